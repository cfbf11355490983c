"""A relay that has a process of its own: scheduled as its file says, and quiet while exchanges run."""

import asyncio
import contextlib
import gc
import json
import os
import re
import sys
import weakref
from collections.abc import AsyncIterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gateway.clock import boot_ns
from gateway.ipc.client import ask
from gateway.ipc.messages import GetStatus, Ping, Pong, Status
from gateway.modbus.mbap import encode_mbap
from gateway.relay.collecting import BUSY_CHECK_S, CHECK_EVERY_S
from gateway.status.line import LatencySettings
from tests.support.ports import free_port
from tests.support.status_models import plain

if TYPE_CHECKING:
    from tests.relay.conftest import Bench, Tools

ROOT = Path(__file__).parents[2]
CPU = min(os.sched_getaffinity(0))
CONFIG = """
[gateway]
name = "trial"

[relay]
{relay}

[line.xyz]
drives = {{ tcp = "127.0.0.1:1" }}

[[line.xyz.controllers]]
name = "cnc"
tcp = "127.0.0.1:{port}"
"""
READ = bytes.fromhex("03 0010 0001")
REPLY = bytes.fromhex("03 02 0007")


class Ring:
    def __init__(self) -> None:
        self.me = self


@contextlib.asynccontextmanager
async def running(folder: Path, relay: str) -> AsyncIterator[tuple[int, dict[str, list[dict[str, Any]]]]]:
    """A gateway in a process of its own, with its log up to what it says of its scheduling."""
    port = free_port()
    config = folder / "gateway.toml"
    config.write_text(CONFIG.format(relay=relay, port=port))
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", "import typer; from gateway.cli.run import run; typer.run(run)", str(config)),
        stderr=asyncio.subprocess.PIPE,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert process.stderr is not None
    log: dict[str, list[dict[str, Any]]] = {}
    try:
        async with asyncio.timeout(20):
            while "scheduling" not in log:
                note = json.loads(await process.stderr.readline())
                log.setdefault(note["event"], []).append(note)
        pong = await asyncio.to_thread(ask, folder / "state" / "relay.sock", Ping())
        assert isinstance(pong, Pong)
        yield pong.pid, log  # run starts the relay as a process of its own
    finally:
        process.kill()
        await process.communicate()


def kernel_says(pid: int) -> dict[str, object]:
    policy = os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK
    found = re.search(r"VmLck:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())
    assert found is not None
    return {
        "fifo": os.sched_getparam(pid).sched_priority if policy == os.SCHED_FIFO else 0,
        "cpus": sorted(os.sched_getaffinity(pid)),
        "memory_locked": int(found[1]) > 0,
    }


async def test_log_and_status_say_what_the_kernel_says(tmp_path: Path) -> None:
    async with running(tmp_path, f"fifo = 50\ncpus = [{CPU}]\nlock_memory = true") as (pid, log):
        truth = kernel_says(pid)
        assert truth["cpus"] == [CPU]
        [note] = log["scheduling"]
        assert {key: note[key] for key in truth} == truth
        refused = {each["key"] for each in log.get("scheduling-refused", [])}
        assert refused == ({"relay.fifo"} if truth["fifo"] != 50 else set()) | (
            set() if truth["memory_locked"] else {"relay.lock_memory"}
        )
        status = await asyncio.to_thread(ask, tmp_path / "state" / "relay.sock", GetStatus())
        assert isinstance(status, Status)
        assert plain(status.status.gateway.scheduling) == truth
        assert sorted(plain(status.status.gateway.garbage)) == [
            "collected",
            "collections",
            "forced",
            "full",
            "longest_us",
        ]


async def test_what_is_refused_is_an_event_with_its_remedy_and_the_gateway_runs(tmp_path: Path) -> None:
    async with running(tmp_path, "cpus = [8191]") as (pid, log):
        assert "ready" in log
        [note] = log["scheduling-refused"]
        assert (note["key"], note["asked"], note["level"]) == ("relay.cpus", [8191], "warning")
        assert note["detail"] == "no CPU 8191 for this process"
        assert "AllowedCPUs=" in note["remedy"]
        assert log["scheduling"][0]["cpus"] == sorted(os.sched_getaffinity(pid)) != [8191]


async def test_garbage_is_not_looked_for_while_an_exchange_is_on_the_wire(
    bench: "Bench", tools: "Tools"
) -> None:
    silent, where = await bench.drive("tcp")
    link, _ = bench.controller_link("tcp")
    relay = await bench.relay(where, (link,))
    await tools.until_up(relay)
    relay.take_process()
    assert not gc.isenabled()
    near = await bench.connect(relay.address("line", "cnc"))
    near.write(encode_mbap(3, 1, READ))
    await silent.until(lambda end: bool(end.data))
    for _ in range(1000):
        last = Ring()
    seen = weakref.ref(last)
    del last
    later_ns = boot_ns() + 3_000_000_000
    assert relay._collecting.check(later_ns) == BUSY_CHECK_S
    assert seen() is not None
    transaction = silent.data[:2]
    silent.write(transaction + bytes.fromhex("0000 0005 01") + REPLY)
    await near.receives(encode_mbap(3, 1, REPLY))
    assert relay._collecting.check(later_ns) == CHECK_EVERY_S
    assert seen() is None
    await relay.stop()
    assert gc.isenabled()


async def test_a_relay_without_wishes_says_nothing_of_scheduling(bench: "Bench", tools: "Tools") -> None:
    _, where = await bench.drive("tcp")
    link, _ = bench.controller_link("tcp")
    relay = await bench.relay(where, (link,))
    relay.take_process()
    assert not [note for note in bench.notes if note.event.startswith("scheduling")]
    assert plain(relay.status().gateway.scheduling) == kernel_says(os.getpid())


async def test_the_port_of_a_controller_shows_its_latency_settings(bench: "Bench") -> None:
    _, where = await bench.drive("tcp")
    link, _ = bench.controller_link("rtu")
    relay = await bench.relay(where, (link,))
    [controller] = relay.status().lines["line"].controllers
    assert controller.latency == LatencySettings()


async def test_the_port_of_the_drives_shows_its_latency_settings(bench: "Bench") -> None:
    link, _ = bench.controller_link("tcp")
    for kind, shown in (("rtu", LatencySettings()), ("tcp", None)):
        _, where = await bench.drive(kind)
        line = (await bench.relay(where, (link,))).status().lines["line"]
        assert line.drives.latency == shown
