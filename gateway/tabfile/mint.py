"""Mint programs of Baldor and ABB that hold leadscrew tables (grammar: ``mint_program``).

After the Mint v4 Advanced Programming Guide (MN1270, 3.4.2 and the keywords). Entry i of a table, counted
from 1, is where the nut really stands, measured from mark A of the screw, when theory says
i x PRECISIONINCREMENT; at A itself both are 0 and nothing is listed. ``fwd`` holds while the axis moves from
A to B, which is the positive direction, ``rev`` on the way back.

Mint replaces the position that it measures, so its motor stops at the inverse of the table: the motor has to
be at i x increment for the nut to be at entry i. The inverse of a polygon is a polygon: point i lies at
A + entry, and i x increment - entry is added there, exactly. The points of both directions differ; a table
has those of both, each curve worked out on its own polygon at the points of the other.

Where A lies, PRECISIONOFFSET says in two ways: it is "the position of point A relative to axis zero" (its
keyword), and it is "ADDED" to a position to look it up (3.4.2), which puts A at minus the offset. So an
offset other than 0 proves nothing, and ``file_start`` tells where A is. Units are user units, so they are
told. Outside its table Mint adds nothing. BACKLASH is a constant beside a single table; with a positive one
Mint adds it while moving forward, with a negative one while moving back.
"""

import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateway.compensation.units import Units
from gateway.tabfile.context import FileContext
from gateway.tabfile.decoded import Decoded, SourceRow
from gateway.tabfile.errors import Problem, TabFileError
from gateway.tabfile.findings import Lint, Severity
from gateway.tabfile.mint_program import INCREMENT, MODE, OFFSET, TABLE, Array, Program, parse_program
from gateway.tabfile.mint_reversal import Reversal, reversal_of
from gateway.tabfile.options import to_tell, typed
from gateway.tabfile.ranges import context_in_file_units, told_units
from gateway.tabfile.stated import check_stated
from gateway.tabfile.text import SourceText, listed

NAME: Final = "mint"
TITLE: Final = "Baldor and ABB Mint programs: PRECISIONTABLE, absolute positions of the nut"
SUFFIX: Final = ".mnt"
USES: Final = frozenset({"file_start", "increment", "file_axis"})
MAX_PROBLEMS: Final = 20
SAME_PLACE: Final = 1e-6
"""Points of both directions that lie closer than this, in units, are one point: at a slope of 1 % that costs
a hundredth of it, and slopes over shorter distances would be noise."""
NOTHING: Final = 1e-9
"""Corrections below this, in units, are 0."""
SAME_START: Final = 1e-6
_SIGN: Final = re.compile(
    r"(?i)\bPRECISION(TABLE|MODE|INCREMENT|OFFSET)\b|^DIM\s+\w+\s*\(\s*[0-9]+\s*\)\s*(AS\s+FLOAT\s*)?="
)
_RULE: Final = (
    "value is where the nut stands, from mark A, when theory says i x increment: i x increment - value is "
    "added (exact inverse); {}"
)


class _Knot(NamedTuple):
    place: float
    correction: float
    line: int | None


@dataclass(frozen=True, slots=True)
class _Screw:
    """The table of one axis; ``forward`` and ``backward`` are places from A with what is added there."""

    axis: int
    increment: float
    forward: Sequence[_Knot]
    backward: Sequence[_Knot]
    decisions: tuple[str, ...]
    remarks: tuple[Lint, ...]


