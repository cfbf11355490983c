"""What the reference says about a key beyond its description."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Said:
    """What stands beside a key in the reference; what is empty comes from the model."""

    meaning: str = ""
    """In place of the description, which is short because errors show it."""
    more: str = ""
    """Behind the description, as a sentence of its own."""
    kind: str = ""
    """What may stand there, where the type of the field does not say it well."""
    default: str = ""
    """What holds without the key, where the field does not know it: it depends on others."""


Texts = Mapping[str, Said]
"""By the key."""
