"""A warm screw on the wire: what the drive is told, what is read back, and that nothing moves by itself."""

from typing import Any

import pytest

from gateway.compensation.settings import ThermalSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.commands import SetLimits, SetReference, TableFor
from gateway.exchange.control import ControlError, set_limits, set_tables, set_temperature, switch
from gateway.exchange.plan import AxisPlan, Reference
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan, read, write
from tests.exchange.record_bench import RecordBench
from tests.exchange.staged_bench import RUN_RELATIVE_PDU, StagedBench, staged_plan

S = 1000 * MS
FLAT = make_table([0, 1000], [0.0, 0.0], [0.0, 0.0], Units.MM)
RAMP = make_table([0, 1000], [0.0, 0.1], [0.0, 0.1], Units.MM)
STEEL = ThermalSettings(11.5e-6, reference=20.0, fixed_at=0.0, timeout_s=60.0, hold_s=600.0)


def limits(max_correction: float, travel_margin: float) -> SetLimits:
    return SetLimits(
        axis="x", max_correction=max_correction, max_slope=0.01, travel_margin=travel_margin, budget_us=1000.0
    )


def warm_plan(thermal: ThermalSettings = STEEL, **changes: Any) -> AxisPlan:
    """1 m of steel that is held at 0; 10 K are 115 µm, 115 counts, at its other end."""
    return axis_plan(**{"table": FLAT, "travel": (0.0, 1000.0), "thermal": thermal, **changes})


def warm(bench: Bench, celsius: float, name: str = "x") -> None:
    set_temperature(bench.line.axes, name, celsius, bench.now_ns)


def told(bench: Bench) -> float:
    return bench.memory.get(COMMAND)


def events(bench: Bench, kind: str) -> list[str]:
    return [event.detail for event in bench.events if event.kind.name == kind]


def test_a_warm_screw_is_told_less_and_reads_back_what_was_commanded() -> None:
    bench = Bench(warm_plan())
    warm(bench, 30.0)
    assert bench.reach(800_000) == 799_908  # 92 µm less
    assert bench.actual() == 800_000
    assert bench.reach(0) == 0  # held there
    assert bench.reach(1_000_000) == 999_885
    assert bench.actual() == 1_000_000


def test_the_screw_is_held_where_the_configuration_says_and_adds_to_the_table() -> None:
    bench = Bench(warm_plan(ThermalSettings(11.5e-6, 22.0, fixed_at=400.0), table=RAMP))
    warm(bench, 32.0)
    assert bench.reach(900_000) == 900_000 + 32  # 90 µm less 57.5 µm over 500 mm: 32.5 rounds to even
    assert bench.reach(400_000) == 400_040
    assert bench.reach(100_000) == 100_000 + 10 + 34  # +34.5 µm: 44.5 rounds to even
    assert bench.actual() == 100_000


def test_a_temperature_moves_nothing_until_another_target_comes() -> None:
    bench = Bench(warm_plan())
    assert bench.reach(800_000) == 800_000
    seen = len(bench.seen)
    warm(bench, 30.0)
    bench.wait(1000.0)
    assert len(bench.seen) == seen  # no frame of its own
    assert bench.actual() == 800_000
    assert bench.reach(800_000) == 800_000  # M4: the same target is the same words
    assert bench.actual() == 800_000
    assert bench.reach(800_001) == 799_909
    assert bench.actual() == 800_001


def test_a_sensor_that_jumps_is_followed_at_two_kelvin_a_minute() -> None:
    bench = Bench(warm_plan())
    warm(bench, 20.0)
    bench.move(100_000)
    warm(bench, 40.0)
    bench.now_ns += 30 * S - 1000 * MS  # a move takes one second of it
    bench.wait(1000.0)
    assert bench.reach(1_000_000) == 999_988  # 1 K in 30 s
    bench.wait(29_000.0)
    assert bench.reach(999_999) == 999_976  # 2 K in 60 s: 23 counts


def test_a_sensor_that_falls_silent_in_the_middle_of_a_move_is_held_and_then_fades() -> None:
    bench = Bench(warm_plan())
    warm(bench, 30.0)
    assert bench.command(1_000_000) == 999_885
    bench.memory.put(ACTUAL, 500_000)
    readings = [bench.actual()]
    bench.wait(659_000.0)  # held for 600 s after 60 s
    readings.append(bench.actual())
    bench.wait(180_000.0)  # 3 min: 6 of 10 K are gone
    readings.append(bench.actual())
    assert len(set(readings)) == 1  # nothing comes into force by itself
    bench.memory.put(ACTUAL, 999_885)
    assert bench.actual() == 1_000_000
    assert bench.reach(999_999) == 999_999 - 46  # 4 K, but for the second that this took
    bench.wait(120_000.0)
    assert bench.reach(1_000_000) == 1_000_000
    assert events(bench, "term-follows") == ["the sensor reports; +10 K count"]
    assert len(events(bench, "term-fades")) == 1


