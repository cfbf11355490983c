"""What both Siemens dialects have in common: lines that assign, numbers, a grid from MIN to MAX, an end.

``;`` begins a comment, blanks stand anywhere, words are in any case. A file ends with M17, M02 or M30; one
that is run as a program has M0, M30 or both before it. Numbers may be hexadecimal, as the control saves them:
'H0', 'H1F'.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final, NamedTuple

from gateway.compensation.units import Units
from gateway.tabfile.decoded import SourceRow
from gateway.tabfile.errors import Problem, TabFileError
from gateway.tabfile.fields import DECIMAL_ALLOWED, to_decimal
from gateway.tabfile.options import MAX_POSITION
from gateway.tabfile.stated import is_closed
from gateway.tabfile.text import MAX_LINES, Line, SourceText, shown

SUFFIX: Final = ".ini"
DECIMALS: Final = 8
PLAUSIBLE: Final = {Units.INCH: 0.1, Units.MM: 0.5, Units.DEGREE: 0.5}
GRID: Final = ("STEP", "MIN", "MAX", "IS_MODULO")
"""Numbers that a table must have, by their names."""
AXIS_NAME: Final = "[A-Z][A-Z0-9_]*"
_MAX_PROBLEMS: Final = 20
_GRID_TOLERANCE: Final = 1e-6
"""MAX may miss MIN + k x STEP by this fraction of a step."""
_SHOWN: Final = 10
_DATA: Final = re.compile(r"(?i)CHANDATA\s*\(\s*[0-9]{1,2}\s*\)")
_END: Final = re.compile(r"(?i)M(17|0?2|30)")
_STOPS: Final = (re.compile("(?i)M30"), re.compile("(?i)M00?"))
"""What may stand before M17 in a file that is run as a program, the last first: it stops there."""
_HEX: Final = re.compile(r"(?i)'H([0-9A-F]{1,8})'")
_EXPONENT: Final = re.compile(r"(?i)(?<=[0-9.])EX(?=[+-]?[0-9])")
_LETTER: Final = re.compile("[A-Z][0-9]{0,2}")
"""Names of axes, such as X1, that tell the letter of the axis; AX1 does not."""


class Number(NamedTuple):
    """A number and the line that it stands on."""

    value: float
    line: int


def assign(
    source: SourceText, header: re.Pattern[str], allowed: str, take: Callable[[Line, str], str]
) -> None:
    """Give each line that is neither header nor end to ``take``, which returns what is wrong with it, or "".

    Raises:
        TabFileError: lines that are wrong, a line after the end, no end.
    """
    lines = [(line, text) for line in source.lines if (text := line.text.split(";")[0].strip())]
    end = next((index for index, (_, text) in enumerate(lines) if _END.fullmatch(text)), len(lines))
    if end == len(lines) - 2 and _STOPS[0].fullmatch(lines[end][1]) and _END.fullmatch(lines[-1][1]):
        end += 1
    first_stop = end
    for stop in _STOPS:
        if 0 < first_stop < len(lines) and stop.fullmatch(lines[first_stop - 1][1]):
            first_stop -= 1
    problems: list[Problem] = []
    is_above = True
    for index, (line, text) in enumerate(lines):
        is_head = (index == 0 and header.fullmatch(text)) or (is_above and _DATA.fullmatch(text))
        if is_head or first_stop <= index <= end:
            continue
        is_above = False
        found = "a line after the end" if index > end else take(line, text)
        if found:
            problems.append(source.problem(f"{found} in {shown(line.text)}", allowed, line=line.number))
    if problems:
        raise TabFileError(*problems[:_MAX_PROBLEMS])
    if end == len(lines):
        raise source.error(
            "the end of the file without M17", "M17 at the end: is the file whole?", line=source.last_line
        )
    if is_above:
        raise source.error("no compensation values", allowed)


def number_of(text: str) -> float | None:
    """Return the number that a value is, None where it is none.

    >>> number_of("'H1F'"), number_of("1.5EX-3"), number_of("1,5")
    (31.0, 0.0015, None)
    """
    hexadecimal = _HEX.fullmatch(text)
    return float(int(hexadecimal[1], 16)) if hexadecimal else to_decimal(_EXPONENT.sub("E", text))


def no_number(text: str) -> str:
    """Say that a value is no number."""
    return f"{shown(text)}, which is not {DECIMAL_ALLOWED},"


def twice(before: tuple[object, int], entry: tuple[object, int]) -> str:
    """Say that something is there already, "" where it was not."""
    return "" if before is entry else f"a second value (the first is on line {before[1]})"


def letter_of(axis: str) -> str | None:
    """Return the letter that the name of a machine axis tells."""
    return axis[0] if _LETTER.fullmatch(axis) else None


def check_there(source: SourceText, name: str, missing: Iterable[str]) -> None:
    """Check that nothing is missing in the table of this name.

    Raises:
        TabFileError: these are.
    """
    names = ", ".join(missing)
    if names:
        raise source.error(
            f"{name}: no {names}", "each once: the control would go on with what it was loaded with before"
        )


def check_grid(
    source: SourceText, name: str, numbers: Mapping[str, Number], values: Mapping[int, Number]
) -> None:
    """Check that a table has every point from MIN to MAX and no other.

    Raises:
        TabFileError: a step or ends that make no grid, a point that is missing or beyond MAX, another
            IS_MODULO than 0 and 1.
    """
    step, low, high, modulo = (numbers[key] for key in GRID)
    if modulo.value not in {0.0, 1.0}:
        raise source.error(f"{name}: IS_MODULO {modulo.value:g}", "0 or 1", line=modulo.line)
    if not step.value > 0:
        raise source.error(f"{name}: STEP {step.value:g}", "a distance above 0", line=step.line)
    if not -MAX_POSITION < low.value < high.value < MAX_POSITION:
        raise source.error(f"{name}: MIN {low.value:g}, MAX {high.value:g}", "MIN below MAX", line=high.line)
    intervals = (high.value - low.value) / step.value
    last = round(min(intervals, MAX_LINES))
    if abs(last - intervals) > _GRID_TOLERANCE or last < 1:
        raise source.error(
            f"{name}: {intervals:.9g} steps of {step.value:g} from MIN {low.value:g} to MAX {high.value:g}",
            "a whole number of steps",
            line=step.line,
        )
    missing = [index for index in range(last + 1) if index not in values]
    if missing:
        raise source.error(
            f"{len(missing)} of {last + 1} points of {name} missing: {_listed(missing)}",
            f"every point from 0 to {last}, which is MAX: the control would keep older values in a gap",
            line=high.line,
        )
    beyond = sorted(index for index in values if index > last)
    if beyond:
        raise source.error(
            f"points of {name} beyond MAX, which is point {last}: {_listed(beyond)}",
            f"points from 0 to {last}, or another MAX",
            line=values[beyond[0]].line,
        )


def _listed(indices: Iterable[int]) -> str:
    names = [str(index) for index in indices]
    return ", ".join(names[:_SHOWN]) + (", …" if len(names) > _SHOWN else "")


def positions(numbers: Mapping[str, Number], count: int) -> Iterator[float]:
    """Yield the positions of a grid, from its nearer end: both ends are exactly what the file says."""
    step, low, high, _ = (numbers[key].value for key in GRID)
    last = count - 1
    for index in range(count):
        yield low + index * step if 2 * index <= last else high - (last - index) * step


def turn_of(source: SourceText, numbers: Mapping[str, Number], rows: tuple[SourceRow, ...]) -> float | None:
    """Return the length after which the table begins again, None where it does not.

    Raises:
        TabFileError: it begins again with other values than it ends with.
    """
    if not numbers["IS_MODULO"].value:
        return None
    if not is_closed(rows):
        raise source.error(
            f"IS_MODULO 1, but {rows[0].forward_value:g} at MIN and {rows[-1].forward_value:g} at MAX: the "
            "axis would jump where the table begins again",
            "the same value at both, or IS_MODULO 0",
            line=rows[-1].forward_line,
        )
    return rows[-1].position - rows[0].position


def edges(turn: float | None) -> tuple[str, ...]:
    """Return the settings of an axis that does at the ends what the control does."""
    return ('outside = "hold"',) if turn is None else (f"modulo = {turn:.10g}",)


def axis_to_write(name: str | None, letter: str | None) -> str:
    """Return the name of a machine axis; without one it is the letter of the axis and 1 (``X1``)."""
    return (name or (f"{letter}1" if letter else "")).upper()


def written(value: float) -> str:
    """Return a value with its decimals."""
    return f"{round(value, DECIMALS) + 0.0:.{DECIMALS}f}"


def losses(units: Units) -> str:
    """Say what no such file holds."""
    return f"values are rounded to {DECIMALS} decimals; units ({units.value}) are not in the file"


def exactly(value: float) -> str:
    """Return a position or a distance."""
    return repr(float(f"{value:.12g}"))
