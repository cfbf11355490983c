"""Leadscrew error compensation of the ISG kernel and of Beckhoff TwinCAT CNC (``achskw*.lis``).

Source: ISG kernel documentation, "Leadscrew error compensation" (P-COMP-00017 to 00022 and 00059), and the
TwinCAT CNC manuals of axis compensation, with their example. Lines are ``key value``, see :mod:`isg_list`::

    kopf.log_achs_nr n, kopf.achs_nr n, kopf.log_achs_name text     which axis; not needed here
    kw.ssfk.unit 0|1             0: increments of the encoder; 1: 0.1 µm, or 0.0001 degree on a rotary axis
    kw.ssfk.interval n           0: each point has its ``setpoint``; above 0: distance of the points
    kw.ssfk.kw_startpos n        position of point 0 (has a meaning with an interval only)
    kw.ssfk.kw_nr_max n          number of points; the indices are 0 to n - 1, each exactly once, in any order
    kw.ssfk.bilateral 0|1        0: ``pos`` holds in both directions; 1: ``neg`` while the axis moves down
    kw.ssfk.modulo 0|1           the table repeats: first and last point have the same values; default 0
    kw.ssfk.max_points n         capacity of the kernel; default 1500
    kw.ssfk.manual_activation, kw.ssfk.set_pos_without_comp         not part of the table
    kw.ssfk.table[i].setpoint n
    kw.ssfk.table[i].pos n
    kw.ssfk.table[i].neg n
    lr_param.n_backlash_cyc n    cycles over which a reversal is spread; from the axis parameters, optional

Numbers are whole or, since build V3.1.3132, real. Other keys outside ``kw.ssfk`` belong to other functions.

Sign: values are "absolute position errors", s_ist - s_soll, so they are subtracted. No source states this for
the correction itself; ``error_sense`` reverses it. Units: a list does not say whether its axis is linear, so
unit 1 means mm unless ``file_units`` says degree; a modulo axis requires ``file_units``. Increments become
lengths by ``file_counts_per_unit``, counts per unit of the axis as with all other formats.
"""

import re
from collections.abc import Iterable, Sequence
from itertools import islice, pairwise
from math import inf
from typing import Final

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.tabfile.checks import RULES, check_stated, context_in_file_units, is_closed, unused_options
from gateway.tabfile.decoded import Decoded, Lint, LintSeverity, SourceRow
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.isg_list import CYCLES, MAX_PROBLEMS, IsgEntry, Keys, parse_list, sort_keys
from gateway.tabfile.options import ErrorSense, FileContext, option_hint
from gateway.tabfile.text import SourceText, shown, to_integer
from gateway.tabfile.writing import WriteOptions, Written, unwritable

NAME: Final = "isg"
TITLE: Final = (
    "ISG kernel and Beckhoff TwinCAT CNC compensation list (kw.ssfk), errors in 0.1 µm or increments"
)
USES: Final = frozenset({"file_counts_per_unit", "file_start", "error_sense"})
PER_UNIT: Final = 1e4
"""Numbers of unit 1 in one mm or degree."""
DEFAULT_MAX_POINTS: Final = 1500
MAX_CYCLES: Final = 19
SETPOINT_TOLERANCE: Final = 1e-6
"""A setpoint in a list with an interval may be off by this fraction of it."""
_RECOGNISED: Final = re.compile(r"kw\.[a-z_]\w*[.\[]", re.IGNORECASE | re.ASCII)
_AXIS_NAME: Final = re.compile(r"\"?([a-z])[0-9]?(?:[ _-]?(?:achse|axis))?\"?", re.IGNORECASE)


class _Shape(Struct, frozen=True):
    """The settings of the table."""

    is_metric: bool
    interval: float
    start: float
    size: int
    is_bilateral: bool
    is_modulo: bool


def recognise(source: SourceText) -> bool:
    """Whether a line begins with a key of a compensation list, whatever else the file contains."""
    return any(_RECOGNISED.match(line.text) for line in source.lines)


