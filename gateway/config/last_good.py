"""Decides the table of each axis when some files are valid, some invalid and some removed.

An invalid file changes nothing: the table in force stays. Removing a file removes its correction. Axes of a
group get their tables together or not at all.
"""

import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from enum import Enum

from gateway.config import signatures
from gateway.config.checks.files import ROUNDING, TableReading
from gateway.config.load import Loaded
from gateway.config.tables_folder import is_folder_of
from gateway.exchange.limits import without_live_values
from gateway.exchange.plan import AxisPlan
from gateway.state.plan import CompiledPlan, GatewayPlan
from gateway.tabfile import TableState


class TableSource(Enum):
    """Source of an axis's table."""

    FILE = "file"
    """Its valid file."""
    KEPT = "kept"
    """Its file is invalid: what was in force stays, even if that is no table."""
    ABSENT = "absent"
    """Its file was removed, or switched off by its name: no correction."""
    REFUSED = "refused"
    """Its file is invalid and nothing in force can stay; or it is missing, and never existed."""


@dataclass(frozen=True, slots=True)
class Settled:
    """A plan with the table that each axis gets, and its source."""

    plan: GatewayPlan
    sources: Mapping[str, TableSource]
    """Of each axis whose configuration names a table."""
    slips: frozenset[str] = frozenset()
    """Axes whose file is missing and never existed by that name in that folder."""

    @property
    def refused(self) -> tuple[str, ...]:
        """Axes that prevent every change, or the start."""
        return tuple(name for name, source in self.sources.items() if source is TableSource.REFUSED)


def settle(loaded: Loaded, before: CompiledPlan | None, *, waiting: Collection[str] = ()) -> Settled:
    """Return the result of a configuration, given what was in force before.

    ``loaded`` was read with ``forgives_tables``. ``waiting`` are axes whose file is being written, or has
    been gone for a moment only. It does not count yet: what was in force stays if allowed. Only a file that
    was known before, by its name and its folder, may be missing or invalid: a name without a good file is an
    error in the configuration, with which no gateway starts, so that none goes on with it either. A table
    that came into force when no signature was asked for does not stay when one is.
    """
    old = {} if before is None else {axis.name: axis for line in before.plan.lines for axis in line.axes}
    new = {axis.name: axis for line in loaded.plan.lines for axis in line.axes}
    is_same_folder = is_folder_of(loaded, before)
    known = {
        name: old[name]
        for name, reading in loaded.readings.items()
        if is_same_folder and name in old and old[name].table_name.lower() == reading.name.lower()
    }
    keeps = loaded.sections.allowed_signers is None or _asked_for_signatures(before)
    sources, slips = {}, set()
    for name, reading in loaded.readings.items():
        if reading.state is TableState.MISSING and name not in known:
            slips.add(name)
            sources[name] = TableSource.REFUSED
        elif name in waiting:
            sources[name] = _source_of_moving(reading, known.get(name), new[name])
        else:
            sources[name] = _source(reading, known.get(name), new[name])
        if sources[name] is TableSource.KEPT and known[name].table is not None and not keeps:
            sources[name] = TableSource.REFUSED
    for line in loaded.plan.lines:
        for group in line.groups:
            members = {name: sources[name] for name in group if name in sources}
            sources |= _together(members, known, new)
    return Settled(_with_tables(loaded.plan, old, sources), sources, frozenset(slips))


def _asked_for_signatures(before: CompiledPlan | None) -> bool:
    """Whether the tables of a plan came into force with the signatures that its configuration asked for."""
    section = {} if before is None else tomllib.loads(before.configuration).get("gateway", {})
    return signatures.KEY[1] in section


def _source(reading: TableReading, known: AxisPlan | None, new: AxisPlan) -> TableSource:
    """Return the source of the table; ``known`` is the axis before, if it had this file."""
    if reading.table is not None:
        return TableSource.FILE
    if reading.is_absent:
        return TableSource.ABSENT
    return TableSource.KEPT if known is not None and _still_fits(known, new) else TableSource.REFUSED


def _source_of_moving(reading: TableReading, known: AxisPlan | None, new: AxisPlan) -> TableSource:
    """Return the source of the table while its file does not count; ``known`` as above."""
    if known is None:
        return TableSource.ABSENT if reading.is_absent else TableSource.REFUSED
    return TableSource.KEPT if _still_fits(known, new) else TableSource.REFUSED


def _still_fits(old: AxisPlan, new: AxisPlan) -> bool:
    """Whether the table in force fits the new settings."""
    table, settings = old.table, new.settings
    if table is None:
        return True
    is_within = table.max_correction() <= settings.max_correction * (
        1.0 + ROUNDING
    ) and table.max_slope() <= settings.max_slope * (1.0 + ROUNDING)
    return is_within and without_live_values(old).settings == without_live_values(new).settings


def _together(
    sources: Mapping[str, TableSource], known: Mapping[str, AxisPlan], new: Mapping[str, AxisPlan]
) -> dict[str, TableSource]:
    """Return the sources with those of each group made equal."""
    for decides in (TableSource.REFUSED, TableSource.ABSENT, TableSource.KEPT):
        if decides in sources.values():
            break
    else:
        return dict(sources)
    if decides is TableSource.KEPT and not all(
        name in known and _still_fits(known[name], new[name]) for name in sources
    ):
        decides = TableSource.REFUSED
    return dict.fromkeys(sources, decides)


def _with_tables(
    plan: GatewayPlan, old: Mapping[str, AxisPlan], sources: Mapping[str, TableSource]
) -> GatewayPlan:
    def settled(axis: AxisPlan) -> AxisPlan:
        match sources.get(axis.name):
            case TableSource.KEPT:
                was = old[axis.name]
                return replace(
                    axis,
                    table=was.table,
                    table_name=was.table_name,
                    table_format=was.table_format,
                    table_digest=was.table_digest,
                )
            case TableSource.ABSENT | TableSource.REFUSED:
                return replace(axis, table=None, table_format="", table_digest="")
            case _:
                return axis

    lines = (replace(line, axes=tuple(map(settled, line.axes))) for line in plan.lines)
    return replace(plan, lines=tuple(lines))
