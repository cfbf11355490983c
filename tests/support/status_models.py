"""Status models as tests write them: plain data of what matters; what is not told has its default."""

from typing import Any

from msgspec import convert, to_builtins

from gateway.status.model import Model, RelayModel, SupervisorStatus


def model_of(parts: dict[str, Any]) -> Model:
    """Return a whole model."""
    return convert(parts, Model)


def relay_model_of(parts: dict[str, Any]) -> RelayModel:
    """Return what a relay tells."""
    return convert(parts, RelayModel)


def supervisor_of(parts: dict[str, Any]) -> SupervisorStatus:
    """Return what a supervisor says of itself."""
    return convert(parts, SupervisorStatus)


def plain(part: object) -> dict[str, Any]:
    """Return a part of the status as plain data, as JSON has it."""
    data: dict[str, Any] = to_builtins(part)
    return data
