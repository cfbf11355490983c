"""What a controller may ask for, beyond its role: unit ids, function codes, registers, how often."""

from dataclasses import dataclass
from typing import Final, NamedTuple


class RegisterSpan(NamedTuple):
    """Addresses from ``first`` to ``last``, both of them in it; of registers, coils and inputs alike."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Rights:
    """What is left of the rights of a role; an empty list leaves everything that its key is about."""

    is_read_only: bool = False
    unit_ids: frozenset[int] = frozenset()
    function_codes: frozenset[int] = frozenset()
    readable: tuple[RegisterSpan, ...] = ()
    """Addresses that may be read; a request has to stay inside one of the spans."""
    writable: tuple[RegisterSpan, ...] = ()
    requests_per_s: float = 0.0
    """Requests in a second over all connections of the controller, in the mean; 0: no limit."""


UNLIMITED: Final = Rights()
