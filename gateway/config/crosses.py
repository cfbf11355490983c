"""The tables of ``cross``: read once, together with the configuration, as a part of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gateway.compensation.curve import Curve
from gateway.compensation.errors import TableError
from gateway.config.axis_model import AxisSection
from gateway.config.findings import Findings
from gateway.config.sections import Sections
from gateway.config.settings_of import settings_of
from gateway.config.tables import find_file, table_in
from gateway.config.terms_model import CrossSpec
from gateway.config.toml import KeyPath
from gateway.exchange.plan import CrossPlan
from gateway.tabfile import FileContext, TableState

MOST_POINTS = 2000
"""Limit of the points, because they are stored in the plan."""


@dataclass(frozen=True, slots=True)
class CrossTable:
    """One table of ``cross``, and its file."""

    plan: CrossPlan
    path: Path


Crosses = Mapping[str, tuple[CrossTable, ...]]
"""By the axis that they correct."""


def read_crosses(findings: Findings, sections: Sections, folder: Path) -> Crosses:
    """Read the tables of ``cross`` of every axis; problems go to ``findings``."""
    found: dict[str, tuple[CrossTable, ...]] = {}
    for name, axis in sections.axes.items():
        tables = [
            _read(
                findings,
                ("axis", name, "cross", index, "table"),
                folder,
                axis,
                (cross, partner),
                allowed=sections.allowed_signers,
            )
            for index, cross in enumerate(axis.cross)
            if (partner := sections.axes.get(cross.axis)) is not None
        ]
        found[name] = tuple(table for table in tables if table is not None)
    return found


def _read(
    findings: Findings,
    key: KeyPath,
    folder: Path,
    axis: AxisSection,
    pair: tuple[CrossSpec, AxisSection],
    *,
    allowed: Path | None,
) -> CrossTable | None:
    cross, partner = pair
    found = find_file(findings, key, folder, cross.table)
    if found is None or found.state is TableState.MISSING:
        return None
    if found.state is TableState.OFF:
        findings.refuse(
            key, f"{cross.table} was renamed to {found.path.name}", "rename it back, or remove cross"
        )
        return None
    try:
        scale = partner.units.convert_factor(axis.units)
    except ValueError:
        return None  # refused already
    travel = partner.travel
    if travel is not None:
        travel = None if partner.modulo else (travel[0] * scale, travel[1] * scale)
    context = FileContext(
        units=axis.units,
        travel=travel,
        max_correction=settings_of(axis).max_correction,
        max_slope=axis.max_slope,
    )
    counts = table_in(findings, key, found.path, context, allowed=allowed, lost_motion_is_taken_up=True)
    if counts is None:
        return None
    read, _ = counts
    table = read.table.in_units(axis.units)
    modulo = (partner.modulo or 0.0) * scale
    if not table.is_unidirectional:
        findings.refuse(key, f"{cross.table} has two directions", "allowed: one column, or two equal ones")
        return None
    if len(table.positions) > MOST_POINTS:
        findings.refuse(key, f"{len(table.positions)} points", f"allowed: {MOST_POINTS} or less")
        return None
    try:
        Curve(table, modulo=modulo)
    except TableError as error:
        findings.refuse(key, str(error), f"axis.{cross.axis} has a modulo: its table is one whole turn")
        return None
    plan = CrossPlan(
        cross.axis,
        tuple(table.positions),
        tuple(table.forward),
        scale,
        modulo,
        cross.fresh_s,
        found.path.name,
        read.sha256,
    )
    return CrossTable(plan, found.path)
