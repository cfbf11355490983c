"""Programs that a test starts, and that never outlive the test: ours, with their logs, and others."""

import contextlib
import json
import os
import queue
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, TypeVar

Found = TypeVar("Found")
ROOT: Final = Path(__file__).parents[2]
COMMAND: Final = [sys.executable, "-c", "from gateway.cli.main import main; main()"]
"""``pitch-gateway``, wherever this checkout is."""
SECONDS: Final = 100.0
"""So long a test waits for a program to go on."""


def of_checkout() -> dict[str, str]:
    """Return the environment in which ``COMMAND`` is that of this checkout in every folder."""
    return {**os.environ, "PYTHONPATH": str(ROOT)}


@contextlib.contextmanager
def started(command: list[str], **options: Any) -> "Iterator[subprocess.Popen[Any]]":
    """``subprocess.Popen`` as a context that kills what still runs at its end.

    ``Popen``'s own context waits for the program, for ever if need be: a failed assertion would hang the run
    where this one shows the failure.
    """
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()


def typed_apart(*arguments: str, seconds: float = SECONDS) -> "subprocess.CompletedProcess[str]":
    """Type a command that becomes another program or logs, which ``commands.typed`` cannot.

    It has so many seconds.
    """
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, timeout=seconds, check=False, cwd=ROOT
    )


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
        with contextlib.suppress(ValueError):  # the test has ended, and with it the pipe
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

    def until_each(self, *names: str) -> None:
        """Read the log until each of these events has come; warnings of the configuration stand before."""
        missing = set(names)
        while missing:
            line = self.line()
            if not line.startswith("warning: "):
                assert line, f"the log ended without {missing}: {self.notes}"
                self.notes.append(json.loads(line))
                missing.discard(self.notes[-1]["event"])

    def port(self, controller: str) -> int:
        """Return where a controller connects, by its name in the event ``ready``: ``xyz/cnc``."""
        (ready,) = (note for note in self.notes if note["event"] == "ready")
        return int(ready["addresses"][controller][0].rpartition(":")[2])

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
def running(*arguments: str, folder: Path = ROOT) -> Iterator[Running]:
    """Run one of our commands in a folder; the log of each that ran is printed when the test fails."""
    command = [*COMMAND, *arguments, "--log-format", "json"]
    with started(command, cwd=folder, env=of_checkout(), stderr=subprocess.PIPE, text=True) as process:
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


@contextlib.contextmanager
def ending(program: Running) -> Iterator[None]:
    """End a program where the test is through with it, and has not waited for its end by itself."""
    yield
    if program.process.returncode is None:
        assert program.end() == 0


def eventually(look: Callable[[], Found], is_so: Callable[[Found], bool]) -> Found:
    """Look twenty times a second until it is so, and return what was seen then."""
    latest_s = time.monotonic() + SECONDS
    while not is_so(found := look()):
        assert time.monotonic() < latest_s, found
        time.sleep(0.05)
    return found


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


def press_ctrl_c_at_question(pid: int) -> None:
    """Send SIGINT to a program that asks, once it sleeps in the reading of the answer.

    Between the last look of CPython for signals and its blocking read lies a moment: a signal that comes then
    is noted, and heard only after the answer. A person presses again; a test would wait for ever.
    """
    deadline_s = time.monotonic() + SECONDS
    while not _sleeps_reading_input(pid):
        assert time.monotonic() < deadline_s, f"{pid} does not read its standard input"
        time.sleep(0.001)  # another process: nothing tells when it sleeps
    os.kill(pid, signal.SIGINT)


def _sleeps_reading_input(pid: int) -> bool:
    """Whether a program sleeps in a system call on its standard input: its first argument is 0.

    A kernel that does not show the call still shows that the program sleeps. After its question that says the
    same: until the read it waits for nothing.
    """
    try:
        call = Path(f"/proc/{pid}/syscall").read_text().split()  # "running", or the number and the arguments
    except OSError:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "S"
    return call[1:2] == ["0x0"]


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
