"""The relay: starts, watches and stops every line of a checked configuration."""

import asyncio
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

from msgspec.structs import asdict

import gateway
from gateway.catalogue import process_events as processes
from gateway.catalogue import starts
from gateway.catalogue import table_events as tables
from gateway.clock import boot_ns, monotonic_ns
from gateway.compensation.table import CorrectionTable
from gateway.compiled import is_compiled
from gateway.exchange.axis.axis import join_terms
from gateway.exchange.axis.record import FindTable
from gateway.exchange.commands import (
    ClearTable,
    Command,
    Disable,
    Enable,
    EndDryRun,
    SetGain,
    SetLimits,
    SetReference,
    SetTable,
    SetTemperature,
    TableFor,
    axes_of,
    for_axis,
)
from gateway.exchange.control import ControlError
from gateway.exchange.latency_status import BOUNDS_US
from gateway.exchange.limits import values_of
from gateway.exchange.line import LineExchange
from gateway.ipc.address import ROOT_UID, Peer, SocketError
from gateway.ipc.handlers import ASKED_AGAIN_S, LONGEST_WAIT_S, RequestHandlers
from gateway.ipc.log import LogEntry
from gateway.ipc.messages import (
    Done,
    GetStatus,
    GetTapes,
    Happened,
    Ping,
    Pong,
    Refused,
    Reply,
    Request,
    Status,
    Subscribe,
)
from gateway.ipc.sealed_memory import NotSealedError, map_sealed
from gateway.ipc.server import ControlServer
from gateway.limits import Reports
from gateway.recording.writer import Recorder
from gateway.relay.activity import Activity
from gateway.relay.collecting import Collecting
from gateway.relay.errors import StartError
from gateway.relay.fd_store import FdStore
from gateway.relay.journal import Journal
from gateway.relay.line import Line
from gateway.relay.pulse import Pulse
from gateway.relay.scheduling import in_force, schedule
from gateway.relay.status_unit import StatusUnit
from gateway.state.folder import why_open_to_others
from gateway.state.plan import GatewayPlan, RelayOptions, shape_of
from gateway.state.tables import HEADER_BYTES, MAX_POINTS, POINT_BYTES, WrongTableError, check_points, mapped
from gateway.state.tables import find_table as find_table_in
from gateway.status.model import GatewayStatus, RelayModel
from gateway.times import NS_PER_S
from gateway.transport.endpoints import TcpEndpoint

TICK_EVERY_S: Final = 5.0
"""Each line ages its marks of the last minute in this interval, also if no status is read."""
LARGEST_BYTES: Final = HEADER_BYTES + MAX_POINTS * POINT_BYTES
"""Of the table of one axis."""
_Result = TypeVar("_Result")


