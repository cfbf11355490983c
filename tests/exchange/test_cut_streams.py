"""A stream of setpoints as a motion controller sends it, one in 10 ms: stored, and cut through.

Each cycle writes a setpoint and reads the position back, over wires as fast as 115 200 Bd. The drive lags a
cycle behind. Every forwarded target and reading must be equal to the stored one. Setpoints that reverse,
begin or stand still are stored or spoilt, and no frame is torn.
"""

import sys
from math import cos, pi
from random import Random

import pytest

from gateway.exchange.cut_through.frame import ForwardEvent
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Arrival, Bench, read, stream_plan, write
from tests.exchange.test_fast_path import CURVE
from tests.soak import repeated

CYCLE_NS = 10 * MS
MOVES = repeated(400)
LOW_COUNTS, HIGH_COUNTS = 1_000, 90_000


def setpoints(rng: Random) -> list[int]:
    """Moves with a smooth speed, short and long, up to 200 mm/s; between some a dwell of half a second."""
    found, place = [], 20_000
    for _ in range(MOVES):
        end = rng.randint(LOW_COUNTS, HIGH_COUNTS) if rng.random() < 0.5 else place + rng.randint(-800, 800)
        end = min(HIGH_COUNTS, max(LOW_COUNTS, end))
        cycles = max(10, abs(end - place) // 1_200)
        found += [round(place + (end - place) * (1 - cos(pi * k / cycles)) / 2) for k in range(1, cycles + 1)]
        place = end
        if rng.random() < 0.3:
            found += [place] * 50
    return found


def played(wanted: list[int]) -> tuple[Bench, list[bytes]]:
    """Feed a stream; return its bench, with the frames to the drive, and the replies to the controller."""
    bench = Bench(stream_plan(table=CURVE, travel=(0.0, 100.0)))
    told, due_ns = [], bench.now_ns
    for setpoint in wanted:
        due_ns += CYCLE_NS
        assert bench.now_ns < due_ns
        bench.wait((due_ns - bench.now_ns) / MS)
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
        told += [bench.ask(write(COMMAND, setpoint)), bench.ask(read(ACTUAL))]
    return bench, told


@pytest.mark.parametrize("seed", range(3))
def test_a_stream_reaches_its_drive_as_on_a_line_that_stores(
    seed: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = setpoints(Random(seed))
    stored, stored_told = played(wanted)
    monkeypatch.setattr(Bench, "arrival", Arrival.BY_CHARACTERS)
    cut, cut_told = played(wanted)
    assert cut.seen == stored.seen
    assert cut_told == stored_told
    forwarding = cut.line.forwarding
    assert forwarding is not None
    requests, replies = (
        forwarding.requests.ended[ForwardEvent.COMMITTED],
        forwarding.replies.ended[ForwardEvent.COMMITTED],
    )
    aborted = {
        event.value: count - forwarding.requests.stored[event]
        for event, count in forwarding.requests.ended.items()
        if event is not ForwardEvent.COMMITTED and count > forwarding.requests.stored[event]
    }
    assert sum(forwarding.requests.ended.values()) == 2 * len(wanted)  # each of them has ended in one way
    whole_at_once = 2 * len(wanted) - sum(
        forwarding.replies.ended.values()
    )  # of requests that took the slow path
    assert (forwarding.underruns, sum(forwarding.replies.ended.values()) - replies) == (
        0,
        sum(forwarding.replies.stored.values()),
    )
    with capsys.disabled():
        sys.stdout.write(
            f"\nstream {seed}: {len(wanted)} setpoints and readings, requests cut through {requests}, stored "
            f"{sum(forwarding.requests.stored.values())}, spoilt {aborted}; replies cut through {replies}, "
            f"stored {sum(forwarding.replies.stored.values()) + whole_at_once}\n"
        )
    assert requests > 0.7 * 2 * len(wanted)
    assert replies > 0.7 * 2 * len(wanted)
