"""Numbers as a file may spell them. Python's own parsers take more (``1_000``, ``nan``, ``٣``) than that."""

import re
from math import isfinite
from typing import Final

_INTEGER: Final = re.compile(r"[+-]?[0-9]{1,15}")
_DECIMAL: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
MAX_CHARACTERS: Final = 40
DECIMAL_ALLOWED: Final = "a decimal number with a point, such as -0.0001"
INTEGER_ALLOWED: Final = "a whole number, such as -32"


def to_integer(text: str) -> int | None:
    """Return a signed whole number of at most 15 digits, or None if ``text`` is not one.

    >>> to_integer("-1448819"), to_integer("1.0")
    (-1448819, None)
    """
    return int(text) if _INTEGER.fullmatch(text) else None


def with_point(text: str, allowed: str = DECIMAL_ALLOWED) -> str:
    """Return what is allowed in the place of ``text``; of a number with a comma, how it is written.

    >>> with_point("150,0", "a distance above 0")
    'a distance above 0, with a decimal point: 150.0'
    >>> with_point("x", "a distance above 0")
    'a distance above 0'
    """
    pointed = text.replace(",", ".")
    is_comma = text.count(",") == 1 and to_decimal(pointed) is not None
    return f"{allowed}, with a decimal point: {pointed}" if is_comma else allowed


def to_decimal(text: str) -> float | None:
    """Return a finite decimal number, or None if ``text`` is not one.

    >>> to_decimal("+0.00010000"), to_decimal("0,5")
    (0.0001, None)
    """
    if len(text) > MAX_CHARACTERS or not _DECIMAL.fullmatch(text):
        return None
    number = float(text)
    return number if isfinite(number) else None
