"""Mint programs of Baldor and ABB that hold leadscrew tables (grammar: ``mint_program``).

From the Mint v4 Advanced Programming Guide (MN1270, 3.4.2 and the keywords). Entry i of a table, counted from
1, is the actual position of the nut, measured from mark A of the screw, at the theoretical position i x
PRECISIONINCREMENT. At A itself both are 0 and the table has no entry. ``fwd`` holds while the axis moves from
A to B, the positive direction, ``rev`` on the way back.

Mint replaces the measured position, so its motor stops at the inverse of the table: the nut is at entry i
when the motor is at i x increment. The inverse of a polygon is a polygon: point i is at A + entry, and i x
increment - entry is added there, exactly. The points of both directions differ. A table has the points of
both; each curve is evaluated on its own polygon at the points of the other.

The guide defines PRECISIONOFFSET, which locates A, in two ways. It is "the position of point A relative to
axis zero" (its keyword). It is also "ADDED" to a position to look it up (3.4.2), which puts A at minus the
offset. So an offset other than 0 proves nothing, and ``file_start`` gives the position of A. Units are user
units, so they must be given. Outside its table Mint adds nothing. BACKLASH is a constant beside a single
table. Mint adds a positive one while moving forward, a negative one while moving back.
"""

import re
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import ceil
from typing import Final, NamedTuple

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import check_stated, context_in_file_units, required_units
from gateway.tabfile.decoded import Decoded, Lint, LintSeverity, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.mint_program import (
    BACKLASH,
    BACKLASH_INTERVAL,
    BACKLASH_MODE,
    INCREMENT,
    MODE,
    OFFSET,
    TABLE,
    Array,
    Program,
    parse_program,
)
from gateway.tabfile.options import FileContext, option_hint, typed
from gateway.tabfile.text import SourceText, listed
from gateway.tabfile.writing import EVEN_TOLERANCE, WriteOptions, Written, unwritable

NAME: Final = "mint"
TITLE: Final = "Baldor and ABB Mint programs: PRECISIONTABLE, absolute positions of the nut"
SUFFIX: Final = ".mnt"
USES: Final = frozenset({"file_start", "increment", "file_axis"})
MAX_PROBLEMS: Final = 20
SAME_POSITION: Final = 1e-6
"""Points of both directions closer than this, in units, are one point. At a slope of 1 % the error is a
hundredth of it; slopes over shorter distances would be noise."""
NOTHING: Final = 1e-9
"""Corrections below this, in units, are 0."""
SAME_START: Final = 1e-6
_SIGN: Final = re.compile(
    r"(?i)\bPRECISION(TABLE|MODE|INCREMENT|OFFSET)\b|^DIM\s+\w+\s*\(\s*[0-9]+\s*\)\s*(AS\s+FLOAT\s*)?="
)
_RULE: Final = (
    "value i is the actual position from mark A at the theoretical position i x increment: i x increment - "
    "value is added (exact inverse); {}"
)


class _Knot(NamedTuple):
    position: float
    correction: float
    line: int | None


class _Screw(Struct, frozen=True):
    """The table of one axis; ``forward`` and ``backward`` are positions from A, each with its correction."""

    axis: int
    increment: float
    forward: Sequence[_Knot]
    backward: Sequence[_Knot]
    decisions: tuple[str, ...]
    remarks: tuple[Lint, ...]


class _Reversal(Struct, frozen=True):
    """``backlash`` is signed, in units of the file, 0 for none; ``cycles`` is None if not set."""

    backlash: float
    cycles: int | None
    decisions: tuple[str, ...]
    remarks: tuple[Lint, ...]


