"""Recorded traffic as text for people."""

from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from typing import Final

from gateway.exchange.access import ACCESS
from gateway.exchange.commands import Command, SetGain, SetTable, SetTemperature, axes_of
from gateway.exchange.plan import AxisPlan
from gateway.modbus.errors import RegisterError
from gateway.modbus.pdu import EXCEPTION_BIT, ExceptionCode, FunctionCode
from gateway.modbus.registers import FieldAccess, PositionField
from gateway.recording import traffic
from gateway.state.plan import GatewayPlan
from gateway.times import NS_PER_S

ARROWS: Final = {
    "request": "controller →",
    "sent": "          → drive",
    "reply": "          ← drive",
    "answered": "controller ←",
}

PLAIN: Final[Mapping[type, str]] = {
    traffic.Abandoned: "          × the reply is not waited for any longer",
    traffic.Paced: "          … the wire needs a silence before the next frame",
    traffic.RestFirst: "the previous gateway left a request unanswered: the line rests first",
    traffic.Up: "the drives can be reached",
    traffic.Down: "the drives cannot be reached",
    traffic.Unframed: "          ← bytes of which no frame was made yet",
    traffic.Tick: "a deadline passed",
    traffic.Beginning: "the line is idle: a replay may begin here",
    traffic.Stop: "the gateway stops",
}


def pdu_name(pdu: bytes) -> str:
    r"""Return the name of a PDU.

    >>> pdu_name(bytes.fromhex("0300640002")), pdu_name(bytes.fromhex("8302")), pdu_name(b"\x64")
    ('read holding registers', 'exception 2 (illegal data address)', 'function 100')
    """
    if not pdu:
        return "nothing"
    if pdu[0] & EXCEPTION_BIT:
        code = pdu[1] if len(pdu) > 1 else 0
        return f"exception {code}{_named(ExceptionCode, code)}"
    try:
        return _words(FunctionCode(pdu[0]))
    except ValueError:
        return f"function {pdu[0]}"


def output_words(output: traffic.Output | None) -> str:
    """Say what was sent, and to whom."""
    if output is None:
        return "nothing"
    if isinstance(output, traffic.Abandoned):
        return "to give up waiting"
    if isinstance(output, traffic.Paced):
        return "to wait for a silence of the wire"
    pdu = bytes.fromhex(output.pdu)
    to = f"controller port {output.port}" if isinstance(output, traffic.Answered) else "drive"
    return f"to {to} unit {output.unit}: {pdu_name(pdu)} {pdu.hex(' ')}"


def _named(kind: type[ExceptionCode], code: int) -> str:
    try:
        return f" ({_words(kind(code))})"
    except ValueError:
        return ""


def _words(member: Enum) -> str:
    return member.name.lower().replace("_", " ")


class Reader:
    """Turns entries into lines of text, with the positions that the configuration finds in them."""

    def __init__(self, plan: GatewayPlan) -> None:
        self._axes = {line.name: line.axes for line in plan.lines}
        self._start_ns: int | None = None
        self._now_ns = 0
        self._asked: dict[tuple[str, str], bytes] = {}
        """Last request of a line, on either side: needed to read its reply."""
        self._controllers: dict[tuple[str, int], str] = {}

    def line(self, entry: traffic.Input | traffic.Output) -> str:
        """Return one line for an entry."""
        if not isinstance(entry, traffic.Output):
            if self._start_ns is None:
                self._start_ns = entry.t
            self._now_ns = entry.t
        since_s = (self._now_ns - (self._start_ns or 0)) / NS_PER_S
        return f"{since_s:12.6f}  {entry.line:<8} {self.text(entry)}"

    def text(self, entry: traffic.Input | traffic.Output) -> str:
        """Return what an entry is, without its time and line."""
        match entry:
            case traffic.Request():
                self._controllers[entry.line, entry.port] = f"{entry.controller}#{entry.port}"
                return self._frame("request", entry, "front")
            case traffic.Sent():
                return self._frame("sent", entry, "back")
            case traffic.Reply():
                return self._frame("reply", entry, "back")
            case traffic.Answered():
                return self._frame("answered", entry, "front")
            case traffic.Gone():
                return f"{self._controller(entry.line, entry.port)} has disconnected"
            case traffic.Stray():
                return "          ← bytes that are no reply" + (" (a whole frame)" if entry.is_frame else "")
            case traffic.Commanded(command=command):
                return f"command {_command_words(command)}"
            case _:
                return PLAIN[type(entry)]

    def _controller(self, line: str, port: int) -> str:
        return self._controllers.get((line, port), f"#{port}")

    def _frame(
        self, kind: str, entry: traffic.Request | traffic.Sent | traffic.Reply | traffic.Answered, side: str
    ) -> str:
        pdu = bytes.fromhex(entry.pdu)
        key = entry.line, side
        if isinstance(entry, traffic.Request | traffic.Sent):
            self._asked[key] = pdu
        who = (
            f" {self._controller(entry.line, entry.port)}"
            if isinstance(entry, traffic.Request | traffic.Answered)
            else ""
        )
        found = list(self._positions(entry.line, entry.unit, pdu, self._asked.get(key, b""), kind))
        positions = f"  [{', '.join(found)}]" if found else ""
        return f"{ARROWS[kind]}{who}  unit {entry.unit}  {pdu_name(pdu)}  {pdu.hex(' ')}{positions}"

    def _positions(self, line: str, unit: int, pdu: bytes, asked: bytes, kind: str) -> Iterator[str]:
        """Yield the positions that a frame holds completely."""
        parse = ACCESS.get(asked[0]) if asked else None
        access = None if parse is None else parse(asked)
        if access is None or not access.is_consistent or not pdu or pdu[0] & EXCEPTION_BIT:
            return
        axes = [axis for axis in self._axes.get(line, ()) if axis.unit_id == unit]
        if kind in ("request", "sent"):
            if access.write_quantity and not access.is_mask:
                yield from _found(axes, access.write_address, access.words(asked), FieldAccess.READ)
        elif access.read_quantity and not access.is_mei and len(pdu) == 2 + 2 * access.read_quantity:
            yield from _found(axes, access.read_address, pdu[2:], FieldAccess.WRITE)


def _command_words(command: Command) -> str:
    match command:
        case SetTable(tables=tables):
            more = ", ".join(f"{each.axis} {each.file}" for each in tables)
        case SetGain():
            more = f"{' '.join(command.axes)} {command.forward:g} {command.backward:g}"
        case SetTemperature():
            more = f"{command.axis} {command.celsius:g} °C"
        case _:
            more = " ".join(axes_of(command))
    return f"{traffic.kind_of(command)} {more}"


def _found(axes: Sequence[AxisPlan], address: int, data: bytes, unless: FieldAccess) -> Iterator[str]:
    for axis in axes:
        roles = (("command", axis.command), ("actual", axis.actual), ("commanded", axis.commanded))
        for role, fields in roles:
            for field in fields:
                at = 2 * (field.address - address)
                if field.access is not unless and 0 <= at <= len(data) - 2 * field.words:
                    yield f"{axis.name} {role} {_units(axis, field, data, at)}"


def _units(axis: AxisPlan, field: PositionField, data: bytes, at: int) -> str:
    settings = axis.settings
    try:
        counts = field.unpack(data, at) * field.scale
    except RegisterError:
        return "?"
    units = (counts - settings.zero_counts) / settings.counts_per_unit - settings.machine_offset
    return f"{units:.10g} {settings.units.value}"
