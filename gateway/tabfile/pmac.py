"""Leadscrew compensation of Delta Tau's PMAC and Turbo PMAC (``DEFINE COMP``): one direction; read only.

Grammar, from the manufacturer's software reference and user manuals (on-line command ``DEFINE COMP``). Words
are in any case; ``;`` and ``//`` begin a comment::

    file    := (command | table)*           the commands that a terminal sends to the control
    table   := ["#" motor] "DEFINE" "COMP" entries "," ["#" source ["D"] "," ["#" target ","]] length
               entry{entries}
    entry   := whole number                 1/16 count; on the lines below, any number of them to a line

``DEF`` is short for ``DEFINE``. A command ``#1`` addresses a motor; source and target default to the
addressed motor. The first entry is one spacing, length / entries counts, from the zero of the motor, the last
one at ``length`` counts. Beyond, the control repeats the table. Entries for positions below zero are
therefore at the end of the table, and the last entry also belongs to zero. The manuals require a 0 there, and
say that the correction at zero is 0 by definition. Another last entry contradicts one of both and is refused.

The manuals say that the control adds an entry to the desired position. A file does not prove it, so
``error_sense`` is required. Counts are those of the old motor: ``file_counts_per_unit``, negative if they
fall while the axis moves up. The travel determines the entries below zero.
"""

import re
from collections.abc import Iterator, Sequence
from collections.abc import Set as AbstractSet
from math import ceil, floor
from typing import Final

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import RULES, TOUCH, context_in_file_units, required_sense, required_units
from gateway.tabfile.decoded import Decoded, Lint, LintSeverity, SourceRow
from gateway.tabfile.increments import REVOLUTION_DEGREES, is_revolution
from gateway.tabfile.options import FileContext, option_hint
from gateway.tabfile.text import SourceText, listed, shown, to_integer
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME: Final = "pmac"
TITLE: Final = "PMAC compensation table (DEFINE COMP), one direction, 1/16 counts; read only"
SUFFIX: Final = ".pmc"
USES: Final = frozenset({"file_counts_per_unit", "file_axis", "error_sense"})
PER_COUNT: Final = 16
_WHAT: Final = "a PMAC compensation table"
_WHY: Final = "by its manual an entry is added (command_minus_actual), but the file does not prove it"
_ALLOWED: Final = (
    "DEFINE COMP entries,#source,#target,length: 'DEFINE COMP 4,#1,#1,4000', or 'DEFINE COMP 4,4000'"
)
_COMMENT: Final = re.compile(r";|//")
_HEAD: Final = re.compile(r"(?:#([0-9]{1,2})[ \t]*)?DEF(?:INE)?[ \t]+COMP\b(.*)", re.IGNORECASE | re.ASCII)
_OTHER: Final = re.compile(r"(?:#[0-9]+[ \t]*)?DEF(?:INE)?[ \t]+(?:BL|T)COMP\b", re.IGNORECASE | re.ASCII)
_MOTOR: Final = re.compile(r"#([0-9]{1,2})(D?)", re.IGNORECASE | re.ASCII)
_ADDRESSED: Final = re.compile(r"#([0-9]{1,2})(?![0-9]|[ \t]*->)", re.ASCII)
"""A motor that a command addresses; ``#1->1000X`` defines an axis."""
_ENABLED: Final = re.compile(r"\bI51[ \t]*=[ \t]*([0-9]+)", re.IGNORECASE | re.ASCII)
_NUMBER: Final = re.compile(r"[+-]?[.0-9]")


class _Table(Struct, frozen=True):
    """One table as written; ``source`` and ``target`` are None for the addressed motor."""

    addressed: str | None
    source: str | None
    target: str | None
    length: int
    line: int
    values: tuple[int, ...]
    lines: tuple[int, ...]


class _File(Struct, frozen=True):
    """All tables, the number of other commands, and the line that leaves the compensation off."""

    tables: tuple[_Table, ...]
    commands: int
    off: int | None