def recognise(source: SourceText) -> bool:
    """Whether a line has a keyword of leadscrew compensation or fills an array."""
    return any(_SIGN.search(line.text) for line in source.lines)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the tables of one axis.

    Raises:
        TabFileError: no units given, a statement outside the grammar, several axes and none given, no
            increment, no position for mark A or an ambiguous one, positions that do not ascend, backlash
            beside two tables.
    """
    units = required_units(source, context, "a Mint program")
    axis_units = context.units
    program = parse_program(source)
    axis = _choose_axis(source, program, context)
    context = context_in_file_units(source, context, units)
    screw = _screw_of(source, program, axis, context)
    start, from_where = _start_of(source, program, screw, context)
    rows = _rows(screw, start)
    check_stated(source, rows, units, context)
    has_two = program.tables[axis].reverse is not None and screw.forward is not screw.backward
    reversal = _reversal_of(source, program, axis, has_two_tables=has_two)
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
            f"{program.others} other statements, without a table or its settings",
        ),
        remarks=(*screw.remarks, *reversal.remarks),
        behaves_as=(*outside, *_reversal_lines(reversal, units, axis_units)),
        are_positions=True,
        file_axis=str(axis),
    )


def _choose_axis(source: SourceText, program: Program, context: FileContext) -> int:
    names = [str(axis) for axis in sorted(program.tables)]
    given = context.file_axis
    if given is not None and given not in names:
        raise source.error(
            f"tables of axis {listed(names)}, but file_axis = {given!r}",
            f"file_axis = {listed(names, ' or ')}",
        )
    if given is None and len(names) > 1:
        raise source.error(
            f"tables of the axes {listed(names)}",
            option_hint("file_axis", f"{names[0]!r}, for example"),
        )
    return int(given or names[0])


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
            "the same number in both tables",
            line=table.line,
        )
    decisions = (decision, f"increment {distance:g}{says}, {sizes[0]} positions from mark A")
    return _Screw(axis, distance, forward, backward, decisions, remarks)


def _increment_of(source: SourceText, program: Program, axis: int, context: FileContext) -> tuple[float, str]:
    """Return the distance of the points, and its source if that is not the program."""
    setting, given = program.settings.get((INCREMENT, axis)), context.increment
    if setting is None:
        if given is None:
            raise source.error(
                f"a table of axis {axis} without {INCREMENT}",
                f"{INCREMENT}.{axis} = a distance, or give increment ({typed('increment')})",
                line=program.tables[axis].line,
            )
        return given, " (from increment)"
    distance = float(setting.value)
    if not distance > 0:
        raise source.error(f"{INCREMENT} {distance:g}", "a distance above 0", line=setting.line)
    if given is not None and abs(given - distance) > SAME_POSITION:
        raise source.error(
            f"{INCREMENT} {distance:g}, but increment = {given:g}",
            f"increment = {context.as_given(distance):.9g}, or none",
            line=setting.line,
        )
    return distance, ""


def _is_dual(source: SourceText, program: Program, axis: int) -> tuple[bool, str, tuple[Lint, ...]]:
    """Whether the reverse table is used, why, and a remark if the program disables all compensation."""
    has_two = program.tables[axis].reverse is not None
    both = "two tables, one for each direction" if has_two else "one table for both directions"
    setting = program.settings.get((MODE, axis))
    if setting is None:
        return has_two, f"{both}: {TABLE} names as many", ()
    word = str(setting.value) if isinstance(setting.value, str) else f"{setting.value:g}"
    if word in {"0", "_LSOFF"}:
        message = (
            f"make sure that this is the right table: the program leaves {MODE} of axis {axis} off, so the "
            "control did not use it"
        )
        return (
            has_two,
            f"{both}: {TABLE} names as many",
            (Lint("R11", LintSeverity.WARNING, message, setting.line),),
        )
    if (word == "_LSDUAL_TABLE" and has_two) or (word in {"1", "_LSSINGLE_TABLE"} and not has_two):
        return has_two, f"{both}: {MODE} says so", ()
    if word == "_LSSINGLE_TABLE":
        return False, f"one table for both directions: with {MODE} the reverse table is not used", ()
    if word == "2" and has_two:
        return True, f"{both}: {MODE} says so", ()
    raise source.error(
        f"{MODE} {word} with {2 if has_two else 1} table(s) in {TABLE}",
        "_lsDUAL_TABLE with two tables, _lsSINGLE_TABLE with one, or _lsOFF",
        line=setting.line,
    )


def _knots(source: SourceText, array: Array, increment: float, what: str) -> list[_Knot]:
    knots = [_Knot(0.0, 0.0, None)]
    problems: list[FileProblem] = []
    for index, (position, line) in enumerate(zip(array.values, array.lines, strict=True), start=1):
        if not position > knots[-1].position:
            found = f"{what} position {position:g} of entry {index} after {knots[-1].position:g}"
            problems.append(
                source.problem(found, "positions that ascend from mark A, 0", line=line, code="L11")
            )
        knots.append(_Knot(position, index * increment - position, line))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    return knots


def _start_of(source: SourceText, program: Program, screw: _Screw, context: FileContext) -> tuple[float, str]:
    """Return the position of mark A on the axis, and its source."""
    setting, given = program.settings.get((OFFSET, screw.axis)), context.file_start
    if setting is None:
        if given is None:
            raise source.error(
                f"no {OFFSET} of axis {screw.axis}, so the position of mark A of the screw is unknown",
                option_hint("file_start", "the machine position of mark A"),
                line=program.tables[screw.axis].line,
            )
        return given, "from file_start"
    offset = float(setting.value)
    if given is None and offset == 0:
        return offset, OFFSET
    ways = (offset, "it is the position of A"), (-offset, "it is added to a position to find it in the table")
    for start, way in ways:
        if given is not None and abs(given - start) <= SAME_START:
            return start, f"file_start; so {OFFSET} {offset:g} means: {way}" if offset else OFFSET
    found = f"but file_start is {given:g}" if given is not None else "and Mint's guide gives it two meanings"
    positions = " or ".join(
        dict.fromkeys(f"file_start = {context.as_given(start) + 0.0:.9g}" for start, _ in ways)
    )
    raise source.error(
        f"{OFFSET} {offset:g}, {found}",
        f"{positions} ({typed('file_start')}): check where mark A of the screw is on the machine",
        line=setting.line,
        code="R9",
        readings=(_reading(screw, start, way, context) for start, way in ways) if offset else (),
    )


def _reading(screw: _Screw, start: float, way: str, context: FileContext) -> str:
    """Describe one reading of mark A by a target that lies behind A in both readings."""
    assert context.units is not None, "the context is in units of the file"
    target = abs(start) + screw.increment / 5
    position = target - start
    out = "unchanged: Mint adds nothing there"
    if position <= screw.forward[-1].position:
        out = f"as {target + _at(screw.forward, position):.5f}"
    end = start + max(screw.forward[-1].position, screw.backward[-1].position)
    return (
        f"{way}: mark A at {start:g} {context.units.value}, the table from there to {end:g}; moving "
        f"forward, {target:g} is sent {out}"
    )


def _rows(screw: _Screw, start: float) -> tuple[SourceRow, ...]:
    """Return the points of both directions, in order of position."""
    rows: list[SourceRow] = []
    lines = [{knot.position: knot.line for knot in knots} for knots in (screw.forward, screw.backward)]
    for positions in _together(sorted({knot.position for knot in (*screw.forward, *screw.backward)})):
        position = positions[0]
        forward, backward = _at(screw.forward, position), _at(screw.backward, position)
        numbers = [next((line for at in positions if (line := branch.get(at))), None) for branch in lines]
        rows.append(
            SourceRow(start + position, forward, backward, position, position, numbers[0], numbers[1])
        )
    return tuple(rows)


def _together(positions: Sequence[float]) -> list[list[float]]:
    """Group positions that are one position."""
    groups = [[positions[0]]]
    for position in positions[1:]:
        if position - groups[-1][0] > SAME_POSITION:
            groups.append([])
        groups[-1].append(position)
    return groups


def _at(knots: Sequence[_Knot], position: float) -> float:
    """Return the correction of one direction; behind its last point it does not change."""
    above = bisect_right(knots, position, key=lambda knot: knot.position)
    if above == len(knots) or knots[above - 1].position == position:
        return knots[above - 1].correction
    low, high = knots[above - 1], knots[above]
    share = (position - low.position) / (high.position - low.position)
    return low.correction + share * (high.correction - low.correction)


def _outside(rows: Sequence[SourceRow], units: Units) -> tuple[tuple[str, ...], str]:
    """Return the behaviour outside: that of Mint if it makes no step."""
    step = max(abs(correction) for row in (rows[0], rows[-1]) for correction in (row.forward, row.backward))
    if step <= NOTHING:
        return ('outside = "zero"',), "both ends are 0: outside, Mint adds nothing"
    return (), (
        f"Mint adds nothing outside, so the axis would jump by {step:.6g} {units.value} at the end of the "
        "table. The gateway does not allow this: it holds the last correction, or fades it: outside = { "
        "fade = LENGTH }"
    )


def _reversal_lines(reversal: _Reversal, units: Units, axis_units: Units | None) -> tuple[str, ...]:
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


def _reversal_of(source: SourceText, program: Program, axis: int, *, has_two_tables: bool) -> _Reversal:
    """Return the program's settings for the reversal of one axis, besides its table.

    BACKLASHMODE 1 adds BACKLASH in one direction, over BACKLASHINTERVAL servo cycles. The sign gives the
    direction. With a positive size the motor is at the negative end of the lost motion after homing: moving
    forward needs the whole size, moving back nothing (MN1270, BACKLASHMODE). With a negative size it is the
    reverse. With two tables it must be off, because these contain the lost motion.

    Raises:
        TabFileError: backlash that is not off beside two tables, or an invalid number of cycles.
    """
    cycles = _cycles(source, program, axis)
    setting = program.settings.get((BACKLASH, axis))
    width = 0.0 if setting is None else float(setting.value)
    if setting is None or width == 0:
        return _Reversal(0.0, cycles, (), ())
    if _is_off(source, program, axis):
        return _Reversal(0.0, cycles, (f"{BACKLASH} {width:g} does not count: {BACKLASH_MODE} is off",), ())
    if has_two_tables:
        raise source.error(
            f"{BACKLASH} {width:g} beside a forward and a reverse table, which already contain the lost "
            "motion",
            f"{BACKLASH_MODE}.{axis} = _blOFF, or one table",
            line=setting.line,
        )
    message = (
        f"{BACKLASH} {width:g} is not in the table: the control added {abs(width):g} while moving "
        f"{'forward' if width > 0 else 'back'}; for the same, set 'backlash' of the axis"
    )
    return _Reversal(width, cycles, (), (Lint("R8", LintSeverity.WARNING, message, setting.line),))


def _is_off(source: SourceText, program: Program, axis: int) -> bool:
    setting = program.settings.get((BACKLASH_MODE, axis))
    if setting is None or setting.value in {1.0, "_BLON"}:
        return False
    if setting.value in {0.0, "_BLOFF"}:
        return True
    raise source.error(f"{BACKLASH_MODE} {setting.value}", "0 or _blOFF, 1 or _blON", line=setting.line)


def _cycles(source: SourceText, program: Program, axis: int) -> int | None:
    setting = program.settings.get((BACKLASH_INTERVAL, axis))
    if setting is None:
        return None
    number = float(setting.value)
    if number < 0 or number != int(number):
        raise source.error(f"{BACKLASH_INTERVAL} {number:g}", "a whole number of cycles", line=setting.line)
    return int(number)


# --- Writing
#
# Mint needs the nut's position at even theoretical (motor) positions A + i x increment: the inverse of our
# curve there. Between two entries it draws a straight line, so bends of the curve between them are lost; the
# resulting error is computed and reported. A table from a Mint program fits its increment again.
#
# Mark A has no correction, by definition. If the table begins with one, A is put below the table, and the
# correction grows slowly from there.

DECIMALS: Final = 8
_FIT_MM: Final = 1e-6
"""Points that are not evenly spaced are only written if an increment fits them as well as this."""
_RAMP: Final = 0.004
"""Largest slope with which a first correction grows from 0 at mark A."""
_PARTS: Final = (1, 2, 3, 4)


class _Curve(Struct, frozen=True):
    """One direction: points, and their motor positions; the end values hold outside."""

    positions: Sequence[float]
    corrections: Sequence[float]
    images: Sequence[float]

    def correction(self, position: float) -> float:
        return _along(self.positions, self.corrections, position)

    def nut(self, motor: float) -> float:
        """Return the position with the corrected position ``motor``."""
        return motor - _along(self.images, self.corrections, motor)


class _Plan(Struct, frozen=True):
    """Entries for one increment; their largest difference from the table, and its position."""

    start: float
    increment: float
    entries: tuple[tuple[float, ...], tuple[float, ...]]
    difference: float
    position: float


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table for axis ``file_axis`` (default 0) with the increment that fits best.

    Raises:
        TabFileError: an axis that is not a number, or uneven points that no even increment fits.
    """
    axis = "0" if options.file_axis is None else options.file_axis
    if not (axis.isascii() and axis.isdigit()):
        raise unwritable(NAME, f"axis {axis!r}", "the number of an axis: --to-file-axis N")
    increments = _increments(table)
    plans = [plan for increment in increments if (plan := _plan(table, increment)) is not None]
    fit = table.units.from_mm(_FIT_MM)
    best = next((plan for plan in plans if plan.difference <= fit), plans[0] if plans else None)
    if best is None or (not _is_even(table) and best.difference > fit):
        found = "points that are not evenly spaced and do not fit an even increment"
        if best is not None:
            found += f" (off by {best.difference:.3g} {table.units.value} at {best.position:g})"
        raise unwritable(NAME, found, "an even grid: --resample STEP")
    context = FileContext(file_units=table.units, file_axis=axis, file_start=best.start)
    return Written(_program(table, best, axis), _losses(table, best, options), context)


