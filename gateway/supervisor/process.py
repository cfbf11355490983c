"""The supervisor as a process: loop, signals, log."""

import asyncio
import contextlib
import os
import signal
from pathlib import Path
from typing import Final

from gateway.catalogue import starts
from gateway.ipc.address import socket_path
from gateway.ipc.children import RELOADS
from gateway.ipc.log_thread import LogThread
from gateway.ipc.service_manager import ServiceManager
from gateway.ipc.structured_log import StructuredLog
from gateway.state.folder import StateError, make_folder, problem_of
from gateway.state.last_good import last_plan
from gateway.state.lock import take_lock
from gateway.state.plan import refuse_newer, writer_of
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.file_stamps import ignore_broken_leases
from gateway.supervisor.supervisor import Supervisor
from gateway.times import NS_PER_S

LOCK_NAME: Final = "supervisor.lock"
BEATS: Final = 4
"""Watchdog pulses within the service manager's timeout; a model comes every second."""
LONGEST_PAUSE_S: Final = 2.0
"""The status text that the service manager shows is at most this old."""


def run_supervisor(
    config: Path,
    state: Path,
    log: StructuredLog,
    *,
    tells_events: bool = False,
    manager: ServiceManager | None = None,
) -> None:
    """Run until SIGTERM or SIGINT; SIGHUP reads configuration and tables again.

    ``tells_events``: also log the relay's events. ``log`` is written in a thread. It gets the gateway's name
    from the last plan, then from the configuration. ``manager`` is the service manager that started this
    process.

    Raises:
        SocketError: the path of the relay's socket is too long.
        StateError: another supervisor uses the state folder, a newer release wrote it, or it is not
            accessible.
    """
    socket_path(state)  # reports a path that is too long before anything is locked
    refuse_newer(state, writer_of(state))
    ignore_broken_leases()
    lock_fd = _lock(state)
    if (last := last_plan(state)) is not None:
        log.name_gateway(last.plan.name)
    try:
        thread = LogThread(log.write)
        supervisor = Supervisor(
            config, state, thread.write, tells_events=tells_events, name_gateway=log.name_gateway
        )
        with asyncio.Runner() as runner:
            runner.run(_with_log(thread, supervisor, manager or ServiceManager()))
    finally:
        os.close(lock_fd)


def _lock(state: Path) -> int:
    """Become the only supervisor of a state folder; return the descriptor of its lock.

    Raises:
        StateError: there is one already, or the folder is not accessible.
    """
    path = state / LOCK_NAME
    try:
        make_folder(state)
        return take_lock(path)
    except BlockingIOError:
        raise StateError(
            f"{starts.SUPERVISOR_RUNS.begin(place=path)}: stop it first (run starts its own), or give this "
            "one its own folder with [gateway] state"
        ) from None
    except OSError as error:
        raise StateError(f"gateway.state: {problem_of(error, state)}") from None


async def _with_log(log: LogThread, supervisor: Supervisor, manager: ServiceManager) -> None:
    async with log:
        await _until_signalled(supervisor, manager)


async def _until_signalled(supervisor: Supervisor, manager: ServiceManager) -> None:
    loop = asyncio.get_running_loop()
    stopping = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stopping.set)
    loop.add_signal_handler(RELOADS, supervisor.reload_soon)
    running = asyncio.create_task(supervisor.run())
    stopped = asyncio.create_task(stopping.wait())
    beating = asyncio.create_task(_beat(supervisor.broadcast, manager))
    await asyncio.wait([running, stopped], return_when=asyncio.FIRST_COMPLETED)
    manager.stopping()
    for task in (stopped, beating):
        task.cancel()
    if running.done():
        running.result()  # a bug: let it end the process, so that the service manager restarts it
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running


async def _beat(broadcast: Broadcast, manager: ServiceManager) -> None:
    """Report readiness with the first model; then feed the watchdog while newer models come.

    A loop that runs but makes no new models must not feed the watchdog.
    """
    with broadcast.open() as feed:
        await feed.next()
    manager.ready(_summary(broadcast))
    every_s = min(manager.watchdog_ns / NS_PER_S / BEATS or LONGEST_PAUSE_S, LONGEST_PAUSE_S)
    shown = None
    while manager.is_there:
        if broadcast.model is not shown:
            shown = broadcast.model
            if manager.watchdog_ns:
                manager.alive(_summary(broadcast))
            else:
                manager.show_status(_summary(broadcast))
        await asyncio.sleep(every_s)


def _summary(broadcast: Broadcast) -> str:
    model = broadcast.model
    if model is None:
        return "the relay is down"
    what = "".join(f"; {alarm.where}: {alarm.what}" for alarm in model.troubles[:1])
    return f"the relay is {model.gateway.relay}{what}"
