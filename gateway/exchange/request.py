"""One request as it came and as it goes: what it touches and means, what was read for it, what it does.

A :class:`Rewriting` is made when a request is about to be sent and holds the state of that moment: the words
that were rendered, the readback maps then in force, and what the controller really asked for.
"""

from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from gateway.compensation.readback import Readback
from gateway.exchange.access import Access
from gateway.exchange.axis.events import AxisRequest
from gateway.exchange.axis.state import Actual, Rendering
from gateway.exchange.axis.transitions import Axis
from gateway.exchange.meaning import Meaning
from gateway.exchange.unit import NO_HITS, FieldRole, Hits, UnitMap
from gateway.modbus.registers import PositionField


class Standing(Enum):
    """What a drive's status bit says of an axis that is to go a distance."""

    UNTOLD = "untold"
    MOVES = "moves"
    SAYS_SO = "says-so"
    """It stands, but the bit may still be that of the time before its last move."""
    STANDS = "stands"


@dataclass(slots=True)
class Known:
    """What was read for one request before it could be rendered. None: asked for, and not to be had."""

    actual: dict[str, Actual | None] = field(default_factory=dict)
    """By axis."""
    commanded: dict[str, float | None] = field(default_factory=dict)
    """The drive's own commanded position in counts, by axis."""
    standing: dict[str, Standing] = field(default_factory=dict)
    """By axis."""
    command_words: dict[tuple[str, int], bytes | None] = field(default_factory=dict)
    """Nominal words, by axis and number of the command field."""
    rule_words: dict[str, dict[int, int | None]] = field(default_factory=dict)
    """Contents of mode and trigger registers, by axis and address."""
    references: set[str] = field(default_factory=set)
    """Axes whose reference was asked for."""
    runs: dict[str, Rendering] = field(default_factory=dict)
    """What a trigger runs, by axis: decided once for each request (M2)."""


NOTHING_KNOWN: Final = Known()
"""For requests that need nothing read; it stays empty."""


@dataclass(frozen=True, slots=True)
class Span:
    """Registers ``address`` to ``address + quantity - 1``."""

    address: int
    quantity: int

    def widened(self, fields: list[PositionField]) -> "Span":
        """Return the smallest span around this one that cuts none of ``fields``."""
        start = min([self.address, *(f.address for f in fields)])
        end = max([self.address + self.quantity, *(f.end for f in fields)])
        return Span(start, end - start)


NO_SPAN: Final = Span(0, 0)


class Request(NamedTuple):
    """A request, the registers that it touches, and what it means for each axis of the unit."""

    unit: UnitMap
    pdu: bytes
    access: Access
    meanings: list[Meaning]
    known: Known
    now_ns: int
    arrived_ns: int
    """When it came from its controller; no two requests of a line came at the same instant."""


@dataclass(slots=True)
class Rewriting:
    """One request as it came and as it went, with all that is needed to turn its reply back."""

    request: Request
    sent_pdu: bytes
    by_axis: dict[str, AxisRequest] = field(default_factory=dict)
    """What it does to each axis that it does something to, by name."""
    read_hits: Hits = NO_HITS
    read_span: Span = NO_SPAN
    readbacks: dict[str, Readback] = field(default_factory=dict)
    """By axis; an axis that passed 1:1 at the moment of the request is not here."""

    def of(self, axis: Axis) -> AxisRequest:
        """Return what it does to one axis, to be filled in."""
        name = axis.plan.name
        found = self.by_axis.get(name)
        if found is None:
            command = next((each for each in self.request.meanings if each.axis is axis), None)
            found = self.by_axis[name] = AxisRequest(self.request.arrived_ns, command)
        return found

    def ask(self, hits: Hits, span: Span) -> None:
        """Note what is read of the drive: what was asked for, or more, where that cuts a position."""
        self.read_hits, self.read_span = hits, span

    def send_instead(self, pdu: bytes) -> None:
        """Note what is sent in place of the request as it came."""
        self.sent_pdu = pdu

    @property
    def written(self) -> list[tuple[Axis, AxisRequest]]:
        """The axes that it does something to, in their order, with what that is."""
        axes = self.request.unit.axes
        return [(axis, self.by_axis[axis.plan.name]) for axis in axes if axis.plan.name in self.by_axis]

    def readback(self, axis: Axis) -> Readback | None:
        """Return the readback map of an axis as it was at the moment of the request; None: it passed 1:1."""
        return self.readbacks.get(axis.plan.name)

    @property
    def access(self) -> Access:
        """The registers that the request touches."""
        return self.request.access

    @property
    def reads_unmapped(self) -> bool:
        """Whether the request reads a position that is not mapped, and so passes as it is (M10)."""
        return any(hit.place.role is FieldRole.GUARDED for hit in self.read_hits.fields)
