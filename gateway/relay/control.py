"""What a person may ask a running gateway: the requests of its socket, answered by the relay."""

import os
from collections.abc import Callable, Sequence
from typing import Protocol

import gateway
from gateway.compensation.settings import Gain
from gateway.exchange import control
from gateway.exchange.control import Control, ControlError, Declare, Switch
from gateway.exchange.limits import Limits
from gateway.ipc.messages import (
    ClearTable,
    Disable,
    Done,
    Enable,
    EndDryRun,
    GetStatus,
    GetTapes,
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
    """What the relay offers."""

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

    def control(self, message: Control) -> dict[str, str]:
        """Do what somebody asks for; return the axes that changed with it, each with how it comes into force.

        Raises ControlError with reason and remedy.
        """
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
            return _on_axes(relay, axes, lambda axis: Switch(axis, is_wanted=True))
        case Disable(axes=axes):
            return _on_axes(relay, axes, lambda axis: Switch(axis, is_wanted=False))
        case EndDryRun(axes=axes):
            return _on_axes(relay, axes, control.EndDryRun)
        case SetReference(axis=axis):
            return _on_axes(relay, (axis,), Declare)
        case ClearTable(axes=axes):
            return _on_axes(relay, axes, control.ClearTable)
        case SetGain(axes=axes):
            gain = Gain(request.forward, request.backward)
            is_configured = request.is_configured
            return _on_axes(relay, axes, lambda axis: control.SetGain(axis, gain, is_configured))
        case SetLimits(axis=axis):
            limits = Limits(
                request.max_correction, request.max_slope, request.travel_margin, request.budget_us
            )
            return _on_axes(relay, (axis,), lambda name: control.SetLimits(name, limits))
        case SetTemperature(axis=axis, celsius=celsius):
            return _on_axes(relay, (axis,), lambda name: control.SetTemperature(name, celsius))
        case Subscribe() | SetTable() | GetTapes():
            return Refused(reason="this is answered where the connection is")  # and never comes here


def _on_axes(relay: Controllable, asked: Sequence[str], message_of: Callable[[str], Control]) -> Done:
    """Ask it of each axis; one that cannot do it does not keep the others from it."""
    changed: dict[str, str] = {}
    problems: list[str] = []
    for axis in asked or relay.axes:
        if axis not in relay.axes:
            problems.append(f"axis {axis}: there is none of that name; there are {', '.join(relay.axes)}")
            continue
        try:
            changed |= relay.control(message_of(axis))
        except ControlError as error:
            problems.append(str(error))
    comes = {axis: how for axis, how in changed.items() if how}
    return Done(changed=tuple(changed), problems=tuple(problems), comes=comes)
