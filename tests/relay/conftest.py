"""The loop that a relay runs on, and a bench with one relay for each test."""

import asyncio
from collections.abc import AsyncIterator, Callable

import pytest

from gateway.transport.loop import RelayLoop
from tests.support.relay import Bench


def pytest_asyncio_loop_factories() -> dict[str, Callable[[], asyncio.AbstractEventLoop]]:
    """The loop that a relay runs on."""
    return {"relay": RelayLoop}


@pytest.fixture
async def bench() -> AsyncIterator[Bench]:
    bench = Bench()
    async with bench.stack:
        yield bench
