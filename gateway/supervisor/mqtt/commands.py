"""What may be asked over MQTT: to reload, to switch compensation on and off, to set gains. Nothing moves.

Commands are carried out one after the other, in the order in which they came, and each is answered. Nothing
is dropped in silence: commands that come too fast are counted, and the last of them is named. One that
switches off is never one of those, unless ``MOST_WAITING`` commands wait for their turn.
"""

import asyncio
import contextlib
import shlex
from collections import deque
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal

import msgspec
from paho.mqtt.client import MQTTMessage

from gateway.catalogue.entry import Severity
from gateway.catalogue.publishing_events import MQTT_COMMAND, MQTT_COMMAND_IGNORED, MQTT_COMMANDS_TOO_MANY
from gateway.exchange.commands import Disable, Enable, SetGain, Share
from gateway.ipc.client import NoGatewayError
from gateway.ipc.messages import Done, Request
from gateway.limits import bucket_of
from gateway.plain import JsonObject
from gateway.supervisor.event_log import LogEvent
from gateway.supervisor.mqtt.connection import BrokerConnection, BrokerError, encode
from gateway.supervisor.mqtt.interfaces import Orders
from gateway.supervisor.mqtt.settings import COMMANDS, Topics
from gateway.times import NS_PER_S

LONGEST_PAYLOAD: Final = 4096
LONGEST_SHOWN: Final = 200
LONGEST_TOPIC_SHOWN: Final = 256
"""Of a topic that a stranger chose."""
BURST: Final = 10
PER_S: Final = 1.0
"""So many commands may come at once, and then so many in a second."""

REPORT_AFTER_S: Final = 2.0
"""So long after a command that came too soon is told what became of it and of those after it."""
MANY_WAITING: Final = 64
"""Where so many wait, a command to switch off is not kept twice."""
MOST_WAITING: Final = 1024
"""More wait only where as many commands to switch off name different axes."""

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
class CommandResult:
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

    def as_data(self) -> JsonObject:
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


async def carry_out(command: str, payload: bytes, orders: Orders) -> CommandResult:
    """Do what a message asks for; what is wrong with it, or with doing it, is in the answer."""
    answer = CommandResult(command, shown_payload(payload))
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


async def _do(asked: _Asked, command: str, orders: Orders, answer: CommandResult) -> None:
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


@dataclass(slots=True)
class _Waiting:
    """A command that came and is not answered yet."""

    connection: BrokerConnection
    message: MQTTMessage
    command: str
    payload: bytes
    disables: frozenset[str] | None
    """The axes that it switches off; None for every other command."""
    missed: int = 0
    """So many before it were not carried out, and no answer has said so."""
    repeated: int = 0
    """So many others it stands for."""
    answer: CommandResult | None = None
    """Where it is known before its turn."""

    @property
    def shown(self) -> str:
        return f"{self.command[:64]} {shown_payload(self.payload)}".strip()


