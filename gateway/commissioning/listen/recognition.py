"""The shipped profiles that fit the traffic of a unit id."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Final

from gateway.commissioning.listen.traffic import BIT_FUNCTIONS, RegisterUse, UnitStatistics
from gateway.drives import library
from gateway.drives.profile import Profile
from gateway.modbus.registers import BitTable, PositionField

POINTS: Final = {"targets": 3, "triggers": 2, "positions": 2, "bits": 1, "settings": 1}
"""Points for a use of each kind, in addition to those for the profile's share of all uses."""
SHARE_POINTS: Final = 3.0
LEAST_POINTS: Final = 5.0
"""Profiles below this are not reported: targets and half of all uses have this many."""
CLEAR_POINTS: Final = 0.25
"""A profile this close to the best may be the right one: a maker's families share their registers."""


@dataclass(frozen=True, slots=True)
class Match:
    """A profile, and how well it fits."""

    drive: str
    points: float
    kinds: tuple[str, ...]
    """The kinds of its uses in the traffic: keys of ``POINTS``."""
    share: float
    """Share of the different uses that it contains."""


@dataclass(frozen=True, slots=True)
class _ProfileRegisters:
    """Registers of a profile by kind: addresses that are written, and that are read."""

    written: dict[str, frozenset[int]]
    read: dict[str, frozenset[int]]
    coils: dict[str, frozenset[int]]


def matches(unit_id: int, unit: UnitStatistics) -> list[Match]:
    """Return the profiles that fit, the best first."""
    uses = list(unit.uses)
    found = [match for name in library.names() if (match := _match(name, unit_id, uses)) is not None]
    return sorted(found, key=lambda match: (-match.points, match.drive))


def likely(found: list[Match]) -> list[Match]:
    """Return the best one, and those that fit nearly as well."""
    return [match for match in found if found[0].points - match.points < CLEAR_POINTS]


def _match(name: str, unit_id: int, uses: list[RegisterUse]) -> Match | None:
    profile = library.shipped(name)
    low, high = profile.unit_id_range or (0, 255)
    functions = {use.function for use in uses}
    if not uses or not low <= unit_id <= high:
        return None
    if profile.function_codes and not functions <= {int(code) for code in profile.function_codes}:
        return None
    registers = _registers_of(name)
    kinds = set()
    understood = 0
    for use in uses:
        kind = _kind(use, registers)
        if kind is not None:
            kinds.add(kind)
            understood += 1
    share = understood / len(uses)
    points = sum(POINTS[kind] for kind in kinds) + SHARE_POINTS * share
    if points < LEAST_POINTS or not kinds & {"targets", "positions"}:
        return None
    return Match(name, points, tuple(kind for kind in POINTS if kind in kinds), share)


def _kind(use: RegisterUse, registers: _ProfileRegisters) -> str | None:
    """Return the kind of a use in a profile: the first kind that it touches."""
    is_bits = use.function in BIT_FUNCTIONS
    kinds = registers.coils if is_bits else registers.written if use.is_write else registers.read
    touched = range(use.address, use.address + use.quantity)
    return next((kind for kind, addresses in kinds.items() if not addresses.isdisjoint(touched)), None)


@cache
def _registers_of(name: str) -> _ProfileRegisters:
    profile: Profile = library.shipped(name)
    registers = profile.registers
    targets = _spans(field for position in registers.command for field in position.fields())
    modes = {mode.address for mode in (registers.mode, *(p.mode for p in registers.command)) if mode}
    triggers = {trigger.address for trigger in registers.trigger if trigger.address is not None}
    others = _spans(
        field for position in (*registers.position_like, *registers.remap) for field in position.fields()
    ) | _spans(position.field() for position in (*registers.limits, *registers.aliases))
    actual = _spans(position.field() for position in (*registers.actual, *registers.commanded))
    bits = [bit for _, bit in registers.bits.named()]
    is_register = {bit.address: bit.table is BitTable.REGISTER for bit in bits}
    settings = frozenset({address for address in modes if address is not None} | others)
    return _ProfileRegisters(
        written={"targets": targets, "triggers": frozenset(triggers), "settings": settings},
        read={
            "positions": actual,
            "bits": frozenset(address for address, is_one in is_register.items() if is_one),
            "settings": settings | targets,
        },
        coils={
            "triggers": frozenset(t.coil for t in registers.trigger if t.coil is not None),
            "bits": frozenset(address for address, is_one in is_register.items() if not is_one),
        },
    )


def _spans(fields: Iterable[PositionField]) -> frozenset[int]:
    return frozenset(field.address + word for field in fields for word in range(field.words))
