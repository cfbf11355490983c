"""Tasks end when they are told to, also where a cancellation is swallowed."""

import asyncio
import contextlib

import pytest

from gateway.supervisor.mqtt.ending import apart, end


async def swallows(times: int) -> str:
    for _ in range(times):
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.Event().wait()
    await asyncio.Event().wait()
    return "never"


async def test_a_task_that_swallows_cancellations_is_told_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.supervisor.mqtt.ending.AGAIN_S", 0.0)
    tasks = [asyncio.create_task(swallows(times)) for times in (0, 1, 5)]
    await asyncio.sleep(0)
    await end(tasks)
    assert all(task.cancelled() for task in tasks)


async def test_who_waits_for_one_hears_its_own_cancellation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.supervisor.mqtt.ending.AGAIN_S", 0.0)
    waiting = asyncio.create_task(apart(swallows(3)))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting


async def test_results_and_errors_come_through() -> None:
    async def fails() -> None:
        raise ValueError("so")

    assert await apart(asyncio.sleep(0, "result")) == "result"
    with pytest.raises(ValueError, match="so"):
        await apart(fails())
