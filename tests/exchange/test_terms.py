"""Thermal and cross terms: the targets, the readings, and that nothing moves by itself."""

from dataclasses import replace
from random import Random
from typing import Any

import pytest

from gateway.compensation.settings import ThermalSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.axis.axis import join_terms
from gateway.exchange.commands import SetLimits, SetReference, TableFor
from gateway.exchange.control import ControlError, set_limits, set_tables, set_temperature, switch
from gateway.exchange.plan import AxisPlan, CrossPlan, Reference
from gateway.exchange.status import axis_status
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan, read, stream_plan, write
from tests.exchange.record_bench import RecordBench
from tests.exchange.staged_bench import HOME_PDU, RUN_RELATIVE_PDU, ZERO_PDU, StagedBench, staged_plan
from tests.exchange.test_cross_terms import FLAT, TRAVEL, Y_ACTUAL, Y_COMMAND, go_y, told, x_plan, y_plan
from tests.support.status_models import plain

# === a warm screw ========================================================================================

S = 1000 * MS
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


def events(bench: Bench, kind: str) -> list[str]:
    return [event.detail for event in bench.events if event.kind.name == kind]


def test_the_target_of_a_warm_screw_is_reduced_and_reads_back_as_commanded() -> None:
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


def test_a_temperature_moves_nothing_until_the_next_target() -> None:
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


def test_a_silent_sensor_is_reported_also_if_nothing_moves() -> None:
    bench = Bench(warm_plan())
    warm(bench, 30.0)
    bench.move(10_000)
    bench.wait(61_000.0)
    bench.line.axes[0].correction.report_terms(bench.now_ns)
    bench.actual()
    assert events(bench, "term-held") == ["the sensor is silent: its last value is held; +10 K count"]


@pytest.mark.parametrize("celsius", [float("nan"), float("inf"), 3000.0, -300.0])
def test_an_impossible_temperature_is_ignored(celsius: float) -> None:
    bench = Bench(warm_plan())
    warm(bench, 30.0)
    with pytest.raises(ControlError, match="the last good value is kept: look at the sensor"):
        warm(bench, celsius)
    assert bench.reach(1_000_000) == 999_885


def test_an_axis_without_a_thermal_term_takes_no_temperature() -> None:
    bench = Bench(axis_plan())
    with pytest.raises(ControlError, match="axis x has no thermal in its configuration"):
        warm(bench, 20.0)
    with pytest.raises(ControlError, match="there is no axis y here"):
        warm(bench, 20.0, "y")


def test_a_thermal_term_beyond_max_correction_with_its_table_stays_as_it_was() -> None:
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


def test_a_new_table_that_leaves_no_room_for_the_thermal_term_is_used_without_it() -> None:
    bench = Bench(warm_plan(max_correction=0.2))
    warm(bench, 30.0)
    assert bench.reach(1_000_000) == 999_885
    set_tables(bench.line.axes, [TableFor("x", "", "", "")], [RAMP])
    assert told(bench) == 999_885
    bench.wait(1000.0)
    assert bench.reach(500_000) == 500_050
    assert len(events(bench, "term-too-large")) == 1


def test_limits_lowered_below_the_term_in_force_remove_it_with_the_next_target() -> None:
    bench = Bench(warm_plan())
    warm(bench, 30.0)
    assert bench.reach(1_000_000) == 999_885
    set_limits(bench.line.axes, limits(0.1, 0.5))
    bench.wait(1000.0)
    assert bench.reach(999_000) == 999_000
    assert len(events(bench, "term-too-large")) == 1


def test_a_sensor_that_was_never_heard_is_reported_once() -> None:
    bench = Bench(warm_plan())
    for counts in range(100):
        assert bench.reach(1_000 * counts) == 1_000 * counts
    assert events(bench, "term-held") == ["no temperature since the start: no correction"]
    warm(bench, 30.0)
    bench.move(1_000_000)
    assert events(bench, "term-follows") == ["the sensor reports; +10 K count"]


def test_the_thermal_term_is_switched_off_and_on_with_the_table() -> None:
    bench = Bench(warm_plan())
    warm(bench, 30.0)
    bench.move(1_000_000)
    switch(bench.line.axes, "x", is_on=False)
    assert bench.actual() == 1_000_000
    assert bench.reach(999_000) == 999_000
    switch(bench.line.axes, "x", is_on=True)
    assert bench.reach(1_000_000) == 999_885


