"""What happens when an event is impossible in a state: no table has a row for the pair.

Each machine of an axis has one table of its states and events. Where an event changes nothing, its row says
:data:`IGNORED`. A pair without a row is impossible; if it occurs, it is a bug of this program. Tests and
``make verify`` raise it. In production the machine enters its safest state, and the axis reports the fault
(``internal-fault``), which its line counts.
"""

from enum import Enum
from typing import Final

IGNORED: Final = None
"""The row of an event that changes nothing."""
_is_raised = False


class ImpossibleEventError(Exception):
    """An event that is impossible in the state in which it came."""


def raise_them() -> None:
    """Raise impossible events from now on: for tests."""
    global _is_raised  # noqa: PLW0603 - one switch for a whole process of tests
    _is_raised = True


def fault(sentence: str) -> str:
    """Return the report of an impossible event; raise it in tests.

    Raises:
        ImpossibleEventError: :func:`raise_them` was called.
    """
    if _is_raised:
        raise ImpossibleEventError(sentence)
    return sentence


def sentence_of(machine: str, state: Enum, event: Enum) -> str:
    """Return the report of a pair without a row; raise it in tests, as :func:`fault` does."""
    return fault(f"{machine}: {event.value} cannot be in {state.value}")
