"""The declaration of a counter, in the type of its status field."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_type_hints

import msgspec


@dataclass(frozen=True, slots=True)
class Counter:
    """A number that only grows, declared in the type of its field: ``Annotated[int, Counter(…)]``."""

    words: str
    """Its label in the terminal and on the page."""
    description: str
    """What it counts, as the end of a sentence."""
    remedy: str = ""
    """What to do if it grows; empty: nothing."""
    is_shown: bool = False
    """The terminal shows it if it is not 0."""
    is_logged: bool = False
    """It is in the status lines of the log."""
    is_metric: bool = False
    """It is a metric of its line."""

    @property
    def sentence(self) -> str:
        """What it counts, as a sentence for metrics.

        >>> Counter("time-outs", "exchanges that a drive did not answer in time").sentence
        'Exchanges that a drive did not answer in time.'
        """
        text = self.description.replace("`", "")
        return f"{text[0].upper()}{text[1:]}."


def counters_of(part: type[msgspec.Struct]) -> Mapping[str, Counter]:
    """Return the counters that a part of the status declares, by their keys and in their order."""
    hints = get_type_hints(part, include_extras=True)
    return {
        name: each
        for name, hint in hints.items()
        for each in getattr(hint, "__metadata__", ())
        if isinstance(each, Counter)
    }
