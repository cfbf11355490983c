"""SIGKILL of the relay at random instants of a stream: how far off is what the drive is told afterwards.

``make soak`` kills a thousand times.
"""

import contextlib
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from gateway.compensation.settings import Reversal, ReversalKind
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.commands import SetReference
from gateway.ipc.client import ask
from gateway.modbus.mbap import encode_mbap
from tests.exchange.line_bench import stream_plan, write
from tests.exchange.test_kills_in_a_stream import Follower, Line, setpoints
from tests.relay.test_kill_and_restart import ACTUAL, COMMAND, Drive
from tests.soak import IS_FULL
from tests.support.commands import typed
from tests.support.config import Keys, axis, gateway_toml, line, registers, tab, written
from tests.support.ports import free_port
from tests.support.processes import COMMAND as COMMAND_LINE
from tests.support.processes import ROOT, SECONDS, started

HOMED = 120
KILLS = 125 if IS_FULL else 3
REVERSAL = Reversal(ReversalKind.DISTANCE, 1.0)
HOMED_BIT: Keys = {"bits.homed": {"address": HOMED, "bit": 0}}
TOLD_BY: dict[str, Keys] = {
    "absolute": {},
    "drive-bit": HOMED_BIT,
    "homing": {**HOMED_BIT, "trigger": [{"address": 130, "home": [4], "stop": [8]}]},
    "set-position": {"actual": [{"address": 110, "type": "int32", "set_position": True}]},
}
"""Registers by what an axis is referenced by."""


class RunningDrive(Drive):
    """A drive that goes on moving while nobody talks to it."""

    def __init__(self, counts_per_ms: float | None) -> None:
        self.writes: list[bytes] = []
        self._place, self._at_s = 50_000.0, time.monotonic()
        self._counts_per_ms = counts_per_ms
        super().__init__()
        self.memory.words[HOMED] = 1
        self.memory.put(COMMAND, 50_000)

    def _move(self) -> None:
        now_s = time.monotonic()
        way = self.memory.get(COMMAND) - self._place
        elapsed_ms = (now_s - self._at_s) * 1000.0
        most = abs(way) if self._counts_per_ms is None else self._counts_per_ms * elapsed_ms
        self._place += max(-most, min(most, way))
        self._at_s = now_s
        self.memory.put(ACTUAL, round(self._place))

    def _answer(self, connection: socket.socket) -> None:
        while head := connection.recv(7, socket.MSG_WAITALL):
            pdu = connection.recv(int.from_bytes(head[4:6], "big") - 1, socket.MSG_WAITALL)
            self._move()
            reply = self.memory.answer(pdu)
            if pdu[0] in (6, 16):
                self.writes.append(pdu)
            if pdu[0] == 16:
                self.told.append(self.memory.get(COMMAND))
            connection.sendall(encode_mbap(int.from_bytes(head[:2], "big"), head[6], reply))


class Machine:
    """A relay between a controller and that drive."""

    def __init__(self, folder: Path, drive: RunningDrive, referenced: str) -> None:
        self.port, self.drive, self.log = free_port(), drive, folder / "log"
        x = axis(
            registers={**registers(command=100, actual=110), **TOLD_BY[referenced]},
            referenced=referenced,
            compensation="on",
            table="x.tab",
            setpoints="stream",
            home_approach="forward",
            reload={"distance": 1.0},
            reversal={"distance": 1.0},
            max_speed=200.0,
            hysteresis=0.002,
        )
        text = gateway_toml(line(drive.port, {"cnc": self.port}), x)
        self.config = written(folder, text, {"x.tab": tab((0.06, -0.06), (0.06, -0.06), interval=100.0)})
        assert typed("check", "--compile", str(self.config)).returncode == 0
        self.must_be_told = referenced in ("homing", "set-position")
        self.process: subprocess.Popen[Any] | None = None
        self._stack = contextlib.ExitStack()
        self.connection: socket.socket | None = None

    def run(self) -> None:
        log = self._stack.enter_context(self.log.open("a"))
        process = started([*COMMAND_LINE, "relay", str(self.config)], stderr=log, cwd=ROOT)
        self.process = self._stack.enter_context(process)
        until_s = time.monotonic() + SECONDS
        while True:
            try:
                self.connection = socket.create_connection(("127.0.0.1", self.port), timeout=SECONDS)
                break
            except OSError:
                assert time.monotonic() < until_s
                time.sleep(0.01)  # until its port is open

    def refer(self) -> None:
        """Say that the axis stands where its drive says, where nothing else does."""
        if self.must_be_told:
            ask(self.config.parent / "state" / "relay.sock", SetReference(axis="x"))

    def kill(self) -> None:
        assert self.process is not None
        self.process.send_signal(signal.SIGKILL)

    def end(self) -> None:
        assert self.process is not None
        assert self.connection is not None
        self.connection.close()
        self.process.wait(SECONDS)
        self._stack.close()

    def follow(self, counts: int) -> bool:
        """Feed a setpoint, again as long as there is no way to the drive; whether it was acknowledged."""
        assert self.connection is not None
        request = write(COMMAND, counts)
        with contextlib.suppress(ConnectionError):
            while True:
                self.connection.sendall(encode_mbap(7, 1, request))
                head = self.connection.recv(7, socket.MSG_WAITALL)
                reply = head and self.connection.recv(head[5] - 1, socket.MSG_WAITALL)
                if reply != b"\x90\x0a":
                    return reply == request[:5]
                time.sleep(0.002)
        return False


