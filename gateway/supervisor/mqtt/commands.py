"""What may be asked over MQTT: to reload, to switch compensation on and off, to set gains. Nothing moves."""

import asyncio
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal

import msgspec

from gateway.exchange.commands import Disable, Enable, SetGain, Share
from gateway.ipc.client import NoGatewayError
from gateway.ipc.messages import Done, Request
from gateway.supervisor.mqtt.interfaces import Orders
from gateway.supervisor.mqtt.topics import COMMANDS

LONGEST_PAYLOAD: Final = 4096
LONGEST_SHOWN: Final = 200
BURST: Final = 10
PER_S: Final = 1.0
"""So many commands may come at once, and then so many in a second."""

Id = Annotated[str, msgspec.Meta(max_length=64)] | int | None
"""What the asker knows its answer by."""
AxisName = Annotated[str, msgspec.Meta(max_length=32)]
Axes = Literal["all"] | Annotated[tuple[AxisName, ...], msgspec.Meta(min_length=1, max_length=64)]


class _Asked(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    id: Id = None


class _OnAxes(_Asked, frozen=True, kw_only=True):
    axes: Axes

    @property
    def names(self) -> tuple[str, ...]:
        """As the relay wants them: no names mean all axes."""
        return () if self.axes == "all" else self.axes


class _Switch(_OnAxes, frozen=True, kw_only=True):
    on: bool


class _Gain(_OnAxes, frozen=True, kw_only=True):
    forward: Share
    backward: Share


_FORMS: Final[dict[str, type[_Asked]]] = {
    "reload": _Asked,
    "enable": _OnAxes,
    "disable": _OnAxes,
    "switch": _Switch,
    "gain": _Gain,
}
_RULES: Final = {
    "reload": "allowed: nothing, or {}",
    "enable": 'allowed: {"axes": ["x"]}, or {"axes": "all"}',
    "disable": 'allowed: {"axes": ["x"]}, or {"axes": "all"}',
    "switch": 'allowed: {"axes": ["x"], "on": true or false}, or "axes": "all"',
    "gain": 'allowed: {"axes": ["x"], "forward": 0 to 1, "backward": 0 to 1}, or "axes": "all"',
}


@dataclass(slots=True)
class Answer:
    """What came of a command."""

    command: str
    asked: Any
    id: Id = None
    changed: tuple[str, ...] = ()
    comes: dict[str, str] = field(default_factory=dict)
    keys: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()

    @property
    def result(self) -> str:
        """``done``, ``partly`` or ``refused``."""
        if not self.problems:
            return "done"
        return "partly" if self.changed or self.comes or self.keys else "refused"

    def as_data(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "command": self.command,
            "asked": self.asked,
            "id": self.id,
            "result": self.result,
            "changed": list(self.changed),
            "comes": self.comes,
            "keys": list(self.keys),
            "problems": list(self.problems),
        }


async def carry_out(command: str, payload: bytes, orders: Orders) -> Answer:
    """Do what a message asks for; what is wrong with it, or with doing it, is in the answer."""
    answer = Answer(command, shown_payload(payload))
    if command not in _FORMS:
        answer.problems = (f"there is no command {command[:LONGEST_SHOWN]}; there are {', '.join(COMMANDS)}",)
        return answer
    if len(payload) > LONGEST_PAYLOAD:
        answer.problems = (f"more than {LONGEST_PAYLOAD} bytes; {_RULES[command]}",)
        return answer
    try:
        asked = msgspec.json.decode(payload or b"{}", type=_FORMS[command])
        answer.asked = msgspec.json.decode(payload or b"{}")
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        answer.problems = (f"{error}; {_RULES[command]}",)
        return answer
    answer.id = asked.id
    try:
        await _do(asked, command, orders, answer)
    except NoGatewayError as error:
        answer.problems = (str(error),)
    except Exception as error:  # noqa: BLE001 - a mistake in one command must not cost those behind it
        answer.problems = (f"a mistake in the gateway: {type(error).__name__}: {error}",)
    return answer


async def _do(asked: _Asked, command: str, orders: Orders, answer: Answer) -> None:
    request: Request
    match asked:
        case _Gain():
            request = SetGain(axes=asked.names, forward=asked.forward, backward=asked.backward)
        case _OnAxes():
            is_on = asked.on if isinstance(asked, _Switch) else command == "enable"
            request = Enable(axes=asked.names) if is_on else Disable(axes=asked.names)
        case _:
            outcome = await orders.reload()
            answer.comes, answer.keys = dict(outcome.comes), outcome.changed
            answer.changed, answer.problems = tuple(outcome.comes), outcome.all_problems
            return
    reply = await asyncio.to_thread(orders.ask, request)
    if isinstance(reply, Done):
        answer.changed, answer.comes, answer.problems = reply.changed, reply.comes, reply.problems
    else:
        answer.problems = (f"answered by {type(reply).__name__}",)


def disabled_axes(command: str, payload: bytes) -> frozenset[str] | None:
    """Return which axes a command switches off, none of them named: all; None where it is another command."""
    if len(payload) > LONGEST_PAYLOAD:
        return None
    try:
        if command == "disable":
            return frozenset(msgspec.json.decode(payload or b"{}", type=_OnAxes).names)
        if command == "switch":
            asked = msgspec.json.decode(payload or b"{}", type=_Switch)
            return None if asked.on else frozenset(asked.names)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
    return None


def shown_payload(payload: bytes) -> str:
    """Return the beginning of what a stranger sent, as text."""
    return payload[:LONGEST_SHOWN].decode(errors="replace")