def read(source: SourceText, context: FileContext) -> Decoded:
    """Read the list; the decisions name the source of the sense and the units.

    Raises:
        TabFileError: a line that is not an entry, an unknown or repeated key, a missing or extra point,
            positions that do not ascend, an open modulo table, increments without a scale, a range that does
            not fit the travel.
    """
    keys = sort_keys(source, parse_list(source))
    shape = _shape(keys)
    units, unit_decision = _units(source, shape, context)
    context = context_in_file_units(source, context, units)
    scale = PER_UNIT if shape.is_metric else _scale(source, context)
    sense = context.error_sense
    rows = _rows(keys, shape, scale, sense or ErrorSense.ACTUAL_MINUS_COMMAND)
    check_stated(source, rows, units, context)
    if shape.is_modulo and not is_closed(rows):
        first, last = rows[0], rows[-1]
        is_forward = first.forward_value != last.forward_value
        raise source.error(
            f"a modulo table with different first and last {'pos' if is_forward else 'neg'} values",
            "the same values at both ends: they are the same position",
            line=last.forward_line if is_forward else last.backward_line,
        )
    forward_rule, backward_rule = _rules(sense, shape)
    unused = ("file_counts_per_unit",) if shape.is_metric else ()
    return Decoded(
        rows,
        units,
        context,
        ("0.0001 degree" if units is Units.DEGREE else "0.1 µm") if shape.is_metric else "increments",
        forward_rule,
        backward_rule,
        comment_axis=_axis(keys.axis_name),
        plausible=(1.0, inf) if shape.is_metric else (0.0, inf),
        decisions=(_sense_decision(sense), unit_decision, *_other_decisions(keys, shape)),
        remarks=(*_remarks(keys), *unused_options(context, NAME, unused)),
        behaves_as=_behaviour(keys, shape, rows),
        modulo=rows[-1].position - rows[0].position if shape.is_modulo else None,
    )


def _shape(keys: Keys) -> _Shape:
    interval = keys.number(keys.setting("interval"))
    if interval < 0:
        allowed = "0 (each point has a setpoint) or a distance above 0"
        raise keys.source.error(f"interval {interval:g}", allowed, line=keys.settings["interval"].line)
    has_start = bool(interval) or "kw_startpos" in keys.settings
    start = keys.number(keys.setting("kw_startpos")) if has_start else 0.0
    size = keys.count("kw_nr_max")
    room = keys.count("max_points", DEFAULT_MAX_POINTS)
    if size > room:
        raise keys.source.error(
            f"kw_nr_max {size}",
            f"at most {room} points ({'max_points' if 'max_points' in keys.settings else 'the default'}); "
            "newer kernels accept more if kw.ssfk.max_points allows it",
            line=keys.settings["kw_nr_max"].line,
        )
    is_metric = keys.flag("unit")
    is_bilateral = keys.flag("bilateral")
    is_modulo = keys.flag("modulo", default=False)
    return _Shape(is_metric, interval, start, size, is_bilateral, is_modulo)


def _units(source: SourceText, shape: _Shape, context: FileContext) -> tuple[Units, str]:
    """Return the units of the rows, and their source."""
    given = context.file_units
    if not shape.is_metric:
        units = given or context.units
        if units is None:
            raise source.error(
                "a list in increments (unit 0) for an axis of unknown units",
                option_hint("file_units"),
            )
        return units, f"units {units.value}: {'from file_units' if given else 'those of the axis'}"
    if given is Units.INCH:
        raise source.error("unit 1 (0.1 µm or 0.0001 degree), but file_units = inch", "'mm' or 'degree'")
    if given is not None:
        return given, f"units {given.value}: from file_units"
    if context.units is Units.DEGREE:
        raise source.error(
            "a list in unit 1 for an axis in degree: unit 1 is 0.0001 degree for a rotary axis, but the "
            "list does not state that its axis is rotary",
            "file_units = 'degree'",
        )
    if shape.is_modulo:
        raise source.error(
            "a modulo list in unit 1, which is 0.0001 degree on a rotary axis and 0.1 µm on a linear one",
            option_hint("file_units", "'degree' or 'mm'"),
        )
    return Units.MM, "units mm: unit 1 is 0.1 µm on a linear axis (0.0001 degree on a rotary one: file_units)"


def _scale(source: SourceText, context: FileContext) -> float:
    scale = context.file_counts_per_unit
    if scale is None or scale < 0:
        found = "file_counts_per_unit is missing" if scale is None else f"file_counts_per_unit = {scale:g}"
        raise source.error(
            f"a list in increments (unit 0), but {found}",
            "file_counts_per_unit = increments of the OLD control's encoder per unit of the axis, above 0",
        )
    return scale


def _rows(keys: Keys, shape: _Shape, scale: float, sense: ErrorSense) -> tuple[SourceRow, ...]:
    fields = ["pos"]
    if shape.is_bilateral:
        fields.append("neg")
    if not shape.interval:
        fields.append("setpoint")
    _check_indices(keys, shape, fields)
    positions = _positions(keys, shape)
    rows = []
    for index in range(shape.size):
        one = keys.points["pos"][index]
        other = keys.points["neg"][index] if shape.is_bilateral else one
        forward, backward = keys.number(one), keys.number(other)
        rows.append(
            SourceRow(
                positions[index] / scale,
                sense.to_correction * forward / scale + 0.0,
                sense.to_correction * backward / scale + 0.0,
                forward,
                backward,
                one.line,
                other.line,
            )
        )
    return tuple(rows)


