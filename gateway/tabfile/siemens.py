"""Siemens SINUMERIK 840D and 808D encoder error compensation, ``_N_AX_EEC_INI`` files.

Grammar, after the function manuals (K3, interpolatory compensation) and their example; ``e`` is the number of
the measuring system, ``;`` begins a comment, blanks stand anywhere, words are in any case::

    %_N_name_EEC_INI                                at most once, first
    CHANDATA(n)                                     before the numbers, if at all
    $AA_ENC_COMP[e,N,axis] = value                  every N from 0 to k, each once, in any order
    $AA_ENC_COMP_STEP[e,axis] = distance
    $AA_ENC_COMP_MIN[e,axis] = position of N = 0
    $AA_ENC_COMP_MAX[e,axis] = position of N = k
    $AA_ENC_COMP_IS_MODULO[e,axis] = 0 | 1
    M17                                             or M02, M30; once, last. A file that is run as a program
                                                    has M0 or M30 before its M17

Numbers may be hexadecimal, as the control saves them: 'H0', 'H1F'.

MIN + k x STEP must be MAX. The control would fill a gap, and a parameter that is not in the file, with what
it was loaded with before; here both are errors, and so is a file without its end.

A value is the error of the measuring system: the control adds it to the actual position, so the axis moves
the other way ("a positive compensation value moves the axis in the negative direction"). It is subtracted,
in both directions; a table knows nothing of the direction. Outside, the end values stay; with IS_MODULO the
table begins again, so the ends must be equal. The file states no units. Sag compensation (CEC) tables are
another thing (:mod:`gateway.tabfile.siemens_cec`) and refused beside these.
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.context import MAX_POSITION, FileContext
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import Problem, TabFileError
from gateway.tabfile.fields import DECIMAL_ALLOWED, to_decimal
from gateway.tabfile.ranges import context_in_file_units, told_units
from gateway.tabfile.stated import check_stated, is_closed
from gateway.tabfile.text import MAX_LINES, Line, SourceText, listed, shown
from gateway.tabfile.writing import WriteOptions, Written, even_step, one_curve, unwritable

NAME: Final = "siemens-eec"
TITLE: Final = "Siemens SINUMERIK _EEC_INI: errors of the measuring system, one direction"
SUFFIX: Final = ".ini"
DECIMALS: Final = 8
MAX_PROBLEMS: Final = 20
GRID_TOLERANCE: Final = 1e-6
"""MAX may miss MIN + k x STEP by this fraction of a step."""
_SHOWN: Final = 10
_PLAUSIBLE: Final = {Units.INCH: 0.1, Units.MM: 0.5, Units.DEGREE: 0.5}
_SIGN: Final = re.compile(r"(?i)_EEC_INI|\$AA_ENC_COMP")
_CEC: Final = re.compile(r"(?i)\$AN_CEC|_CEC_INI")
_HEADER: Final = re.compile(r"(?i)%_N_[A-Z0-9_]*EEC_INI")
_DATA: Final = re.compile(r"(?i)CHANDATA\s*\(\s*[0-9]{1,2}\s*\)")
_END: Final = re.compile(r"(?i)M(17|0?2|30)")
_STOP: Final = re.compile(r"(?i)M(0|00|30)")
"""What stands before M17 in a file that is run as a program: it stops there."""
_HEX: Final = re.compile(r"(?i)'H([0-9A-F]{1,8})'")
_ASSIGNMENT: Final = re.compile(
    r"(?i)\$AA_ENC_COMP(?P<key>_STEP|_MIN|_MAX|_IS_MODULO)?\s*\[\s*(?P<encoder>[0-9])\s*,"
    r"\s*(?:(?P<index>[0-9]{1,6})\s*,\s*)?(?P<axis>[A-Z][A-Z0-9_]*)\s*\]\s*=\s*(?P<value>\S+)"
)
_LETTER: Final = re.compile("[A-Z][0-9]{0,2}")
"""Names of axes, such as X1, that tell the letter of the axis; AX1 does not."""
_EXPONENT: Final = re.compile(r"(?i)(?<=[0-9.])EX(?=[+-]?[0-9])")
_KEYS: Final = ("STEP", "MIN", "MAX", "IS_MODULO")
_ALLOWED: Final = (
    "$AA_ENC_COMP[e,N,axis]=value, its _STEP, _MIN, _MAX, _IS_MODULO [e,axis]=value, or M17 at the end"
)
_RULE: Final = "value is the error of the measuring system: subtracted, in both directions"


class _Number(NamedTuple):
    value: float
    line: int


@dataclass(frozen=True, slots=True)
class _Table:
    """One axis on one measuring system."""

    values: dict[int, _Number] = field(default_factory=dict)
    parameters: dict[str, _Number] = field(default_factory=dict)


_Tables = dict[tuple[str, str], _Table]


def recognise(source: SourceText) -> bool:
    """Whether it names compensation of an encoder; beside it sag compensation is refused by :func:`read`."""
    return any(_SIGN.search(line.text) for line in source.lines)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the table of one axis on one measuring system.

    Raises:
        TabFileError: no units were told, a line that is not grammar, no end, a point that is missing or
            listed twice, a grid that does not end at MAX, several tables and none told, a turn that does not
            close, a range that does not fit the travel.
    """
    for line in source.lines:
        if _CEC.search(line.text):
            raise source.error(
                f"a sag compensation (CEC) table: {shown(line.text)}",
                "encoder error compensation, $AA_ENC_COMP, or the CEC tables in a file of their own",
                line=line.number,
            )
    units = told_units(source, context, "a Siemens compensation file")
    tables = _parse(source)
    name, table = _choose(source, tables, context)
    context = context_in_file_units(source, context, units)
    rows = _rows(source, table, name)
    check_stated(source, rows, units, context)
    is_modulo = _is_modulo(source, table, rows)
    turn = rows[-1].position - rows[0].position
    return Decoded(
        rows,
        units,
        context,
        units.value,
        _RULE,
        _RULE,
        axis=name[1][0] if _LETTER.fullmatch(name[1]) else None,
        file_axis=",".join(name),
        plausible=(0.0, _PLAUSIBLE[units]),
        decisions=(
            f"axis {name[1]}, measuring system {name[0]}",
            f"{len(rows)} points, all from 0 to {len(rows) - 1} and each once",
            *((f"one turn of {turn:.10g}, then it begins again",) if is_modulo else ()),
        ),
        behaves_as=(f"modulo = {turn:.10g}",) if is_modulo else ('outside = "hold"',),
        modulo=turn if is_modulo else None,
    )


