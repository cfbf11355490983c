"""Cut-through over real pseudo terminals, between ends that write byte by byte.

A pseudo terminal has no baud rate: the ends keep that of 1 200 baud by timers of their own. How soon a frame
may begin to leave is given to the port as if it had been measured, with room for a machine that is busy; a
frame for which that was not enough is spoilt, and the next one is tried.
"""

import asyncio
from dataclasses import replace

import msgspec
import pytest

from gateway.clock import boot_ns
from gateway.compensation.settings import Setpoints
from gateway.exchange.cut_through.delay import (
    LEARNED_AFTER,
    FrameShape,
    Piece,
    acknowledgement_shape,
    write_shape,
)
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.line import LineExchange
from gateway.modbus.crc import INVERTED, append_crc, is_intact, residue_after
from gateway.state.plan import GatewayPlan, LinePlan
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.serial import SerialPort
from gateway.transport.serial_channel import character_ns
from gateway.transport.timer import Timer
from tests.support.relay import TIMING, Bench, RawEnd, axis_plan, until_up

BAUD = 1200
CHAR_NS = character_ns(SerialEndpoint("", BAUD))
SILENCE_NS = 100_000_000
"""Longer than what waits in a decoder is waited for."""
ROOM_NS = 20_000_000
TRIES = 40
HEARD_IN_S = 3.0
LENGTH = 13


def frame_of(counts: int) -> bytes:
    """The write of a position at register 100, high word first."""
    return append_crc(bytes.fromhex("01 10 00 64 00 02 04") + counts.to_bytes(4, "big"))


ACKNOWLEDGED = append_crc(bytes.fromhex("01 10 00 64 00 02"))


class Paced:
    """Writes a frame byte by byte, one in each character's time."""

    def __init__(self, end: RawEnd) -> None:
        self._end = end
        self._timer = Timer(self._next)
        self._left = b""
        self._due_ns = 0
        self.done: asyncio.Future[None] | None = None
        self.seen_before_last = -1
        """Bytes that the other end had got when the last one was written."""
        self.other: RawEnd | None = None

    def write(self, frame: bytes) -> "asyncio.Future[None]":
        """Write it, after a silence; return what is done when all of it was."""
        self._left = frame
        self._due_ns = boot_ns() + SILENCE_NS
        self._timer.arm(self._due_ns)
        self.done = asyncio.get_running_loop().create_future()
        return self.done

    def _next(self, _now_ns: int) -> None:
        if len(self._left) == 1 and self.other is not None:
            self.seen_before_last = len(self.other.data)
        self._end.write(self._left[:1])
        self._left = self._left[1:]
        if self._left:
            self._due_ns += CHAR_NS
            self._timer.arm(self._due_ns)
        elif self.done is not None:
            self.done.set_result(None)

    def close(self) -> None:
        """Write no more."""
        self._timer.close()


class Wires:
    """A relay between a raw controller and a raw drive, both on pseudo terminals."""

    def __init__(self, controller: RawEnd, drive: RawEnd, line: LineExchange) -> None:
        self.controller, self.drive = controller, drive
        self.paced, self.drive_paced = Paced(controller), Paced(drive)
        self.paced.other, self.drive_paced.other = drive, controller
        assert line.forwarding is not None
        self.forwarding = line.forwarding

    async def settle(self) -> None:
        """Let a stream begin that comes in whole frames, and is stored."""
        for counts in range(0, 30_000, 500):
            self.controller.write(frame_of(counts))
            await self.drive.until(lambda end: len(end.data) >= LENGTH)
            self.drive.data = b""
            self.drive.write(ACKNOWLEDGED)
            await self.controller.receives(ACKNOWLEDGED)
        self.teach()

    def teach(self) -> None:
        """Let the port know what it would have measured, and forget what a busy machine has cost it."""
        (way,) = self.forwarding._ways.values()
        way.forwarder._came = self.forwarding.drives._came = (
            None  # else learned from when the next one begins
        )
        for forgotten in (way.heads, way.replies):
            forgotten.delays.measured.clear()
            forgotten._stored.clear()
        for shape, measure in (
            (write_shape(2, 0, 2), way.heads.delays.measure),
            (acknowledgement_shape(), way.replies.delays.measure),
        ):
            for number in range(LEARNED_AFTER):
                measure(shape, pieces_of(shape, ROOM_NS if number else 0))

    def close(self) -> None:
        """Give the timers back."""
        self.paced.close()
        self.drive_paced.close()


