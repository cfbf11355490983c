"""Running the load program, and what it found."""

import json
import signal
import socket
import subprocess
import time
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from bench.building import Programs
from bench.errors import BenchError
from bench.figures import Round
from bench.places import BUILD
from bench.processes import Process, Processes, cpu_ns, line_from, pinned
from gateway.modbus.mbap import encode_mbap

RETRY_S: Final = 0.05
START_S: Final = 30.0


@dataclass(frozen=True, slots=True)
class Way:
    """Where requests go in: endpoints as ``load`` takes them, and the descriptors that they name."""

    endpoints: tuple[str, ...]
    fds: tuple[int, ...] = ()
    pids: tuple[int, ...] = ()
    """The processes that carry them, where their processor time is asked for."""

    @classmethod
    def tcp(cls, *ports: int, pids: tuple[int, ...] = ()) -> "Way":
        """Modbus/TCP on loopback."""
        return cls(tuple(f"tcp:127.0.0.1:{port}" for port in ports), pids=pids)

    @classmethod
    def fd(cls, descriptor: int) -> "Way":
        """RTU through a descriptor of ours."""
        return cls((f"fd:{descriptor}",), (descriptor,))

    @classmethod
    def tty(cls, path: str) -> "Way":
        """RTU through a serial port."""
        return cls((f"tty:{path}",))


@dataclass(frozen=True, slots=True)
class Load:
    """What is asked, and how often; see ``c/load.c``."""

    count: int
    kind: str = "write"
    warmup: int = 500
    period_us: int = 0
    units: tuple[int, ...] = (1,)
    lines: int = 1
    is_concurrent: bool = False
    is_reconnecting: bool = False
    fifo: int = 0
    timeout_ms: int = 1000
    cpus: tuple[int, ...] | None = None

    def words(self) -> list[str]:
        """As options of the program."""
        options = {
            "count": self.count, "kind": self.kind, "warmup": self.warmup, "period-us": self.period_us,
            "units": ",".join(map(str, self.units)), "lines": self.lines,
            "concurrent": int(self.is_concurrent), "reconnect": int(self.is_reconnecting), "fifo": self.fifo,
            "timeout-ms": self.timeout_ms,
        }  # fmt: skip
        return [word for name, value in options.items() for word in (f"--{name}", str(value))]


@dataclass(frozen=True, slots=True)
class Found:
    """What one run of the load program found. ``by_due``: counted from when each request was due."""

    from_sent: Round
    by_due: Round
    seconds: float
    used: Round
    """Processor time of an exchange, of all processes of the way together; 0 where there are none."""


class Meter:
    """Runs the load program; every reply that is missing or wrong ends the bench."""

    def __init__(self, programs: Programs) -> None:
        self._programs = programs
        self._file = BUILD / "latencies.bin"

    def run(self, way: Way, load: Load) -> Found:
        """Measure one round.

        Raises:
            BenchError: a reply did not come, or was not the right one.
        """
        before_ns = sum(map(cpu_ns, way.pids))
        done = self._load(way, load, str(self._file))
        used_ns = sum(map(cpu_ns, way.pids)) - before_ns
        if done.returncode:
            raise BenchError(f"{' '.join(way.endpoints)}: {done.stdout.strip()} {done.stderr.strip()}")
        values = array("q")
        values.frombytes(self._file.read_bytes())
        said = json.loads(done.stdout)
        used = Round.same(used_ns / (load.count + load.warmup))
        return Found(Round.of(values[1::2]), Round.of(values[::2]), said["seconds"], used)

    def attempt(self, way: Way, load: Load) -> tuple[dict[str, int], list[int]]:
        """Measure one round in which replies may be missing or wrong; it ends after ten of them.

        Returns what the load program says, and how long those took that were right, in nanoseconds.
        """
        done = self._load(way, load, str(self._file))
        values = array("q")
        values.frombytes(self._file.read_bytes())
        said: dict[str, int] = json.loads(done.stdout)
        return said, values[1::2].tolist()

    def wait_until_serving(self, way: Way, units: Iterable[int] = (1,), patience_s: float = START_S) -> None:
        """Ask until the first good reply.

        Raises:
            BenchError: there is none in ``patience_s``.
        """
        one = Load(1, warmup=0, units=tuple(units), timeout_ms=500)
        until = time.monotonic() + patience_s
        while True:
            done = self._load(way, replace(one, kind="read"), None)
            if not done.returncode:
                return
            if time.monotonic() > until:
                raise BenchError(f"{' '.join(way.endpoints)} does not serve: {done.stderr.strip()}")
            time.sleep(RETRY_S)

    def _load(self, way: Way, load: Load, out: str | None) -> "subprocess.CompletedProcess[str]":
        command = [str(self._programs.load), *load.words(), *(["--out", out] if out else []), *way.endpoints]
        return subprocess.run(
            pinned(command, load.cpus), capture_output=True, text=True, check=False, pass_fds=way.fds
        )


@dataclass(frozen=True, slots=True)
class Drive:
    """Drives that run: the ports of those that listen, and how to end them."""

    ports: tuple[int, ...]
    process: Process
    processes: Processes
    arrivals_file: Path | None = None

    def arrivals(self) -> "array[int]":
        """Return when the writes since the last call arrived, in nanoseconds."""
        assert self.arrivals_file is not None
        self.arrivals_file.unlink(missing_ok=True)
        self.process.send_signal(signal.SIGUSR1)
        until = time.monotonic() + START_S
        while not self.arrivals_file.exists():
            if time.monotonic() > until or self.process.poll() is not None:
                raise BenchError("the drive does not say when its writes arrived")
            time.sleep(RETRY_S)
        times = array("q")
        times.frombytes(self.arrivals_file.read_bytes())
        return times

    def stop(self) -> dict[str, int]:
        """End them; returns what they counted."""
        said: dict[str, int] = json.loads(self.processes.stop(self.process))
        return said


def start_drive(
    processes: Processes,
    programs: Programs,
    at: Sequence[str] = ("listen:0",),
    *,
    fds: Sequence[int] = (),
    arrivals: Path | None = None,
    fifo: int = 0,
    cpus: Iterable[int] | None = None,
) -> Drive:
    """Start drives at endpoints as ``c/drive.c`` takes them."""
    options = ["--fifo", str(fifo), *(["--arrivals", str(arrivals)] if arrivals else [])]
    process = processes.start("drive", [programs.drive, *options, *at], cpus=cpus, fds=fds, is_talking=True)
    ports: list[int] = []
    while (line := line_from(process)) != "ready":
        ports.append(int(line.removeprefix("port ")))
    return Drive(tuple(ports), process, processes, arrivals)


def holding(port: int, address: int) -> int:
    """Return the 32-bit number that a drive's registers hold, high word first, asked directly."""
    with socket.create_connection(("127.0.0.1", port), START_S) as connection:
        connection.sendall(encode_mbap(1, 1, bytes([3]) + address.to_bytes(2, "big") + bytes([0, 2])))
        reply = connection.recv(13, socket.MSG_WAITALL)
    return int.from_bytes(reply[9:13], "big", signed=True)
