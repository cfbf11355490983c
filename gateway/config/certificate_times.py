"""From when until when a certificate is good, and what is said of one that has ended or soon will."""

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gateway.config.findings import Findings
from gateway.config.toml_lines import KeyPath
from gateway.files import FileRefusedError

if TYPE_CHECKING:
    from gateway.transport.certificate_facts import Facts

SOON: Final = timedelta(days=30)
"""So long before its end a certificate is warned of."""


@dataclass(frozen=True, slots=True)
class TimeProblem:
    """What is wrong with the time of a certificate; ``is_good_now``: nothing yet."""

    found: str
    remedy: str
    is_good_now: bool


def time_problem(facts: "Facts", now: datetime) -> TimeProblem | None:
    """Return what is to be said of a certificate's time, None for nothing."""
    if facts.ends < now:
        found = f"{facts.subject} expired on {day(facts.ends)}"
        return TimeProblem(found, "give one that is good; if this is, set the clock", is_good_now=False)
    if facts.begins > now:
        found = f"{facts.subject} is good from {day(facts.begins)} on only"
        return TimeProblem(found, "wait until then, or set the clock if it is wrong", is_good_now=False)
    if facts.ends < now + SOON:
        found = f"{facts.subject} expires on {day(facts.ends)}"
        return TimeProblem(found, "have it renewed before", is_good_now=True)
    return None


def list_problem(name: str, ends: datetime | None, now: datetime) -> TimeProblem | None:
    """Return what is to be said of a list of revoked certificates that has run out, or soon will."""
    if ends is None or ends >= now + SOON:
        return None
    when = "out of date since" if ends < now else "good until"
    remedy = "have the authority write a new list: with one that is out of date nobody comes in"
    return TimeProblem(f"{name} is {when} {day(ends)}", remedy, is_good_now=ends >= now)


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


def day(when: datetime) -> str:
    """Return the day of a time, for people."""
    return when.date().isoformat()
