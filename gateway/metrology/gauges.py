r"""Lines from serial gauges: one reading is one line of ASCII.

``mitutoyo``: interfaces that turn the DATA plug of a Mitutoyo gauge into RS-232 or USB. Two digits of the
channel, ``A``, a sign, digits with a point, CR: ``01A+0012.345\r``. ``911\r`` is an error of channel 1:
no gauge, or one that is switched off.

``sylvac``: gauges of Sylvac and of makes with the same protocol. A sign or a space, digits with a point, CR:
``+12.345\r``. ``?\r`` asks for a reading; instruments with an echo send it back first. ``ERR1\r`` is an
error. In tolerance mode ``<``, ``=`` or ``>`` follows the number (user manuals of the Power and UniCal
families: data format, remote commands).

``millimar``: the first feature of a Mahr Millimar C 1202 with its Duplex interface. Its number, a sign,
digits with a point, the unit and, with tolerances, ``<``, ``=`` or ``>`` after it, with blanks between, CR:
``1 +012.345 um =\r``. ``M1?\r`` asks for it; ``ERR6`` is the answer for a feature that is off (operating
instructions, data transmission parameters).

``pattern``: any other instrument that writes a line of ASCII for each reading, a DRO or the counter of a
glass scale. The user gives a regular expression whose group ``value`` is the number. The whole line must
match. If it has a group ``unit``, that must match the unit in which readings are taken.

The other three always send the sign. Without it, a line that lost its first byte would be a reading of the
other sign. Nothing is guessed: a line that is not exactly one of these is refused, and shown.
"""

import re
from typing import Final

from gateway.metrology.errors import MetrologyError
from gateway.metrology.gauge_kinds import GaugeKind
from gateway.tabfile.text import to_decimal

LONGEST_LINE: Final = 64
SHOWN: Final = 40
VALUE: Final = "value"
UNIT: Final = "unit"
_UNIT_NAMES: Final = {"in": "inch", '"': "inch", "µm": "um"}
_ENDS: Final = re.compile(rb"\r\n|\r|\n")


class GaugeError(MetrologyError):
    """A line that is not a reading; the message shows the line and the remedy."""


_MITUTOYO: Final = re.compile(r"(\d\d)A([+-])(\d{1,8}\.\d{0,6})")
_MITUTOYO_ERROR: Final = re.compile(r"9\d\d?")
_MILLIMAR: Final = re.compile(
    r"1 (?P<value>[+-]\d{1,6}\.\d{1,6}) (?P<unit>mm|um|inch)(?: [<=>]){0,2} ?", re.ASCII
)
_MILLIMAR_ERROR: Final = re.compile(r"1 ERR\d+.*")
_SYLVAC: Final = re.compile(r"([+ -])(\d{1,8}\.\d{1,6})([<=>]?)")
_REMEDY: Final = (
    "a sign in front, a decimal point, no unit; set its output to this, choose another --gauge-kind, or "
    "type the readings (without --gauge)"
)
_SYLVAC_ERROR: Final = re.compile(r"ERR ?\d+")


def pattern_of(text: str) -> re.Pattern[str]:
    r"""Return the compiled pattern of the user.

    Raises:
        GaugeError: it is not a regular expression, or has no group named value.

    >>> pattern_of(r"X\s*(?P<value>[+-]?\d+\.\d+)").fullmatch("X  +1.25")["value"]
    '+1.25'
    """
    try:
        pattern = re.compile(text, re.ASCII)
    except re.error as error:
        raise GaugeError(f"--gauge-pattern {text!r}: not a regular expression: {error}") from None
    if VALUE not in pattern.groupindex:
        raise GaugeError(
            f"--gauge-pattern {text!r}: the number must be a group with the name value, as in "
            r"'X(?P<value>[+-]?\d+\.\d+)'"
        )
    return pattern