def _check_indices(keys: Keys, shape: _Shape, fields: Iterable[str]) -> None:
    """Check that each list has every index from 0 to kw_nr_max - 1 once, and no other."""
    size_line = keys.settings["kw_nr_max"].line
    problems: list[FileProblem] = []
    for field in fields:
        missing = shape.size - sum(index < shape.size for index in keys.points[field])
        if missing:
            # A generator, because the size has no limit and only the first few are shown.
            absent = (index for index in range(shape.size) if index not in keys.points[field])
            indices = ", ".join(map(str, islice(absent, 5))) + (", …" if missing > 5 else "")
            problems.append(
                keys.source.problem(
                    f"no table[i].{field} for {missing} of {shape.size} points: i = {indices}",
                    f"all from 0 to {shape.size - 1}, as kw_nr_max on line {size_line} says",
                    line=size_line,
                )
            )
    for entries in keys.points.values():
        beyond = [entry for index, entry in entries.items() if index >= shape.size]
        allowed = f"indices 0 to {shape.size - 1}, as kw_nr_max on line {size_line} says"
        problems.extend(keys.source.problem(entry.key, allowed, line=entry.line) for entry in beyond)
    if not shape.is_bilateral and keys.points["neg"]:
        first = min(keys.points["neg"].values(), key=lambda entry: entry.line)
        problems.append(
            keys.source.problem(
                f"{first.key} with bilateral 0", "bilateral 1, or no neg values", line=first.line
            )
        )
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])


def _positions(keys: Keys, shape: _Shape) -> list[float]:
    """Return the positions in units of the file."""
    entries = keys.points["setpoint"]
    if shape.interval:
        positions = [shape.start + index * shape.interval for index in range(shape.size)]
        for index, entry in sorted(entries.items()):
            if abs(keys.number(entry) - positions[index]) > SETPOINT_TOLERANCE * shape.interval:
                allowed = f"{positions[index]:.10g}, which kw_startpos and interval give, or no setpoint"
                raise keys.source.error(f"{entry.key} {entry.value}", allowed, line=entry.line)
        return positions
    positions = [keys.number(entries[index]) for index in range(shape.size)]
    for index, (before, after) in enumerate(pairwise(positions), start=1):
        if after <= before:
            raise keys.source.error(
                f"setpoint {after:.10g} after {before:.10g}",
                "positions that ascend with the index",
                line=entries[index].line,
                code="L11",
            )
    return positions


def _rules(sense: ErrorSense | None, shape: _Shape) -> tuple[str, str]:
    rule = RULES[sense or ErrorSense.ACTUAL_MINUS_COMMAND]
    if not shape.is_bilateral:
        return (f"{rule}; pos, one value for both directions",) * 2
    return f"{rule}; pos", f"{rule}; neg"


def _sense_decision(sense: ErrorSense | None) -> str:
    if sense is not None:
        return f"sense {sense.value}: as given"
    return (
        "sense actual_minus_command, because the manuals call the values position errors, actual - "
        "commanded: confirm it by one test move; error_sense changes it"
    )


def _axis(name: IsgEntry | None) -> str | None:
    match = _AXIS_NAME.fullmatch(name.value) if name is not None else None
    return match[1].upper() if match else None


def _other_decisions(keys: Keys, shape: _Shape) -> tuple[str, ...]:
    """Report the entries that are not part of the table."""
    decisions = []
    start = keys.settings.get("kw_startpos")
    if start is not None and not shape.interval:
        decisions.append("kw_startpos: not used, interval 0 gives each point its setpoint")
    sections: dict[str, int] = {}
    for entry in keys.others:
        section = re.split(r"[.\[]", entry.key)[0]
        if entry.key != CYCLES and not entry.key.startswith("kw."):
            sections[section] = sections.get(section, 0) + 1
    if sections:
        listed = ", ".join(f"{section} ({count})" for section, count in sections.items())
        decisions.append(f"not part of the table, by section and number of lines: {listed}")
    return tuple(decisions)


def _remarks(keys: Keys) -> tuple[Lint, ...]:
    """Name the other compensations in the list, which are not applied."""
    firsts: dict[str, int] = {}
    for entry in keys.others:
        if entry.key.startswith("kw."):
            firsts.setdefault(".".join(entry.key.split(".", 2)[:2]), entry.line)
    return tuple(
        Lint(
            "R4",
            LintSeverity.WARNING,
            f"check the key {section}, or remove it from this file: it is not of a leadscrew table and was "
            "not used",
            line,
        )
        for section, line in firsts.items()
    )


