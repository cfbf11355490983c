"""The last minutes of a line, looked into while it runs, replayed from where they begin."""

import asyncio
import mmap
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.commands import SetGain, SetReference
from gateway.exchange.plan import AxisPlan, ControllerPlan, Reference
from gateway.ipc.client import borrow
from gateway.ipc.messages import GetTapes, Tapes
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.registers import BitField
from gateway.recording import traffic
from gateway.recording.capture import Capture, NoCaptureError, Timed
from gateway.recording.replay import ReplayResult
from gateway.recording.trace_buffer import TEXT
from gateway.relay.gateway import Relay
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan
from gateway.transport.endpoints import TcpEndpoint
from tests.exchange.line_bench import Memory
from tests.support.recordings import replayed
from tests.support.relay import TIMING, Bench, RawEnd, axis_plan, until_up

LOOPBACK = TcpEndpoint("127.0.0.1", 0)
COMMAND, ACTUAL, HOMED = 100, 110, 120
SMALLEST = 8 * 4096
"""Eight segments of a page each: some thirty exchanges in each of them."""
HEADER = traffic.Header(traffic.CAPTURED, "0", "2026-01-01T00:00:00+00:00", "gateway.toml", "")


def drive(memory: Memory) -> Callable[[bytes], bytes]:
    """A drive that is at once where it is told to be, over Modbus/TCP."""

    def answer(data: bytes) -> bytes:
        replies = b""
        while data:
            size = int.from_bytes(data[4:6], "big")
            pdu, head, data = data[7 : 6 + size], data[:7], data[6 + size :]
            reply = memory.answer(pdu)
            if pdu[0] == 16 and int.from_bytes(pdu[1:3], "big") == COMMAND:
                memory.write(ACTUAL, pdu[6:10])
            replies += encode_mbap(int.from_bytes(head[:2], "big"), head[6], reply)
        return replies

    return answer


def write(counts: int) -> bytes:
    return b"\x10" + COMMAND.to_bytes(2, "big") + b"\0\x02\x04" + counts.to_bytes(4, "big", signed=True)


READ = b"\x03" + ACTUAL.to_bytes(2, "big") + b"\0\x02"


async def running(
    bench: Bench, state: Path, axis: AxisPlan, memory: Memory
) -> tuple[GatewayPlan, Relay, RawEnd]:
    _, where = await bench.drive("tcp", drive(memory))
    link = ControllerLink(ControllerPlan("cnc"), LOOPBACK)
    plan = GatewayPlan("bench", (LinePlan("line", where, (link,), (axis,), TIMING, tape_bytes=SMALLEST),))
    relay = await bench.start(plan, state=state)
    await until_up(relay)
    return plan, relay, await bench.connect(relay.address("line", "cnc"))


async def ask(controller: RawEnd, number: int, pdu: bytes) -> bytes:
    controller.data = b""
    controller.write(encode_mbap(number & 0xFFFF, 1, pdu))
    await controller.until(
        lambda end: len(end.data) > 6 and len(end.data) >= 6 + int.from_bytes(end.data[4:6], "big")
    )
    return controller.data[7:]


async def captured(relay: Relay) -> list[Timed]:
    assert relay.control_socket is not None
    capture = await asyncio.to_thread(Capture, relay.control_socket)
    try:
        return capture.new()[0]
    finally:
        capture.close()


def replayed_capture(plan: GatewayPlan, timed: list[Timed]) -> ReplayResult:
    entries = [traffic.decode(traffic.encode(entry)) for _, entry in timed]
    return replayed(plan, [HEADER, *entries, traffic.End(len(timed))])


async def test_a_capture_has_the_frames_of_both_sides(bench: Bench, tmp_path: Path) -> None:
    plan, relay, controller = await running(bench, tmp_path, axis_plan(), Memory())
    assert await ask(controller, 7, write(50_000)) == write(50_000)[:5]
    timed = await captured(relay)
    frames = [(t_ns, entry) for t_ns, entry in timed if not isinstance(entry, traffic.Up | traffic.Beginning)]
    asked_ns, _, replied_ns, _ = [t_ns for t_ns, _ in frames]
    assert [entry for _, entry in frames] == [
        traffic.Request("line", asked_ns, 1, "cnc", 7, 1, write(50_000).hex(), "127.0.0.1"),
        # The table adds 50 counts at 50 mm.
        traffic.Sent("line", 1, write(50_050).hex()),
        traffic.Reply("line", replied_ns, 1, write(50_050)[:5].hex()),
        traffic.Answered("line", 1, 7, 1, write(50_000)[:5].hex()),
    ]
    times = [t_ns for t_ns, _ in timed]
    assert times == sorted(times)
    [up] = [(t_ns, entry.t) for t_ns, entry in timed if isinstance(entry, traffic.Up)]
    assert up[0] == up[1]
    result = replayed_capture(plan, timed)
    assert (result.different, result.outputs, result.is_truncated) == (0, 2, False)


