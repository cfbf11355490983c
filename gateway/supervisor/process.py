"""The supervisor as a process: loop, signals, log."""

import asyncio
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gateway.ipc.children import RELOADS
from gateway.ipc.folder_problems import problem_of
from gateway.ipc.log_thread import LogThread
from gateway.ipc.messages import Happened
from gateway.ipc.notes import Note, Severity
from gateway.ipc.place import socket_path
from gateway.ipc.state_folder import StateError, make_folder
from gateway.ipc.state_lock import take_lock
from gateway.supervisor.link import Link
from gateway.supervisor.tables import Outcome, bring_up_to_date

LOCK_NAME: Final = "supervisor.lock"


def run_supervisor(
    config: Path, state: Path, write: Callable[[Note], None], *, tells_events: bool = False
) -> None:
    """Run until SIGTERM or SIGINT; SIGHUP reads the tables anew. ``tells_events``: log those of the relay.

    ``write`` writes a note into the log and may block, as in ``relay.run.run_relay``.

    Raises:
        SocketError: the path of the relay's socket is too long.
        StateError: another supervisor has the state folder, or it cannot be had.
    """
    path = socket_path(state)
    lock_fd = _lock(state)
    try:
        log = LogThread(write)
        supervisor = Supervisor(config, path, log.write, tells_events=tells_events)
        with asyncio.Runner() as runner:
            runner.run(_with_log(log, supervisor))
    finally:
        os.close(lock_fd)


def _lock(state: Path) -> int:
    """Be the only supervisor of a state folder; returns the descriptor of its lock.

    Raises:
        StateError: there is one already, or the folder cannot be had.
    """
    path = state / LOCK_NAME
    try:
        make_folder(state)
        return take_lock(path)
    except BlockingIOError:
        raise StateError(
            f"gateway.state: {path} belongs to a supervisor that runs: stop it first (run has one of its "
            "own), or give this one a folder of its own with [gateway] state"
        ) from None
    except OSError as error:
        raise StateError(f"gateway.state: {problem_of(error, state)}") from None


async def _with_log(log: LogThread, supervisor: "Supervisor") -> None:
    async with log:
        await supervisor.run()


class Supervisor:
    """Listens to the relay, and brings its tables up to date when it is reached and when it is asked to.

    ``write`` takes a note and does not block.
    """

    def __init__(
        self, config: Path, path: Path, write: Callable[[Note], None], *, tells_events: bool = False
    ) -> None:
        self._config = config
        self._write = write
        self._tells_events = tells_events
        self._link = Link(path, self._reached, self._lost, self._happened)
        self._wanted = asyncio.Event()
        self._is_asked = False
        self._last_problems: tuple[str, ...] = ()

    async def run(self) -> None:
        """Run until a signal ends it."""
        loop = asyncio.get_running_loop()
        stopping = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, stopping.set)
        loop.add_signal_handler(RELOADS, self._asked)
        self._say("supervising", config=str(self._config))
        tasks: list[asyncio.Task[object]] = [
            asyncio.create_task(self._link.run()),
            asyncio.create_task(self._keep_up()),
        ]
        stopped: asyncio.Task[object] = asyncio.create_task(stopping.wait())
        ended, _ = await asyncio.wait([*tasks, stopped], return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            task.cancel()
        for task in ended - {stopped}:
            task.result()  # a bug: let it be seen, and let whoever started us start us again

    async def _keep_up(self) -> None:
        while True:
            await self._wanted.wait()
            self._wanted.clear()
            is_asked, self._is_asked = self._is_asked, False
            outcome = await asyncio.to_thread(bring_up_to_date, self._config)
            self._report(outcome, is_asked=is_asked)

    def _report(self, outcome: Outcome, *, is_asked: bool) -> None:
        for axis, comes in outcome.comes.items():
            what = "table-taken-away" if axis in outcome.gone else "table-handed-over"
            self._say(what, axis=axis, comes=comes)
        if outcome.problems and (is_asked or outcome.problems != self._last_problems):
            detail = "the tables in force stay"
            self._say("reload-refused", Severity.ERROR, problems=list(outcome.problems), detail=detail)
        elif is_asked and not outcome.comes and not outcome.problems:
            there = (
                "all tables are in force already" if outcome.is_running else "no gateway runs: kept for it"
            )
            self._say("nothing-to-reload", detail=there)
        self._last_problems = outcome.problems

    def _asked(self) -> None:
        self._is_asked = True
        self._wanted.set()

    def _reached(self) -> None:
        self._say("relay-reached")
        self._wanted.set()

    def _lost(self, why: str) -> None:
        self._say("relay-not-reached", Severity.WARNING, detail=why)

    def _happened(self, happened: Happened) -> None:
        if self._tells_events:
            fields = {**happened.fields, "process": "relay"}
            self._write(Note(Severity(happened.severity), happened.event, fields, happened.wall_s))

    def _say(self, event: str, severity: Severity = Severity.INFO, **fields: object) -> None:
        self._write(Note(severity, event, {**fields, "process": "supervisor"}, time.time()))