def _parse(source: SourceText) -> _Tables:
    tables: _Tables = {}
    problems: list[Problem] = []
    lines = [(line, text) for line in source.lines if (text := line.text.split(";")[0].strip())]
    end = next((index for index, (_, text) in enumerate(lines) if _END.fullmatch(text)), None)
    if (
        end is not None
        and end == len(lines) - 2
        and _STOP.fullmatch(lines[end][1])
        and _END.fullmatch(lines[-1][1])
    ):
        end += 1
    for index, (line, text) in enumerate(lines):
        is_head = (index == 0 and _HEADER.fullmatch(text)) or (not tables and _DATA.fullmatch(text))
        is_stop = end is not None and index == end - 1 and _STOP.fullmatch(text)
        if is_head or is_stop or index == end:
            continue
        found = "a line after the end" if end is not None and index > end else _add(tables, line, text)
        if found is not None:
            problems.append(source.problem(f"{found} in {shown(line.text)}", _ALLOWED, line=line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if end is None:
        raise source.error(
            "the end of the file without M17", "M17 at the end: is the file whole?", line=source.last_line
        )
    if not tables:
        raise source.error("no compensation values", _ALLOWED)
    return tables


def _add(tables: _Tables, line: Line, text: str) -> str | None:
    """Add what a line assigns; return what is wrong with it."""
    match = _ASSIGNMENT.fullmatch(text)
    if match is None:
        return "something else"
    hexadecimal = _HEX.fullmatch(match["value"])
    value = float(int(hexadecimal[1], 16)) if hexadecimal else to_decimal(_EXPONENT.sub("E", match["value"]))
    if value is None:
        return f"{shown(match['value'])}, which is not {DECIMAL_ALLOWED},"
    table = tables.setdefault((match["encoder"], match["axis"].upper()), _Table())
    number = _Number(value, line.number)
    if (match["key"] is None) != (match["index"] is not None):
        return "a wrong number of indices"
    if match["key"] is None:
        before = table.values.setdefault(int(match["index"]), number)
    else:
        before = table.parameters.setdefault(match["key"][1:].upper(), number)
    return None if before is number else f"a second value (the first is on line {before.line})"


def _choose(source: SourceText, tables: _Tables, context: FileContext) -> tuple[tuple[str, str], _Table]:
    systems = Counter(axis for _, axis in tables)
    names = {
        (axis if systems[axis] == 1 else f"{encoder},{axis}"): (encoder, axis)
        for encoder, axis in sorted(tables)
    }
    told = context.file_axis
    if told is not None:
        full = {f"{encoder},{axis}": (encoder, axis) for encoder, axis in tables}
        name = (full | names).get(told.upper().replace(" ", ""))
        if name is None:
            raise source.error(
                f"tables of {listed(names)}, told file_axis {told!r}", f"file_axis = {listed(names, ' or ')}"
            )
        return name, tables[name]
    if len(names) > 1:
        raise source.error(
            f"tables of {listed(names)}",
            f"file_axis = {next(iter(names))!r}, for example (--file-axis on the command line); with two "
            "measuring systems their number comes first, as in the file",
        )
    name = next(iter(tables))
    return name, tables[name]


def _rows(source: SourceText, table: _Table, name: tuple[str, str]) -> tuple[SourceRow, ...]:
    inside = f"[{name[0]},{name[1]}]"
    missing = [f"$AA_ENC_COMP_{key}{inside}" for key in _KEYS if key not in table.parameters]
    if missing:
        raise source.error(
            f"no {', '.join(missing)}",
            "each once: the control would go on with what it was loaded with before",
        )
    step, low, high = (table.parameters[key] for key in ("STEP", "MIN", "MAX"))
    if not step.value > 0:
        raise source.error(f"STEP {step.value:g}", "a distance above 0", line=step.line)
    if not -MAX_POSITION < low.value < high.value < MAX_POSITION:
        raise source.error(f"MIN {low.value:g}, MAX {high.value:g}", "MIN below MAX", line=high.line)
    intervals = (high.value - low.value) / step.value
    last = round(min(intervals, MAX_LINES))
    if abs(last - intervals) > GRID_TOLERANCE or last < 1:
        raise source.error(
            f"{intervals:.9g} steps of {step.value:g} from MIN {low.value:g} to MAX {high.value:g}",
            "a whole number of steps",
            line=step.line,
        )
    _check_indices(source, table, last, inside)
    rows = []
    for index in range(last + 1):
        error, line = table.values[index]
        # From the nearer end, so that both ends are exactly what the file says.
        position = (
            low.value + index * step.value if 2 * index <= last else high.value - (last - index) * step.value
        )
        rows.append(SourceRow(position, 0.0 - error, 0.0 - error, error, error, line, line))
    return tuple(rows)


def _check_indices(source: SourceText, table: _Table, last: int, inside: str) -> None:
    missing = [index for index in range(last + 1) if index not in table.values]
    if missing:
        raise source.error(
            f"{len(missing)} of {last + 1} points of {inside} missing: {_listed(missing)}",
            f"every point from 0 to {last}, which is MAX: the control would keep older values in a gap",
            line=table.parameters["MAX"].line,
        )
    beyond = sorted(index for index in table.values if index > last)
    if beyond:
        raise source.error(
            f"points of {inside} beyond MAX, which is point {last}: {_listed(beyond)}",
            f"points from 0 to {last}, or another MAX",
            line=table.values[beyond[0]].line,
        )


def _listed(indices: Iterable[int]) -> str:
    names = [str(index) for index in indices]
    return ", ".join(names[:_SHOWN]) + (", …" if len(names) > _SHOWN else "")


def _is_modulo(source: SourceText, table: _Table, rows: tuple[SourceRow, ...]) -> bool:
    modulo = table.parameters["IS_MODULO"]
    if modulo.value not in {0.0, 1.0}:
        raise source.error(f"IS_MODULO {modulo.value:g}", "0 or 1", line=modulo.line)
    if modulo.value and not is_closed(rows):
        raise source.error(
            f"IS_MODULO 1, but {rows[0].forward_value:g} at MIN and {rows[-1].forward_value:g} at MAX: the "
            "axis would jump where the table begins again",
            "the same value at both, or IS_MODULO 0",
            line=rows[-1].forward_line,
        )
    return bool(modulo.value)


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table for one axis and its first measuring system, one curve for both directions.

    ``file_axis`` is the name of the machine axis; without one it is the letter of the axis and 1 (``X1``).

    Raises:
        TabFileError: no axis, or points that are not evenly spaced.
    """
    step = even_step(table, NAME)
    encoder, axis = _name(options)
    curve, losses = one_curve(table)
    inside = f"{encoder},{axis}"
    intervals = len(table.positions) - 1
    lines = [
        f"%_N_{axis}_EEC_INI",
        "CHANDATA(1)",
        *(
            f"$AA_ENC_COMP[{encoder},{index},{axis}]={_number(0.0 - correction)}"
            for index, correction in enumerate(curve)
        ),
        f"$AA_ENC_COMP_STEP[{inside}]={float(f'{step:.12g}')!r}",
        f"$AA_ENC_COMP_MIN[{inside}]={float(f'{table.first:.12g}')!r}",
        f"$AA_ENC_COMP_MAX[{inside}]={float(f'{table.last:.12g}')!r}",
        f"$AA_ENC_COMP_IS_MODULO[{inside}]={int(options.is_modulo)}",
        "M17",
    ]
    losses = (
        *losses,
        f"values are rounded to {DECIMALS} decimals; units ({table.units.value}) are not in the file",
        f"the control needs room for {intervals + 1} points (MD38000) and MD32700 = 0 while it is loaded",
    )
    context = FileContext(file_units=table.units, file_axis=axis)
    return Written("".join(f"{line}\n" for line in lines), losses, context)


def _name(options: WriteOptions) -> tuple[str, str]:
    name = options.file_axis or (f"{options.axis}1" if options.axis else "")
    match = re.fullmatch(r"(?:([0-9]),)?([A-Z][A-Z0-9_]*)", name.upper())
    if match is None:
        raise unwritable(
            NAME, f"axis {name!r}", "the name of a machine axis, such as X1: --to-file-axis NAME"
        )
    return match[1] or "0", match[2]


def _number(value: float) -> str:
    return f"{round(value, DECIMALS) + 0.0:.{DECIMALS}f}"
