from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from gateway.simulator.bus import DriveBus
from gateway.simulator.drive import DEFAULT_REGISTERS, AxisRegisters, SimulatedAxis, SimulatedDrive
from gateway.simulator.errors import SimulatorError
from gateway.simulator.mechanics import Encoder, Mechanics
from gateway.simulator.motion import Dynamics
from gateway.simulator.screw import Screw
from gateway.simulator.server import RegisterImage

COMMAND, ACTUAL, COMMANDED, STATUS = 0x0100, 0x0200, 0x0202, 0x0204
HOMED, DONE, MOVING, ALARM = 1, 2, 4, 8


def mechanics(start_mm: float = 0.0) -> Mechanics:
    return Mechanics(Screw(), Encoder(1000.0), dynamics=Dynamics(100.0, 1000.0), start_mm=start_mm)


def plain_drive(size: int = 0x10000, **options: object) -> SimulatedDrive:
    axis = SimulatedAxis("x", DEFAULT_REGISTERS, mechanics())
    return SimulatedDrive(1, [axis], image=RegisterImage(size), **options)  # type: ignore[arg-type]


def read(drive: SimulatedDrive, address: int, count: int, now_s: float, function: int = 3) -> bytes:
    reply = drive.answer(pack(">BHH", function, address, count), now_s)
    assert reply[:2] == bytes((function, 2 * count))
    return reply[2:]