def _is_even(table: CorrectionTable) -> bool:
    step = (table.last - table.first) / (len(table.positions) - 1)
    return all(
        abs(position - (table.first + index * step)) <= EVEN_TOLERANCE * step / 2
        for index, position in enumerate(table.positions)
    )


def _curves(table: CorrectionTable) -> tuple[_Curve, _Curve]:
    return _curve(table.positions, table.forward), _curve(table.positions, table.backward)


def _curve(positions: Sequence[float], corrections: Sequence[float]) -> _Curve:
    return _Curve(positions, corrections, [x + c for x, c in zip(positions, corrections, strict=True)])


def _increments(table: CorrectionTable) -> list[float]:
    """Return candidate increments, best first: the step of an even grid, parts of a motor distance."""
    found = [(table.last - table.first) / (len(table.positions) - 1)] if _is_even(table) else []
    gaps = [after - before for curve in _curves(table) for before, after in pairwise(_bends(curve))]
    found += [min(gaps) / part for part in _PARTS]
    return [increment for length in found if (increment := float(f"{length:.10g}")) > 0]


def _bends(curve: _Curve) -> list[float]:
    """Return the motor positions of the first point and of the bends of the curve, or of both ends.

    The last point is not a bend: if one direction ends before the other, it only holds its value up to there.
    """
    bends = [curve.images[0]]
    for index in range(1, len(curve.positions) - 1):
        low, high = curve.positions[index - 1], curve.positions[index + 1]
        share = (curve.positions[index] - low) / (high - low)
        chord = curve.corrections[index - 1] * (1 - share) + curve.corrections[index + 1] * share
        if abs(curve.corrections[index] - chord) > NOTHING:
            bends.append(curve.images[index])
    return bends if len(bends) > 1 else [curve.images[0], curve.images[-1]]