def test_without_a_reference_positions_pass_unchanged() -> None:
    bench = Bench(warm_plan(referenced=Reference.HOMING))
    warm(bench, 30.0)
    assert bench.command(1_000_000) == 1_000_000
    bench.line.command(SetReference(axis="x"), bench.now_ns)
    assert bench.reach(999_000) == 998_885


def test_after_a_restart_the_thermal_term_in_force_continues() -> None:
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


def test_after_a_restart_with_another_table_the_thermal_term_in_force_continues() -> None:
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
    """The record has no thermal line, and so no temperature either."""
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


def test_a_restart_without_the_key_removes_the_thermal_term_with_the_next_target() -> None:
    bench = RecordBench(warm_plan())
    warm(bench, 30.0)
    bench.move(1_000_000)
    again = bench.restarted(axis_plan(table=FLAT, travel=(0.0, 1000.0)))
    assert again.actual() == 1_000_000
    assert again.reach(1_000_000) == 999_885
    assert again.reach(800_000) == 800_000


def test_a_frame_on_the_wire_when_the_temperature_came_counts_as_it_was_sent() -> None:
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


def test_distances_there_and_back_add_up_to_0_while_the_screw_warms() -> None:
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


# === fine registers, restarts in between, another zero ===================================================

X_COMMAND = PositionField(0x0906, RegisterType.INT32, WordOrder.LOW_FIRST)
X_ACTUAL = PositionField(0x0920, RegisterType.INT32, WordOrder.LOW_FIRST)


# --- registers that tell more than counts ---------------------------------------------------------------


def test_a_float_register_in_millimetres_gets_far_less_than_half_a_count() -> None:
    place, reported = (PositionField(at, RegisterType.FLOAT32) for at in (0x0606, 0x0520))
    plan = warm_plan(command=(place,), actual=(reported,), counts_per_unit=1.0, hysteresis=0.001)
    bench = Bench(plan)
    warm(bench, 30.0)
    bench.ask(write(place, 1000.0))
    assert bench.memory.get(place) == pytest.approx(999.885, abs=5e-5)  # half a step there is 3e-5
    bench.memory.put(reported, bench.memory.get(place))
    assert bench.ask(read(reported))[2:] == reported.pack(1000.0)
    warm(bench, 30.1)
    bench.wait(600_000.0)
    bench.ask(write(place, 999.0))
    assert bench.memory.get(place) == pytest.approx(999.0 - 999 * 11.5e-6 * 10.1, abs=5e-5)


def test_a_field_with_a_step_finer_than_a_count_is_corrected_to_its_step() -> None:
    place, reported = (PositionField(at, RegisterType.INT32, scale=0.01) for at in (0x0606, 0x0520))
    plan = warm_plan(command=(place,), actual=(reported,), counts_per_unit=1.0, hysteresis=0.01)
    bench = Bench(plan)
    warm(bench, 30.0)
    bench.ask(write(place, 100_000))  # 1000 mm
    assert bench.memory.get(place) == 99_988  # 115 µm less: 11.5 steps, to the even one
    bench.memory.put(reported, 99_988)
    assert reported.unpack(bench.ask(read(reported))[2:]) == 100_000


# --- limits ---------------------------------------------------------------------------------------------


def test_a_term_that_trembles_about_its_limit_is_reported_once_until_it_has_fitted_for_a_minute() -> None:
    ramp = make_table([0, 1000], [0.0, 0.1], [0.0, 0.1], Units.MM)
    bench = Bench(warm_plan(table=ramp, max_correction=0.2))  # 100 µm are left, 8.696 K
    noise = Random(1)
    counts = iter(range(100_000, 200_000))

    def tremble(celsius: float, moves: int) -> int:
        for _ in range(moves):  # of 2 s
            warm(bench, celsius + noise.uniform(-0.1, 0.1))
            bench.wait(1000.0)
            bench.move(next(counts))
        return len(events(bench, "term-too-large"))

    assert tremble(28.7, 300) == 1
    assert tremble(28.0, 8) == 1  # 16 s, and 20 more on the way back
    assert tremble(28.7, 100) == 1
    assert tremble(28.0, 90) == 1
    assert tremble(28.7, 100) == 2


# --- restarts -------------------------------------------------------------------------------------------


