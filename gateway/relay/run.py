"""The relay as a process: loop, signals, log, a clean end."""

import asyncio
import contextlib
import signal
import sys
import traceback
from collections.abc import Callable, Coroutine, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from msgspec import UNSET, Struct

from gateway import system
from gateway.catalogue import process_events as events
from gateway.catalogue.entry import EventEntry
from gateway.catalogue.exchange_events import RECORD_NOT_USED, RESTORED, STREAM_BEGAN
from gateway.clock import wall_s
from gateway.compiled import is_compiled
from gateway.exchange.plan import CompensationMode
from gateway.ipc.children import RELOADS
from gateway.ipc.log import LogEntry, log_entry
from gateway.ipc.log_thread import LogThread
from gateway.ipc.service_manager import ServiceManager
from gateway.plain import JsonObject
from gateway.recording.writer import Recorder
from gateway.relay.fd_store import FdStore
from gateway.relay.gateway import Relay
from gateway.relay.watchdog import WatchdogFeeder
from gateway.state.plan import GatewayPlan
from gateway.status.line import LINE_COUNTERS
from gateway.status.model import RelayModel
from gateway.transport.loop import RelayLoop

SWITCH_INTERVAL_S: Final = 1e-4
"""How long another thread may keep the interpreter from the loop. The only others look up host names, write a
recording and write the log. The default of 5 ms would be fifty exchanges."""
WRITE_EVERY_S: Final = 0.2
AT_ONCE_S: Final = 0.5
"""Time that a stop by a second signal waits for the reader of the log."""
AT_ONCE: Final = frozenset(entry.name for entry in (RESTORED, RECORD_NOT_USED, STREAM_BEGAN))
"""Events that each start reports once: written immediately, not at the next wake-up of the log."""
AXIS_FIELDS: Final = (
    "compensation",
    "direction",
    "nominal_setpoint",
    "corrected_setpoint",
    "correction",
    "nominal_actual",
    "corrected_actual",
    "units",
)
LINE_FIELDS: Final = ("state", *(name for name, each in LINE_COUNTERS.items() if each.is_logged))
CONTROLLER_FIELDS: Final = ("crc_errors", "dropped_bytes", "malformed", "refused_connections")
UNFINISHED: Final = "an exchange was not finished: whether the drive took it is not known"
HANGUP_MEANS: Final = "SIGHUP changes nothing here: the supervisor reads the tables anew, and SIGTERM stops"
SHADOW_MEANS: Final = "corrections are computed and shown; positions pass unchanged in both directions"


class Service:
    """The service manager of this process, and what the manager kept for it."""

    def __init__(self, manager: ServiceManager, handed: Sequence[tuple[str, int]] = ()) -> None:
        self.manager = manager
        self.fd_store = FdStore(manager, handed) if manager.is_there or handed else None


