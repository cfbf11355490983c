"""An RS-485 adapter whose receiver stays on: every request comes back before its reply."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import RtuRequestDecoder, encode_rtu
from gateway.transport.endpoints import SerialEndpoint
from tests.support.relay import TIMING, Bench, RawEnd, eventually, first_controller, line_status, until_up

if TYPE_CHECKING:
    from gateway.relay.gateway import Relay

WRITE = bytes.fromhex("06 00C8 1234")
READ = bytes.fromhex("03 0010 0002")
SEVENS = bytes.fromhex("03 04 0007 0007")
BROADCAST = bytes.fromhex("06 6002 0040")


class Echoing:
    """Sends back what it hears, and acknowledges a write of one register: the very same bytes again.

    Each register that is read is 7.
    """

    def __init__(self, *, has_echo: bool = True) -> None:
        self.has_echo = has_echo
        self._decoder = RtuRequestDecoder()

    def __call__(self, data: bytes) -> bytes:
        heard = self._decoder.feed(data, 0)
        answers = [encode_rtu(unit, _answer(pdu)) for unit, pdu in heard if unit]
        return (data if self.has_echo else b"") + b"".join(answers)


def _answer(pdu: bytes) -> bytes:
    return bytes((3, 2 * pdu[4])) + b"\0\7" * pdu[4] if pdu[0] == 3 else pdu


async def test_the_own_request_is_taken_out_and_is_no_acknowledgement(bench: Bench) -> None:
    drive, where = await bench.drive("rtu", Echoing())
    assert isinstance(where, SerialEndpoint)
    link, _ = bench.controller_link("tcp", timeout_ms=4000.0)
    # Time for an echo to come back on a machine that is busy, also after a broadcast, which has no reply.
    timing = replace(TIMING, response_timeout_ms=2000.0, turnaround_ms=500.0)
    relay = await bench.relay(msgspec.structs.replace(where, echo=True), (link,), timing=timing)
    await until_up(relay)
    controller = await bench.connect(relay.address("line", "cnc"))
    for number in range(3):
        controller.write(encode_mbap(number, 1, WRITE))
        await controller.receives(encode_mbap(number, 1, WRITE))
    controller.write(encode_mbap(3, 0, BROADCAST))
    await drive.until(lambda end: end.data.endswith(encode_rtu(0, BROADCAST)))
    controller.write(encode_mbap(4, 1, WRITE))
    await controller.receives(encode_mbap(4, 1, WRITE))
    status = line_status(relay)
    assert (status["echoes"], status["late"], status["stray_bytes"]) == (5, 0, 0)


async def test_an_echo_that_nobody_announced_is_named_as_that(bench: Bench) -> None:
    relay, controller = await _undeclared(bench, Echoing())
    for number in range(3):
        controller.data = b""
        controller.write(encode_mbap(number, 1, READ))
        await controller.receives(encode_mbap(number, 1, SEVENS))
    why = "set echo = true: the adapter returns what is sent"
    drives: Any = line_status(relay)["drives"]
    assert drives["echo"] == why
    [note] = [note for note in bench.notes if note.event == "adapter-echoes"]
    assert note.fields["detail"] == f"{drives['address']}: {why}"


async def test_a_drive_that_acknowledges_with_the_bytes_of_the_request_is_no_echo(bench: Bench) -> None:
    relay, controller = await _undeclared(bench, Echoing(has_echo=False))
    for number, (asked, answer) in enumerate([(WRITE, WRITE), (READ, SEVENS)] * 4):
        controller.data = b""
        controller.write(encode_mbap(number, 1, asked))
        await controller.receives(encode_mbap(number, 1, answer))
    drives: Any = line_status(relay)["drives"]
    assert drives["echo"] == ""
    assert [note for note in bench.notes if note.event == "adapter-echoes"] == []


async def test_an_acknowledgement_that_comes_back_is_not_written_again(bench: Bench) -> None:
    drive, controller, relay = await _echoing_controller(bench)
    for asked, answered in ((WRITE, WRITE), (READ, SEVENS), (WRITE, WRITE)):
        controller.write(encode_rtu(1, asked))
        await controller.receives(encode_rtu(1, answered))
    assert drive.data == encode_rtu(1, WRITE) + encode_rtu(1, READ) + encode_rtu(1, WRITE)
    why = "set echo = true: the adapter returns what is sent"
    status = first_controller(relay)
    assert (status["echo"], status["damaged"]) == (why, 0)
    [note] = [note for note in bench.notes if note.event == "adapter-echoes"]
    assert (note.fields["controller"], note.fields["detail"]) == ("cnc", f"{status['address']}: {why}")


async def test_an_echo_of_replies_that_is_announced_is_no_trouble(bench: Bench) -> None:
    drive, controller, relay = await _echoing_controller(bench, echo=True)
    for number in range(1, 4):
        controller.write(encode_rtu(1, WRITE))
        await controller.receives(encode_rtu(1, WRITE))
        await _until_echoes(relay, number)
    assert drive.data == encode_rtu(1, WRITE) * 3
    assert first_controller(relay)["echo"] == ""
    assert [note for note in bench.notes if note.event == "adapter-echoes"] == []


async def test_a_controller_that_repeats_a_write_at_once_is_no_echo(bench: Bench) -> None:
    controller, drive, relay = await bench.raw_pair(
        "rtu",
        "rtu",
        Echoing(has_echo=False),
        timeout_ms=4000.0,
        timing=replace(TIMING, response_timeout_ms=2000.0),
    )
    controller.write(encode_rtu(1, READ))
    await controller.receives(encode_rtu(1, SEVENS))
    for _ in range(5):
        controller.write(encode_rtu(1, WRITE))
        await controller.receives(encode_rtu(1, WRITE))
    assert drive.data == encode_rtu(1, READ) + encode_rtu(1, WRITE) * 5
    assert first_controller(relay)["echo"] == ""


async def _until_echoes(relay: "Relay", number: int) -> None:
    await eventually(lambda: first_controller(relay)["echoes"] == number)


async def _echoing_controller(bench: Bench, *, echo: bool = False) -> "tuple[RawEnd, RawEnd, Relay]":
    """Return a drive without an echo, a controller behind an adapter that returns all, and the relay."""
    drive, where = await bench.drive("rtu", Echoing(has_echo=False))
    link, device = bench.controller_link("rtu", timeout_ms=4000.0)
    assert isinstance(link.endpoint, SerialEndpoint)
    link = replace(link, endpoint=msgspec.structs.replace(link.endpoint, echo=echo))
    relay = await bench.relay(where, (link,), timing=replace(TIMING, response_timeout_ms=2000.0))
    await until_up(relay)
    return drive, await bench.plug(device, lambda data: data), relay


async def _undeclared(bench: Bench, drive: Echoing) -> "tuple[Relay, RawEnd]":
    """Return a gateway that was told nothing of an echo, and its controller."""
    controller, _, relay = await bench.raw_pair(
        "tcp", "rtu", drive, timeout_ms=4000.0, timing=replace(TIMING, response_timeout_ms=2000.0)
    )
    return relay, controller
