"""Streams that begin or lose their reference: only a different setpoint moves the drive (M6, M9)."""

from dataclasses import replace
from typing import Any

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action, MotionPlan, Operation, TriggerPlan
from gateway.exchange.axis.record_layout import RECORD_SIZE
from gateway.exchange.plan import AxisPlan, CompensationMode, LineTiming, Reference
from gateway.modbus.registers import BitField, PositionField, RegisterType
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Memory, read, stream_plan, write
from tests.exchange.record_bench import RecordBench

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


# --- after a restart that ends the correction ---------------------------------------------------------------


def off(**changes: Any) -> AxisPlan:
    """The axis of LIFTED as another start of the gateway finds it: no longer corrected."""
    plan = {"table": LIFTED, "reload_distance": 1.2, "compensation": CompensationMode.OFF, **changes}
    return stream_plan(**plan)


HOME, SET_POSITION = bytes.fromhex("06 0100 0001"), bytes.fromhex("06 0100 0002")
ZEROING = MotionPlan(
    triggers=(TriggerPlan(0x0100, deeds={1: Operation(Action.HOME), 2: Operation(Action.SET_POSITION)}),)
)


class Refusing(Memory):
    """A drive that takes no new zero."""

    def answer(self, pdu: bytes) -> bytes:
        return b"\x86\x04" if pdu in (HOME, SET_POSITION) else super().answer(pdu)


NO_TABLE = {"table": None, "compensation": CompensationMode.ON}


def streamed(*setpoints: int) -> RecordBench:
    """Return a corrected axis that got these setpoints and stands at the last one."""
    bench = RecordBench(stream_plan(table=LIFTED, reload_distance=1.2))
    stream(bench, list(setpoints))
    return bench


def refusing(bench: RecordBench) -> RecordBench:
    """Return the axis after a restart without its correction; its drive takes no new zero."""
    memory = Refusing()
    memory.words = dict(bench.memory.words)
    plan = off(motion=ZEROING)
    return RecordBench(plan, records=bench.records.copy(), memory=memory, start_ns=bench.now_ns)


@pytest.mark.parametrize("changes", [{}, NO_TABLE])
def test_m6_a_held_setpoint_moves_nothing_after_a_restart_without_the_correction(
    changes: dict[str, Any],
) -> None:
    bench = streamed(13_000, 15_000, 18_000, 20_000, 21_400)
    again = bench.restarted(off(**changes), find_table=lambda _: LIFTED)
    assert again.actual() == 21_400
    assert stream(again, [21_400] * 3) == [21_700] * 3
    # It fades as after ``pitch-gateway disable``: sin² over 1.2 mm from the first different setpoint on.
    assert stream(again, [22_000, 22_600]) == [22_300, 22_600 + 150]
    once_more = again.restarted(find_table=lambda _: LIFTED)  # in the middle of the fade
    assert stream(once_more, [22_600, 23_200]) == [22_600 + 150, 23_200]
    assert once_more.actual() == 23_200


@pytest.mark.parametrize(("stands_at", "told"), [(21_705, 21_701), (21_690, 21_690), (21_400, 21_400)])
def test_m6_a_drive_beside_its_record_keeps_what_may_be_its_old_correction(stands_at: int, told: int) -> None:
    """The range is 0 to 300 counts, and half a step of both registers."""
    bench = streamed(13_000, 15_000, 18_000, 20_000, 21_400)
    assert bench.actual() == 21_400  # it has arrived
    bench.memory.put(ACTUAL, stands_at)
    again = bench.restarted(off())
    assert stream(again, [21_400] * 3) == [told] * 3
    assert stream(again, [22_000, 22_600, 23_200])[-1] == 23_200


def test_m6_an_axis_that_is_homed_before_its_stream_begins_has_no_old_correction() -> None:
    again = streamed(13_000, 15_000, 18_000, 20_000, 21_400).restarted(off(motion=ZEROING))
    again.ask(HOME)
    again.memory.put(ACTUAL, 0)
    assert stream(again, [200]) == [200]


@pytest.mark.parametrize("pdu", [HOME, SET_POSITION], ids=["home", "set-position"])
@pytest.mark.parametrize(("before", "setpoint", "told"), [([], 21_400, 21_700), ([22_000], 22_000, 22_300)])
def test_m6_a_refused_homing_or_set_position_leaves_the_old_correction_in_force(
    pdu: bytes, before: list[int], setpoint: int, told: int
) -> None:
    again = refusing(streamed(13_000, 15_000, 18_000, 20_000, 21_400))
    stream(again, before)
    assert again.ask(pdu) == b"\x86\x04"
    assert stream(again, [setpoint] * 2) == [told] * 2
    assert stream(again, [setpoint + 600, setpoint + 1_200]) == [setpoint + 600 + 150, setpoint + 1_200]


