"""Loads a configuration file: the result is everything that runs from it, or all errors."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gateway.clock import now_utc
from gateway.config.build import build_plan
from gateway.config.checks.axes import check_axes, check_groups, check_terms
from gateway.config.checks.files import (
    TableReading,
    check_open_files,
    check_permissions,
    check_signers,
    check_state,
    read_tables,
)
from gateway.config.checks.lines import (
    check_budget,
    check_drives,
    check_lines,
    check_ports,
    check_status_unit,
    check_ways,
)
from gateway.config.checks.motion import check_late, check_motion, check_references
from gateway.config.checks.rights import check_rights, check_roles, check_tls_files, check_tls_keys
from gateway.config.checks.services import check_alarm_output, check_http, check_http_files, check_mqtt
from gateway.config.crosses import Crosses, read_crosses
from gateway.config.drive_files import NamedProfile, fit_drives
from gateway.config.findings import Document, Findings
from gateway.config.included import check_include, read_configuration
from gateway.config.newer_release import with_newer_release
from gateway.config.problems import ConfigErrors, Problem, in_file_order
from gateway.config.sections import Sections, read_sections
from gateway.config.tables import AxisTable
from gateway.config.toml import KeyLines
from gateway.state.plan import GatewayPlan, TablesFolder


@dataclass(frozen=True, slots=True)
class Loaded:
    """A configuration without errors; see :func:`load` for its tables."""

    path: Path
    plan: GatewayPlan
    tables_folder: Path
    read_from: TablesFolder | None
    """The folder at this path just before the tables were read; None: there was none."""
    state_folder: Path
    tables: Mapping[str, AxisTable]
    """The table of each axis that has one, with its file."""
    readings: Mapping[str, TableReading]
    """The result of reading the table of each axis that names one."""
    warnings: tuple[Problem, ...]
    drives: Mapping[str, NamedProfile]
    """The profile of each axis that names one."""
    document: Document
    """Its content as TOML."""
    sections: Sections
    crosses: Crosses
    """The tables of ``cross``."""


def load(
    path: Path,
    *,
    checks_times: bool = True,
    forgives_tables: bool = False,
    is_start: bool = False,
    is_elsewhere: bool = False,
) -> Loaded:
    """Apply :func:`load_document` to a file.

    Raises:
        ConfigErrors: all errors together.
    """
    return load_document(
        read_configuration(path),
        checks_times=checks_times,
        forgives_tables=forgives_tables,
        is_start=is_start,
        is_elsewhere=is_elsewhere,
    )


def load_document(
    document: Document,
    *,
    checks_times: bool = True,
    forgives_tables: bool = False,
    is_start: bool = False,
    is_elsewhere: bool = False,
) -> Loaded:
    """Read, check and build a configuration with all its tables.

    Without ``checks_times``, limits are not checked against the time budget. With ``forgives_tables``, errors
    in tables stay in their readings only, and their axes have no table. With ``is_start``, this user is about
    to run it, and what the user may not open is an error. With ``is_elsewhere``, it is for another machine:
    files of that machine, such as secrets, are not checked.

    Raises:
        ConfigErrors: all errors together.
    """
    findings = Findings(document)
    try:
        check_include(findings)
        sections, drives = _check_but_tables(findings)
        sections.checks_signatures = not is_elsewhere
        check_signers(findings, sections)
        if not is_elsewhere:
            now = now_utc()
            check_mqtt(findings, sections.mqtt, document.path.parent, now)
            check_http_files(findings, sections.http, document.path.parent, now)
            check_permissions(findings, sections, is_start=is_start)
            check_tls_files(findings, sections, now)
        crosses = read_crosses(findings, sections, document.path.parent / sections.gateway.tables)
        parts = (sections, drives, crosses)
        return _with_tables(findings, parts, checks_times=checks_times, forgives_tables=forgives_tables)
    except ConfigErrors as errors:
        raise with_newer_release(errors, document) from None


def reread_tables(loaded: Loaded) -> Loaded:
    """Return a configuration with its tables read again; errors stay in their readings.

    The configuration file is not read again, nor are the tables of ``cross``, which belong to it.

    Raises:
        ConfigErrors: the state folder can no longer be used.
    """
    findings = Findings(loaded.document)
    parts = (loaded.sections, loaded.drives, loaded.crosses)
    return _with_tables(findings, parts, checks_times=False, forgives_tables=True)


def _with_tables(
    findings: Findings,
    parts: tuple[Sections, Mapping[str, NamedProfile], Crosses],
    *,
    checks_times: bool,
    forgives_tables: bool,
) -> Loaded:
    sections, drives, crosses = parts
    path = findings.document.path
    tables_folder = path.parent / sections.gateway.tables
    read_from = TablesFolder.at(tables_folder)
    readings = read_tables(findings, sections, tables_folder)
    for reading in () if forgives_tables else readings.values():
        findings.include(reading.findings)
    tables = {name: reading.table for name, reading in readings.items() if reading.table is not None}
    check_state(findings, path.parent / sections.gateway.state)
    check_open_files(
        findings, tables_folder, readings, drives, crosses, allowed_signers=sections.allowed_signers
    )
    if checks_times:
        check_budget(findings, sections, tables, drives)
    findings.raise_if_any()
    return Loaded(
        path=path,
        plan=build_plan(sections, tables, drives, crosses),
        tables_folder=tables_folder,
        read_from=read_from,
        state_folder=path.parent / sections.gateway.state,
        tables=tables,
        readings=readings,
        warnings=in_file_order(findings.warnings, str(path)),
        drives=drives,
        document=findings.document,
        sections=sections,
        crosses=crosses,
    )


def problems_of_draft(path: Path, tables: Mapping[str, Any]) -> tuple[Problem, ...]:
    """Return the problems of an unfinished configuration that will be saved at ``path``.

    Its table files are not checked. A missing key is a problem whose ``found`` is "missing".
    """
    findings = Findings(Document(path, tables, KeyLines("")))
    _check_but_tables(findings)
    return in_file_order(findings.problems, str(path))


def _unit_ids(sections: Sections) -> dict[str, set[int]]:
    """Return the unit ids of the axes of each line."""
    found: dict[str, set[int]] = {}
    for axis in sections.axes.values():
        found.setdefault(axis.line, set()).add(axis.unit_id)
    return found


def _check_but_tables(findings: Findings) -> tuple[Sections, Mapping[str, NamedProfile]]:
    sections = read_sections(findings)
    drives = fit_drives(findings, sections, findings.document.path.parent)
    check_ways(findings)
    check_tls_keys(findings)
    check_lines(findings, sections.lines, _unit_ids(sections))
    check_status_unit(findings, sections.status_unit, sections.lines, sections.axes)
    check_http(findings, sections.http, sections.lines)
    check_alarm_output(findings, sections.alarm_output, sections.lines)
    check_axes(findings, sections)
    check_references(findings, sections)
    check_motion(findings, sections)
    check_roles(findings, sections)
    check_rights(findings, sections)
    check_ports(findings, sections)
    check_late(findings, sections)
    check_groups(findings, sections)
    check_terms(findings, sections)
    check_drives(findings, sections, drives)
    return sections, drives
