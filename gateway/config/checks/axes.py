"""Axes: scale, travel, corrections, groups and terms."""

from collections.abc import Mapping
from itertools import combinations
from typing import Any, Final

from gateway.compensation.settings import BacklashKind, OutsideKind, ReversalKind, Setpoints
from gateway.compensation.units import Units
from gateway.config.axis_model import AxisSection, GroupSection, HomeApproach
from gateway.config.checks.files import check_backlash_alone
from gateway.config.findings import Findings, suggest
from gateway.config.line_model import LineSection
from gateway.config.problems import key_text, shown
from gateway.config.sections import Sections
from gateway.config.settings_of import settings_of
from gateway.config.terms_model import TemperatureSource, ThermalSpec
from gateway.config.toml import KeyPath
from gateway.drives.registers import (
    ClaimedSpan,
    RegisterMap,
    bit_spans,
    clashes,
    first_of_keys,
    position_spans,
    share_register,
)
from gateway.drives.words import LAST_ADDRESS
from gateway.exchange.plan import CompensationMode
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import BROADCAST_UNIT_ID

# --- Keys of an axis against each other and against the other axes; tables are checked in files.py

COUNTED_FROM: Final = (30_001, 40_001)
"""First register numbers in manuals, of input and holding registers. Their addresses in the frame start at
0."""
COUNTED: Final = 9999
"""Number of registers with such five-digit numbers."""
ADDRESSES: Final = ("address", "block")
LARGEST_EXACT_COUNTS: Final = 2.0**53
"""Beyond it a double does not represent every whole count."""


def check_axes(findings: Findings, sections: Sections) -> None:
    """Check every axis alone and against the others with its unit id."""
    for name, axis in (sections.axes | sections.partial_axes).items():
        path = ("axis", name)
        _check_line(findings, path, axis)
        _check_unit_id(findings, path, axis, sections.lines.get(axis.line))
        _check_registers(findings, path, axis)
        _check_setpoints(findings, path, axis)
        _check_without_table(findings, path, axis)
        _check_mode_is_given(findings, path, axis)
        _check_gain(findings, path, axis)
    for name, axis in sections.axes.items():
        path = ("axis", name)
        _check_modulo(findings, path, axis)
        _check_travel(findings, path, axis)
        _check_counts(findings, path, axis)
        _check_steps(findings, path, axis)
    _check_shared_registers(findings, sections.axes)