async def test_what_only_a_newer_release_understands_is_told(bench: Bench, tmp_path: Path) -> None:
    _, relay, _ = await running(bench, tmp_path, axis_plan(), Memory())
    trace_buffer = relay._lines[0].trace_buffer
    assert trace_buffer is not None
    trace_buffer.put(TEXT, 7, 0, b'{"kind":"dance","line":"line","t":7}')
    with pytest.raises(NoCaptureError, match=r"'dance'.*; command and gateway must be"):
        await captured(relay)


@pytest.mark.parametrize("reference", [Reference.ABSOLUTE, Reference.DRIVE_BIT, Reference.SET_POSITION])
async def test_the_rest_of_a_long_run_is_replayed(bench: Bench, tmp_path: Path, reference: Reference) -> None:
    """Axes and their corrections are as they were in the middle of the run, although its start is lost."""
    memory = Memory()
    memory.words[HOMED] = 1
    # 0.05 mm forward and -0.05 mm backward: 50 counts, and the direction decides.
    table = make_table([0.0, 100.0], [0.05, 0.05], [-0.05, -0.05], Units.MM)
    axis = replace(axis_plan(), referenced=reference, table=table)
    if reference is Reference.DRIVE_BIT:
        axis = replace(axis, bits={"homed": BitField(HOMED)})
    plan, relay, controller = await running(bench, tmp_path, axis, memory)
    if reference is Reference.SET_POSITION:
        relay.command(SetReference(axis="x"))
    for number in range(600):
        # Forwards and backwards, with readings between: 1 200 exchanges are five times what the tape holds.
        await ask(controller, number, write(number * 7919 % 100_000))
        await ask(controller, number, READ)
    timed = await captured(relay)
    assert not any(isinstance(entry, traffic.Up) for _, entry in timed)
    result = replayed_capture(plan, timed)
    assert result.first == []
    assert result.different == 0
    assert result.outputs > 400


async def test_a_line_that_keeps_nothing_says_so(bench: Bench, tmp_path: Path) -> None:
    relay = await bench.start(GatewayPlan("bench", ()), state=tmp_path)
    with pytest.raises(NoCaptureError, match="set size_mb in"):
        await captured(relay)


async def test_what_was_changed_since_the_start_is_known_to_a_capture(bench: Bench, tmp_path: Path) -> None:
    plan, relay, controller = await running(bench, tmp_path, axis_plan(), Memory())
    relay.command(SetGain(axes=("x",), forward=0.5, backward=0.5))
    for number in range(400):
        await ask(controller, number, write(number * 7919 % 100_000))
    timed = await captured(relay)
    assert not any(isinstance(entry, traffic.Commanded) for _, entry in timed)
    assert replayed_capture(plan, timed).different == 0
    [first, *_] = [entry for _, entry in timed if isinstance(entry, traffic.Beginning)]
    told = [traffic.as_command(each).command for each in first.controls]
    assert told == [SetGain(axes=("x",), forward=0.5, backward=0.5)]


async def test_only_who_may_change_something_may_look(bench: Bench, tmp_path: Path) -> None:
    """Frames may hold what nobody else is to know; and what is lent cannot be written."""
    _, relay, _ = await running(bench, tmp_path, axis_plan(), Memory())
    assert relay.control_socket is not None
    reply, lent = await asyncio.to_thread(borrow, relay.control_socket, GetTapes())
    assert reply == Tapes(lines=("line",))
    [descriptor] = lent
    try:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.write(descriptor, b"x")
        with pytest.raises(PermissionError):
            mmap.mmap(descriptor, 4096, prot=mmap.PROT_WRITE)
    finally:
        os.close(descriptor)
