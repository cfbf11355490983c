"""From the name of a table in the configuration to the table: the only reader of table files."""

from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.config import signatures
from gateway.config.axis_model import AxisSection
from gateway.config.findings import Findings
from gateway.config.problems import Problem, key_text
from gateway.config.settings_of import settings_of
from gateway.config.toml import KeyPath
from gateway.tabfile import (
    DIALECTS,
    KEEP_ONE,
    FileContext,
    FoundTable,
    LintSeverity,
    LoadedTable,
    TabFileError,
    TableState,
    WriteOptions,
    find_table,
    parse_table,
    read_bytes,
)

COVERAGE_LINT: Final = "L8"
"""Reported here instead: only the configuration has the policy for positions outside the table."""


OLD_NAME_LINT: Final = "R14"
"""A warning here, although a table is also read under an old name: a configuration is kept for years."""


LOST_MOTION_LINT: Final = "R8"
"""No longer reported when the axis has its own backlash."""


@dataclass(frozen=True, slots=True)
class AxisTable:
    """The table of one axis, in the units of the axis, with its file."""

    table: CorrectionTable
    source: LoadedTable
    path: Path
    signer: str = ""
    """Who signed it; "" if no signature is asked for."""


def find_file(findings: Findings, key: KeyPath, folder: Path, name: str) -> FoundTable | None:
    """Return the path of a table file, or that it is missing; None if unknown.

    What prevents reading goes to ``findings``; a file that was switched off is a warning.
    """
    if not name or "\0" in name or Path(name).name != name:
        findings.refuse(
            key, f'found "{name}"', "allowed: the name of a file in the tables folder, without a path"
        )
        return None
    try:
        found = find_table(folder, name)
    except TabFileError as error:
        remedy = "put the tables there, or correct [gateway] tables: it is relative to the configuration file"
        if error.allowed == KEEP_ONE:
            remedy = f"allowed: {KEEP_ONE}"
        findings.refuse(key, f"{error.file}: {error.found}", remedy)
        return None
    if found.state is TableState.OFF:
        what = f"{name} was renamed to {found.path.name}: the axis is not corrected"
        findings.warn(key, what, "rename it back to correct it again")
    elif found.state is TableState.MISSING:
        findings.refuse(key, f"there is no {name} in {folder}", _near(folder, name))
    return found


def _near(folder: Path, name: str) -> str:
    names = {path.name.lower(): path.name for path in folder.iterdir()}
    near = get_close_matches(name.lower(), names, n=3, cutoff=0.5)
    if near:
        return f"did you mean {' or '.join(names[n] for n in near)}?"
    suffixes = {dialect.suffix.lower() for dialect in DIALECTS}
    tables = sorted(shown for low, shown in names.items() if Path(low).suffix in suffixes)
    return f"it holds {', '.join(tables[:10])}" if tables else "put the table file there"


def read_file(
    findings: Findings, key: KeyPath, path: Path, axis: AxisSection, name: str, *, allowed: Path | None
) -> AxisTable | None:
    """Return the table of an axis, and problems of the file to ``findings``; see :func:`table_in`."""
    is_taken_up = axis.backlash is not None
    found = table_in(
        findings, key, path, context_of(axis, name), allowed=allowed, lost_motion_is_taken_up=is_taken_up
    )
    if found is None:
        return None
    loaded, signer = found
    return AxisTable(loaded.table.in_units(axis.units), loaded, path, signer)


def table_in(
    findings: Findings,
    key: KeyPath,
    path: Path,
    context: FileContext,
    *,
    allowed: Path | None,
    lost_motion_is_taken_up: bool,
) -> tuple[LoadedTable, str] | None:
    """Return the content of a file and who signed it; problems go to ``findings``. None if it does not count.

    Every table in force comes from here. ``allowed`` is the file of those who may sign; None: nobody has to.
    The bytes that are checked are those that are read.
    """
    if allowed is not None and findings.is_refused(signatures.KEY):
        return None  # no signature can be checked, and that is said
    try:
        content = read_bytes(path)
        signer = "" if allowed is None else signatures.signer_of(path, content, allowed)
        loaded = parse_table(content, str(path), context)
    except signatures.SignatureRefusedError as error:
        findings.refuse_elsewhere(key, Problem(str(path), key_text(key), error.found, error.remedy))
        return None
    except TabFileError as error:
        for problem in error.problems:
            code = f"{problem.code} " if problem.code else ""
            found = "; ".join((f"{code}{problem.found}", *_numbered(problem.readings)))
            remedy = f"allowed: {problem.allowed}" if problem.allowed else ""
            located = Problem(str(path), key_text(key), found, remedy, problem.line)
            findings.refuse_elsewhere(key, located)
        return None
    for lint in loaded.lints:
        remark = Problem(str(path), key_text(key), f"{lint.code} {lint.message}", "", lint.line)
        if lint.severity is LintSeverity.ERROR:
            findings.refuse_elsewhere(key, remark)
        elif lint.code == LOST_MOTION_LINT:
            if not lost_motion_is_taken_up:
                findings.warnings.append(replace(remark, remedy=_backlash_of(loaded)))
        elif lint.code == OLD_NAME_LINT or (
            lint.severity is LintSeverity.WARNING and lint.code != COVERAGE_LINT
        ):
            findings.warnings.append(remark)
    return loaded, signer


def _backlash_of(loaded: LoadedTable) -> str:
    """Return what to do about lost motion that a file states beside its table."""
    lines = [line for line in loaded.source.behaves_as if line.startswith("backlash")]
    return f"if nothing else corrects it now, add to the axis: {'; '.join(lines)}"


def _numbered(readings: tuple[str, ...]) -> list[str]:
    return [f"reading {number}: {text}" for number, text in enumerate(readings, start=1)]


def write_options_of(axis: AxisSection, name: str, format_name: str) -> WriteOptions:
    """Return the options for writing a table of the axis, so that its configuration reads the same table."""
    options = axis.table_options.options().under_new_names(format_name)
    return WriteOptions(
        axis=_letter(name),
        file_counts_per_unit=options.file_counts_per_unit,
        v1_layout=options.v1_layout,
        file_axis=options.file_axis,
        sense=options.error_sense,
        is_modulo=axis.modulo is not None,
    )


def _letter(name: str) -> str | None:
    return name.upper() if len(name) == 1 and name.isalpha() else None


def context_of(axis: AxisSection, name: str) -> FileContext:
    """Return what the configuration knows about a table file and the file itself does not state."""
    settings = settings_of(axis)
    return FileContext(
        **axis.table_options.options().given(),
        axis=_letter(name),
        units=axis.units,
        travel=None if axis.modulo else axis.travel,
        counts_per_unit=axis.counts_per_unit / settings.step_counts,  # what the drive can report
        max_correction=settings.max_correction,
        max_slope=axis.max_slope,
    )
