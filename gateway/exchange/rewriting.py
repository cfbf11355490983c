"""One request as it came and as it went.

A :class:`Rewriting` is made when a request is about to be sent and holds the state of that moment: the words
that were rendered, the readback maps then in force, and what the controller really asked for.
"""

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from gateway.compensation.readback import Readback
from gateway.exchange.access import Access
from gateway.exchange.axis import AxisExchange, Rendering
from gateway.exchange.request import Request
from gateway.exchange.shadow import Shadow
from gateway.exchange.unit import NO_HITS, FieldHit, FieldRole, Hits
from gateway.modbus.registers import PositionField


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


class Staging(NamedTuple):
    """Words of a command field or limit that the drive holds and does not run.

    ``corrected_words`` None: what the drive holds is not known. ``losses``: of its shadow, when it was sent.
    """

    shadow: Shadow
    nominal_words: bytes
    corrected_words: bytes | None
    losses: int


@dataclass(slots=True)
class Rewriting:
    """One request as it came and as it went, with all that is needed to turn its reply back."""

    request: Request
    sent_pdu: bytes
    renderings: tuple[Rendering, ...] = ()
    """Targets that the drive goes to with this request."""
    runs: tuple[Rendering, ...] = ()
    """Those of them that it held already."""
    stagings: tuple[Staging, ...] = ()
    pending: tuple[FieldHit, ...] = ()
    """Parts of staged targets whose other parts are not known yet: they pass as they come (M1)."""
    touched_blindly: tuple[tuple[AxisExchange, Shadow], ...] = ()
    """Command fields that were written 1:1 in a way that leaves their content unknown."""
    moved_unknown: tuple[AxisExchange, ...] = ()
    """Axes that go somewhere nobody knows: a distance passed unchanged, a target not written by us ran."""
    command_hits: tuple[FieldHit, ...] = ()
    """Every command field that the request writes."""
    remaps: bool = False
    """Whether the request writes a register that moves other registers about."""
    losses: dict[int, int] = field(default_factory=dict)
    """Of the shadow of each target that it runs, by its identity, when the request was sent."""
    read_hits: Hits = NO_HITS
    read_span: Span = NO_SPAN
    readbacks: dict[str, Readback] | None = None
    """By axis; an axis that passed 1:1 at the moment of the request is not here."""

    def readback(self, axis: AxisExchange) -> Readback | None:
        """Return the readback map of an axis as it was at the moment of the request; None: it passed 1:1."""
        return None if self.readbacks is None else self.readbacks.get(axis.plan.name)

    @property
    def access(self) -> Access:
        """The registers that the request touches."""
        return self.request.access

    @property
    def writes(self) -> bool:
        """Whether the request changes what the gateway knows of an axis."""
        return bool(self.command_hits or self.request.meanings or self.stagings)

    @property
    def reads_unmapped(self) -> bool:
        """Whether the request reads a position that is not mapped, and so passes as it is (M10)."""
        return any(hit.place.role is FieldRole.GUARDED for hit in self.read_hits.fields)
