"""W6 over the death of a gateway: what its drives have still to say answers nothing of the next one."""

import socket
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from gateway.exchange.plan import LineTiming
from gateway.ipc.place import socket_path
from gateway.ipc.plan import GatewayPlan, LinePlan
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.relay.gateway import Relay

if TYPE_CHECKING:
    from tests.relay.conftest import Bench, RawEnd, Tools

READ = bytes.fromhex("03 0010 0001")
LATE = bytes.fromhex("03 02 1111")
REPLY = bytes.fromhex("03 02 2222")
NO_PATH = bytes.fromhex("83 0A")
FOR_EVER_MS = 3_600_000.0


def leave_a_dead_socket(state: Path) -> None:
    """What a gateway leaves that was killed."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
        dead.bind(str(socket_path(state)))


async def pair(
    bench: "Bench", state: Path, timing: LineTiming, drives: str = "rtu"
) -> tuple["RawEnd", "RawEnd", Relay]:
    far, where = await bench.drive(drives)
    link, _ = bench.controller_link("tcp")
    relay = Relay(
        GatewayPlan("bench", (LinePlan("line", where, (link,), (), timing),)), bench.notes.append, state=state
    )
    await relay.start()
    bench.stack.push_async_callback(relay.stop)
    await far.until(lambda end: end.opens == 1)
    return await bench.connect(relay.address("line", "cnc")), far, relay


@pytest.mark.parametrize("drives", ["rtu", "rtu_over_tcp"])
async def test_the_line_rests_first_and_nothing_is_sent_meanwhile(
    bench: "Bench", tools: "Tools", tmp_path: Path, drives: str
) -> None:
    leave_a_dead_socket(tmp_path)
    near, far, _ = await pair(bench, tmp_path, replace(tools.timing, drain_ms=FOR_EVER_MS), drives)
    near.write(encode_mbap(1, 1, READ))
    await near.receives(encode_mbap(1, 1, NO_PATH))
    assert far.data == b""
    [note] = [note for note in bench.notes if note.event == "line-rests"]
    assert str(note.fields["detail"]).endswith("waiting for 3.6e+06 ms of silence")


@pytest.mark.parametrize("drives", ["rtu", "rtu_over_tcp"])
async def test_what_comes_meanwhile_is_counted_and_answers_nothing(
    bench: "Bench", tools: "Tools", tmp_path: Path, drives: str
) -> None:
    leave_a_dead_socket(tmp_path)
    near, far, relay = await pair(bench, tmp_path, tools.timing, drives)
    far.write(encode_rtu(1, LATE))
    late_bytes = len(encode_rtu(1, LATE))
    await tools.eventually(lambda: tools.line_status(relay)["stray_bytes"] == late_bytes)
    await tools.until_up(relay)
    near.write(encode_mbap(2, 1, READ))
    await far.receives(encode_rtu(1, READ))
    far.write(encode_rtu(1, REPLY))
    await near.receives(encode_mbap(2, 1, REPLY))


@pytest.mark.parametrize("drives", ["rtu", "rtu_over_tcp"])
async def test_after_a_clean_stop_the_line_is_there_at_once(
    bench: "Bench", tools: "Tools", tmp_path: Path, drives: str
) -> None:
    timing = replace(tools.timing, drain_ms=FOR_EVER_MS)
    _, _, relay = await pair(bench, tmp_path, timing, drives)
    await relay.stop()
    near, far, relay = await pair(bench, tmp_path, timing, drives)
    await tools.until_up(relay)
    near.write(encode_mbap(1, 1, READ))
    await far.receives(encode_rtu(1, READ))
    assert not [note for note in bench.notes if note.event == "line-rests"]


async def test_replies_over_modbus_tcp_carry_a_number_and_need_no_silence(
    bench: "Bench", tools: "Tools", tmp_path: Path
) -> None:
    leave_a_dead_socket(tmp_path)
    timing = replace(tools.timing, drain_ms=FOR_EVER_MS)
    near, far, relay = await pair(bench, tmp_path, timing, "tcp")
    await tools.until_up(relay)
    near.write(encode_mbap(1, 1, READ))
    await far.until(lambda end: end.data[7:] == READ)
