"""Siemens SINUMERIK 840D and 808D encoder error compensation, ``_N_AX_EEC_INI`` files.

Grammar, from the function manuals (K3, interpolatory compensation) and their example. ``e`` is the number of
the measuring system, ``;`` begins a comment, blanks are allowed anywhere, words are in any case::

    %_N_name_EEC_INI                                at most once, first
    CHANDATA(n)                                     before the numbers, if at all
    $AA_ENC_COMP[e,N,axis] = value                  every N from 0 to k, each once, in any order
    $AA_ENC_COMP_STEP[e,axis] = distance
    $AA_ENC_COMP_MIN[e,axis] = position of N = 0
    $AA_ENC_COMP_MAX[e,axis] = position of N = k
    $AA_ENC_COMP_IS_MODULO[e,axis] = 0 | 1
    M17                                             or M02, M30; once, last. A file that is run as a program
                                                    has M0, M30 or both before its M17

MIN + k x STEP must be MAX. The control would fill a gap, or a parameter that is not in the file, with its
previous value. Here both are errors, and so is a file without its end.

A value is the error of the measuring system: the control adds it to the actual position, so the axis moves
the other way ("a positive compensation value moves the axis in the negative direction"). It is subtracted in
both directions; a table does not depend on the direction. Outside, the end values hold. With IS_MODULO the
table repeats, so the ends must be equal. The file states no units. Sag compensation (CEC) tables are
different (:mod:`gateway.tabfile.siemens_cec`) and refused in the same file.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final, NamedTuple

from msgspec import Struct, field

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import check_stated, context_in_file_units, is_closed, required_units
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import MAX_POSITION, FileContext, option_hint
from gateway.tabfile.text import DECIMAL_ALLOWED, MAX_LINES, SourceLine, SourceText, listed, shown, to_decimal
from gateway.tabfile.writing import WriteOptions, Written, even_step, one_curve, unwritable

# --- Assignments, a grid from MIN to MAX, an end: shared with :mod:`gateway.tabfile.siemens_cec`
#
# ``;`` begins a comment, blanks are allowed anywhere, words are in any case. A file ends with M17, M02 or
# M30. A file that is run as a program has M0, M30 or both before it. Numbers may be hexadecimal, as saved by
# the control: 'H0', 'H1F'.

SUFFIX: Final = ".ini"
DECIMALS: Final = 8
PLAUSIBLE: Final = {Units.INCH: 0.1, Units.MM: 0.5, Units.DEGREE: 0.5}
GRID: Final = ("STEP", "MIN", "MAX", "IS_MODULO")
"""Numbers that a table must have, by name."""
AXIS_NAME: Final = "[A-Z][A-Z0-9_]*"
_MAX_PROBLEMS: Final = 20
_GRID_TOLERANCE: Final = 1e-6
"""MAX may differ from MIN + k x STEP by this fraction of a step."""
_SHOWN: Final = 10
_DATA: Final = re.compile(r"(?i)CHANDATA\s*\(\s*[0-9]{1,2}\s*\)")
_END: Final = re.compile(r"(?i)M(17|0?2|30)")
_STOPS: Final = (re.compile("(?i)M30"), re.compile("(?i)M00?"))
"""What may precede M17 in a file that is run as a program, last first: the program stops there."""
_HEX: Final = re.compile(r"(?i)'H([0-9A-F]{1,8})'")
_EXPONENT: Final = re.compile(r"(?i)(?<=[0-9.])EX(?=[+-]?[0-9])")
_LETTER: Final = re.compile("[A-Z][0-9]{0,2}")
"""Names of axes, such as X1, that contain the letter of the axis; AX1 does not."""


class Number(NamedTuple):
    """A number and its line."""

    value: float
    line: int


def assign(
    source: SourceText, header: re.Pattern[str], allowed: str, take: Callable[[SourceLine, str], str]
) -> None:
    """Pass each line that is neither header nor end to ``take``, which returns its error, or "".

    Raises:
        TabFileError: lines with errors, a line after the end, no end.
    """
    lines = [(line, text) for line in source.lines if (text := line.text.split(";")[0].strip())]
    end = next((index for index, (_, text) in enumerate(lines) if _END.fullmatch(text)), len(lines))
    if end == len(lines) - 2 and _STOPS[0].fullmatch(lines[end][1]) and _END.fullmatch(lines[-1][1]):
        end += 1
    first_stop = end
    for stop in _STOPS:
        if 0 < first_stop < len(lines) and stop.fullmatch(lines[first_stop - 1][1]):
            first_stop -= 1
    problems: list[FileProblem] = []
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
            "the end of the file without M17",
            "M17 at the end: check that the file is complete",
            line=source.last_line,
        )
    if is_above:
        raise source.error("no compensation values", allowed)


def number_of(text: str) -> float | None:
    """Return the number in a value, or None.

    >>> number_of("'H1F'"), number_of("1.5EX-3"), number_of("1,5")
    (31.0, 0.0015, None)
    """
    hexadecimal = _HEX.fullmatch(text)
    return float(int(hexadecimal[1], 16)) if hexadecimal else to_decimal(_EXPONENT.sub("E", text))


def no_number(text: str) -> str:
    """Return the error of a value that is not a number."""
    return f"{shown(text)}, which is not {DECIMAL_ALLOWED},"


def twice(before: tuple[object, int], entry: tuple[object, int]) -> str:
    """Return the error of a repeated entry, "" if it is not repeated."""
    return "" if before is entry else f"a second value (the first is on line {before[1]})"


def letter_of(axis: str) -> str | None:
    """Return the letter in the name of a machine axis."""
    return axis[0] if _LETTER.fullmatch(axis) else None


def check_there(source: SourceText, name: str, missing: Iterable[str]) -> None:
    """Check that nothing is missing in the table of this name.

    Raises:
        TabFileError: ``missing`` is not empty.
    """
    names = ", ".join(missing)
    if names:
        raise source.error(f"{name}: no {names}", "each once: the control would keep its older value")


def check_grid(
    source: SourceText, name: str, numbers: Mapping[str, Number], values: Mapping[int, Number]
) -> None:
    """Check that a table has every point from MIN to MAX and no other.

    Raises:
        TabFileError: a step or ends that make no grid, a point that is missing or beyond MAX, an IS_MODULO
            other than 0 and 1.
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
            f"every point from 0 to {last}, which is MAX: in a gap the control would keep older values",
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
    """Yield the positions of a grid, each from its nearer end: both ends are exactly those of the file."""
    step, low, high, _ = (numbers[key].value for key in GRID)
    last = count - 1
    for index in range(count):
        yield low + index * step if 2 * index <= last else high - (last - index) * step


