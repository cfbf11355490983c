"""What a person may ask a running gateway: the requests of its socket, answered by the relay."""

import os
from collections.abc import Callable, Sequence
from typing import Protocol

import gateway
from gateway.compensation.settings import Gain
from gateway.exchange.control import ControlError, Limits
from gateway.ipc.messages import (
    ClearTable,
    Disable,
    Done,
    Enable,
    GetStatus,
    Ping,
    Pong,
    Refused,
    Reply,
    Request,
    SetGain,
    SetLimits,
    SetReference,
    SetTable,
    SetTemperature,
    Status,
    Subscribe,
)


class Controllable(Protocol):
    """What the relay offers; each command returns the names of the axes that changed with it."""

    @property
    def name(self) -> str:
        """Name of the gateway."""
        ...

    @property
    def shape(self) -> str:
        """Digest of its plan without the tables."""
        ...

    @property
    def axes(self) -> Sequence[str]:
        """Names of all axes."""
        ...

    def status(self) -> dict[str, dict[str, object]]:
        """Return the status model."""
        ...

    def enable(self, axis: str) -> tuple[str, ...]:
        """Switch the compensation of an axis on. Raises ControlError with reason and remedy."""
        ...

    def disable(self, axis: str) -> tuple[str, ...]:
        """Switch the compensation of an axis off. Raises ControlError with reason and remedy."""
        ...

    def reference(self, axis: str) -> tuple[str, ...]:
        """Take an axis as referenced where it stands. Raises ControlError with reason and remedy."""
        ...

    def clear_table(self, axis: str) -> dict[str, str]:
        """Take the table of an axis away; returns how it goes, by axis. Raises ControlError."""
        ...

    def set_gain(self, axis: str, gain: Gain, *, is_configured: bool = False) -> dict[str, str]:
        """Apply another share of the table of an axis; as :meth:`clear_table`."""
        ...

    def set_limits(self, axis: str, limits: Limits) -> tuple[str, ...]:
        """Give an axis other limits. Raises ControlError."""
        ...

    def set_temperature(self, axis: str, celsius: float) -> tuple[str, ...]:
        """Tell an axis the temperature of its screw. Raises ControlError."""
        ...


def answer(relay: Controllable, request: Request) -> Reply:
    """Do what a request asks for and return the reply."""
    match request:
        case Ping():
            return Pong(
                name=relay.name, gateway_version=gateway.__version__, pid=os.getpid(), shape=relay.shape
            )
        case GetStatus():
            return Status(status=dict(relay.status()))
        case Enable(axes=axes):
            return _on_axes(relay, axes, relay.enable)
        case Disable(axes=axes):
            return _on_axes(relay, axes, relay.disable)
        case SetReference(axis=axis):
            return _on_axes(relay, (axis,), relay.reference)
        case ClearTable(axes=axes):
            return _on_axes(relay, axes, relay.clear_table)
        case SetGain(axes=axes):
            gain = Gain(request.forward, request.backward)
            is_configured = request.is_configured
            return _on_axes(relay, axes, lambda axis: relay.set_gain(axis, gain, is_configured=is_configured))
        case SetLimits(axis=axis):
            limits = Limits(
                request.max_correction, request.max_slope, request.travel_margin, request.budget_us
            )
            return _on_axes(relay, (axis,), lambda name: relay.set_limits(name, limits))
        case SetTemperature(axis=axis, celsius=celsius):
            return _on_axes(relay, (axis,), lambda name: relay.set_temperature(name, celsius))
        case Subscribe() | SetTable():
            return Refused(reason="this is answered where the connection is")  # and never comes here


Changed = tuple[str, ...] | dict[str, str]


def _on_axes(relay: Controllable, asked: Sequence[str], command: Callable[[str], Changed]) -> Done:
    """Command each axis; one that cannot be commanded does not keep the others from it."""
    changed: dict[str, str] = {}
    comes: dict[str, str] = {}
    problems: list[str] = []
    for axis in asked or relay.axes:
        if axis not in relay.axes:
            problems.append(f"axis {axis}: there is none of that name; there are {', '.join(relay.axes)}")
            continue
        try:
            found = command(axis)
        except ControlError as error:
            problems.append(str(error))
            continue
        changed.update(dict.fromkeys(found, ""))
        if isinstance(found, dict):
            comes.update(found)
    return Done(changed=tuple(changed), problems=tuple(problems), comes=comes)
