"""Drives whose addresses are no plain memory, and other ways than registers to make them act."""

import pytest

from gateway.drives.motion import Action, Addressing, Form, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import ControllerPlan
from gateway.modbus.registers import BitField, BitTable, FieldAccess, PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import COMMAND, Bench, Memory, Port, axis_plan, read, write
from tests.exchange.staged_bench import ONLY_ABSOLUTE, RUN_PDU

INT32 = RegisterType.INT32
LOW = WordOrder.LOW_FIRST
HIGH = WordOrder.HIGH_FIRST


# --- addresses that are commands: 0x00F5 takes [acceleration, speed, position high, position low] ---------

SPEED_MODE = ModePlan(0x00F6, actions={0: Action.STOP}, otherwise=Action.ABSOLUTE, is_in_frame=True)
RELATIVE_SPEED = ModePlan(0x00F5, actions={0: Action.STOP}, otherwise=Action.RELATIVE, is_in_frame=True)
OPCODES = {
    "command": (
        PositionField(0x00F7, INT32, HIGH, block=0x00F5),
        PositionField(0x00F6, INT32, HIGH, block=0x00F4),
    ),
    "motion": MotionPlan(
        modes=(SPEED_MODE, RELATIVE_SPEED),
        triggers=(TriggerPlan(0x00F7, deeds={1: Operation(Action.STOP)}, block=0x00F7),),
    ),
}


class Answering(Memory):
    """A drive that answers as it is told to; it holds nothing."""

    def __init__(self, reply: str = "") -> None:
        super().__init__()
        self.reply = reply

    def answer(self, pdu: bytes) -> bytes:
        return bytes.fromhex(self.reply) if self.reply else super().answer(pdu)


def test_opcodes_the_golden_absolute_frame_is_corrected_in_its_block_only() -> None:
    bench = Bench(axis_plan(**OPCODES, actual=()))
    bench.ask(bytes.fromhex("10 00F5 0004 08 0002 012C 0000 C350"))
    assert bench.sent_for(bytes.fromhex("10 00F5 0004 08 0002 012C 0000 EA60")) == bytes.fromhex(
        "10 00F5 0004 08 0002 012C 0000 EA6A"
    )


def test_opcodes_a_stop_with_position_0_is_no_target() -> None:
    bench = Bench(axis_plan(**OPCODES, actual=(), travel=(10.0, 100.0)))
    stop = bytes.fromhex("10 00F5 0004 08 0002 0000 0000 0000")
    assert bench.ask(stop) == stop[:5]
    assert bench.seen[-1] == stop


def test_opcodes_the_same_register_in_another_frame_is_another_thing() -> None:
    bench = Bench(axis_plan(**OPCODES, actual=()))
    for pdu in ("06 00F7 0001", "06 00F6 1234", "10 00F6 0002 04 0001 0002"):
        assert bench.sent_for(bytes.fromhex(pdu)) == bytes.fromhex(pdu)


@pytest.mark.parametrize("reply", ["10 00F5 0000", "06 00F7 FFFF"])
def test_w4_a_failure_that_looks_like_success_passes_untouched_and_is_no_acknowledgement(reply: str) -> None:
    bench = Bench(axis_plan(**OPCODES, actual=()), memory=Answering(reply))
    assert bench.ask(bytes.fromhex("10 00F5 0004 08 0002 012C 0000 C350")) == bytes.fromhex(reply)
    assert bench.line.axes[0].compensation.accepted is None


# --- objects: an index is an object of its own width ------------------------------------------------------

OBJECTS = {
    "command": (PositionField(0x607A, INT32, LOW),),
    "actual": (PositionField(0x6064, INT32, LOW),),
    "addressing": Addressing.OBJECTS,
    "object_words": {0x6062: 2, 0x6063: 2, 0x607B: 4, 0x607C: 2},
}


