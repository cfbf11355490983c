"""Streams that begin or lose their reference: only a different setpoint moves the drive (M6, M9)."""

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.plan import CompensationMode, LineTiming, Reference
from gateway.modbus.registers import BitField
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, read, stream_plan, write

HOMED = BitField(0x0031, 5)
LIFTED = make_table([0, 100], [0.3, 0.3], [0.26, 0.26], Units.MM)
"""300 counts more going forward, 260 going backward."""
WORN = make_table([0, 0.5, 1, 2], [-0.022, 0.032, 0.0, -0.022], [-0.022, 0.032, 0.0, -0.022], Units.MM)
"""Between -22 and +32 counts."""


def read_of(bit: BitField) -> bytes:
    return bytes((3,)) + bit.address.to_bytes(2, "big") + bytes((0, 1))


def told(bench: Bench) -> float:
    return bench.memory.get(COMMAND)


def stream(bench: Bench, setpoints: list[int]) -> list[float]:
    """Feed setpoints to a drive that follows immediately; return the setpoints that it got."""
    found = []
    for counts in setpoints:
        bench.ask(write(COMMAND, counts))
        found.append(told(bench))
        bench.memory.put(ACTUAL, told(bench))
        bench.now_ns += 4 * MS
    return found


def test_m6_the_first_step_of_a_stream_contains_no_correction() -> None:
    bench = Bench(stream_plan(table=WORN, reload_distance=0.1, max_slope=0.2))
    assert bench.memory.get(ACTUAL) == 0
    # The table puts 0.022 / 1.108 mm to 0, with -19.86 counts; and half a step of both registers.
    assert stream(bench, [400]) == [400 - 21]
    assert "-0.379144 mm more cannot be a correction" in bench.events[-1].detail
    assert stream(bench, [800, 1200]) == [800 + 13, 1200 - 4]  # 32 * 0.4, -22 * 0.2


@pytest.mark.parametrize("stands_at", [20_000 + 300, 20_000 + 260, 20_000 + 280, 20_000, 20_000 + 120])
@pytest.mark.parametrize("is_referenced", [True, False])
def test_m6_a_held_setpoint_that_may_be_corrected_moves_nothing(stands_at: int, is_referenced: bool) -> None:
    referenced = Reference.ABSOLUTE if is_referenced else Reference.HOMING
    bench = Bench(stream_plan(table=LIFTED, reload_distance=1.2, referenced=referenced))
    bench.memory.put(ACTUAL, stands_at)
    assert stream(bench, [20_000] * 3) == [stands_at] * 3
    assert bench.seen.count(read(ACTUAL)) == 1
    assert bench.kinds().count("stream-began") == (stands_at != 20_000)
    # Over 1.2 mm, four times the largest difference, it goes over to the table, or fades.
    assert stream(bench, [21_300, 30_000])[-1] == (30_300 if is_referenced else 30_000)
    assert bench.actual() == 30_000


def test_m6_a_distance_larger_than_any_correction_is_motion() -> None:
    bench = Bench(stream_plan(table=LIFTED))
    bench.memory.put(ACTUAL, 19_700)
    assert stream(bench, [20_000]) == [19_999]  # 0 is the nearest of 0, 260 and 300; half a step of each


def test_m9_a_stream_that_loses_its_reference_keeps_its_offset_and_fades() -> None:
    bench = Bench(
        stream_plan(
            table=LIFTED,
            home_approach=1,
            reload_distance=1.2,
            referenced=Reference.DRIVE_BIT,
            bits={"homed": HOMED},
        )
    )
    homed = read_of(HOMED)
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.ask(homed)
    stream(bench, [50_000, 52_000, 55_950])
    assert told(bench) == 56_250
    bench.memory.words[HOMED.address] = 0
    bench.ask(homed)
    assert not bench.line.axes[0].reference.is_referenced
    assert bench.actual() == 55_950
    assert stream(bench, [55_950] * 3) == [56_250] * 3
    assert bench.actual() == 55_950
    # sin² over four times 0.3 mm, from the first different setpoint on: half of it after 0.6 mm
    assert stream(bench, [56_550]) == [56_550 + 150]
    assert bench.actual() == 56_550
    assert stream(bench, [56_550, 57_160]) == [56_700, 57_160]
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.ask(homed)
    assert stream(bench, [57_160] * 2) == [57_160] * 2
    assert stream(bench, [57_760, 58_360]) == [57_760 + 150, 58_660]


def test_m9_a_repeated_setpoint_after_lost_replies_does_not_move_the_axis() -> None:
    plan = stream_plan(table=LIFTED, referenced=Reference.HOMING, lost_ms=1000.0)
    bench = Bench(plan, timing=LineTiming(drain_ms=1, retry_ms=0))
    bench.line.axes[0].declare_referenced()
    bench.memory.put(ACTUAL, 50_000)
    stream(bench, [50_000, 52_000, 55_950])
    assert told(bench) == 56_250
    for _ in range(3):
        bench.send(write(COMMAND, 55_950))
        assert bench.link.take() == write(COMMAND, 56_250)
        bench.wait(1001)
        bench.wait(2)
        bench.port.replies.clear()
    assert stream(bench, [55_950] * 2) == [56_250] * 2
    assert not bench.line.axes[0].reference.is_referenced
    assert stream(bench, [57_150]) == [57_150]


def test_m6_without_added_reads_the_last_reading_of_the_controller_decides_where_a_stream_begins() -> None:
    bench = Bench(stream_plan(table=LIFTED, added_frames=False))
    bench.memory.put(ACTUAL, 20_300)
    bench.ask(read(ACTUAL))
    assert stream(bench, [20_000]) == [20_300]
    bench = Bench(stream_plan(table=LIFTED, added_frames=False))
    bench.memory.put(ACTUAL, 20_300)
    bench.ask(read(ACTUAL))
    bench.wait(501)
    assert stream(bench, [20_000]) == [20_000]  # nobody knows


def test_m9_no_position_is_read_for_an_axis_without_compensation() -> None:
    bench = Bench(stream_plan(table=LIFTED, compensation=CompensationMode.OFF))
    bench.memory.put(ACTUAL, 20_300)
    assert stream(bench, [20_000]) == [20_000]
    assert bench.seen == [write(COMMAND, 20_000)]
