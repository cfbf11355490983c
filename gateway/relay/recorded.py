"""A line's exchange with a listener at its border: every input with its time, then what it caused."""

from collections.abc import Callable
from dataclasses import asdict

from gateway.compensation.settings import Gain
from gateway.compiled import mypyc_attr
from gateway.exchange.control import (
    ClearTable,
    Control,
    Declare,
    EndDryRun,
    SetGain,
    SetLimits,
    SetTables,
    SetTemperature,
    Switch,
    TableChange,
)
from gateway.exchange.cut_line import RequestCutter, Wire
from gateway.exchange.limits import Limits
from gateway.exchange.line import LineExchange
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.ipc import traffic
from gateway.ipc.capture import frame_entry
from gateway.ipc.tape import ABANDONED, ANSWERED, REPLY, REQUEST, SENT, TEXT, TICK, Raw, Tape, ids_of
from gateway.relay.recorder import Recorder
from gateway.relay.timed import TimedExchange
from gateway.state.tables import checked, compiled


@mypyc_attr(allow_interpreted_subclasses=True)
class Sink:
    """Where what crosses the border of a line's exchange goes: into a file, or onto a tape."""

    def frame(self, kind: int, t_ns: int, ids: int, pdu: bytes) -> None:
        """Take what comes often, as ``ipc.tape`` has it; outputs have no ``t_ns`` (0)."""
        raise NotImplementedError

    def entry(self, entry: traffic.Entry) -> None:
        """Take what comes seldom."""
        raise NotImplementedError

    def came(self, number: int, port: ControllerPort) -> None:
        """Take note of who asks as a port, before its first request."""
        raise NotImplementedError

    def gone(self, number: int) -> None:
        """Forget a port, which asks nothing any more."""
        raise NotImplementedError

    def may_begin(self, exchange: LineExchange, now_ns: int) -> None:
        """Take note of what holds, where that is wanted; called before each request."""

    def show(self) -> None:
        """Let others see what was taken; called with each beat of the line."""


class FileSink(Sink):
    """Into a recording: everything from the start, as entries."""

    def __init__(self, line: str, recorder: Recorder) -> None:
        self._line = line
        self._recorder = recorder
        self._ports: dict[int, tuple[str, str, str]] = {}

    def frame(self, kind: int, t_ns: int, ids: int, pdu: bytes) -> None:
        """See ``Sink``."""
        self._recorder.put(frame_entry(self._line, self._ports, Raw(kind, t_ns, ids, pdu)))

    def entry(self, entry: traffic.Entry) -> None:
        """See ``Sink``."""
        self._recorder.put(entry)

    def came(self, number: int, port: ControllerPort) -> None:
        """See ``Sink``."""
        self._ports[number] = port.plan.name, port.peer, port.plan.certified

    def gone(self, number: int) -> None:
        """See ``Sink``."""
        self._ports.pop(number, None)


class TapeSink(Sink):
    """Onto the tape of a line: bytes over the oldest ones.

    Each segment of the tape tells by itself who asks, and once what holds (``beginning``): a replay may begin
    in any of them.
    """

    def __init__(self, line: str, tape: Tape, beginning: Callable[[int], traffic.Beginning]) -> None:
        self._line = line
        self._tape = tape
        self._beginning = beginning
        self._begun_in = 0
        self._ports: dict[int, traffic.Port] = {}
        self._told_in: dict[int, int] = {}
        self._t_ns = 0

    def frame(self, kind: int, t_ns: int, ids: int, pdu: bytes) -> None:
        """See ``Sink``. An output has the time of the input that caused it."""
        tape = self._tape
        if t_ns:
            self._t_ns = t_ns
        if kind == REQUEST and self._told_in.get(ids >> 24) != tape.number:
            self.entry(self._ports[ids >> 24])
            self._told_in[ids >> 24] = tape.number
        tape.put(kind, self._t_ns, ids, pdu)

    def entry(self, entry: traffic.Entry) -> None:
        """See ``Sink``."""
        self._t_ns = getattr(entry, "t", self._t_ns)  # outputs, and who a port is, have no time of their own
        self._tape.put(TEXT, self._t_ns, 0, traffic.encode(entry))

    def came(self, number: int, port: ControllerPort) -> None:
        """See ``Sink``."""
        self._ports[number] = traffic.Port(self._line, number, port.plan.name, port.peer, port.plan.certified)

    def gone(self, number: int) -> None:
        """See ``Sink``."""
        self._ports.pop(number, None)
        self._told_in.pop(number, None)

    def may_begin(self, exchange: LineExchange, now_ns: int) -> None:
        """See ``Sink``. Something holds only where nothing is on the wire, waits, or is due."""
        if self._begun_in != self._tape.number and exchange.is_still:
            self._t_ns = now_ns
            self.entry(self._beginning(now_ns))
            self._begun_in = self._tape.number

    def show(self) -> None:
        """See ``Sink``."""
        self._tape.show()


