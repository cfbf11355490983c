"""Tables are saved over each other while axes stream: no step, no loss, and an answer to every save.

Four axes, each with its own way of saving, get a setpoint every 2 ms; 10 times, in ``make soak`` 50 times, a
table with other values is saved over the one in force, and every fifth is bad.
"""

import asyncio
import hashlib
import math
import threading
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from gateway.ipc.address import socket_path
from gateway.ipc.client import ask
from gateway.ipc.messages import GetStatus, Status
from gateway.modbus.mbap import encode_mbap
from tests.processes.saving import in_place, old_moved_away, renamed_over, symlink_swapped
from tests.soak import IS_FULL
from tests.support.config import axis, gateway_toml, line, tab, written
from tests.support.ports import free_port
from tests.support.processes import SECONDS, Running, running

SAVES = 50 if IS_FULL else 10
BAD_EVERY = 5
PERIOD_S = 0.002
COUNTS_PER_MM = 1000
STEP_COUNTS = 100
"""0.1 mm in 2 ms: 50 mm/s."""
LOW_COUNTS, MIDDLE_COUNTS, HIGH_COUNTS = 10_000, 50_000, 90_000
RELOAD_MM, REVERSAL_MM, BACKLASH_MM = 4.0, 2.0, 0.01
AMPLITUDES_MM = [0.02 + 0.01 * (number % 8) for number in range(SAVES)]
AXES: dict[str, Callable[[Path, str], None]] = {
    "a": in_place,
    "b": renamed_over,
    "c": old_moved_away,
    "d": symlink_swapped,
}


def table(name: str, amplitude_mm: float) -> str:
    """Rise to the amplitude at 100 mm; the way back lies 10 µm lower."""
    rows = [round(amplitude_mm * x / 100, 4) for x in range(0, 101, 25)]
    return tab(*((c, round(c - BACKLASH_MM, 4)) for c in rows), name=name.upper(), interval=25.0)


def most_off_counts() -> float:
    """Return how far a step of the drive may be from the step of the controller (DESIGN section 7).

    The slope of a table, of a change-over and of a reversal, each blended with sin², and rounding.
    """
    slope = max(AMPLITUDES_MM) / 100
    change = math.pi / 2 * (max(AMPLITUDES_MM) - min(AMPLITUDES_MM)) / RELOAD_MM
    reversal = math.pi / 2 * BACKLASH_MM / REVERSAL_MM
    return (slope + change + reversal) * STEP_COUNTS + 1.0


@dataclass
class Drives:
    """Acknowledges FC16 for every unit; keeps what each was told, in counts."""

    told: dict[int, list[int]] = field(default_factory=dict)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while True:
                head = await reader.readexactly(6)
                body = await reader.readexactly(int.from_bytes(head[4:6], "big"))
                self.told.setdefault(body[0], []).append(int.from_bytes(body[7:11], "big", signed=True))
                writer.write(head[:4] + bytes((0, 6)) + body[:6])
        except asyncio.IncompleteReadError:
            writer.close()


