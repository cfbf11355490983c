"""Whether the table of an axis goes with the other keys of the axis."""

from gateway.compensation.backlash import no_correction, with_backlash
from gateway.compensation.correction_spec import reversal_in_force, spec_of_table
from gateway.compensation.curve import check_closes
from gateway.compensation.errors import CompensationError, TableError
from gateway.compensation.settings import AxisSettings, OutsideKind, ReversalKind, Setpoints
from gateway.compensation.table import CorrectionTable
from gateway.config.axis_model import AxisSection
from gateway.config.findings import Findings
from gateway.config.settings_of import settings_of
from gateway.config.tables import AxisTable
from gateway.config.toml_lines import KeyPath

ROUNDING = 1e-9
"""Share of a limit by which decimal fractions and conversions may exceed it."""


def check_table(findings: Findings, name: str, axis: AxisSection, found: AxisTable) -> None:
    """Check an axis against its table."""
    path = ("axis", name)
    settings = settings_of(axis)
    table = _check_backlash(findings, path, settings, found.table)
    _check_turn(findings, path, settings, table)
    _check_that_it_repeats(findings, path, settings, found)
    _check_outside(findings, path, settings, table)
    _check_hysteresis(findings, path, axis, settings, table)
    _check_reversal(findings, path, settings, table)
    _check_direction(findings, path, axis, table)
    _check_coverage(findings, path, settings, table)
    _check_the_rest(findings, path, settings, found.table)


