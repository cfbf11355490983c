"""Centroid .tab version 2 (CNC7 7.50 and up, CNC10 below 2.61): two directions, tenths or microns.

Grammar, after Centroid TB058 ("File Format") and the description by CNC Services Northwest::

    file   := header value{N+1} separator value{N+1}
    header := "2" N STEP UNITS F5 F6 [";" comment]      blanks or commas between the fields
    value  := decimal number, -999.9999 to 999.9999     one to a line
    separator := ";" anything                           "; backward data"

N counts intervals, so each list has N + 1 values. STEP is in machine units; UNITS is 20 (inch, values in
0.0001 inch) or 21 (mm, values in microns). A value is target - measured and is added unchanged. The first
list holds for motion in the positive direction, the second for the negative; both begin at the most negative
position. Text after ";" is ignored. A line with only such text may come before or after the lists, not inside
one. A file without the separator is accepted, with a remark, if it has exactly 2(N + 1) values.

The sources differ on the position of the first point. CNC Services: F6 is its machine position and F5 the
encoder counts of the whole travel. TB058: F5 and F6 are the constants 1 and 0; the start follows from the
travel limits, which are not in the file. Therefore a given ``file_start`` is used. With F5 other than 1, F6
is used once F5 is confirmed as a number of counts. "1 0" means the travel limits of the axis. Anything else
is refused.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import floor, inf
from typing import Final

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import (
    Interpretation,
    check_home,
    check_range,
    context_in_file_units,
    describe_both,
    unused_options,
)
from gateway.tabfile.decoded import Decoded, Lint, LintSeverity, SourceRow
from gateway.tabfile.errors import ContextError, FileProblem, TabFileError
from gateway.tabfile.names import axis_of_comment
from gateway.tabfile.options import FileContext
from gateway.tabfile.text import SourceLine, SourceText, shown, to_decimal, to_integer, with_point
from gateway.tabfile.writing import LARGER_SCALE, WriteOptions, Written, even_step, unwritable

NAME: Final = "centroid-2"
TITLE: Final = "Centroid version 2 (CNC7 7.50 and up, CNC10 below 2.61), two directions, tenths or microns"
USES: Final = frozenset({"file_counts_per_unit", "file_start", "file_home"})
MAX_VALUE: Final = 999.9999
MIN_INTERVALS: Final = 2
COUNTS_TOLERANCE: Final = 1e-4
"""F5 / travel may differ from the given counts per unit by 0.01 %."""
GRID_TOLERANCE: Final = 1e-6
MIN_LARGEST_VALUE: Final = 0.01
"""If all values of a file are below this, they are in inches or mm instead of tenths or microns."""
MAX_PROBLEMS: Final = 20
_UNITS: Final = {20: Units.INCH, 21: Units.MM}
_CODES: Final = {units: code for code, units in _UNITS.items()}
_VALUES_PER_UNIT: Final = {Units.INCH: 1e4, Units.MM: 1e3}
_VALUE_UNITS: Final = {Units.INCH: "0.0001 inch", Units.MM: "µm"}
_HEADER: Final = "2 N STEP UNITS F5 F6 ; comment"


class _Header(Struct, frozen=True):
    line: int
    intervals: int
    step: float
    units: Units
    counts: float
    """F5"""
    position: float
    """F6"""
    comment: str


class _Start(Struct, frozen=True):
    """Position of the first point, with the reason; ``other`` is the next best position."""

    position: float
    reason: str
    remarks: tuple[Lint, ...] = ()


def recognise(source: SourceText) -> bool:
    """Whether the first line has six or more numbers that begin with 2."""
    fields = fields_of_header(source.lines[0].text.partition(";")[0])
    return len(fields) >= 6 and fields[0] == "2" and all(to_decimal(field) is not None for field in fields)


def fields_of_header(content: str) -> list[str]:
    """Split a header: blanks between its fields, or commas between all of them, as printed in TB058.

    >>> fields_of_header("2, 4, 0.5, 20, 1, 0 ")
    ['2', '4', '0.5', '20', '1', '0']
    """
    if "," in content:
        return [field.strip() for field in content.split(",")]
    return content.split()


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the file and decide the position of its first point.

    Raises:
        TabFileError: a line outside the grammar, a wrong number of values, a value out of range, a start
            without proof, a count of encoder pulses or a range that does not fit the axis.
    """
    header = _parse_header(source)
    forward, backward, remarks = _parse_lists(source, header)
    context = context_in_file_units(source, context, header.units)
    start = _decide_start(source, header, (forward, backward), context)
    rows = _rows(header, forward, backward, start.position)
    mirror = _reading(header, forward, backward, start.position - header.intervals * header.step)
    reading = _reading(header, forward, backward, start.position)
    check_range(
        source,
        reading,
        mirror,
        context,
        f"file_start = {context.as_given(mirror.rows[0].position):.9g} or the right travel",
    )
    check_home(source, rows, context)
    unused = ("file_counts_per_unit",) if header.counts == 1 else ()
    rule = "value = target - measured, added unchanged; {} list (towards {} positions)"
    return Decoded(
        rows,
        header.units,
        _with_counts(context, header),
        _VALUE_UNITS[header.units],
        rule.format("first", "greater"),
        rule.format("second", "smaller"),
        comment_axis=axis_of_comment(header.comment),
        plausible=(MIN_LARGEST_VALUE, inf),
        decisions=(start.reason,),
        remarks=(*remarks, *start.remarks, *unused_options(context, NAME, unused), *_ends(rows)),
    )