class Commander:
    """Listens for commands; outlives connections."""

    def __init__(self, topics: Topics, orders: Orders, log: LogEvent) -> None:
        self._waiting: deque[_Waiting | asyncio.Event] = deque()
        """In the order in which they came; an event is set when all before it have been answered."""
        self._has_more = asyncio.Event()
        self._topics = topics
        self._orders = orders
        self._log = log
        self._rate = bucket_of(PER_S, BURST)
        self._missed = 0
        """Commands that came too often, since the last one that was let through."""
        self._too_many = 0
        """Commands that were not carried out, and are not told of yet."""
        self._last_of_them = ""
        self._retained_seen: set[str] = set()

    def take(self, connection: BrokerConnection, message: MQTTMessage) -> None:
        """Have a command carried out in its turn, or say that it is not. Does not block."""
        command = self._topics.command_in(message.topic)
        if message.retain:
            self._ignore_retained(command, message.topic)
            return
        payload = bytes(message.payload)
        axes = disabled_axes(command, payload)
        now_ns = int(asyncio.get_running_loop().time() * NS_PER_S)
        entry = _Waiting(connection, message, command, payload, axes, missed=self._missed)
        if axes is not None and (same := self._same_waiting(axes)) is not None:
            same.repeated += 1
        elif len(self._waiting) < MOST_WAITING if axes is not None else self._rate.takes(now_ns):
            self._missed = 0
            self._wait(entry)
        else:
            self._missed += axes is None
            self._count_too_many(entry.shown)
            if axes is None and not entry.missed:  # one answer for all that follow
                text = f"more than {BURST} at once and {PER_S:g} a second: this and what follows is ignored"
                entry.answer = CommandResult(command[:64], None, problems=(text,))
                self._wait(entry)

    async def run(self) -> None:
        """Carry out what waits, until cancelled; what waits then is told of as not carried out."""
        try:
            while True:
                await self.carry_out_waiting()
                await self._has_more.wait()
                self._has_more.clear()
        finally:
            for each in self._waiting:
                if isinstance(each, _Waiting) and each.answer is None:
                    self._count_too_many(each.shown)
            self._report_too_many()

    async def carry_out_waiting(self) -> None:
        """Carry out and answer what waits, in the order in which it came."""
        while self._waiting:
            each = self._waiting.popleft()
            if isinstance(each, asyncio.Event):
                each.set()
                continue
            answer = each.answer
            if answer is None:
                answer = await carry_out(each.command, each.payload, self._orders)
            await self._answer(each, answer)

    async def finish(self) -> None:
        """Wait until what waits now has been answered."""
        done = asyncio.Event()
        self._wait(done)
        await done.wait()

    def _wait(self, entry: "_Waiting | asyncio.Event") -> None:
        self._waiting.append(entry)
        self._has_more.set()

    def _same_waiting(self, axes: frozenset[str]) -> "_Waiting | None":
        """Return the disable that stands for one more of the same axes, where many wait.

        None where something else waits behind it: that may switch on again what is to be off.
        """
        if len(self._waiting) < MANY_WAITING:
            return None
        for each in reversed(self._waiting):
            if isinstance(each, _Waiting) and each.disables != axes:
                if each.disables is None:
                    return None
            elif isinstance(each, _Waiting):
                return each
        return None

    def _count_too_many(self, last: str) -> None:
        """Tell of commands that nobody carries out, and which was the last: it is not what holds."""
        self._too_many += 1
        self._last_of_them = last
        if self._too_many == 1:
            asyncio.get_running_loop().call_later(REPORT_AFTER_S, self._report_too_many)

    def _report_too_many(self) -> None:
        count, self._too_many = self._too_many, 0
        if count:  # else the end has told of them
            self._log(MQTT_COMMANDS_TOO_MANY, count=count, last=self._last_of_them)

    async def _answer(self, entry: "_Waiting", answer: CommandResult) -> None:
        severity = Severity.INFO if answer.result == "done" else Severity.WARNING
        data = answer.as_data()
        if entry.missed:
            data["ignored_before"] = entry.missed
        if entry.repeated:
            data["repeated"] = entry.repeated
        self._log(MQTT_COMMAND, severity, **data)
        topic = getattr(entry.message.properties, "ResponseTopic", None)
        if topic is None or not self._may_answer(topic):
            return
        correlation = getattr(entry.message.properties, "CorrelationData", None)
        with contextlib.suppress(BrokerError):  # the connection has gone, and the event is told
            await entry.connection.publish(topic, encode(data), qos=1, correlation=correlation)

    def _may_answer(self, topic: str) -> bool:
        """Not under our own topics: answers would be status, or commands that are answered again."""
        is_own = topic == self._topics.root or topic.startswith(f"{self._topics.root}/")
        return bool(topic) and not is_own and not any(sign in topic for sign in "+#\0")

    def _ignore_retained(self, command: str, topic: str) -> None:
        counted = command if command in COMMANDS else "other"
        if counted not in self._retained_seen:
            self._retained_seen.add(counted)
            self._log(
                MQTT_COMMAND_IGNORED,
                command=command[:64],
                detail="it was published as retained: it would be obeyed again at every start. Take it away "
                f"{_how_to_clear(topic)}, and publish commands without retain",
            )


def _how_to_clear(topic: str) -> str:
    """Return how to clear a retained topic, which a stranger may have chosen, in a shell."""
    if topic.isprintable() and len(topic) <= LONGEST_TOPIC_SHOWN:
        return f"with: mosquitto_pub -r -n -t {shlex.quote(topic)}"
    return f"with an empty retained message to its topic, which is no name to type ({topic[:64]!a})"
