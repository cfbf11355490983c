"""Replay of a recording in a new exchange: equal inputs at equal times must cause equal bytes."""

import contextlib
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from gateway.exchange.axis.axis import Axis, join_terms
from gateway.exchange.axis.record import Record, digest_of_axis
from gateway.exchange.axis.record_layout import RECORD_SIZE, RecordSlots
from gateway.exchange.commands import SetReference
from gateway.exchange.control import ControlError
from gateway.exchange.events import Event
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan
from gateway.exchange.ports import ControllerPort, DriveLink, OwnUnit
from gateway.modbus.pdu import ExceptionCode, FunctionCode, exception_pdu
from gateway.modbus.registers import BitTable
from gateway.plain import JsonObject
from gateway.recording import traffic
from gateway.recording.readable import output_words
from gateway.state.plan import GatewayPlan, LinePlan
from gateway.state.tables import WrongTableError, checked
from gateway.times import NS_PER_MS
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

Numbered = tuple[int, traffic.Entry]
"""An entry with its line in the file."""
KEPT_DIFFERENCES: Final = 10
"""Only the first ones matter: later differences mostly follow from them."""


class ReplayError(Exception):
    """A recording that this configuration cannot replay; the text has the reason and the remedy."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One output that differs from the recording.

    ``entry`` is the line in the file of the input that caused it. ``file_line`` is that of the recorded
    output, or of the input if no output was recorded.
    """

    entry: int
    file_line: int
    t: int
    line: str
    expected: traffic.Output | None
    got: traffic.Output | None

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return {
            "entry": self.entry,
            "file_line": self.file_line,
            "t": self.t,
            "line": self.line,
            "expected": None if self.expected is None else output_words(self.expected),
            "got": None if self.got is None else output_words(self.got),
        }

    def __str__(self) -> str:
        return (
            f"at {self.t} ns on line {self.line}: expected {output_words(self.expected)}, "
            f"got {output_words(self.got)}"
        )


@dataclass(slots=True)
class ReplayResult:
    """The result of a replay."""

    inputs: int = 0
    outputs: int = 0
    """Recorded outputs that were compared."""
    different: int = 0
    first: list[Difference] = field(default_factory=list)
    is_truncated: bool = False
    before: int = 0
    """Number of entries of a capture before its first known state: they are not compared."""

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return {
            "inputs": self.inputs,
            "outputs": self.outputs,
            "different": self.different,
            "is_cut_off": self.is_truncated,
            "before": self.before,
            "first": [difference.as_data() for difference in self.first],
        }


class _Port(ControllerPort):
    """A controller's connection; its replies are outputs, except those of the gateway's own unit id."""

    def __init__(self, plan: ControllerPlan, peer: str, number: int, line: "_Line") -> None:
        super().__init__(plan, peer)
        self._number = number
        self._line = line

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """See ``ControllerPort``."""
        if unit_id == self._line.own_unit_id:
            return
        name = self._line.plan.name
        self._line.outputs.append(traffic.Answered(name, self._number, transaction_id, unit_id, pdu.hex()))


class _Mute(OwnUnit):
    """The gateway's own unit id: its replies depend on more than one line, and are not compared."""

    def answer(self, pdu: bytes, now_ns: int) -> bytes:
        """See ``OwnUnit``."""
        return b""