def _check_line(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    lines = findings.document.tables.get("line", {})
    names = list(lines) if isinstance(lines, dict) else []
    if axis.line not in names and not findings.is_refused((*path, "line")):
        findings.refuse(
            (*path, "line"), f"there is no [line.{axis.line}]", suggest(axis.line, names or ["[line.NAME]"])
        )


def _check_unit_id(findings: Findings, path: KeyPath, axis: AxisSection, line: LineSection | None) -> None:
    """Unit id 0 is one drive on Modbus TCP, but all drives on a serial line."""
    if axis.unit_id == BROADCAST_UNIT_ID and line is not None and line.drives.tcp is None:
        findings.refuse(
            (*path, "unit_id"),
            "unit_id = 0 on a serial line",
            "allowed: 1 to 255; 0 is the broadcast there and reaches every drive",
        )


def _check_registers(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    raw = findings.document.tables["axis"][path[1]].get("registers")
    _warn_of_counted_registers(findings, (*path, "registers"), raw)
    if axis.registers is None:
        if axis.drive is None and not findings.is_refused((*path, "registers")):
            key = (*path, "registers")
            findings.refuse(key, "missing", "needed: which registers of the drive hold positions")
        return
    for one, other in clashes(axis.registers):
        _refuse_shared(findings, (*path, "registers", *other.key), (*path, "registers", *one.key), other, one)
    for span in position_spans(axis.registers):
        if span.words > axis.registers.max_registers:
            findings.refuse(
                (*path, "registers", "max_registers"),
                f"max_registers = {axis.registers.max_registers}, "
                f"but {key_text(span.key)} has {span.words} registers",
                f"allowed: {span.words} or more",
            )


def _warn_of_counted_registers(findings: Findings, path: KeyPath, raw: object) -> None:
    """Warn of addresses that look like the register numbers of a manual, which start at 30001 or 40001.

    Such an address can be correct. Written in hexadecimal it counts as intended.
    """
    if isinstance(raw, dict | list):
        for key, inside in raw.items() if isinstance(raw, dict) else enumerate(raw):
            _warn_of_counted_registers(findings, (*path, key), inside)
    elif path[-1] in ADDRESSES and isinstance(raw, int) and not isinstance(raw, bool):
        first = next((first for first in COUNTED_FROM if first <= raw < first + COUNTED), None)
        if first is None:
            return
        if str(raw) not in findings.document.line_of(path):
            return
        findings.warn(
            path,
            f"{path[-1]} = {raw}: is that a manual's register number? Register {raw} has the address "
            f"{raw - first:#06x}",
            f"write {raw - first:#06x} if it is; write {raw:#06x} if {raw} is the address itself",
        )


def _refuse_shared(
    findings: Findings, key: KeyPath, other_key: KeyPath, span: ClaimedSpan, other: ClaimedSpan
) -> None:
    findings.refuse(
        key,
        f"{span} overlaps {other} of {key_text(other_key)}",
        "a register belongs to one position: check addresses and types",
    )


def _check_shared_registers(findings: Findings, axes: Mapping[str, AxisSection]) -> None:
    """Two axes of one unit: a position of one must not overlap any register of the other.

    State bits may be shared.
    """
    for (name, axis), (other_name, other) in combinations(axes.items(), 2):
        if (axis.line, axis.unit_id) != (other.line, other.unit_id):
            continue
        if axis.registers is None or other.registers is None:
            continue
        if axis.registers == other.registers:
            findings.refuse(
                ("axis", other_name, "unit_id"),
                f"unit_id = {other.unit_id} and the registers of axis.{name}: both would move the same drive",
                "give each drive its own unit id, or each axis its own registers",
            )
            continue
        for span, other_span in _shared(axis.registers, other.registers):
            _refuse_shared(
                findings,
                ("axis", other_name, "registers", *other_span.key),
                ("axis", name, "registers", *span.key),
                other_span,
                span,
            )


def _shared(one: RegisterMap, other: RegisterMap) -> list[tuple[ClaimedSpan, ClaimedSpan]]:
    positions, other_positions = position_spans(one), position_spans(other)
    candidates = (
        *((p, q) for p in positions for q in (*other_positions, *bit_spans(other))),
        *((bit, q) for bit in bit_spans(one) for q in other_positions),
    )
    return first_of_keys((p, q) for p, q in candidates if share_register(p, q))


def _check_setpoints(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    if axis.setpoints is Setpoints.STREAM:
        return
    if axis.reversal is not None and axis.reversal.kind is not ReversalKind.STEP:
        findings.refuse(
            (*path, "reversal"),
            f'a {axis.reversal.kind.value} blend with setpoints = "targets"',
            'allowed: "step": the drive profiles each move, and with a blend it would end beside the target',
        )
    if axis.reload is not None:
        findings.warn(
            (*path, "reload"),
            'reload has no effect with setpoints = "targets"',
            "remove it: a new table applies from the next different target",
        )


def _check_without_table(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    backlash = axis.backlash
    if backlash is not None:
        against = {
            BacklashKind.HOMED_FORWARD: HomeApproach.BACKWARD,
            BacklashKind.HOMED_BACKWARD: HomeApproach.FORWARD,
        }
        if against.get(backlash.kind) is axis.home_approach:
            findings.refuse(
                (*path, "backlash", "kind"),
                f'kind = "{backlash.kind.value}" with home_approach = "{axis.home_approach.value}"',
                "make them agree: both give the direction in which homing ends",
            )
    if axis.table is not None or findings.is_refused((*path, "table")):
        return
    is_asked_for = axis.compensation is CompensationMode.ON and "compensation" in axis.model_fields_set
    if is_asked_for and backlash is None:
        findings.warn(
            (*path, "compensation"),
            'compensation = "on" without a table: positions pass uncorrected, and the axis is not green',
            'name its file with `table` once it is measured; or write "off": then it is green uncorrected',
        )
    if "table_options" in axis.model_fields_set:
        findings.refuse(
            (*path, "table_options"),
            "table_options without a table",
            "name the table file, or remove table_options",
        )
    if backlash is not None:
        check_backlash_alone(findings, path, axis)


def _check_gain(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    """Warn of an axis that its gain leaves uncorrected; terms have no gain."""
    is_corrected = (axis.table is not None or axis.backlash is not None) and not (axis.thermal or axis.cross)
    if axis.gain.is_zero and is_corrected and axis.compensation is not CompensationMode.OFF:
        findings.warn(
            (*path, "gain"),
            "a gain of 0: positions pass uncorrected, and the axis is not green",
            'write 1 to apply the whole table, or compensation = "off" if that is intended',
        )


def _check_mode_is_given(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    """Warn of a missing mode. A missing key corrects, so that older files keep their meaning."""
    what = "its table" if axis.table is not None else "its backlash"
    if (axis.table is None and axis.backlash is None) or "compensation" in axis.model_fields_set:
        return
    findings.warn(
        (*path, "compensation"),
        f'missing: the axis is corrected with {what}, as with compensation = "on"',
        f'write compensation = "on" below [{key_text(path)}] if this is intended, or compensation = '
        '"shadow" to see the corrections first while positions pass unchanged',
    )


def _check_modulo(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    if axis.modulo is None:
        return
    if axis.table is None and axis.units is not Units.DEGREE:
        findings.refuse(
            (*path, "modulo"),
            f'modulo with units = "{axis.units.value}" and no table',
            'allowed: units = "degree", or a table that covers exactly one turn',
        )
    if axis.outside.kind is not OutsideKind.HOLD:
        findings.refuse(
            (*path, "outside"),
            f"outside = {axis.outside.kind.value} with modulo",
            "remove it: a table of one turn has no outside",
        )


def _check_steps(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    """A field whose step is larger than any correction cannot carry one."""
    if axis.registers is None:
        return
    limit = settings_of(axis).max_correction
    for key in ("command", "actual", "commanded"):
        for index, position in enumerate(getattr(axis.registers, key)):
            step = position.scale / abs(axis.counts_per_unit)
            if position.type.is_float or step <= limit:
                continue
            findings.warn(
                (*path, "registers", key, index, "scale"),
                f"one step of this position is {step:.6g} {axis.units.value}, more than "
                f"max_correction = {limit:.6g}",
                "check scale and counts_per_unit: no correction is that small",
            )


def _check_travel(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    if axis.travel is None:
        if not findings.is_refused((*path, "travel")) and axis.modulo is None:
            findings.warn(
                path,
                "no travel: the limits of the axis are unknown",
                "give travel = [lowest, highest]: then corrected positions beyond it are refused",
            )
        return
    if axis.hysteresis is not None and axis.hysteresis >= axis.travel[1] - axis.travel[0]:
        findings.refuse(
            (*path, "hysteresis"),
            f"hysteresis = {axis.hysteresis:g} is as long as travel {shown(list(axis.travel))}",
            "allowed: a small part of travel, otherwise the direction never changes",
        )
    if axis.registers is not None:
        _check_travel_fits(findings, path, axis, axis.registers, axis.travel)


def _check_counts(findings: Findings, path: KeyPath, axis: AxisSection) -> None:
    largest = max(abs(axis.zero_counts + axis.counts_per_unit * end) for end in axis.travel or (0.0,))
    if largest > LARGEST_EXACT_COUNTS:
        key = "zero_counts" if abs(axis.zero_counts) > LARGEST_EXACT_COUNTS else "counts_per_unit"
        findings.refuse(
            (*path, key),
            f"positions of up to {largest:.3g} counts: beyond 2^53 single counts are lost",
            "move the drive's zero near the travel, or command it in coarser counts",
        )


def _check_travel_fits(
    findings: Findings, path: KeyPath, axis: AxisSection, registers: RegisterMap, travel: tuple[float, float]
) -> None:
    for index, position in enumerate(registers.command):
        for end in travel:
            counts = axis.zero_counts + axis.counts_per_unit * end
            raw = counts / position.scale
            try:
                position.field().pack(raw if position.type.is_float else round(raw))
            except RegisterRangeError as error:
                findings.refuse(
                    (*path, "registers", "command", index),
                    f"travel ends at {end:g} {axis.units.value}, that is {counts:.0f} counts: {error}",
                    "check counts_per_unit, zero_counts, travel, and type and scale of the register",
                )
                break


# --- The axes of a group: whether they can be corrected together


def check_groups(findings: Findings, sections: Sections) -> None:
    """Check every group: its axes alone, against each other and against other groups."""
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
            findings.refuse((*path, index), f"{axis} is listed twice", "name each axis once")


def _check_alike(findings: Findings, path: KeyPath, members: Mapping[str, AxisSection]) -> None:
    """Settings that all axes of a group must share."""
    lines = {name: f'line = "{axis.line}"' for name, axis in members.items()}
    _check_same(findings, path, lines, "put the axes of a group on one line")
    modes = {name: f'compensation = "{axis.compensation.value}"' for name, axis in members.items()}
    _check_same(findings, path, modes, "write the same for all axes of the group")
    tables = {name: _corrected_by(axis) for name, axis in members.items()}
    _check_same(findings, path, tables, "give each of them a table, or none")


def _corrected_by(axis: AxisSection) -> str:
    if axis.table is not None:
        return "a table"
    return "no table" if axis.backlash is None else "a backlash and no table"


def _check_same(findings: Findings, path: KeyPath, values: Mapping[str, str], remedy: str) -> None:
    if len(set(values.values())) > 1:
        found = ", ".join(f"{name} has {value}" for name, value in values.items())
        findings.refuse(path, found, f"{remedy}: they are corrected together or not at all")


# --- ``thermal`` and ``cross`` of an axis against its other keys and the other axes


def check_terms(findings: Findings, sections: Sections) -> None:
    """Check every axis that has one of them."""
    in_groups = {axis for group in sections.groups.values() for axis in group.axes}
    for name, axis in (sections.axes | sections.partial_axes).items():
        path = ("axis", name)
        for key in ("thermal", "cross"):
            if not getattr(axis, key):
                continue
            if axis.table is None:
                findings.refuse((*path, key), f"{key} without a table", "name one; it may be all zeros")
            if name in in_groups:
                findings.refuse(
                    (*path, key),
                    f"{key} of an axis in a group",
                    "remove it: the drives of one beam would get different corrections",
                )
            if axis.travel is None and not findings.is_refused((*path, "travel")):
                findings.refuse(
                    (*path, key), f"{key} without travel", "needed: travel, to know how far it can reach"
                )
        if axis.thermal is not None:
            _check_thermal(findings, (*path, "thermal"), axis, axis.thermal)
            _check_source(findings, (*path, "thermal", "source"), sections, axis.thermal)
        _check_partners(findings, path, sections, name, axis)


def _check_thermal(findings: Findings, path: KeyPath, axis: AxisSection, thermal: ThermalSpec) -> None:
    if axis.units is Units.DEGREE or axis.modulo:
        findings.refuse(path, "thermal of a rotary axis", "remove it: a turn does not grow with temperature")
        return
    tilt = thermal.alpha * thermal.largest_dt
    if not axis.max_slope + tilt < 1.0:
        findings.refuse(
            path,
            f"alpha × largest_dt = {tilt:.4g} and max_slope = {axis.max_slope:g}",
            "allowed: together less than 1, otherwise corrected positions could not be converted back",
        )
    if axis.travel is None:
        return
    limit = settings_of(axis).max_correction
    per_kelvin = thermal.alpha * max(abs(end - thermal.fixed_at) for end in axis.travel)
    if per_kelvin * thermal.largest_dt > limit:
        findings.warn(
            path,
            f"{thermal.largest_dt:g} K would add {per_kelvin * thermal.largest_dt:.4g} "
            f"{axis.units.value}, more than max_correction = {limit:g}",
            f"check fixed_at: the correction stops following beyond {limit / per_kelvin:.4g} K, or less "
            "with the correction of the table",
        )


def _check_source(findings: Findings, path: KeyPath, sections: Sections, thermal: ThermalSpec) -> None:
    source = thermal.source
    if findings.is_refused(path):
        return
    if (source.mqtt is None) is (source.modbus is None):
        found = "neither mqtt nor modbus" if source.mqtt is None else "mqtt and modbus"
        findings.refuse(path, found, "needed: one of them, as the source of the temperature")
        return
    if source.mqtt is not None:
        if sections.mqtt is None and not findings.is_refused(("mqtt",)):
            findings.refuse(
                (*path, "mqtt"), "a topic without [mqtt]", "needed: [mqtt], which names the broker"
            )
        for key in sorted(source.model_fields_set - {"mqtt"}):
            findings.refuse((*path, key), f"{key} beside mqtt", "remove it: it belongs to modbus")
        return
    _check_sensor_registers(findings, path, source)
    if source.every_s >= thermal.timeout_s:
        findings.refuse(
            (*path, "every_s"),
            f"every_s = {source.every_s:g} and timeout_s = {thermal.timeout_s:g}",
            "allowed: less than timeout_s, otherwise the sensor would be silent between two readings",
        )


def _check_sensor_registers(findings: Findings, path: KeyPath, source: TemperatureSource) -> None:
    if source.address is None:
        findings.refuse((*path, "address"), "missing", "needed: the first register of the value")
    elif source.address + source.type.words - 1 > LAST_ADDRESS:
        findings.refuse(
            (*path, "address"),
            f"{source.type.value} at {source.address:#06x} ends beyond {LAST_ADDRESS:#06x}",
            "check address and type",
        )


def _check_partners(
    findings: Findings, path: KeyPath, sections: Sections, name: str, axis: AxisSection
) -> None:
    tables = findings.document.tables.get("axis", {})
    names = list(tables) if isinstance(tables, dict) else []
    seen: set[str] = set()
    for index, cross in enumerate(axis.cross):
        key = (*path, "cross", index, "axis")
        if cross.axis == name:
            findings.refuse(key, f"{cross.axis} itself", "name another axis: for its own position use table")
        elif cross.axis not in names:
            findings.refuse(key, f"there is no [axis.{cross.axis}]", suggest(cross.axis, names))
        elif cross.axis in seen:
            findings.refuse(key, f"{cross.axis} is listed twice", "put both into one table")
        elif cross.axis in sections.axes:
            units = sections.axes[cross.axis].units
            if (units is Units.DEGREE) is not (axis.units is Units.DEGREE):
                found = f"{name} is in {axis.units.value} and {cross.axis} in {units.value}"
                findings.refuse(
                    key,
                    found,
                    "name an axis with the same kind of unit: a table file cannot hold both angles and "
                    "lengths",
                )
        seen.add(cross.axis)