def _plan(table: CorrectionTable, increment: float) -> _Plan | None:
    """Return the entries for one increment; None if they are many more than the table's points."""
    start, forward, backward = _from_mark(table, increment)
    end = max(forward.images[-1], backward.images[-1])
    size = max(1, ceil((end - start) / increment - EVEN_TOLERANCE))
    if size > 4 * len(forward.positions) + (table.first - start) / increment:
        return None
    motors = [start + index * increment for index in range(1, size + 1)]
    entries = tuple(
        tuple(round(curve.nut(motor) - start, DECIMALS) + 0.0 for motor in motors)
        for curve in (forward, backward)
    )
    difference, position = 0.0, table.first
    for curve, positions in zip((forward, backward), entries, strict=True):
        read = _curve(
            [start, *(start + position for position in positions)],
            [0.0, *(index * increment - position for index, position in enumerate(positions, start=1))],
        )
        for at in (*table.positions, *read.positions):
            off = abs(read.correction(at) - curve.correction(at)) if table.first <= at <= table.last else 0.0
            if off > difference:
                difference, position = off, at
    return _Plan(start, increment, (entries[0], entries[1]), difference, position)


def _from_mark(table: CorrectionTable, increment: float) -> tuple[float, _Curve, _Curve]:
    """Return the position of mark A, and both curves from there."""
    largest = max(abs(table.forward[0]), abs(table.backward[0]))
    if largest <= NOTHING:
        return (float(f"{table.first:.12g}"), *_curves(table))
    # The correction is complete while the motor may still be below the table.
    ready = 2 * largest
    count = ceil((ready + largest / _RAMP) / increment)
    start = float(f"{table.first - count * increment:.12g}")
    before = [start, table.first - ready]
    return (
        start,
        _curve([*before, *table.positions], [0.0, table.forward[0], *table.forward]),
        _curve([*before, *table.positions], [0.0, table.backward[0], *table.backward]),
    )


