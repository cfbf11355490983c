"""A line's exchange with a recorder at its border: every input with its time, then what it caused."""

from dataclasses import asdict

from gateway.compensation.settings import Gain
from gateway.exchange.control import (
    ClearTable,
    Control,
    Declare,
    EndDryRun,
    Limits,
    SetGain,
    SetLimits,
    SetTables,
    SetTemperature,
    Switch,
    TableChange,
)
from gateway.exchange.line import LineExchange
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.ipc import traffic
from gateway.ipc.compiled_table import checked, compiled
from gateway.relay.recorder import Recorder
from gateway.relay.timed import TimedExchange


class RecordedLink(DriveLink):
    """The way to the drives, listened to."""

    def __init__(self, link: DriveLink, line: str, recorder: Recorder) -> None:
        super().__init__(is_serial=link.is_serial)
        self.stamps = link.stamps
        self._link = link
        self._line = line
        self._recorder = recorder

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        """See ``DriveLink``."""
        self._recorder.put(traffic.Sent(self._line, unit_id, pdu.hex()))
        self._link.send_request(unit_id, pdu)

    def abandon(self) -> None:
        """See ``DriveLink``."""
        self._recorder.put(traffic.Abandoned(self._line))
        self._link.abandon()


class _RecordedPort(ControllerPort):
    """A controller's port, listened to."""

    def __init__(self, port: ControllerPort, number: int, line: str, recorder: Recorder) -> None:
        super().__init__(port.plan, port.peer)
        self.stamps = port.stamps
        self.number = number
        self._port = port
        self._line = line
        self._recorder = recorder

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """See ``ControllerPort``."""
        self._recorder.put(traffic.Answered(self._line, self.number, transaction_id, unit_id, pdu.hex()))
        self._port.send_reply(transaction_id, unit_id, pdu)


class RecordedExchange(TimedExchange):
    """A :class:`TimedExchange` that writes down what it is told before it acts on it."""

    def __init__(self, exchange: LineExchange, line: str, recorder: Recorder) -> None:
        super().__init__(exchange)
        self._line = line
        self._recorder = recorder
        self._ports: dict[ControllerPort, _RecordedPort] = {}
        self._last_number = 0

    def request(
        self,
        port: ControllerPort,
        transaction_id: int,
        unit_id: int,
        pdu: bytes,
        now_ns: int,
        *,
        why_given_up: str = "",
    ) -> None:
        """See ``TimedExchange``."""
        recorded = self._port(port)
        plan = port.plan
        self._recorder.put(
            traffic.Request(
                self._line,
                now_ns,
                recorded.number,
                plan.name,
                transaction_id,
                unit_id,
                pdu.hex(),
                port.peer,
                plan.certified,
                why_given_up,
            )
        )
        super().request(recorded, transaction_id, unit_id, pdu, now_ns, why_given_up=why_given_up)

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``TimedExchange``."""
        self._recorder.put(traffic.Reply(self._line, now_ns, unit_id, pdu.hex()))
        super().reply(unit_id, pdu, now_ns)

    def stray(self, now_ns: int, *, is_frame: bool = False) -> None:
        """See ``TimedExchange``."""
        self._recorder.put(traffic.Stray(self._line, now_ns, is_frame))
        super().stray(now_ns, is_frame=is_frame)

    def controller_gone(self, port: ControllerPort, now_ns: int) -> None:
        """See ``TimedExchange``. A port that never asked for anything has not been here."""
        recorded = self._ports.pop(port, None)
        if recorded is not None:
            self._recorder.put(traffic.Gone(self._line, now_ns, recorded.number))
            super().controller_gone(recorded, now_ns)

    def rest_first(self, now_ns: int) -> None:
        """See ``TimedExchange``."""
        self._recorder.put(traffic.RestFirst(self._line, now_ns))
        super().rest_first(now_ns)

    def link_up(self, now_ns: int) -> None:
        """See ``TimedExchange``."""
        self._recorder.put(traffic.Up(self._line, now_ns))
        super().link_up(now_ns)

    def link_down(self, now_ns: int) -> None:
        """See ``TimedExchange``."""
        self._recorder.put(traffic.Down(self._line, now_ns))
        super().link_down(now_ns)

    async def stop(self, now_ns: int, timeout_s: float) -> None:
        """See ``TimedExchange``."""
        self._recorder.put(traffic.Stop(self._line, now_ns))
        await super().stop(now_ns, timeout_s)

    def control(self, message: Control, now_ns: int) -> dict[str, str]:
        """See ``TimedExchange``."""
        self._recorder.put(entry_of(message, self._line, now_ns))
        return super().control(message, now_ns)

    def _due(self, now_ns: int) -> None:
        if self.is_due(now_ns):
            self._recorder.put(traffic.Tick(self._line, now_ns))
        super()._due(now_ns)

    def _port(self, port: ControllerPort) -> _RecordedPort:
        recorded = self._ports.get(port)
        if recorded is None:
            self._last_number += 1
            recorded = self._ports[port] = _RecordedPort(port, self._last_number, self._line, self._recorder)
        return recorded


def entry_of(message: Control, line: str, now_ns: int) -> traffic.ControlInput:
    """Return what a recording says of a message; of tables all points, or nobody could replay it."""
    match message:
        case Switch(axis=axis):
            return traffic.Control(line, now_ns, "enable" if message.is_wanted else "disable", axis)
        case EndDryRun(axis=axis):
            return traffic.Control(line, now_ns, "end-dry-run", axis)
        case Declare(axis=axis):
            return traffic.Control(line, now_ns, "reference", axis)
        case ClearTable(axis=axis):
            return traffic.Control(line, now_ns, "clear-table", axis)
        case SetTables(changes=changes):
            tables = [
                traffic.Table(each.axis, each.name, each.format, each.digest, compiled(each.table))
                for each in changes
            ]
            return traffic.Tables(line, now_ns, tuple(tables))
        case SetGain(axis=axis, gain=gain):
            return traffic.Share(line, now_ns, axis, gain.forward, gain.backward, message.is_configured)
        case SetLimits(axis=axis):
            return traffic.Limits(line, now_ns, axis, **asdict(message.limits))
        case SetTemperature(axis=axis):
            return traffic.Temperature(line, now_ns, axis, message.celsius)


def message_of(entry: traffic.ControlInput) -> Control | None:
    """Return the message that a recording tells of; None where it is of a command that is not known.

    Raises:
        WrongTableError: a table in it is of another release.
    """
    match entry:
        case traffic.Tables():
            found = [TableChange(t.axis, checked(t.data), t.file, t.format, t.sha256) for t in entry.tables]
            return SetTables(tuple(found))
        case traffic.Share(axis=axis):
            return SetGain(axis, Gain(entry.forward, entry.backward), entry.is_alone)
        case traffic.Limits(axis=axis):
            limits = (entry.max_correction, entry.max_slope, entry.travel_margin, entry.budget_us)
            return SetLimits(axis, Limits(*limits))
        case traffic.Temperature(axis=axis):
            return SetTemperature(axis, entry.celsius)
        case traffic.Control(command="enable" | "disable", axis=axis):
            return Switch(axis, is_wanted=entry.command == "enable")
        case traffic.Control(command="end-dry-run", axis=axis):
            return EndDryRun(axis)
        case traffic.Control(command="reference", axis=axis):
            return Declare(axis)
        case traffic.Control(command="clear-table", axis=axis):
            return ClearTable(axis)
    return None
