"""Commands go out corrected, readings come back nominal, everything else stays as it was."""

import struct
from dataclasses import replace
from typing import Any

import pytest

from gateway.compensation.settings import Backlash, BacklashKind
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.plan import CompensationMode, Reference
from gateway.exchange.status import axis_status, direction_state
from gateway.modbus.registers import BitField, FieldAccess, PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan, read, stream_plan, write


def test_fc16_is_corrected_and_its_echo_is_the_controllers_own() -> None:
    bench = Bench(axis_plan())
    # 50 000 counts = 50 mm from 0: forward, +10 counts = 50 010 = 0x0000C35A, low word first
    assert bench.ask(bytes.fromhex("10 0606 0002 04 C350 0000")) == bytes.fromhex("10 0606 0002")
    assert bench.seen[-1] == bytes.fromhex("10 0606 0002 04 C35A 0000")


def test_the_actual_position_is_read_before_the_first_move_and_decides_its_direction() -> None:
    bench = Bench(axis_plan())
    bench.memory.put(ACTUAL, 80_000)
    bench.move(50_000)
    assert bench.seen[0] == read(ACTUAL)
    assert bench.memory.get(COMMAND) == 49_990


def test_added_reads_can_be_turned_off() -> None:
    bench = Bench(axis_plan(added_frames=False))
    bench.move(50_000)
    assert len(bench.seen) == 1
    assert bench.memory.get(COMMAND) == 50_000  # half way between the branches
    assert direction_state(bench.line.axes[0]) == "unsure"


@pytest.mark.parametrize("where", [{"access": FieldAccess.WRITE}, {"block": ACTUAL.address - 1}])
def test_w8_a_position_that_no_read_brings_alone_is_never_asked_for(where: dict[str, Any]) -> None:
    """At its address the drive shows something else: here 80 000, from where the move would be backward."""
    bench = Bench(axis_plan(actual=(replace(ACTUAL, **where),)))
    bench.memory.put(ACTUAL, 80_000)
    bench.move(50_000)
    assert [pdu[0] for pdu in bench.seen] == [0x10]
    assert bench.memory.get(COMMAND) == 50_000  # half way between the branches
    assert direction_state(bench.line.axes[0]) == "unsure"


def test_a_settled_axis_reads_back_what_was_commanded() -> None:
    bench = Bench(axis_plan())
    for target in (50_000, 20_000, 20_001, 99_999, 0):
        bench.move(target)
        assert bench.actual() == target


def test_the_command_register_reads_back_nominal() -> None:
    bench = Bench(axis_plan())
    assert bench.reach(50_000) == 50_010
    assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == 50_000
    bench.memory.put(COMMAND, 50_110)  # somebody else wrote to the drive
    assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == 50_100


def test_fc04_reads_are_turned_back_like_fc03() -> None:
    bench = Bench(axis_plan())
    bench.move(50_000)
    assert ACTUAL.unpack(bench.ask(read(ACTUAL, 4))[2:]) == 50_000


def test_m4_the_same_target_again_is_the_same_words() -> None:
    bench = Bench(axis_plan())
    bench.move(50_000)
    frames = len(bench.seen)
    for noise in (3, -3, 3, -3, 3):
        bench.memory.put(ACTUAL, 50_010 + noise)  # M4: a standing error must not flip the branch
        bench.ask(read(ACTUAL))
        assert bench.ask(write(COMMAND, 50_000)) == write(COMMAND, 50_000)[:5]
        assert bench.seen[-1] == write(COMMAND, 50_010)
    assert len(bench.seen) == frames + 10


def test_a_position_in_the_middle_of_a_block_leaves_the_rest_alone() -> None:
    bench = Bench(axis_plan())
    request = bytes.fromhex("10 0604 0006 0C 1111 2222 C350 0000 3333 4444")
    assert bench.ask(request) == request[:5]
    assert bench.seen[-1] == bytes.fromhex("10 0604 0006 0C 1111 2222 C35A 0000 3333 4444")


def test_two_axes_in_one_frame_are_each_corrected_by_their_own_table() -> None:
    other = PositionField(0x0608, RegisterType.INT32, WordOrder.LOW_FIRST)
    steep = make_table([0, 100], [0.0, 0.1], [0.0, 0.1], Units.MM)
    bench = Bench(axis_plan(), axis_plan(name="y", command=(other,), actual=(), table=steep))
    bench.ask(bytes.fromhex("10 0606 0004 08 C350 0000 C350 0000"))
    # x: +10; y at 50 mm of a ramp of 0.1 mm over 100 mm: +50 counts
    assert bench.seen[-1] == bytes.fromhex("10 0606 0004 08 C35A 0000 C382 0000")


def test_a_window_of_reads_is_turned_back_in_place() -> None:
    bench = Bench(axis_plan())
    bench.move(50_000)
    bench.memory.write(0x051E, bytes.fromhex("AAAA BBBB"))
    bench.memory.write(0x0522, bytes.fromhex("CCCC"))
    assert bench.ask(bytes.fromhex("03 051E 0005")) == bytes.fromhex("03 0A AAAA BBBB C350 0000 CCCC")