def revolution_of(
    source: SourceText, numbers: Mapping[str, Number], rows: tuple[SourceRow, ...]
) -> float | None:
    """Return the length after which the table repeats, None if it does not.

    Raises:
        TabFileError: it repeats, but its first values differ from its last.
    """
    if not numbers["IS_MODULO"].value:
        return None
    if not is_closed(rows):
        raise source.error(
            f"IS_MODULO 1, but {rows[0].forward_value:g} at MIN and {rows[-1].forward_value:g} at MAX: the "
            "axis would jump where the table repeats",
            "the same value at both, or IS_MODULO 0",
            line=rows[-1].forward_line,
        )
    return rows[-1].position - rows[0].position


def edges(revolution: float | None) -> tuple[str, ...]:
    """Return the axis settings for the control's behaviour at the ends."""
    return ('outside = "hold"',) if revolution is None else (f"modulo = {revolution:.10g}",)


def axis_to_write(name: str | None, letter: str | None) -> str:
    """Return the name of a machine axis; the default is the letter of the axis and 1 (``X1``)."""
    return (name or (f"{letter}1" if letter else "")).upper()


def written(value: float) -> str:
    """Return a value with its decimals."""
    return f"{round(value, DECIMALS) + 0.0:.{DECIMALS}f}"


def losses(units: Units) -> str:
    """Return the losses of every such file."""
    return f"values are rounded to {DECIMALS} decimals; units ({units.value}) are not in the file"


