"""Counts what the running program does: function calls and files of a position command and of a reload.

Relay and supervisor run as processes of their own, from the sources of one checkout, with real sockets. Each
counts from one signal to another (``sys.setprofile``). Nothing of the program is imported here, so that every
revision can be walked.
"""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

BEGIN: Final = signal.SIGRTMIN + 1
END: Final = signal.SIGRTMIN + 2
TIMES: Final = 25
"""How often each walk is taken; the shortest counts, in which no timer of the program came between."""
PATIENCE_S: Final = 30.0
AFTER_REPLY_S: Final = 0.02
AFTER_RELOAD_S: Final = 0.5
"""So long it is counted on: what a process does after it has answered belongs to the walk."""
COUNTING: Final = f"""
import collections, json, os, signal, sys, threading
file, inside = os.environ["COUNTS"], os.path.join(os.environ["COUNTED"], "gateway") + os.sep
counts, states = collections.Counter(), {{"counting": False}}
def note(frame, event, argument):
    if states["counting"] and event == "call" and frame.f_code.co_filename.startswith(inside):
        counts[frame.f_code.co_filename[len(inside):]] += 1
def begin(*_):
    counts.clear()
    states["counting"] = True
    sys.setprofile(note)
def end(*_):
    states["counting"] = False
    sys.setprofile(None)
    with open(file + ".new", "w") as out:
        json.dump(counts, out)
    os.replace(file + ".new", file)
threading.setprofile(note)
signal.signal({int(BEGIN)}, begin)
signal.signal({int(END)}, end)
"""
"""What Python runs first in each process (``sitecustomize``), also where one becomes another program."""
PROGRAM: Final = "from gateway.cli.main import main; main()"
CONFIGURATION: Final = """
[gateway]
tables = "tables"

[line.xy]
drives = {{ tcp = "127.0.0.1:{drives}" }}

[[line.xy.controllers]]
name = "cnc"
tcp = "127.0.0.1:{listens}"

[axis.x]
line = "xy"
unit_id = 1
units = "mm"
counts_per_unit = 1000.0
travel = [0.0, 200.0]
referenced = "absolute"
table = "x.tab"
compensation = "on"
setpoints = "stream"
reversal = {{ distance = 0.5 }}
registers.command = [{{ address = 100, type = "int32" }}]

[axis.y]
line = "xy"
unit_id = 2
units = "mm"
counts_per_unit = 1000.0
travel = [0.0, 200.0]
referenced = "absolute"
table = "y.tab"
compensation = "on"
registers.command = [{{ address = 100, type = "int32" }}]
registers.actual = [{{ address = 200, type = "int32" }}]
"""
TABLE: Final = """CNC10 TAB FILE VERSION 3
AXIS {axis}
UNITS MILLIMETER
INTERVAL 100.0
ENTRIES 3
0.0 0.0 0.0
100.0 0.01 -0.02
200.0 {last} -0.01
"""

Counts = dict[str, int]
"""Calls in each file of the package."""


class WalkError(Exception):
    """The program does not do what a walk needs."""


POSITIONS: Final = {
    "stream, same direction (fast path)": [(1, 1000 + 700 * i) for i in range(TIMES + 2)],
    "stream, reversals": [(1, 50_000 + 900 * (i % 2)) for i in range(TIMES + 2)],
    "a target (slow path)": [(2, 20_000 + 9_000 * (i % 3)) for i in range(TIMES + 2)],
}
"""Position commands of each walk: unit id and counts."""


def walks_of(root: Path) -> dict[str, int]:
    """Return how many calls, through how many files, each walk takes. Raises WalkError."""
    with _desk(root) as (desk, config, listens), _counting(root, desk, "relay", config) as relay:
        found: dict[str, int] = {}
        for name, shortest in _of_positions(desk, relay, listens).items():
            found[f"calls of {name}"] = _calls(shortest)
            found[f"files of {name}"] = len(shortest)
        with _counting(root, desk, "supervise", config) as supervisor:
            _run(root, desk, "reload", str(config))  # both have met, and nothing is left to do
            counts = [_reload(root, desk, config, (supervisor, relay), i) for i in range(5)]
            found["calls of a reload, supervisor"] = min(_calls(each) for each, _ in counts)
            found["calls of a reload, relay"] = min(_calls(each) for _, each in counts)
        return found


def files_of_positions(root: Path) -> set[str]:
    """Return the files of the package that a position command touches, on any way. Raises WalkError."""
    with _desk(root) as (desk, config, listens), _counting(root, desk, "relay", config) as relay:
        return {file for counts in _of_positions(desk, relay, listens).values() for file in counts}


@contextlib.contextmanager
def _desk(root: Path) -> Iterator[tuple[Path, Path, int]]:
    """Make a folder with a compiled configuration; yields folder, configuration and port to listen at."""
    with TemporaryDirectory() as folder, _drives() as drives_port:
        desk = Path(folder)
        config, listens = _write(desk, drives_port)
        _run(root, desk, "check", "--compile", str(config))
        yield desk, config, listens


def _of_positions(desk: Path, relay: "_Process", listens: int) -> dict[str, Counts]:
    """Return what the shortest of each walk of a position command called."""
    found: dict[str, Counts] = {}
    with _counted_controller(listens) as controller:
        _wait_for(lambda: b'"line-up"' in (desk / "relay.log").read_bytes(), "the line to the drives")
        for name, targets in POSITIONS.items():
            for each in targets[:2]:  # the way that the first ones take is none of the usual ones
                _ask(controller, *each)
            found[name] = min((_count(relay, controller, *each) for each in targets[2:]), key=_calls)
    return found


def _calls(counts: Counts) -> int:
    return sum(counts.values())


