"""A relay that has a process of its own: scheduled as its file says, and quiet while exchanges run."""

import asyncio
import contextlib
import gc
import os
import re
import weakref
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from gateway.clock import boot_ns
from gateway.ipc.client import ask
from gateway.ipc.messages import GetStatus, Ping, Pong, Status
from gateway.modbus.mbap import encode_mbap
from gateway.relay.collecting import BUSY_CHECK_S, CHECK_EVERY_S
from gateway.status.line import LatencySettings
from tests.support.config import gateway_toml, line, section, written
from tests.support.ports import free_port
from tests.support.processes import running
from tests.support.relay import Bench, until_up
from tests.support.status_models import plain

CPU = min(os.sched_getaffinity(0))
READ = bytes.fromhex("03 0010 0001")
REPLY = bytes.fromhex("03 02 0007")


class Ring:
    def __init__(self) -> None:
        self.me = self


@contextlib.asynccontextmanager
async def relay_of(folder: Path, wishes: dict[str, Any]) -> AsyncIterator[tuple[int, list[dict[str, Any]]]]:
    """A gateway whose relay wishes this, with its log up to what it says of its scheduling."""
    text = gateway_toml(section("[relay]", wishes), line(1, {"cnc": free_port()}))
    with running("run", str(written(folder, text, {}))) as program:
        await asyncio.to_thread(program.until, "scheduling")
        pong = await asyncio.to_thread(ask, folder / "state" / "relay.sock", Ping())
        assert isinstance(pong, Pong)
        yield pong.pid, program.notes  # run starts the relay as a process of its own


def of(event: str, notes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [note for note in notes if note["event"] == event]


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
    async with relay_of(tmp_path, {"fifo": 50, "cpus": [CPU], "lock_memory": True}) as (pid, notes):
        truth = kernel_says(pid)
        assert truth["cpus"] == [CPU]
        [note] = of("scheduling", notes)
        assert {key: note[key] for key in truth} == truth
        refused = {each["key"] for each in of("scheduling-refused", notes)}
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
    async with relay_of(tmp_path, {"cpus": [8191]}) as (pid, notes):
        assert of("ready", notes)
        [note] = of("scheduling-refused", notes)
        assert (note["key"], note["asked"], note["level"]) == ("relay.cpus", [8191], "warning")
        assert note["detail"] == "no CPU 8191 for this process"
        assert "AllowedCPUs=" in note["remedy"]
        assert of("scheduling", notes)[0]["cpus"] == sorted(os.sched_getaffinity(pid)) != [8191]


async def test_garbage_is_not_looked_for_while_an_exchange_is_on_the_wire(bench: Bench) -> None:
    silent, where = await bench.drive("tcp")
    link, _ = bench.controller_link("tcp")
    relay = await bench.relay(where, (link,))
    await until_up(relay)
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


async def test_a_relay_without_wishes_says_nothing_of_scheduling(bench: Bench) -> None:
    _, where = await bench.drive("tcp")
    link, _ = bench.controller_link("tcp")
    relay = await bench.relay(where, (link,))
    relay.take_process()
    assert not [note for note in bench.notes if note.event.startswith("scheduling")]
    assert plain(relay.status().gateway.scheduling) == kernel_says(os.getpid())


async def test_the_port_of_a_controller_shows_its_latency_settings(bench: Bench) -> None:
    _, where = await bench.drive("tcp")
    link, _ = bench.controller_link("rtu")
    relay = await bench.relay(where, (link,))
    [controller] = relay.status().lines["line"].controllers
    assert controller.latency == LatencySettings()


async def test_the_port_of_the_drives_shows_its_latency_settings(bench: Bench) -> None:
    link, _ = bench.controller_link("tcp")
    for kind, shown in (("rtu", LatencySettings()), ("tcp", None)):
        _, where = await bench.drive(kind)
        line = (await bench.relay(where, (link,))).status().lines["line"]
        assert line.drives.latency == shown