def pieces_of(shape: FrameShape, late_ns: int) -> list[Piece]:
    """How a frame came of which all but the first byte was so late."""
    return [Piece(number * CHAR_NS + late_ns * (number > 0), number + 1) for number in range(shape.length)]


async def hears(end: RawEnd, count: int) -> bool:
    """Return whether so many bytes come in time."""
    try:
        async with asyncio.timeout(HEARD_IN_S):
            await end.until(lambda each: len(each.data) >= count)
    except TimeoutError:
        return False
    return True


async def wires_of(bench: Bench, *, echo: bool = False, tape_bytes: int = 0) -> Wires:
    drive, controller = RawEnd(), RawEnd()
    ends = []
    for end in (drive, controller):
        cable = bench.cable()
        await bench._open(SerialPort(SerialEndpoint(cable.far, BAUD), end, lambda _why: None))
        ends.append(SerialEndpoint(cable.near, BAUD))
    link, _ = bench.controller_link("tcp")
    link = replace(link, plan=replace(link.plan, serial=True, timeout_ms=20_000.0), endpoint=ends[1])
    plain = axis_plan()
    settings = replace(plain.settings, setpoints=Setpoints.STREAM, hysteresis=0.002)
    plan = LinePlan(
        "line",
        msgspec.structs.replace(ends[0], echo=echo),
        (link,),
        (replace(plain, settings=settings, actual=()),),
        replace(TIMING, response_timeout_ms=20_000.0),
        cut_through=True,
        tape_bytes=tape_bytes,
    )
    relay = await bench.start(GatewayPlan("bench", (plan,)))
    await until_up(relay)
    wires = Wires(controller, drive, relay._lines[0].exchange)
    bench.stack.callback(wires.close)
    return wires


@pytest.mark.parametrize(("echo", "tape_bytes"), [(False, 0), (True, 1 << 16)])
async def test_setpoint_and_reply_leave_as_they_come(bench: Bench, *, echo: bool, tape_bytes: int) -> None:
    wires = await wires_of(bench, echo=echo, tape_bytes=tape_bytes)
    if echo:
        wires.drive.script = lambda data: data
    await wires.settle()
    counts = 30_000
    for _ in range(TRIES):
        counts += 100
        wires.drive.data = b""
        wires.teach()
        await wires.paced.write(frame_of(counts))
        if not await hears(wires.drive, LENGTH):
            continue
        sent, wires.drive.data = wires.drive.data[:LENGTH], wires.drive.data[LENGTH:]
        if not is_intact(sent):  # too late somewhere: then it comes whole behind the silence
            assert residue_after(sent) == INVERTED
            if not await hears(wires.drive, LENGTH):
                continue
            sent, wires.drive.data = wires.drive.data, b""
        # The table adds one count per thousand.
        assert sent == frame_of(counts + round(counts / 1000))
        wires.controller.data = b""
        await wires.drive_paced.write(ACKNOWLEDGED)
        if not await hears(wires.controller, len(ACKNOWLEDGED)):
            continue  # the machine made a pause that ended the reply: its controller goes on
        heard = wires.controller.data
        if heard != ACKNOWLEDGED:
            assert residue_after(heard) == INVERTED
        is_seen = wires.paced.seen_before_last >= 7 and wires.drive_paced.seen_before_last >= 2
        if (
            is_seen
            and wires.forwarding.requests.ended[ForwardEvent.COMMITTED]
            and wires.forwarding.replies.ended[ForwardEvent.COMMITTED]
        ):
            break
    assert wires.forwarding.requests.ended[ForwardEvent.COMMITTED]
    assert wires.forwarding.replies.ended[ForwardEvent.COMMITTED]
    assert wires.paced.seen_before_last >= 7
    assert wires.drive_paced.seen_before_last >= 2
    assert (
        wires.forwarding.requests.ended[ForwardEvent.MET],
        wires.forwarding.replies.ended[ForwardEvent.BAD],
    ) == (0, 0)


async def test_w3_a_bad_check_sum_leaves_as_one_that_is_bad_in_both_bytes(bench: Bench) -> None:
    wires = await wires_of(bench)
    await wires.settle()
    frame = frame_of(30_100)
    for _ in range(TRIES):
        wires.teach()
        await wires.paced.write(frame[:-1] + bytes((frame[-1] ^ 1,)))
        if wires.drive.data:
            break
    await wires.drive.until(lambda end: len(end.data) >= LENGTH)
    assert residue_after(wires.drive.data) == INVERTED
    # What comes next is not joined to it.
    wires.drive.data = b""
    wires.controller.write(frame_of(30_100))
    await wires.drive.receives(frame_of(30_130))