@pytest.mark.parametrize("function", [0x41, 0x64, 0x65, 0x2B, 0x08, 0x05])
def test_w1_what_holds_no_position_passes_byte_for_byte(function: int) -> None:
    bench = Bench(axis_plan())
    request = bytes((function, 0x06, 0x06, 1, 2, 3, 4, 5))
    bench.send(request)
    assert bench.answers(bytes((function, 9, 8, 7))) == request
    assert bench.port.take() == bytes((function, 9, 8, 7))


@pytest.mark.parametrize("pdu", ["06 0700 1234", "10 0700 0001 02 1234", "03 0700 0010"])
def test_registers_that_are_not_mapped_pass_byte_for_byte(pdu: str) -> None:
    bench = Bench(axis_plan())
    request = bytes.fromhex(pdu)
    bench.send(request)
    assert bench.link.take() == request


def test_other_unit_ids_pass_byte_for_byte() -> None:
    bench = Bench(axis_plan())
    bench.send(write(COMMAND, 50_000), unit_id=2)
    assert bench.link.sent == [(2, write(COMMAND, 50_000))]


@pytest.mark.parametrize("mode", [CompensationMode.OFF, CompensationMode.SHADOW])
def test_m9_off_and_shadow_pass_one_to_one_both_ways(mode: CompensationMode) -> None:
    bench = Bench(axis_plan(compensation=mode))
    bench.move(50_000)
    assert bench.seen[-1] == write(COMMAND, 50_000)
    assert bench.actual() == 50_000


def test_shadow_computes_and_shows_what_it_would_write() -> None:
    bench = Bench(axis_plan(compensation=CompensationMode.SHADOW))
    bench.move(50_000, 20_000)
    status = axis_status(bench.line.axes[0], bench.now_ns)
    assert status.compensation == "shadow"
    assert status.correction == pytest.approx(-0.01)
    assert status.nominal_setpoint == pytest.approx(20.0)
    assert status.corrected_setpoint == pytest.approx(19.99)


def test_a_reading_is_shown_for_two_seconds() -> None:
    bench = Bench(axis_plan())
    bench.move(50_000)
    bench.actual()
    actual = bench.line.axes[0].motion.actual
    assert actual is not None
    read_ns = actual.seen_ns

    def shown(age_ms: int) -> tuple[object, object]:
        status = axis_status(bench.line.axes[0], read_ns + age_ms * MS)
        return status.nominal_actual, status.corrected_actual

    assert shown(2_000) == (pytest.approx(50.0), pytest.approx(50.01))
    assert shown(2_001) == (None, None)


def test_without_a_table_positions_pass_one_to_one() -> None:
    bench = Bench(axis_plan(table=None))
    bench.move(50_000)
    assert bench.seen == [write(COMMAND, 50_000)]
    assert axis_status(bench.line.axes[0], bench.now_ns).compensation == "no-table"


def test_an_axis_is_corrected_only_while_its_homed_bit_is_set() -> None:
    homed = BitField(0x0030, 6)
    bench = Bench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": homed}))
    assert bench.seen == [bytes.fromhex("03 0030 0001")]  # asked once when the line came up
    assert bench.reach(10_000) == 10_000
    bench.memory.words[0x0030] = 1 << 6
    bench.ask(bytes.fromhex("03 0030 0001"))  # the controller polls the status word
    assert bench.reach(50_000) == 50_010
    bench.memory.words[0x0030] = 0
    bench.ask(bytes.fromhex("03 0030 0001"))
    assert bench.reach(20_000) == 20_000
    assert bench.kinds() == ["line-up", "reference-lost", "axis-referenced", "reference-lost"]


def test_m6_the_done_bit_makes_the_last_target_the_place_of_the_axis() -> None:
    done = BitField(0x0031, 0)
    bench = Bench(axis_plan(bits={"done": done}))
    bench.move(50_000)
    bench.memory.words[0x0031] = 1
    bench.ask(bytes.fromhex("03 0031 0001"))
    frames = len(bench.seen)
    bench.move(49_999)  # one count back from a reached target is backward; where it stands is read once
    assert bench.seen[frames:] == [read(ACTUAL), write(COMMAND, 49_989)]
    bench.ask(bytes.fromhex("03 0031 0001"))
    bench.actual()
    frames = len(bench.seen)
    bench.move(49_998)  # somebody else has read it
    assert bench.seen[frames:] == [write(COMMAND, 49_988)]


def test_a_fresh_actual_decides_when_it_is_farther_than_the_axis_can_have_moved() -> None:
    bench = Bench(axis_plan())
    bench.ask(write(COMMAND, 80_000))
    bench.memory.put(ACTUAL, 30_010)  # on its way up, at nominal 30 mm
    bench.ask(read(ACTUAL))
    frames = len(bench.seen)
    bench.wait(10)
    # 200 mm/s in 10 ms is 2 mm: a target at 50 mm is forward without asking again
    bench.ask(write(COMMAND, 50_000))
    assert len(bench.seen) == frames + 1
    assert bench.memory.get(COMMAND) == 50_010


