"""Which words of which frame are positions: the register map of one unit id."""

from collections.abc import Iterable
from enum import Enum
from typing import Final, NamedTuple

from gateway.exchange.axis import AxisExchange
from gateway.exchange.shadow import Shadow
from gateway.modbus.registers import BitField, PositionField

CACHE_LIMIT: Final = 4096
"""Distinct (address, quantity) pairs that are remembered; a controller uses a few dozen."""


class FieldRole(Enum):
    """What a position register means."""

    COMMAND = "command"
    ACTUAL = "actual"
    COMMANDED = "commanded"
    GUARDED = "guarded"
    """Holds a position that is not mapped."""
    REMAPPING = "remapping"
    """Moves other registers about."""

    @property
    def is_position(self) -> bool:
        """Whether the gateway knows what position the register holds."""
        return self in _POSITIONS


_POSITIONS: Final = frozenset({FieldRole.COMMAND, FieldRole.ACTUAL, FieldRole.COMMANDED})


class FieldPlace(NamedTuple):
    """A position field where it stands in one unit id; ``number`` counts within its role."""

    axis: AxisExchange
    role: FieldRole
    number: int
    field: PositionField
    shadow: Shadow | None


class FieldHit(NamedTuple):
    """A field that a span of registers touches.

    ``word`` is its first word's index in the span; negative when the span begins inside the field.
    """

    place: FieldPlace
    word: int
    is_whole: bool


class BitHit(NamedTuple):
    """A status bit inside a span; ``word`` is the index of its register in the span."""

    axis: AxisExchange
    name: str
    bit: BitField
    word: int


class Hits(NamedTuple):
    """Everything that a span of registers touches."""

    fields: tuple[FieldHit, ...]
    bits: tuple[BitHit, ...]


NO_HITS: Final = Hits((), ())


class UnitMap:
    """All mapped registers of one unit id on one line."""

    def __init__(self, axes: Iterable[AxisExchange]) -> None:
        self.axes = tuple(axes)
        self._places = tuple(place for axis in self.axes for place in _places(axis))
        self._bits = tuple((axis, name, bit) for axis in self.axes for name, bit in axis.plan.bits.items())
        self._cache: dict[int, Hits] = {}

    def hits(self, address: int, quantity: int) -> Hits:
        """Return what the span ``address`` to ``address + quantity - 1`` touches."""
        key = address << 16 | quantity
        hits = self._cache.get(key)
        if hits is None:
            hits = self._find(address, quantity)
            if len(self._cache) >= CACHE_LIMIT:
                self._cache.clear()
            self._cache[key] = hits
        return hits

    def _find(self, address: int, quantity: int) -> Hits:
        end = address + quantity
        fields = tuple(
            FieldHit(
                place,
                place.field.address - address,
                address <= place.field.address and place.field.end <= end,
            )
            for place in self._places
            if place.field.address < end and place.field.end > address
        )
        bits = tuple(
            BitHit(axis, name, bit, bit.address - address)
            for axis, name, bit in self._bits
            if address <= bit.address < end
        )
        return Hits(fields, bits) if fields or bits else NO_HITS


def _places(axis: AxisExchange) -> list[FieldPlace]:
    plan = axis.plan
    places = [FieldPlace(axis, FieldRole.COMMAND, i, f, axis.shadows[i]) for i, f in enumerate(plan.command)]
    places += [FieldPlace(axis, FieldRole.ACTUAL, i, f, None) for i, f in enumerate(plan.actual)]
    places += [FieldPlace(axis, FieldRole.COMMANDED, i, f, None) for i, f in enumerate(plan.commanded)]
    places += [FieldPlace(axis, FieldRole.GUARDED, i, f, None) for i, f in enumerate(plan.guarded)]
    places += [FieldPlace(axis, FieldRole.REMAPPING, i, f, None) for i, f in enumerate(plan.remapping)]
    return places