async def stream(port: int, until: threading.Event, passed: threading.Event) -> dict[int, list[int]]:
    """Send each axis a setpoint every 2 ms; returns what was acknowledged. ``passed``: the middle was."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    sent: dict[int, list[int]] = {unit_id: [] for unit_id in range(1, len(AXES) + 1)}
    loop = asyncio.get_running_loop()
    counts, way, number, due_s = LOW_COUNTS, STEP_COUNTS, 0, loop.time()
    while not until.is_set():
        for unit_id, acknowledged in sent.items():
            number = number % 60_000 + 1
            pdu = bytes.fromhex("10 0064 0002 04") + counts.to_bytes(4, "big")
            writer.write(encode_mbap(number, unit_id, pdu))
            expected = encode_mbap(number, unit_id, bytes.fromhex("10 0064 0002"))
            assert await reader.readexactly(len(expected)) == expected
            acknowledged.append(counts)
        if counts == MIDDLE_COUNTS:
            passed.set()
        if not LOW_COUNTS <= counts + way <= HIGH_COUNTS:
            way = -way
        counts += way
        due_s = max(due_s + PERIOD_S, loop.time())
        await asyncio.sleep(due_s - loop.time())
    writer.close()
    return sent


def wait_for(passed: threading.Event) -> None:
    """Wait until the axes pass the middle."""
    passed.clear()
    assert passed.wait(SECONDS)


def save_all(gateway: Running, tables: Path, passed: threading.Event) -> dict[str, list[str]]:
    """Save the tables of each axis and read what the gateway says of each; returns the answers by axis.

    The axes pass the middle on their first tables, and twice on their last: then nothing of another fades.
    """
    answers: dict[str, list[str]] = {axis: [] for axis in AXES}
    wait_for(passed)
    for number, amplitude_mm in enumerate(AMPLITUDES_MM):
        is_bad = number % BAD_EVERY == BAD_EVERY - 1
        for name, save in AXES.items():
            content = table(name, amplitude_mm)
            save(tables / f"{name}.tab", content.replace("ENTRIES 5", "ENTRIES 6") if is_bad else content)
        waiting = set(AXES)
        while waiting:
            note = gateway.next()
            if note["event"] in {"table-handed-over", "table-rejected"}:
                assert note["axis"] in waiting, note
                waiting.remove(note["axis"])
                answers[note["axis"]].append(note["event"])
                assert note["event"] == "table-handed-over" or note["line"], note
    wait_for(passed)
    wait_for(passed)
    return answers


@pytest.mark.timeout(300)
async def test_saves_of_each_kind_cost_the_drive_no_step_and_the_controller_no_exchange(
    tmp_path: Path,
) -> None:
    drives = Drives()
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(await asyncio.start_server(drives.serve, "127.0.0.1", 0))
        port = free_port()
        axes = [
            axis(
                name,
                unit_id=unit_id,
                compensation="on",
                setpoints="stream",
                max_speed=60.0,
                table=f"{name}.tab",
                reload={"distance": RELOAD_MM},
                reversal={"distance": REVERSAL_MM},
            )
            for unit_id, name in enumerate(AXES, start=1)
        ]
        text = gateway_toml(line(server.sockets[0].getsockname()[1], {"cnc": port}), *axes, name="stream")
        config = written(tmp_path, text, {f"{name}.tab": table(name, 0.1) for name in AXES})
        gateway = stack.enter_context(running("run", str(config)))
        await asyncio.to_thread(gateway.until, "relay-reached")
        saved, passed = threading.Event(), threading.Event()
        streaming = asyncio.create_task(stream(port, saved, passed))
        try:
            answers = await asyncio.to_thread(save_all, gateway, tmp_path / "tables", passed)
        finally:
            saved.set()
        sent = await streaming
        status = await asyncio.to_thread(ask, socket_path(tmp_path / "state"), GetStatus())
        assert isinstance(status, Status)
        assert await asyncio.to_thread(gateway.end) == 0
    for unit_id, name in enumerate(AXES, start=1):
        good, bad = "table-handed-over", "table-rejected"
        kinds = [bad if n % BAD_EVERY == BAD_EVERY - 1 else good for n in range(SAVES)]
        assert answers[name] == kinds
        nominal, told = sent[unit_id], drives.told[unit_id]
        assert len(told) == len(nominal)  # nothing lost, nothing doubled
        steps = zip(nominal, nominal[1:], told, told[1:], strict=False)
        worst = max(abs((b1 - b0) - (a1 - a0)) for a0, a1, b0, b1 in steps)
        assert worst <= most_off_counts()
        offsets = [drive - own for own, drive in zip(nominal, told, strict=False) if own == MIDDLE_COUNTS]
        # More than the two branches of one table: several came into force while it streamed.
        assert max(offsets) - min(offsets) > BACKLASH_MM * COUNTS_PER_MM + 2
        in_force = status.status.axes[name].table.sha256
        last_good = table(name, AMPLITUDES_MM[SAVES - 2])
        assert in_force == hashlib.sha256(last_good.encode()).hexdigest()