class _Line(DriveLink):
    """One line's exchange; also its link to the drives, whose frames are outputs."""

    def __init__(self, plan: LinePlan, on_event: Callable[[str, Event], None], own_unit_id: int) -> None:
        is_connection = isinstance(plan.drives, TcpEndpoint)
        is_serial = not isinstance(plan.drives, TcpEndpoint) or plan.drives.rtu
        super().__init__(is_serial=is_serial, connects=is_connection)
        self.plan = plan
        self.own_unit_id = own_unit_id
        self.outputs: deque[traffic.Output] = deque()
        self._controllers = {link.plan.name: link for link in plan.controllers}
        self._ports: dict[int, _Port] = {}
        self._exchange = LineExchange(
            plan.axes,
            plan.timing,
            self,
            lambda event: on_event(plan.name, event),
            plan.groups,
            other_units=plan.other_units,
            own_unit=_Mute(own_unit_id) if own_unit_id else None,
        )

    @property
    def axes(self) -> Sequence[Axis]:
        """Its axes."""
        return self._exchange.axes

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        """See ``DriveLink``."""
        self.outputs.append(traffic.Sent(self.plan.name, unit_id, pdu.hex()))

    def abandon(self) -> None:
        """See ``DriveLink``."""
        self.outputs.append(traffic.Abandoned(self.plan.name))

    def feed(self, entry: traffic.Input) -> None:
        """Repeat an input."""
        exchange = self._exchange
        match entry:
            case traffic.Request():
                pdu = bytes.fromhex(entry.pdu)
                exchange.request(
                    self._port(entry),
                    entry.transaction,
                    entry.unit,
                    pdu,
                    entry.t,
                    why_given_up=entry.given_up,
                )
            case traffic.Reply():
                exchange.reply(entry.unit, bytes.fromhex(entry.pdu), entry.t)
            case traffic.Stray():
                exchange.stray(entry.t, unit_id=max(entry.unit, 0) if entry.is_frame else -1)
            case traffic.Gone():
                if entry.port in self._ports:
                    port = self._ports.pop(entry.port)
                    exchange.controller_gone(port, entry.t, is_broken=entry.is_broken)
            case traffic.RestFirst() | traffic.Up() | traffic.Down():
                self._reach(entry)
            case traffic.Unframed():
                exchange.unframed(entry.t)
            case traffic.Tick():
                exchange.tick(entry.t)
            case traffic.Stop():
                exchange.stop(entry.t)
            case traffic.Beginning():
                pass  # it has begun already
            case traffic.Commanded():
                self._command(entry)

    def begin(self, beginning: traffic.Beginning) -> None:
        """Continue from a known state, as a gateway does after a restart.

        The reads that the gateway makes at a start get the known values of its axes; they are not compared.

        Raises:
            ReplayError: a record of an axis is of another release or another configuration.
        """
        axes_at = {at.axis: at for at in beginning.axes}
        for axis in self.axes:
            if axis.plan.name in axes_at:
                _recall(axis, axes_at[axis.plan.name], beginning.boot)
        for entry in beginning.controls:
            self._command(traffic.as_command(entry))
        for at in beginning.axes:
            if at.is_referenced and at.axis in {axis.plan.name for axis in self.axes}:
                with contextlib.suppress(ControlError):  # a homed bit of the drive reports it
                    self._exchange.command(SetReference(axis=at.axis), beginning.t)
        if beginning.is_up:
            # The homed bit is as old as it was then: its age decides when it is read again.
            seen_ns = [at.reference_seen_ns for at in beginning.axes if at.reference_seen_ns]
            began_ns = min([beginning.t, *seen_ns])
            self._exchange.link_up(began_ns - int(self.plan.timing.connect_delay_ms * NS_PER_MS))
            self._exchange.tick(began_ns)
            self._exchange.link_state.resume(beginning.up_ns, closes_soon=False, has_closed_soon=False)
        drives = _Drives(self.axes, axes_at)
        while self.outputs:
            sent = self.outputs.popleft()
            if isinstance(sent, traffic.Sent):
                self._exchange.reply(
                    sent.unit, drives.answer(sent.unit, bytes.fromhex(sent.pdu)), beginning.t
                )
        self._exchange.link_state.resume(
            beginning.up_ns, closes_soon=beginning.closes_soon, has_closed_soon=beginning.has_closed_soon
        )

    def _reach(self, entry: traffic.RestFirst | traffic.Up | traffic.Down) -> None:
        if isinstance(entry, traffic.RestFirst):
            self._exchange.rest.expect_late_reply()
        elif isinstance(entry, traffic.Up):
            self._exchange.link_up(entry.t)
        else:
            self._exchange.link_down(entry.t, entry.reason, is_orderly=entry.is_orderly)

    def _command(self, entry: traffic.Commanded) -> None:
        try:
            tables = tuple(map(checked, entry.tables))
        except WrongTableError as error:
            raise ReplayError(f"a table in the recording: {error}; replay it with its own release") from None
        # A command that is refused now was also refused then and changed nothing, or the configuration
        # differs.
        with contextlib.suppress(ControlError):
            self._exchange.command(entry.command, entry.t, tables)

    def _port(self, entry: traffic.Request) -> _Port:
        port = self._ports.get(entry.port)
        if port is None:
            link = self._controllers.get(entry.controller)
            if link is None:
                raise ReplayError(
                    f"line {self.plan.name} has no controller {entry.controller}, but the recording has: "
                    f"there are {', '.join(self._controllers)}; replay it with a configuration that names "
                    "it"
                )
            plan = link.plan_of(entry.role)
            if plan is None:
                raise ReplayError(
                    f"controller {entry.controller} has no role {entry.role!r}, but the recording has: "
                    "replay it with a configuration with the same roles"
                )
            port = self._ports[entry.port] = _Port(plan, entry.peer, entry.port, self)
            port.ends_by_silence = isinstance(link.endpoint, SerialEndpoint)
        return port


