"""A recording through a fresh exchange: the same inputs at the same times have to cause the same bytes."""

import contextlib
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from gateway.exchange.axis.groups import join_terms
from gateway.exchange.axis.transitions import Axis
from gateway.exchange.control import ControlError
from gateway.exchange.events import Event
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan
from gateway.exchange.ports import ControllerPort, DriveLink, OwnUnit
from gateway.ipc import traffic
from gateway.ipc.compiled_table import WrongTableError
from gateway.ipc.plan import GatewayPlan, LinePlan
from gateway.relay.recorded import message_of
from gateway.transport.endpoints import TcpEndpoint

KEPT_DIFFERENCES: Final = 10
"""The first ones tell; what follows a difference mostly follows from it."""


class ReplayError(Exception):
    """A recording that this configuration cannot replay; the text says why and what to do."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One output that is not as recorded.

    ``entry`` is the line in the file of the input that caused it, ``file_line`` that of the recorded output
    that differs: of the input where none was recorded.
    """

    entry: int
    file_line: int
    t: int
    line: str
    expected: traffic.Output | None
    got: traffic.Output | None


@dataclass(slots=True)
class ReplayResult:
    """What came of a replay."""

    inputs: int = 0
    outputs: int = 0
    """Recorded outputs that were compared."""
    different: int = 0
    first: list[Difference] = field(default_factory=list)
    is_cut_off: bool = False


class _Port(ControllerPort):
    """A controller's connection; its replies are outputs, but for what the gateway says of itself."""

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
    """What the gateway says of itself depends on more than one line has seen, and is not compared."""

    def answer(self, pdu: bytes, now_ns: int) -> bytes:
        """See ``OwnUnit``."""
        return b""


class _Line(DriveLink):
    """One line's exchange; it is the link to the drives too, and what goes there is output."""

    def __init__(self, plan: LinePlan, on_event: Callable[[str, Event], None], own_unit_id: int) -> None:
        super().__init__(is_serial=not isinstance(plan.drives, TcpEndpoint) or plan.drives.rtu)
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
        """Let it happen again."""
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
                exchange.stray(entry.t, is_frame=entry.is_frame)
            case traffic.Gone():
                if entry.port in self._ports:
                    exchange.controller_gone(self._ports.pop(entry.port), entry.t)
            case traffic.RestFirst() | traffic.Up() | traffic.Down():
                self._reach(entry)
            case traffic.Tick():
                exchange.tick(entry.t)
            case traffic.Stop():
                exchange.stop(entry.t)
            case _:
                self._control(entry)

    def _reach(self, entry: traffic.RestFirst | traffic.Up | traffic.Down) -> None:
        if isinstance(entry, traffic.RestFirst):
            self._exchange.rest.owe()
        elif isinstance(entry, traffic.Up):
            self._exchange.link_up(entry.t)
        else:
            self._exchange.link_down(entry.t)

    def _control(self, entry: traffic.ControlInput) -> None:
        try:
            message = message_of(entry)
        except WrongTableError as error:
            raise ReplayError(f"a table in the recording: {error}; replay it with its own release") from None
        if message is None:
            command = entry.command if isinstance(entry, traffic.Control) else ""
            raise ReplayError(f"the command {command!r} is not known; replay it with a newer release")
        # Refused now: as it was refused then, when it changed nothing either, or of another configuration.
        with contextlib.suppress(ControlError):
            self._exchange.control(message, entry.t)

    def _port(self, entry: traffic.Request) -> _Port:
        port = self._ports.get(entry.port)
        if port is None:
            link = self._controllers.get(entry.controller)
            if link is None:
                raise ReplayError(
                    f"line {self.plan.name} has no controller {entry.controller}, which the recording has: "
                    f"there are {', '.join(self._controllers)}; replay it with a configuration that names it"
                )
            plan = link.plan_of(entry.role)
            if plan is None:
                raise ReplayError(
                    f"controller {entry.controller} has no role {entry.role!r}, which the recording has: "
                    "replay it with a configuration that has the same roles"
                )
            port = self._ports[entry.port] = _Port(plan, entry.peer, entry.port, self)
        return port


class Replay:
    """Takes the entries of a recording one after the other; ask for :attr:`result` when all are fed.

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
        self.result = ReplayResult(is_cut_off=True)
        tell = on_event or _tell_nobody
        own = self._own_unit_id = plan.status_unit
        self._lines = {line.name: _Line(line, tell, own) for line in plan.lines if only in (None, line.name)}
        self._others = {line.name: _Line(line, _tell_nobody, own) for line in _acting_on(plan, only)}
        """Lines that do not count, with axes that act on one that does."""
        lines = (*self._lines.values(), *self._others.values())
        join_terms(axis for line in lines for axis in line.axes)
        self._only = only
        self._input: tuple[int, traffic.Input] | None = None

    def feed(self, number: int, entry: traffic.Entry) -> bool:
        """Take one entry, which stands on line ``number``; whether it belongs to what is replayed.

        Raises:
            ReplayError: the configuration has no such line or controller.
        """
        match entry:
            case traffic.Header():
                return False
            case traffic.End():
                self._settle()
                self.result.is_cut_off = False
                return False
            case traffic.Answered(unit=unit) if unit and unit == self._own_unit_id:
                return False
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

    def _line(self, name: str) -> _Line | None:
        line = self._lines.get(name)
        if line is None and self._only is None:
            raise ReplayError(
                f"the recording has a line {name}, and the configuration has none of that name: there are "
                f"{', '.join(self._lines)}; choose one of the recording's with --line"
            )
        return line

    def _compare(self, number: int, expected: traffic.Output) -> None:
        self.result.outputs += 1
        outputs = self._lines[expected.line].outputs
        got = outputs.popleft() if outputs else None
        if got != expected:
            self._differs(expected.line, expected, got, number)

    def _settle(self) -> None:
        """What the last input caused beyond what was recorded is a difference too."""
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


def _tell_nobody(line: str, event: Event) -> None:
    pass