class RecordedLink(DriveLink):
    """The way to the drives, listened to."""

    def __init__(self, link: DriveLink, sink: Sink) -> None:
        super().__init__(is_serial=link.is_serial, connects=link.connects)
        self.stamps = link.stamps
        self._link = link
        self._sink = sink

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        """See ``DriveLink``."""
        self._sink.frame(SENT, 0, unit_id, pdu)
        self._link.send_request(unit_id, pdu)

    def abandon(self) -> None:
        """See ``DriveLink``."""
        self._sink.frame(ABANDONED, 0, 0, b"")
        self._link.abandon()

    def came_instead(self, unit_id: int) -> str:
        """See ``DriveLink``."""
        return self._link.came_instead(unit_id)

    def want(self) -> None:
        """See ``DriveLink``."""
        self._link.want()

    def renew(self) -> None:
        """See ``DriveLink``."""
        self._link.renew()

    def hang_up(self, *, returns: bool) -> None:
        """See ``DriveLink``."""
        self._link.hang_up(returns=returns)

    def may_lead(self, now_ns: int) -> bool:
        """See ``DriveLink``."""
        return self._link.may_lead(now_ns)

    def lead(self, piece: bytes) -> None:
        """See ``DriveLink``. What is no frame yet is not kept."""
        self._link.lead(piece)

    def leave(self, unit_id: int, pdu: bytes, rest: bytes) -> None:
        """See ``DriveLink``."""
        self._sink.frame(SENT, 0, unit_id, pdu)
        self._link.leave(unit_id, pdu, rest)


