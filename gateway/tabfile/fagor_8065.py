"""Leadscrew tables of the Fagor 8065, in the file of machine parameters that the control saves (``.mp``).

UTF-16 text, one parameter to a line, ``number;/PATH   ;value``. The first line names the axis, the second the
units. Of the other lines only those of ``/LSCRWDATA`` are read::

    X AXIS                             ;3100
    MM                                 ;0
    2;/LSCRWDATA/NPOINTS               ;3
    2;/LSCRWDATA/BIDIR                 ;1
    2;/LSCRWDATA/DATA/POSITION 1       ;-127.0000
    2;/LSCRWDATA/DATA/POSERROR 1       ;-0.0127          error in the positive direction
    2;/LSCRWDATA/DATA/NEGERROR 1       ;0.0000           ... in the negative one, used with BIDIR 1 only

Points are numbered from 1 to NPOINTS, each with its three values, in any order of lines; positions ascend.
The layout is that of the files of a public program (laser_adjust), which adds the readings of a laser to
these values without a change of sign. No available manual gives the sign of an error, so the sense is
required, as with the 8055.
"""

import re
from itertools import pairwise
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import RULES, check_stated, context_in_file_units, required_sense
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import FileContext
from gateway.tabfile.text import DECIMAL_ALLOWED, SourceLine, SourceText, shown, to_decimal, to_integer
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME: Final = "fagor-8065"
TITLE: Final = "Fagor 8065 machine parameters of an axis (.mp), one or two directions"
SUFFIX: Final = ".mp"
USES: Final = frozenset({"file_start", "file_axis", "error_sense"})
ENCODING: Final = "utf-16-le"
MAX_PROBLEMS: Final = 20
DECIMALS: Final = {Units.MM: 4, Units.INCH: 5}
_WHAT: Final = "a Fagor 8065 table"
_DATA: Final = ("POSITION", "POSERROR", "NEGERROR")
_AXIS: Final = re.compile(r"([A-Z][0-9]*) AXIS[ \t]*;.*")
_UNITS: Final = re.compile(r"(MM|INCH|INCHES)[ \t]*;.*")
_WORDS: Final = {"MM": Units.MM, "INCH": Units.INCH, "INCHES": Units.INCH}
_LINE: Final = re.compile(r"[0-9]+;/LSCRWDATA/(.*?)[ \t]*;[ \t]*(.*)")
_POINT: Final = re.compile(r"DATA/([A-Z]+) ([0-9]{1,4})")
_BIDIR: Final = {"0": False, "NO": False, "1": True, "YES": True}
_PLAUSIBLE: Final = {Units.MM: 0.5, Units.INCH: 0.1}