def reading_of(
    kind: GaugeKind, line: bytes, pattern: re.Pattern[str] | None = None, unit: str = "mm"
) -> float:
    r"""Return the number in a line without its end, in the units that the gauge shows.

    ``pattern`` is that of the kind ``pattern``; ``unit`` is the expected unit of the number. A unit in the
    line must match it.

    Raises:
        GaugeError: the line is an error of the gauge, has another unit, or is not a reading.

    >>> reading_of(GaugeKind.MITUTOYO, b"01A+0012.345")
    12.345
    >>> reading_of(GaugeKind.SYLVAC, b"-0.020")
    -0.02
    """
    try:
        text = line.decode("ascii")
    except UnicodeDecodeError:
        raise _unreadable(kind, line, "bytes that are not ASCII: check baud rate, parity and bits") from None
    if kind is GaugeKind.MITUTOYO:
        return _mitutoyo(text)
    if kind is GaugeKind.PATTERN:
        assert pattern is not None, "the kind has one"
        return _matching(text, pattern, unit)
    if kind is GaugeKind.MILLIMAR:
        return _millimar(text, unit)
    return _sylvac(text)


def _mitutoyo(text: str) -> float:
    found = _MITUTOYO.fullmatch(text)
    if found is not None:
        return float(found[2] + found[3])
    if _MITUTOYO_ERROR.fullmatch(text):
        raise GaugeError(
            f"the interface reports {text!r}, no reading from the gauge: check that the gauge is on "
            "and plugged in"
        )
    raise _unreadable(GaugeKind.MITUTOYO, text.encode(), f"it must be as in 01A+0012.345, {_REMEDY}")


def _sylvac(text: str) -> float:
    found = _SYLVAC.fullmatch(text)
    if found is not None:
        return float((found[1].strip() or "+") + found[2])
    if _SYLVAC_ERROR.fullmatch(text):
        raise GaugeError(f"the gauge reports {text!r}: look at its display")
    raise _unreadable(GaugeKind.SYLVAC, text.encode(), f"it must be as in +12.345, {_REMEDY}")


def _millimar(text: str, unit: str) -> float:
    if _MILLIMAR.fullmatch(text):
        return _matching(text, _MILLIMAR, unit)
    if _MILLIMAR_ERROR.fullmatch(text):
        raise GaugeError(f"the instrument reports {text[:SHOWN]!r}: check that feature 1 is on")
    raise _unreadable(GaugeKind.MILLIMAR, text.encode(), f"it must be as in 1 +012.345 um, {_REMEDY}")


def _matching(text: str, pattern: re.Pattern[str], unit: str) -> float:
    found = pattern.fullmatch(text)
    if found is None:
        raise GaugeError(f"the line {text[:SHOWN]!r} does not match --gauge-pattern {pattern.pattern!r}")
    number = to_decimal((found[VALUE] or "").replace(" ", "").replace(",", "."))
    if number is None:
        raise GaugeError(
            f"the line {text[:SHOWN]!r}: --gauge-pattern finds {found[VALUE]!r}, which is not a number: "
            "correct it"
        )
    shown = found[UNIT] if UNIT in pattern.groupindex else None
    if shown is not None and _UNIT_NAMES.get(shown, shown) != unit:
        raise GaugeError(
            f"the line {text[:SHOWN]!r} is in {shown}, but the reading units are {unit}: give "
            f"--reading-units {_UNIT_NAMES.get(shown, shown)}, or set the instrument to {unit}"
        )
    return number


def _unreadable(kind: GaugeKind, line: bytes, why: str) -> GaugeError:
    shown = line[:SHOWN].decode("latin-1")
    return GaugeError(f"the line {shown!r} is not a reading of a {kind.value} gauge: {why}")


class GaugeLines:
    r"""Splits the data of a gauge into lines; CR, LF and CR LF end one. Empty lines are dropped.

    >>> lines = GaugeLines()
    >>> lines.feed(b"+1.5\r\n+2"), lines.feed(b".5\r"), lines.rest
    ([b'+1.5'], [b'+2.5'], b'')
    """

    def __init__(self) -> None:
        self.rest = b""
        """The bytes of an incomplete line."""

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes; return the lines that are now complete.

        Raises:
            GaugeError: too many bytes without a line end.
        """
        *lines, self.rest = _ENDS.split(self.rest + data)
        if len(self.rest) > LONGEST_LINE:
            shown = self.rest[:SHOWN].decode("latin-1")
            self.rest = b""
            raise GaugeError(f"{shown!r}… and no end of the line: check baud rate, parity and --gauge-kind")
        return [line for line in lines if line]