def test_m6_an_old_actual_is_read_anew() -> None:
    bench = Bench(axis_plan())
    bench.move(80_000)
    bench.ask(read(ACTUAL))
    bench.wait(21)
    frames = len(bench.seen)
    bench.ask(write(COMMAND, 50_000))
    assert bench.seen[frames] == read(ACTUAL)


def test_a_drive_that_refuses_the_added_read_leaves_the_branch_and_flags_it() -> None:
    bench = Bench(axis_plan())
    bench.move(50_000)
    bench.wait(30)
    bench.send(write(COMMAND, 20_000))
    for _ in range(2):  # it is asked once more
        assert bench.answers(bytes((0x83, 2))) == read(ACTUAL)
    assert bench.answers(write(COMMAND, 20_010)[:5]) == write(COMMAND, 20_010)
    assert bench.port.take() == write(COMMAND, 20_000)[:5]
    assert direction_state(bench.line.axes[0]) == "unsure"


def test_an_axis_without_an_actual_position_follows_the_order_of_its_targets_flagged() -> None:
    bench = Bench(axis_plan(actual=()))
    bench.ask(write(COMMAND, 0))
    assert bench.sent_for(write(COMMAND, 50_000)) == write(COMMAND, 50_010)
    assert bench.sent_for(write(COMMAND, 20_000)) == write(COMMAND, 19_990)
    assert direction_state(bench.line.axes[0]) == "unsure"


def test_a_unidirectional_table_needs_no_read_of_the_actual_position() -> None:
    ramp = make_table([0, 100], [0.0, 0.1], [0.0, 0.1], Units.MM)
    bench = Bench(axis_plan(table=ramp))
    bench.move(50_000)
    assert bench.seen == [write(COMMAND, 50_050)]
    both = Bench(axis_plan(table=ramp, backlash=Backlash(0.02, BacklashKind.TWO_SIDED)))
    both.move(50_000)
    assert both.seen == [read(ACTUAL), write(COMMAND, 50_060)]


@pytest.mark.parametrize(
    ("register_type", "order", "nominal", "corrected"),
    [
        (RegisterType.INT16, WordOrder.HIGH_FIRST, 20_000, 20_010),
        (RegisterType.UINT16, WordOrder.HIGH_FIRST, 50_000, 50_010),
        (RegisterType.INT32, WordOrder.HIGH_FIRST, 70_000, 70_010),
        (RegisterType.UINT32, WordOrder.LOW_FIRST, 70_000, 70_010),
        (RegisterType.INT48, WordOrder.HIGH_FIRST, 70_000, 70_010),
        (RegisterType.INT64, WordOrder.LOW_FIRST, 70_000, 70_010),
        (RegisterType.FLOAT32, WordOrder.HIGH_FIRST, 70_000.5, 70_010.5),
    ],
)
def test_each_type_and_order(
    register_type: RegisterType, order: WordOrder, nominal: float, corrected: float
) -> None:
    place = PositionField(0x0606, register_type, order)
    bench = Bench(axis_plan(command=(place,)))
    bench.ask(write(place, nominal))
    assert bench.memory.get(place) == corrected
    assert place.unpack(bench.ask(read(place))[2:]) == nominal


def test_float32_reads_back_the_very_bits_that_were_commanded() -> None:
    place = PositionField(0x0606, RegisterType.FLOAT32)
    reported = PositionField(0x0520, RegisterType.FLOAT32)
    bench = Bench(axis_plan(command=(place,), actual=(reported,)))
    for value in (0.1, 33.333, 12345.678, -0.7):
        nominal = struct.unpack(">f", struct.pack(">f", value))[0]
        bench.ask(write(place, nominal))
        bench.memory.put(reported, bench.memory.get(place))
        assert bench.ask(read(reported))[2:] == struct.pack(">f", value)


def test_a_field_of_another_step_is_scaled() -> None:
    fine = PositionField(0x0606, RegisterType.INT32, WordOrder.HIGH_FIRST, scale=0.1)
    bench = Bench(axis_plan(command=(fine,)))
    bench.ask(write(fine, 500_000))  # 50 mm in steps of 0.1 count
    assert bench.memory.get(fine) == 500_100


def test_a_stream_takes_its_offset_from_the_drive_and_blends() -> None:
    bench = Bench(stream_plan(home_approach=1, reload_distance=1.0))
    bench.memory.put(ACTUAL, 4)
    bench.ask(write(COMMAND, 0))
    assert bench.seen == [read(ACTUAL), write(COMMAND, 4)]
    assert bench.sent_for(write(COMMAND, 1000)) == write(COMMAND, 1010)
    assert len(bench.seen) == 3
