"""Files: tables, the state folder, and who may write to them."""

import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.compensation.backlash import no_correction, with_backlash
from gateway.compensation.correction_spec import reversal_in_force, spec_of_table
from gateway.compensation.curve import check_closes
from gateway.compensation.errors import CompensationError, TableError
from gateway.compensation.settings import AxisSettings, OutsideKind, ReversalKind, Setpoints
from gateway.compensation.table import CorrectionTable
from gateway.config import signatures
from gateway.config.axis_model import AxisSection
from gateway.config.checks.lines import controller_key, drives_key
from gateway.config.crosses import Crosses
from gateway.config.drive_files import NamedProfile
from gateway.config.findings import Findings
from gateway.config.problems import Problem, in_file_order
from gateway.config.sections import Sections
from gateway.config.settings_of import settings_of
from gateway.config.tables import AxisTable, find_file, read_file
from gateway.config.toml import KeyPath
from gateway.ipc.address import ROOT_UID, why_too_long
from gateway.state.folder import why_no_folder, why_open_to_others
from gateway.state.include import INCLUDE
from gateway.tabfile import TableState
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.permissions import why_no_device, why_no_port


@dataclass(frozen=True, slots=True)
class TableReading:
    """The table of one axis, as far as it could be read, and all problems found."""

    axis: str
    name: str
    """File name from the configuration."""
    path: Path
    """Where the file is, or would be."""
    state: TableState | None
    """Whether the file exists; None if unknown, as in a folder that cannot be read."""
    table: AxisTable | None
    """None if the file is missing or anything is wrong with it."""
    findings: Findings

    @property
    def problems(self) -> Sequence[Problem]:
        """What is wrong with it."""
        return in_file_order(self.findings.problems, str(self.findings.document.path))

    @property
    def is_absent(self) -> bool:
        """Whether the file certainly does not exist: removed, or switched off by its name."""
        return self.state in {TableState.MISSING, TableState.OFF}


# --- The table of an axis against its other keys

ROUNDING = 1e-9
"""Tolerance for decimal fractions and conversions, as a share of the limit."""


def check_table(findings: Findings, name: str, axis: AxisSection, found: AxisTable) -> None:
    """Check an axis against its table."""
    path = ("axis", name)
    settings = settings_of(axis)
    table = _check_backlash(findings, path, settings, found.table)
    _check_revolution(findings, path, settings, table)
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
            "remove it: lost motion is the same everywhere",
        )
    table = _check_backlash(findings, path, settings, no_correction(settings))
    _check_reversal(findings, path, settings, table)
    _check_direction(findings, path, axis, table)


def _check_backlash(
    findings: Findings, path: KeyPath, settings: AxisSettings, table: CorrectionTable
) -> CorrectionTable:
    """Return the table with its backlash, as it will be in force."""
    if settings.backlash is None:
        return table
    if not table.is_unidirectional:
        findings.refuse(
            (*path, "backlash"),
            "backlash with a table of two directions",
            "remove it: the difference of the two columns is the backlash",
        )
        return table
    what = "table and backlash together correct" if table.max_correction() else "backlash corrects"
    table = with_backlash(table, settings.backlash)
    if table.max_correction() > settings.max_correction * (1 + ROUNDING):
        findings.refuse(
            (*path, "backlash", "width"),
            f"{what} by {table.max_correction():.6g} {settings.units.value}, "
            f"more than max_correction = {settings.max_correction:.6g}",
            "check the unit of width; raise max_correction only if the screw is really so bad",
        )
    return table


def _branches(table: CorrectionTable) -> tuple[tuple[str, list[float]], ...]:
    return ("forward", list(table.forward)), ("backward", list(table.backward))


