"""A configuration file to everything that runs from it, or to everything that is wrong with it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gateway.config.build import build_plan
from gateway.config.check_axes import check_axes
from gateway.config.check_budget import check_budget
from gateway.config.check_drives import check_drives
from gateway.config.check_groups import check_groups
from gateway.config.check_late import check_late
from gateway.config.check_lines import check_lines
from gateway.config.check_motion import check_motion
from gateway.config.check_references import check_references
from gateway.config.check_roles import check_roles
from gateway.config.check_state import check_state
from gateway.config.check_tables import check_tables
from gateway.config.check_ways import check_ways
from gateway.config.document import Document, read_document
from gateway.config.drive_files import NamedProfile, fit_drives
from gateway.config.findings import Findings
from gateway.config.not_built import refuse_what_is_not_built
from gateway.config.problems import Problem, in_file_order
from gateway.config.sections import Sections, read_sections
from gateway.config.tables import AxisTable, read_tables
from gateway.config.toml_lines import key_lines
from gateway.ipc.plan import GatewayPlan


@dataclass(frozen=True, slots=True)
class Loaded:
    """A configuration in which nothing is wrong."""

    path: Path
    plan: GatewayPlan
    tables_folder: Path
    state_folder: Path
    tables: Mapping[str, AxisTable]
    """The table of each axis that has one, with the file it came from."""
    warnings: tuple[Problem, ...]
    drives: Mapping[str, NamedProfile]
    """The profile of each axis that names one."""
    sha256: str
    """Of the configuration file."""


def load(path: Path, *, checks_times: bool = True) -> Loaded:
    """Read, check and build a configuration with all its tables.

    Without ``checks_times`` nothing is said about limits that the arithmetic of time proves wrong.

    Raises:
        ConfigErrors: everything that is wrong with it, at once.
    """
    findings = Findings(read_document(path))
    sections, drives = _check_but_tables(findings)
    tables_folder = path.parent / sections.gateway.tables
    tables = read_tables(findings, sections, tables_folder)
    check_tables(findings, sections.axes, tables)
    check_state(findings, path.parent / sections.gateway.state)
    if checks_times:
        check_budget(findings, sections, tables, drives)
    findings.raise_if_any()
    return Loaded(
        path=path,
        plan=build_plan(sections, tables, drives),
        tables_folder=tables_folder,
        state_folder=path.parent / sections.gateway.state,
        tables=tables,
        warnings=in_file_order(findings.warnings, str(path)),
        drives=drives,
        sha256=findings.document.sha256,
    )


def problems_of_draft(path: Path, tables: Mapping[str, Any]) -> tuple[Problem, ...]:
    """Return what is wrong with a configuration that is still being made and will stand at ``path``.

    Its table files are not looked at. What is missing so far is a problem whose ``found`` is "missing".
    """
    findings = Findings(Document(path, tables, key_lines("")))
    _check_but_tables(findings)
    return in_file_order(findings.problems, str(path))


def _check_but_tables(findings: Findings) -> tuple[Sections, Mapping[str, NamedProfile]]:
    sections = read_sections(findings)
    drives = fit_drives(findings, sections, findings.document.path.parent)
    refuse_what_is_not_built(findings)
    check_ways(findings)
    check_lines(findings, sections.lines)
    check_axes(findings, sections)
    check_references(findings, sections)
    check_motion(findings, sections)
    check_roles(findings, sections)
    check_late(findings, sections)
    check_groups(findings, sections)
    check_drives(findings, sections, drives)
    return sections, drives
