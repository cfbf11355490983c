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
    pulse = Pulse(told.append)
    pulse.on_beat.append(lambda: beats.append(len(told)))
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


async def test_traffic_stands_for_beats_and_tells_of_a_standstill_as_they_do() -> None:
    """Beats are due every 20 ms. Traffic counts as one from 10 ms after the last on."""
    told: list[int] = []
    beats: list[int] = []
    pulse = Pulse(told.append)
    pulse.on_beat.append(lambda: beats.append(len(told)))
    while not beats:  # noqa: ASYNC110 - before its first beat
        await asyncio.sleep(0)
    start_ns = pulse._due_ns - 20 * MS
    for ms in (1, 9, 11, 15, 20, 22, 33):
        pulse.traffic(start_ns + ms * MS)
    assert beats == [0, 0, 0, 0]  # its first one, and 11, 22 and 33 ms later
    assert not pulse.stood_still(start_ns + 57 * MS, 5 * MS)
    assert pulse.stood_still(start_ns + 59 * MS, 5 * MS)
    pulse.traffic(start_ns + 653 * MS)  # it was due at 53 ms
    assert told == [600 * MS]
    pulse.traffic(start_ns + 664 * MS)
    assert pulse.stood_still(start_ns + 665 * MS, 599 * MS)  # others may still read what had waited
    pulse.traffic(start_ns + 675 * MS)
    assert not pulse.stood_still(start_ns + 676 * MS, 5 * MS)
    assert told == [600 * MS]
    pulse.close()