def _behaviour(keys: Keys, shape: _Shape, rows: Sequence[SourceRow]) -> tuple[str, ...]:
    lines = ['outside = "hold"']
    if shape.is_modulo:
        lines = [f"modulo = {rows[-1].position - rows[0].position:.10g}"]
    if keys.cycles is not None:
        cycles = to_integer(keys.cycles.value)
        if cycles is None or not 0 <= cycles <= MAX_CYCLES:
            allowed = f"a whole number, 0 to {MAX_CYCLES}"
            raise keys.source.error(
                f"n_backlash_cyc {shown(keys.cycles.value)}", allowed, line=keys.cycles.line
            )
        if shape.is_bilateral:
            lines.append(f"reversal = {{ cycles = {cycles} }}" if cycles > 1 else 'reversal = "step"')
    return tuple(lines)


# --- Writing

_DECIMALS: Final = 2
"""0.01 of 0.1 µm is a nanometre."""
_ROUNDING: Final = 0.5 * 10**-_DECIMALS


def write(table: CorrectionTable, options: WriteOptions) -> Written:
    """Write the table in unit 1, or in increments if the scale of the old control is given.

    Numbers are rounded to 0.01 of the unit. Points on an even grid become an interval, others setpoints.

    Raises:
        TabFileError: inches without a scale, a negative scale, points that are equal after rounding.
    """
    scale = options.file_counts_per_unit
    if scale is None and table.units is Units.INCH:
        found = "a table in inch: lengths are in 0.1 µm"
        raise unwritable(NAME, found, "mm (--to-units mm), or increments (--to-counts-per-unit N)")
    if scale is not None and scale < 0:
        raise unwritable(NAME, f"{scale:g} increments per {table.units.value}", "a scale above 0")
    sense = options.sense or ErrorSense.ACTUAL_MINUS_COMMAND
    factor = PER_UNIT if scale is None else scale
    positions = [round(position * factor, _DECIMALS) for position in table.positions]
    if any(after <= before for before, after in pairwise(positions)):
        found = f"points closer than {10**-_DECIMALS:g} of its unit"
        raise unwritable(NAME, found, "points further apart (--resample STEP), or --to-counts-per-unit N")
    lines = _settings(table, positions, is_metric=scale is None)
    if options.is_modulo:
        lines.append(("kw.ssfk.modulo", "1"))
    if options.axis is not None:
        lines.insert(0, ("kopf.log_achs_name", f"{options.axis.upper()}-ACHSE"))
    branches = [("pos", table.forward)]
    if not table.is_unidirectional:
        branches.append(("neg", table.backward))
    for name, curve in branches:
        for index, correction in enumerate(curve):
            error = _text(sense.to_correction * correction * factor)
            lines.append((f"kw.ssfk.table[{index}].{name}", error))
    context = FileContext(
        axis=options.axis,
        units=None,
        file_counts_per_unit=scale,
        file_units=table.units,
        error_sense=sense,
    )
    return Written(
        "".join(f"{key:<35} {value}\n" for key, value in lines), _losses(positions, scale), context
    )


def _settings(
    table: CorrectionTable, positions: Sequence[float], *, is_metric: bool
) -> list[tuple[str, str]]:
    """Return the lines before the values, including those of free positions."""
    size = len(positions)
    interval = round((positions[-1] - positions[0]) / (size - 1), _DECIMALS)
    is_even = interval > 0 and all(
        abs(position - (positions[0] + index * interval)) < _ROUNDING
        for index, position in enumerate(positions)
    )
    lines = [
        ("kw.ssfk.unit", str(int(is_metric))),
        ("kw.ssfk.interval", _text(interval) if is_even else "0"),
        ("kw.ssfk.kw_startpos", _text(positions[0])),
        ("kw.ssfk.kw_nr_max", str(size)),
        ("kw.ssfk.bilateral", str(int(not table.is_unidirectional))),
    ]
    if size > DEFAULT_MAX_POINTS:
        lines.append(("kw.ssfk.max_points", str(size)))
    if not is_even:
        lines.extend(
            (f"kw.ssfk.table[{index}].setpoint", _text(position)) for index, position in enumerate(positions)
        )
    return lines


def _losses(positions: Sequence[float], scale: float | None) -> tuple[str, ...]:
    unit = "0.1 µm (0.0001 degree)" if scale is None else "an increment"
    losses = [
        (
            f"positions and values are rounded to 0.01 of {unit}; kernels before V3.1.3132 accept only whole "
            "numbers"
        )
    ]
    if len(positions) > DEFAULT_MAX_POINTS:
        losses.append(
            f"{len(positions)} points need a kernel with max_points (V3.1.3079.06 or newer); older kernels "
            f"accept {DEFAULT_MAX_POINTS}"
        )
    return tuple(losses)


def _text(number: float) -> str:
    """Return a number without trailing zeros."""
    return f"{round(number, _DECIMALS) + 0.0:.{_DECIMALS}f}".rstrip("0").rstrip(".")