def _write(desk: Path, drives_port: int) -> tuple[Path, int]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        listens = free.getsockname()[1]
    (desk / "site").mkdir()
    (desk / "site" / "sitecustomize.py").write_text(COUNTING)
    (desk / "tables").mkdir()
    for axis in "XY":
        _write_table(desk, axis, "0.02")
    config = desk / "gateway.toml"
    config.write_text(CONFIGURATION.format(drives=drives_port, listens=listens))
    return config, listens


def _write_table(desk: Path, axis: str, last: str) -> None:
    (desk / "tables" / f"{axis.lower()}.tab").write_text(TABLE.format(axis=axis, last=last))


def _run(root: Path, desk: Path, *words: str) -> None:
    command = [sys.executable, "-P", "-c", PROGRAM, *words]
    environment = _environment(root, desk, desk / "unused")
    done = subprocess.run(command, cwd=desk, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise WalkError(f"{' '.join(words)}: {done.stdout}{done.stderr}")


def _environment(root: Path, desk: Path, file: Path) -> dict[str, str]:
    path = os.pathsep.join((str(desk / "site"), str(root)))
    return {**os.environ, "PYTHONPATH": path, "COUNTS": str(file), "COUNTED": str(root)}


class _Process:
    """A process of the program that counts its calls."""

    def __init__(self, process: "subprocess.Popen[bytes]", file: Path) -> None:
        self._process, self._file = process, file

    def begin(self) -> None:
        """Count from now."""
        self._file.unlink(missing_ok=True)
        self._process.send_signal(BEGIN)

    def end(self) -> Counts:
        """Return what was called since. Raises WalkError."""
        self._process.send_signal(END)
        _wait_for(self._file.exists, "the counts of a process")
        found: Counts = json.loads(self._file.read_text())
        return found


@contextlib.contextmanager
def _counting(root: Path, desk: Path, command: str, config: Path) -> Iterator[_Process]:
    file, log = desk / f"{command}.json", desk / f"{command}.log"
    words = [sys.executable, "-P", "-c", PROGRAM, command, str(config)]
    environment = _environment(root, desk, file)
    with (
        log.open("wb") as out,
        subprocess.Popen(words, cwd=desk, env=environment, stdout=out, stderr=out) as process,
    ):
        try:
            yield _Process(process, file)
        except (OSError, WalkError) as error:
            raise WalkError(
                f"{error}; {command} ended {process.poll()}, said: {log.read_text()[-2000:]}"
            ) from error
        finally:
            process.kill()


def _wait_for(happened: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not happened():
        if time.monotonic() > deadline:
            raise WalkError(f"{what} did not come within {PATIENCE_S:g} s")
        time.sleep(0.01)


@contextlib.contextmanager
def _counted_controller(port: int) -> Iterator[socket.socket]:
    found: list[socket.socket] = []

    def connects() -> bool:
        with contextlib.suppress(OSError):
            connection = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
            if connection.getsockname() == connection.getpeername():  # nothing listens yet: it met itself
                connection.close()
                return False
            found.append(connection)
        return bool(found)

    _wait_for(connects, "the gateway's port")
    with found[0] as controller:
        controller.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        yield controller


def _ask(controller: socket.socket, unit_id: int, counts: int) -> None:
    pdu = b"\x10\x00\x64\x00\x02\x04" + counts.to_bytes(4, "big", signed=True)
    controller.sendall(b"\x00\x01\x00\x00" + (len(pdu) + 1).to_bytes(2, "big") + bytes((unit_id,)) + pdu)
    reply = controller.recv(260)
    if reply[7:8] != b"\x10":
        raise WalkError(f"the gateway answers a position command with {reply.hex(' ')}")


def _count(relay: _Process, controller: socket.socket, unit_id: int, counts: int) -> Counts:
    relay.begin()
    _ask(controller, unit_id, counts)
    time.sleep(AFTER_REPLY_S)
    return relay.end()


def _reload(
    root: Path, desk: Path, config: Path, both: tuple[_Process, _Process], number: int
) -> tuple[Counts, Counts]:
    """Return the calls of supervisor and relay. Raises WalkError."""
    supervisor, relay = both
    _write_table(desk, "X", f"0.02{number + 1}")
    supervisor.begin()
    relay.begin()
    _run(root, desk, "reload", str(config))
    time.sleep(AFTER_RELOAD_S)
    return supervisor.end(), relay.end()


@contextlib.contextmanager
def _drives() -> Iterator[int]:
    """Drives that acknowledge every write and stand at 0."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=_serve, args=(server,), daemon=True).start()
        yield server.getsockname()[1]


def _serve(server: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while True:
            connection, _ = server.accept()
            threading.Thread(target=_answer, args=(connection,), daemon=True).start()


def _answer(connection: socket.socket) -> None:
    buffer = b""
    with contextlib.suppress(OSError), connection:
        while received := connection.recv(4096):
            buffer += received
            while len(buffer) >= 6 and len(buffer) >= 6 + int.from_bytes(buffer[4:6], "big"):
                length = 6 + int.from_bytes(buffer[4:6], "big")
                frame, buffer = buffer[:length], buffer[length:]
                pdu = frame[7:]
                quantity = int.from_bytes(pdu[3:5], "big")
                is_read = pdu[0] == 3
                reply = bytes((3, 2 * quantity)) + bytes(2 * quantity) if is_read else pdu[:5]
                head = frame[:4] + (len(reply) + 1).to_bytes(2, "big") + frame[6:7]
                connection.sendall(head + reply)


if __name__ == "__main__":
    print(json.dumps(walks_of(Path(os.path.realpath(sys.argv[1]))), indent=1))