def _ends(rows: Sequence[SourceRow]) -> tuple[Lint, ...]:
    """Report what TB058 says of the ends, where its own rule of home does not explain them.

    By that rule one end has a value other than 0 if the other end is 0 (TB058's example: +2.0000).
    """
    first, last = rows[0].forward_value, rows[-1].backward_value
    if not first or not last:
        return ()
    message = (
        f"the first forward value is {first:g} and the last backward value {last:g}; they are used "
        'unchanged, but TB058 says that both "must be zero. It is impossible to acquire meaningful data '
        'for these points"'
    )
    return (Lint("R12", LintSeverity.INFO, message, rows[0].forward_line),)


def _parse_header(source: SourceText) -> _Header:
    line = source.lines[0]
    content, _, comment = line.text.partition(";")
    fields = fields_of_header(content)
    if len(fields) != 6:
        raise source.error(f"{len(fields)} header fields", f"6: {_HEADER}", line=line.number)
    intervals, code = to_integer(fields[1]), to_integer(fields[3])
    step, counts, position = (to_decimal(fields[index]) or 0.0 for index in (2, 4, 5))
    if intervals is None or intervals < MIN_INTERVALS:
        allowed = f"a whole number of intervals, at least {MIN_INTERVALS}"
        raise source.error(f"field 2 (N) {shown(fields[1])}", allowed, line=line.number)
    if step <= 0:
        allowed = with_point(fields[2], "a distance above 0")
        raise source.error(f"field 3 (STEP) {shown(fields[2])}", allowed, line=line.number)
    if code not in _UNITS:
        raise source.error(f"field 4 (UNITS) {shown(fields[3])}", "20 (inch) or 21 (mm)", line=line.number)
    return _Header(line.number, intervals, step, _UNITS[code], counts, position, comment)


