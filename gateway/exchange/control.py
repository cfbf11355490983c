"""What each command does to the axes of a line (:mod:`gateway.exchange.commands`)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from gateway.compensation.correction_spec import spec_of_table
from gateway.compensation.errors import CompensationError, TemperatureError
from gateway.compensation.settings import Gain, Setpoints
from gateway.compensation.table import CorrectionTable
from gateway.exchange.axis.axis import Axis
from gateway.exchange.commands import (
    ClearTable,
    Command,
    Disable,
    Enable,
    EndDryRun,
    SetGain,
    SetLimits,
    SetReference,
    SetTable,
    SetTemperature,
    TableFor,
    axes_of,
)
from gateway.exchange.limits import limits_of, values_of, with_limits

ROUNDING: Final = 1e-9
"""Fraction of a limit by which decimal fractions and conversions may exceed it."""
NEXT_TARGET: Final = "next-target"
BLENDED: Final = "blended"
NOT_IN_FORCE: Final = "not-in-force"


class ControlError(Exception):
    """A command that cannot be carried out; the message says why, and what to do."""


def carry_out(
    axes: Sequence[Axis], command: Command, now_ns: int, tables: Sequence[CorrectionTable] = ()
) -> dict[str, str]:
    """Carry out a command; return the axes that changed, each with how that comes into force.

    That text is "" if there is nothing to say. No axis moves because of a command. The command is for one
    axis, or sets ``tables``, one for each axis that it names.

    Raises:
        ControlError: why it is not possible, and what to do; nothing has changed then.
    """
    if isinstance(command, SetTable):
        return set_tables(axes, command.tables, tables)
    [name] = axes_of(command)
    match command:
        case Enable():
            switched = switch(axes, name, is_on=True)
            return {axis.plan.name: _comes_on(axis) for axis in axes if axis.plan.name in switched}
        case Disable():
            return dict.fromkeys(switch(axes, name, is_on=False), "")
        case EndDryRun():
            return end_dry_run(axes, name)
        case SetReference():
            return dict.fromkeys(declare(axes, name), "")
        case ClearTable():
            return clear_table(axes, name)
        case SetGain():
            gain = Gain(command.forward, command.backward)
            return set_gain(axes, name, gain, is_configured=command.is_configured)
        case SetLimits():
            return dict.fromkeys(set_limits(axes, command), "")
        case SetTemperature():
            return dict.fromkeys(set_temperature(axes, name, command.celsius, now_ns), "")


def switch(axes: Sequence[Axis], name: str, *, is_on: bool) -> tuple[str, ...]:
    """Apply the table of an axis and of its whole group, or stop applying it; return their names.

    No axis moves: it comes into force with the next different target, or blended over setpoints.

    Raises:
        ControlError: no such axis, or nothing to apply.
    """
    members = _group_of(axes, name)
    for axis in members:
        if is_on and axis.plan.table is None:
            raise ControlError(f"axis {axis.plan.name} has no table: name one in the configuration first")
        if is_on and axis.reference.is_remapped:
            raise ControlError(
                f"the registers of axis {axis.plan.name} were moved about on its drive: check the drive, "
                "then restart the gateway"
            )
    for axis in members:
        axis.correction.enable(is_on=is_on)
    return tuple(axis.plan.name for axis in members)


def end_dry_run(axes: Sequence[Axis], name: str) -> dict[str, str]:
    """Apply what an axis and its whole group only showed; return how that comes into force, by name.

    No axis moves, and no reading changes: the drives are where they were commanded to be.

    Raises:
        ControlError: no such axis, or one of them is not at standstill; nothing has changed then.
    """
    members = [axis for axis in _group_of(axes, name) if axis.correction.is_dry_run]
    for axis in members:
        if why := axis.motion.why_not_at_rest:
            raise ControlError(
                f"axis {axis.plan.name} stays in shadow: {why}; let it arrive at a target, and reload again"
            )
    for axis in members:
        if axis.member.fixed is not None:
            raise ControlError(
                f"axis {axis.plan.name} stays in shadow: one axis of its group has gone, and another one has "
                "not; let all of them arrive, and reload again"
            )
    for axis in members:
        axis.end_dry_run()
    return {axis.plan.name: _comes(axis) for axis in members}


def declare(axes: Sequence[Axis], name: str) -> tuple[str, ...]:
    """Declare that an axis is where its drive says; return its name.

    Raises:
        ControlError: no such axis, or its drive's homed bit decides.
    """
    axis = _group_of(axes, name)[0]
    if axis.reference.follows_homed_bit:
        raise ControlError(
            f'axis {name} is referenced by its drive\'s homed bit (referenced = "drive-bit"): home the drive'
        )
    axis.declare_referenced()
    return (name,)


def set_tables(
    axes: Sequence[Axis], requested: Sequence[TableFor], tables: Sequence[CorrectionTable]
) -> dict[str, str]:
    """Set other tables of axes, all of them or none; return how each comes into force, by name.

    No loop here runs over the points of a table.

    Raises:
        ControlError: which axis cannot have its table, and why; nothing has changed then.
    """
    members = [_group_of(axes, each.axis)[0] for each in requested]
    for axis, table in zip(members, tables, strict=True):
        _check_fits(axis, table)
    _check_whole(members)
    for axis, each, table in zip(members, requested, tables, strict=True):
        axis.adopt(
            replace(
                axis.plan,
                table=table,
                table_name=each.file,
                table_format=each.format,
                table_digest=each.sha256,
            )
        )
    return {axis.plan.name: _comes(axis) for axis in members}


def clear_table(axes: Sequence[Axis], name: str) -> dict[str, str]:
    """Remove the table of an axis and of its whole group; return how the correction ends, by name.

    Raises:
        ControlError: no such axis.
    """
    members = [axis for axis in _group_of(axes, name) if axis.plan.table is not None]
    for axis in members:
        axis.adopt(replace(axis.plan, table=None, table_name="", table_format="", table_digest=""))
    return {axis.plan.name: _comes(axis, is_end=True) for axis in members}


def set_gain(axes: Sequence[Axis], name: str, gain: Gain, *, is_configured: bool = False) -> dict[str, str]:
    """Set another gain of the tables of an axis and its whole group; return how each comes into force.

    ``is_configured``: as in :class:`~gateway.exchange.commands.SetGain`.

    Raises:
        ControlError: no such axis.
    """
    group = _group_of(axes, name)[: 1 if is_configured else None]
    members = [axis for axis in group if axis.plan.settings.gain != gain]
    for axis in members:
        axis.adopt(replace(axis.plan, settings=replace(axis.plan.settings, gain=gain)))
    return {axis.plan.name: _comes(axis) for axis in members}


def set_limits(axes: Sequence[Axis], limits: SetLimits) -> tuple[str, ...]:
    """Set other limits of an axis, from now on; return its name if they have changed.

    Raises:
        ControlError: no such axis.
    """
    axis, values = _group_of(axes, limits.axis)[0], values_of(limits)
    if values_of(limits_of(axis.plan)) == values:
        return ()
    axis.limit(with_limits(axis.plan, values))
    return (limits.axis,)


def set_temperature(axes: Sequence[Axis], name: str, celsius: float, now_ns: int) -> tuple[str, ...]:
    """Set the temperature of an axis's screw; it counts from its next different target on.

    Raises:
        ControlError: no such axis, an axis without thermal settings, or an impossible temperature.
    """
    terms = _group_of(axes, name)[0].correction.terms
    if terms is None or terms.thermal is None:
        raise ControlError(f"axis {name} has no thermal in its configuration: it needs no temperature")
    try:
        terms.take_temperature(celsius, now_ns)
    except TemperatureError as error:
        raise ControlError(f"axis {name}: {error}; the last good value is kept: look at the sensor") from None
    return (name,)


def _check_fits(axis: Axis, table: CorrectionTable) -> None:
    name, settings = axis.plan.name, axis.plan.settings
    if table.units is not settings.units:
        raise ControlError(f"the table for axis {name} is in {table.units.value}, not {settings.units.value}")
    if settings.backlash is not None and not table.facts.has_backlash:
        raise ControlError(f"the table for axis {name} is without its backlash: compile it again")
    largest = table.max_correction()
    if not largest <= settings.max_correction * (1.0 + ROUNDING):
        raise ControlError(
            f"the table for axis {name} corrects by {largest:.6g} {settings.units.value}, more than "
            f"max_correction = {settings.max_correction:.6g}"
        )
    if not 0.0 <= table.max_slope() < 1.0:
        raise ControlError(f"the table for axis {name} has a slope of {table.max_slope():.4g}, 1 or more")
    try:
        spec_of_table(table, settings)
    except CompensationError as error:
        raise ControlError(f"the table for axis {name}: {error}") from None


def _check_whole(members: Sequence[Axis]) -> None:
    """Check that no axis comes twice, and that no axis of a group is left without a table (M11)."""
    names = [axis.plan.name for axis in members]
    for axis in members:
        if names.count(axis.plan.name) > 1:
            raise ControlError(f"two tables for axis {axis.plan.name}: send one")
        for peer in axis.peers:
            if peer.plan.table is None and peer.plan.name not in names:
                raise ControlError(
                    f"axis {peer.plan.name} of the group of {axis.plan.name} has no table: they are "
                    "corrected together or not at all; send both in one message"
                )


def _comes_on(axis: Axis) -> str:
    """Return how an axis that was switched on is corrected: not at all with a gain of 0."""
    is_zero = axis.plan.settings.gain.is_zero and axis.correction.terms is None
    return NOT_IN_FORCE if is_zero else _comes(axis)


def _comes(axis: Axis, *, is_end: bool = False) -> str:
    """Return how a requested change of an axis comes into force; it never moves the axis.

    ``is_end``: the change is that its table has gone.
    """
    correction = axis.correction
    if not correction.is_enabled or correction.is_dry_run or not axis.reference.is_referenced:
        return NOT_IN_FORCE
    if axis.plan.table is None and not is_end:
        return NOT_IN_FORCE
    return BLENDED if axis.plan.settings.setpoints is Setpoints.STREAM else NEXT_TARGET


def _group_of(axes: Sequence[Axis], name: str) -> tuple[Axis, ...]:
    for axis in axes:
        if axis.plan.name == name:
            return (axis, *axis.peers)
    raise ControlError(f"there is no axis {name} here; there are {', '.join(a.plan.name for a in axes)}")
