"""The states that the status of an axis can show; importing them needs nothing of the exchange."""

from typing import Final

from gateway.compensation.thermal import TermState

COMPENSATION_STATES: Final = (
    "active",
    "blending",
    "shadow",
    "off",
    "unreferenced",
    "no-table",
    "outside",
    "blocked",
)
"""Everything that ``exchange.status.compensation_state`` returns."""
DIRECTION_STATES: Final = ("forward", "backward", "unknown", "unsure")
"""Everything that ``exchange.status.direction_state`` returns."""
TERM_STATES: Final = tuple(state.value for state in TermState)
"""Every ``state`` of ``terms.thermal`` and ``terms.cross``."""
