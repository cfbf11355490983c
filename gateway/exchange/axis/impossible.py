"""What becomes of an event that cannot be in a state: no table has a row for such a pair.

Each machine of an axis has one table of its states and events. Where nothing happens its row says
:data:`IGNORED`; a pair without a row cannot be, and to meet one is a bug of this program. Tests and
``make verify`` raise it. In production the machine goes to its safest state, and the axis tells it
(``internal-fault``), which its line counts.
"""

from enum import Enum
from typing import Final

IGNORED: Final = None
"""What a table says where an event changes nothing."""
_is_raised = False


class ImpossibleEventError(Exception):
    """An event that cannot be in the state in which it came."""


def raise_them() -> None:
    """From now on raise what cannot be: for tests."""
    global _is_raised  # noqa: PLW0603 - one switch for a whole process of tests
    _is_raised = True


def fault(sentence: str) -> str:
    """Return what is to be told of something that cannot be; raise it in tests.

    Raises:
        ImpossibleEventError: where :func:`raise_them` was called.
    """
    if _is_raised:
        raise ImpossibleEventError(sentence)
    return sentence


def sentence_of(machine: str, state: Enum, event: Enum) -> str:
    """Return what is to be told of a pair that has no row; raise it in tests, as :func:`fault` does."""
    return fault(f"{machine}: {event.value} cannot be in {state.value}")
