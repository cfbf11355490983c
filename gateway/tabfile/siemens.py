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
                                                    has M0, M30 or both before its M17

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
from dataclasses import dataclass, field
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.tabfile import siemens_lines
from gateway.tabfile.context import FileContext
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.options import to_tell
from gateway.tabfile.ranges import context_in_file_units, told_units
from gateway.tabfile.siemens_lines import Number
from gateway.tabfile.stated import check_stated
from gateway.tabfile.text import Line, SourceText, listed, shown
from gateway.tabfile.writing import WriteOptions, Written, even_step, one_curve, unwritable

NAME: Final = "siemens-eec"
TITLE: Final = "Siemens SINUMERIK _EEC_INI: errors of the measuring system, one direction"
SUFFIX: Final = siemens_lines.SUFFIX
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


@dataclass(frozen=True, slots=True)
class _Table:
    """One axis on one measuring system."""

    values: dict[int, Number] = field(default_factory=dict)
    numbers: dict[str, Number] = field(default_factory=dict)


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
    turn = siemens_lines.turn_of(source, table.numbers, rows)
    return Decoded(
        rows,
        units,
        context,
        units.value,
        _RULE,
        _RULE,
        axis=siemens_lines.letter_of(name[1]),
        file_axis=",".join(name),
        plausible=(0.0, siemens_lines.PLAUSIBLE[units]),
        decisions=(
            f"axis {name[1]}, measuring system {name[0]}",
            f"{len(rows)} points, all from 0 to {len(rows) - 1} and each once",
            *((f"one turn of {turn:.10g}, then it begins again",) if turn is not None else ()),
        ),
        behaves_as=siemens_lines.edges(turn),
        modulo=turn,
    )


def _parse(source: SourceText) -> _Tables:
    tables: _Tables = {}
    siemens_lines.assign(source, _HEADER, _ALLOWED, lambda line, text: _add(tables, line, text))
    return tables


def _add(tables: _Tables, line: Line, text: str) -> str:
    """Add what a line assigns; return what is wrong with it."""
    match = _ASSIGNMENT.fullmatch(text)
    if match is None:
        return "something else"
    value = siemens_lines.number_of(match["value"])
    if value is None:
        return siemens_lines.no_number(match["value"])
    table = tables.setdefault((match["encoder"], match["axis"].upper()), _Table())
    number = Number(value, line.number)
    if (match["key"] is None) != (match["index"] is not None):
        return "a wrong number of indices"
    if match["key"] is None:
        return siemens_lines.twice(table.values.setdefault(int(match["index"]), number), number)
    return siemens_lines.twice(table.numbers.setdefault(match["key"][1:].upper(), number), number)


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
            to_tell("file_axis", f"{next(iter(names))!r}, for example") + "; with two "
            "measuring systems their number comes first, as in the file",
        )
    name = next(iter(tables))
    return name, tables[name]


def _rows(source: SourceText, table: _Table, name: tuple[str, str]) -> tuple[SourceRow, ...]:
    inside = f"[{name[0]},{name[1]}]"
    siemens_lines.check_there(
        source,
        inside,
        (f"$AA_ENC_COMP_{key}{inside}" for key in siemens_lines.GRID if key not in table.numbers),
    )
    siemens_lines.check_grid(source, inside, table.numbers, table.values)
    rows = []
    for index, position in enumerate(siemens_lines.positions(table.numbers, len(table.values))):
        error, line = table.values[index]
        rows.append(SourceRow(position, 0.0 - error, 0.0 - error, error, error, line, line))
    return tuple(rows)


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
            f"$AA_ENC_COMP[{encoder},{index},{axis}]={siemens_lines.written(0.0 - correction)}"
            for index, correction in enumerate(curve)
        ),
        f"$AA_ENC_COMP_STEP[{inside}]={siemens_lines.exactly(step)}",
        f"$AA_ENC_COMP_MIN[{inside}]={siemens_lines.exactly(table.first)}",
        f"$AA_ENC_COMP_MAX[{inside}]={siemens_lines.exactly(table.last)}",
        f"$AA_ENC_COMP_IS_MODULO[{inside}]={int(options.is_modulo)}",
        "M17",
    ]
    losses = (
        *losses,
        siemens_lines.losses(table.units),
        f"the control needs room for {intervals + 1} points (MD38000) and MD32700 = 0 while it is loaded",
    )
    context = FileContext(file_units=table.units, file_axis=axis)
    return Written("".join(f"{line}\n" for line in lines), losses, context)


def _name(options: WriteOptions) -> tuple[str, str]:
    name = siemens_lines.axis_to_write(options.file_axis, options.axis)
    match = re.fullmatch(rf"(?:([0-9]),)?({siemens_lines.AXIS_NAME})", name)
    if match is None:
        raise unwritable(
            NAME, f"axis {name!r}", "the name of a machine axis, such as X1: --to-file-axis NAME"
        )
    return match[1] or "0", match[2]
