"""What every test needs."""

import functools
import gc
import signal
from collections.abc import Generator
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule
from hypothesis import HealthCheck, settings

from gateway.exchange.axis import impossible
from tests import needs
from tests.soak import repeated

# How long an example takes says how busy the machine is; what is fast enough is the business of `bench/`.
settings.register_profile(
    "any machine",
    deadline=None,
    max_examples=repeated(1000),
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("any machine")

# What cannot be in a state of an axis is a bug: here it is raised.
impossible.raise_them()

# A shell that starts us in the background, as some CI runners do, has us ignore SIGINT, and so would every
# program that a test starts: Ctrl-C would then go unheard.  With Python's own handler here, they hear it.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(needs)


def pytest_collection() -> None:
    """Look for no garbage while tests are collected: hardly anything of it is."""
    gc.disable()


@pytest.hookimpl(wrapper=True)
def pytest_collect_file() -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Look for doctests only in files that have some: each worker would load and search all others too."""
    collectors = yield
    return [each for each in collectors if not isinstance(each, DoctestModule) or _has_doctest(each.path)]


def _has_doctest(file: Path) -> bool:
    return ">>> " in file.read_text(encoding="utf-8")


FREEZE_EVERY = 50
"""Tests: what they leave would make full collections take seconds, for which a relay stands still."""


class _Thawing:
    """Spares the garbage collections of a test the thousands of tests that were collected."""

    def __init__(self) -> None:
        self.unfreeze = gc.unfreeze
        self.has_thawed = True
        self.tests = 0
        gc.unfreeze = self.thawed

    def thawed(self) -> None:
        """A relay in this process puts all of it back at its end."""
        self.has_thawed = True
        self.unfreeze()

    def freeze(self) -> None:
        """Take it out again where it was put back; to ask gc for it would walk through all of it.

        Only what lately came is looked through first, which is where a test leaves its rings.
        """
        self.tests += 1
        if self.has_thawed or self.tests % FREEZE_EVERY == 0:
            gc.collect(1)
            gc.freeze()
            self.has_thawed = False


_thawing = _Thawing()


def pytest_collection_finish() -> None:
    gc.enable()
    _thawing.freeze()


def pytest_runtest_logfinish() -> None:
    _thawing.freeze()


def pytest_sessionfinish() -> None:
    gc.unfreeze()


FIRST = (
    "tests/package/",
    "tests/metrology/test_what_lies_between.py",
    "tests/supervisor/page/test_page_for_everybody.py",
    "tests/service/",
    "tests/supervisor/page/test_page_shows.py",
    "tests/processes/test_watched_tables.py",
    "tests/relay/test_kills_at_any_instant.py",
    "tests/tools/test_bootstrap.py",
    "tests/compiled/",
    "tests/measure/",
    "tests/processes/test_configuration_reload.py",
    "tests/processes/test_stalled_log.py",
    "tests/processes/test_two_services.py",
    "tests/processes/test_sick_line.py",
    "tests/verify/",
    "tests/supervisor/page/",
    "tests/report/test_writing.py",
    "tests/simulator/test_demo_command.py",
    "tests/cli/test_table_between_points.py",
    "tests/docs/test_guides.py",
    "tests/tabfile/test_every_pair.py",
    "tests/tabfile/test_mutants.py",
)
"""Long, each file of them: begun last, one worker would have them while the others have nothing to do."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest, and with what waits for programs: the others have work meanwhile."""
    items.sort(key=lambda item: _place_in_order(item.nodeid.partition("::")[0], item.path))


@functools.cache
def _place_in_order(file: str, path: Path) -> tuple[int, bool]:
    place = next((place for place, first in enumerate(FIRST) if file.startswith(first)), len(FIRST))
    return place, needs.needs_of(path) <= needs.MARKS["anywhere"]
