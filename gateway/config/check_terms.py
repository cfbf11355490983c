"""Whether ``thermal`` and ``cross`` of an axis go with its other keys, and with the other axes."""

from gateway.compensation.units import Units
from gateway.config.axis_model import AxisSection
from gateway.config.explain import suggest
from gateway.config.findings import Findings
from gateway.config.sections import Sections
from gateway.config.settings_of import settings_of
from gateway.config.terms_model import TemperatureSource, ThermalSpec
from gateway.config.toml_lines import KeyPath
from gateway.drives.words import LAST_ADDRESS


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
                    "leave it out: two drives of one beam would be told different things",
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
        findings.refuse(path, "thermal of a rotary axis", "leave it out: a turn stays a turn when it is warm")
        return
    tilt = thermal.alpha * thermal.largest_dt
    if not axis.max_slope + tilt < 1.0:
        findings.refuse(
            path,
            f"alpha × largest_dt = {tilt:.4g} and max_slope = {axis.max_slope:g}",
            "allowed: less than 1 together, or positions could not be turned back",
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
            f"beyond {limit / per_kelvin:.4g} K, less what the table takes, it does not follow: check "
            "fixed_at",
        )


def _check_source(findings: Findings, path: KeyPath, sections: Sections, thermal: ThermalSpec) -> None:
    source = thermal.source
    if findings.is_refused(path):
        return
    if (source.mqtt is None) is (source.modbus is None):
        found = "neither mqtt nor modbus" if source.mqtt is None else "mqtt and modbus"
        findings.refuse(path, found, "needed: one of them, where the temperature is heard")
        return
    if source.mqtt is not None:
        if sections.mqtt is None and not findings.is_refused(("mqtt",)):
            findings.refuse(
                (*path, "mqtt"), "a topic without [mqtt]", "needed: [mqtt], which names the broker"
            )
        for key in sorted(source.model_fields_set - {"mqtt"}):
            findings.refuse((*path, key), f"{key} beside mqtt", "it belongs to modbus: leave it out")
        return
    _check_registers(findings, path, source)
    if source.every_s >= thermal.timeout_s:
        findings.refuse(
            (*path, "every_s"),
            f"every_s = {source.every_s:g} and timeout_s = {thermal.timeout_s:g}",
            "allowed: less than timeout_s, or the sensor would be silent between two readings",
        )


def _check_registers(findings: Findings, path: KeyPath, source: TemperatureSource) -> None:
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
            findings.refuse(key, f"{cross.axis} itself", "its own position is what table is for")
        elif cross.axis not in names:
            findings.refuse(key, f"there is no [axis.{cross.axis}]", suggest(cross.axis, names))
        elif cross.axis in seen:
            findings.refuse(key, f"{cross.axis} stands here twice", "put both into one table")
        elif cross.axis in sections.axes:
            units = sections.axes[cross.axis].units
            if (units is Units.DEGREE) is not (axis.units is Units.DEGREE):
                found = f"{name} is in {axis.units.value} and {cross.axis} in {units.value}"
                findings.refuse(key, found, "no table file holds angles and lengths at once")
        seen.add(cross.axis)
