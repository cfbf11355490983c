"""Which test of ``tests/exchange`` notices a mutant that no small world notices?

The tests run in one process, with the broken file in place of the file. Those files of tests are asked that
run through the broken line, the quickest first. The first test that fails is named in the verdict.
"""

import json
import multiprocessing
import os
import resource
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from tests.verify.breaking import ROOT, Mutant

TESTS: Final = ROOT / "tests" / "exchange"
MOST_BYTES: Final = 6 << 30
NEVER_ENDS_S: Final = 60.0
"""Seconds of the processor after which a file of tests never ends: the slowest takes a tenth of it."""
OPTIONS: Final = ("-x", "-q", "-n0", "--no-header", "-p", "no:cacheprovider", "-p", "no:randomly")


@dataclass(frozen=True)
class Ran:
    """What a file of tests runs through, and how long it takes."""

    file: str
    seconds: float
    lines: dict[str, set[int]]


class _FirstFailure:
    """A plugin of pytest that keeps the name of the first test that failed."""

    def __init__(self) -> None:
        self.name = ""

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.name:
            self.name = report.nodeid

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed and not self.name:
            self.name = report.nodeid


def _run(file: str) -> str:
    """Run a file of tests in this process and return the first one that failed; "": none did."""
    import pytest

    failure = _FirstFailure()
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        code = pytest.main([*OPTIONS, file], plugins=[failure])
    return failure.name or ("" if code in (0, 5) else file)


def _traced(file: str, sources: Sequence[str]) -> tuple[str, float, dict[str, list[int]]]:
    met: dict[str, set[int]] = {source: set() for source in sources}
    absolute = {str(ROOT / source): source for source in sources}

    def on_call(frame: Any, _event: str, _argument: object) -> Any:
        source = absolute.get(frame.f_code.co_filename)
        if source is None:
            return None
        add = met[source].add

        def on_line(frame: Any, _event: str, _argument: object) -> Any:
            add(frame.f_lineno)
            return on_line

        add(frame.f_lineno)
        return on_line

    began_s = time.process_time()
    sys.settrace(on_call)
    try:
        _run(file)
    finally:
        sys.settrace(None)
    return file, time.process_time() - began_s, {key: sorted(lines) for key, lines in met.items() if lines}


def all_tests(sources: Sequence[Path], path: Path, jobs: int) -> list[Ran]:
    """Return what each file of tests runs through; kept in ``path`` for the same sources and tests."""
    files = sorted(str(each.relative_to(ROOT)) for each in TESTS.glob("test_*.py"))
    digest = sha256(
        b"".join(each.read_bytes() for each in sorted((*sources, *TESTS.glob("*.py"))))
    ).hexdigest()
    kept = path.read_text().splitlines() if path.exists() else []
    if kept[:1] != [digest]:
        names = [str(each.relative_to(ROOT)) for each in sources]
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(jobs, mp_context=context, max_tasks_per_child=1) as pool:
            found = [pool.submit(_traced, file, names) for file in files]
            kept = [digest, *(json.dumps(each.result()) for each in found)]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(kept) + "\n")
    rows = [json.loads(row) for row in kept[1:]]
    return [Ran(file, seconds, {key: set(lines) for key, lines in by.items()}) for file, seconds, by in rows]


def _try(mutant: Mutant, files: Sequence[str], answer: Any) -> None:
    """Run the tests with a mutant; runs in a process that has loaded nothing of the gateway."""
    from tests.verify.mutants import BrokenFile

    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    sys.meta_path.insert(0, BrokenFile(mutant))  # type: ignore[arg-type]
    for file in files:
        answer.send(file)
        failed = _run(file)
        if failed:
            answer.send((failed,))
            return
    answer.send(None)


def noticed(mutant: Mutant, ran: Sequence[Ran]) -> str:
    """Return the first test that fails with a mutant; "": none does."""
    from tests.verify.mutants import ENDLESS, heard

    lines = {mutant.line, mutant.statement_line}
    is_row = "." not in mutant.unit and mutant.unit.isupper()
    reaching = [each for each in ran if is_row or lines & each.lines.get(mutant.file, set())]
    files = [each.file for each in sorted(reaching, key=lambda each: each.seconds)]
    if not files:
        return ""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=_try, args=(mutant, files, theirs))
    process.start()
    theirs.close()
    file = files[0]
    try:
        while (found := heard(ours, process, NEVER_ENDS_S)) is not ENDLESS:
            if isinstance(found, str):
                file = found
            else:
                break
        else:
            return f"{file}: never ends"
    except EOFError:
        return f"{file}: the process ended"
    else:
        return found[0] if found else ""
    finally:
        process.kill()
        process.join()
