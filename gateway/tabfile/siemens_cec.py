"""Siemens SINUMERIK sag compensation (CEC) of an axis by its own position, for both directions.

Grammar, from the function manuals (K3, interpolatory compensation: sag, and direction-dependent leadscrew
error compensation). ``t`` is the number of a table, ``;`` begins a comment, blanks are allowed anywhere, any
case::

    %_N_name_CEC_INI                                at most once, first
    CHANDATA(n)                                     before the numbers, if at all
    $AN_CEC[t,N] = value                            every N from 0 to k, each once, in any order
    $AN_CEC_INPUT_AXIS[t] = (axis)                  the axis whose position chooses the point
    $AN_CEC_OUTPUT_AXIS[t] = (axis)                 the axis that is moved: here the same one
    $AN_CEC_STEP[t] = distance
    $AN_CEC_MIN[t] = position of N = 0
    $AN_CEC_MAX[t] = position of N = k
    $AN_CEC_DIRECTION[t] = 0 | 1 | -1               both directions, or only the positive or negative one
    $AN_CEC_MULT_BY_TABLE[t] = 0                    optional
    $AN_CEC_IS_MODULO[t] = 0 | 1
    M17                                             or M02, M30; once, last; M0, M30 or both may come before

An axis has one table of direction 0, or one of 1 and one of -1 with the same points. MIN + k x STEP must be
MAX. For a gap or a missing parameter the control would keep its previous value, so both are errors. Outside,
the end values hold; with IS_MODULO 1 the table repeats. The file states no units.

No available manual gives the sign of a value, so ``error_sense`` is required. A public program that writes
such files from measurements writes commanded - measured.
"""

import re
from dataclasses import dataclass, field
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.tabfile import siemens
from gateway.tabfile.checks import RULES, check_stated, context_in_file_units, required_sense, required_units
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.options import FileContext, option_hint
from gateway.tabfile.siemens import Number
from gateway.tabfile.text import SourceLine, SourceText, listed, shown
from gateway.tabfile.writing import WriteOptions, Written, even_step, unwritable

NAME: Final = "siemens-cec"
TITLE: Final = "Siemens SINUMERIK _CEC_INI of an axis by itself, both directions ($AN_CEC_DIRECTION)"
SUFFIX: Final = siemens.SUFFIX
USES: Final = frozenset({"file_start", "file_axis", "error_sense"})
_WHAT: Final = "a sag compensation (CEC) table"
_SIGN: Final = re.compile(r"(?i)\$AN_CEC|_CEC_INI")
_OTHER: Final = re.compile(r"(?i)\$AA_ENC_COMP|_EEC_INI")
_HEADER: Final = re.compile(r"(?i)%_N_[A-Z0-9_]*CEC_INI")
_ASSIGNMENT: Final = re.compile(
    r"(?i)\$AN_CEC(?P<key>_[A-Z_]+)?\s*\[\s*(?P<table>[0-9]{1,3})\s*"
    r"(?:,\s*(?P<index>[0-9]{1,6})\s*)?\]\s*=\s*(?P<value>\S.*)"
)
_AXIS: Final = re.compile(rf"(?i)\(\s*({siemens.AXIS_NAME})\s*\)")
_AXES: Final = ("INPUT_AXIS", "OUTPUT_AXIS")
_NUMBERS: Final = (*siemens.GRID, "DIRECTION")
_ALLOWED: Final = (
    "$AN_CEC[t,N]=value, its _INPUT_AXIS, _OUTPUT_AXIS [t]=(axis), _STEP, _MIN, _MAX, _DIRECTION, _IS_MODULO "
    "[t]=value, or M17 at the end"
)


@dataclass(slots=True)
class _Table:
    """One table; each number and axis with its line."""

    number: int
    values: dict[int, Number] = field(default_factory=dict)
    numbers: dict[str, Number] = field(default_factory=dict)
    axes: dict[str, tuple[str, int]] = field(default_factory=dict)

    @property
    def grid(self) -> tuple[float, ...]:
        """The part that two tables of one axis must have in common."""
        return tuple(self.numbers[key].value for key in siemens.GRID)

    @property
    def direction(self) -> int:
        return round(self.numbers["DIRECTION"].value)

    @property
    def axis(self) -> str:
        return self.axes["INPUT_AXIS"][0]


