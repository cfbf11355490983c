"""What a person may ask of a running line: switch an axis's compensation, declare it referenced."""

from collections.abc import Sequence

from gateway.exchange.axis import AxisExchange


class ControlError(Exception):
    """A request that cannot be followed; the message says why, and what to do."""


def switch(axes: Sequence[AxisExchange], name: str, *, is_wanted: bool) -> tuple[str, ...]:
    """Apply the table of an axis and of its whole group, or stop to; return their names.

    Nothing moves by itself: it comes into force with the next different target, or blended over setpoints.

    Raises:
        ControlError: no such axis, or nothing to apply.
    """
    members = _group_of(axes, name)
    for axis in members:
        if is_wanted and axis.plan.table is None:
            raise ControlError(f"axis {axis.plan.name} has no table: name one in the configuration first")
        if is_wanted and axis.is_ended:
            raise ControlError(
                f"the registers of axis {axis.plan.name} were moved about on its drive: check the drive, "
                "then restart the gateway"
            )
    for axis in members:
        axis.enable(is_wanted=is_wanted)
    return tuple(axis.plan.name for axis in members)


def declare(axes: Sequence[AxisExchange], name: str) -> tuple[str, ...]:
    """Take an axis as standing where its drive says; return its name.

    Raises:
        ControlError: no such axis, or its drive's homed bit decides.
    """
    axis = _group_of(axes, name)[0]
    if axis.reference.follows_bit:
        raise ControlError(
            f'axis {name} is referenced by its drive\'s homed bit (referenced = "drive-bit"): home the drive'
        )
    axis.declare_referenced()
    return (name,)


def _group_of(axes: Sequence[AxisExchange], name: str) -> tuple[AxisExchange, ...]:
    for axis in axes:
        if axis.plan.name == name:
            return (axis, *axis.peers)
    raise ControlError(f"there is no axis {name} here; there are {', '.join(a.plan.name for a in axes)}")
