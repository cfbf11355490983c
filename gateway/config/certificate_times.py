"""What a check says of files of certificates that are not good, or not for long."""

from datetime import datetime
from pathlib import Path

from gateway.config.findings import Findings
from gateway.config.toml_lines import KeyPath
from gateway.files import FileRefusedError
from gateway.transport.certificate_times import list_problem, time_problem


def warn_of_times(findings: Findings, key: KeyPath, path: Path, now: datetime) -> None:
    """Warn of every certificate of a file that OpenSSL has taken and that is not, or not for long, good.

    No more than that: whoever looks is turned away by such a page or broker, but axes go on to be corrected.
    """
    from gateway.transport.certificate_facts import read_facts

    try:
        certificates = read_facts(path)
    except FileRefusedError as error:
        findings.warn(key, f"{path}: until when it is good could not be read ({error.found})", error.remedy)
        return
    for facts in certificates:
        problem = time_problem(facts, now)
        if problem is not None:
            findings.warn(key, problem.found, problem.remedy)


def warn_of_list(findings: Findings, key: KeyPath, path: Path, now: datetime) -> None:
    """Warn of a list of revoked certificates that has run out, or soon will: nobody comes in then."""
    from gateway.transport.certificate_facts import list_ends

    try:
        _, ends = list_ends(path)
    except FileRefusedError as error:
        findings.warn(key, f"{path}: until when it is good could not be read ({error.found})", error.remedy)
        return
    problem = list_problem(str(path), ends, now)
    if problem is not None:
        findings.warn(key, problem.found, problem.remedy)
