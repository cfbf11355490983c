"""What each file of tests costs: ``make costs``, or ``pytest -p tests.costs`` with any tests.

Processor time is that of the worker and of the programs that its tests started and saw end. The rest of a
file's seconds is time that it waited, or that others had the processor.
"""

import resource
import time
from collections import defaultdict
from collections.abc import Generator
from dataclasses import dataclass
from typing import Final

import pytest

SHOWN: Final = 40
"""Files."""
NAME: Final = "costs"
"""Of what a worker adds to the report of a test."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Seconds."""

    own: float = 0.0
    programs: float = 0.0
    wall: float = 0.0
    tests: int = 0

    def __add__(self, other: "Cost") -> "Cost":
        return Cost(
            self.own + other.own,
            self.programs + other.programs,
            self.wall + other.wall,
            self.tests + other.tests,
        )


def _spent() -> tuple[float, float, float]:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    own, programs = (each.ru_utime + each.ru_stime for each in used)
    return own, programs, time.monotonic()


class _Costs:
    def __init__(self) -> None:
        self.before = _spent()
        self.of_files: defaultdict[str, Cost] = defaultdict(Cost)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self) -> Generator[None, object, object]:
        self.before = _spent()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        if call.when == "teardown":
            spent = [after - before for after, before in zip(_spent(), self.before, strict=True)]
            report.user_properties.append((NAME, spent))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        for name, spent in report.user_properties:
            if name == NAME and report.when == "teardown":
                assert isinstance(spent, list)
                own, programs, wall = spent
                self.of_files[report.nodeid.partition("::")[0]] += Cost(own, programs, wall, tests=1)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        def line(cost: Cost, what: str) -> None:
            terminalreporter.write_line(
                f"{cost.own:9.1f} {cost.programs:9.1f} {cost.wall:9.1f} {cost.tests:6d}  {what}"
            )

        terminalreporter.section("seconds of the processor")
        terminalreporter.write_line("      own  programs      wall  tests")
        files = sorted(self.of_files.items(), key=lambda item: -item[1].own - item[1].programs)
        for file, cost in files[:SHOWN]:
            line(cost, file)
        line(sum(self.of_files.values(), Cost()), f"all {len(files)} files")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(_Costs())