def check_backlash_alone(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    """Check an axis that has a backlash and no table."""
    settings = settings_of(axis)
    if settings.outside.kind is not OutsideKind.HOLD and not settings.modulo:
        findings.refuse(
            (*path, "outside"),
            f"outside = {settings.outside.kind.value} with a backlash and no table",
            "leave it out: lost motion is the same everywhere",
        )
    table = _check_backlash(findings, path, settings, no_correction(settings))
    _check_reversal(findings, path, settings, table)
    _check_direction(findings, path, axis, table)


def _check_backlash(
    findings: Findings, path: KeyPath, settings: AxisSettings, table: CorrectionTable
) -> CorrectionTable:
    """Return the table that will be in force, with its backlash."""
    if settings.backlash is None:
        return table
    if not table.is_unidirectional:
        findings.refuse(
            (*path, "backlash"),
            "backlash with a table of two directions",
            "leave it out: the difference of the two columns is the backlash",
        )
        return table
    what = "table and backlash together correct" if table.max_correction() else "backlash corrects"
    table = with_backlash(table, settings.backlash)
    if table.max_correction() > settings.max_correction * (1 + ROUNDING):
        findings.refuse(
            (*path, "backlash", "width"),
            f"{what} by {table.max_correction():.6g} {settings.units.value}, "
            f"more than max_correction = {settings.max_correction:.6g}",
            "check the unit of width; raise max_correction only if the screw is really that bad",
        )
    return table


def _branches(table: CorrectionTable) -> tuple[tuple[str, list[float]], ...]:
    return ("forward", list(table.forward)), ("backward", list(table.backward))


def _check_turn(findings: Findings, path: KeyPath, settings: AxisSettings, table: CorrectionTable) -> None:
    if not settings.modulo:
        return
    try:
        check_closes(table, settings.modulo)
    except TableError as error:
        findings.refuse(
            (*path, "modulo"), str(error), "allowed: a table that covers exactly one turn with equal ends"
        )


def _check_that_it_repeats(
    findings: Findings, path: KeyPath, settings: AxisSettings, found: AxisTable
) -> None:
    """Whether a table that begins again after a turn does so here, where the axis can leave the first one."""
    source = found.source
    if source.source.modulo is None or settings.modulo:
        return
    turn = source.source.modulo * source.table.units.convert_factor(settings.units)
    if settings.travel is not None and settings.travel[1] - settings.travel[0] <= turn * (1 + ROUNDING):
        return
    findings.warn(
        (*path, "table"),
        f"on the control of {found.path.name} the table begins again after {turn:.10g} "
        f"{settings.units.value}; here it does not: outside it {_OUTSIDE_WORDS[settings.outside.kind]}",
        f"add to the axis: modulo = {turn:.10g}",
    )


def _check_outside(findings: Findings, path: KeyPath, settings: AxisSettings, table: CorrectionTable) -> None:
    ends = [abs(curve[i]) for _, curve in _branches(table) for i in (0, -1)]
    largest = max(ends)
    unit = settings.units.value
    step = "count" if settings.step_counts == 1.0 else "step of the registers"
    if settings.outside.kind is OutsideKind.ZERO and largest > settings.step * (1 + ROUNDING):
        findings.refuse(
            (*path, "outside"),
            f'outside = "zero" where the table ends with a correction of {largest:.6g} {unit}',
            f"allowed: ends within one {step} ({settings.step:.6g} {unit}) of 0; "
            f'use "hold", or {{ fade = {largest / settings.max_slope:.6g} }} or longer: the correction goes '
            "to 0 over that length and is off beyond it",
        )
    length = settings.outside.fade_length
    if settings.outside.kind is OutsideKind.FADE and largest / length > settings.max_slope * (1 + ROUNDING):
        findings.refuse(
            (*path, "outside"),
            f"a correction of {largest:.6g} {unit} at the end fades over {length:g}, steeper than max_slope",
            f"allowed: a fade of {largest / settings.max_slope:.6g} {unit} or more",
        )


def _check_hysteresis(
    findings: Findings, path: KeyPath, axis: AxisSection, settings: AxisSettings, table: CorrectionTable
) -> None:
    key = (*path, "hysteresis")
    unit = settings.units.value
    what = f"hysteresis = {settings.hysteresis:g} {unit}"
    if settings.hysteresis >= table.last - table.first:
        findings.refuse(
            key,
            f"{what} is longer than the whole table ({table.last - table.first:g} {unit})",
            "allowed: a small part of it, else the direction never changes",
        )
        return
    step = min(high - low for low, high in zip(table.positions, list(table.positions)[1:], strict=False))
    if axis.hysteresis is not None and settings.hysteresis > step:
        findings.warn(
            key,
            f"{what} is longer than the shortest interval of the table ({step:g} {unit})",
            "a reversal shorter than that keeps the branch it came on"
            if axis.setpoints is Setpoints.STREAM
            else "a measured position as far away as that still counts as the same place",
        )


def _check_reversal(
    findings: Findings, path: KeyPath, settings: AxisSettings, table: CorrectionTable
) -> None:
    asked = settings.reversal
    if settings.setpoints is not Setpoints.STREAM or asked is None or asked.kind is not ReversalKind.DISTANCE:
        return
    in_force = reversal_in_force(table, settings, settings.gain)
    if in_force.amount > asked.amount:
        findings.warn(
            (*path, "reversal"),
            f"a blend over {asked.amount:g} {settings.units.value} would turn the axis round",
            f"it is made {in_force.amount:.6g} {settings.units.value} long",
        )


def _check_direction(findings: Findings, path: KeyPath, axis: AxisSection, table: CorrectionTable) -> None:
    registers = axis.registers
    if axis.setpoints is not Setpoints.TARGETS or table.is_unidirectional or registers is None:
        return
    if not registers.actual and registers.bits.done is None:
        findings.warn(
            (*path, "registers"),
            "neither actual nor bits.done is mapped: the direction of a move follows the order of the "
            "targets and is flagged unsure",
            "map one of them: a target that comes during a move may take the wrong branch",
        )


_OUTSIDE_WORDS = {
    OutsideKind.HOLD: "the correction of the end holds",
    OutsideKind.FADE: "the correction fades to 0",
    OutsideKind.ZERO: "nothing is corrected",
    OutsideKind.REFUSE: "targets are refused",
}


def _check_coverage(
    findings: Findings, path: KeyPath, settings: AxisSettings, table: CorrectionTable
) -> None:
    if settings.travel is None or settings.modulo:
        return
    low, high = settings.travel
    slack = ROUNDING * (high - low)
    stretches = []
    if low < table.first - slack:
        stretches.append(f"{low:g} to {min(table.first, high):g}")
    if high > table.last + slack:
        stretches.append(f"{max(table.last, low):g} to {high:g}")
    if stretches:
        findings.warn(
            (*path, "table"),
            f"L8 the table does not cover travel from {' and from '.join(stretches)} {settings.units.value}",
            f'outside = "{settings.outside.kind.value}": {_OUTSIDE_WORDS[settings.outside.kind]} there',
        )


def _check_the_rest(
    findings: Findings, path: KeyPath, settings: AxisSettings, table: CorrectionTable
) -> None:
    """Whatever else the compensation will not take; a known problem of the axis explains it already."""
    if findings.is_refused(path):
        return
    try:
        spec_of_table(table, settings)
    except CompensationError as error:
        findings.refuse((*path, "table"), str(error), "change the table or the settings of the axis")
