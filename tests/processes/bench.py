"""Real programs, a real drive and a real master, for tests of the two processes."""

import contextlib
import json
import os
import queue
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gateway.ipc.address import socket_path
from gateway.modbus.mbap import encode_mbap
from tests.child import started
from tests.ports import free_port

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-c", "from gateway.cli.main import main; main()"]
SECONDS = 100.0
"""At most, for what an idle machine does within a second: a busy one takes as long to start a program."""
CONFIG = """
[gateway]
name = "trial"

[http]
listen = ""

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
travel = [0.0, 100.0]
referenced = "absolute"
compensation = "on"
table = "x.tab"
registers.command = [{{ address = 100, type = "int32" }}]
"""
TABLE = """CNC10 TAB FILE VERSION 3
AXIS X
UNITS MILLIMETER
INTERVAL 50.0
ENTRIES 3
0.0 0.0 0.0
50.0 0.05 0.05
100.0 0.1 0.1
"""
STEEPER = TABLE.replace("0.1 0.1", "0.2 0.2").replace("0.05 0.05", "0.1 0.1")


def typed_apart(*arguments: str) -> "subprocess.CompletedProcess[str]":
    """Type a command that becomes another program or logs, which ``tests.commands.typed`` cannot."""
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, timeout=SECONDS, check=False, cwd=ROOT
    )


class Drive:
    """Acknowledges FC16 unless it is silent; keeps what it was told, in counts."""

    def __init__(self, listening: socket.socket) -> None:
        self.told: list[int] = []
        self.is_silent = False
        self._listening = listening
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._listening.accept()
            except OSError:
                return
            with connection, contextlib.suppress(OSError):
                while data := connection.recv(300):
                    self.told.append(int.from_bytes(data[13:17], "big", signed=True))
                    if not self.is_silent:
                        connection.sendall(data[:4] + bytes((0, 6)) + data[6:12])


class Master:
    """Commands positions, and sees every answer."""

    def __init__(self, port: int, drive: Drive, unit_id: int = 1) -> None:
        self._unit_id = unit_id
        self._connection = socket.create_connection(("127.0.0.1", port), timeout=SECONDS)
        self._drive = drive
        self._number = 0

    def move(self, counts: int) -> int:
        """Command a position; returns what the drive was told."""
        self.send(counts)
        assert self._connection.recv(300) == encode_mbap(
            self._number, self._unit_id, bytes.fromhex("10 0064 0002")
        )
        return self._drive.told[-1]

    def is_refused(self, counts: int) -> bool:
        """Command a position; returns whether the answer is that it cannot be."""
        self.send(counts)
        return self._connection.recv(300) == encode_mbap(self._number, self._unit_id, bytes.fromhex("90 04"))

    def is_answered_with_an_exception(self) -> bool:
        """Return whether what was sent last is answered with any exception."""
        answer = self._connection.recv(300)
        return len(answer) == 9 and answer[7] == 0x90

    def send(self, counts: int) -> None:
        """Command a position, and leave the answer where it is."""
        self._number = self._number % 60_000 + 1
        pdu = bytes.fromhex("10 0064 0002 04") + counts.to_bytes(4, "big", signed=True)
        self._connection.sendall(encode_mbap(self._number, self._unit_id, pdu))

    def close(self) -> None:
        self._connection.close()


class Site:
    """A configuration with a drive behind it."""

    def __init__(self, folder: Path, drives: int, port: int, drive: Drive) -> None:
        self.config = folder / "gateway.toml"
        self.config.write_text(CONFIG.format(drives=drives, port=port))
        self.table = folder / "tables" / "x.tab"
        self.table.parent.mkdir()
        self.table.write_text(TABLE)
        self.socket = socket_path(folder / "state")
        self.port = port
        self.drive = drive

    def port_is_open(self) -> bool:
        """Whether the gateway listens."""
        try:
            self.master().close()
        except ConnectionError:  # refused, or reset by a listener that closes just now
            return False
        return True

    def serve_page(self) -> str:
        """Have the status served over TCP too; returns where."""
        address = f"127.0.0.1:{free_port()}"
        self.config.write_text(self.config.read_text().replace('listen = ""', f'listen = "{address}"'))
        return f"http://{address}"

    def master(self) -> Master:
        return Master(self.port, self.drive)


@contextlib.contextmanager
def site_in(folder: Path) -> Iterator[Site]:
    """Lay out a configuration with a drive that answers."""
    port = free_port()
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield Site(folder, listening.getsockname()[1], port, Drive(listening))


class Running:
    """A program of ours with its log, which is read as it is written: the program never waits for a test."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self.process = process
        self.notes: list[dict[str, Any]] = []
        """The events that have been read."""
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self._lines.put(line)
        self._lines.put("")

    def line(self) -> str:
        """Return the next line of the log, empty at its end; a log that stands still is a failure."""
        try:
            line = self._lines.get(timeout=SECONDS)
        except queue.Empty:
            raise AssertionError(f"nothing more in the log for {SECONDS} s: {self.notes}") from None
        if not line:
            self._lines.put("")  # whoever asks again is told again
        return line

    def next(self) -> dict[str, Any]:
        """Return the next event of the log."""
        line = self.line()
        assert line, f"the log ended: {self.notes}"
        self.notes.append(json.loads(line))
        return self.notes[-1]

    def until(self, name: str, **fields: object) -> dict[str, Any]:
        """Read the log up to an event."""
        while True:
            note = self.next()
            if note["event"] == name and all(note.get(key) == value for key, value in fields.items()):
                return note

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        self.rest()
        return self.process.wait(SECONDS)

    def rest(self) -> list[dict[str, Any]]:
        """Read the log to its end: every program that writes into it has ended then."""
        before = len(self.notes)
        while line := self.line():
            self.notes.append(json.loads(line))
        return self.notes[before:]


@contextlib.contextmanager
def running(*arguments: str) -> Iterator[Running]:
    """Run one of our commands; the log of each that ran is printed when the test fails."""
    command = [*COMMAND, *arguments, "--log-format", "json"]
    with started(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        program = Running(process)
        try:
            yield program
        except BaseException:
            process.kill()
            sys.stdout.write(f"{arguments} ended with {process.wait(SECONDS)}\n")
            sys.stdout.writelines(f"{note}\n" for note in program.notes)
            sys.stdout.writelines(iter(program.line, ""))
            raise
        process.kill()


def children(process: "subprocess.Popen[Any]") -> dict[str, int]:
    """Return the programs that a process has started, by module."""
    found = {}
    for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
        words: list[str] = []
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # it has just ended
            words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
        if "-m" in words:  # else it is about to become one of ours
            found[words[words.index("-m") + 1]] = int(pid)
    return found


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def wait_until_dead(pid: int) -> None:
    """Wait for the end of a process that is not ours to wait for."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    try:
        ready, _, _ = select.select([descriptor], [], [], SECONDS)
        assert ready, f"{pid} still runs"
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def gateway_of(site: Site) -> Iterator[tuple[Running, Master]]:
    """``run`` with both processes, which have found each other."""
    with running("run", str(site.config)) as gateway:
        seen: set[str] = set()
        while not {"line-up", "relay-reached"} <= seen:
            seen.add(gateway.next()["event"])
        master = site.master()
        try:
            yield gateway, master
        finally:
            master.close()