class _Drives:
    """Drives that report their recorded positions, and that they were homed."""

    def __init__(self, axes: Sequence[Axis], axes_at: Mapping[str, traffic.AxisAt]) -> None:
        self._words: dict[tuple[int, int], int] = {}
        for axis in axes:
            at, unit_id, field_ = axes_at.get(axis.plan.name), axis.plan.unit_id, axis.reach.asked_actual
            if at is None:
                continue
            if at.actual is not None and field_ is not None:
                raw = at.actual / field_.scale
                data = field_.pack(raw if field_.type.is_float else round(raw))
                for word in range(field_.words):
                    key = unit_id, field_.address + word
                    self._words[key] = int.from_bytes(data[2 * word : 2 * word + 2], "big")
            bit = axis.plan.bits.get(axis.reference.bit)
            if bit is not None and at.is_referenced is not bit.is_inverted:
                is_word = bit.table is BitTable.REGISTER
                self._words[unit_id, bit.address] = self._words.get((unit_id, bit.address), 0) | (
                    1 << bit.bit if is_word else 1
                )

    def answer(self, unit_id: int, pdu: bytes) -> bytes:
        """Return the reply to a read that the gateway added."""
        function, address, quantity = pdu[0], int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
        words = [self._words.get((unit_id, address + at), 0) for at in range(quantity)]
        if function in (FunctionCode.READ_HOLDING_REGISTERS, FunctionCode.READ_INPUT_REGISTERS):
            return bytes((function, 2 * quantity)) + b"".join(word.to_bytes(2, "big") for word in words)
        if function in (FunctionCode.READ_COILS, FunctionCode.READ_DISCRETE_INPUTS):
            bits = sum((word & 1) << at for at, word in enumerate(words)).to_bytes(
                (quantity + 7) // 8, "little"
            )
            return bytes((function, len(bits))) + bits
        return exception_pdu(function, ExceptionCode.ILLEGAL_FUNCTION)


def _recall(axis: Axis, at: traffic.AxisAt, boot: bytes) -> None:
    """Let an axis continue from its record, as at a restart."""
    if not at.record:
        return
    try:
        content = zlib.decompress(at.record)
    except zlib.error:
        content = b""
    if len(content) != RECORD_SIZE:
        raise ReplayError(f"the record of axis {at.axis} is of another release; replay it with its own")
    slots = RecordSlots(memoryview(bytearray(content)), digest_of_axis(axis.plan), boot)
    saved = slots.read()
    if saved is not None and saved.scale_digest != digest_of_axis(axis.plan):
        saved = None  # the scale of counts has changed in this configuration
    axis.recall.attach(Record(slots, saved))


def paced_first(entries: Iterable[Numbered]) -> Iterator[Numbered]:
    """Yield the entries, each ``Paced`` before the input that it concerns: a replay needs to know it first.

    A recording has it after that input. After a ``Sent``, a ``Paced`` keeps its place: an input sends no
    second frame.
    """
    group: list[Numbered] = []
    has_sent = False
    for numbered in entries:
        entry = numbered[1]
        if isinstance(entry, traffic.Paced) and not has_sent:
            group.insert(0, numbered)
            continue
        if not isinstance(entry, traffic.Output):
            yield from group
            group, has_sent = [], False
        has_sent = has_sent or isinstance(entry, traffic.Sent)
        group.append(numbered)
    yield from group