class _RecordedPort(ControllerPort):
    """A controller's port, listened to."""

    def __init__(
        self, port: ControllerPort, number: int, sink: Sink, answered: list[tuple[int, bytes]]
    ) -> None:
        super().__init__(port.plan, port.peer)
        self.ends_by_silence = port.ends_by_silence
        self.stamps = port.stamps
        self.number = number
        self._port = port
        self._sink = sink
        self._answered = answered

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """See ``ControllerPort``."""
        self._sink.frame(ANSWERED, 0, ids_of(self.number, transaction_id, unit_id), pdu)
        self._port.send_reply(transaction_id, unit_id, pdu)

    def may_lead(self, now_ns: int) -> bool:
        """See ``ControllerPort``."""
        return self._port.may_lead(now_ns)

    def lead(self, piece: bytes) -> None:
        """See ``ControllerPort``. What is no frame yet is not kept."""
        self._port.lead(piece)

    def leave(self, transaction_id: int, unit_id: int, pdu: bytes, rest: bytes) -> None:
        """See ``ControllerPort``. It is written down behind the reply of the drive, as if that were whole."""
        self._answered.append((ids_of(self.number, transaction_id, unit_id), pdu))
        self._port.leave(transaction_id, unit_id, pdu, rest)

    def note_request(self, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``ControllerPort``: as if it had been stored."""
        self._sink.frame(REQUEST, now_ns, ids_of(self.number, transaction_id, unit_id), pdu)


class RecordedExchange(TimedExchange):
    """A :class:`TimedExchange` that writes down what it is told before it acts on it."""

    def __init__(self, exchange: LineExchange, line: str, sink: Sink) -> None:
        self._sink = sink  # first: it beats from its beginning on
        super().__init__(exchange)
        self._line = line
        self._ports: dict[ControllerPort, _RecordedPort] = {}
        self._last_number = 0
        self._answered: list[tuple[int, bytes]] = []
        """What controllers were answered of a reply that the exchange has not been told of yet."""

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
        recorded = self._ports.get(port) or self._port(port)
        self._sink.may_begin(self._exchange, now_ns)
        if why_given_up:
            ids = transaction_id, unit_id
            self._sink.entry(self._given_up(recorded, ids, pdu, now_ns, why_given_up))
        else:
            self._sink.frame(REQUEST, now_ns, ids_of(recorded.number, transaction_id, unit_id), pdu)
        super().request(recorded, transaction_id, unit_id, pdu, now_ns, why_given_up=why_given_up)

    def follow(self, port: ControllerPort, wire: Wire) -> RequestCutter | None:
        """See ``TimedExchange``."""
        return None if self.cuts is None else super().follow(self._ports.get(port) or self._port(port), wire)

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``TimedExchange``."""
        self._sink.frame(REPLY, now_ns, unit_id, pdu)
        while self._answered:
            self._sink.frame(ANSWERED, 0, *self._answered.pop(0))
        super().reply(unit_id, pdu, now_ns)

    def stray(self, now_ns: int, *, unit_id: int = -1) -> None:
        """See ``TimedExchange``."""
        self._sink.entry(traffic.Stray(self._line, now_ns, unit_id >= 0, unit_id))
        super().stray(now_ns, unit_id=unit_id)

    def controller_gone(self, port: ControllerPort, now_ns: int, *, is_broken: bool = False) -> None:
        """See ``TimedExchange``. A port that never asked for anything has not been here."""
        recorded = self._ports.pop(port, None)
        if recorded is not None:
            self._sink.entry(traffic.Gone(self._line, now_ns, recorded.number, is_broken))
            self._sink.gone(recorded.number)
            super().controller_gone(recorded, now_ns, is_broken=is_broken)

    def rest_first(self, now_ns: int) -> None:
        """See ``TimedExchange``."""
        self._sink.entry(traffic.RestFirst(self._line, now_ns))
        super().rest_first(now_ns)

    def link_up(self, now_ns: int) -> None:
        """See ``TimedExchange``."""
        self._sink.entry(traffic.Up(self._line, now_ns))
        super().link_up(now_ns)

    def link_down(self, now_ns: int, reason: str = "", *, is_orderly: bool = False) -> None:
        """See ``TimedExchange``."""
        self._sink.entry(traffic.Down(self._line, now_ns, reason, is_orderly))
        super().link_down(now_ns, reason, is_orderly=is_orderly)

    def unframed(self, now_ns: int) -> None:
        """See ``TimedExchange``."""
        self._sink.entry(traffic.Unframed(self._line, now_ns))
        super().unframed(now_ns)

    async def stop(self, now_ns: int, timeout_s: float) -> None:
        """See ``TimedExchange``."""
        self._sink.entry(traffic.Stop(self._line, now_ns))
        await super().stop(now_ns, timeout_s)

    def control(self, message: Control, now_ns: int) -> dict[str, str]:
        """See ``TimedExchange``."""
        self._sink.entry(entry_of(message, self._line, now_ns))
        return super().control(message, now_ns)

    def _beat(self) -> None:
        self._sink.show()

    def _tick_exchange(self, now_ns: int) -> None:
        if self.is_due(now_ns):
            self._sink.frame(TICK, now_ns, 0, b"")
        super()._tick_exchange(now_ns)

    def _port(self, port: ControllerPort) -> _RecordedPort:
        self._last_number += 1
        recorded = self._ports[port] = _RecordedPort(port, self._last_number, self._sink, self._answered)
        self._sink.came(recorded.number, port)
        return recorded

    def _given_up(
        self, port: _RecordedPort, ids: tuple[int, int], pdu: bytes, now_ns: int, why: str
    ) -> traffic.Request:
        transaction_id, unit_id = ids
        name, peer, role = port.plan.name, port.peer, port.plan.certified
        return traffic.Request(
            self._line, now_ns, port.number, name, transaction_id, unit_id, pdu.hex(), peer, role, why
        )


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
