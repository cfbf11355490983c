"""Builds the plan that the relay runs from checked models."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

from gateway.compensation.backlash import no_correction
from gateway.config.axis_model import AddedFrames, AxisSection, StoredMoves, Unmapped, Writers
from gateway.config.crosses import Crosses
from gateway.config.drive_files import NamedProfile
from gateway.config.line_model import Connect, ControllerSection, LineSection
from gateway.config.sections import Sections
from gateway.config.settings_of import settings_of, thermal_of
from gateway.config.tables import AxisTable
from gateway.drives import library
from gateway.drives.motion import Action
from gateway.drives.registers import DoneMeans, OnException, RegisterMap
from gateway.drives.strict import planned
from gateway.exchange.plan import (
    AxisPlan,
    ControllerPlan,
    LineTiming,
    OtherUnits,
    StopWord,
    default_late,
)
from gateway.modbus.pdu import BROADCAST_UNIT_ID
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan, RoleRights, TlsPlan


def build_plan(
    sections: Sections,
    tables: Mapping[str, AxisTable],
    drives: Mapping[str, NamedProfile],
    crosses: Crosses,
) -> GatewayPlan:
    """Build the plan of a configuration without errors."""
    lines = (line_plan(name, sections, tables, drives) for name in sections.lines)
    return GatewayPlan(
        sections.gateway.name,
        tuple(_with_crosses(line, crosses) for line in lines),
        sections.relay.options,
        0 if sections.status_unit is None else sections.status_unit.id,
    )


def _with_crosses(line: LinePlan, crosses: Crosses) -> LinePlan:
    axes = (
        replace(axis, cross=tuple(each.plan for each in crosses.get(axis.name, ()))) for axis in line.axes
    )
    return replace(line, axes=tuple(axes))


def line_plan(
    name: str, sections: Sections, tables: Mapping[str, AxisTable], drives: Mapping[str, NamedProfile]
) -> LinePlan:
    """Build the plan of one line without errors."""
    line = sections.lines[name]
    axes = {axis_name: axis for axis_name, axis in sections.axes.items() if axis.line == name}
    return LinePlan(
        **planned(LinePlan, line),
        name=name,
        drives=line.drives.endpoint,
        controllers=tuple(_controller_link(each, sections.folder) for each in line.controllers),
        axes=tuple(
            _axis_plan(axis_name, axis, tables.get(axis_name), drives.get(axis_name))
            for axis_name, axis in axes.items()
        ),
        timing=LineTiming(
            **planned(LineTiming, line),
            drain_ms=line.response_timeout_ms if line.drain_ms is None else line.drain_ms,
            connects_on_demand=line.connect is Connect.ON_DEMAND,
            # Drives share the bus: the one that needs the longest silence determines it.
            gap_ms=max([line.gap_ms, *(_registers(axis).gap_ms for axis in axes.values())]),
        ),
        other_units=_other_units(line, {axis.unit_id for axis in axes.values()}),
        tape_bytes=sections.capture.tape_bytes,
        groups=tuple(group.axes for group in sections.groups.values() if set(group.axes) <= set(axes)),
    )


def _other_units(line: LineSection, axis_ids: set[int]) -> OtherUnits:
    """Return the settings of unit ids without an axis. Stop commands matter for a single unit on Modbus/TCP.

    Only a serial port can find the end of a frame whose length does not follow from its function code.
    """
    is_alone = line.drives.tcp is not None and len(axis_ids) == 1
    unit_ids = frozenset(line.other_units)
    odd = unit_ids - {BROADCAST_UNIT_ID} if line.drives.rtu is not None else frozenset()
    return OtherUnits(unit_ids, odd, shipped_stops() if is_alone else frozenset())


@cache
def shipped_stops() -> frozenset[StopWord]:
    """Return the stop commands of all shipped drive profiles."""
    triggers = (
        trigger for name in library.names() for trigger in library.shipped(name).registers.motion().triggers
    )
    return frozenset(
        StopWord(trigger.address, trigger.mask, value, trigger.is_coil)
        for trigger in triggers
        for value, operation in trigger.deeds.items()
        if operation.action is Action.STOP
    )


def _controller_link(controller: ControllerSection, folder: Path) -> ControllerLink:
    plan = ControllerPlan(
        **planned(ControllerPlan, controller),
        role=controller.roles_in_use[0],
        serial=controller.tcp is None,
        rights=controller.rights,
    )
    tls = _tls_plan(controller, folder)
    return ControllerLink(
        plan, controller.endpoint, tuple(map(str, controller.allow)), controller.limits, tls
    )


def _tls_plan(controller: ControllerSection, folder: Path) -> TlsPlan | None:
    if controller.tls is None:
        return None
    roles = {name: RoleRights(each.role, each.rights) for name, each in controller.roles.items()}
    return TlsPlan(controller.tls.files(folder), roles)


def _axis_plan(name: str, axis: AxisSection, table: AxisTable | None, drive: NamedProfile | None) -> AxisPlan:
    registers, settings = _registers(axis), settings_of(axis)
    found = None if table is None else table.table
    if axis.table is None and axis.backlash is not None:
        found = no_correction(settings)
    return AxisPlan(
        **planned(AxisPlan, axis, registers),
        name=name,
        settings=settings,
        table=found,
        command=tuple(field for position in registers.command for field in position.fields()),
        actual=tuple(position.field() for position in registers.actual),
        commanded=tuple(position.field() for position in registers.commanded),
        guarded=tuple(field for position in registers.position_like for field in position.fields()),
        remapping=tuple(field for position in registers.remap for field in position.fields()),
        passes_unmapped=axis.unmapped is Unmapped.PASS,
        limits=tuple(position.field() for position in registers.limits),
        aliases=tuple(position.field() for position in registers.aliases),
        settable=frozenset(n for n, position in enumerate(registers.actual) if position.set_position),
        motion=registers.motion(
            passes_stored_moves=axis.stored_moves is StoredMoves.UNCORRECTED,
            passes_unknown_relative=axis.relative_unknown is Unmapped.PASS,
        ),
        object_words={entry.address: entry.words for entry in registers.objects},
        reads_with=registers.read,
        writes_with=registers.write,
        deadline_ms=axis.deadline_ms or 0.0,
        late=axis.late or default_late(axis.setpoints),
        done_is_in_position=registers.done_means is DoneMeans.IN_POSITION,
        bits={bit_name: bit.field() for bit_name, bit in registers.bits.named()},
        added_frames=axis.added_frames is AddedFrames.AUTO,
        exception_writes_nothing=registers.exception is OnException.NOTHING_WRITTEN,
        has_one_writer=axis.writers is Writers.ONE,
        drive=drive.name if drive is not None and drive.is_shipped else "",
        table_name=(axis.table or "") if table is None else table.path.name,
        table_format="" if table is None else table.source.format,
        table_digest="" if table is None else table.source.sha256,
        thermal=None if axis.thermal is None else thermal_of(axis.thermal),
    )


def _registers(axis: AxisSection) -> RegisterMap:
    assert axis.registers is not None, "an axis without registers has been refused"
    return axis.registers