class Relay:
    """Runs a plan on the loop of its caller.

    ``write`` gets each log entry, immediately and on the hot path: it must not block
    (``ipc.log_thread.LogThread.put``). Without it :meth:`recent` returns the newest entries. ``state`` is the
    folder of its socket and of the records of its axes; without it there are none. A ``recorder`` records all
    traffic. ``find_table`` finds a table of an earlier run by its ``compensation.fingerprint.table_digest``.
    ``fd_store`` holds the sockets that a service manager keeps, ``shape`` the shape of the compiled plan. A
    relay starts once only: make another one to start again.
    """

    def __init__(
        self,
        plan: GatewayPlan,
        write: Callable[[LogEntry], None] | None = None,
        *,
        state: Path | None = None,
        recorder: Recorder | None = None,
        find_table: FindTable | None = None,
        fd_store: FdStore | None = None,
        shape: str = "",
    ) -> None:
        self._plan = plan
        self._journal = Journal(write)
        self._lines: list[Line] = []
        self._fd_store = fd_store
        self._started_ns = 0
        self._state = state
        self._control: ControlServer | None = None
        self._recorder = recorder
        self._activity = Activity()
        self._looks = self._ticks = 0
        self._next_tick: asyncio.TimerHandle | None = None
        self._tick_due_s = 0.0
        self._collecting = Collecting(lambda: not self.busy_lines, self._activity)
        self._pulse: Pulse | None = None
        """It beats from the start on; None: not started, or closed."""
        self._scheduling = in_force()
        """How the kernel schedules it. Refreshed at each tick only, because the query takes a millisecond."""
        self._shape = shape or shape_of(plan)
        self._refused_tables: Reports[str] = Reports()
        self._find_table = find_table or (None if state is None else partial(find_table_in, state))

    @property
    def name(self) -> str:
        """Name of the gateway."""
        return self._plan.name

    @property
    def shape(self) -> str:
        """Digest of its plan without the tables: it accepts only tables made for the same digest."""
        return self._shape

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of all axes, as configured."""
        return tuple(axis.name for line in self._plan.lines for axis in line.axes)

    @property
    def control_socket(self) -> Path | None:
        """The socket that receives commands."""
        return None if self._control is None else self._control.path

    @property
    def recording(self) -> Path | None:
        """The recording file; None while nothing is recorded."""
        return self._recorder.path if self._recorder is not None and self._recorder.is_on else None

    @property
    def addresses(self) -> dict[tuple[str, str], tuple[TcpEndpoint, ...]]:
        """The listening addresses by line and controller, with the ports that the system chose for 0."""
        return {
            (line.plan.name, name): addresses
            for line in self._lines
            for name, addresses in line.addresses.items()
        }

    def address(self, line: str, controller: str) -> TcpEndpoint:
        """Return the (first) address of one controller's listener."""
        return self.addresses[line, controller][0]

    async def start(self) -> None:
        """Open all listeners and ports. Drives that do not respond yet are connected in the background.

        Raises:
            StartError: names every listener and port that cannot be opened; all others are closed again.
        """
        self._started_ns = boot_ns()
        problems = self._start_recorder()
        own_unit = None
        if self._plan.status_unit:
            own_unit = StatusUnit(self._plan.status_unit, self._exchanges, self._started_ns)
        self._pulse = Pulse(self._stood_still)
        self._lines = [
            Line(plan, self._journal, self._activity, self._recorder, own_unit, pulse=self._pulse)
            for plan in self._plan.lines
        ]
        join_terms(axis for line in self._lines for axis in line.axes)
        problems += await self._open_control()
        self._take_over()
        for line in () if problems else self._lines:
            if self._state is not None:
                line.attach_records(self._state, self._find_table)
            if self._control is not None and self._control.is_after_crash:
                line.rest_first()
            problems += await line.open()
        if problems:
            for line in self._lines:
                await line.close()
            if self._recorder is not None:
                await self._recorder.discard()
            needs_silence = self._control is not None and self._control.is_after_crash
            await self._close_rest(needs_silence=needs_silence)
            raise StartError(problems)
        self._tick()

    def take_process(self) -> None:
        """Set scheduling and garbage collection of the whole process, once everything is open.

        For a caller that started a process for it, on the thread of its loop. What the system refuses is
        logged.
        """
        self._collecting.start()
        for refused in schedule(self._plan.relay, self._scheduling_withdrawn):
            self._journal.log(
                processes.SCHEDULING_REFUSED,
                key=refused.key,
                asked=refused.asked,
                detail=refused.detail,
                remedy=refused.remedy,
            )
        if self._plan.relay != RelayOptions():
            self._journal.log(processes.SCHEDULING, **asdict(in_force()))
        self._scheduling = in_force()

    async def stop(self) -> None:
        """Accept no new requests, let the exchanges on the wires end, close everything."""
        if self._control is not None:
            self._control.hang_up()  # its address stays reserved as long as its lines are open
        await asyncio.gather(*(line.stop() for line in self._lines))
        await self._close_rest(needs_silence=any(line.needs_silence for line in self._lines))

    def answer(self, request: Request, peer: Peer | None = None) -> Reply:
        """Carry out a request of the socket."""
        match request:
            case Ping():
                version, pid = gateway.__version__, os.getpid()
                return Pong(name=self.name, gateway_version=version, pid=pid, shape=self._shape)
            case GetStatus():
                return Status(status=self.status())
            case Subscribe() | GetTapes() | SetTable():
                return Refused(reason="this is answered where the connection is")  # answered earlier
            case _:
                return self._command_each(request, peer)

    def _command_each(self, command: Command, peer: Peer | None) -> Done:
        """Send a command to each axis; an axis that refuses it does not stop the others."""
        changed: dict[str, str] = {}
        problems: list[str] = []
        for axis in axes_of(command) or self.axes:
            try:
                changed |= self.command(for_axis(command, axis), peer=peer)
            except ControlError as error:
                problems.append(str(error))
        comes = {axis: how for axis, how in changed.items() if how}
        return Done(changed=tuple(changed), problems=tuple(problems), comes=comes)

    async def take_tables(
        self, command: SetTable, descriptors: Sequence[int], peer: Peer | None = None
    ) -> Done:
        """Map the tables of a command and put them into force, all of them or none.

        Frames pass while the points are compared with their digest. The caller keeps the descriptors.
        """
        try:
            with self._activity.of("a table"):
                pairs = zip(command.tables, descriptors, strict=True)
                found = [self._mapped(requested, descriptor) for requested, descriptor in pairs]
            for requested, (_, data) in zip(command.tables, found, strict=True):
                with _refused_for(requested.axis):
                    await asyncio.to_thread(check_points, data)
            with self._activity.of("a table"):
                comes = self.command(command, [table for table, _ in found], peer)
        except ControlError as error:
            self._log_refused(str(error))
            return Done(problems=(str(error),))
        return Done(changed=tuple(comes), comes=comes)

    def _mapped(self, requested: TableFor, descriptor: int) -> tuple[CorrectionTable, memoryview]:
        """Return a table by its header, and its bytes; the points are not checked yet."""
        self._line_of(requested.axis)
        with _refused_for(requested.axis):
            data = map_sealed(descriptor, LARGEST_BYTES)
            return mapped(data), data

    def command(
        self, command: Command, tables: Sequence[CorrectionTable] = (), peer: Peer | None = None
    ) -> dict[str, str]:
        """Carry out a command for one axis, or the tables of several axes on one line.

        ``peer`` sent it; None: this process.

        Returns:
            The changed axes, each with how the change comes into force.

        Raises:
            ControlError: the reason and the remedy; nothing has changed then.
        """
        lines = {id(line): line for line in map(self._line_of, axes_of(command))}
        if len(lines) > 1:
            raise ControlError("tables for axes of several lines: send a message for each line")
        [line] = lines.values()
        changed = line.command(command, tables)
        if changed:
            self._log_command(command, changed, tables, peer)
        return changed

    def _log_command(
        self,
        command: Command,
        changed: dict[str, str],
        loaded: Sequence[CorrectionTable],
        peer: Peer | None,
    ) -> None:
        """Log a command that changed something, and who sent it; temperatures are not logged."""
        if isinstance(command, SetTemperature):
            return
        who = {} if peer is None else peer.as_fields()
        more: dict[str, object] = {}
        by = "by a command"
        match command:
            case Enable():
                what = tables.ENABLED
            case Disable():
                what = tables.DISABLED
            case EndDryRun():
                what = tables.DRY_RUN_ENDED
            case SetReference():
                what = tables.REFERENCED
            case ClearTable():
                what, by = tables.TABLE_REMOVED, "its file is gone, or the configuration names none"
            case SetGain():
                what, more = tables.GAIN_CHANGED, {"forward": command.forward, "backward": command.backward}
            case SetLimits():
                what, more = tables.LIMITS_CHANGED, {**values_of(command)}
            case SetTable():
                for requested, table in zip(command.tables, loaded, strict=True):
                    self._journal.log(
                        tables.TABLE_ACTIVATED,
                        axis=requested.axis,
                        table=requested.file,
                        points=len(table.positions),
                        sha256=requested.sha256,
                        comes=changed[requested.axis],
                        **who,
                        detail="handed over",
                    )
                return
        self._journal.log(what, axes=list(changed), **more, **who, detail=by)

    def _log_refused(self, detail: str) -> None:
        """Log that a table was refused; at most once a minute."""
        if sentence := self._refused_tables.sentence("table", detail, monotonic_ns()):
            self._journal.log(tables.TABLE_REFUSED, detail=sentence)

    @property
    def busy_lines(self) -> dict[str, float]:
        """Lines with an exchange on the wire, each with the longest wait of a stop for it, in seconds."""
        return {line.plan.name: line.longest_stop_s for line in self._lines if not line.is_idle}

    def why_stuck(self, now_ns: int) -> str:
        """Return what makes no progress, "" if everything does; see ``watchdog.WatchdogFeeder``."""
        with self._activity.of("the watchdog"):
            return next((why for line in self._lines if (why := line.why_stuck(now_ns))), "")

    def log_stuck(self, why: str) -> None:
        """Log that the watchdog is not fed."""
        self._journal.log(processes.NO_PROGRESS, detail=why)

    @property
    def summary(self) -> str:
        """One short sentence about the whole relay."""
        up = sum(line.is_up for line in self._lines)
        return f"{up} of {len(self._lines)} lines up, {len(self.axes)} axes"

    def recent(self) -> tuple[LogEntry, ...]:
        """Return the newest log entries, oldest first; only if ``write`` is not given."""
        return self._journal.recent()

    def status(self) -> RelayModel:
        """Return the status model: the gateway, its lines, its axes."""
        with self._activity.of("status"):
            return self._status()

    def _status(self) -> RelayModel:
        if self._lines:  # one line each time, so that the loop is not held up
            self._looks += 1
            self._lines[self._looks % len(self._lines)].refresh_latency()
        return RelayModel(
            gateway=GatewayStatus(
                name=self._plan.name,
                version=gateway.__version__,
                compiled=is_compiled(),
                uptime_s=round((boot_ns() - self._started_ns) / NS_PER_S, 3),
                relay="up",
                snapshot_age_s=0.0,
                scheduling=self._scheduling,
                garbage=self._collecting.status(),
                loop=self._activity.status(),
                latency_bounds_us=list(BOUNDS_US),
            ),
            lines={line.plan.name: line.status() for line in self._lines},
            axes={name: axis for line in self._lines for name, axis in line.axes_status().items()},
        )

    def _tick(self) -> None:
        """Tick one line each time; not while a frame is being forwarded."""
        loop = asyncio.get_running_loop()
        if self._lines and self._is_forwarding() and loop.time() < self._tick_due_s + LONGEST_WAIT_S:
            self._next_tick = loop.call_later(ASKED_AGAIN_S, self._tick)
        elif self._lines:
            # Before the work: an error in the work must not end the ticks.
            pause_s = TICK_EVERY_S / len(self._lines)
            self._tick_due_s = loop.time() + pause_s
            self._next_tick = loop.call_later(pause_s, self._tick)
            self._ticks += 1
            self._scheduling = in_force()
            self._lines[self._ticks % len(self._lines)].tick()
            if self._control is not None and (done := self._control.renew_socket()):
                self._journal.log(processes.SOCKET_MISSING, detail=done)

    def _is_forwarding(self) -> bool:
        return any(line.is_forwarding for line in self._lines)

    def _stood_still(self, gap_ns: int) -> None:
        for line in self._lines:
            line.exchange.report_standstill(gap_ns)

    def _scheduling_withdrawn(self, why: str) -> None:
        self._scheduling = in_force()
        self._journal.log(processes.SCHEDULING_WITHDRAWN, key="relay.fifo", detail=why)

    def _publish_entry(self, entry: LogEntry) -> None:
        """Send an entry to the clients that subscribed."""
        if self._control is not None and self._control.has_listeners:
            self._control.publish_event(
                Happened(
                    event=entry.event,
                    severity=entry.severity.value,
                    fields=dict(entry.fields),
                    wall_s=entry.wall_s,
                )
            )

    def _tapes(self) -> dict[str, int]:
        """Return the descriptors of the trace buffers, each with all data until now."""
        tapes = {line.plan.name: line.trace_buffer for line in self._lines if line.trace_buffer is not None}
        for trace_buffer in tapes.values():
            trace_buffer.show()
        return {name: trace_buffer.descriptor for name, trace_buffer in tapes.items()}

    def _exchanges(self) -> list[LineExchange]:
        return [line.exchange for line in self._lines]

    def _line_of(self, axis: str) -> Line:
        for line in self._lines:
            if axis in (plan.name for plan in line.plan.axes):
                return line
        raise ControlError(f"axis {axis}: there is none of that name; there are {', '.join(self.axes)}")

    def _start_recorder(self) -> list[str]:
        if self._recorder is None:
            return []
        try:
            self._recorder.start()
        except FileExistsError:
            return [f"{starts.RECORDING_EXISTS.begin(file=self._recorder.path)}, or remove this one"]
        except OSError as error:
            found = starts.RECORDING_NOT_WRITTEN.begin(file=self._recorder.path)
            return [f"{found}: {error.strerror or error}"]
        self._recorder.on_lost = lambda why: self._journal.log(processes.RECORDING_ENDED, detail=why)
        return []

    async def _open_control(self) -> list[str]:
        if self._state is None:
            return []
        try:
            handlers = RequestHandlers(
                answer=partial(self._named, "a command", self.answer),
                hand_over=self.take_tables,
                status=self.status,
                has_to_wait=self._is_forwarding,
                tapes=self._tapes,
                complain=lambda detail: self._journal.log(processes.SOCKET_REFUSED, detail=detail),
            )
            self._control = ControlServer(self._state, handlers)
            self._journal.on_entry = self._publish_entry
            await self._control.open()
            self._check_folder(self._state)
        except SocketError as error:
            return [f"gateway.state: {error}"]
        return []

    def _take_over(self) -> None:
        """Give the lines their stored sockets and ports, and close the rest before any is opened."""
        if self._fd_store is None:
            return
        for line in self._lines:
            line.use_fd_store(self._fd_store)
        if number := self._fd_store.drop_rest():
            detail = f"{number} sockets or ports that the configuration does not have any more were closed"
            self._journal.log(processes.DESCRIPTORS_DROPPED, detail=detail)

    def _check_folder(self, state: Path) -> None:
        problem = why_open_to_others(state, frozenset((os.geteuid(), ROOT_UID)))
        if problem is not None:
            self._journal.log(processes.STATE_FOLDER_OPEN, detail=problem.found, remedy=problem.remedy)

    def _named(self, name: str, work: Callable[..., _Result], *arguments: Any) -> _Result:
        """Run work for a client, and record how long it took."""
        with self._activity.of(name):
            return work(*arguments)

    async def _close_rest(self, *, needs_silence: bool) -> None:
        if self._next_tick is not None:
            self._next_tick.cancel()
        if self._pulse is not None:
            self._pulse.close()
            self._pulse = None
        self._collecting.stop()
        if self._control is not None:
            await self._control.close(is_finished=not needs_silence)
        if self._recorder is not None:
            await self._recorder.stop()


@contextmanager
def _refused_for(axis: str) -> Iterator[None]:
    try:
        yield
    except (NotSealedError, WrongTableError) as error:
        raise ControlError(f"the table for axis {axis}: {error}") from None
