"""Whether the rights of a controller say something, and leave no half of a position to be written."""

from typing import Final

from gateway.config.axis_model import AxisSection, Writers
from gateway.config.check_lines import controller_key
from gateway.config.findings import Findings
from gateway.config.line_model import ControllerSection, LineSection
from gateway.config.rights_model import RightsKeys
from gateway.config.sections import Sections
from gateway.config.toml_lines import KeyPath
from gateway.exchange.access import MONITOR_FUNCTIONS
from gateway.exchange.plan import Role
from gateway.modbus.pdu import BROADCAST_UNIT_ID, FunctionCode

LISTS: Final = ("unit_ids", "function_codes", "readable", "writable")
WRITING: Final = frozenset({0x05, 0x06, 0x0F, 0x10, 0x16, 0x17, 0x2B})
"""Function codes that can carry a position or a trigger."""
READING: Final = MONITOR_FUNCTIONS | {FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT}

Axes = dict[str, AxisSection]


def check_rights(findings: Findings, sections: Sections) -> None:
    """Check the rights of every controller against its role, and against the axes of its line."""
    for name, line in sections.lines.items():
        axes = {axis: section for axis, section in sections.axes.items() if section.line == name}
        for index, controller in enumerate(line.controllers):
            for key, rights in _rights_of(controller, controller_key(findings, name, controller.name, index)):
                _check_lists(findings, rights, key)
                _check_role(findings, rights, key)
                if axes:
                    is_broadcast = BROADCAST_UNIT_ID in rights.unit_ids and line.drives.tcp is None
                    _check_unit_ids(findings, rights, key, axes, is_broadcast=is_broadcast)
                    _check_positions(findings, rights, key, axes)
                    _check_moves(findings, rights, key, axes)
        for axis, section in axes.items():
            _check_movers(findings, name, line, axis, section)


def _rights_of(controller: ControllerSection, key: KeyPath) -> list[tuple[KeyPath, RightsKeys]]:
    """Return the rights of a controller, or those of each role that its certificates may have."""
    if controller.tls is None:
        return [(key, controller)]
    return [((*key, "roles", name), rights) for name, rights in controller.roles.items()]


def _check_lists(findings: Findings, rights: RightsKeys, key: KeyPath) -> None:
    for name in LISTS:
        is_empty = name in rights.model_fields_set and not getattr(rights, name)
        if is_empty and not findings.is_refused((*key, name)):  # else what stood in it was refused
            findings.refuse(
                (*key, name),
                "an empty list, which would allow everything",
                "leave it out where all are allowed, or name those that are",
            )


def _check_role(findings: Findings, rights: RightsKeys, key: KeyPath) -> None:
    may_not_write = rights.role is Role.MONITOR or rights.read_only
    if rights.writable and may_not_write:
        why = "read_only = true" if rights.read_only else f'role = "{rights.role.value}"'
        findings.refuse(
            (*key, "writable"),
            f"addresses that may be written beside {why}, which may write nothing",
            f"leave writable out, or {why} where it may write them",
        )
    if may_not_write and rights.function_codes and not READING & set(rights.function_codes):
        findings.refuse(
            (*key, "function_codes"),
            "function codes that only write, for a controller that may only read: nothing is left",
            "name those that it reads with, as 3 and 4, or let it write",
        )


def _check_unit_ids(
    findings: Findings, rights: RightsKeys, key: KeyPath, axes: Axes, *, is_broadcast: bool
) -> None:
    known = {axis.unit_id for axis in axes.values()}
    for index, unit_id in enumerate(rights.unit_ids):
        if unit_id not in known and not (is_broadcast and unit_id == BROADCAST_UNIT_ID):
            shown = ", ".join(map(str, sorted(known)))
            findings.warn(
                (*key, "unit_ids", index),
                f"no axis of this line has unit id {unit_id}",
                f"the axes have {shown}; leave it so if something else on the line has it",
            )
    left_out = sorted(known - set(rights.unit_ids))
    if is_broadcast and left_out:
        shown = ", ".join(map(str, left_out))
        findings.warn(
            (*key, "unit_ids"),
            f"unit id 0, the broadcast, without {shown}, which it reaches too: broadcasts are refused",
            f"name {shown} as well, or leave 0 out",
        )


def _check_positions(findings: Findings, rights: RightsKeys, key: KeyPath, axes: Axes) -> None:
    """Refuse what lets a part of a position be written: nobody could tell what comes of it."""
    for name, axis in axes.items():
        if axis.registers is None or (rights.unit_ids and axis.unit_id not in rights.unit_ids):
            continue
        fields = [field for position in axis.registers.command for field in position.fields()]
        for index, span in enumerate(rights.writable):
            for field in fields:
                last = field.end - 1
                is_apart = last < span.first or span.last < field.address
                if not is_apart and not span.first <= field.address <= last <= span.last:
                    cut, whole = f"{span.first:04X}-0x{span.last:04X}", f"{field.address:04X}-0x{last:04X}"
                    findings.refuse(
                        (*key, "writable", index),
                        f"0x{cut} holds a part of a command position of axis {name}, which is 0x{whole}",
                        "take all of its addresses, or none",
                    )


def _check_moves(findings: Findings, rights: RightsKeys, key: KeyPath, axes: Axes) -> None:
    if rights.role is not Role.MOTION or not _has_rights(rights):
        return
    if any(_may_move(rights, axis) for axis in axes.values()):
        return
    findings.warn(
        (*key, "role"),
        'role = "motion", and its rights let it move no axis of this line',
        'write role = "monitor" or "operator", or allow a command position of an axis',
    )


def _check_movers(findings: Findings, name: str, line: LineSection, axis: str, section: AxisSection) -> None:
    """Warn of a second controller for an axis: the first to move it holds it, and the other is refused."""
    movers = []
    for index, controller in enumerate(line.controllers):
        key = controller_key(findings, name, controller.name, index)
        rights = [each for _, each in _rights_of(controller, key)]
        if any(each.role is Role.MOTION and _may_move(each, section) for each in rights):
            movers.append((key, controller.name))
    if len(movers) < 2 or section.writers is Writers.ANY:
        return
    findings.warn(
        (*movers[-1][0], "role"),
        f"{' and '.join(mover for _, mover in movers)} may each move axis {axis}: while one does, the "
        "other is refused",
        'give what only looks or stops role = "monitor" or "operator", or name in unit_ids what each may '
        f'reach; where all are to move it, set axis.{axis}.writers = "any"',
    )


def _has_rights(rights: RightsKeys) -> bool:
    return rights.read_only or any(getattr(rights, name) for name in LISTS)


def _may_move(rights: RightsKeys, axis: AxisSection) -> bool:
    if rights.read_only or (rights.unit_ids and axis.unit_id not in rights.unit_ids):
        return False
    if rights.function_codes and not WRITING & set(rights.function_codes):
        return False
    if not rights.writable or axis.registers is None:
        return True
    return any(
        span.first <= field.address and field.end - 1 <= span.last
        for span in rights.writable
        for position in axis.registers.command
        for field in position.fields()
    )
