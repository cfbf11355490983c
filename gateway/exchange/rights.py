"""What a controller may send, beyond its role: unit ids, function codes, registers, rate."""

from dataclasses import dataclass
from typing import Final, NamedTuple


class RegisterSpan(NamedTuple):
    """Addresses from ``first`` to ``last``, both included; of registers, coils and inputs alike."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Rights:
    """Restrictions of a role's rights; an empty list restricts nothing."""

    is_read_only: bool = False
    unit_ids: frozenset[int] = frozenset()
    function_codes: frozenset[int] = frozenset()
    readable: tuple[RegisterSpan, ...] = ()
    """Addresses that may be read; a request must be inside one of the spans."""
    writable: tuple[RegisterSpan, ...] = ()
    requests_per_s: float = 0.0
    """Average requests per second over all connections of the controller; 0: no limit."""


UNLIMITED: Final = Rights()