def recognise(source: SourceText) -> bool:
    """Whether it names sag compensation, and no compensation of an encoder."""
    return any(_SIGN.search(line.text) for line in source.lines) and not any(
        _OTHER.search(line.text) for line in source.lines
    )


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the table, or the two tables, of one axis.

    Raises:
        TabFileError: no units or no sense given, a line outside the grammar, no end, a parameter or a point
            that is missing or repeated, a table of two axes, tables that are not one for each direction, a
            grid that does not end at MAX, several axes and none given, a range that does not fit the travel.
    """
    tables = _parse(source)
    for table in tables:
        _check(source, table)
    axis, chosen = _choose(source, tables, context)
    forward, backward = _directions(source, axis, chosen)
    units = required_units(source, context, _WHAT)
    context = context_in_file_units(source, context, units)
    sense = required_sense(source, context, _WHAT)
    rows = _rows(forward, backward, sense.to_correction)
    check_stated(source, rows, units, context)
    revolution = siemens.revolution_of(source, forward.numbers, rows)
    which = "one table for both directions" if forward is backward else "a table for each direction"
    return Decoded(
        rows,
        units,
        context,
        units.value,
        f"{RULES[sense]}; table {forward.number}",
        f"{RULES[sense]}; table {backward.number}",
        axis=siemens.letter_of(axis),
        file_axis=axis,
        plausible=(0.0, siemens.PLAUSIBLE[units]),
        decisions=(
            f"axis {axis}: {which}",
            f"sense {sense.value}: as given",
            f"{len(rows)} points, each once",
        ),
        behaves_as=siemens.edges(revolution),
        modulo=revolution,
    )


def _parse(source: SourceText) -> list[_Table]:
    tables: dict[int, _Table] = {}
    siemens.assign(source, _HEADER, _ALLOWED, lambda line, text: _add(tables, line, text))
    return list(tables.values())


def _add(tables: dict[int, _Table], line: SourceLine, text: str) -> str:
    """Add the assignment of a line; return its error."""
    match = _ASSIGNMENT.fullmatch(text)
    if match is None:
        return "something else"
    key = (match["key"] or "").lstrip("_").upper()
    if key not in {"", "MULT_BY_TABLE", *_AXES, *_NUMBERS}:
        return "an unknown parameter"
    if (not key) != (match["index"] is not None):
        return "a wrong number of indices"
    table = tables.setdefault(int(match["table"]), _Table(int(match["table"])))
    value = match["value"].strip()
    if key in _AXES:
        name = _AXIS.fullmatch(value)
        if name is None:
            return f"{shown(value)}, which is not an axis in brackets such as (X1),"
        entry = (name[1].upper(), line.number)
        return siemens.twice(table.axes.setdefault(key, entry), entry)
    number = siemens.number_of(value)
    if number is None:
        return siemens.no_number(value)
    if key == "MULT_BY_TABLE":
        return "" if number == 0.0 else "a product of two tables"
    point = Number(number, line.number)
    if key:
        return siemens.twice(table.numbers.setdefault(key, point), point)
    return siemens.twice(table.values.setdefault(int(match["index"]), point), point)


def _check(source: SourceText, table: _Table) -> None:
    """Check one table alone."""
    name = f"{_WHAT[2:]} {table.number}"
    missing = [key for key in _AXES if key not in table.axes]
    missing += [key for key in _NUMBERS if key not in table.numbers]
    siemens.check_there(source, name, (f"$AN_CEC_{key}[{table.number}]" for key in missing))
    one, two = (table.axes[key] for key in _AXES)
    if one[0] != two[0]:
        raise source.error(
            f"{name}: {two[0]} corrected over the position of {one[0]}",
            "the same axis for both; also for the 'cross' key of another axis",
            line=two[1],
        )
    direction, line = table.numbers["DIRECTION"]
    if direction not in {0.0, 1.0, -1.0}:
        raise source.error(f"{name}: DIRECTION {direction:g}", "0, 1 or -1", line=line)
    siemens.check_grid(source, name, table.numbers, table.values)


def _choose(source: SourceText, tables: list[_Table], context: FileContext) -> tuple[str, list[_Table]]:
    axes: dict[str, list[_Table]] = {}
    for table in tables:
        axes.setdefault(table.axis, []).append(table)
    given = context.file_axis
    if given is not None and given.upper() not in axes:
        raise source.error(
            f"tables of {listed(axes)}, but file_axis = {given!r}", f"file_axis = {listed(axes, ' or ')}"
        )
    if given is None and len(axes) > 1:
        raise source.error(
            f"tables of {listed(axes)}",
            option_hint("file_axis", f"{next(iter(axes))!r}, for example"),
        )
    axis = given.upper() if given is not None else next(iter(axes))
    return axis, axes[axis]


def _directions(source: SourceText, axis: str, tables: list[_Table]) -> tuple[_Table, _Table]:
    """Return the table of each direction."""
    by_direction = {table.direction: table for table in tables}
    if len(tables) == 1 and 0 in by_direction:
        return by_direction[0], by_direction[0]
    if len(tables) != 2 or set(by_direction) != {1, -1}:
        found = ", ".join(f"{table.direction:+d} (table {table.number})" for table in tables)
        raise source.error(
            f"axis {axis} with tables of DIRECTION {found}",
            "one of 0, or one of 1 and one of -1: the control adds several, and does not compensate a "
            "direction without a table",
            line=tables[-1].numbers["DIRECTION"].line,
        )
    forward, backward = by_direction[1], by_direction[-1]
    if forward.grid != backward.grid:
        raise source.error(
            f"tables {forward.number} and {backward.number} of axis {axis} with different points",
            "the same MIN, MAX, STEP and IS_MODULO in both",
            line=backward.numbers["MIN"].line,
        )
    return forward, backward


def _rows(forward: _Table, backward: _Table, to_correction: float) -> tuple[SourceRow, ...]:
    rows = []
    for index, position in enumerate(siemens.positions(forward.numbers, len(forward.values))):
        (one, line), (other, other_line) = forward.values[index], backward.values[index]
        rows.append(
            SourceRow(
                position, to_correction * one + 0.0, to_correction * other + 0.0, one, other, line, other_line
            )
        )
    return tuple(rows)


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table for one axis: one table for both directions, or one for each.

    ``file_axis`` is the name of the machine axis; the default is the letter of the axis and 1 (``X1``).

    Raises:
        TabFileError: no axis, no sense given, or points that are not evenly spaced.
    """
    step = even_step(table, NAME)
    name = siemens.axis_to_write(options.file_axis, options.axis)
    if re.fullmatch(siemens.AXIS_NAME, name) is None:
        raise unwritable(
            NAME, f"axis {name!r}", "the name of a machine axis, such as X1: --to-file-axis NAME"
        )
    if options.sense is None:
        raise unwritable(
            NAME,
            "the sense of its values is missing: no manual at hand states which one the control expects",
            "--to-sense actual_minus_command or command_minus_actual",
        )
    factor = options.sense.to_correction
    columns = [(0, table.forward)] if table.is_unidirectional else [(1, table.forward), (-1, table.backward)]
    lines = ["%_N_NC_CEC_INI", "CHANDATA(1)"]
    for number, (direction, curve) in enumerate(columns):
        lines += [f"$AN_CEC[{number},{index}]={siemens.written(factor * c)}" for index, c in enumerate(curve)]
        lines += [
            f"$AN_CEC_INPUT_AXIS[{number}]=({name})",
            f"$AN_CEC_OUTPUT_AXIS[{number}]=({name})",
            f"$AN_CEC_STEP[{number}]={siemens.exactly(step)}",
            f"$AN_CEC_MIN[{number}]={siemens.exactly(table.first)}",
            f"$AN_CEC_MAX[{number}]={siemens.exactly(table.last)}",
            f"$AN_CEC_DIRECTION[{number}]={direction}",
            f"$AN_CEC_MULT_BY_TABLE[{number}]=0",
            f"$AN_CEC_IS_MODULO[{number}]={int(options.is_modulo)}",
        ]
    lines.append("M17")
    room = f"the control needs room for {len(table.positions)} points in each table (MD18342)"
    losses = (
        siemens.losses(table.units),
        f"{room} and MD32710 = 0 while it is loaded",
    )
    context = FileContext(file_units=table.units, file_axis=name, error_sense=options.sense)
    return Written("".join(f"{line}\n" for line in lines), losses, context)
