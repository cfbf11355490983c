"""A service for each test that needs no other one."""

from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.supervisor.http.http_bench import Served, model, serving


@pytest.fixture
async def served(tmp_path: Path) -> AsyncIterator[Served]:
    """A service that has heard of no relay yet."""
    async with serving(tmp_path) as served:
        yield served


@pytest.fixture
async def showing(tmp_path: Path) -> AsyncIterator[Served]:
    """A service that shows a gateway that is well."""
    async with serving(tmp_path, newest=model()) as served:
        yield served
