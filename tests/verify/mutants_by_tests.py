"""Which test of ``tests/exchange`` notices a mutant?

One process collects all tests once. For each mutant a copy of it runs tests, with the mutant in place of the
method; where a file is broken outside of its methods, the copy imports and collects anew. Those tests are
asked that run through the broken line: first what has noticed others of the same method, then the quickest.
The first test that fails is named in the verdict.
"""

import json
import multiprocessing
import os
import resource
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from hashlib import sha256
from itertools import pairwise, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from tests.verify.breaking import ROOT, Mutant

if TYPE_CHECKING:
    from tests.verify.mutants import Verdict

TESTS: Final = ROOT / "tests" / "exchange"
MOST_BYTES: Final = 6 << 30
NEVER_ENDS_S: Final = 30.0
"""Seconds of the processor after which a test never ends: the slowest takes a tenth of it."""
OPTIONS: Final = ("-x", "-q", "-n0", "--no-header", "-p", "no:cacheprovider", "-p", "no:randomly")
COPIED: Final = multiprocessing.get_context("fork")
"""Its processes begin as copies of one that has collected all tests."""


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
    """Return what each test runs through; kept in ``path`` by file of tests."""
    files = sorted(TESTS.glob("test_*.py"))
    shared = _digest((*sources, *(each for each in TESTS.glob("*.py") if each not in files)))
    known: dict[str, dict[str, Any]] = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        row = json.loads(line)
        known[row["file"]] = row
    wanted = {str(each.relative_to(ROOT)): f"{shared}{_digest((each,))}" for each in files}
    left = [file for file in wanted if file not in known or known[file]["digest"] != wanted[file]]
    names = [str(each.relative_to(ROOT)) for each in sources]
    path.parent.mkdir(parents=True, exist_ok=True)
    context = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(jobs, mp_context=context, max_tasks_per_child=1) as pool,
        path.open("a") as kept,
    ):
        for file, found in zip(left, pool.map(_traced, left, repeat(names)), strict=True):
            known[file] = {"file": file, "digest": wanted[file], "tests": found}
            kept.write(f"{json.dumps(known[file])}\n")
            kept.flush()
    return [
        Ran(test, seconds, {key: set(lines) for key, lines in by.items()})
        for file in wanted
        for test, seconds, by in known[file]["tests"]
    ]


def _digest(paths: Iterable[Path]) -> str:
    return sha256(b"".join(each.read_bytes() for each in sorted(paths))).hexdigest()[:16]


class _Asked:
    """A plugin of pytest that sends the name of each test before it runs, and knows the first that failed."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer
        self.failed = ""

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.answer.send(nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid


class _Serving(_Asked):
    """A plugin of pytest that asks collected tests about mutants, in place of running all."""

    def __init__(self, requests: Any) -> None:
        super().__init__(None)
        self._requests = requests
        self._items: dict[str, Any] = {}

    def pytest_runtestloop(self, session: Any) -> bool:
        """Answer until the end of the requests."""
        self._items = {item.nodeid: item for item in session.items}
        while (asked := self._requests.recv()) is not None:
            self._requests.send(self._noticed(*asked))
        return True

    def _noticed(self, mutant: Mutant, compiled: bytes, tests: Sequence[str]) -> str:
        """Return the first of some tests that fails with a mutant; "": none does."""
        from tests.verify.mutants import ENDLESS, heard

        ours, theirs = multiprocessing.Pipe()
        process = COPIED.Process(target=self._try, args=(mutant, compiled, tests, theirs))
        process.start()
        theirs.close()
        test = tests[0]
        try:
            while (found := heard(ours, process, NEVER_ENDS_S)) is not ENDLESS:
                if isinstance(found, str):
                    test = found
                else:
                    return found[0] if found else ""
        except EOFError:
            return f"{test}: the process ended"
        else:
            return f"{test}: never ends"
        finally:
            process.kill()
            process.join()

    def _try(self, mutant: Mutant, compiled: bytes, tests: Sequence[str], answer: Any) -> None:
        """Run the tests with a mutant; sent last is the one that failed, or None."""
        from tests.verify.mutants import load

        resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
        self.answer = answer
        if load(mutant, compiled):
            items = [self._items[test] for test in tests]
            for item, following in pairwise((*items, None)):
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                if self.failed:
                    break
            failed = self.failed
        else:
            asked = _Asked(answer)
            code = run_pytest(*tests, plugin=asked)
            failed = asked.failed or ("" if code in (0, 5) else tests[0])
        answer.send((failed,) if failed else None)


def _serve(requests: Any) -> None:
    run_pytest(str(TESTS), plugin=_Serving(requests))


class CollectedTests:
    """All tests of the exchange, collected in a process of its own."""

    def __init__(self) -> None:
        self._requests: Any = None
        """None: the process is not running."""

    def noticed(self, mutant: Mutant, tests: Sequence[str]) -> str:
        """Return the first of some tests that fails with a mutant; "": none does."""
        if not tests:
            return ""
        if self._requests is None:
            self._requests, theirs = multiprocessing.Pipe()
            context = multiprocessing.get_context("spawn")
            context.Process(target=_serve, args=(theirs,)).start()
            theirs.close()
        self._requests.send((mutant, mutant.code(), tests))
        return str(self._requests.recv())

    def end(self) -> None:
        """End the process."""
        if self._requests is not None:
            self._requests.send(None)
            self._requests = None


class Asker:
    """Asks the tests about mutants. Those that noticed others of the same method go first."""

    def __init__(self, ran: Sequence[Ran], most_s: float, verdicts: Iterable["Verdict"]) -> None:
        self._ran, self._most_s = ran, most_s
        self._tests = CollectedTests()
        self._by_unit: Counter[tuple[str, str]] = Counter()
        for verdict in verdicts:
            self._note(verdict.name, verdict.test)

    def _note(self, name: str, test: str | None) -> None:
        if test:
            self._by_unit[_unit_of(name), test.partition(": ")[0]] += 1

    def __call__(self, mutant: Mutant) -> str | None:
        """Return the first test that fails; "": none does; None: not all were asked."""
        met: set[str] = set()
        order: list[tuple[int, bool, float, str]] = []
        for each in sorted(reaching(mutant, self._ran), key=lambda each: each.seconds):
            case = each.test.partition("[")[0]
            kills = self._by_unit[_unit_of(mutant.name), each.test]
            order.append((-kills, case in met, each.seconds, each.test))
            met.add(case)
        order.sort()
        left_s, tests = self._most_s or float("inf"), []
        for _, _, seconds, test in order:
            left_s -= seconds
            if left_s > 0.0:
                tests.append(test)
        test = self._tests.noticed(mutant, tests)
        self._note(mutant.name, test)
        return test if test or len(tests) == len(order) else None

    def end(self) -> None:
        """End the process of the tests."""
        self._tests.end()


def _unit_of(name: str) -> str:
    return ":".join(name.split(":")[:2])


def reaching(mutant: Mutant, ran: Sequence[Ran]) -> list[Ran]:
    """Return the tests that run through the place of a mutant; of a table: all."""
    lines = {mutant.line, mutant.statement_line}
    is_row = "." not in mutant.unit and mutant.unit.isupper()
    return [each for each in ran if is_row or lines & each.lines.get(mutant.file, set())]