def run_relay(
    plan: GatewayPlan,
    write: Callable[[LogEntry], None],
    status_every_s: float = 0.0,
    *,
    state: Path | None = None,
    recorder: Recorder | None = None,
    on_ready: Callable[[], None] | None = None,
    service: Service | None = None,
    shape: str = "",
    make_loop: Callable[[], RelayLoop] = RelayLoop,
    make_log: Callable[[Callable[[LogEntry], None]], LogThread] = LogThread,
) -> None:
    """Run until SIGTERM or SIGINT, then stop cleanly. ``status_every_s`` 0: no status lines.

    SIGHUP changes nothing: a terminal that is closed must not stop an axis.

    ``write`` writes a log entry and may block: its own thread calls it. Only the end waits for that thread,
    for ``ipc.log_thread.CLOSE_S`` seconds at most. ``state`` is the folder of the gateway's socket; a
    ``recorder`` records all traffic. ``on_ready`` is called when all listeners are open. ``service`` is this
    process as a service, ``shape`` the shape of the compiled plan (``state.plan``). A simulated system
    (``tests/year``) brings its own loop and log.

    Raises:
        StartError: a listener, a port, the socket or the recording cannot be opened.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    with asyncio.Runner(loop_factory=make_loop) as runner:
        log = make_log(write)
        service = service or Service(ServiceManager())
        relay = Relay(
            plan, noting(log), state=state, recorder=recorder, fd_store=service.fd_store, shape=shape
        )
        serving = _serve(relay, plan, _Log(log), service, status_every_s=status_every_s, on_ready=on_ready)
        runner.run(_with_log(log, serving))


def noting(log: LogThread) -> Callable[[LogEntry], None]:
    """Return a function that takes log entries of a relay, and writes those of its start immediately.

    Otherwise a relay that is killed in its first tenth of a second would not report what it did with its
    records. Any other entry costs one append, and is written within ``WRITE_EVERY_S``: waking the log thread
    on the hot path costs too much.
    """
    is_due = False

    def take(made: LogEntry) -> None:
        nonlocal is_due
        log.put(made)
        if made.event in AT_ONCE:
            log.wake()
        elif not is_due:
            is_due = True
            asyncio.get_running_loop().call_later(WRITE_EVERY_S, write)

    def write() -> None:
        nonlocal is_due
        is_due = False
        log.wake()

    return take


async def _serve(
    relay: Relay,
    plan: GatewayPlan,
    log: "_Log",
    service: Service,
    *,
    status_every_s: float,
    on_ready: Callable[[], None] | None,
) -> None:
    loop = asyncio.get_running_loop()
    stopping = asyncio.Event()

    def stop() -> None:
        if stopping.is_set():
            _end_at_once(relay, log)
        stopping.set()
        service.manager.stopping(max(relay.busy_lines.values(), default=0.0))
        log.stopping(relay)

    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop)
    loop.add_signal_handler(RELOADS, log.hangup)
    loop.set_exception_handler(log.unexpected)
    log.plan(plan)
    await relay.start()
    log.ready(relay)
    relay.take_process()
    if on_ready is not None:
        on_ready()
    service.manager.ready(relay.summary)
    feeder = WatchdogFeeder(service.manager, relay.why_stuck, relay.log_stuck, lambda: relay.summary)
    status = asyncio.create_task(_status_lines(relay, log, status_every_s))
    await stopping.wait()
    feeder.stop()
    status.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await status
    await relay.stop()
    log.log(events.STOPPED)


async def _with_log(thread: LogThread, serving: Coroutine[None, None, None]) -> None:
    """Serve while the log is written, and write the rest of it afterwards."""
    async with thread:
        await serving


async def _status_lines(relay: Relay, log: "_Log", every_s: float) -> None:
    while every_s > 0:
        await asyncio.sleep(every_s)
        log.status(relay.status())


def _end_at_once(relay: Relay, log: "_Log") -> None:
    """End the process without any wait; the system closes sockets and ports."""
    lines = list(relay.busy_lines)
    detail = f"a second signal; {UNFINISHED}" if lines else "a second signal"
    log.log(events.STOPPED_AT_ONCE, lines=lines, detail=detail)
    log.thread.close(AT_ONCE_S)
    # An orderly end of the loop would wait for tasks, and for a thread that looks up a host name.
    system.end_now(1)


class _Log:
    """Log entries about the process itself; they follow what the relay logged before."""

    def __init__(self, thread: LogThread) -> None:
        self.thread = thread
        self._lines: dict[str, str] = {}
        """The line of each axis."""

    def log(self, event: EventEntry, **fields: Any) -> None:
        self.thread.write(log_entry(event, fields, wall_s()))

    def unexpected(self, _loop: asyncio.AbstractEventLoop, context: Mapping[str, Any]) -> None:
        """Log what the loop would print itself, and block: a bug of this program, or no free descriptor."""
        error = context.get("exception")
        where = "".join(traceback.format_exception(error)) if isinstance(error, BaseException) else ""
        self.log(events.UNEXPECTED, detail=context.get("message", ""), traceback=where)

    def hangup(self) -> None:
        self.log(events.HANGUP_IGNORED, detail=HANGUP_MEANS)

    def stopping(self, relay: Relay) -> None:
        busy = relay.busy_lines
        waits = "no exchange is on a wire"
        if busy:
            waits = f"waits up to {max(busy.values()):g} s for the exchange on {', '.join(busy)} to end"
        self.log(events.STOPPING, lines=list(busy), detail=f"{waits}; a second signal ends it immediately")

    def plan(self, plan: GatewayPlan) -> None:
        self.log(events.STARTING, gateway=plan.name, compiled=is_compiled())
        for line in plan.lines:
            controllers = [f"{link.plan.name} ({link.plan.role.value})" for link in line.controllers]
            self.log(events.LINE, line=line.name, drives=str(line.drives), controllers=controllers)
            for axis in line.axes:
                self._lines[axis.name] = line.name
                self.log(
                    events.AXIS,
                    line=line.name,
                    axis=axis.name,
                    unit_id=axis.unit_id,
                    compensation=axis.compensation.value,
                    table=axis.table_name or None,
                )
                if axis.compensation is CompensationMode.SHADOW:
                    self.log(events.SHADOW, line=line.name, axis=axis.name, detail=SHADOW_MEANS)

    def ready(self, relay: Relay) -> None:
        addresses = {
            f"{line}/{controller}": [str(address) for address in where]
            for (line, controller), where in relay.addresses.items()
        }
        socket = {"socket": str(relay.control_socket)} if relay.control_socket else {}
        recording = {"recording": str(relay.recording)} if relay.recording else {}
        self.log(events.READY, addresses=addresses, **socket, **recording)

    def status(self, status: RelayModel) -> None:
        for name, axis in status.axes.items():
            self.log(events.STATUS, line=self._lines[name], axis=name, **_picked(axis, AXIS_FIELDS))
        for name, line in status.lines.items():
            heard = {each.name: _picked(each, CONTROLLER_FIELDS) for each in line.controllers}
            self.log(events.STATUS, line=name, **_picked(line, LINE_FIELDS), controllers=heard)


def _picked(part: Struct, names: tuple[str, ...]) -> JsonObject:
    """Return the named fields of a part of the status, without those that are unset."""
    values = {name: getattr(part, name) for name in names}
    return {name: value for name, value in values.items() if value is not UNSET}
