"""Programs that the bench starts: each stopped by its own id, whatever way the bench ends."""

import contextlib
import os
import signal
import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import FrameType, TracebackType
from typing import Final, Self

from bench.errors import BenchError
from bench.places import BUILD, ROOT

PATIENCE_S: Final = 5.0
LOGS: Final = BUILD / "logs"

Command = Sequence[str | Path]
Process = subprocess.Popen[str]


def environment(packages: Path = ROOT) -> dict[str, str]:
    """Return the environment of what is started: a folder's packages come first, then this checkout's.

    Python keeps its bytecode, as in an installation: without it each start would compile the sources, and the
    relay would be 2 MB larger for good.
    """
    folders = dict.fromkeys((str(packages), str(ROOT)))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    return environment


def pinned(command: Command, cpus: Iterable[int] | None) -> list[str]:
    """Return a command that runs on these processors only, and dies with the bench, even a killed one."""
    words = ["setpriv", "--pdeathsig", "KILL"]
    if cpus is not None:
        words += ["taskset", "--cpu-list", ",".join(map(str, cpus))]
    return [*words, *map(str, command)]


class Processes:
    """Started programs. As a context it stops all of them, last first."""

    def __init__(self, logs: Path = LOGS) -> None:
        self._running: list[Process] = []
        self.logs = logs
        logs.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in reversed(self._running[:]):
            self.stop(process)

    def start(
        self,
        name: str,
        command: Command,
        *,
        cpus: Iterable[int] | None = None,
        fds: Sequence[int] = (),
        is_talking: bool = False,
        packages: Path = ROOT,
    ) -> Process:
        """Start a program. What it says goes to a log; if ``is_talking``, its output through a pipe.

        ``packages``: the folder from which it imports, and in which it runs.
        """
        with (self.logs / f"{name}.log").open("w") as log:
            process = subprocess.Popen(
                pinned(command, cpus),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE if is_talking else log,
                stderr=log,
                pass_fds=fds,
                text=True,
                cwd=packages,
                env=environment(packages),
            )
        self._running.append(process)
        return process

    def stop(self, process: Process, patience_s: float = PATIENCE_S) -> str:
        """End a program, by force where it does not listen; returns the rest of its output."""
        if process.poll() is None:
            process.terminate()
            process.send_signal(signal.SIGCONT)
        try:
            rest, _ = process.communicate(timeout=patience_s)
        except subprocess.TimeoutExpired:
            process.kill()
            rest, _ = process.communicate()
        if process in self._running:
            self._running.remove(process)
        return rest or ""


def line_from(process: Process) -> str:
    """Wait for one line of a talking program.

    Raises:
        BenchError: it ended.
    """
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        raise BenchError(f"{process.args!r} ended (see {LOGS})")
    return line.strip()


def stop_on_signals() -> None:
    """Let SIGTERM and SIGHUP end the bench as Ctrl-C does, so that everything is stopped.

    Ctrl-C is asked for as well: a shell that starts the bench in the background has it ignored.
    """

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, interrupt)


def children(pid: int) -> list[int]:
    """Return the ids of the processes that a process started, oldest first."""
    found: list[int] = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            # The name, in brackets, may hold anything: the rest counts from the last bracket.
            parent = int(status.read_text().rpartition(")")[2].split()[1])
            if parent == pid:
                found.append(int(status.parent.name))
    return sorted(found)


def command_line(pid: int) -> str:
    """Return the words a process was started with; empty when it has gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
    except OSError:
        return ""


def resident_bytes(pid: int) -> int:
    """Return the memory of a process that is in RAM and its own or shared."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def cpu_ns(pid: int) -> int:
    """Return the processor time of a process, all threads."""
    times = [Path(path / "schedstat").read_text().split()[0] for path in Path(f"/proc/{pid}/task").iterdir()]
    return sum(map(int, times))
