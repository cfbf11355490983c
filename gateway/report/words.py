"""Numbers and names as displayed in a report."""

from dataclasses import dataclass
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.readings import small_unit

MINUS: Final = "\N{MINUS SIGN}"
GAP: Final = "\N{NO-BREAK SPACE}"
"""Between a number and its unit."""
NONE: Final = "\N{EN DASH}"
"""Shown if the readings have no number."""
_POSITIONS: Final = {Units.MM: "mm", Units.INCH: "in", Units.DEGREE: "°"}


@dataclass(frozen=True, slots=True)
class Scale:
    """How lengths of one axis are displayed: positions unchanged, deviations multiplied by ``factor``."""

    position: str
    deviation: str
    factor: float

    def of(self, deviation: float) -> float:
        """Convert a deviation from the units of the axis."""
        return deviation * self.factor

    def deviation_text(self, deviation: float | None, decimals: int) -> str:
        r"""Return a deviation as text with its unit; it is given in the units of the axis.

        >>> scale_of(Units.MM).deviation_text(-0.0125, 1)
        '−12.5\xa0µm'
        """
        return NONE if deviation is None else f"{number(self.of(deviation), decimals)}{GAP}{self.deviation}"

    def rounded(self, deviation: float) -> str:
        r"""Return a deviation for a sentence: three digits and two decimals at most.

        >>> [scale_of(Units.MM).rounded(length) for length in (0.12034, 0.00912, 0.0000404)]
        ['120\xa0µm', '9.1\xa0µm', '0.04\xa0µm']
        """
        shown = abs(self.of(deviation))
        return self.deviation_text(deviation, 0 if shown >= 99.5 else 1 if shown >= 0.95 else 2)


def scale_of(units: Units) -> Scale:
    """Return how an axis with these units is displayed."""
    small = small_unit(units)
    return Scale(_POSITIONS[units], small.name, small.factor)


def number(value: float, decimals: int) -> str:
    """Return a number with a real minus sign; a value that rounds to zero has none.

    >>> number(-1.25, 2), number(-0.001, 2), number(12345.0, 0)
    ('−1.25', '0.00', '12345')
    """
    text = f"{value:.{decimals}f}"
    if not text.strip("-0."):
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def shortest(value: float) -> str:
    """Return a position with its significant digits, at most nine.

    >>> shortest(-12.5), shortest(0.1 + 0.2), shortest(-0.0)
    ('−12.5', '0.3', '0')
    """
    return f"{value + 0.0:.9g}".replace("-", MINUS)


def clean(text: str) -> str:
    r"""Return any text in a form fit for a page: what cannot be displayed becomes a replacement character.

    Facts come from untrusted files. Control characters would end a line of a picture or make invalid XML, and
    bytes that were not text cannot be encoded again.

    >>> clean("Haas\x00 VF-2\udcff")
    'Haas\ufffd VF-2\ufffd'
    """
    return "".join(sign if sign.isprintable() else " " if sign.isspace() else "\ufffd" for sign in text)


def truncated(text: str, longest: int) -> str:
    """Return a text of at most ``longest`` characters; an ellipsis replaces the end of a longer one.

    >>> truncated("a long name", 7)
    'a long…'
    """
    return text if len(text) <= longest else f"{text[: longest - 1].rstrip()}…"