def _parse_lists(
    source: SourceText, header: _Header
) -> tuple[list[SourceLine], list[SourceLine], tuple[Lint, ...]]:
    """Return the value lines of both lists, in the order of the file."""
    size = header.intervals + 1
    values: list[SourceLine] = []
    comments: list[tuple[int, int]] = []
    """Number of values before a comment line, and the line number of the comment."""
    problems: list[FileProblem] = []
    for line in source.lines[1:]:
        text = line.text.partition(";")[0].strip()
        if text:
            values.append(SourceLine(line.number, text))
            problems.extend(_value_problems(source, line.number, text))
        elif line.text:
            comments.append((len(values), line.number))
        else:
            problems.append(source.problem("a blank line", "a value on every line", line=line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    _check_counts(source, size, len(values), comments)
    has_separator = any(before == size for before, _ in comments)
    missing = Lint(
        "R1", LintSeverity.WARNING, "no '; backward data' line between the lists: split by their length", None
    )
    return values[:size], values[size:], () if has_separator else (missing,)


def _value_problems(source: SourceText, line: int, text: str) -> Iterable[FileProblem]:
    value = to_decimal(text)
    if value is None:
        yield source.problem(shown(text), with_point(text), line=line)
    elif abs(value) > MAX_VALUE:
        yield source.problem(f"value {text}", f"{-MAX_VALUE} to {MAX_VALUE}", line=line)


def _with_counts(context: FileContext, header: _Header) -> FileContext:
    """Return the context with the encoder counts of the header, so that a table written again keeps them."""
    if context.file_counts_per_unit or header.counts == 1:
        return context
    try:
        return replace(context, file_counts_per_unit=header.counts / (header.intervals * header.step))
    except ContextError:  # no possible number, and nothing in the table depends on it
        return context


def _check_counts(source: SourceText, size: int, total: int, comments: Iterable[tuple[int, int]]) -> None:
    for before, line in comments:
        if before not in (0, size, 2 * size):
            found, branch = (before, "forward") if before < size else (before - size, "backward")
            raise source.error(
                f"a comment line after {found} {branch} values",
                f"{size} values in each list (N + 1), then the line between them",
                line=line,
            )
    if total != 2 * size:
        raise source.error(
            f"{total} values",
            f"{2 * size}: N + 1 = {size} forward and {size} backward",
            line=source.last_line,
        )


def _reading(
    header: _Header, forward: list[SourceLine], backward: list[SourceLine], start: float
) -> Interpretation:
    return Interpretation(f"file_start {start:g}", _rows(header, forward, backward, start), header.units)


def _rows(
    header: _Header, forward: list[SourceLine], backward: list[SourceLine], start: float
) -> tuple[SourceRow, ...]:
    per_unit = _VALUES_PER_UNIT[header.units]
    rows = []
    for index, (ahead, back) in enumerate(zip(forward, backward, strict=True)):
        position = start + index * header.step
        if abs(position) < GRID_TOLERANCE * header.step:
            position = 0.0
        one, other = float(ahead.text), float(back.text)
        rows.append(
            SourceRow(position, one / per_unit, other / per_unit, one, other, ahead.number, back.number)
        )
    return tuple(rows)


def _decide_start(
    source: SourceText,
    header: _Header,
    lists: tuple[list[SourceLine], list[SourceLine]],
    context: FileContext,
) -> _Start:
    _check_encoder_counts(source, header, context)
    if context.file_start is not None:
        return _Start(context.file_start, f"start {context.file_start:g}: from file_start")
    if header.counts != 1:
        return _Start(
            header.position, f"start {header.position:g}: from field 6, because field 5 holds encoder counts"
        )
    if header.position != 0:
        candidates = [header.position, -header.intervals * header.step]
        raise _ambiguous_start(
            source,
            header,
            lists,
            candidates,
            f"fields 5 and 6 are '1 {header.position:g}', which no manual describes",
        )
    if context.travel is None:
        candidates = [-header.intervals * header.step, 0.0]
        raise _ambiguous_start(
            source,
            header,
            lists,
            candidates,
            "fields 5 and 6 are '1 0', which does not state the first position, and there are no travel "
            "limits",
        )
    return _start_from_travel(source, header, lists, context)


def _check_encoder_counts(source: SourceText, header: _Header, context: FileContext) -> None:
    """If F5 is a number of counts, check it against the old scale, or at least the length."""
    if header.counts == 1:
        return
    length = header.intervals * header.step
    found = abs(header.counts) / length
    unit = header.units.value
    given = context.file_counts_per_unit
    if given is not None and abs(found - abs(given)) > COUNTS_TOLERANCE * abs(given):
        raise source.error(
            f"field 5, {header.counts:.10g} counts over {length:g} {unit}, gives {found:.8g} counts per "
            f"{unit}, but file_counts_per_unit = {given:.8g}",
            f"the same within {COUNTS_TOLERANCE:.2%}",
            line=header.line,
        )
    if given is None and context.file_start is None and found <= 1:
        raise source.error(
            f"field 5, {header.counts:.10g} over {length:g} {unit}, is too small for encoder counts",
            f"1, or more than 1 count per {unit}; or file_start = position of the first point",
            line=header.line,
        )


def _start_from_travel(
    source: SourceText,
    header: _Header,
    lists: tuple[list[SourceLine], list[SourceLine]],
    context: FileContext,
) -> _Start:
    """Derive the start as TB058 does: multiples of the step, beginning just inside the travel."""
    assert context.travel is not None
    low, high = context.travel
    length = header.intervals * header.step
    travel = f"travel {low:g} to {high:g}"
    if high == 0:
        fitting = floor(-low / header.step + GRID_TOLERANCE)
        if header.intervals != fitting:
            found = (
                f"{header.intervals} intervals of {header.step:g} for {travel}, which has room for {fitting}"
            )
            raise _ambiguous_start(source, header, lists, [-length, -fitting * header.step], found)
        return _Start(-length, f"start {-length:g}: multiples of the step down from 0, {travel}")
    if low == 0:
        return _Start(0.0, f"start 0: {travel}")
    if length < (high - low) - header.step * (1 + GRID_TOLERANCE):
        found = f"{header.intervals} intervals of {header.step:g}, too few for {travel}"
        raise _ambiguous_start(source, header, lists, [low, high - length], found)
    message = (
        f"check the start {low:g}, which comes from {travel}; if it is right, set file_start = "
        f"{context.as_given(low):.9g}"
    )
    return _Start(low, f"start {low:g}: lower end of {travel}", (Lint("R2", LintSeverity.WARNING, message),))


def _ambiguous_start(
    source: SourceText,
    header: _Header,
    lists: tuple[list[SourceLine], list[SourceLine]],
    starts: Iterable[float],
    found: str,
) -> TabFileError:
    readings = [_reading(header, *lists, start) for start in starts]
    return source.error(
        found,
        "file_start = position of the first point (or the travel limits that the table was made for)",
        line=header.line,
        readings=describe_both(readings[0], readings[1]),
    )


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table; the header has encoder counts and start if the scale is given, else ``1 0``.

    Values are rounded to 0.0001 tenth or micron.

    Raises:
        TabFileError: degrees, fewer than 3 points, points that are not evenly spaced, a value out of range, a
            scale that gives too few counts for the cross-check of a reader.
    """
    step = even_step(table, NAME)
    if table.units not in _CODES:
        raise unwritable(NAME, f"a table in {table.units.value}", "a table in inch or mm")
    intervals = len(table.positions) - 1
    if intervals < MIN_INTERVALS:
        raise unwritable(NAME, f"{intervals} interval", f"at least {MIN_INTERVALS}")
    counts, start = _origin(table, options)
    letter = f" for {options.axis.upper()} axis" if options.axis else ""
    header = f"2 {intervals} {step:.10g} {_CODES[table.units]} {counts} {start}"
    lines = [
        f"{header} ; Ver. 2 compensation tables{letter}",
        *_value_lines(table, table.forward),
        "; backward data",
        *_value_lines(table, table.backward),
    ]
    losses = [f"values are rounded to 0.0001 x {_VALUE_UNITS[table.units]}"]
    if counts == 1:
        losses.append(f"the start is not in the file: read it with file_start {table.first:g}")
    context = FileContext(axis=options.axis, file_start=table.first if counts == 1 else None)
    return Written("".join(f"{line}\n" for line in lines), tuple(losses), context)


def _origin(table: CorrectionTable, options: WriteOptions) -> tuple[int, str]:
    """Return fields 5 and 6."""
    scale = options.file_counts_per_unit
    if scale is None:
        return 1, "0"
    length = table.last - table.first
    counts = round(length * scale)
    if (
        abs(scale) <= 1
        or abs(counts - length * scale) > COUNTS_TOLERANCE * abs(length * scale) / 2
        or counts == 1
    ):
        found = (
            f"{length * scale:.6g} counts over the table: too few, a reader would not take them for counts"
        )
        raise unwritable(NAME, found, f"{LARGER_SCALE}, or none")
    return counts, f"{table.first:.6f}"


def _value_lines(table: CorrectionTable, curve: Iterable[float]) -> list[str]:
    per_unit = _VALUES_PER_UNIT[table.units]
    lines = []
    for position, correction in zip(table.positions, curve, strict=True):
        value = f"{correction * per_unit + 0.0:.4f}"
        if abs(float(value)) > MAX_VALUE:
            found = f"{value} x {_VALUE_UNITS[table.units]} at {position:g}"
            raise unwritable(NAME, found, f"{-MAX_VALUE} to {MAX_VALUE}")
        lines.append(f"{value:>10}")
    return lines
