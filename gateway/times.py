"""Units of time. Instants and spans are integers of nanoseconds; every name has the unit."""

from typing import Final

US_PER_MS: Final = 1000
NS_PER_US: Final = 1_000
NS_PER_MS: Final = 1_000_000
NS_PER_S: Final = 1_000_000_000
NEVER_NS: Final = 1 << 62
"""Later than every instant, and longer than every span."""


def span(seconds: float) -> str:
    """Return a span in words.

    >>> span(0.4), span(12.34), span(3_725.0), span(90_061.0)
    ('less than 1 s', '12 s', '1 h 2 min', '1 d 1 h')
    """
    whole = int(seconds)
    for unit_s, unit, part_s, part in (
        (86_400, "d", 3_600, "h"),
        (3_600, "h", 60, "min"),
        (60, "min", 1, "s"),
    ):
        if whole >= unit_s:
            return f"{whole // unit_s} {unit} {whole % unit_s // part_s} {part}"
    return f"{whole} s" if whole else "less than 1 s"
