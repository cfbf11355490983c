"""The register map of one unit id: which words of a frame are positions, modes and triggers."""

from collections.abc import Iterable
from enum import Enum
from typing import Final, NamedTuple

from gateway.drives.motion import Addressing
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.registers import FieldImage
from gateway.modbus.registers import BitField, BitTable, FieldAccess, PositionField

CACHE_LIMIT: Final = 2048
"""Distinct (address, quantity) pairs of writes, and of reads, that are remembered; a controller uses a few
dozen."""


class FieldRole(Enum):
    """What a position register means."""

    COMMAND = "command"
    ACTUAL = "actual"
    COMMANDED = "commanded"
    ALIAS = "alias"
    """A further address at which a position is read."""
    LIMIT = "limit"
    """A position with which the drive compares its own."""
    GUARDED = "guarded"
    """Holds a position that is not mapped."""
    REMAPPING = "remapping"
    """Remaps other registers."""

    @property
    def is_position(self) -> bool:
        """Whether the gateway knows which position the register holds."""
        return self in _POSITIONS


_POSITIONS: Final = frozenset(
    {FieldRole.COMMAND, FieldRole.ACTUAL, FieldRole.COMMANDED, FieldRole.ALIAS, FieldRole.LIMIT}
)


class MappedField(NamedTuple):
    """A position field of one unit id; ``number`` counts within its role."""

    axis: Axis
    role: FieldRole
    number: int
    field: PositionField
    image: FieldImage | None


class FieldHit(NamedTuple):
    """A field that a span of registers touches.

    ``word`` is its first word's index in the span; negative if the span begins inside the field.
    """

    mapped: MappedField
    word: int
    is_whole: bool


class BitHit(NamedTuple):
    """A status bit inside a span; ``word`` is the index of its register, coil or input in the span."""

    axis: Axis
    name: str
    bit: BitField
    word: int


class RuleHit(NamedTuple):
    """A register inside a span that decides what positions mean, or makes the drive act."""

    axis: Axis
    address: int
    word: int


class AxisHits(NamedTuple):
    """What a span of registers touches of one axis."""

    axis: Axis
    fields: tuple[FieldHit, ...] = ()
    commands: tuple[FieldHit, ...] = ()
    """Its command fields."""
    rules: tuple[RuleHit, ...] = ()
    sets_position: bool = False
    """The span holds an actual position that can be written to set the drive's position."""


class Hits(NamedTuple):
    """Everything that a span of registers touches."""

    fields: tuple[FieldHit, ...]
    bits: tuple[BitHit, ...]
    rules: tuple[RuleHit, ...] = ()
    by_axis: tuple[AxisHits, ...] = ()
    """Fields and rules, by axis, for each axis that has any; in the order of the axes."""
    is_unclear: bool = False
    """Where addresses are objects: the span holds an object of unknown width before a mapped one."""


NO_HITS: Final = Hits((), ())