def test_an_unacknowledged_target_keeps_its_thermal_term_over_a_restart() -> None:
    bench = RecordBench(warm_plan(max_correction=1.0))
    warm(bench, 22.0)
    bench.move(500_000)
    warm(bench, 30.0)
    bench.now_ns += 300_000 * MS
    warm(bench, 30.0)  # all of the 10 K by now
    bench.send(write(COMMAND, 1_000_000))
    bench.serve_reads()
    for _, pdu in bench.link.sent:
        bench.memory.answer(pdu)
    assert bench.memory.get(COMMAND) == 999_885
    bench.memory.put(ACTUAL, 999_885)
    again = bench.restarted()
    assert again.actual() == 1_000_000
    again.move(900_000)  # not the 2 K of the target before
    assert again.memory.get(COMMAND) == 900_000 - 104  # 103.5 rounds to even


@pytest.mark.parametrize("is_heard_first", [False, True])
def test_a_restart_with_a_corrected_alpha_does_not_wait_for_a_hundred_kelvin(is_heard_first: bool) -> None:
    """Alpha was ten times too large: 10 K at 11.5e-5 are 100 K at 11.5e-6, which would fade for 45
    minutes."""
    bench = RecordBench(warm_plan(replace(STEEL, alpha=11.5e-5), max_correction=2.0))
    warm(bench, 30.0)
    assert bench.reach(1_000_000) == 998_850
    again = bench.restarted(warm_plan(max_correction=2.0))
    if is_heard_first:
        warm(again, 30.0)
    assert again.actual() == 1_000_000
    if not is_heard_first:
        assert again.reach(800_000) == 799_080  # until then what was in force holds
        warm(again, 30.0)
    again.wait(1000.0)
    assert again.reach(900_000) == 900_000 - 104


# --- the other axis -------------------------------------------------------------------------------------


def test_another_axis_whose_registers_were_remapped_has_no_position() -> None:
    bench = Bench(x_plan(), y_plan())
    go_y(bench, 400_000)
    assert bench.reach(100_000) == 100_040
    bench.line.axes[1].end()
    bench.ask(write(Y_COMMAND, 900_000))  # whatever that is by now
    bench.wait(1000.0)
    assert bench.reach(200_000) == 200_040  # held


@pytest.mark.parametrize("pdu", [ZERO_PDU, HOME_PDU], ids=["set-position", "home"])
def test_a_reading_of_the_other_axis_from_before_its_zero_was_moved_does_not_count(pdu: bytes) -> None:
    y = staged_plan(name="y", table=None, travel=(0.0, 1000.0), referenced=Reference.SET_POSITION)
    if pdu is HOME_PDU:
        y = replace(y, referenced=Reference.DRIVE_BIT)
    bench = StagedBench(x_plan(command=(X_COMMAND,), actual=(X_ACTUAL,)), y)
    if pdu is ZERO_PDU:
        bench.line.command(SetReference(axis="y"), bench.now_ns)
    bench.go_to(400_000)
    assert bench.actual() == 400_000
    bench.ask(write(X_COMMAND, 100_000))
    assert bench.memory.get(X_COMMAND) == 100_040
    assert bench.ask(pdu) == pdu
    bench.memory.put(ACTUAL, 0)
    bench.drive.set_bits(is_done=True)
    bench.wait(1000.0)
    bench.poll()
    bench.ask(write(X_COMMAND, 200_000))
    assert bench.memory.get(X_COMMAND) == 200_040  # held: nobody has read where y is
    assert bench.actual() == 0
    bench.wait(1000.0)
    bench.ask(write(X_COMMAND, 300_000))
    assert bench.memory.get(X_COMMAND) == 300_000


def test_a_reduced_target_of_a_drive_that_counts_the_other_way_gets_more_counts() -> None:
    plan = axis_plan(
        table=x_plan().table, thermal=ThermalSettings(11.5e-6), travel=(0.0, 1000.0), counts_per_unit=-500.0
    )
    bench = Bench(plan)
    set_temperature(bench.line.axes, "x", 30.0, bench.now_ns)
    bench.move(-400_000)  # 800 mm; the drive counts the other way
    assert told(bench) == -400_000 + 46  # 92 µm
    assert bench.actual() == -400_000


def test_a_target_in_one_frame_with_that_of_the_other_axis_uses_the_previous_position_of_that_axis() -> None:
    beside = PositionField(COMMAND.address + 2, RegisterType.INT32, WordOrder.LOW_FIRST)
    bench = Bench(x_plan(), y_plan(command=(beside,)))

    def move(x: int, y: int) -> None:
        data = COMMAND.pack(x) + beside.pack(y)
        pdu = bytes((16,)) + COMMAND.address.to_bytes(2, "big") + bytes((0, 4, 8)) + data
        assert bench.ask(pdu) == pdu[:5]
        bench.wait(1000.0)

    move(100_000, 400_000)
    assert told(bench) == 100_000
    move(200_000, 500_000)
    assert told(bench) == 200_040
    move(200_001, 500_000)
    assert told(bench) == 200_051


