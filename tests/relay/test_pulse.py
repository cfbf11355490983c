"""A loop that stood still is noticed, whether the beat comes before what had waited is read or after it."""

import asyncio
import time

from gateway.clock import boot_ns
from gateway.relay.pulse import Beats, Pulse

MS = 1_000_000


def test_what_waited_longer_than_an_impatient_controller_waits_is_old_however_short_the_standstill() -> None:
    """Beats are due every 20 ms. 280 ms late is not worth an event; 150 ms are over all the same."""
    beats = Beats()
    assert beats.beat(1000 * MS) == 0
    assert beats.stood_still(1300 * MS, 150 * MS)
    assert beats.beat(1300 * MS) == 0
    assert beats.stood_still(1300 * MS, 150 * MS)
    assert not beats.stood_still(1300 * MS, 300 * MS)
    assert beats.stood_still(1325 * MS, 5 * MS)  # the next beat is due at 1320 ms, and 5 ms late by now
    assert not beats.stood_still(1335 * MS, 150 * MS)


async def test_what_is_read_before_and_after_the_late_beat_had_waited() -> None:
    told: list[int] = []
    beats: list[int] = []
    pulse = Pulse(told.append, lambda: beats.append(len(told)))
    while not pulse.stood_still(boot_ns() + 1000 * MS, 500 * MS):  # noqa: ASYNC110 - before its first beat
        await asyncio.sleep(0)
    assert not pulse.stood_still(boot_ns(), 100 * MS)
    time.sleep(0.8)  # noqa: ASYNC251 - the loop is to stand still
    assert pulse.stood_still(boot_ns(), 500 * MS)
    while not told:  # noqa: ASYNC110 - one turn after the other, and no longer
        await asyncio.sleep(0)
    after_ns = boot_ns()
    assert pulse.stood_still(after_ns, 500 * MS)
    assert not pulse.stood_still(after_ns, 2000 * MS)
    assert not pulse.stood_still(after_ns + 35 * MS, 500 * MS)
    assert 600 * MS < told[0] < 2000 * MS
    assert beats == [0, 1]  # its first one, and the late one
    pulse.close()