def recognise(source: SourceText) -> bool:
    """Whether a line defines such a table, and none a table of backlash or torque."""
    return any(_HEAD.match(line.text) for line in source.lines) and not any(
        _OTHER.match(line.text) for line in source.lines
    )


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the table of one motor, over the travel of the axis or one revolution.

    Raises:
        TabFileError: a line outside the grammar, a wrong number of entries, a table in two dimensions or of
            two motors, several tables and no motor given, a last entry other than 0; no units, scale, sense
            or travel given, a travel that is longer than the table.
    """
    file = _parse(source)
    table, motor = _choose(source, file.tables, context)
    units = context.file_units or context.units or required_units(source, context, _WHAT)
    context = context_in_file_units(source, context, units)
    scale = context.file_counts_per_unit
    if scale is None:
        raise source.error(
            f"{_WHAT} holds counts, and file_counts_per_unit is missing",
            f"file_counts_per_unit = counts of the motor per {context.option_units(units).value} on the "
            "OLD control, negative if they decrease while the axis goes up",
        )
    sense = required_sense(source, context, _WHAT, _WHY)
    if table.values[-1]:
        raise source.error(
            f"a last entry of {table.values[-1]}, but it is also the entry for the zero of the motor, "
            "where the correction is 0 by definition",
            "0; if the control did correct at zero, write the table as CSV: position_mm,correction_mm",
            line=table.lines[-1],
        )
    size = len(table.values)
    step = table.length / (size * abs(scale))
    low, high = _steps(source, context, table, step, units)
    direction = 1 if scale > 0 else -1
    rows, used = [], set()
    for number in range(low, high + 1):
        # Entry 1 is at one spacing, so 0 and each whole length use the last one.
        index = (direction * number - 1) % size
        used.add(index)
        value, line = table.values[index], table.lines[index]
        added = sense.to_correction * value / (PER_COUNT * scale) + 0.0
        position = number * table.length / (size * abs(scale)) + 0.0
        rows.append(SourceRow(position, added, added, value, value, line, line))
    revolution = REVOLUTION_DEGREES if is_revolution(units, high - low, step) else None
    rule = f"{RULES[sense]}; an entry / {PER_COUNT} / file_counts_per_unit"
    return Decoded(
        tuple(rows),
        units,
        context,
        "1/16 count",
        rule,
        rule,
        file_axis=motor,
        decisions=(
            f"sense {sense.value}: as given",
            (f"{'the addressed motor' if motor is None else f'motor {motor}'}: its zero is that of the axis"),
            (f"entries are {step:.9g} {units.value} apart; below zero of the motor they count from the end"),
            *((f"other commands, not part of the table: {file.commands}",) if file.commands else ()),
        ),
        remarks=_remarks(file, table, used),
        behaves_as=() if revolution is None else (f"modulo = {revolution:g}",),
        modulo=revolution,
    )


def _parse(source: SourceText) -> _File:
    tables: list[_Table] = []
    addressed: str | None = None
    commands, off = 0, None
    bare = ((line.number, _COMMENT.split(line.text, maxsplit=1)[0].strip()) for line in source.lines)
    texts = ((number, text) for number, text in bare if text)
    for number, text in texts:
        head = _HEAD.fullmatch(text)
        if head is not None:
            addressed = head[1] or addressed
            tables.append(_table(source, number, head[2], addressed, texts))
        elif _NUMBER.match(text):
            allowed = "the number of entries that DEFINE COMP states, all below it"
            raise source.error(f"{shown(text)} outside of a table", allowed, line=number)
        else:
            commands += 1
            addressed = next(reversed(_ADDRESSED.findall(text)), addressed)
            for enabled in _ENABLED.findall(text):
                off = None if to_integer(enabled) else number
    if not tables:
        raise source.error("no table", _ALLOWED)
    return _File(tuple(tables), commands, off)


def _table(
    source: SourceText, line: int, head: str, addressed: str | None, texts: Iterator[tuple[int, str]]
) -> _Table:
    """Read the rest of the line behind DEFINE COMP, and the entries on the lines below it."""
    first, *between, last = [field.strip() for field in (head if "," in head else f"{head},").split(",")]
    if "." in first:
        raise source.error("a table in two dimensions", "tables of one motor", line=line)
    size, length = to_integer(first), to_integer(last)
    motors = [_MOTOR.fullmatch(name) for name in between]
    names = [(motor[1], bool(motor[2])) for motor in motors if motor]
    is_named = len(names) == len(motors) <= 2 and not any(is_desired for _, is_desired in names[1:])
    if not is_named or size is None or length is None or size < 1 or length < 1:
        raise source.error(shown(f"DEFINE COMP {head.strip()}"), _ALLOWED, line=line)
    values: list[int] = []
    lines: list[int] = []
    while len(values) < size:
        number, text = next(texts, (source.last_line, ""))
        expected = f"{size} whole numbers below line {line}, in 1/16 count, as DEFINE COMP says"
        if not text:
            raise source.error(f"{len(values)} entries", expected, line=number)
        entries = [to_integer(word) for word in text.split()]
        if None in entries:
            raise source.error(f"{shown(text)} after {len(values)} entries", expected, line=number)
        values += [entry or 0 for entry in entries]
        lines += [number] * len(entries)
    if len(values) > size:
        raise source.error(f"{len(values)} entries", expected, line=lines[-1])
    source_motor, target = (*(motor for motor, _ in names), None, None)[:2]
    return _Table(addressed, source_motor, target, length, line, tuple(values), tuple(lines))


def _choose(source: SourceText, tables: Sequence[_Table], context: FileContext) -> tuple[_Table, str | None]:
    """Return the table of the given motor, or the only one; and its motor if anything names it."""
    given = context.file_axis.removeprefix("#") if context.file_axis else None
    motors = [table.target or table.addressed or given for table in tables]
    for table, motor in zip(tables, motors, strict=True):
        if motor is None and (table.source is not None or len(tables) > 1):
            number = table.source or "1"
            raise source.error(
                "a table for the addressed motor, but the file does not name it",
                f"'#{number}' on a line above it if it is motor {number}, or file_axis = '{number}'",
                line=table.line,
            )
    names = listed(dict.fromkeys(motor for motor in motors if motor))
    fitting = [index for index, motor in enumerate(motors) if given in (None, motor)]
    if not fitting:
        raise source.error(
            f"tables of motor {names}, but file_axis = {shown(given or '')}", f"file_axis = one of {names}"
        )
    if len(fitting) > 1:
        first, second, *_ = fitting
        is_same = motors[first] == motors[second]
        raise source.error(
            f"a second table of motor {motors[second]}" if is_same else f"tables of motor {names}",
            "one of each motor" if is_same else option_hint("file_axis", f"one of {names}"),
            line=tables[second].line,
        )
    table, motor = tables[fitting[0]], motors[fitting[0]]
    if (table.source or table.addressed or motor) != motor:
        raise source.error(
            f"a table that corrects motor {motor} over the position of motor "
            f"{table.source or table.addressed}",
            "a table of one motor; for the 'cross' key of the axis write this one as CSV: "
            "position_mm,correction_mm",
            line=table.line,
        )
    return table, motor


def _steps(
    source: SourceText, context: FileContext, table: _Table, step: float, units: Units
) -> tuple[int, int]:
    """Return the first and the last spacing that the travel needs, counted from the zero of the axis."""
    size = len(table.values)
    if context.travel is None:
        if is_revolution(units, size, step):
            return 0, size
        raise source.error(
            f"{_WHAT} without travel: its last entries are for positions below zero, and travel shows which",
            "travel = [lowest, highest] of the axis (--travel LO HI on the command line); only a table of "
            f"{REVOLUTION_DEGREES:g} degrees needs none",
            line=table.line,
        )
    low, high = context.travel
    if high - low > size * step * (1 + TOUCH):
        unit = context.option_units(units).value
        long, covered = context.as_given(high - low), context.as_given(size * step)
        raise source.error(
            f"a length of {table.length} counts, that is {covered:.9g} {unit}, for a travel of {long:.9g}: "
            "the control would repeat the table",
            "a table as long as the travel, with the right file_counts_per_unit and travel; if the table "
            "is meant to repeat, write it as CSV over the whole travel",
            line=table.line,
        )
    first = floor(low / step + TOUCH)
    return first, max(ceil(high / step - TOUCH), first + 1)


def _remarks(file: _File, table: _Table, used: AbstractSet[int]) -> tuple[Lint, ...]:
    remarks = []
    if file.off is not None:
        message = (
            "make sure that this is the right table: the file leaves compensation off (I51 = 0), so the "
            "control did not use it"
        )
        remarks.append(Lint("R11", LintSeverity.WARNING, message, file.off))
    left = [index + 1 for index, value in enumerate(table.values) if value and index not in used]
    if left:
        message = (
            f"check the length of the table, file_counts_per_unit and travel: {len(left)} entries other "
            f"than 0, from {left[0]} to {left[-1]}, are outside travel"
        )
        remarks.append(Lint("R13", LintSeverity.WARNING, message, table.line))
    return tuple(remarks)


def write(table: CorrectionTable, _: WriteOptions) -> Written:
    """Refuse: this format is read only.

    Raises:
        TabFileError: always.
    """
    raise unwritable(
        NAME,
        f"a table of {len(table.positions)} points to write",
        "another format, such as csv: PMAC tables are only read",
    )
