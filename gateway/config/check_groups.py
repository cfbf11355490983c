"""Whether the axes of a group can be corrected together, or not at all."""

from collections.abc import Mapping
from typing import Any

from gateway.config.axis_model import AxisSection, GroupSection
from gateway.config.explain import suggest
from gateway.config.findings import Findings
from gateway.config.sections import Sections
from gateway.config.toml_lines import KeyPath


def check_groups(findings: Findings, sections: Sections) -> None:
    """Check every group: its axes for themselves, against each other and against other groups."""
    tables = findings.document.tables.get("axis", {})
    names: Mapping[str, Any] = tables if isinstance(tables, dict) else {}
    group_of: dict[str, str] = {}
    for name, group in sections.groups.items():
        path = ("group", name, "axes")
        _check_names(findings, path, group, names)
        _check_once(findings, path, group, group_of)
        members = {axis: sections.axes[axis] for axis in group.axes if axis in sections.axes}
        _check_alike(findings, path, members)
        group_of |= {axis: name for axis in group.axes if axis not in group_of}


def _check_names(findings: Findings, path: KeyPath, group: GroupSection, names: Mapping[str, Any]) -> None:
    for index, axis in enumerate(group.axes):
        if axis not in names:
            findings.refuse(
                (*path, index), f"there is no [axis.{axis}]", suggest(axis, list(names) or ["[axis.NAME]"])
            )


def _check_once(findings: Findings, path: KeyPath, group: GroupSection, group_of: Mapping[str, str]) -> None:
    for index, axis in enumerate(group.axes):
        if axis in group_of:
            found = f"{axis} is in [group.{group_of[axis]}] already"
            findings.refuse((*path, index), found, "an axis belongs to one group")
        if axis in group.axes[:index]:
            findings.refuse((*path, index), f"{axis} stands here twice", "name each axis once")


def _check_alike(findings: Findings, path: KeyPath, members: Mapping[str, AxisSection]) -> None:
    """What holds for one axis of a group holds for all of them."""
    lines = {name: f'line = "{axis.line}"' for name, axis in members.items()}
    _check_same(findings, path, lines, "put the axes of a group on one line")
    modes = {name: f'compensation = "{axis.compensation.value}"' for name, axis in members.items()}
    _check_same(findings, path, modes, "write the same for all of them")
    tables = {name: _corrected_by(axis) for name, axis in members.items()}
    _check_same(findings, path, tables, "give each of them its table, or none")


def _corrected_by(axis: AxisSection) -> str:
    if axis.table is not None:
        return "a table"
    return "no table" if axis.backlash is None else "a backlash and no table"


def _check_same(findings: Findings, path: KeyPath, values: Mapping[str, str], remedy: str) -> None:
    if len(set(values.values())) > 1:
        found = ", ".join(f"{name} has {value}" for name, value in values.items())
        findings.refuse(path, found, f"{remedy}: they are corrected together or not at all")