def _check_revolution(
    findings: Findings, path: KeyPath, settings: AxisSettings, table: CorrectionTable
) -> None:
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
    """Check that a table of one turn is used as one, if the axis can leave the first turn."""
    source = found.source
    if source.source.modulo is None or settings.modulo:
        return
    revolution = source.source.modulo * source.table.units.convert_factor(settings.units)
    if settings.travel is not None and settings.travel[1] - settings.travel[0] <= revolution * (1 + ROUNDING):
        return
    findings.warn(
        (*path, "table"),
        f"on the control of {found.path.name} the table repeats after {revolution:.10g} "
        f"{settings.units.value}; here it does not: outside the table "
        f"{_OUTSIDE_WORDS[settings.outside.kind]}",
        f"add to the axis: modulo = {revolution:.10g}",
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
            "allowed: a small part of it, otherwise the direction never changes",
        )
        return
    step = min(high - low for low, high in zip(table.positions, list(table.positions)[1:], strict=False))
    if axis.hysteresis is not None and settings.hysteresis > step:
        findings.warn(
            key,
            f"{what} is longer than the shortest interval of the table ({step:g} {unit})",
            "a shorter reversal keeps its branch"
            if axis.setpoints is Setpoints.STREAM
            else "measured positions within this distance count as the same position",
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
            f"a blend over {asked.amount:g} {settings.units.value} would reverse the axis",
            f"the gateway uses a blend of {in_force.amount:.6g} {settings.units.value}",
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
    """Report everything else that the compensation refuses.

    A known problem of the axis already explains it.
    """
    if findings.is_refused(path):
        return
    try:
        spec_of_table(table, settings)
    except CompensationError as error:
        findings.refuse((*path, "table"), str(error), "change the table or the settings of the axis")


# --- Write access of others to the files that decide positions: configuration, tables and profiles


def check_open_files(
    findings: Findings,
    tables_folder: Path,
    readings: Mapping[str, TableReading],
    drives: Mapping[str, NamedProfile],
    crosses: Crosses,
    *,
    allowed_signers: Path | None,
) -> None:
    """Warn of each file that every user may write to, and of each folder where every user may replace one."""
    config = findings.document.path
    found: dict[Path, KeyPath] = {config.parent: (), config: (), tables_folder: ("gateway", "tables")}
    for part in findings.document.parts:
        found |= {path: found.get(path, (INCLUDE,)) for path in (part.path.parent, part.path)}
    if allowed_signers is not None:
        found[allowed_signers] = signatures.KEY
    for path, key in _named(config, readings, drives, crosses):
        found.setdefault(path, key)
    for path, key in found.items():
        warning = None if _is_sticky_folder(path) else why_open_to_others(path, None)
        if warning is not None:
            findings.warn(key, warning.found, warning.remedy)


def _named(
    config: Path,
    readings: Mapping[str, TableReading],
    drives: Mapping[str, NamedProfile],
    crosses: Crosses,
) -> Iterator[tuple[Path, KeyPath]]:
    for axis, reading in readings.items():
        yield reading.path, ("axis", axis, "table")
    for axis, each in crosses.items():
        for index, cross in enumerate(each):
            yield cross.path, ("axis", axis, "cross", index, "table")
    for axis, drive in drives.items():
        if not drive.is_shipped:
            yield config.parent / drive.name, ("axis", axis, "drive")


def _is_sticky_folder(path: Path) -> bool:
    """Whether it is a folder like /tmp, in which a user may not replace or remove files of another user."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return True
    return stat.S_ISDIR(mode) and bool(mode & stat.S_ISVTX)


# --- Who may sign tables


def check_signers(findings: Findings, sections: Sections) -> None:
    """Refuse a file of allowed signers with which no table can be checked."""
    allowed = sections.allowed_signers
    if allowed is None:
        return
    try:
        signatures.check_tools(allowed)
    except signatures.SignatureRefusedError as error:
        findings.refuse(signatures.KEY, error.found, error.remedy)


# --- What the user may not open: ports below 1024, and serial ports of a group without the user


def check_permissions(findings: Findings, sections: Sections, *, is_start: bool) -> None:
    """Refuse what this user may not open at a start; only warn at a check.

    Root often checks what another user will run, so root gets no warning.
    """
    if not is_start and os.geteuid() == ROOT_UID:
        return
    report = findings.refuse if is_start else findings.warn
    for key, endpoint in _opened(findings, sections):
        why = why_no_device(endpoint) if isinstance(endpoint, SerialEndpoint) else why_no_port(endpoint)
        if why is not None and not findings.is_refused(key):
            report(key, *why)


def _opened(findings: Findings, sections: Sections) -> Iterator[tuple[KeyPath, TcpEndpoint | SerialEndpoint]]:
    for name, line in sections.lines.items():
        if isinstance(line.drives.endpoint, SerialEndpoint):
            yield drives_key(name, line), line.drives.endpoint
        for index, controller in enumerate(line.controllers):
            key = (*controller_key(findings, name, controller.name, index), controller.way)
            yield key, controller.endpoint
    if sections.http.endpoint is not None:
        yield ("http", "listen"), sections.http.endpoint


# --- The state folder and the socket in it

KEY: Final = ("gateway", "state")


def check_state(findings: Findings, folder: Path) -> None:
    """Refuse a folder with which no gateway can start; warn of one that others may write to."""
    if findings.is_refused(KEY):
        return
    problem = why_too_long(folder) or why_no_folder(folder)
    if problem is not None:
        findings.refuse(KEY, problem.found, problem.remedy)
        return
    # Root often checks what another user will run, and that user owns the folder.
    uid = os.geteuid()
    warning = why_open_to_others(folder, None if uid == ROOT_UID else frozenset((uid, ROOT_UID)))
    if warning is not None:
        findings.warn(KEY, warning.found, warning.remedy)


def read_tables(findings: Findings, sections: Sections, folder: Path) -> dict[str, TableReading]:
    """Read and check the table of every axis that names one.

    Problems stay with each reading; ``Findings.include`` takes them over. So a bad file of one axis does not
    keep the others from their tables.
    """
    return {
        name: _reading(findings.part(), sections, folder, name, axis)
        for name, axis in (sections.axes | sections.partial_axes).items()
        if axis.table is not None
    }


def _reading(part: Findings, sections: Sections, folder: Path, name: str, axis: AxisSection) -> TableReading:
    assert axis.table is not None, "only axes that name a table have a reading"
    key = ("axis", name, "table")
    found = find_file(part, key, folder, axis.table)
    path = folder / axis.table if found is None else found.path
    table: AxisTable | None = None
    # Without scale and units the table cannot be interpreted, but its presence is known.
    if found is not None and found.state is TableState.PRESENT and name not in sections.partial_axes:
        table = read_file(part, key, path, axis, name, allowed=sections.allowed_signers)
    if table is not None:
        check_table(part, name, axis, table)
    is_good = not part.problems
    return TableReading(
        name, axis.table, path, None if found is None else found.state, table if is_good else None, part
    )