def write(drive: SimulatedDrive, address: int, data: bytes, now_s: float) -> bytes:
    return drive.answer(pack(">BHHB", 16, address, len(data) // 2, len(data)) + data, now_s)


def test_writing_a_position_moves_the_axis_and_the_encoder_is_live() -> None:
    drive = plain_drive()
    assert write(drive, COMMAND, pack(">i", 20_000), 0.0) == pack(">BHH", 16, COMMAND, 2)
    # 20 mm at 100 mm/s and 1000 mm/s²: 0.1 s over 5 mm, 0.1 s over 10 mm, 0.1 s over 5 mm.
    assert read(drive, ACTUAL, 2, 0.1) == pack(">i", 5_000)
    assert read(drive, COMMANDED, 2, 0.1) == pack(">i", 5_000)
    assert read(drive, STATUS, 1, 0.1) == pack(">H", HOMED | MOVING)
    assert read(drive, ACTUAL, 2, 0.301, function=4) == pack(">i", 20_000)
    assert read(drive, STATUS, 1, 0.301) == pack(">H", HOMED | DONE)


def test_reading_a_command_back_gives_what_was_written() -> None:
    drive = plain_drive()
    write(drive, COMMAND, pack(">i", -5), 0.0)
    assert read(drive, COMMAND, 2, 0.0) == pack(">i", -5)


def test_a_half_written_alone_moves_to_what_the_register_then_holds() -> None:
    drive = plain_drive()
    write(drive, COMMAND, pack(">i", 0x0001_0005), 0.0)
    assert drive.answer(pack(">BHH", 6, COMMAND + 1, 0x0007), 10.0) == pack(">BHH", 6, COMMAND + 1, 7)
    assert read(drive, ACTUAL, 2, 20.0) == pack(">i", 0x0001_0007)


def test_other_registers_and_the_rest_of_the_status_word_are_plain_memory() -> None:
    drive = plain_drive()
    drive.answer(pack(">BHH", 6, STATUS, 0xF000), 0.0)
    assert read(drive, STATUS, 1, 0.0) == pack(">H", 0xF000 | HOMED | DONE)
    write(drive, 0x4000, b"\x12\x34\x56\x78", 0.0)
    assert read(drive, 0x4000, 2, 0.0) == b"\x12\x34\x56\x78"


def test_alarm_and_a_lost_home_show_in_their_bits() -> None:
    drive = plain_drive()
    drive.axes[0].mechanics.alarm = True
    drive.axes[0].mechanics.homed = False
    assert read(drive, STATUS, 1, 0.0) == pack(">H", ALARM)


def test_a_float_axis_in_low_word_order_with_a_scale() -> None:
    registers = AxisRegisters(
        command=(PositionField(0x10, RegisterType.FLOAT32, WordOrder.LOW_FIRST, scale=1000.0),),
        actual=(PositionField(0x20, RegisterType.INT16),),
        bits={"done": BitField(0x30, 15)},
    )
    drive = SimulatedDrive(7, [SimulatedAxis("z", registers, mechanics())])
    # 1.5 in steps of 1000 counts; 1.5 as float32 is 3F C0 00 00.
    write(drive, 0x10, b"\x00\x00\x3f\xc0", 0.0)
    assert read(drive, 0x20, 1, 9.0) == pack(">h", 1500)
    assert read(drive, 0x30, 1, 9.0) == pack(">H", 0x8000)


def test_an_actual_register_that_is_too_small_wraps_as_counters_do() -> None:
    registers = AxisRegisters(
        command=DEFAULT_REGISTERS.command, actual=(PositionField(0, RegisterType.INT16),)
    )
    drive = SimulatedDrive(1, [SimulatedAxis("x", registers, mechanics(40.0))])
    assert read(drive, 0, 1, 0.0) == pack(">h", 40_000 - 65_536)


def test_coils_are_written_one_by_one_and_in_blocks() -> None:
    drive = plain_drive()
    assert drive.answer(bytes.fromhex("05000AFF00"), 0.0) == bytes.fromhex("05000AFF00")
    # V1.1b3's own example: 10 coils from 19 with CD 01.
    assert drive.answer(bytes.fromhex("0F0013000A02CD01"), 0.0) == bytes.fromhex("0F0013000A")
    assert drive.answer(bytes.fromhex("010013000A"), 0.0) == bytes.fromhex("0102CD01")
    assert drive.answer(bytes.fromhex("02000A0001"), 0.0) == bytes.fromhex("020101")


def test_mask_write_follows_the_example_of_the_specification() -> None:
    drive = plain_drive()
    drive.answer(pack(">BHH", 6, 4, 0x12), 0.0)
    request = pack(">BHHH", 22, 4, 0xF2, 0x25)
    assert drive.answer(request, 0.0) == request
    assert read(drive, 4, 1, 0.0) == pack(">H", 0x17)


def test_read_write_multiple_writes_first() -> None:
    drive = plain_drive()
    request = pack(">BHHHHB", 23, 0x50, 2, 0x50, 2, 4) + b"\x01\x02\x03\x04"
    assert drive.answer(request, 0.0) == b"\x17\x04\x01\x02\x03\x04"


@pytest.mark.parametrize("request_hex", ["410102030405", "64", "65AABB", "080000A537"])
def test_vendor_codes_and_the_loopback_are_echoed(request_hex: str) -> None:
    pdu = bytes.fromhex(request_hex)
    assert plain_drive().answer(pdu, 0.0) == pdu


def test_exception_status_is_zero() -> None:
    assert plain_drive().answer(b"\x07", 0.0) == b"\x07\x00"


@pytest.mark.parametrize(
    ("request_hex", "code"),
    [
        ("2B0E0100", 1),  # unknown function
        ("0800010000", 1),  # unknown subfunction
        ("0300000000", 3),
        ("030000007E", 3),  # 126 registers
        ("03FFFF007E", 3),  # the quantity is checked before the address
        ("0300FF0002", 2),  # ends behind the last register
        ("0400FF0002", 2),
        ("0100FF0002", 2),
        ("01000007D1", 3),  # 2001 coils
        ("0500010001", 3),
        ("050100FF00", 2),
        ("0601000001", 2),
        ("100000007CF8" + "00" * 248, 3),  # 124 registers
        ("100000000203000000", 3),  # byte count is not twice the quantity
        ("10000000020400000000"[:-2], 3),  # a byte is missing
        ("1000FF00020400000000", 2),
        ("0F00FF00020100", 2),
        ("0F0000000902FF", 3),
        ("160100FFFF0000", 2),
        ("17000000000000000204000000", 3),
        ("17000000010000000204000000"[:-2], 3),
        ("170000000101000001020000", 2),
        ("03", 3),
        ("17", 3),
    ],
)
def test_refusals_come_in_the_order_of_the_specification(request_hex: str, code: int) -> None:
    pdu = bytes.fromhex(request_hex)
    drive = SimulatedDrive(1, image=RegisterImage(0x100))
    assert drive.answer(pdu, 0.0) == bytes((pdu[0] | 0x80, code))


def test_a_drive_takes_no_more_registers_than_it_says() -> None:
    drive = plain_drive(max_registers=10)
    assert drive.answer(pack(">BHH", 3, 0, 11), 0.0) == b"\x83\x03"
    assert read(drive, 0, 10, 0.0) == bytes(20)


def test_a_drive_without_fc16_says_so() -> None:
    assert write(plain_drive(without=(16,)), COMMAND, bytes(4), 0.0) == b"\x90\x01"


@given(st.binary(min_size=1, max_size=253))
def test_any_bytes_get_a_reply_of_their_function(pdu: bytes) -> None:
    reply = SimulatedDrive(1).answer(pdu, 0.0)
    assert reply[0] & 0x7F == pdu[0] & 0x7F
    assert 1 <= len(reply) <= 253


def two_drives() -> DriveBus:
    return DriveBus(
        SimulatedDrive(unit, [SimulatedAxis(name, DEFAULT_REGISTERS, mechanics())])
        for unit, name in ((1, "x"), (2, "y"))
    )


def test_a_broadcast_is_obeyed_by_all_and_answered_by_none() -> None:
    bus = two_drives()
    assert bus.answer(0, pack(">BHHBi", 16, COMMAND, 2, 4, 777), 0.0) is None
    assert [bus.axis(name).mechanics.target_counts for name in "xy"] == [777, 777]
    assert [w.unit_id for w in bus.ledger.writes] == [1, 2]


def test_a_unit_that_is_not_there_stays_silent() -> None:
    bus = two_drives()
    assert bus.answer(3, pack(">BHH", 3, 0, 1), 0.0) is None
    assert not bus.has(3)
    assert bus.answer(1, b"", 0.0) is None


def test_the_ledger_keeps_every_write_in_order() -> None:
    bus = two_drives()
    bus.answer(1, pack(">BHHBi", 16, COMMAND, 2, 4, 5), 0.25)
    bus.answer(2, pack(">BHH", 6, 9, 8), 0.5)
    bus.answer(2, pack(">BHH", 3, 9, 1), 0.5)
    (move,) = bus.ledger.writes_to(1, COMMAND)
    assert (move.function, move.words, move.now_s) == (16, pack(">i", 5), 0.25)
    assert bus.ledger.writes_to(2, 9)[0].words == b"\x00\x08"
    assert bus.ledger.requests == {16: 1, 6: 1, 3: 1}


def test_two_drives_with_one_unit_id_are_refused() -> None:
    with pytest.raises(SimulatorError, match="unit id 4"):
        DriveBus([SimulatedDrive(4), SimulatedDrive(4)])
