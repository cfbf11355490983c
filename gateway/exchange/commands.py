"""Commands to a running line: one struct each, passed on by the socket, MQTT, recordings and the line.

:func:`gateway.exchange.control.carry_out` carries them out. A new command needs its struct and a place in
:data:`Command` here, a case there, a case in ``relay.gateway.Relay._log_command`` for its event, and a
command line.
"""

from typing import Annotated, ClassVar, Final

import msgspec

VERSION: Final = 2
"""Of the messages on the gateway's socket."""
MAX_TABLES: Final = 16
"""In one command: the axes of a group change together, and no gantry has more."""


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The common part of all messages on the socket."""

    version: int = VERSION


class Enable(Message, frozen=True, tag="enable", tag_field="kind"):
    """Switch the compensation of axes on; no names: all axes. A group changes as one."""

    stays: ClassVar[str] = "switch"
    axes: tuple[str, ...] = ()


class Disable(Message, frozen=True, tag="disable", tag_field="kind"):
    """Switch the compensation of axes off; no names: all axes. A group changes as one."""

    stays: ClassVar[str] = "switch"
    axes: tuple[str, ...] = ()


class EndDryRun(Message, frozen=True, tag="end-dry-run", tag_field="kind"):
    """Apply what axes in shadow only showed; their configuration says ``on`` now."""

    stays: ClassVar[str] = "switch"
    axes: tuple[str, ...]


class SetReference(Message, frozen=True, tag="reference", tag_field="kind"):
    """Declare that an axis is where its drive says."""

    stays: ClassVar[str] = ""
    axis: str


class TableFor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table and its axis. Its points are passed beside the command, at the same index."""

    axis: str
    file: str
    format: str
    sha256: str
    """Of the file from which it was read."""


class SetTable(Message, frozen=True, tag="set-table", tag_field="kind"):
    """Set tables, all of them or none; recorded by their digests."""

    stays: ClassVar[str] = "table"
    tables: Annotated[tuple[TableFor, ...], msgspec.Meta(min_length=1, max_length=MAX_TABLES)]


class ClearTable(Message, frozen=True, tag="clear-table", tag_field="kind"):
    """Remove the tables of axes, and so their correction; axes of a group lose theirs together."""

    stays: ClassVar[str] = "table"
    axes: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]


Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class SetGain(Message, frozen=True, tag="set-gain", tag_field="kind"):
    """Set another gain of the tables, until the gateway restarts; no names: all axes.

    A command applies to the whole group of an axis. A configured value (``is_configured``) applies to each
    axis alone.
    """

    stays: ClassVar[str] = "gain"
    forward: Share
    backward: Share
    axes: tuple[str, ...] = ()
    is_configured: bool = False


Limit = Annotated[float, msgspec.Meta(ge=0.0)]


class SetLimits(Message, frozen=True, tag="set-limits", tag_field="kind"):
    """Set other limits of an axis, in its units: those of its configuration, while the gateway runs."""

    stays: ClassVar[str] = "limits"
    axis: str
    max_correction: Limit
    max_slope: Limit
    travel_margin: Limit
    budget_us: Limit


class SetTemperature(Message, frozen=True, tag="set-temperature", tag_field="kind"):
    """Set the present temperature of an axis's screw, in °C."""

    stays: ClassVar[str] = "temperature"
    axis: str
    celsius: float


Command = (
    Enable | Disable | EndDryRun | SetReference | SetTable | ClearTable | SetGain | SetLimits | SetTemperature
)
"""``stays`` names what a command changes permanently: the last one of each name holds. Empty: nothing."""


def axes_of(command: Command) -> tuple[str, ...]:
    """Return the names of the axes that a command is for; none: all.

    >>> axes_of(SetReference(axis="x")), axes_of(Enable())
    (('x',), ())
    """
    match command:
        case SetReference(axis=axis) | SetLimits(axis=axis) | SetTemperature(axis=axis):
            return (axis,)
        case SetTable(tables=tables):
            return tuple(table.axis for table in tables)
        case Enable(axes=axes) | Disable(axes=axes) | EndDryRun(axes=axes):
            return axes
        case ClearTable(axes=axes) | SetGain(axes=axes):
            return axes


def for_axis(command: Command, axis: str) -> Command:
    """Return the same command for one of its axes.

    >>> for_axis(Enable(), "x")
    Enable(axes=('x',), version=2)
    """
    match command:
        case SetReference() | SetTable() | SetLimits() | SetTemperature():
            return command
        case Enable() | Disable() | EndDryRun() | ClearTable() | SetGain():
            return msgspec.structs.replace(command, axes=(axis,))
