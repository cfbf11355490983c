"""A connection is looked for anew at once when its peer had answered, and more rarely when it had not."""

import asyncio

import pytest

from gateway.transport import keeper
from gateway.transport.keeper import Keeper

NEVER_S = 3600.0
"""The pause after the first attempt that brings nothing: so long nobody waits here."""


async def attempts(monkeypatch: pytest.MonkeyPatch, *heard: bool) -> int:
    """Lose one connection after the other, on each of which something came or not; return how many came."""
    monkeypatch.setattr(keeper, "BACKOFF_START_S", NEVER_S)
    monkeypatch.setattr(keeper, "BACKOFF_MAX_S", NEVER_S)
    left, made = list(heard), 0
    all_lost = asyncio.Event()

    async def attempt() -> "asyncio.Future[None]":
        nonlocal made
        made += 1
        lost = asyncio.get_running_loop().create_future()
        lost.set_result(None)
        return lost

    def was_heard() -> bool:
        answer = left.pop(0)
        if not left:
            all_lost.set()
        return answer

    kept = Keeper(attempt, was_heard, lambda _detail: None)
    kept.start()
    async with asyncio.timeout(10.0):
        await all_lost.wait()
    await kept.stop()
    return made


async def test_a_peer_that_had_answered_is_looked_for_at_once_each_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert await attempts(monkeypatch, True, True, True) == 3


async def test_one_that_had_not_answered_is_left_alone_for_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.2):
            await attempts(monkeypatch, False, True)