class Replay:
    """Takes the entries of a recording one after the other, in the order of :func:`paced_first`.

    Read :attr:`result` when all are fed.

    ``only`` is the name of the one line that counts; ``on_event`` gets what the exchange reports.
    """

    def __init__(
        self,
        plan: GatewayPlan,
        only: str | None = None,
        on_event: Callable[[str, Event], None] | None = None,
    ) -> None:
        names = [line.name for line in plan.lines]
        if only is not None and only not in names:
            raise ReplayError(f"there is no line {only}; there are {', '.join(names)}")
        self.result = ReplayResult(is_truncated=True)
        report = on_event or _ignore
        own = self._own_unit_id = plan.status_unit
        self._lines = {
            line.name: _Line(line, report, own) for line in plan.lines if only in (None, line.name)
        }
        self._others = {line.name: _Line(line, _ignore, own) for line in _acting_on(plan, only)}
        """Other lines, with axes that act on an axis of a counted line."""
        lines = (*self._lines.values(), *self._others.values())
        join_terms(axis for line in lines for axis in line.axes)
        self._only = only
        self._is_capture = False
        self._begun: set[str] = set()
        """Lines of a capture whose beginning was fed."""
        self._input: tuple[int, traffic.Input] | None = None

    def feed(self, number: int, entry: traffic.Entry) -> bool:
        """Take one entry, from line ``number`` of the file; return whether it belongs to the replay.

        Raises:
            ReplayError: the configuration has no such line or controller.
        """
        if isinstance(entry, traffic.Beginning) and self._is_capture and entry.line not in self._begun:
            self._begin(entry)
            return False
        if not isinstance(entry, traffic.Header | traffic.End) and self._is_early(entry.line):
            self.result.before += 1
            return False
        match entry:
            case traffic.Header():
                self._is_capture = entry.format == traffic.CAPTURED
                return False
            case traffic.Port():
                return False
            case traffic.End():
                self._settle()
                self.result.is_truncated = False
                return False
            case traffic.Answered(unit=unit) if unit and unit == self._own_unit_id:
                return False
            case traffic.Paced(line=name, until=until):
                line = self._others.get(name) or self._line(name)
                if line is None:
                    return False
                line.stamps.next_ns = until
            case traffic.Sent() | traffic.Abandoned() | traffic.Answered():
                if self._line(entry.line) is None:
                    return False
                self._compare(number, entry)
            case _:
                if (other := self._others.get(entry.line)) is not None:
                    other.feed(entry)
                    other.outputs.clear()
                    return False
                line = self._line(entry.line)
                if line is None:
                    return False
                self._settle()
                self._input = number, entry
                self.result.inputs += 1
                line.feed(entry)
        return True

    def _begin(self, beginning: traffic.Beginning) -> None:
        self._begun.add(beginning.line)
        line = self._others.get(beginning.line) or self._line(beginning.line)
        if line is not None:
            line.begin(beginning)

    def _is_early(self, line: str) -> bool:
        """Whether the state of the line is still unknown: a capture begins anywhere."""
        return self._is_capture and line not in self._begun

    def _line(self, name: str) -> _Line | None:
        line = self._lines.get(name)
        if line is None and self._only is None:
            raise ReplayError(
                f"the configuration has no line {name}, but the recording has: there are "
                f"{', '.join(self._lines)}; choose a line of the recording with --line"
            )
        return line

    def _compare(self, number: int, expected: traffic.Output) -> None:
        self.result.outputs += 1
        outputs = self._lines[expected.line].outputs
        got = outputs.popleft() if outputs else None
        if got != expected:
            self._differs(expected.line, expected, got, number)

    def _settle(self) -> None:
        """Count the outputs of the last input that were not recorded as differences."""
        for name, line in self._lines.items():
            while line.outputs:
                self._differs(name, None, line.outputs.popleft())

    def _differs(
        self, line: str, expected: traffic.Output | None, got: traffic.Output | None, file_line: int = 0
    ) -> None:
        self.result.different += 1
        if len(self.result.first) < KEPT_DIFFERENCES:
            number, cause = self._input or (0, traffic.Up(line, 0))
            self.result.first.append(Difference(number, file_line or number, cause.t, line, expected, got))


def _acting_on(plan: GatewayPlan, only: str | None) -> list[LinePlan]:
    """Return the other lines whose axes act on those of one line by ``cross``, or on each other there."""
    if only is None:
        return []
    names: set[str] = set()
    found = {line.name: line for line in plan.lines if line.name == only}
    while True:
        names |= {cross.axis for line in found.values() for axis in line.axes for cross in axis.cross}
        more = [line for line in plan.lines if names & {axis.name for axis in line.axes}]
        if found.keys() >= {line.name for line in more}:
            return [line for line in found.values() if line.name != only]
        found |= {line.name: line for line in more}


def _ignore(line: str, event: Event) -> None:
    pass