def test_it_is_told_that_a_sensor_is_silent_also_where_nothing_moves() -> None:
    bench = Bench(warm_plan())
    warm(bench, 30.0)
    bench.move(10_000)
    bench.wait(61_000.0)
    bench.line.axes[0].correction.report_terms(bench.now_ns)
    bench.actual()
    assert events(bench, "term-held") == ["the sensor is silent: its last value is held; +10 K count"]


@pytest.mark.parametrize("celsius", [float("nan"), float("inf"), 3000.0, -300.0])
def test_what_is_no_temperature_moves_nothing(celsius: float) -> None:
    bench = Bench(warm_plan())
    warm(bench, 30.0)
    with pytest.raises(ControlError, match="the last good value is kept: look at the sensor"):
        warm(bench, celsius)
    assert bench.reach(1_000_000) == 999_885


def test_an_axis_that_asks_for_no_temperature_gets_none() -> None:
    bench = Bench(axis_plan())
    with pytest.raises(ControlError, match="axis x has no thermal in its configuration"):
        warm(bench, 20.0)
    with pytest.raises(ControlError, match="there is no axis y here"):
        warm(bench, 20.0, "y")


def test_a_line_that_comes_with_its_table_to_more_than_allowed_stays_as_it_was() -> None:
    bench = Bench(warm_plan(table=RAMP, max_correction=0.2))  # 100 µm of it are left
    warm(bench, 28.0)  # 92 µm
    assert bench.reach(1_000_000) == 1_000_000 + 100 - 92
    warm(bench, 30.0)
    bench.wait(600_000.0)
    warm(bench, 30.0)
    bench.move(999_999)
    # It followed up to 100 µm, but looked only when targets came: what came then did not fit.
    assert told(bench) == 999_999 + 100 - 92
    assert len(events(bench, "term-too-large")) == 1
    set_limits(bench.line.axes, limits(0.3, 0.3))
    bench.wait(1000.0)
    assert bench.reach(1_000_000) == 1_000_000 + 100 - 115


def test_another_table_that_leaves_no_room_for_the_line_has_none() -> None:
    bench = Bench(warm_plan(max_correction=0.2))
    warm(bench, 30.0)
    assert bench.reach(1_000_000) == 999_885
    set_tables(bench.line.axes, [TableFor("x", "", "", "")], [RAMP])
    assert told(bench) == 999_885
    bench.wait(1000.0)
    assert bench.reach(500_000) == 500_050
    assert len(events(bench, "term-too-large")) == 1


def test_limits_that_are_lowered_below_what_is_in_force_take_it_away_with_the_next_target() -> None:
    bench = Bench(warm_plan())
    warm(bench, 30.0)
    assert bench.reach(1_000_000) == 999_885
    set_limits(bench.line.axes, limits(0.1, 0.5))
    bench.wait(1000.0)
    assert bench.reach(999_000) == 999_000
    assert len(events(bench, "term-too-large")) == 1


def test_a_sensor_that_was_never_heard_is_told_once() -> None:
    bench = Bench(warm_plan())
    for counts in range(100):
        assert bench.reach(1_000 * counts) == 1_000 * counts
    assert events(bench, "term-held") == ["no temperature since the start: no correction"]
    warm(bench, 30.0)
    bench.move(1_000_000)
    assert events(bench, "term-follows") == ["the sensor reports; +10 K count"]


def test_switched_off_it_is_off_with_its_table_and_comes_back_with_it() -> None:
    bench = Bench(warm_plan())
    warm(bench, 30.0)
    bench.move(1_000_000)
    switch(bench.line.axes, "x", is_on=False)
    assert bench.actual() == 1_000_000
    assert bench.reach(999_000) == 999_000
    switch(bench.line.axes, "x", is_on=True)
    assert bench.reach(1_000_000) == 999_885


def test_without_a_reference_positions_pass_as_they_are() -> None:
    bench = Bench(warm_plan(referenced=Reference.HOMING))
    warm(bench, 30.0)
    assert bench.command(1_000_000) == 1_000_000
    bench.line.command(SetReference(axis="x"), bench.now_ns)
    assert bench.reach(999_000) == 998_885