@contextlib.contextmanager
def machine(folder: Path, counts_per_ms: float | None, referenced: str) -> Iterator[Machine]:
    drive = RunningDrive(counts_per_ms)
    each = Machine(folder, drive, referenced)
    try:
        each.run()
        yield each
    finally:
        each.kill()
        each.end()
        drive.close()


class Twin:
    """What the drive is told where nobody is killed, worked out as far as it is asked for."""

    def __init__(self, walk: list[int]) -> None:
        table = make_table([0, 100], [0.06, 0.06], [-0.06, -0.06], Units.MM)
        plan = stream_plan(table=table, home_approach=1, reload_distance=1.0, reversal=REVERSAL)
        self._line = Line(plan, Follower(None, 50_000))
        self._walk = walk
        self._told: list[float] = []

    def told(self, number: int) -> float:
        while len(self._told) <= number:
            self._told.append(self._line.follow(self._walk[len(self._told)]))
        return self._told[number]

    def step(self, number: int) -> float:
        """The largest step of a blend so far."""
        self.told(number - 1)
        ways = zip(pairwise(self._told), pairwise(self._walk), strict=False)
        return max(abs(b - a - (q - p)) for (a, b), (p, q) in ways)


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("referenced", ["absolute", "drive-bit", "homing", "set-position"])
@pytest.mark.parametrize("counts_per_ms", [None, 30.0], ids=["at once", "30 mm/s"])
def test_a_kill_at_any_instant(
    tmp_path: Path,
    counts_per_ms: float | None,
    referenced: str,
    record_property: Callable[[str, object], None],
) -> None:
    rng = random.Random(f"{counts_per_ms} {referenced}")
    walk = setpoints(rng.randrange(1 << 30), 2000 * KILLS + 400)  # a busy machine kills late
    twin = Twin(walk)
    step = twin.step(400 * KILLS)
    worst, number, acknowledged = 0.0, 0, 0
    with machine(tmp_path, counts_per_ms, referenced) as each:
        each.refer()
        for kill in range(KILLS + 1):
            for _ in range(60):  # a blend that was cut is over by then
                assert each.follow(walk[number])
                time.sleep(0.001)
                number += 1
            acknowledged = len(each.drive.told)
            if kill == KILLS:
                break
            timer = threading.Timer(rng.uniform(0.0, 0.03), each.kill)
            timer.start()
            while each.follow(walk[number]):
                number += 1
                acknowledged += 1
            timer.join()
            each.end()
            has_left = len(each.drive.told) - acknowledged  # one that was not acknowledged any more
            last, told = walk[number - 1 + has_left], each.drive.told[-1]
            time.sleep(rng.choice([0.0, 0.05]))
            each.run()
            errors = []
            for _ in range(5):
                assert each.follow(walk[number])
                errors.append(abs(each.drive.told[-1] - told - (walk[number] - last)))
                # Where the reference is gone the offset stays and fades, elsewhere all goes on as before.
                errors.append(0.0 if each.must_be_told else abs(each.drive.told[-1] - twin.told(number)))
                last, told = walk[number], each.drive.told[-1]
                number += 1
            worst = max(worst, *errors)
            assert max(errors) <= step + 1, (kill, errors)
            each.refer()
    what = f"{KILLS} kills, {referenced}, {counts_per_ms} counts/ms"
    record_property(what, f"worst {worst / 1000:.4f} mm; a step of the blend {step / 1000:.4f} mm")
    sys.stderr.write(f"{what}: worst {worst / 1000:.4f} mm; a step of the blend {step / 1000:.4f} mm\n")
