"""Run benches between two serial wires in three ways: stored, and cut through at once or by characters."""

from typing import Final

import pytest

from gateway.compiled import is_compiled
from gateway.exchange.axis import impossible
from tests.exchange.line_bench import Arrival, Bench

OWN_LINES: Final = (
    "test_cut_",
    "test_fast_path",
    "test_link_",
    "test_renewal",
    "test_streams_with",
    "test_terms",
)
"""Modules that put lines of their own together, or work out whole streams for minutes."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run each test of such a bench once for every way in which requests may come."""
    name = metafunc.module.__name__.rpartition(".")[2]
    has_bench = any(
        isinstance(each, type) and issubclass(each, Bench) for each in vars(metafunc.module).values()
    )
    if has_bench and not name.startswith(OWN_LINES):
        metafunc.parametrize("arrival", list(Arrival), indirect=True, ids=lambda each: each.value)


@pytest.fixture(autouse=True)
def arrival(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Arrival:
    """How the requests of a test's benches come."""
    arrival: Arrival = getattr(request, "param", Arrival.STORED)
    monkeypatch.setattr(Bench, "arrival", arrival)
    return arrival


@pytest.fixture
def in_production(monkeypatch: pytest.MonkeyPatch) -> None:
    """An impossible event is reported, as in production, not raised."""
    if is_compiled():
        pytest.skip("the switch is no attribute of what is compiled")
    monkeypatch.setattr(impossible, "_is_raised", False)