def test_a_restart_goes_on_with_the_line_that_was_in_force() -> None:
    bench = RecordBench(warm_plan(max_correction=1.0))
    warm(bench, 30.0)
    assert bench.reach(1_000_000) == 999_885
    again = bench.restarted()
    assert [detail[:24] for detail in again.told] == ["goes on from its record:"]
    assert again.actual() == 1_000_000
    assert again.reach(1_000_000) == 999_885  # the same words
    assert again.reach(800_000) == 799_908  # no sensor was heard yet: 10 K still count
    assert again.actual() == 800_000
    warm(again, 20.0)  # it has cooled down meanwhile: 2 K in a minute
    again.wait(59_000.0)
    assert again.reach(1_000_000) == 999_908


def test_a_restart_with_another_table_goes_on_with_the_line_that_was_in_force() -> None:
    bench = RecordBench(warm_plan(max_correction=1.0))
    warm(bench, 30.0)
    bench.move(1_000_000)
    again = bench.restarted(warm_plan(table=RAMP, max_correction=1.0), find_table=lambda _digest: FLAT)
    assert again.actual() == 1_000_000
    assert again.reach(1_000_000) == 999_885
    assert again.reach(400_000) == 399_994  # 40 µm of the new table, and 46 less of 10 K
    assert again.actual() == 400_000


@pytest.mark.parametrize("is_heard_first", [False, True])
def test_a_first_restart_with_the_key_begins_with_the_first_temperature(is_heard_first: bool) -> None:
    """The record knows of no line, and so of no temperature either."""
    bench = RecordBench(axis_plan(table=FLAT, travel=(0.0, 1000.0)))
    bench.move(500_000)
    again = bench.restarted(warm_plan())
    if is_heard_first:  # before the record is recalled
        warm(again, 30.0)
    assert again.actual() == 500_000
    assert again.reach(500_000) == 500_000
    if not is_heard_first:
        again.move(300_000)
        again.wait(600_000.0)
        again.move(400_000)
        assert events(again, "term-held") == ["no temperature since the start: no correction"]
        warm(again, 30.0)
    assert again.reach(1_000_000) == 999_885
    assert again.actual() == 1_000_000


def test_a_restart_without_the_key_takes_the_line_away_with_the_next_target() -> None:
    bench = RecordBench(warm_plan())
    warm(bench, 30.0)
    bench.move(1_000_000)
    again = bench.restarted(axis_plan(table=FLAT, travel=(0.0, 1000.0)))
    assert again.actual() == 1_000_000
    assert again.reach(1_000_000) == 999_885
    assert again.reach(800_000) == 800_000


def test_a_frame_that_was_on_the_wire_when_the_temperature_came_is_what_counts() -> None:
    bench = Bench(warm_plan())
    bench.send(write(COMMAND, 1_000_000))
    warm(bench, 30.0)
    bench.serve()
    bench.port.take()
    assert told(bench) == 1_000_000
    bench.memory.put(ACTUAL, 1_000_000)
    assert ACTUAL.unpack(bench.ask(read(ACTUAL))[2:]) == 1_000_000
    bench.wait(1000.0)
    assert bench.reach(999_000) == 998_885


def test_a_staged_target_is_corrected_for_the_temperature_of_its_trigger() -> None:
    bench = StagedBench(staged_plan(table=FLAT, travel=(0.0, 1000.0), thermal=STEEL))
    bench.go_to(500_000)
    bench.stage(800_000)
    warm(bench, 30.0)
    bench.wait(1000.0)
    assert bench.actual() == 500_000
    bench.trigger()
    assert bench.drive.moves == [("absolute", 500_000), ("absolute", 799_908)]
    assert bench.line.counters.restaged == 1
    bench.settle()
    assert bench.actual() == 800_000
    warm(bench, 20.0)
    bench.wait(60_000.0)
    bench.trigger()  # the same target once more: the same words (M4)
    assert bench.drive.moves[2:] == [("absolute", 799_908)]


def test_distances_add_up_to_nothing_while_it_warms() -> None:
    bench = StagedBench(staged_plan(table=FLAT, travel=(0.0, 1000.0), thermal=STEEL))
    bench.go_to(500_000)
    for celsius in (25.0, 30.0, 22.0, 28.0):
        warm(bench, celsius)
        for distance in (100_000, -100_000):
            bench.wait(1000.0)
            bench.run(distance, RUN_RELATIVE_PDU)
            bench.settle()
    assert bench.actual() == 500_000
    warm(bench, 20.0)
    bench.wait(600_000.0)
    warm(bench, 20.0)
    bench.go_to(400_000)
    bench.wait(1000.0)
    assert bench.go_to(500_000) == ("absolute", 500_000)
    assert bench.actual() == 500_000
