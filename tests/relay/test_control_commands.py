"""Commands to a relay that runs, over its socket."""

import asyncio
import os
from pathlib import Path

import pytest

from gateway.exchange.commands import Disable, Enable, SetReference
from gateway.ipc.client import ask
from gateway.ipc.messages import Done, GetStatus, Ping, Pong, Status
from gateway.modbus.mbap import encode_mbap
from gateway.relay.errors import StartError
from gateway.relay.gateway import Relay
from gateway.state.plan import GatewayPlan, LinePlan
from tests.support.relay import TIMING, Bench, axis_plan, eventually, until_up

WRITE_50_000 = bytes.fromhex("10 0064 0002 04 0000C350")
"""50 mm at 1000 counts/mm into register 100."""
WRITE_50_001 = bytes.fromhex("10 0064 0002 04 0000C351")
CORRECTED = bytes.fromhex("10 0064 0002 04 0000C382")
"""50.05 mm: the table of the bench adds 0.05 mm at 50 mm."""


def answered(data: bytes) -> bytes:
    """Acknowledge FC16."""
    return data[:4] + bytes((0, 6)) + data[6:12]


async def started(bench: Bench, state: Path) -> tuple[Relay, list[bytes]]:
    """A relay with one axis; and all that its drive was told."""
    told: list[bytes] = []

    def script(data: bytes) -> bytes:
        told.append(data[7:])
        return answered(data)

    _, where = await bench.drive("tcp", script)
    link, _ = bench.controller_link("tcp")
    line = LinePlan("line", where, (link,), (axis_plan(),), TIMING)
    relay = await bench.start(GatewayPlan("bench", (line,)), state=state)
    await until_up(relay)
    return relay, told


async def test_compensation_is_switched_off_and_on_while_it_runs(bench: Bench, tmp_path: Path) -> None:
    relay, told = await started(bench, tmp_path)
    assert relay.control_socket is not None
    near = await bench.connect(relay.address("line", "cnc"))

    async def write(pdu: bytes) -> bytes:
        near.write(encode_mbap(1, 1, pdu))
        await near.receives(encode_mbap(1, 1, pdu[:5]))
        return told[-1]

    assert await write(WRITE_50_000) == CORRECTED
    assert await asyncio.to_thread(ask, relay.control_socket, Disable(axes=("x",))) == Done(changed=("x",))
    assert await write(WRITE_50_001) == WRITE_50_001
    assert await asyncio.to_thread(ask, relay.control_socket, Enable()) == Done(
        changed=("x",), comes={"x": "next-target"}
    )
    assert await write(WRITE_50_000) == CORRECTED
    await eventually(lambda: "enabled" in [note.event for note in bench.notes])
    assert [(n.event, n.fields["axes"]) for n in bench.notes if "axes" in n.fields] == [
        ("disabled", ["x"]),
        ("enabled", ["x"]),
    ]


async def test_a_relay_whose_socket_was_removed_makes_it_again(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.relay.gateway.TICK_EVERY_S", 0.02)
    relay, _ = await started(bench, tmp_path)
    assert relay.control_socket is not None
    relay.control_socket.unlink()
    await eventually(lambda: "socket-missing" in [note.event for note in bench.notes])
    assert await asyncio.to_thread(ask, relay.control_socket, Disable(axes=("x",))) == Done(changed=("x",))


NAME = Path("/proc/self/comm").read_text().strip()


async def test_an_event_says_which_process_sent_the_command(bench: Bench, tmp_path: Path) -> None:
    relay, _ = await started(bench, tmp_path)
    assert relay.control_socket is not None
    await asyncio.to_thread(ask, relay.control_socket, Disable(axes=("x",)))
    relay.command(Enable(axes=("x",)))  # no other process
    await eventually(lambda: "enabled" in [note.event for note in bench.notes])
    disabled, enabled = (note.fields for note in bench.notes if note.event in ("disabled", "enabled"))
    assert (disabled["user"], disabled["pid"], disabled["program"]) == (os.geteuid(), os.getpid(), NAME)
    assert "pid" not in enabled


async def test_the_relay_says_who_it_is_and_how_it_is(bench: Bench, tmp_path: Path) -> None:
    relay, _ = await started(bench, tmp_path)
    assert relay.control_socket is not None
    pong = await asyncio.to_thread(ask, relay.control_socket, Ping())
    assert isinstance(pong, Pong)
    assert pong.name == "bench"
    reply = await asyncio.to_thread(ask, relay.control_socket, GetStatus())
    assert isinstance(reply, Status)
    assert reply.status.lines["line"].state == "up"
    assert reply.status.axes["x"].units == "mm"


async def test_an_unknown_axis_is_named_and_the_others_are_commanded(bench: Bench, tmp_path: Path) -> None:
    relay, _ = await started(bench, tmp_path)
    assert relay.control_socket is not None
    reply = await asyncio.to_thread(ask, relay.control_socket, Disable(axes=("nope", "x")))
    assert reply == Done(changed=("x",), problems=("axis nope: there is none of that name; there are x",))
    reply = await asyncio.to_thread(ask, relay.control_socket, SetReference(axis="nope"))
    assert isinstance(reply, Done)
    assert reply.problems


async def test_two_relays_do_not_share_a_state_folder(bench: Bench, tmp_path: Path) -> None:
    await started(bench, tmp_path)
    with pytest.raises(StartError, match=r"gateway\.state: .* belongs to a gateway that runs"):
        await started(bench, tmp_path)