def recognise(source: SourceText) -> bool:
    """Whether a line has a keyword of leadscrew compensation or fills an array."""
    return any(_SIGN.search(line.text) for line in source.lines)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the tables of one axis.

    Raises:
        TabFileError: no units were told, a statement that is not of the grammar, several axes and none told,
            no increment, no place for mark A or one of two, positions that do not ascend, backlash beside two
            tables.
    """
    units = told_units(source, context, "a Mint program")
    axis_units = context.units
    program = parse_program(source)
    axis = _choose_axis(source, program, context)
    context = context_in_file_units(source, context, units)
    screw = _screw_of(source, program, axis, context)
    start, from_where = _start_of(source, program, screw, context)
    rows = _rows(screw, start)
    check_stated(source, rows, units, context)
    has_two = program.tables[axis].reverse is not None and screw.forward is not screw.backward
    reversal = reversal_of(source, program, axis, has_two_tables=has_two)
    outside, at_the_ends = _outside(rows, units)
    return Decoded(
        rows,
        units,
        context,
        units.value,
        _RULE.format("forward table"),
        _RULE.format("reverse table" if has_two else "the one table, both directions"),
        decisions=(
            f"axis {axis}",
            *screw.decisions,
            f"mark A at {start:g} {units.value}: {from_where}",
            *reversal.decisions,
            at_the_ends,
            f"{program.others} other statements, none of which mentions a table or its settings",
        ),
        remarks=(*screw.remarks, *reversal.remarks),
        behaves_as=(*outside, *_reversal_lines(reversal, units, axis_units)),
        are_positions=True,
        file_axis=str(axis),
    )


def _choose_axis(source: SourceText, program: Program, context: FileContext) -> int:
    names = [str(axis) for axis in sorted(program.tables)]
    told = context.file_axis
    if told is not None and told not in names:
        raise source.error(
            f"tables of axis {listed(names)}, told file_axis {told!r}", f"file_axis = {listed(names, ' or ')}"
        )
    if told is None and len(names) > 1:
        raise source.error(
            f"tables of the axes {listed(names)}",
            to_tell("file_axis", f"{names[0]!r}, for example"),
        )
    return int(told or names[0])


def _screw_of(source: SourceText, program: Program, axis: int, context: FileContext) -> _Screw:
    table = program.tables[axis]
    distance, says = _increment_of(source, program, axis, context)
    is_dual, decision, remarks = _is_dual(source, program, axis)
    forward = _knots(source, table.forward, distance, "forward")
    backward = _knots(source, table.reverse, distance, "reverse") if is_dual and table.reverse else forward
    sizes = (len(forward) - 1, len(backward) - 1)
    if sizes[0] != sizes[1]:
        raise source.error(
            f"{sizes[0]} forward and {sizes[1]} reverse positions of axis {axis}",
            "as many in both tables",
            line=table.line,
        )
    decisions = (decision, f"increment {distance:g}{says}, {sizes[0]} positions from mark A")
    return _Screw(axis, distance, forward, backward, decisions, remarks)


def _increment_of(source: SourceText, program: Program, axis: int, context: FileContext) -> tuple[float, str]:
    """Return the distance of the points, and who told it where it is not the program."""
    setting, told = program.settings.get((INCREMENT, axis)), context.increment
    if setting is None:
        if told is None:
            raise source.error(
                f"a table of axis {axis} without its {INCREMENT}",
                f"{INCREMENT}.{axis} = a distance, or increment told ({typed('increment')})",
                line=program.tables[axis].line,
            )
        return told, " (told by increment)"
    distance = float(setting.value)
    if not distance > 0:
        raise source.error(f"{INCREMENT} {distance:g}", "a distance above 0", line=setting.line)
    if told is not None and abs(told - distance) > SAME_PLACE:
        raise source.error(
            f"{INCREMENT} {distance:g}, told increment {told:g}",
            f"increment = {context.as_told(distance):.9g}, or none",
            line=setting.line,
        )
    return distance, ""


def _is_dual(source: SourceText, program: Program, axis: int) -> tuple[bool, str, tuple[Lint, ...]]:
    """Whether the reverse table counts, why, and a remark where the program switches all of it off."""
    has_two = program.tables[axis].reverse is not None
    both = "two tables, one for each direction" if has_two else "one table for both directions"
    setting = program.settings.get((MODE, axis))
    if setting is None:
        return has_two, f"{both}: {TABLE} names as many", ()
    word = str(setting.value) if isinstance(setting.value, str) else f"{setting.value:g}"
    if word in {"0", "_LSOFF"}:
        message = (
            f"the program leaves {MODE} of axis {axis} off, so the control itself did not use this table: "
            "make sure that it is the right one"
        )
        return (
            has_two,
            f"{both}: {TABLE} names as many",
            (Lint("R11", Severity.WARNING, message, setting.line),),
        )
    if (word == "_LSDUAL_TABLE" and has_two) or (word in {"1", "_LSSINGLE_TABLE"} and not has_two):
        return has_two, f"{both}: {MODE} says so", ()
    if word == "_LSSINGLE_TABLE":
        return False, f"one table for both directions: {MODE} leaves the reverse table aside", ()
    if word == "2" and has_two:
        return True, f"{both}: {MODE} says so", ()
    raise source.error(
        f"{MODE} {word} with {2 if has_two else 1} table(s) in {TABLE}",
        "_lsDUAL_TABLE with two tables, _lsSINGLE_TABLE with one, or _lsOFF",
        line=setting.line,
    )


def _knots(source: SourceText, array: Array, increment: float, what: str) -> list[_Knot]:
    knots = [_Knot(0.0, 0.0, None)]
    problems: list[Problem] = []
    for index, (place, line) in enumerate(zip(array.values, array.lines, strict=True), start=1):
        if not place > knots[-1].place:
            found = f"{what} position {place:g} of entry {index} after {knots[-1].place:g}"
            problems.append(
                source.problem(found, "positions that ascend from mark A, 0", line=line, code="L11")
            )
        knots.append(_Knot(place, index * increment - place, line))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    return knots


def _start_of(source: SourceText, program: Program, screw: _Screw, context: FileContext) -> tuple[float, str]:
    """Return where mark A lies on the axis, and who says so."""
    setting, told = program.settings.get((OFFSET, screw.axis)), context.file_start
    if setting is None:
        if told is None:
            raise source.error(
                f"no {OFFSET} of axis {screw.axis}: nothing says where mark A of the screw is",
                to_tell("file_start", "the machine position of mark A"),
                line=program.tables[screw.axis].line,
            )
        return told, "told by file_start"
    offset = float(setting.value)
    if told is None and offset == 0:
        return offset, OFFSET
    ways = (offset, "it is the position of A"), (-offset, "it is added to a position to look it up")
    for start, way in ways:
        if told is not None and abs(told - start) <= SAME_START:
            return start, f"file_start; so {OFFSET} {offset:g} means: {way}" if offset else OFFSET
    found = f"but file_start is {told:g}" if told is not None else "and Mint's guide reads it in two ways"
    places = " or ".join(
        dict.fromkeys(f"file_start = {context.as_told(start) + 0.0:.9g}" for start, _ in ways)
    )
    raise source.error(
        f"{OFFSET} {offset:g}, {found}",
        f"{places} ({typed('file_start')}): look where mark A of the screw is on the machine",
        line=setting.line,
        code="R9",
        readings=(_reading(screw, start, way, context) for start, way in ways) if offset else (),
    )


def _reading(screw: _Screw, start: float, way: str, context: FileContext) -> str:
    """Say what one place of mark A makes of a target that lies behind A in both readings."""
    assert context.units is not None, "the context is in units of the file"
    target = abs(start) + screw.increment / 5
    place = target - start
    out = "as it is: Mint adds nothing there"
    if place <= screw.forward[-1].place:
        out = f"as {target + _at(screw.forward, place):.5f}"
    end = start + max(screw.forward[-1].place, screw.backward[-1].place)
    return (
        f"{way}: mark A at {start:g} {context.units.value}, the table from there to {end:g}; moving forward, "
        f"{target:g} goes out {out}"
    )


def _rows(screw: _Screw, start: float) -> tuple[SourceRow, ...]:
    """Return the points of both directions, in order of position."""
    rows: list[SourceRow] = []
    lines = [{knot.place: knot.line for knot in knots} for knots in (screw.forward, screw.backward)]
    for places in _together(sorted({knot.place for knot in (*screw.forward, *screw.backward)})):
        place = places[0]
        forward, backward = _at(screw.forward, place), _at(screw.backward, place)
        numbers = [next((line for at in places if (line := branch.get(at))), None) for branch in lines]
        rows.append(SourceRow(start + place, forward, backward, place, place, numbers[0], numbers[1]))
    return tuple(rows)


def _together(places: Sequence[float]) -> list[list[float]]:
    """Put what is one place into one group."""
    groups = [[places[0]]]
    for place in places[1:]:
        if place - groups[-1][0] > SAME_PLACE:
            groups.append([])
        groups[-1].append(place)
    return groups


def _at(knots: Sequence[_Knot], place: float) -> float:
    """Return the correction of one direction; behind its last point it stays."""
    above = bisect_right(knots, place, key=lambda knot: knot.place)
    if above == len(knots) or knots[above - 1].place == place:
        return knots[above - 1].correction
    low, high = knots[above - 1], knots[above]
    share = (place - low.place) / (high.place - low.place)
    return low.correction + share * (high.correction - low.correction)


def _outside(rows: Sequence[SourceRow], units: Units) -> tuple[tuple[str, ...], str]:
    """Say what to do outside: as Mint does where that makes no step."""
    step = max(abs(correction) for row in (rows[0], rows[-1]) for correction in (row.forward, row.backward))
    if step <= NOTHING:
        return ('outside = "zero"',), "both ends are 0: outside, Mint adds nothing"
    return (), (
        f"outside, Mint adds nothing: the axis would jump by {step:.6g} {units.value} at the end of the "
        "table; the gateway refuses that and holds, or goes to 0 over a length: outside = { fade = LENGTH }"
    )


def _reversal_lines(reversal: Reversal, units: Units, axis_units: Units | None) -> tuple[str, ...]:
    """Return the settings of the reversal, lengths in units of the axis."""
    lines: list[str] = []
    if reversal.backlash:
        width = abs(reversal.backlash) * (units.convert_factor(axis_units) if axis_units else 1.0)
        kind = "homed-backward" if reversal.backlash > 0 else "homed-forward"
        lines.append(f'backlash = {{ width = {width:.10g}, kind = "{kind}" }}')
    if reversal.cycles is not None:
        lines.append(
            f"reversal = {{ cycles = {reversal.cycles} }}" if reversal.cycles else 'reversal = "step"'
        )
    return tuple(lines)
