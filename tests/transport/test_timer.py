"""The microsecond timer."""

import asyncio
import itertools

import pytest

from gateway.clock import boot_ns
from gateway.transport.timer import Timer

US = 1000


class Firings:
    """Collects the times of a timer's callbacks."""

    def __init__(self) -> None:
        self.times_ns: list[int] = []
        self._event = asyncio.Event()

    def __call__(self, now_ns: int) -> None:
        self.times_ns.append(now_ns)
        self._event.set()

    async def first(self) -> int:
        async with asyncio.timeout(30):
            await self._event.wait()
        return self.times_ns[0]


async def test_it_fires_once_and_never_early() -> None:
    for delay_us in (50, 200, 1750):
        firings = Firings()
        timer = Timer(firings)
        deadline_ns = boot_ns() + delay_us * US
        timer.arm(deadline_ns)
        assert await firings.first() >= deadline_ns
        assert timer.deadline_ns is None
        timer.close()
        assert len(firings.times_ns) == 1


async def test_most_firings_are_within_a_fraction_of_a_millisecond() -> None:
    late_ns = []
    for _ in range(20):
        firings = Firings()
        timer = Timer(firings)
        deadline_ns = boot_ns() + 300 * US
        timer.arm(deadline_ns)
        late_ns.append(await firings.first() - deadline_ns)
        timer.close()
    assert min(late_ns) < 700 * US  # the loop's own timers wake a whole millisecond later at best


async def test_a_deadline_in_the_past_fires_at_once() -> None:
    firings = Firings()
    timer = Timer(firings)
    timer.arm(1)
    await firings.first()
    timer.close()


@pytest.mark.parametrize(
    ("first_us", "then_us", "by_us"), [(500, 2500, 60_000_000), (60_000_000, 500, 5_000_000)]
)
async def test_a_deadline_moved_later_or_earlier_holds(first_us: int, then_us: int, by_us: int) -> None:
    firings = Firings()
    timer = Timer(firings)
    start_ns = boot_ns()
    timer.arm(start_ns + first_us * US)
    timer.arm(start_ns + then_us * US)
    assert start_ns + then_us * US <= await firings.first() < start_ns + by_us * US
    timer.close()


async def test_a_deadline_taken_away_does_not_fire_and_a_new_one_does() -> None:
    taken, other = Firings(), Firings()
    timer, witness = Timer(taken), Timer(other)
    start_ns = boot_ns()
    timer.arm(start_ns + 300 * US)
    timer.arm(None)
    witness.arm(start_ns + 1000 * US)
    await other.first()
    assert taken.times_ns == []
    timer.arm(start_ns + 1500 * US)
    assert await taken.first() >= start_ns + 1500 * US
    timer.close()
    witness.close()


async def test_a_callback_may_arm_its_timer_again() -> None:
    times_ns: list[int] = []
    done = asyncio.Event()

    def again(now_ns: int) -> None:
        times_ns.append(now_ns)
        timer.arm(now_ns + 200 * US) if len(times_ns) < 4 else done.set()

    timer = Timer(again)
    timer.arm(boot_ns())
    async with asyncio.timeout(30):
        await done.wait()
    timer.close()
    assert all(later - earlier >= 200 * US for earlier, later in itertools.pairwise(times_ns))


async def test_a_closed_timer_is_silent_and_may_be_closed_again() -> None:
    closed, other = Firings(), Firings()
    timer, witness = Timer(closed), Timer(other)
    timer.arm(boot_ns() + 100 * US)
    timer.close()
    timer.close()
    timer.arm(boot_ns())
    witness.arm(boot_ns() + 500 * US)
    await other.first()
    witness.close()
    assert closed.times_ns == []
