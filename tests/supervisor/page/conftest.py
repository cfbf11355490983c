"""A browser for the whole module, and a visit of its own for each test."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.supervisor.page.models import curve, model
from tests.supervisor.page.stage import Stage
from tests.supervisor.page.visit import Tabs, Visit
from tests.support.browser import started_browser


@pytest.fixture(scope="module")
def tabs() -> Iterator[Tabs]:
    """For one module only: while a browser lives, no test can run an event loop of its own."""
    with started_browser() as browser:
        yield Tabs(browser)


@pytest.fixture
def stage() -> Iterator[Stage]:
    """A gateway with one axis that is well."""
    stage = Stage()
    stage.open()
    stage.tables["x"] = curve()
    stage.show(model())
    try:
        yield stage
    finally:
        stage.close()


@pytest.fixture
def visit(tabs: Tabs, stage: Stage, request: pytest.FixtureRequest) -> Iterator[Visit]:
    """The page, opened, with its axes; ``visit`` marks give the browser's options.

    At the end it must have fetched nothing but from the gateway, and have complained of nothing.
    """
    options: dict[str, Any] = getattr(request, "param", {})
    visit = Visit(tabs, stage, options)
    try:
        yield visit
        assert visit.elsewhere == []
        assert visit.complaints == []
    finally:
        visit.close()