def exactly(value: float) -> str:
    """Return the text of a position or a distance."""
    return repr(float(f"{value:.12g}"))


# --- Encoder error compensation

NAME: Final = "siemens-eec"
TITLE: Final = "Siemens SINUMERIK _EEC_INI: errors of the measuring system, one direction"
USES: Final = frozenset({"file_start", "file_axis"})
_SIGN: Final = re.compile(r"(?i)_EEC_INI|\$AA_ENC_COMP")
_CEC: Final = re.compile(r"(?i)\$AN_CEC|_CEC_INI")
_HEADER: Final = re.compile(r"(?i)%_N_[A-Z0-9_]*EEC_INI")
_ASSIGNMENT: Final = re.compile(
    r"(?i)\$AA_ENC_COMP(?P<key>_STEP|_MIN|_MAX|_IS_MODULO)?\s*\[\s*(?P<encoder>[0-9])\s*,"
    r"\s*(?:(?P<index>[0-9]{1,6})\s*,\s*)?(?P<axis>[A-Z][A-Z0-9_]*)\s*\]\s*=\s*(?P<value>\S+)"
)
_ALLOWED: Final = (
    "$AA_ENC_COMP[e,N,axis]=value, its _STEP, _MIN, _MAX, _IS_MODULO [e,axis]=value, or M17 at the end"
)
_RULE: Final = "value is the error of the measuring system: subtracted, in both directions"


class _Table(Struct, frozen=True):
    """One axis on one measuring system."""

    values: dict[int, Number] = field(default_factory=dict)
    numbers: dict[str, Number] = field(default_factory=dict)


_Tables = dict[tuple[str, str], _Table]


