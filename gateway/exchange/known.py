"""What was read for one request before it could be rendered."""

from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from gateway.exchange.axis import Actual, Rendering


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
    command_words: dict[int, bytes | None] = field(default_factory=dict)
    """Nominal words by identity of the shadow they belong to."""
    rule_words: dict[str, dict[int, int | None]] = field(default_factory=dict)
    """Contents of mode and trigger registers, by axis and address."""
    references: set[str] = field(default_factory=set)
    """Axes whose reference was asked for."""
    runs: dict[str, Rendering] = field(default_factory=dict)
    """What a trigger runs, by axis: decided once for each request (M2)."""


NOTHING_KNOWN: Final = Known()
"""For requests that need nothing read; it stays empty."""