def test_m6_a_refused_homing_brings_no_old_correction_back_that_has_faded_out() -> None:
    again = refusing(streamed(13_000, 15_000, 18_000, 20_000, 21_400))
    assert stream(again, [22_000, 22_600, 23_200, 22_600])[2:] == [23_200, 22_600]
    again.memory.put(ACTUAL, 22_800)  # it lags behind
    again.ask(HOME)
    assert stream(again, [22_500]) == [22_500]


REMAP = PositionField(0x0900, RegisterType.INT16)


@pytest.mark.parametrize("mode", [CompensationMode.ON, CompensationMode.OFF])
def test_m10_after_a_remapping_no_old_correction_is_left(mode: CompensationMode) -> None:
    again = streamed(13_000, 15_000, 18_000, 20_000, 21_400).restarted(
        off(compensation=mode, remapping=(REMAP,))
    )
    stream(again, [22_000])
    again.ask(write(REMAP, 1))
    again.memory.put(ACTUAL, 99_000)  # its register means something else now
    assert stream(again, [22_500]) == [22_500]


Y_COMMAND, Y_ACTUAL = (replace(field, address=field.address + 0x1000) for field in (COMMAND, ACTUAL))
CHANGED = {"table": make_table([0, 100], [0.1, 0.1], [0.1, 0.1], Units.MM)}


def beam(**changes: Any) -> tuple[AxisPlan, AxisPlan]:
    x = stream_plan(**{"table": LIFTED, "reload_distance": 1.2, **changes})
    return x, replace(x, name="y", command=(Y_COMMAND,), actual=(Y_ACTUAL,))


def move_beam(bench: RecordBench, *setpoints: int) -> tuple[int | float, int | float]:
    """Stream setpoints to both sides of a beam; return the last ones that their drives got."""
    for setpoint in setpoints:
        for command, actual in ((COMMAND, ACTUAL), (Y_COMMAND, Y_ACTUAL)):
            bench.ask(write(command, setpoint))
            bench.memory.put(actual, bench.memory.get(command))
        bench.wait(10)
    return bench.memory.get(COMMAND), bench.memory.get(Y_COMMAND)


@pytest.mark.parametrize(
    ("changes", "without"),
    [({"compensation": CompensationMode.OFF}, 21_400), (NO_TABLE, 21_400), (CHANGED, 21_501)],
    ids=["off", "no table", "another table"],
)
@pytest.mark.parametrize("lost", ["", "x", "y"])
def test_m11_both_sides_of_a_beam_keep_their_old_correction_or_none_does(
    changes: dict[str, Any], without: int, lost: str
) -> None:
    """Without it a stream may begin with what its table gives now, and half a step of both registers."""
    bench = RecordBench(*beam(), groups=[("x", "y")])
    assert move_beam(bench, 13_000, 15_000, 18_000, 20_000, 21_400) == (21_700, 21_700)
    if lost:
        bench.records.buffers[lost] = bytearray(RECORD_SIZE)
    again = bench.restarted(*beam(**changes), find_table=lambda _: LIFTED)
    told = without if lost else 21_700
    assert move_beam(again, 21_400) == (told, told)


@pytest.mark.parametrize("missing", ["x", "y"])
def test_m11_no_side_of_a_beam_keeps_its_old_correction_if_the_table_of_one_is_missing(missing: str) -> None:
    bench = RecordBench(*beam(), groups=[("x", "y")])
    move_beam(bench, 13_000, 15_000, 18_000, 20_000, 21_400)
    plans = [
        replace(plan, table=None if plan.name == missing else LIFTED)
        for plan in beam(compensation=CompensationMode.OFF)
    ]
    again = bench.restarted(*plans)
    assert move_beam(again, 21_400) == (21_400, 21_400)


def test_m9_an_axis_that_was_not_corrected_in_the_last_run_is_not_read_at_the_start() -> None:
    bench = streamed(13_000, 15_000, 18_000, 20_000, 21_400).restarted(off())
    stream(bench, [22_000, 22_600, 23_200, 24_000])
    again = bench.restarted()
    assert stream(again, [24_000]) == [24_000]
    assert again.seen == [write(COMMAND, 24_000)]