def recognise(source: SourceText) -> bool:
    """Whether it names compensation of an encoder; :func:`read` refuses sag compensation beside it."""
    return any(_SIGN.search(line.text) for line in source.lines)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the table of one axis on one measuring system.

    Raises:
        TabFileError: no units given, a line outside the grammar, no end, a point that is missing or repeated,
            a grid that does not end at MAX, several tables and none given, a revolution that does not close,
            a range that does not fit the travel.
    """
    for line in source.lines:
        if _CEC.search(line.text):
            raise source.error(
                f"a sag compensation (CEC) table: {shown(line.text)}",
                "encoder error compensation, $AA_ENC_COMP, or the CEC tables in a separate file",
                line=line.number,
            )
    units = required_units(source, context, "a Siemens compensation file")
    tables = _parse(source)
    name, table = _choose(source, tables, context)
    context = context_in_file_units(source, context, units)
    rows = _rows(source, table, name)
    check_stated(source, rows, units, context)
    revolution = revolution_of(source, table.numbers, rows)
    return Decoded(
        rows,
        units,
        context,
        units.value,
        _RULE,
        _RULE,
        axis=letter_of(name[1]),
        file_axis=",".join(name),
        plausible=(0.0, PLAUSIBLE[units]),
        decisions=(
            f"axis {name[1]}, measuring system {name[0]}",
            f"{len(rows)} points, all from 0 to {len(rows) - 1} and each once",
            *((f"one turn of {revolution:.10g}, then the table repeats",) if revolution is not None else ()),
        ),
        behaves_as=edges(revolution),
        modulo=revolution,
    )


def _parse(source: SourceText) -> _Tables:
    tables: _Tables = {}
    assign(source, _HEADER, _ALLOWED, lambda line, text: _add(tables, line, text))
    return tables


def _add(tables: _Tables, line: SourceLine, text: str) -> str:
    """Add the assignment of a line; return its error."""
    match = _ASSIGNMENT.fullmatch(text)
    if match is None:
        return "something else"
    value = number_of(match["value"])
    if value is None:
        return no_number(match["value"])
    table = tables.setdefault((match["encoder"], match["axis"].upper()), _Table())
    number = Number(value, line.number)
    if (match["key"] is None) != (match["index"] is not None):
        return "a wrong number of indices"
    if match["key"] is None:
        return twice(table.values.setdefault(int(match["index"]), number), number)
    return twice(table.numbers.setdefault(match["key"][1:].upper(), number), number)


def _choose(source: SourceText, tables: _Tables, context: FileContext) -> tuple[tuple[str, str], _Table]:
    systems = Counter(axis for _, axis in tables)
    names = {
        (axis if systems[axis] == 1 else f"{encoder},{axis}"): (encoder, axis)
        for encoder, axis in sorted(tables)
    }
    given = context.file_axis
    if given is not None:
        full = {f"{encoder},{axis}": (encoder, axis) for encoder, axis in tables}
        name = (full | names).get(given.upper().replace(" ", ""))
        if name is None:
            raise source.error(
                f"tables of {listed(names)}, but file_axis = {given!r}",
                f"file_axis = {listed(names, ' or ')}",
            )
        return name, tables[name]
    if len(names) > 1:
        raise source.error(
            f"tables of {listed(names)}",
            option_hint("file_axis", f"{next(iter(names))!r}, for example")
            + "; with two measuring systems put their number first, as in the file",
        )
    name = next(iter(tables))
    return name, tables[name]


def _rows(source: SourceText, table: _Table, name: tuple[str, str]) -> tuple[SourceRow, ...]:
    inside = f"[{name[0]},{name[1]}]"
    check_there(
        source,
        inside,
        (f"$AA_ENC_COMP_{key}{inside}" for key in GRID if key not in table.numbers),
    )
    check_grid(source, inside, table.numbers, table.values)
    rows = []
    for index, position in enumerate(positions(table.numbers, len(table.values))):
        error, line = table.values[index]
        rows.append(SourceRow(position, 0.0 - error, 0.0 - error, error, error, line, line))
    return tuple(rows)


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table for one axis and its first measuring system, one curve for both directions.

    ``file_axis`` is the name of the machine axis; the default is the letter of the axis and 1 (``X1``).

    Raises:
        TabFileError: no axis, or points that are not evenly spaced.
    """
    step = even_step(table, NAME)
    encoder, axis = _name(options)
    curve, lost = one_curve(table)
    inside = f"{encoder},{axis}"
    intervals = len(table.positions) - 1
    lines = [
        f"%_N_{axis}_EEC_INI",
        "CHANDATA(1)",
        *(
            f"$AA_ENC_COMP[{encoder},{index},{axis}]={written(0.0 - correction)}"
            for index, correction in enumerate(curve)
        ),
        f"$AA_ENC_COMP_STEP[{inside}]={exactly(step)}",
        f"$AA_ENC_COMP_MIN[{inside}]={exactly(table.first)}",
        f"$AA_ENC_COMP_MAX[{inside}]={exactly(table.last)}",
        f"$AA_ENC_COMP_IS_MODULO[{inside}]={int(options.is_modulo)}",
        "M17",
    ]
    lost = (
        *lost,
        losses(table.units),
        f"the control needs room for {intervals + 1} points (MD38000) and MD32700 = 0 while it is loaded",
    )
    context = FileContext(file_units=table.units, file_axis=axis)
    return Written("".join(f"{line}\n" for line in lines), lost, context)


def _name(options: WriteOptions) -> tuple[str, str]:
    name = axis_to_write(options.file_axis, options.axis)
    match = re.fullmatch(rf"(?:([0-9]),)?({AXIS_NAME})", name)
    if match is None:
        raise unwritable(
            NAME, f"axis {name!r}", "the name of a machine axis, such as X1: --to-file-axis NAME"
        )
    return match[1] or "0", match[2]
