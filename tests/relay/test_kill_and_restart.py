"""SIGKILL in the middle of a move, of a blend and of a reversal: the gateway goes on without a step."""

import contextlib
import shutil
import signal
import socket
import threading
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.registers import PositionField, RegisterType
from tests.exchange.line_bench import Memory, read, write
from tests.support.commands import typed
from tests.support.config import Keys, axis, gateway_toml, line, registers, tab, written
from tests.support.ports import free_port
from tests.support.processes import SECONDS, Running, running

COMMAND = PositionField(100, RegisterType.INT32)
ACTUAL = PositionField(110, RegisterType.INT32)
STREAM: Keys = {"setpoints": "stream", "reload": {"distance": 1.0}, "reversal": {"distance": 1.0}}


class Drive:
    """A drive on TCP that is plain memory; where it follows, it is at a setpoint as soon as it is told."""

    def __init__(self) -> None:
        self.memory = Memory()
        self.told: list[float] = []
        self.follows = True
        self.takes_next: bool | None = None
        """Of a write that is not answered any more: whether the drive still takes it."""
        self.is_cut_off = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(SECONDS)

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._listener.accept()
                with connection, contextlib.suppress(OSError):
                    self._answer(connection)

    def _answer(self, connection: socket.socket) -> None:
        while head := connection.recv(7, socket.MSG_WAITALL):
            pdu = connection.recv(int.from_bytes(head[4:6], "big") - 1, socket.MSG_WAITALL)
            is_write = pdu[0] == 16
            if is_write and self.takes_next is False:
                self.is_cut_off.set()
                continue
            reply = self.memory.answer(pdu)
            if is_write:
                self.told.append(self.memory.get(COMMAND))
                if self.follows:
                    self.memory.put(ACTUAL, self.memory.get(COMMAND))
                if self.takes_next:
                    self.is_cut_off.set()
                    continue
            connection.sendall(encode_mbap(int.from_bytes(head[:2], "big"), head[6], reply))