class UnitMap:
    """All mapped registers of one unit id on one line."""

    def __init__(self, axes: Iterable[Axis]) -> None:
        self.axes = tuple(axes)
        self.has_rules = any(axis.plan.has_rules or axis.peers for axis in self.axes)
        """Whether a frame may mean something other than a position to go to immediately, or something for a
        group."""
        self.asks_for_bits = any(axis.reference.depends_on_bit for axis in self.axes)
        """Whether a status bit may have to be read before positions pass."""
        self._mapped_fields = tuple(mapped for axis in self.axes for mapped in _mapped_fields(axis))
        self._bits = tuple((axis, name, bit) for axis in self.axes for name, bit in axis.plan.bits.items())
        self._rules = tuple((axis, address) for axis in self.axes for address in axis.rules.addresses)
        self._widths = _object_widths(self.axes)
        self.has_objects = self._widths is not None
        """Whether addresses are objects, each with its own width."""
        self._writes: dict[int, Hits] = {}
        self._reads: dict[int, Hits] = {}
        """What spans touch: by address and quantity in one number."""

    def written(self, address: int, quantity: int) -> Hits:
        """Return what a write of ``address`` to ``address + quantity - 1`` touches."""
        hits = self._writes.get(address << 16 | quantity)
        return hits or self._find_and_cache(self._writes, address, quantity, FieldAccess.READ)

    def read(self, address: int, quantity: int) -> Hits:
        """Return what a read of these registers touches."""
        hits = self._reads.get(address << 16 | quantity)
        return hits or self._find_and_cache(self._reads, address, quantity, FieldAccess.WRITE)

    def read_bits(self, table: BitTable, address: int, quantity: int) -> list[BitHit]:
        """Return the status bits among these coils or discrete inputs."""
        return [
            BitHit(axis, name, bit, bit.address - address)
            for axis, name, bit in self._bits
            if bit.table is table and address <= bit.address < address + quantity
        ]

    def _find_and_cache(
        self, cache: dict[int, Hits], address: int, quantity: int, other: FieldAccess
    ) -> Hits:
        hits = self._find(address, quantity, other)
        if len(cache) >= CACHE_LIMIT:
            cache.clear()
        cache[address << 16 | quantity] = hits
        return hits

    def _find(self, address: int, quantity: int, other: FieldAccess) -> Hits:
        if not quantity:
            return NO_HITS
        mapped_fields = [mapped for mapped in self._mapped_fields if mapped.field.access is not other]
        is_read = other is FieldAccess.WRITE
        bits = [(a, n, b) for a, n, b in self._bits if b.table is BitTable.REGISTER] if is_read else []
        rules = () if is_read else self._rules
        if self._widths is not None:
            return self._find_objects(address, quantity, mapped_fields, bits, rules)
        end = address + quantity
        fields = tuple(
            FieldHit(
                mapped,
                mapped.field.address - address,
                address <= mapped.field.address and mapped.field.end <= end,
            )
            for mapped in mapped_fields
            if mapped.field.address < end
            and mapped.field.end > address
            and (mapped.field.block is None or mapped.field.block == address)
        )
        hit_rules = tuple(RuleHit(a, at, at - address) for a, at in rules if address <= at < end)
        return Hits(
            fields,
            tuple(BitHit(a, n, b, b.address - address) for a, n, b in bits if address <= b.address < end),
            hit_rules,
            self._by_axis(fields, hit_rules),
        )

    def _find_objects(
        self,
        address: int,
        quantity: int,
        mapped_fields: list[MappedField],
        bits: list[tuple[Axis, str, BitField]],
        rules: tuple[tuple[Axis, int], ...],
    ) -> Hits:
        """Find the objects in a span: each takes as many registers as its width."""
        assert self._widths is not None
        layout: dict[int, int] = {}
        index, word = address, 0
        while word < quantity:
            layout[index] = word
            width = self._widths.get(index)
            if width is None:
                break
            index, word = index + 1, word + width
        mapped = (
            {p.field.address for p in mapped_fields} | {b.address for _, _, b in bits} | {a for _, a in rules}
        )
        is_unclear = word < quantity and any(index < at < index + quantity - word for at in mapped)
        fields = tuple(
            FieldHit(mapped_field, at, at + mapped_field.field.words <= quantity)
            for mapped_field in mapped_fields
            if (at := layout.get(mapped_field.field.address)) is not None
        )
        hit_rules = tuple(RuleHit(a, at, layout[at]) for a, at in rules if at in layout)
        return Hits(
            fields,
            tuple(BitHit(a, n, b, layout[b.address]) for a, n, b in bits if b.address in layout),
            hit_rules,
            self._by_axis(fields, hit_rules),
            is_unclear,
        )

    def _by_axis(self, fields: tuple[FieldHit, ...], rules: tuple[RuleHit, ...]) -> tuple[AxisHits, ...]:
        found = []
        for axis in self.axes:
            own = tuple(hit for hit in fields if hit.mapped.axis is axis)
            own_rules = tuple(hit for hit in rules if hit.axis is axis)
            if own or own_rules:
                commands = tuple(hit for hit in own if hit.mapped.role is FieldRole.COMMAND)
                settable = axis.plan.settable
                sets_position = any(
                    hit.mapped.role is FieldRole.ACTUAL and hit.mapped.number in settable for hit in own
                )
                found.append(AxisHits(axis, own, commands, own_rules, sets_position))
        return tuple(found)


def _object_widths(axes: tuple[Axis, ...]) -> dict[int, int] | None:
    """Return the registers of each known object; None: addresses are registers."""
    if not any(axis.plan.addressing is Addressing.OBJECTS for axis in axes):
        return None
    widths: dict[int, int] = {}
    for axis in axes:
        widths.update(dict.fromkeys(axis.rules.addresses, 1))
        widths.update({bit.address: 1 for bit in axis.plan.bits.values() if bit.table is BitTable.REGISTER})
        widths.update(axis.plan.object_words)
        widths.update({mapped.field.address: mapped.field.words for mapped in _mapped_fields(axis)})
    return widths


def _mapped_fields(axis: Axis) -> list[MappedField]:
    plan = axis.plan
    read_or_guarded = (
        (FieldRole.ACTUAL, plan.actual),
        (FieldRole.COMMANDED, plan.commanded),
        (FieldRole.ALIAS, plan.aliases),
        (FieldRole.GUARDED, plan.guarded),
        (FieldRole.REMAPPING, plan.remapping),
    )
    mapped_fields = [
        MappedField(axis, FieldRole.COMMAND, i, f, axis.fields[i]) for i, f in enumerate(plan.command)
    ]
    mapped_fields += [
        MappedField(axis, FieldRole.LIMIT, i, f, axis.limit_fields[i]) for i, f in enumerate(plan.limits)
    ]
    for role, fields in read_or_guarded:
        mapped_fields += [MappedField(axis, role, i, f, None) for i, f in enumerate(fields)]
    return mapped_fields
