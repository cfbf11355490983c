"""A connection is looked for anew at once when its peer had answered, and more rarely when it had not."""

import asyncio
from itertools import pairwise

import pytest

from gateway.transport import reconnector
from gateway.transport.errors import AbsentError
from gateway.transport.reconnector import Reconnector

NEVER_S = 3600.0
"""The pause after the first attempt that brings nothing: so long nobody waits here."""


async def attempts(monkeypatch: pytest.MonkeyPatch, *heard: bool) -> int:
    """Lose one connection after the other, on each of which something came or not; return how many came."""
    monkeypatch.setattr(reconnector, "BACKOFF_START_S", NEVER_S)
    monkeypatch.setattr(reconnector, "BACKOFF_MAX_S", NEVER_S)
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

    kept = Reconnector(attempt, was_heard, lambda _detail: None)
    kept.start()
    async with asyncio.timeout(10.0):
        await all_lost.wait()
    await kept.stop()
    return made


async def test_a_peer_that_had_answered_is_looked_for_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    assert await attempts(monkeypatch, True, True, True) == 3


async def test_one_that_had_not_answered_is_left_alone_for_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.2):
            await attempts(monkeypatch, False, True)


async def test_one_on_demand_makes_no_attempt_until_it_is_wanted() -> None:
    made = 0

    async def attempt() -> "asyncio.Future[None]":
        nonlocal made
        made += 1
        return asyncio.get_running_loop().create_future()

    kept = Reconnector(attempt, lambda: True, lambda _detail: None, on_demand=True)
    kept.start()
    await asyncio.sleep(0.05)
    assert made == 0
    kept.want()
    async with asyncio.timeout(10.0):
        while kept.opens == 0:  # noqa: ASYNC110 - nobody tells of it
            await asyncio.sleep(0)
    assert made == 1
    await kept.stop()


async def test_who_waits_cuts_a_pause_short_to_one_attempt_in_100_ms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reconnector, "FIRST_RETRY_S", 0.0)
    monkeypatch.setattr(reconnector, "BACKOFF_START_S", NEVER_S)
    monkeypatch.setattr(reconnector, "BACKOFF_MAX_S", NEVER_S)
    at_s: list[float] = []

    async def attempt() -> "asyncio.Future[None]":
        at_s.append(asyncio.get_running_loop().time())
        raise AbsentError("nobody is there")

    kept = Reconnector(attempt, lambda: False, lambda _detail: None)
    kept.start()
    async with asyncio.timeout(10.0):
        while len(at_s) < 4:
            kept.want()
            await asyncio.sleep(0.005)
    await kept.stop()
    # The first attempt, then one for each 100 ms.
    assert all(after - before >= 0.099 for before, after in pairwise(at_s))