class Machine:
    """A configuration with its drive, and the gateway between it and a controller, killed and run again."""

    def __init__(self, folder: Path, drive: Drive) -> None:
        self.folder = folder
        self.drive = drive
        self.readings: list[float] = []
        self._port: int = free_port()
        self._stack = contextlib.ExitStack()
        self._program: Running | None = None
        self._connection: socket.socket | None = None
        self.configure()

    def configure(self, name: str = "x", middle_mm: float = 0.05, **keys: Any) -> None:
        """Write the configuration; ``middle_mm`` is what the table adds at 50 mm on the way forward."""
        one = axis(
            name,
            registers(command=100, actual=110),
            compensation="on",
            table=f"{name}.tab",
            max_speed=200.0,
            **{"setpoints": "targets", **keys},
        )
        table = tab((0.0, -0.02), (middle_mm, 0.03), (0.1, 0.08), name=name.upper())
        text = gateway_toml(line(self.drive.port, {"cnc": self._port}), one)
        written(self.folder, text, {f"{name}.tab": table})

    def run(self) -> None:
        config = str(self.folder / "gateway.toml")
        assert typed("check", "--compile", config).returncode == 0
        self._program = self._stack.enter_context(running("relay", config))
        self._program.until("line-up")
        self._connection = socket.create_connection(("127.0.0.1", self._port), timeout=SECONDS)

    def kill(self) -> None:
        assert self._program is not None
        assert self._connection is not None
        self._program.process.kill()
        assert self._program.process.wait(SECONDS) == -signal.SIGKILL
        self._connection.close()

    def close(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._stack.close()

    def note(self, *events: str) -> dict[str, Any]:
        """Return one of these events of this run, waiting for it if need be."""
        assert self._program is not None
        while True:
            for note in self._program.notes:
                if note["event"] in events:
                    return note
            self._program.next()

    def ask(self, pdu: bytes) -> bytes:
        connection = self._connection
        assert connection is not None
        connection.sendall(encode_mbap(7, 1, pdu))
        head = connection.recv(7, socket.MSG_WAITALL)
        return connection.recv(int.from_bytes(head[4:6], "big") - 1, socket.MSG_WAITALL)

    def command(self, counts: int) -> None:
        assert self.ask(write(COMMAND, counts)) == write(COMMAND, counts)[:5]

    def actual(self) -> float:
        self.readings.append(ACTUAL.unpack(self.ask(read(ACTUAL))[2:]))
        return self.readings[-1]

    def kill_during(self, counts: int, *, is_taken: bool) -> None:
        """Command a setpoint and kill the gateway before its drive has answered."""
        assert self._connection is not None
        self.drive.takes_next = is_taken
        self._connection.sendall(encode_mbap(7, 1, write(COMMAND, counts)))
        assert self.drive.is_cut_off.wait(SECONDS)
        self.kill()
        self.drive.takes_next = None
        self.drive.is_cut_off.clear()


@contextlib.contextmanager
def machine(folder: Path) -> Iterator[Machine]:
    drive = Drive()
    folder.mkdir()
    machine = Machine(folder, drive)
    try:
        yield machine
    finally:
        machine.close()
        drive.close()


SETPOINTS = [*range(20_000, 22_000, 100), *range(22_000, 20_500, -100), *range(20_500, 20_900, 100)]
"""A change-over from the first on, over 1 mm; reversals at 22 mm and, before that one has ended, at 20.5."""
IN_THE_BLEND, IN_THE_REVERSAL, IN_THE_SECOND = 5, 24, 37


def stream(folder: Path, kills: dict[int, bool | None]) -> tuple[list[float], list[float]]:
    """Feed all setpoints; kill before some (None), or with one on the wire: taken by the drive or not."""
    with machine(folder) as each:
        each.configure(**STREAM)
        each.drive.memory.put(ACTUAL, 20_000)
        each.run()
        for number, counts in enumerate(SETPOINTS):
            if number in kills:
                is_taken = kills[number]
                if is_taken is None:
                    each.kill()
                else:
                    each.kill_during(counts, is_taken=is_taken)
                each.run()
            if kills.get(number) is not True:
                each.command(counts)
            each.actual()
        return each.drive.told, each.readings


def test_a_kill_in_a_blend_and_in_reversals_leaves_no_trace(tmp_path: Path) -> None:
    told, readings = stream(tmp_path / "whole", {})
    # 20 mm, forward: the whole way is blended in by 21 mm, and out of the other branch by 23 mm of travel.
    assert told[0] == 20_000
    assert told[15] == 21_500 + round(0.001 * 21_500)
    steps = [abs(b - a) for a, b in pairwise(told)]
    assert max(steps) <= 110
    assert readings == SETPOINTS
    kills = {IN_THE_BLEND: True, IN_THE_REVERSAL: None, IN_THE_SECOND: False}
    assert stream(tmp_path / "killed", kills) == (told, readings)


def test_a_kill_in_a_move_leaves_reading_and_words_as_they_were(tmp_path: Path) -> None:
    with machine(tmp_path / "x") as each:
        each.drive.follows = False
        each.run()
        each.command(40_000)
        each.drive.memory.put(ACTUAL, each.drive.told[-1])
        assert each.actual() == 40_000
        each.command(20_000)
        each.drive.memory.put(ACTUAL, 30_000)
        on_the_way = each.actual()
        each.kill()
        each.run()
        assert each.actual() == on_the_way
        each.command(20_000)
        assert each.drive.told[-1] == each.drive.told[-2] == 20_000
        for counts in (28_000, 25_000, 21_000, 20_000):
            each.drive.memory.put(ACTUAL, counts)
            each.actual()
        assert each.readings == sorted(each.readings, reverse=True)
        assert each.readings[-1] == 20_000
        each.kill_during(30_000, is_taken=True)
        each.drive.memory.put(ACTUAL, 25_000)
        each.run()
        each.actual()
        each.drive.memory.put(ACTUAL, 30_030)  # forward: 0.03 mm at 30 mm
        assert each.actual() == 30_000
        assert 24_950 < each.readings[-2] < 25_050


def test_a_kill_with_a_target_on_the_way_of_another_leaves_the_reading_of_its_end(tmp_path: Path) -> None:
    """It may have been stopped at 30 mm, or gone there: it read 30.01 mm until its next target."""
    with machine(tmp_path / "x") as each:
        each.drive.follows = False
        each.run()
        for counts in (20_000, 60_000):
            each.command(counts)
            each.drive.memory.put(ACTUAL, {20_000: each.drive.told[-1], 60_000: 45_000}[counts])
            each.actual()
        each.kill_during(30_000, is_taken=True)
        assert each.drive.told[-1] == 30_010  # backward
        each.drive.memory.put(ACTUAL, 30_010)
        each.run()
        assert each.actual() == 30_000


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"middle_mm": 0.06}, "the table that was in force is not the one configured now"),
        ({"counts_per_unit": 1001.0}, "what a count means, or a register of the axis, was changed"),
    ],
    ids=["table", "counts_per_unit"],
)
def test_a_record_of_another_axis_does_not_count(
    tmp_path: Path, changes: dict[str, Any], reason: str
) -> None:
    with machine(tmp_path / "x") as each:
        each.run()
        each.command(40_000)
        assert each.actual() == 40_000
        assert each.drive.told == [40_040]
        each.kill()
        shutil.rmtree(each.folder / "state" / "tables")  # nothing is left of the table that was in force
        each.configure(**changes)
        each.run()
        each.actual()
        assert each.readings[-1] == 40_040
        assert reason in each.note("record-not-used", "restored")["detail"]


def test_a_table_that_changed_meanwhile_comes_into_force_with_the_next_target(tmp_path: Path) -> None:
    with machine(tmp_path / "x") as each:
        each.run()
        each.command(40_000)
        assert each.actual() == 40_000
        each.kill()
        each.configure(middle_mm=0.06)
        each.run()
        assert each.actual() == 40_000  # a standing axis does not jump: the old table is still to be had
        each.command(45_000)
        assert each.drive.told == [40_040, 45_054]  # 0.06 mm at 50 mm: 0.054 mm at 45 mm
        assert each.actual() == 45_000


def test_an_axis_of_another_name_has_a_record_of_its_own(tmp_path: Path) -> None:
    with machine(tmp_path / "x") as each:
        each.run()
        each.command(40_000)
        each.kill()
        each.configure("y")
        each.run()
        assert each.actual() == 40_040
        assert (tmp_path / "x" / "state" / "axis-x.record").exists()
        each.kill()
        state = tmp_path / "x" / "state"
        (state / "axis-x.record").rename(state / "axis-y.record")
        each.run()
        assert "it belongs to axis x" in each.note("record-not-used", "restored")["detail"]
        assert each.actual() == 40_040


def test_a_drive_that_was_moved_by_hand_is_read_as_it_stands(tmp_path: Path) -> None:
    with machine(tmp_path / "x") as each:
        each.run()
        each.command(40_000)
        assert each.actual() == 40_000
        each.actual()  # the reply goes out before the record is written: with this one the first is
        each.kill()
        each.drive.memory.put(ACTUAL, 39_000)
        each.run()
        assert each.actual() == 39_000
        detail = each.note("record-not-used", "restored")["detail"]
        assert detail.startswith("the drive is at 39000 counts, and the record says at 40040")
