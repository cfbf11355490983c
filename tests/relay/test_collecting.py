"""Garbage in rings is looked for between exchanges only, when it is worth it, and never left to grow."""

import asyncio
import gc
import weakref
from collections.abc import AsyncIterator

import pytest

from gateway.relay.collecting import BUSY_CHECK_S, CHECK_EVERY_S, HARD_LIMIT, QUIET_CHECKS, Collecting

SECOND_NS = 1_000_000_000


class Ring:
    """Refers to itself: no reference count ever frees it."""

    def __init__(self) -> None:
        self.me = self


def rings(number: int) -> "weakref.ref[Ring]":
    """Leave so many rings behind; returns where the last one is seen to live."""
    for _ in range(number):
        last = Ring()
    return weakref.ref(last)


class Desk:
    """A collecting that was started, with a switch in place of lines; times are seconds from the start."""

    def __init__(self) -> None:
        self.is_idle = True
        self.collecting = Collecting(lambda: self.is_idle)

    def check(self, seconds: float) -> float:
        return self.collecting.check(self.start_ns + round(seconds * SECOND_NS))

    def start(self) -> None:
        self.collecting.start()
        self.start_ns = self.collecting._last_ns

    def counts(self) -> tuple[object, ...]:
        status = self.collecting.status()
        return status.collections, status.full, status.forced


@pytest.fixture
async def desk() -> AsyncIterator[Desk]:
    made = Desk()
    made.start()
    yield made
    made.collecting.stop()
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


async def test_python_never_starts_a_collection_by_itself(desk: Desk) -> None:
    before = gc.get_stats()
    seen = rings(10_000)
    assert seen() is not None
    assert gc.get_stats() == before
    assert gc.get_freeze_count() > 10_000  # all that was loaded is out of it


async def test_nothing_is_collected_while_an_exchange_runs(desk: Desk) -> None:
    seen = rings(1000)
    desk.is_idle = False
    assert desk.check(3.0) == BUSY_CHECK_S  # it is due: soon again
    assert desk.counts() == (0, 0, 0)
    assert seen() is not None
    desk.is_idle = True
    assert desk.check(3.02) == CHECK_EVERY_S
    assert desk.counts() == (1, 0, 0)
    assert seen() is None
    status = desk.collecting.status()
    assert isinstance(status.collected, int)
    assert status.collected >= 1000
    assert isinstance(status.longest_us, int)
    assert status.longest_us > 0


async def test_two_collections_are_two_seconds_apart(desk: Desk) -> None:
    rings(1000)
    desk.check(1.9)
    assert desk.counts() == (0, 0, 0)
    desk.check(2.0)
    assert desk.counts() == (1, 0, 0)
    rings(1000)
    desk.check(3.9)
    assert desk.counts() == (1, 0, 0)


async def test_what_is_not_worth_it_is_left(desk: Desk) -> None:
    """Fewer than 700 objects, Python's own threshold; what was freed again already counts for nothing."""
    seen = rings(200)
    for _ in range(10_000):
        assert len([[]]) == 1
    assert desk.check(10.0) == CHECK_EVERY_S
    assert desk.counts() == (0, 0, 0)
    assert seen() is not None


async def test_where_garbage_was_found_the_old_are_looked_at_next(desk: Desk) -> None:
    rings(1000)
    desk.check(2.0)
    desk.check(3.9)
    assert desk.counts() == (1, 0, 0)
    desk.check(4.0)
    assert desk.counts() == (2, 1, 0)
    desk.check(100.0)  # and nothing more: nothing was made since
    assert desk.counts() == (2, 1, 0)


async def test_the_old_are_looked_at_after_ten_collections(desk: Desk) -> None:
    kept: list[list[list[int]]] = []
    for number in range(10):
        kept.append([[] for _ in range(1000)])
        desk.check(2.0 * (number + 1))
    assert desk.counts() == (10, 0, 0)
    desk.check(22.0)
    assert desk.counts() == (11, 1, 0)


async def test_a_ring_that_got_old_is_found_by_a_full_collection(desk: Desk) -> None:
    ring = Ring()
    seen = weakref.ref(ring)
    rings(1000)
    desk.check(2.0)  # survives, and is old now
    del ring
    assert seen() is not None
    desk.check(4.0)
    assert desk.counts() == (2, 1, 0)
    assert seen() is None


async def test_a_full_collection_that_took_long_waits_for_five_quiet_seconds(desk: Desk) -> None:
    kept = [[] for _ in range(HARD_LIMIT - 5000)]  # type: list[list[int]]
    for _ in range(8):
        desk.check(1.0)
        kept += [[] for _ in range(HARD_LIMIT - 5000)]
        desk.collecting._collect_young(0)
    desk.collecting._collect_full(0)  # 400 000 objects: more than 2 ms on any machine
    rings(1000)
    desk.check(2.0)
    collections, full, _ = desk.counts()
    desk.is_idle = False
    desk.check(4.0)
    desk.is_idle = True
    for number in range(QUIET_CHECKS - 1):
        desk.check(4.0 + 0.25 * number)
    assert desk.counts() == (collections, full, 0)
    desk.check(9.0)
    assert desk.counts()[1] == full + 1  # type: ignore[operator]
    assert len(kept) > 0


async def test_memory_does_not_grow_without_end_on_a_line_that_never_rests(desk: Desk) -> None:
    desk.is_idle = False
    seen = rings(HARD_LIMIT)
    assert desk.check(0.25) == CHECK_EVERY_S
    assert desk.counts() == (1, 0, 1)
    assert seen() is None
    for number in range(99):
        rings(HARD_LIMIT) if number == 98 else desk.collecting._collect_young(0)
    desk.check(0.5)
    assert desk.counts()[1:] == (0, 2)
    rings(HARD_LIMIT)
    desk.check(0.75)
    assert desk.counts()[1:] == (1, 3)


async def test_the_timer_asks_by_itself(desk: Desk) -> None:
    seen = rings(HARD_LIMIT)
    async with asyncio.timeout(30):
        while seen() is not None:  # noqa: ASYNC110 - nobody tells when garbage is gone
            await asyncio.sleep(0)
    assert desk.counts() == (1, 0, 0)
