"""W6 over the death of a gateway: what its drives have still to say answers nothing of the next one."""

import asyncio
import socket
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.exchange.plan import LineTiming
from gateway.exchange.queue import REQUEST_BYTES, WAITING_BYTES
from gateway.ipc.address import socket_path
from gateway.ipc.client import NoGatewayError, ask
from gateway.ipc.messages import Ping
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.recording.writer import Recorder
from gateway.relay.errors import StartError
from gateway.relay.gateway import Relay
from gateway.state.plan import GatewayPlan, LinePlan
from gateway.transport.endpoints import SerialEndpoint
from tests.support.recordings import HEADER, replayed
from tests.support.relay import TIMING, Bench, RawEnd, eventually, line_status, until_up

READ = bytes.fromhex("03 0010 0001")
LATE = bytes.fromhex("03 02 1111")
REPLY = bytes.fromhex("03 02 2222")
BUSY = bytes.fromhex("83 06")
FOR_EVER_MS = 3_600_000.0


def leave_a_dead_socket(state: Path) -> None:
    """What a gateway leaves that was killed."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(str(socket_path(state)))


async def pair(
    bench: Bench, state: Path, timing: LineTiming, drives: str = "rtu"
) -> tuple[RawEnd, RawEnd, Relay]:
    far, where = await bench.drive(drives)
    link, _ = bench.controller_link("tcp")
    relay = await bench.start(
        GatewayPlan("bench", (LinePlan("line", where, (link,), (), timing),)), state=state
    )
    await far.until(lambda end: end.opens == 1)
    return await bench.connect(relay.address("line", "cnc")), far, relay


@pytest.mark.parametrize("drives", ["rtu", "rtu_over_tcp"])
async def test_the_line_rests_first_and_requests_wait(bench: Bench, tmp_path: Path, drives: str) -> None:
    leave_a_dead_socket(tmp_path)
    near, far, _ = await pair(bench, tmp_path, replace(TIMING, drain_ms=FOR_EVER_MS), drives)
    number = -(-2 * WAITING_BYTES // (REQUEST_BYTES + len(READ)))
    for each in range(number):
        near.write(encode_mbap(each, 1, READ))
    near.write(encode_mbap(number, 1, READ))  # as many as may wait do wait, and as many for their refusal
    await near.receives(encode_mbap(number, 1, BUSY))
    assert far.data == b""
    [note] = [note for note in bench.notes if note.event == "line-rests"]
    assert str(note.fields["detail"]).endswith("waiting for 3.6e+06 ms of silence")


@pytest.mark.parametrize("drives", ["rtu", "rtu_over_tcp"])
async def test_late_replies_are_counted_and_answer_nothing(bench: Bench, tmp_path: Path, drives: str) -> None:
    leave_a_dead_socket(tmp_path)
    near, far, relay = await pair(bench, tmp_path, TIMING, drives)
    far.write(encode_rtu(1, LATE))
    late_bytes = len(encode_rtu(1, LATE))
    await eventually(lambda: line_status(relay)["stray_bytes"] == late_bytes)
    near.write(encode_mbap(2, 1, READ))
    await far.receives(encode_rtu(1, READ))
    far.write(encode_rtu(1, REPLY))
    await near.receives(encode_mbap(2, 1, REPLY))


@pytest.mark.parametrize("drives", ["rtu", "rtu_over_tcp"])
async def test_after_a_clean_stop_the_line_serves_at_once(bench: Bench, tmp_path: Path, drives: str) -> None:
    timing = replace(TIMING, drain_ms=FOR_EVER_MS)
    _, _, relay = await pair(bench, tmp_path, timing, drives)
    await relay.stop()
    near, far, relay = await pair(bench, tmp_path, timing, drives)
    await until_up(relay)
    near.write(encode_mbap(1, 1, READ))
    await far.receives(encode_rtu(1, READ))
    assert not [note for note in bench.notes if note.event == "line-rests"]


async def test_replies_over_modbus_tcp_need_no_silence(bench: Bench, tmp_path: Path) -> None:
    leave_a_dead_socket(tmp_path)
    timing = replace(TIMING, drain_ms=FOR_EVER_MS)
    near, far, relay = await pair(bench, tmp_path, timing, "tcp")
    await until_up(relay)
    near.write(encode_mbap(1, 1, READ))
    await far.until(lambda end: end.data[7:] == READ)


def rests(bench: Bench) -> int:
    """How often a line began with a rest."""
    return sum(note.event == "line-rests" for note in bench.notes)


@pytest.mark.parametrize("drives", ["rtu", "rtu_over_tcp"])
async def test_a_gateway_killed_while_it_stops_was_killed(bench: Bench, tmp_path: Path, drives: str) -> None:
    near, far, relay = await pair(bench, tmp_path, TIMING, drives)
    await until_up(relay)
    near.write(encode_mbap(1, 1, READ))
    await far.receives(encode_rtu(1, READ))
    stopping = asyncio.create_task(relay.stop())
    await asyncio.sleep(0)
    # It waits for the drive. A kill now, or a second signal, leaves what stands here.
    assert socket_path(tmp_path).is_socket()
    with pytest.raises(StartError, match="belongs to a gateway that runs"):
        await Relay(relay._plan, state=tmp_path).start()
    with pytest.raises(NoGatewayError, match="nothing listens"):
        await asyncio.to_thread(ask, socket_path(tmp_path), Ping())
    far.write(encode_rtu(1, REPLY))
    await stopping
    assert not socket_path(tmp_path).exists()


@pytest.mark.parametrize("drives", ["rtu", "rtu_over_tcp"])
async def test_after_an_unanswered_stop_the_line_rests(bench: Bench, tmp_path: Path, drives: str) -> None:
    near, far, relay = await pair(bench, tmp_path, TIMING, drives)
    await until_up(relay)
    near.write(encode_mbap(1, 1, READ))
    await far.receives(encode_rtu(1, READ))
    await relay.stop()  # the drive has not answered within its time, and may still
    assert rests(bench) == 0
    _, _, relay = await pair(bench, tmp_path, replace(TIMING, drain_ms=FOR_EVER_MS), drives)
    assert rests(bench) == 1
    await relay.stop()  # in the middle of its rest
    await pair(bench, tmp_path, TIMING, drives)
    assert rests(bench) == 2


async def test_a_start_that_fails_leaves_the_rest_to_another(bench: Bench, tmp_path: Path) -> None:
    leave_a_dead_socket(tmp_path)
    bad = LinePlan("line", SerialEndpoint("/dev/null"), (), (), TIMING)
    for _ in range(2):
        with pytest.raises(StartError, match="is not a serial port"):
            await Relay(GatewayPlan("bench", (bad,)), bench.notes.append, state=tmp_path).start()
    await pair(bench, tmp_path, TIMING)
    assert rests(bench) == 3


async def test_a_rest_is_recorded_and_replayed(bench: Bench, tmp_path: Path) -> None:
    leave_a_dead_socket(tmp_path)
    far, where = await bench.drive("rtu")
    link, _ = bench.controller_link("tcp")
    plan = GatewayPlan("bench", (LinePlan("line", where, (link,), (), TIMING),))
    recorder = Recorder(tmp_path / "record.jsonl", HEADER)
    relay = await bench.start(plan, state=tmp_path, recorder=recorder)
    near = await bench.connect(relay.address("line", "cnc"))
    near.write(encode_mbap(1, 1, READ))
    await far.receives(encode_rtu(1, READ))
    far.write(encode_rtu(1, REPLY))
    await near.receives(encode_mbap(1, 1, REPLY))
    await relay.stop()
    result = replayed(plan, recorder.path)
    assert (result.different, result.is_truncated) == (0, False)
