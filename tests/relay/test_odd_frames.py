"""Frames of another length than their function code says, on real pseudo terminals."""

from dataclasses import dataclass
from typing import Final

import pytest

from gateway.exchange.plan import OtherUnits, Role
from gateway.modbus.crc import append_crc
from gateway.relay.gateway import Relay
from tests.support.relay import Bench, RawEnd, axis_plan, eventually, first_controller, line_status

START: Final = bytes.fromhex("05 03 01 01 30 B8")
SPEED: Final = bytes.fromhex("05 05 02 13 88 44 5A")
LONG: Final = bytes.fromhex("05 03 01 01 00 00 00 09 07 23 36")
STOP: Final = bytes.fromhex("01 06 60 02 00 40 37 FA")
READ: Final = append_crc(bytes.fromhex("05 03 00 10 00 01"))
VALUE: Final = append_crc(bytes.fromhex("05 03 02 00 07"))
ODD: Final = OtherUnits(frozenset({5}), frozenset({5}))


@dataclass
class Wires:
    """A raw controller and a raw drive, with a relay between them."""

    controller: RawEnd
    drive: RawEnd
    relay: Relay


async def wires_of(
    bench: Bench,
    other_units: OtherUnits = ODD,
    *,
    role: Role = Role.MOTION,
    answers: bool = True,
    tape_bytes: int = 0,
) -> Wires:
    """The drive answers a read, and repeats all else."""

    def answer(data: bytes) -> bytes | None:
        return None if not answers else VALUE if data == READ else data

    controller, drive, relay = await bench.raw_pair(
        "rtu", "rtu", answer, role=role, axes=(axis_plan(),), other_units=other_units, tape_bytes=tape_bytes
    )
    return Wires(controller, drive, relay)


@pytest.mark.parametrize("tape_bytes", [0, 1 << 20])
@pytest.mark.parametrize("frame", [START, SPEED, LONG], ids=lambda frame: frame.hex())
async def test_an_odd_frame_and_its_answer_get_through(bench: Bench, frame: bytes, tape_bytes: int) -> None:
    wires = await wires_of(bench, tape_bytes=tape_bytes)
    for _ in range(3):
        wires.controller.write(frame)
        await wires.controller.receives(frame)
        assert wires.drive.data == frame  # once
        wires.drive.data = b""
        wires.controller.write(READ)
        await wires.controller.receives(VALUE)
        wires.drive.data = b""
    assert first_controller(wires.relay)["dropped_bytes"] == 0
    assert line_status(wires.relay)["dropped_bytes"] == 0


async def test_byte_by_byte_too(bench: Bench) -> None:
    wires = await wires_of(bench)
    for byte in LONG:
        wires.controller.write(bytes((byte,)))
    await wires.controller.receives(LONG)
    assert wires.drive.data == LONG


@pytest.mark.parametrize("frame", [START, SPEED])
async def test_for_a_device_that_is_not_named_it_is_refused(bench: Bench, frame: bytes) -> None:
    wires = await wires_of(bench, OtherUnits(frozenset({6}), frozenset({6})))
    wires.controller.write(frame)
    await wires.controller.receives(append_crc(bytes((5, frame[1] | 0x80, 3))))
    assert wires.drive.data == b""


@pytest.mark.parametrize("frame", [START, SPEED, LONG])
async def test_a_stop_glued_behind_it_is_not_lost(bench: Bench, frame: bytes) -> None:
    wires = await wires_of(bench)
    wires.controller.write(frame + STOP)
    await wires.controller.receives(STOP)
    assert wires.drive.data == STOP  # W5: of several in one read only the last is waited for


async def test_a_stop_glued_in_front_of_it_goes_and_both_are_answered(bench: Bench) -> None:
    wires = await wires_of(bench)
    wires.controller.write(STOP + LONG)
    await wires.drive.until(lambda end: len(end.data) >= len(STOP + LONG))
    assert wires.drive.data == STOP + LONG


async def test_a_monitor_may_not_send_it(bench: Bench) -> None:
    wires = await wires_of(bench, role=Role.MONITOR)
    wires.controller.write(START)
    await wires.controller.receives(append_crc(bytes.fromhex("05 83 01")))
    wires.controller.write(READ)
    await wires.controller.receives(VALUE)
    assert wires.drive.data == READ


async def test_one_that_nobody_answers_is_sent_once(bench: Bench) -> None:
    wires = await wires_of(bench, answers=False)
    wires.controller.write(START)
    await eventually(lambda: line_status(wires.relay)["timeouts"] == 1)
    assert wires.drive.data == START
    assert wires.controller.data == b""
