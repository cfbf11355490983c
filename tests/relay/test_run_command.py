"""``pitch-gateway run``: what it says, how it stops, with which code it ends."""

import asyncio
import json
import signal
import socket
from pathlib import Path
from typing import Any

import pytest

from gateway.modbus.mbap import encode_mbap
from tests.support.config import axis, gateway_toml, line, registers, written
from tests.support.ports import free_port
from tests.support.processes import SECONDS, Running, running, typed_apart
from tests.support.relay import Bench


def configured(folder: Path, drives: int, port: int, **keys: Any) -> Path:
    """Write the configuration of an axis in shadow mode without a table; ``keys`` of its line."""
    x = axis(
        registers=registers(command=0x0606, actual=0x0520),
        travel=[-300.0, 0.0],
        compensation="shadow",
        setpoints="targets",
    )
    return written(folder, gateway_toml(line(drives, {"cnc": port}, **keys), x), {})


async def event(program: Running, name: str) -> dict[str, Any]:
    """Read the log up to an event."""
    return await asyncio.to_thread(program.until, name)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_it_is_ready_serves_and_stops(bench: Bench, tmp_path: Path, number: signal.Signals) -> None:
    reply = bytes.fromhex("03 02 0007")
    _, where = await bench.drive(
        "tcp", lambda data: data[:4] + bytes([0, len(reply) + 1]) + data[6:7] + reply
    )
    port = free_port()
    config = configured(tmp_path, getattr(where, "port", 0), port)
    with running("run", str(config), "--status-every", "0.05") as program:
        shadow = await event(program, "shadow")
        assert (shadow["line"], shadow["axis"]) == ("xyz", "x")
        assert "unchanged" in shadow["detail"]
        ready = await event(program, "ready")
        assert ready["addresses"] == {"xyz/cnc": [f"127.0.0.1:{port}"]}
        await event(program, "line-up")
        near = await bench.connect(type(where)("127.0.0.1", port))  # type: ignore[arg-type]
        near.write(encode_mbap(3, 1, bytes.fromhex("03 0010 0001")))
        await near.receives(encode_mbap(3, 1, reply))
        status = await event(program, "status")
        assert (status["line"], status["axis"]) == ("xyz", "x")
        assert status["compensation"] == "no-table"
        program.process.send_signal(number)
        await event(program, "stopped")
        assert await asyncio.to_thread(program.process.wait, SECONDS) == 0


async def test_a_second_signal_ends_and_says_what_was_not_finished(bench: Bench, tmp_path: Path) -> None:
    silent, where = await bench.drive("tcp")
    port = free_port()
    config = configured(tmp_path, getattr(where, "port", 0), port, response_timeout_ms=3600000)
    with running("run", str(config)) as program:
        await event(program, "line-up")
        near = await bench.connect(type(where)("127.0.0.1", port))  # type: ignore[arg-type]
        near.write(encode_mbap(3, 1, bytes.fromhex("03 0010 0001")))
        await silent.until(lambda end: bool(end.data))
        program.process.send_signal(signal.SIGTERM)
        stopping = await event(program, "stopping")
        # The time-out of the drives, 3600 s, and a second.
        assert stopping["detail"] == (
            "waits up to 3601 s for the exchange on xyz to end; a second signal ends it immediately"
        )
        program.process.send_signal(signal.SIGINT)
        ended = await event(program, "stopped-at-once")
        assert ended["lines"] == ["xyz"]
        assert "an exchange was not finished" in ended["detail"]
        assert await asyncio.to_thread(program.process.wait, SECONDS) == 1
        assert await asyncio.to_thread(program.rest) == []


async def test_the_log_is_in_order_and_status_lines_count_everything(bench: Bench, tmp_path: Path) -> None:
    reply = bytes.fromhex("83 02")
    _, where = await bench.drive(
        "tcp", lambda data: data[:4] + bytes([0, len(reply) + 1]) + data[6:7] + reply
    )
    port = free_port()
    config = configured(tmp_path, getattr(where, "port", 0), port)
    notes: list[dict[str, Any]] = []
    with running("run", str(config), "--status-every", "0.05") as program:
        await event(program, "line-up")
        near = await bench.connect(type(where)("127.0.0.1", port))  # type: ignore[arg-type]
        near.write(encode_mbap(3, 1, bytes.fromhex("03 0010 0001")))
        await near.receives(encode_mbap(3, 1, reply))
        near.write(b"no Modbus at all")
        while not any(note.get("controllers", {}).get("cnc", {}).get("malformed") for note in notes):
            notes.append(await event(program, "status"))
        program.process.send_signal(signal.SIGTERM)
        notes += await asyncio.to_thread(program.rest)
    notes = [note for note in notes if note.get("process") != "supervisor"]  # it writes when it likes
    [*_, line] = [note for note in notes if note["event"] == "status" and note.get("line") == "xyz"]
    counters = ("exchanges", "timeouts", "exceptions", "late", "refused", "withdrawn")
    assert [line[name] for name in counters] == [1, 0, 1, 0, 0, 0]
    assert (line["state"], line["crc_errors"], line["malformed"]) == ("up", 0, 0)
    assert line["controllers"]["cnc"]["malformed"] == 1
    times = [note["timestamp"] for note in notes]
    assert times == sorted(times)
    assert [note["event"] for note in notes[-2:]] == ["stopping", "stopped"]
    assert notes[-2]["detail"] == "no exchange is on a wire; a second signal ends it immediately"


def test_a_port_in_use_is_one_line_with_its_key_and_code_1(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        done = typed_apart("run", str(configured(tmp_path, 1, port)))
    notes = map(json.loads, done.stderr.splitlines())
    [said] = [note["detail"] for note in notes if note["event"] == "standard-error"]
    assert f"line.xyz.controllers[1].tcp (cnc): 127.0.0.1:{port} is in use" in said
    assert done.returncode == 1


def test_a_bad_configuration_ends_with_code_1_and_no_traceback(tmp_path: Path) -> None:
    config = configured(tmp_path, 1, 1502)
    config.write_text(config.read_text() + "what_is_this = 1\n")
    done = typed_apart("run", str(config))
    assert "what_is_this" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.returncode == 1