def _along(positions: Sequence[float], values: Sequence[float], at: float) -> float:
    above = bisect_right(positions, at)
    if above == 0:
        return values[0]
    if above == len(positions):
        return values[-1]
    share = (at - positions[above - 1]) / (positions[above] - positions[above - 1])
    return values[above - 1] + share * (values[above] - values[above - 1])


def _program(table: CorrectionTable, plan: _Plan, axis: str) -> str:
    names = ["fwdTable"] if table.is_unidirectional else ["fwdTable", "revTable"]
    lines = [
        f"' Leadscrew table of axis {axis} in {table.units.value}, mark A at {plan.start:.12g}",
        *(
            f"DIM {name}({len(entries)}) = {', '.join(map(_number, entries))}"
            for name, entries in zip(names, plan.entries, strict=False)
        ),
        f"PRECISIONTABLE({axis}, {', '.join(names)})",
        f"PRECISIONINCREMENT.{axis} = {plan.increment:.10g}",
        f"PRECISIONOFFSET.{axis} = {plan.start:.12g}",
    ]
    if table.is_unidirectional:
        lines.append(f"' Switch it on with the single table mode of axis {axis}")
    else:
        lines.append(f"BACKLASHMODE.{axis} = _blOFF : REM the tables contain the lost motion")
        lines.append(f"PRECISIONMODE.{axis} = _lsDUAL_TABLE")
    return "".join(f"{line}\n" for line in lines)


def _number(value: float) -> str:
    return f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")


def _losses(table: CorrectionTable, plan: _Plan, options: WriteOptions) -> tuple[str, ...]:
    unit = table.units.value
    between = (
        f"Mint uses straight lines between motor positions {plan.increment:.10g} apart: the curve differs "
        f"by up to {plan.difference:.3g} {unit} (at {plan.position:g})"
    )
    losses = [
        between,
        f"positions are rounded to {DECIMALS} decimals; units ({unit}) are not in the file",
        "check the sign of PRECISIONOFFSET on the control: its guide describes both signs",
    ]
    if plan.start < table.first:
        losses.append(
            f"mark A has no correction, so it is placed at {plan.start:g}; from there the correction grows "
            f"to that of the first point, {table.first:g}"
        )
    if options.file_axis is None:
        losses.append("no axis was given: the program is for axis 0")
    return tuple(losses)
