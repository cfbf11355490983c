"""One line: its controllers, the exchange between, and the link to the drives."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from gateway import system
from gateway.catalogue.line_events import (
    ADAPTER_ECHOES,
    DRIVES_NOT_REACHED,
    FRAMES_NOT_KEPT,
    LINE_RESTS,
    OTHER_TRANSACTION_ID,
    SERIAL_LATENCY,
    WRONG_UNIT,
)
from gateway.clock import boot_ns, now_utc
from gateway.compensation.settings import Gain
from gateway.compensation.table import CorrectionTable
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.record import FindTable
from gateway.exchange.commands import (
    ClearTable,
    Command,
    EndDryRun,
    SetGain,
    SetLimits,
    SetTable,
    axes_of,
)
from gateway.exchange.cut_through.forward import SerialTiming
from gateway.exchange.latency_status import LatencyStatus
from gateway.exchange.limits import limits_of, values_of
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import AxisPlan, CompensationMode
from gateway.exchange.ports import OwnUnit
from gateway.exchange.status import axes_status, line_status
from gateway.exchange.tap import Tap
from gateway.plain import JsonObject
from gateway.recording import traffic
from gateway.recording.tap import FileTap, TraceTap
from gateway.recording.trace_buffer import TraceBuffer
from gateway.recording.writer import Recorder
from gateway.relay.activity import Activity
from gateway.relay.alarm import LineAlarm
from gateway.relay.axis_record import AxisRecord, record_path
from gateway.relay.computed import computed
from gateway.relay.controller import Controller, make_controller, wire_of
from gateway.relay.drive_link import Instead, Link, MbapDriveLink, OtherIds, ReplyUnitIds, RtuDriveLink
from gateway.relay.fd_store import FdStore, store_port
from gateway.relay.journal import Journal
from gateway.relay.last_minute import LastMinute
from gateway.relay.pulse import Pulse
from gateway.relay.watchdog import STUCK_NS
from gateway.state.plan import LinePlan
from gateway.state.tables import compiled
from gateway.status.axis import AxisStatus
from gateway.status.line import ControllerStatus, DrivesStatus, LineMinute, LineStatus, UnitStatus
from gateway.times import NS_PER_MS, NS_PER_S
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.errors import TransportError
from gateway.transport.framing import endpoint_key, frame_silence_ns, reply_decoder, returns_requests
from gateway.transport.serial import SerialPort
from gateway.transport.tcp import TcpConnector

STOP_MARGIN_S: Final = 1.0
"""Added to the longest exchange. A stop that waits longer has met a bug, and ends anyway."""
NOTHING: Final = Instead()
"""Nothing came instead of replies."""


class Line:
    """A bus of drives with its controllers, from the configuration to open sockets and ports."""

    def __init__(
        self,
        plan: LinePlan,
        journal: Journal,
        activity: Activity,
        recorder: Recorder | None = None,
        own_unit: OwnUnit | None = None,
        *,
        pulse: Pulse,
    ) -> None:
        self.plan = plan
        self._pulse = pulse
        self.trace_buffer = (
            _make_trace_buffer(plan, journal) if recorder is None and plan.tape_bytes else None
        )
        """The traffic of its last minutes."""
        if self.trace_buffer is not None:
            pulse.on_beat.append(self.trace_buffer.show)
        self._journal = journal
        self._link = _make_link(plan, self._wrong_unit, self._other_id, self._returned)
        self._drives = self._make_drives()
        self._exchange = LineExchange(
            plan.axes,
            plan.timing,
            self._link,
            lambda event: journal.exchange_event(plan.name, event),
            groups=plan.groups,
            other_units=plan.other_units,
            what_ran=activity.between,
            own_unit=own_unit,
            cut_through=_forwarding_wire(plan),
            tap=self._make_tap(recorder),
        )
        self._latency = LatencyStatus(self._exchange.meter)
        self._minute = LastMinute(self._frames)
        self._computed = computed(plan)
        self._alarm = LineAlarm(self._exchange, lambda: self._link.bytes_received)
        self._link.attach(self._exchange)
        self._in_force: dict[tuple[str, tuple[str, ...]], traffic.Commanded] = {}
        """What commands have changed since the start, for the trace buffer."""
        self._records: dict[str, AxisRecord] = {}
        self._loaded_at = {axis.name: _now() for axis in plan.axes if axis.table is not None}
        """When the table of an axis was loaded, in ISO 8601."""
        self._configured = {axis.name: _configured(axis) for axis in plan.axes}
        """Gain, limits and mode of the configuration; a command may have changed the gain since."""
        self._is_recorded = recorder is not None
        odd_units = plan.other_units.odd
        self._controllers = [
            make_controller(plan.name, link, self._exchange, journal, beats=pulse, odd_units=odd_units)
            for link in plan.controllers
        ]

    @property
    def addresses(self) -> dict[str, tuple[TcpEndpoint, ...]]:
        """The listening addresses of each controller that connects over TCP."""
        return {
            controller.plan.name: controller.addresses
            for controller in self._controllers
            if controller.addresses
        }

    @property
    def exchange(self) -> LineExchange:
        """Its exchange, with the state of drives and axes; for reading only."""
        return self._exchange

    @property
    def axes(self) -> Sequence[Axis]:
        """Its axes."""
        return self._exchange.axes

    @property
    def is_up(self) -> bool:
        """Whether the drives can be reached; an idle connection that is made on demand counts as up."""
        return self._exchange.is_up or (self._exchange.serves and not self._drives.failure)

    @property
    def is_idle(self) -> bool:
        """Whether no exchange is on the wire."""
        return self._exchange.is_idle

    @property
    def is_forwarding(self) -> bool:
        """Whether a frame is being forwarded: a long task of the loop would leave a gap in it."""
        forwarding = self._exchange.forwarding
        return forwarding is not None and forwarding.is_leaving

    @property
    def longest_stop_s(self) -> float:
        """The longest time that a stop waits for the exchange on the wire."""
        return self._longest_exchange_s() + STOP_MARGIN_S

    def attach_records(self, state: Path, find_table: FindTable | None = None) -> None:
        """Keep a record of each axis in this folder, and use those of the previous run where they are valid.

        A recorded run does not use them, so that its replay begins in the same state.
        """
        for axis in self._exchange.axes:
            record = AxisRecord(axis, record_path(state, axis.plan.name))
            record.open(
                partial(self._journal.record_not_used, self.plan.name, axis.plan.name),
                find_table,
                is_used=not self._is_recorded,
            )
            self._records[axis.plan.name] = record

    def use_fd_store(self, fd_store: FdStore) -> None:
        """Take the stored descriptors of this line, and store the new ones; call it before :meth:`open`."""
        for controller in self._controllers:
            controller.use_slot(fd_store.slot(self.plan.name, controller.plan.name, controller.endpoint))
        if isinstance(self._drives, SerialPort) and isinstance(self.plan.drives, SerialEndpoint):
            slot = fd_store.slot(self.plan.name, "", self.plan.drives)
            # The port stayed open: a drive may still answer a request of the previous gateway.
            if store_port(self._drives, self.plan.drives, slot):
                self._exchange.rest_first(boot_ns())

    def why_stuck(self, now_ns: int) -> str:
        """Return what makes no progress on this line, "" if all is well. An idle line is well."""
        if self._alarm.late_ns(now_ns) > STUCK_NS:
            return f"line {self.plan.name}: what was due more than {STUCK_NS // NS_PER_S} s ago was not done"
        if not self._drives.is_kept_up:
            return f"line {self.plan.name}: {self.plan.drives} is not kept open any more"
        return next(
            (f"line {self.plan.name}: {why}" for each in self._controllers if (why := each.why_stuck())), ""
        )

    @property
    def needs_silence(self) -> bool:
        """Whether a drive may still answer a request of this gateway; read it when the line is closed."""
        return self._exchange.needs_silence

    def rest_first(self) -> None:
        """Wait for silence before the first frame; call before :meth:`open`. Modbus/TCP needs none (W6)."""
        if self._link.is_serial:
            self._exchange.rest_first(boot_ns())
            self._journal.log(
                LINE_RESTS,
                line=self.plan.name,
                detail="the gateway before this one left something unanswered, and a drive may still answer "
                f"it: waiting for {self._exchange.rest.drain_ms:g} ms of silence",
            )

    async def open(self) -> list[str]:
        """Open listeners and ports; return one line with the key for each that cannot be opened.

        Drives and serial ports that are absent are no problem: the line waits for them.
        """
        problems: list[str] = []
        for number, (controller, link) in enumerate(
            zip(self._controllers, self.plan.controllers, strict=True), start=1
        ):
            listener_key = f"controllers[{number}].{endpoint_key(link.endpoint)}"
            await self._open(controller, f"line.{self.plan.name}.{listener_key} ({link.plan.name})", problems)
        key = endpoint_key(self.plan.drives)
        await self._open(self._drives, f"line.{self.plan.name}.drives.{key}", problems)
        return problems

    async def stop(self) -> None:
        """Stop cleanly: the exchange on the wire ends, no frame is left half sent."""
        for controller in self._controllers:
            controller.stop_accepting()
        self._exchange.stop(boot_ns())
        await self._alarm.idle(self.longest_stop_s)
        for controller in self._controllers:
            await controller.drained()
        await self.close()

    async def close(self) -> None:
        """Close everything immediately."""
        for record in self._records.values():
            record.close()  # first: closing the drive link now is no event of the axes
        for controller in self._controllers:
            await controller.close()
        await self._drives.close()
        self._alarm.close()
        self._link.close()
        if self.trace_buffer is not None:
            self._pulse.on_beat.remove(self.trace_buffer.show)
            self.trace_buffer.close()
            self.trace_buffer = None

    def status(self) -> LineStatus:
        """Return this line's part of the status model."""
        now_ns = boot_ns()
        status = line_status(self._exchange, now_ns)
        minute = self._minute.grown(now_ns)
        for unit_id, drive in status.unit_ids.drives.items():
            self._add_damage(drive, int(unit_id))
            drive.damaged_minute = minute.get(unit_id, 0)
        status.state = "up" if self.is_up else "down"
        status.minute = LineMinute(
            exchanges=minute["exchanges"],
            damaged=minute.get("damaged", 0),
            malformed=minute.get("malformed", 0),
        )
        self._latency.fill_line(status)
        status.computed = self._computed
        for name, count in self._link.counters().items():
            setattr(status, name, count)
        status.drives = DrivesStatus(
            echo=returns_requests(self.plan.drives) if self._link.returns_requests else "",
            address=str(self.plan.drives),
            failure=self._drives.failure,
            opens=self._drives.opens,
            notes=list(self._drives.notes),
            latency=self._drives.latency,
        )
        status.controllers = [self._controller_status(controller) for controller in self._controllers]
        return status

    def _add_damage(self, drive: UnitStatus, unit_id: int) -> None:
        """Add what came instead of replies."""
        damage = self._link.damage.get(unit_id, NOTHING)
        drive.damaged = damage.total
        drive.damaged_in_a_row = damage.among(drive.timeouts_in_a_row)
        other_ids = self._link.other_ids.get(unit_id)
        if other_ids is not None:
            drive.other_ids_in_a_row = other_ids.among(drive.timeouts_in_a_row)
            drive.answers_with = str(other_ids)

    def _controller_status(self, controller: Controller) -> ControllerStatus:
        status = controller.status()
        status.refused = self._exchange.counters.refused_by.get(controller.plan.name, 0)
        self._latency.fill_controller(status)
        return status

    def tick(self) -> None:
        """Age the high marks of the last minute; report silent sensors and certificates that expire soon.

        To be called at least every ten seconds.
        """
        now_ns = boot_ns()
        self._exchange.meter.tick(now_ns)
        self._minute.tick(now_ns)
        for axis in self._exchange.axes:
            terms = axis.correction.terms
            for event in () if terms is None else terms.events(axis.plan.name, now_ns):
                self._journal.exchange_event(self.plan.name, event)
        for record in self._records.values():
            record.try_again(time.monotonic())
        now = now_utc()
        for controller in self._controllers:
            controller.tick(now)

    def refresh_latency(self) -> None:
        """Recalculate some of the measured times."""
        self._latency.refresh(boot_ns())

    def axes_status(self) -> dict[str, AxisStatus]:
        """Return the status of each axis on this line, by name."""
        status = axes_status(self._exchange, boot_ns())
        for name, of_axis in status.items():
            of_axis.latency = self._latency.axis(name)
            of_axis.configured = self._configured[name]
            of_axis.table.loaded_at = self._loaded_at.get(name)
            if name in self._records:
                of_axis.record_problem = self._records[name].problem or None
        return status

    def command(self, command: Command, tables: Sequence[CorrectionTable] = ()) -> dict[str, str]:
        """Carry out a command; see ``exchange.control.carry_out``. Raises ControlError."""
        changed = self._exchange.command(command, boot_ns(), tables)
        if self.trace_buffer is not None and command.stays:
            self._remember_in_force(command, tables)
        match command:
            case SetTable():
                self._loaded_at |= dict.fromkeys(changed, _now())
                for each in self._exchange.axes:  # one that had no table has no record yet
                    name = each.plan.name
                    if name in changed and name in self._records and each.recall.record is None:
                        self._records[name].begin()
            case ClearTable():
                for name in changed:
                    self._loaded_at.pop(name, None)
            case SetGain(axes=(axis,), is_configured=True):
                self._configured[axis] |= {"gain": _shares(Gain(command.forward, command.backward))}
            case EndDryRun():
                for axis in changed:
                    self._configured[axis] |= {"compensation": CompensationMode.ON.value}
                    if axis in self._records:
                        self._records[axis].begin()
            case SetLimits(axis=axis):
                self._configured[axis] |= values_of(command)
        return changed

    async def _open(self, way: Controller | SerialPort | TcpConnector, key: str, problems: list[str]) -> None:
        try:
            await way.open()
        except TransportError as error:
            problems.append(f"{key}: {error.detail}")

    def _make_tap(self, recorder: Recorder | None) -> Tap | None:
        if recorder is not None:
            return FileTap(self.plan.name, recorder)
        return (
            None
            if self.trace_buffer is None
            else TraceTap(self.plan.name, self.trace_buffer, self._beginning)
        )

    def _beginning(self, now_ns: int) -> traffic.Beginning | None:
        """Return the state that a replay from here needs; None: a replay cannot begin during an exchange."""
        if not self._exchange.is_still:
            return None
        records = {name: record.content() for name, record in self._records.items()}
        axes = tuple(
            traffic.AxisAt(
                axis.plan.name,
                records.get(axis.plan.name, b""),
                None if axis.motion.actual is None else float(axis.motion.actual.counts),
                axis.reference.is_found,
                axis.reference.bit_seen_ns,
            )
            for axis in self._exchange.axes
        )
        in_force = tuple(self._in_force.values())
        state = self._exchange.link_state
        return traffic.Beginning(
            self.plan.name,
            now_ns,
            axes,
            self._exchange.is_up,
            system.boot_id(),
            in_force,
            state.up_ns,
            state.closes_soon,
            state.has_closed_soon,
        )

    def _remember_in_force(self, command: Command, tables: Sequence[CorrectionTable]) -> None:
        """Keep the latest change of each kind for each axis."""
        key = command.stays, axes_of(command)
        self._in_force.pop(key, None)
        data = tuple(map(compiled, tables))
        self._in_force[key] = traffic.Commanded(self.plan.name, boot_ns(), command, data)

    def _make_drives(self) -> SerialPort | TcpConnector:
        endpoint, link = self.plan.drives, self._link
        if isinstance(endpoint, SerialEndpoint):
            return SerialPort(endpoint, link, self._drives_failed, self._drives_slow)
        connector = TcpConnector(
            endpoint,
            link,
            self._drives_failed,
            was_of_use=self._was_of_use,
            on_demand=self.plan.timing.connects_on_demand,
        )
        link.over(connector)
        return connector

    def _was_of_use(self, made_ns: int) -> bool:
        """Whether a connection gave a reply, or lasted more than a second without a request."""
        has_answered = self._exchange.silent_units.last_answered_ns >= made_ns
        return has_answered or (not self._link.was_asked and boot_ns() - made_ns > NS_PER_S)

    def _frames(self) -> dict[str, int]:
        """Return the frame counters: replies and damage, and the damage of each unit id."""
        return {
            "exchanges": self._exchange.counters.exchanges,
            "damaged": self._link.counters().get("damaged", 0),
            "malformed": self._link.counters().get("malformed", 0),
            **{str(unit_id): damage.total for unit_id, damage in self._link.damage.items()},
        }

    def _wrong_unit(self, asked: int, answered: int) -> None:
        detail = f"asked for unit id {asked}, the drive answered as unit id {answered}"
        self._journal.log(WRONG_UNIT, line=self.plan.name, detail=detail)

    def _other_id(self, unit_id: int, other_ids: OtherIds) -> None:
        detail = f"unit id {unit_id} {other_ids}: its replies answer nothing"
        self._journal.log(OTHER_TRANSACTION_ID, line=self.plan.name, detail=detail)

    def _returned(self) -> None:
        detail = f"{self.plan.drives}: {returns_requests(self.plan.drives)}"
        self._journal.log(ADAPTER_ECHOES, line=self.plan.name, detail=detail)

    def _drives_failed(self, why: str) -> None:
        self._journal.log(DRIVES_NOT_REACHED, line=self.plan.name, detail=why)

    def _drives_slow(self, why: str) -> None:
        self._journal.log(SERIAL_LATENCY, line=self.plan.name, detail=why)

    def _longest_exchange_s(self) -> float:
        patience_ms = [link.plan.timeout_ms for link in self.plan.controllers]
        return max(self.plan.timing.response_timeout_ms, *patience_ms, 0.0) / 1000.0


