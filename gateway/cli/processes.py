"""Relay and supervisor as programs: starting each, and both together in the foreground."""

import os
import select
import signal
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NoReturn

import typer

import gateway
from gateway.backoff import Backoff
from gateway.catalogue.entry import EventEntry
from gateway.catalogue.process_events import RELAY_ENDED, SUPERVISOR_ENDED, SUPERVISOR_STARTED
from gateway.ipc.children import HELD_BACK, READY, RELOADS
from gateway.ipc.log import LogEntry, LogFormat, log_entry, take_standard_error
from gateway.state.folder import StateError, state_folder

STOPS: Final = frozenset({signal.SIGTERM, signal.SIGINT})
FIRST_WAIT_S: Final = 0.2
LONGEST_WAIT_S: Final = 30.0
LONG_LIFE_S: Final = 60.0
"""After a run of at least this time, a supervisor is restarted with the first delay."""
PATIENCE_S: Final = 2.0
"""For the supervisor to stop: it has no work that must be finished."""


def command_of(module: str, config: Path, log_format: LogFormat, *more: str) -> list[str]:
    """Return the command line of one of our programs."""
    # -P: a folder "gateway" in the working directory is not this program.
    return [sys.executable, "-P", "-m", module, str(config), "--log-format", log_format.value, *more]


def become(config: Path, command: list[str], log_format: LogFormat) -> NoReturn:
    """Replace this process by another program, without the memory of the command line.

    If CONFIG cannot be read, this is logged before, in the form of the log.
    """
    take_standard_error(log_format)
    try:
        state_folder(config)
    except StateError as error:
        typer.echo(f"{config}: {error}", err=True)
        raise typer.Exit(1) from None
    sys.stdout.flush()
    sys.stderr.flush()
    os.execve(command[0], command, _environment())  # noqa: S606 - no shell, and our own interpreter


def _environment() -> dict[str, str]:
    """Return the environment in which a child finds the same package as this process."""
    folder = str(Path(gateway.__file__).parents[1])
    if folder in (sysconfig.get_path("purelib"), sysconfig.get_path("platlib")):
        return dict(os.environ)  # installed: found unchanged, and after the standard library
    others = os.environ.get("PYTHONPATH")
    return {**os.environ, "PYTHONPATH": os.pathsep.join((folder, others) if others else (folder,))}


def run_both(
    relay: list[str], supervisor: list[str], open_log: Callable[[], Callable[[LogEntry], None]]
) -> int:
    """Run both until SIGTERM, SIGINT or the end of the relay; return the exit code.

    SIGHUP is passed on to the supervisor, which reloads the tables. All write into the same log. ``open_log``
    returns the writer of these log entries, which may block. It is called after the start of the relay, which
    must not wait. A supervisor that ends is restarted, with growing delays; the relay continues without it.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, HELD_BACK)
    try:
        return _Pair(relay, supervisor, open_log).run()
    finally:
        while signal.sigtimedwait(STOPS | {RELOADS}, 0) is not None:
            pass  # nothing is left to stop or reload
        signal.pthread_sigmask(signal.SIG_UNBLOCK, HELD_BACK)


def _unless_full(write: Callable[[LogEntry], None]) -> Callable[[LogEntry], None]:
    """Drop entries that would have to wait for the reader of the log.

    A thread is not possible: children get the parent-death signal for the end of each thread (prctl(2)), and
    two of them end the relay immediately.
    """

    def write_or_drop(entry: LogEntry) -> None:
        if select.select((), (sys.stderr,), (), 0)[1]:
            write(entry)

    return write_or_drop


def _started(command: list[str]) -> "subprocess.Popen[bytes]":
    """Start a program in its own process group: Ctrl-C on the terminal reaches it only through us."""
    return subprocess.Popen(  # noqa: S603 - our own interpreter
        [*command, "--parent", str(os.getpid())],
        process_group=0,
        stdin=subprocess.DEVNULL,
        env=_environment(),
    )


class _Pair:
    """The two processes, from the start of the first to the end of the last."""

    def __init__(
        self, relay: list[str], supervisor: list[str], open_log: Callable[[], Callable[[LogEntry], None]]
    ) -> None:
        self._supervisor_command = supervisor
        self._relay = _started(relay)
        self._write = _unless_full(open_log())
        self._supervisor: subprocess.Popen[bytes] | None = None
        self._is_relay_ready = False
        self._supervisor_since_s = time.monotonic()
        self._backoff = Backoff(FIRST_WAIT_S, LONGEST_WAIT_S)
        self._is_stopping = False

    def run(self) -> int:
        while self._relay.poll() is None:
            if self._is_relay_ready and not self._is_stopping:
                self._watch_supervisor()
            found = signal.sigtimedwait(HELD_BACK, self._longest_wait_s())
            if found is not None and found.si_signo in STOPS:
                self._stop(found.si_signo)
            elif found is not None and found.si_signo == RELOADS:
                self._reload()
            elif found is not None and (found.si_signo, found.si_pid) == (READY, self._relay.pid):
                self._is_relay_ready = True
                self._start_supervisor()
        self._end_supervisor()
        return self._exit_code(self._relay.returncode)

    def _longest_wait_s(self) -> float:
        if self._supervisor is not None or not self._is_relay_ready:
            return LONGEST_WAIT_S  # or until a signal, as at the end of a child
        return max(0.0, self._supervisor_since_s + self._backoff.pause_s - time.monotonic())

    def _watch_supervisor(self) -> None:
        now_s = time.monotonic()
        if self._supervisor is None:
            if now_s >= self._supervisor_since_s + self._backoff.pause_s:
                self._backoff.next_s()
                self._start_supervisor()
                self._log(SUPERVISOR_STARTED)
        elif self._supervisor.poll() is not None:
            if now_s - self._supervisor_since_s > LONG_LIFE_S:
                self._backoff.reset()
            status = _status(self._supervisor.returncode)
            self._supervisor = None
            self._supervisor_since_s = now_s
            detail = f"the relay goes on; the supervisor is restarted in {self._backoff.pause_s:g} s"
            self._log(SUPERVISOR_ENDED, status=status, detail=detail)

    def _start_supervisor(self) -> None:
        if not self._is_stopping:
            self._supervisor = _started(self._supervisor_command)
            self._supervisor_since_s = time.monotonic()

    def _reload(self) -> None:
        if self._supervisor is not None:  # a supervisor that is starting reads them anyway
            self._supervisor.send_signal(RELOADS)

    def _stop(self, number: int) -> None:
        """Stop both; the second call ends the relay immediately."""
        self._is_stopping = True
        self._relay.send_signal(number)
        if self._supervisor is not None:
            self._supervisor.send_signal(signal.SIGTERM)

    def _end_supervisor(self) -> None:
        if self._supervisor is None:
            return
        self._supervisor.terminate()
        try:
            self._supervisor.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._supervisor.kill()
            self._supervisor.wait()

    def _exit_code(self, code: int) -> int:
        if self._is_stopping and -code in STOPS:
            return 0  # it was not running yet
        if not self._is_stopping and code <= 0:
            detail = "no more positions are forwarded: the gateway ends"
            self._log(RELAY_ENDED, status=_status(code), detail=detail)
            return 1
        return code if code >= 0 else 1

    def _log(self, event: EventEntry, **fields: Any) -> None:
        self._write(log_entry(event, fields, time.time()))


def _status(code: int) -> str:
    """Return how a process ended, for a person.

    >>> _status(-9), _status(1)
    ('SIGKILL', 'exit code 1')
    """
    return f"exit code {code}" if code >= 0 else signal.Signals(-code).name
