"""``compensation`` from "shadow" to "on" while it runs: at standstill, and nothing jumps.

Table LOST_MOTION, 1000 counts per mm: 10 counts more going forward, 10 less going backward.
"""

from itertools import pairwise

import pytest

from gateway.exchange.commands import Enable, EndDryRun
from gateway.exchange.control import ControlError
from gateway.exchange.plan import CompensationMode
from gateway.exchange.status import axis_status
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, axis_plan, read, stream_plan, write

LIVE = EndDryRun(axes=("x",))
SHADOW = CompensationMode.SHADOW


def arrived(bench: Bench, counts: int) -> None:
    """Command a position, let the axis get there, and read it back."""
    bench.move(counts)
    assert ACTUAL.unpack(bench.ask(read(ACTUAL))[2:]) == counts


def state(bench: Bench) -> object:
    return axis_status(bench.line.axes[0], bench.now_ns).compensation


def test_the_end_of_a_dry_run_comes_into_force_with_the_next_different_target() -> None:
    bench = Bench(axis_plan(compensation=SHADOW))
    arrived(bench, 20_000)
    arrived(bench, 50_000)
    assert bench.line.command(LIVE, bench.now_ns) == {"x": "next-target"}
    assert state(bench) == "active"
    # No reading jumps: the drive stands where it was told to, and the controller reads what it commanded.
    assert ACTUAL.unpack(bench.ask(read(ACTUAL))[2:]) == 50_000
    # The same target is the same words (M4): nothing moves.
    assert bench.move(50_000) == write(COMMAND, 50_000)
    # Forward from there: 10 counts more; backward again: 10 less. Readings are those of the controller.
    assert bench.move(60_000) == write(COMMAND, 60_010)
    assert ACTUAL.unpack(bench.ask(read(ACTUAL))[2:]) == 60_000
    assert bench.move(30_000) == write(COMMAND, 29_990)


@pytest.mark.parametrize(("target", "told"), [(60_000, 60_010), (40_000, 39_990)])
def test_the_next_target_gets_the_branch_of_its_direction_as_after_enabling(target: int, told: int) -> None:
    dry = Bench(axis_plan(compensation=SHADOW))
    off = Bench(axis_plan(compensation=CompensationMode.OFF))
    for bench, message in ((dry, LIVE), (off, Enable(axes=("x",)))):
        arrived(bench, 20_000)
        arrived(bench, 50_000)
        bench.line.command(message, bench.now_ns)
        assert bench.move(target) == write(COMMAND, told)


def test_an_axis_that_is_on_its_way_stays_in_shadow() -> None:
    bench = Bench(axis_plan(compensation=SHADOW))
    arrived(bench, 20_000)
    bench.ask(write(COMMAND, 50_000))
    with pytest.raises(ControlError, match="axis x stays in shadow: it was not seen at its target; "):
        bench.line.command(LIVE, bench.now_ns)
    bench.memory.put(ACTUAL, 35_000)
    bench.ask(read(ACTUAL))
    with pytest.raises(ControlError, match="it is not at its target yet"):
        bench.line.command(LIVE, bench.now_ns)
    assert state(bench) == "shadow"
    assert bench.move(60_000) == write(COMMAND, 60_000)


def test_a_dry_run_does_not_end_while_a_target_is_on_the_wire() -> None:
    bench = Bench(axis_plan(compensation=SHADOW))
    arrived(bench, 20_000)
    bench.send(write(COMMAND, 50_000))
    with pytest.raises(ControlError, match="on the wire"):
        bench.line.command(LIVE, bench.now_ns)
    bench.serve()


def test_an_axis_without_a_target_begins_as_at_a_start() -> None:
    bench = Bench(axis_plan(compensation=SHADOW))
    bench.memory.put(ACTUAL, 50_000)
    assert bench.line.command(LIVE, bench.now_ns) == {"x": "next-target"}
    assert bench.move(60_000) == write(COMMAND, 60_010)


def test_a_second_time_changes_nothing() -> None:
    bench = Bench(axis_plan(compensation=SHADOW))
    bench.line.command(LIVE, bench.now_ns)
    assert bench.line.command(LIVE, bench.now_ns) == {}


def test_the_dry_run_ends_for_all_axes_of_a_group_or_for_none() -> None:
    other = axis_plan(compensation=SHADOW, name="y", unit_id=2)
    bench = Bench(axis_plan(compensation=SHADOW), other, groups=[["x", "y"]])
    bench.ask(write(COMMAND, 50_000))
    with pytest.raises(ControlError, match="axis x stays in shadow"):
        bench.line.command(EndDryRun(axes=("y",)), bench.now_ns)
    assert [axis.correction.is_dry_run for axis in bench.line.axes] == [True, True]
    bench.memory.put(ACTUAL, 50_000)
    bench.ask(read(ACTUAL))
    with pytest.raises(ControlError, match="one axis of its group has gone, and another one has not"):
        bench.line.command(EndDryRun(axes=("y",)), bench.now_ns)  # y would go corrected to where x stands 1:1
    bench.wait(10_001)
    assert bench.line.command(EndDryRun(axes=("y",)), bench.now_ns) == {
        "x": "next-target",
        "y": "next-target",
    }


def test_a_stream_blends_the_correction_in_from_its_present_setpoint() -> None:
    """Setpoints 50 counts apart."""
    bench = Bench(stream_plan(compensation=SHADOW))
    for counts in range(0, 10_000, 50):
        bench.move(counts)
    assert ACTUAL.unpack(bench.ask(read(ACTUAL))[2:]) == 9_950
    assert bench.line.command(LIVE, bench.now_ns) == {"x": "blended"}
    offsets = []
    for counts in range(10_000, 11_500, 50):
        bench.move(counts)
        offsets.append(bench.memory.get(COMMAND) - counts)
    # From 0 to the 10 counts of the table, at most one count with each setpoint: as after enabling.
    assert (offsets[0], offsets[-1]) == (0, 10)
    assert {after - before for before, after in pairwise(offsets)} == {0, 1}


def test_the_fast_path_corrects_after_the_end_of_a_dry_run() -> None:
    """Paths that were remembered in the dry run do not count any more."""
    bench = Bench(axis_plan(compensation=SHADOW))
    for counts in (10_000, 20_000, 30_000):
        arrived(bench, counts)
    bench.line.command(LIVE, bench.now_ns)
    for counts in (40_000, 50_000, 60_000):
        assert bench.move(counts) == write(COMMAND, counts + 10)


def test_without_an_actual_position_the_last_acknowledged_target_counts() -> None:
    bench = Bench(axis_plan(compensation=SHADOW, actual=()))
    bench.move(20_000, 50_000)
    assert bench.line.command(LIVE, bench.now_ns) == {"x": "next-target"}
    assert bench.move(50_000) == write(COMMAND, 50_000)
    assert bench.move(60_000) == write(COMMAND, 60_010)
