"""A gateway killed at any moment goes on from its record: the same words, the same readings."""

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.compensation.settings import Reversal, ReversalKind
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.plan import AxisPlan
from tests.exchange.line_bench import ACTUAL, COMMAND, axis_plan, stream_plan, write
from tests.exchange.record_bench import RecordBench

SCREW = make_table([0, 30, 55, 100], [0.02, 0.14, -0.06, 0.1], [0.0, 0.09, -0.1, 0.07], Units.MM)
Op = tuple[str, int, float]


def play(bench: RecordBench, ops: list[Op]) -> list[object]:
    """Let a controller command and read; return all that it and the drive got."""
    seen: list[object] = []
    before = len(bench.writes)
    for what, number, share in ops:
        if what in ("move", "follow"):
            start = bench.memory.get(ACTUAL if what == "move" else COMMAND)
            assert bench.ask(write(COMMAND, number))[0] == 16
            told = bench.memory.get(COMMAND)
            bench.memory.put(ACTUAL, round(start + share * (told - start)))
            bench.wait(100.0)
        elif what == "arrive":
            bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
            bench.wait(100.0)
        elif what == "switch":
            (bench.line.enable if number else bench.line.disable)("x", bench.now_ns)
        else:
            seen.append(bench.actual())
    return [*seen, *bench.writes[before:]]


def is_enabled(ops: list[Op]) -> int:
    switches = [number for what, number, _ in ops if what == "switch"]
    return switches[-1] if switches else 1


targets = st.tuples(st.just("move"), st.integers(0, 100_000), st.sampled_from([0.0, 0.3, 0.8, 1.0]))
others = st.tuples(st.sampled_from(["arrive", "read"]), st.just(0), st.just(0.0))
switches = st.tuples(st.just("switch"), st.integers(0, 1), st.just(0.0))


@st.composite
def streams(draw: st.DrawFn) -> list[Op]:
    """Setpoints near each other, some repeated, with reversals; the drive follows or lags a little."""
    at = draw(st.integers(20_000, 80_000))
    ops: list[Op] = []
    for step in draw(st.lists(st.integers(-400, 400), min_size=2, max_size=40)):
        at += step if abs(step) > 10 else 0
        ops.append(("follow", at, draw(st.sampled_from([0.0, 0.5, 1.0])) if ops else 1.0))
        if draw(st.booleans()):
            ops.append(draw(others))
        if draw(st.integers(0, 8)) == 0:
            ops.append(draw(switches))
    return ops


def check_goes_on(plan: AxisPlan, ops: list[Op], at: int) -> RecordBench:
    bench = RecordBench(plan)
    play(bench, ops[:at])
    bench.actual()  # what the start of the other one reads
    again = bench.restarted()
    assert "restored" in again.kinds()
    again.now_ns = bench.now_ns
    if not is_enabled(ops[:at]):  # the configuration decides after a start: tell it the same
        again.line.disable("x", again.now_ns)
    rest = [("read", 0, 0.0), *ops[at:], ("read", 0, 0.0), ("arrive", 0, 0.0), ("read", 0, 0.0)]
    assert play(again, rest) == play(bench, rest)
    return again


@settings(max_examples=150, deadline=None)
@given(st.lists(st.one_of(targets, targets, others, switches), min_size=1, max_size=12), st.data())
def test_targets_go_on_after_a_kill_with_the_same_words_and_readings(ops: list[Op], data: Any) -> None:
    ops = [("move", 50_000, 1.0), ("arrive", 0, 0.0), *ops]
    check_goes_on(axis_plan(table=SCREW), ops, data.draw(st.integers(2, len(ops))))


@settings(max_examples=150, deadline=None)
@given(
    streams(),
    st.sampled_from(
        [
            None,
            Reversal(ReversalKind.CYCLES, 7),
            Reversal(ReversalKind.STEP),
            Reversal(ReversalKind.TIME_MS, 900),
        ]
    ),
    st.data(),
)
def test_setpoints_go_on_after_a_kill_with_the_same_words_and_readings(
    ops: list[Op], reversal: Reversal | None, data: Any
) -> None:
    at = data.draw(st.integers(1, len(ops)))
    check_goes_on(stream_plan(table=SCREW, reversal=reversal), ops, at)
