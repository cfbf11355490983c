"""Which test of ``tests/exchange`` notices a mutant that no small world notices?

The tests run in one process, with the mutant in place of the method or file. Those tests are asked that run
through the broken line, the quickest first. The first test that fails is named in the verdict.
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
NEVER_ENDS_S: Final = 30.0
"""Seconds of the processor after which a test never ends: the slowest takes a tenth of it."""
OPTIONS: Final = ("-x", "-q", "-n0", "--no-header", "-p", "no:cacheprovider", "-p", "no:randomly")
COLLECTED: Final = multiprocessing.get_context("forkserver")
"""Its processes begin with all tests imported, as copies of one that has collected them."""
COLLECTED.set_forkserver_preload(["tests.verify.mutants_collected"])


@dataclass(frozen=True)
class Ran:
    """What a test runs through, and how long it takes."""

    test: str
    seconds: float
    lines: dict[str, set[int]]


def run_pytest(*arguments: str, plugin: object = None) -> int:
    """Run pytest in this process, and say nothing; returns its exit code."""
    import pytest

    plugins = [] if plugin is None else [plugin]
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        return int(pytest.main([*OPTIONS, *arguments], plugins=plugins))


class _Tracer:
    """A plugin of pytest that notes for each test the lines of the sources that it runs through."""

    def __init__(self, sources: Sequence[str]) -> None:
        self._sources = {str(ROOT / source): source for source in sources}
        self._met: dict[str, set[int]] = {}
        self._began_s = 0.0
        self.rows: list[tuple[str, float, dict[str, list[int]]]] = []

    def pytest_runtest_logstart(self) -> None:
        self._met = {source: set() for source in self._sources.values()}
        self._began_s = time.process_time()
        sys.settrace(self._on_call)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        sys.settrace(None)
        lines = {source: sorted(met) for source, met in self._met.items() if met}
        if lines:
            self.rows.append((nodeid, round(time.process_time() - self._began_s, 4), lines))

    def _on_call(self, frame: Any, _event: str, _argument: object) -> Any:
        source = self._sources.get(frame.f_code.co_filename)
        if source is None:
            return None
        add = self._met[source].add

        def on_line(frame: Any, _event: str, _argument: object) -> Any:
            add(frame.f_lineno)
            return on_line

        add(frame.f_lineno)
        return on_line


def _traced(file: str, sources: Sequence[str]) -> list[tuple[str, float, dict[str, list[int]]]]:
    tracer = _Tracer(sources)
    run_pytest(file, plugin=tracer)
    return tracer.rows


def all_tests(sources: Sequence[Path], path: Path, jobs: int) -> list[Ran]:
    """Return what each test runs through; kept in ``path`` for the same sources and tests."""
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
            kept = [digest, *(json.dumps(row) for each in found for row in each.result())]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(kept) + "\n")
    rows = [json.loads(row) for row in kept[1:]]
    return [Ran(test, seconds, {key: set(lines) for key, lines in by.items()}) for test, seconds, by in rows]


class _Asked:
    """A plugin of pytest that sends the name of each test before it runs, and of the first that failed."""

    def __init__(self, answer: Any) -> None:
        self._answer = answer
        self.failed = ""

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._answer.send(nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid


def _try(mutant: Mutant, tests: Sequence[str], answer: Any) -> None:
    """Run the tests with a mutant, in a process of its own; sent last is the one that failed, or None."""
    from tests.verify.mutants import load

    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    load(mutant)
    asked = _Asked(answer)
    code = run_pytest(*tests, plugin=asked)
    failed = asked.failed or ("" if code in (0, 5) else tests[0])
    answer.send((failed,) if failed else None)


def noticed(mutant: Mutant, ran: Sequence[Ran]) -> str:
    """Return the first test that fails with a mutant; "": none does."""
    from tests.verify.mutants import ENDLESS, heard

    lines = {mutant.line, mutant.statement_line}
    is_row = "." not in mutant.unit and mutant.unit.isupper()
    reaching = [each for each in ran if is_row or lines & each.lines.get(mutant.file, set())]
    tests = [each.test for each in sorted(reaching, key=lambda each: each.seconds)]
    if not tests:
        return ""
    ours, theirs = multiprocessing.Pipe()
    process = COLLECTED.Process(target=_try, args=(mutant, tests, theirs))
    process.start()
    theirs.close()
    test = tests[0]
    try:
        while (found := heard(ours, process, NEVER_ENDS_S)) is not ENDLESS:
            if isinstance(found, str):
                test = found
            else:
                break
        else:
            return f"{test}: never ends"
    except EOFError:
        return f"{test}: the process ended"
    else:
        return found[0] if found else ""
    finally:
        process.kill()
        process.join()