# === what the status says of them ========================================================================

HELD_IN_THE_MIDDLE = ThermalSettings(11.5e-6, reference=20.0, fixed_at=400.0, timeout_s=60.0, hold_s=600.0)


def terms(bench: Bench) -> Any:
    return plain(axis_status(bench.line.axes[0], bench.now_ns).terms)


def both(**changes: Any) -> Bench:
    """x with a screw that is held at 400 mm, and 0.1 mm out of square over 1 m of y."""
    bench = Bench(x_plan(thermal=HELD_IN_THE_MIDDLE, **changes), y_plan())
    join_terms(bench.line.axes)
    return bench


def test_the_status_shows_what_each_term_added_to_the_last_target() -> None:
    bench = both()
    warm(bench, 30.0)
    assert terms(bench)["correction"] is None  # there is no target yet
    assert terms(bench)["thermal"]["correction"] is None
    go_y(bench, 400_000)
    bench.move(900_000)
    found = terms(bench)
    assert found["thermal"]["correction"] == pytest.approx(-0.0575)  # 11.5e-6 x 10 K x 500 mm
    assert found["cross"]["correction"] == pytest.approx(0.04)
    assert found["correction"] == pytest.approx(-0.0175)
    bench.move(400_000)
    assert terms(bench)["thermal"]["correction"] == 0.0
    assert terms(bench)["cross"]["correction"] == pytest.approx(0.04)
    go_y(bench, 1_000_000)
    assert terms(bench)["correction"] == pytest.approx(0.04)  # x has got no target since
    bench.move(500_000)
    assert terms(bench)["cross"]["correction"] == pytest.approx(0.1)


def test_the_status_of_a_term_that_is_too_large_shows_no_correction() -> None:
    bench = both(max_correction=0.05)
    go_y(bench, 400_000)
    bench.move(100_000)
    go_y(bench, 900_000)
    assert bench.reach(200_000) == 200_040
    found = terms(bench)
    assert (found["is_too_large"], found["correction"]) == (True, pytest.approx(0.04))
    assert found["cross"]["correction"] == pytest.approx(0.04)


def test_the_status_shows_the_rest_of_a_term_that_fades_out_in_a_stream() -> None:
    screw = ThermalSettings(1e-4, reference=20.0, fixed_at=0.0)
    bench = Bench(stream_plan(table=FLAT, travel=TRAVEL, thermal=screw, max_correction=2.0))
    warm(bench, 30.0)
    bench.memory.put(ACTUAL, 100_000)
    shares = []
    for step in range(600):
        if step == 400:
            switch(bench.line.axes, "x", is_on=False)
        counts = 100_000 + 500 * step
        bench.ask(write(COMMAND, counts))
        bench.wait(10.0)
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
        told = (bench.memory.get(COMMAND) - counts) / 1000.0  # of a flat table: the term alone
        if step > 0:
            assert terms(bench)["correction"] == pytest.approx(told, abs=0.0006)  # half a count, and rounding
            shares.append(terms(bench)["thermal"]["correction"])
    assert shares[398] == pytest.approx(-0.2995)  # 1e-4 x 10 K x 299.5 mm
    assert any(-0.2 < share < -0.1 for share in shares[399:])
    assert shares[-1] == 0.0


def test_an_axis_without_terms_has_none_in_its_status() -> None:
    assert terms(Bench(axis_plan())) is None


def test_a_sensor_is_silent_after_its_time_also_when_it_was_never_heard() -> None:
    bench = both()

    def state() -> tuple[str, bool]:
        bench.line.axes[0].correction.report_terms(bench.now_ns)  # as the line does every few seconds
        thermal = terms(bench)["thermal"]
        return thermal["state"], thermal["is_silent"]

    assert state() == ("waiting", False)
    bench.wait(60_000.0)
    assert state() == ("waiting", False)
    bench.wait(1_000.0)
    assert state() == ("waiting", True)
    warm(bench, 30.0)
    assert state() == ("following", False)
    bench.wait(61_000.0)
    assert state() == ("held", True)
    bench.wait(600_000.0)
    assert state() == ("fading", True)
    bench.wait(300_000.0)
    assert state() == ("faded", True)
    warm(bench, 30.0)
    assert state() == ("following", False)


