"""``pitch-gateway run``: what it says, how it stops, with which code it ends."""

import asyncio
import contextlib
import json
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from gateway.modbus.mbap import encode_mbap
from tests.support.ports import free_port

if TYPE_CHECKING:
    from tests.relay.conftest import Bench

ROOT = Path(__file__).parents[2]
CONFIG = """
[gateway]
name = "trial"

[line.xyz]
drives = {{ tcp = "127.0.0.1:{drives}" }}

[[line.xyz.controllers]]
name = "cnc"
tcp = "127.0.0.1:{port}"

[axis.x]
line = "xyz"
unit_id = 1
units = "mm"
counts_per_unit = 1000.0
travel = [-300.0, 0.0]
referenced = "absolute"
compensation = "shadow"
setpoints = "targets"

[axis.x.registers]
command = [{{ address = 0x0606, type = "int32" }}]
actual = [{{ address = 0x0520, type = "int32" }}]
"""


@contextlib.asynccontextmanager
async def running(config: Path, *options: str) -> AsyncIterator[asyncio.subprocess.Process]:
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        "import typer; from gateway.cli.run import run; typer.run(run)",
        str(config),
        *options,
        stderr=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    yield process
    with contextlib.suppress(ProcessLookupError):
        process.kill()
    await process.communicate()


async def event(process: asyncio.subprocess.Process, name: str) -> dict[str, Any]:
    """Read the log up to an event."""
    assert process.stderr is not None
    async with asyncio.timeout(20):
        while line := await process.stderr.readline():
            note: dict[str, Any] = json.loads(line)
            if note["event"] == name:
                return note
    raise AssertionError(f"the log ended without {name}")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_it_says_ready_serves_and_stops_cleanly(
    bench: "Bench", tmp_path: Path, number: signal.Signals
) -> None:
    reply = bytes.fromhex("03 02 0007")
    _, where = await bench.drive(
        "tcp", lambda data: data[:4] + bytes([0, len(reply) + 1]) + data[6:7] + reply
    )
    config = tmp_path / "gateway.toml"
    port = free_port()
    config.write_text(CONFIG.format(drives=getattr(where, "port", 0), port=port))
    async with running(config, "--status-every", "0.05") as process:
        shadow = await event(process, "shadow")
        assert (shadow["line"], shadow["axis"]) == ("xyz", "x")
        assert "unchanged" in shadow["detail"]
        ready = await event(process, "ready")
        assert ready["addresses"] == {"xyz/cnc": [f"127.0.0.1:{port}"]}
        await event(process, "line-up")
        near = await bench.connect(type(where)("127.0.0.1", port))  # type: ignore[arg-type]
        near.write(encode_mbap(3, 1, bytes.fromhex("03 0010 0001")))
        await near.receives(encode_mbap(3, 1, reply))
        status = await event(process, "status")
        assert (status["line"], status["axis"]) == ("xyz", "x")
        assert status["compensation"] == "no-table"
        process.send_signal(number)
        await event(process, "stopped")
        async with asyncio.timeout(30):
            assert await process.wait() == 0


async def test_a_second_signal_ends_at_once_and_says_what_was_not_finished(
    bench: "Bench", tmp_path: Path
) -> None:
    silent, where = await bench.drive("tcp")
    config = tmp_path / "gateway.toml"
    port = free_port()
    text = CONFIG.format(drives=getattr(where, "port", 0), port=port)
    config.write_text(text.replace("[line.xyz]", "[line.xyz]\nresponse_timeout_ms = 3600000"))
    async with running(config) as process:
        await event(process, "line-up")
        near = await bench.connect(type(where)("127.0.0.1", port))  # type: ignore[arg-type]
        near.write(encode_mbap(3, 1, bytes.fromhex("03 0010 0001")))
        await silent.until(lambda end: bool(end.data))
        process.send_signal(signal.SIGTERM)
        stopping = await event(process, "stopping")
        # The time-out of the drives, 3600 s, and a second.
        assert stopping["detail"] == (
            "waits up to 3601 s for the exchange on xyz to end; a second signal ends at once"
        )
        process.send_signal(signal.SIGINT)
        ended = await event(process, "stopped-at-once")
        assert ended["lines"] == ["xyz"]
        assert "an exchange was not finished" in ended["detail"]
        async with asyncio.timeout(30):
            assert await process.wait() == 1
        assert process.stderr is not None
        assert await process.stderr.read() == b""


async def test_the_log_is_in_the_order_of_its_times_and_status_lines_count_everything(
    bench: "Bench", tmp_path: Path
) -> None:
    reply = bytes.fromhex("83 02")
    _, where = await bench.drive(
        "tcp", lambda data: data[:4] + bytes([0, len(reply) + 1]) + data[6:7] + reply
    )
    config = tmp_path / "gateway.toml"
    port = free_port()
    config.write_text(CONFIG.format(drives=getattr(where, "port", 0), port=port))
    notes: list[dict[str, Any]] = []
    async with running(config, "--status-every", "0.05") as process:
        await event(process, "line-up")
        near = await bench.connect(type(where)("127.0.0.1", port))  # type: ignore[arg-type]
        near.write(encode_mbap(3, 1, bytes.fromhex("03 0010 0001")))
        await near.receives(encode_mbap(3, 1, reply))
        near.write(b"no Modbus at all")
        while not any(note.get("controllers", {}).get("cnc", {}).get("malformed") for note in notes):
            notes.append(await event(process, "status"))
        process.send_signal(signal.SIGTERM)
        assert process.stderr is not None
        async with asyncio.timeout(30):
            notes += [json.loads(line) async for line in process.stderr]
    notes = [note for note in notes if note.get("process") != "supervisor"]  # it writes when it likes
    [*_, line] = [note for note in notes if note["event"] == "status" and note.get("line") == "xyz"]
    counters = ("exchanges", "timeouts", "exceptions", "late", "refused", "withdrawn")
    assert [line[name] for name in counters] == [1, 0, 1, 0, 0, 0]
    assert (line["state"], line["crc_errors"], line["malformed"]) == ("up", 0, 0)
    assert line["controllers"]["cnc"]["malformed"] == 1
    times = [note["timestamp"] for note in notes]
    assert times == sorted(times)
    assert [note["event"] for note in notes[-2:]] == ["stopping", "stopped"]
    assert notes[-2]["detail"] == "no exchange is on a wire; a second signal ends at once"


async def test_a_port_in_use_is_one_line_with_its_key_and_code_1(tmp_path: Path) -> None:
    config = tmp_path / "gateway.toml"
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        config.write_text(CONFIG.format(drives=1, port=port))
        async with running(config) as process:
            _, errors = await process.communicate()
    notes = map(json.loads, errors.decode().splitlines())
    [said] = [note["detail"] for note in notes if note["event"] == "standard-error"]
    assert f"line.xyz.controllers[1].tcp (cnc): 127.0.0.1:{port} is in use" in said
    assert process.returncode == 1


async def test_a_bad_configuration_ends_with_code_1_and_no_traceback(tmp_path: Path) -> None:
    config = tmp_path / "gateway.toml"
    config.write_text(CONFIG.format(drives=1, port=1502) + "\nwhat_is_this = 1\n")
    async with running(config) as process:
        _, errors = await process.communicate()
    assert b"what_is_this" in errors
    assert b"Traceback" not in errors
    assert process.returncode == 1
