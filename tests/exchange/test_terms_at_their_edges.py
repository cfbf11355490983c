"""Terms where something beside them is unusual: fine registers, restarts in between, another zero."""

from dataclasses import replace
from random import Random

import pytest

from gateway.compensation.settings import ThermalSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.commands import SetReference
from gateway.exchange.control import set_temperature
from gateway.exchange.plan import Reference
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan, read, write
from tests.exchange.record_bench import RecordBench
from tests.exchange.staged_bench import HOME_PDU, ZERO_PDU, StagedBench, staged_plan
from tests.exchange.test_cross_terms import Y_COMMAND, go_y, told, x_plan, y_plan
from tests.exchange.test_thermal_terms import STEEL, events, warm, warm_plan

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


def test_a_field_whose_step_is_a_part_of_a_count_is_corrected_to_its_step() -> None:
    place, reported = (PositionField(at, RegisterType.INT32, scale=0.01) for at in (0x0606, 0x0520))
    plan = warm_plan(command=(place,), actual=(reported,), counts_per_unit=1.0, hysteresis=0.01)
    bench = Bench(plan)
    warm(bench, 30.0)
    bench.ask(write(place, 100_000))  # 1000 mm
    assert bench.memory.get(place) == 99_988  # 115 µm less: 11.5 steps, to the even one
    bench.memory.put(reported, 99_988)
    assert reported.unpack(bench.ask(read(reported))[2:]) == 100_000


# --- limits ---------------------------------------------------------------------------------------------


def test_a_sensor_that_trembles_about_the_limit_is_told_of_once_until_it_has_fitted_for_a_minute() -> None:
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


def test_a_target_that_nobody_saw_acknowledged_brings_its_line_into_the_next_run() -> None:
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
def test_a_restart_with_a_mended_alpha_does_not_wait_for_a_hundred_kelvin(is_heard_first: bool) -> None:
    """A figure too many: 10 K at 11.5e-5 are 100 K at 11.5e-6, and would last for 45 minutes."""
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


def test_an_other_axis_whose_registers_were_moved_about_is_nowhere() -> None:
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


def test_a_drive_that_counts_the_other_way_is_told_more_where_it_is_to_go_less_far() -> None:
    plan = axis_plan(
        table=x_plan().table, thermal=ThermalSettings(11.5e-6), travel=(0.0, 1000.0), counts_per_unit=-500.0
    )
    bench = Bench(plan)
    set_temperature(bench.line.axes, "x", 30.0, bench.now_ns)
    bench.move(-400_000)  # 800 mm; the drive counts the other way
    assert told(bench) == -400_000 + 46  # 92 µm
    assert bench.actual() == -400_000


def test_of_two_targets_in_one_frame_this_one_is_corrected_for_where_the_other_axis_was() -> None:
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