def _make_trace_buffer(plan: LinePlan, journal: Journal) -> TraceBuffer | None:
    try:
        return TraceBuffer(plan.name, plan.tape_bytes, boot_ns(), system.wall_ns())
    except OSError as error:
        why = error.strerror or str(error)
        journal.log(FRAMES_NOT_KEPT, line=plan.name, detail=f"no memory for them: {why}")
        return None


def _configured(plan: AxisPlan) -> JsonObject:
    mode = plan.compensation.value
    return {"gain": _shares(plan.settings.gain), "compensation": mode, **values_of(limits_of(plan))}


def _shares(gain: Gain) -> dict[str, float]:
    return {"forward": gain.forward, "backward": gain.backward}


def _now() -> str:
    return now_utc().isoformat(timespec="seconds")


def _make_link(
    plan: LinePlan,
    on_wrong_unit: Callable[[int, int], None],
    on_other_id: Callable[[int, OtherIds], None],
    on_return: Callable[[], None],
) -> Link:
    gap_ns = int(plan.timing.gap_ms * NS_PER_MS)
    if isinstance(plan.drives, TcpEndpoint) and not plan.drives.rtu:
        unit_ids = {axis.unit_id for axis in plan.axes}.union(plan.other_units.unit_ids)
        return MbapDriveLink(
            gap_ns, ReplyUnitIds(len(unit_ids) > 1, plan.answers_as), on_wrong_unit, on_other_id
        )
    wire_gap_ns = frame_silence_ns(plan.drives) if isinstance(plan.drives, SerialEndpoint) else 0
    refused_reads = {axis.unit_id: 0 for axis in plan.axes}
    refused_reads |= {axis.unit_id: axis.refused_read for axis in plan.axes if axis.refused_read}
    has_echo = isinstance(plan.drives, SerialEndpoint) and plan.drives.echo
    decoder = reply_decoder(plan.drives, refused_reads, plan.other_units.odd)
    return RtuDriveLink(gap_ns, decoder, wire_gap_ns, has_echo=has_echo, on_return=on_return)


def _forwarding_wire(plan: LinePlan) -> SerialTiming | None:
    """Return the wire of the drives if the line forwards frames on it, else None."""
    if plan.cut_through and isinstance(plan.drives, SerialEndpoint):
        return wire_of(plan.drives)
    return None