def recognise(source: SourceText) -> bool:
    """Whether a line is a leadscrew parameter of such a control."""
    return any("/LSCRWDATA/" in line.text for line in source.lines)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the table with the sense from the context.

    Raises:
        TabFileError: no axis or units at the top, a leadscrew line that is outside the grammar or repeated,
            points that are missing or do not ascend, no BIDIR or NPOINTS, no sense given, another axis, a
            range that does not fit the travel.
    """
    axis, units = _head(source)
    given = context.file_axis or context.axis
    if given is not None and given.upper() != axis:
        raise source.error(
            f"parameters of axis {axis}, read for axis {given.upper()}",
            f"axis {given.upper()}: is this the right file? If so: file_axis = {axis!r}",
            line=source.lines[0].number,
        )
    facts, points = _parse(source)
    size = to_integer(_fact(source, facts, "NPOINTS", "the number of points")) or 0
    bidir = _fact(source, facts, "BIDIR", "0: one error for both directions, 1: one for each").upper()
    if bidir not in _BIDIR:
        raise source.error(f"BIDIR {shown(bidir)}", "0 or 1", line=facts["BIDIR"].number)
    is_both_ways = not _BIDIR[bidir]
    _check_whole(source, facts["NPOINTS"], size, points)
    context = context_in_file_units(source, context, units)
    sense = required_sense(source, context, _WHAT)
    rows = []
    for number in range(1, size + 1):
        position, positive, negative = (points[name, number] for name in _DATA)
        backward = positive if is_both_ways else negative
        rows.append(
            SourceRow(
                position[0],
                sense.to_correction * positive[0] + 0.0,
                sense.to_correction * backward[0] + 0.0,
                positive[0],
                backward[0],
                positive[1],
                backward[1],
            )
        )
    for before, after in pairwise(rows):
        if after.position <= before.position:
            found = f"position {after.position:g} after {before.position:g}"
            raise source.error(found, "positions that ascend", line=after.forward_line, code="L11")
    check_stated(source, rows, units, context)
    directions = (
        "BIDIR 0: POSERROR applies in both directions" if is_both_ways else "BIDIR 1: an error for each"
    )
    return Decoded(
        tuple(rows),
        units,
        context,
        units.value,
        f"{RULES[sense]}; POSERROR",
        f"{RULES[sense]}; {'POSERROR, as in the positive direction' if is_both_ways else 'NEGERROR'}",
        axis=axis if len(axis) == 1 and context.file_axis is None else None,
        file_axis=context.file_axis,
        plausible=(0.0, _PLAUSIBLE[units]),
        decisions=(f"sense {sense.value}: as given", f"units {units.value}: second line", directions),
        behaves_as=('outside = "hold"',),
    )


def _head(source: SourceText) -> tuple[str, Units]:
    found = _AXIS.fullmatch(source.lines[0].text)
    if found is None:
        raise source.error(
            shown(source.lines[0].text),
            "'X AXIS ;...' on the first line: give the whole file, as the control saved it",
            line=source.lines[0].number,
        )
    units = _UNITS.fullmatch(source.lines[1].text) if len(source.lines) > 1 else None
    if units is None:
        line = source.lines[min(1, len(source.lines) - 1)]
        raise source.error(shown(line.text), "'MM ;0' or 'INCH ;1' on the second line", line=line.number)
    return found[1], _WORDS[units[1]]


def _parse(source: SourceText) -> tuple[dict[str, SourceLine], dict[tuple[str, int], tuple[float, int]]]:
    """Return the single parameters, each as value and line, and the values of the points."""
    facts: dict[str, SourceLine] = {}
    decimals: int | None = None
    points: dict[tuple[str, int], tuple[float, int]] = {}
    problems: list[FileProblem] = []
    for line in source.lines[2:]:
        found = _LINE.fullmatch(line.text)
        if found is None:
            if "LSCRWDATA" in line.text:
                allowed = "'2;/LSCRWDATA/DATA/POSITION 1 ;-127.0000'"
                problems.append(source.problem(shown(line.text), allowed, line=line.number))
            continue
        name, text = found.groups()
        point = _POINT.fullmatch(name)
        number = to_decimal(text)
        key = (point[1], int(point[2])) if point else None
        if name in facts or key in points:
            problems.append(source.problem(f"{name} for the second time", "each once", line=line.number))
        elif key is None and not name.startswith("DATA"):
            facts[name] = SourceLine(line.number, text)
        elif key is None or key[0] not in _DATA or number is None:
            allowed = f"DATA/{', DATA/'.join(_DATA)} with its number, each {DECIMAL_ALLOWED}"
            problems.append(source.problem(shown(line.text), allowed, line=line.number))
        else:
            points[key] = (number, line.number)
            # The control pads the decimals: a value with fewer is truncated.
            size = len(text.partition(".")[2])
            decimals = size if decimals is None else decimals
            if size != decimals:
                allowed = f"{decimals} decimals, as in the lines above"
                problems.append(source.problem(shown(line.text), allowed, line=line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    return facts, points


def _fact(source: SourceText, facts: dict[str, SourceLine], name: str, what: str) -> str:
    if name not in facts:
        raise source.error(
            f"no line /LSCRWDATA/{name}", f"this line ({what}): give the whole file, as the control saved it"
        )
    return facts[name].text


def _check_whole(
    source: SourceText, stated: SourceLine, size: int, points: dict[tuple[str, int], tuple[float, int]]
) -> None:
    if size < 2:
        raise source.error(f"NPOINTS {shown(stated.text)}", "a whole number from 2 on", line=stated.number)
    missing = [
        f"{name} {number}" for number in range(1, size + 1) for name in _DATA if (name, number) not in points
    ]
    if missing:
        raise source.error(
            f"NPOINTS {size}, but no {', '.join(missing[:3])}",
            "three values for each point",
            line=stated.number,
        )
    beyond = next((key for key in points if not 1 <= key[1] <= size), None)
    if beyond is not None:
        raise source.error(
            f"{beyond[0]} {beyond[1]}, but NPOINTS {size}", f"points 1 to {size}", line=points[beyond][1]
        )


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the leadscrew lines of an axis, in UTF-16; BIDIR 1 if the directions differ.

    Raises:
        TabFileError: no axis or no sense given, a table in degrees, points that are equal after rounding.
    """
    axis = options.file_axis or options.axis
    if axis is None or not re.fullmatch("[A-Za-z][0-9]*", axis):
        raise unwritable(NAME, f"axis {axis!r}", "a name such as X or X1: --to-axis LETTER")
    if options.sense is None:
        found = "the sense of its errors is missing: no manual states which one the control expects"
        raise unwritable(NAME, found, "--to-sense actual_minus_command or command_minus_actual")
    if table.units not in DECIMALS:
        raise unwritable(NAME, f"a table in {table.units.value}", "a table of a linear axis")
    decimals, to_error = DECIMALS[table.units], options.sense.to_correction
    columns = {
        "POSITION": table.positions,
        "POSERROR": [to_error * each for each in table.forward],
        "NEGERROR": [0.0 if table.is_unidirectional else to_error * each for each in table.backward],
    }
    texts = {name: [f"{each + 0.0:.{decimals}f}" for each in values] for name, values in columns.items()}
    for before, after in pairwise(texts["POSITION"]):
        if float(after) <= float(before):
            found = f"points closer than {10**-decimals:g} {table.units.value} at {after}"
            raise unwritable(NAME, found, "points further apart: --resample STEP")
    unit = "MM" if table.units is Units.MM else "INCH"
    lines = [
        _row(f"{axis.upper()} AXIS", "0"),
        _row(unit, "0"),
        _row("2;/LSCRWDATA/NPOINTS", str(len(table.positions))),
        _row("2;/LSCRWDATA/BIDIR", "0" if table.is_unidirectional else "1"),
        *(
            _row(f"2;/LSCRWDATA/DATA/{name} {number}", text)
            for name in _DATA
            for number, text in enumerate(texts[name], start=1)
        ),
    ]
    losses = (
        f"positions and values are rounded to {decimals} decimals ({table.units.value})",
        "replace the leadscrew lines of the file that the control saved with these: this file has no others",
    )
    context = FileContext(axis=options.axis, file_axis=options.file_axis, error_sense=options.sense)
    return Written("".join(f"{line}\n" for line in lines), losses, context, ENCODING)


def _row(name: str, value: str) -> str:
    return f"{name:<52};{value}"