# === whatever comes between two targets: a standing axis reads what was commanded ========================

ALPHA = 1e-4
TABLE = make_table([0, 300, 1000], [0.02, -0.05, 0.08], [0.0, -0.06, 0.05], Units.MM)
PLANS = (
    axis_plan(
        table=TABLE,
        travel=(0.0, 1000.0),
        max_correction=10.0,
        thermal=ThermalSettings(ALPHA, fixed_at=100.0, rate_per_min=60.0),
        cross=(CrossPlan("y", (0.0, 1000.0), (0.0, 0.5), fresh_s=5.0),),
    ),
    axis_plan(name="y", command=(Y_COMMAND,), actual=(Y_ACTUAL,), table=None, travel=(0.0, 1000.0)),
)


class Machine:
    """A bench that is warmed, cooled, interrupted and killed; and what its controller believes of x."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.bench = RecordBench(*PLANS)
        self.nominal = 0

    def step(self) -> None:
        what = self.random.choice(
            ("move", "move", "warm", "other", "lost", "killed", "again", "pause", "off")
        )
        getattr(self, what)()

    def move(self) -> None:
        self.nominal = self.random.randrange(0, 1_000_001)
        self.bench.move(self.nominal)

    def warm(self) -> None:
        set_temperature(self.bench.line.axes, "x", self.random.uniform(-10.0, 50.0), self.bench.now_ns)

    def other(self) -> None:
        counts = self.random.randrange(0, 1_000_001)
        self.bench.ask(write(Y_COMMAND, counts))
        self.bench.memory.put(Y_ACTUAL, self.bench.memory.get(Y_COMMAND))

    def lost(self) -> None:
        """A target whose reply is lost, and which the drive obeyed."""
        self.nominal = self.random.randrange(0, 1_000_001)
        self.bench.send(write(COMMAND, self.nominal))
        self.bench.serve_reads()
        for _, pdu in self.bench.link.sent:
            self.bench.memory.answer(pdu)
        self.bench.link.sent.clear()
        self.bench.wait(2000.0)
        self.bench.wait(2000.0)
        self.bench.port.replies.clear()
        self.bench.memory.put(ACTUAL, self.bench.memory.get(COMMAND))
        self.bench.move(self.nominal)

    def killed(self) -> None:
        self.bench = self.bench.restarted()

    def again(self) -> None:
        told = self.bench.memory.get(COMMAND)
        self.bench.move(self.nominal)
        assert self.bench.memory.get(COMMAND) == told

    def pause(self) -> None:
        self.bench.wait(self.random.choice((1.0, 600.0, 20_000.0, 2_000_000.0)))

    def off(self) -> None:
        for is_on in (False, True):
            switch(self.bench.line.axes, "x", is_on=is_on)


@pytest.mark.parametrize("seed", range(8))
def test_a_standing_axis_reads_its_target_whatever_came_between(seed: int) -> None:
    machine = Machine(seed)
    machine.move()
    for _ in range(60):
        told = machine.bench.memory.get(COMMAND)
        before = machine.nominal
        machine.step()
        if machine.nominal == before:
            assert machine.bench.memory.get(COMMAND) == told  # nothing moves by itself
        assert ACTUAL.unpack(machine.bench.ask(read(ACTUAL))[2:]) == machine.nominal
    # At last the sensor says what the table was measured at, and y stands at 0: the table alone is left.
    bench = machine.bench
    for _ in range(3):
        set_temperature(bench.line.axes, "x", 20.0, bench.now_ns)
        bench.now_ns += 50_000 * MS
    set_temperature(bench.line.axes, "x", 20.0, bench.now_ns)
    bench.ask(write(Y_COMMAND, 0))
    bench.move(500_000)
    assert bench.reach(300_000) == 299_940
    assert bench.reach(1_000_000) == 1_000_080


@pytest.mark.parametrize(("most", "kept"), [(0.05, 51), (1.0, 100)])
def test_m6_a_stream_begins_with_as_much_of_a_term_as_the_present_limit_allows(
    most: float, kept: int
) -> None:
    """100 counts lie between drive and setpoint; of 50 and half a step of both registers 51 are left."""
    bench = Bench(stream_plan(table=FLAT, travel=TRAVEL, thermal=STEEL, max_correction=0.05))
    set_limits(bench.line.axes, limits(most, 0.0))
    bench.memory.put(ACTUAL, 500_100)
    bench.ask(write(COMMAND, 500_000))
    assert bench.memory.get(COMMAND) == 500_000 + kept