class Objects(Memory):
    """Objects of 2 registers each, one after the other in a frame."""

    def __init__(self) -> None:
        super().__init__()
        self.held: dict[int, bytes] = {}

    def answer(self, pdu: bytes) -> bytes:
        index, quantity = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
        if pdu[0] == 3:
            data = b"".join(self.held.get(index + i, bytes(4)) for i in range(quantity // 2))
            return bytes((3, len(data))) + data
        self.held[index] = pdu[6:10]
        return pdu[:5]


def object_bench() -> Bench:
    bench = Bench(axis_plan(**OBJECTS), memory=Objects())
    assert isinstance(bench.memory, Objects)
    return bench


def test_objects_a_neighbouring_index_does_not_overlap() -> None:
    bench = object_bench()
    other = bytes.fromhex("10 607B 0004 08 0001 0002 0003 0004")
    assert bench.sent_for(other) == other


def test_objects_a_target_and_its_reading_are_corrected() -> None:
    bench = object_bench()
    field = PositionField(0x607A, INT32, LOW)
    assert bench.sent_for(write(field, 50_000)) == write(field, 50_010)
    bench.memory.held[0x6064] = field.pack(50_010)  # type: ignore[attr-defined]
    assert field.unpack(bench.ask(read(PositionField(0x6064, INT32, LOW)))[2:]) == 50_000


def test_objects_several_in_one_frame_are_found_by_their_widths() -> None:
    bench = object_bench()
    field = PositionField(0x607A, INT32, LOW)
    bench.ask(write(field, 50_000))
    bench.memory.held.update({0x6062: field.pack(1), 0x6063: field.pack(2), 0x6064: field.pack(50_010)})  # type: ignore[attr-defined]
    reply = bench.ask(bytes.fromhex("03 6062 0006"))
    assert reply[2:] == field.pack(1) + field.pack(2) + field.pack(50_000)


def test_objects_of_unknown_width_before_a_position_are_refused() -> None:
    bench = object_bench()
    assert bench.ask(bytes.fromhex("03 6061 0008")) == bytes.fromhex("83 02")


# --- general reference (function code 43, MEI type 13): objects over the wire, little-endian --------------

MEI = {
    "command": (PositionField(0x607A, INT32, LOW),),
    "actual": (PositionField(0x6064, INT32, LOW),),
    "addressing": Addressing.OBJECTS,
    "reads_with": Form.MEI,
    "writes_with": Form.MEI,
}


class MeiDrive(Memory):
    """Objects read and written by general reference."""

    def __init__(self) -> None:
        super().__init__()
        self.held: dict[int, bytes] = {0x6064: bytes(4), 0x607A: bytes(4), 0x6040: bytes(2)}

    def answer(self, pdu: bytes) -> bytes:
        index = int.from_bytes(pdu[5:7], "big")
        if pdu[2]:
            self.held[index] = pdu[12:]
            return pdu[:11] + b"\x00"
        return pdu[:11] + bytes((len(self.held[index]),)) + self.held[index]


def mei_write(index: int, data: bytes) -> bytes:
    return bytes.fromhex("2B 0D 01 0000") + index.to_bytes(2, "big") + bytes(4) + bytes((len(data),)) + data


def mei_read(index: int, count: int) -> bytes:
    return bytes.fromhex("2B 0D 00 0000") + index.to_bytes(2, "big") + bytes(4) + bytes((count,))


def test_mei_a_target_and_its_reading_are_corrected_like_the_rest() -> None:
    bench = Bench(axis_plan(**MEI, unit_id=0), memory=MeiDrive(), tcp_drive=True, serial=False)
    bench.send(mei_write(0x607A, (50_000).to_bytes(4, "little")), unit_id=0)
    bench.serve()
    assert bench.port.take() == mei_write(0x607A, b"")[:11] + b"\x00"
    assert bench.memory.held[0x607A] == (50_010).to_bytes(4, "little")  # type: ignore[attr-defined]
    bench.memory.held[0x6064] = (50_010).to_bytes(4, "little")  # type: ignore[attr-defined]
    assert bench.ask(mei_read(0x6064, 4), unit_id=0)[12:] == (50_000).to_bytes(4, "little")


@pytest.mark.parametrize(
    "pdu", ["2B 0D 00 0000 6041 00 000000 02", "2B 0E 01 00", "2B 0D 01 0000 6081 00 000000 04 10270000"]
)
def test_mei_everything_else_passes_untouched(pdu: str) -> None:
    bench = Bench(axis_plan(**MEI), memory=Answering("AB 04"))
    assert bench.ask(bytes.fromhex(pdu)) == bytes.fromhex("AB 04")
    assert bench.seen[-1] == bytes.fromhex(pdu)


def test_mei_a_staged_target_runs_with_its_control_word() -> None:
    start = TriggerPlan(
        0x6040, mask=0x5F, rising=0x10, deeds={0x1F: Operation(Action.ABSOLUTE)}, otherwise=Action.IGNORE
    )
    motion = MotionPlan(is_staged=True, triggers=(start,))
    bench = Bench(axis_plan(**MEI, motion=motion), memory=MeiDrive())
    bench.ask(mei_write(0x6040, b"\x0f\x00"))
    bench.ask(mei_write(0x607A, (50_000).to_bytes(4, "little")))
    bench.ask(mei_write(0x6040, b"\x1f\x00"))
    bench.ask(mei_write(0x6040, b"\x0f\x00"))
    assert bench.memory.held[0x607A] == (50_010).to_bytes(4, "little")  # type: ignore[attr-defined]
    accepted = bench.line.axes[0].compensation.accepted
    assert accepted is not None
    assert accepted.nominal_counts == 50_000


# --- another thing is read than was written: image at 0, status at 0 --------------------------------------

IMAGE = {
    "command": (PositionField(2, INT32, HIGH, access=FieldAccess.WRITE),),
    "actual": (PositionField(2, INT32, HIGH, access=FieldAccess.READ),),
    "motion": MotionPlan(
        is_staged=True,
        modes=(ModePlan(1, mask=0x0100, actions={0: Action.ABSOLUTE, 0x0100: Action.RELATIVE}),),
        triggers=(
            TriggerPlan(0, mask=2, rising=2, deeds={2: Operation(Action.START)}, otherwise=Action.IGNORE),
            TriggerPlan(0, mask=1, deeds={1: Operation(Action.IGNORE)}, otherwise=Action.STOP),
        ),
    ),
}


def image(control: int, counts: int, direction: int = 0) -> bytes:
    words = control.to_bytes(2, "big") + direction.to_bytes(2, "big") + counts.to_bytes(4, "big")
    return bytes.fromhex("17 0000 0004 0000 0004 08") + words


class ImageDrive(Memory):
    """Holds the image that was written, and shows another."""

    def __init__(self) -> None:
        super().__init__()
        self.written: list[bytes] = []
        self.actual = 0

    def answer(self, pdu: bytes) -> bytes:
        if pdu[0] == 0x17:
            self.written.append(pdu[10:])
        return bytes((pdu[0], 8)) + bytes(4) + self.actual.to_bytes(4, "big")


def image_bench() -> tuple[Bench, ImageDrive]:
    drive = ImageDrive()
    return Bench(axis_plan(**IMAGE), memory=drive), drive


def test_a3_the_image_repeated_all_the_time_keeps_its_words_and_runs_once() -> None:
    bench, drive = image_bench()
    for control in (0x01, 0x01, 0x03, 0x03, 0x01, 0x01, 0x01):
        bench.ask(image(control, 50_000))
    positions = [int.from_bytes(words[4:], "big") for words in drive.written]
    # staged half-way while nothing is known of the direction, forward from the start bit on
    assert positions == [50_000, 50_000, 50_010, 50_010, 50_010, 50_010, 50_010]


def test_image_another_target_is_staged_without_a_start_and_runs_with_the_next() -> None:
    bench, drive = image_bench()
    for control, counts in ((1, 50_000), (3, 50_000), (1, 50_000), (1, 20_000), (3, 20_000), (3, 20_000)):
        drive.actual = 50_010 if len(drive.written) > 1 else 0
        bench.ask(image(control, counts))
    # the position that came with the image before tells that it goes backward
    assert [int.from_bytes(words[4:], "big") for words in drive.written][-3:] == [19_990, 19_990, 19_990]


def test_image_a_relative_start_that_is_held_moves_once() -> None:
    bench, drive = image_bench()
    bench.ask(image(1, 50_000))
    bench.ask(image(3, 50_000))
    drive.actual = 50_010
    for control in (1, 3, 3, 3, 1, 3):
        bench.ask(image(control, 1_000, 0x0100))
    accepted = bench.line.axes[0].compensation.accepted
    assert accepted is not None
    assert accepted.nominal_counts == 52_000


def test_image_a_start_bit_that_may_have_been_held_before_leaves_the_place_unknown() -> None:
    bench, drive = image_bench()
    bench.ask(image(3, 50_000))  # the first that the gateway ever sees
    assert bench.line.axes[0].compensation.accepted is None
    drive.actual = 40_000
    bench.ask(image(1, 50_000))
    bench.ask(image(3, 50_000))
    assert bench.line.axes[0].compensation.accepted is not None


def test_image_without_the_halt_bit_is_a_stop_and_passes_untouched() -> None:
    bench, drive = image_bench()
    bench.ask(image(0x01, 50_000))
    bench.ask(image(0x00, 77))
    assert drive.written[-1] == image(0x00, 77)[10:]


# --- coils and discrete inputs ----------------------------------------------------------------------------

COILS = {
    "motion": MotionPlan(
        is_staged=True,
        triggers=(
            *ONLY_ABSOLUTE.triggers,
            TriggerPlan(0x1C, is_coil=True, deeds={1: Operation(Action.HOME), 0: Operation(Action.IGNORE)}),
            TriggerPlan(0x19, is_coil=True, deeds={0: Operation(Action.STOP), 1: Operation(Action.IGNORE)}),
        ),
    ),
    "bits": {"done": BitField(0x4B, table=BitTable.INPUT), "moving": BitField(0x48, table=BitTable.INPUT)},
}


class CoilDrive(Memory):
    """Memory that also takes coils and shows eight inputs from 0x48."""

    inputs = 0

    def answer(self, pdu: bytes) -> bytes:
        if pdu[0] == 5:
            return pdu
        if pdu[0] == 15:
            return pdu[:5]
        if pdu[0] == 2:
            first = int.from_bytes(pdu[1:3], "big") - 0x48
            count = int.from_bytes(pdu[3:5], "big")
            return bytes((2, 1, self.inputs >> first & ((1 << count) - 1)))
        return super().answer(pdu)


def test_coils_a_stop_coil_passes_when_the_axis_is_blocked_and_a_trigger_does_not() -> None:
    bench = Bench(axis_plan(**COILS, travel=(0.0, 60.0)), memory=CoilDrive())
    assert bench.ask(write(COMMAND, 90_000))[0] == 0x90
    for stop in ("05 0019 0000", "0F 0018 0004 01 00"):
        assert bench.ask(bytes.fromhex(stop))[0] == bytes.fromhex(stop)[0]
    assert bench.ask(RUN_PDU) == bytes.fromhex("86 04")


@pytest.mark.parametrize("pdu", ["05 001C FF00", "05 001C FF00 00", "0F 001C 0001 01 01"])
def test_coils_a_trigger_that_is_longer_than_it_should_be_is_one(pdu: str) -> None:
    bench = Bench(axis_plan(**COILS), memory=CoilDrive())
    cnc, panel = Port(ControllerPlan("cnc")), Port(ControllerPlan("panel"))
    bench.send(write(COMMAND, 5_000), cnc)
    bench.serve()
    bench.send(bytes.fromhex(pdu), panel)
    assert panel.take() == bytes((int(pdu[:2], 16) | 0x80, 6))


def test_coils_the_done_input_tells_where_the_axis_is() -> None:
    drive = CoilDrive()
    bench = Bench(axis_plan(**COILS, actual=()), memory=drive)
    bench.ask(write(COMMAND, 50_000))
    bench.ask(RUN_PDU)
    assert bench.ask(bytes.fromhex("02 0048 0008")) == bytes.fromhex("02 01 00")
    drive.inputs = 0b1000
    assert bench.ask(bytes.fromhex("02 0048 0008")) == bytes.fromhex("02 01 08")
    bench.ask(write(COMMAND, 40_000))
    bench.ask(RUN_PDU)
    assert bench.memory.get(COMMAND) == 39_990
