"""Commands over MQTT: reload, switch compensation on and off, set gains. Nothing moves.

Commands are executed one after the other, in the order of arrival, and each is answered. Commands that come
too fast are counted and reported, with the last of them by name. A command that switches off is never dropped
for that, unless ``MOST_WAITING`` commands wait.
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
from gateway.exchange.commands import Command, Disable, Enable, SetGain, Share
from gateway.ipc.client import NoGatewayError
from gateway.ipc.messages import Done
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
"""Of a received topic."""
BURST: Final = 10
PER_S: Final = 1.0
"""Rate limit: so many commands in a burst, and then so many each second."""

REPORT_AFTER_S: Final = 2.0
"""Time from the first command that came too fast to the report on it and those after it."""
MANY_WAITING: Final = 64
"""From so many waiting commands on, a command to switch off is queued only once."""
MOST_WAITING: Final = 1024
"""More commands wait only if as many commands to switch off name different axes."""

Id = Annotated[str, msgspec.Meta(max_length=64)] | int | None
"""The client's own identifier, repeated in the answer."""
AxisName = Annotated[str, msgspec.Meta(max_length=32)]
Axes = Literal["all"] | Annotated[tuple[AxisName, ...], msgspec.Meta(min_length=1, max_length=64)]


class _Asked(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    id: Id = None


class _WithId(msgspec.Struct, frozen=True):
    id: Id = None


class _OnAxes(_Asked, frozen=True, kw_only=True):
    axes: Axes

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the axes, as the relay takes them; empty: all axes."""
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
    """The result of a command."""

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
    """Execute the command of a message.

    The result contains what is wrong with the message or its execution.
    """
    answer = CommandResult(command, shown_payload(payload), id_in(payload))
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
    try:
        await _do(asked, command, orders, answer)
    except NoGatewayError as error:
        answer.problems = (str(error),)
    except Exception as error:  # noqa: BLE001 - a bug in one command must not cost those behind it
        answer.problems = (f"an error in the gateway: {type(error).__name__}: {error}",)
    return answer


async def _do(asked: _Asked, command: str, orders: Orders, answer: CommandResult) -> None:
    request: Command
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
        orders.done(request, reply.changed)
        answer.changed, answer.comes, answer.problems = reply.changed, reply.comes, reply.problems
    else:
        answer.problems = (f"answered by {type(reply).__name__}",)


def disabled_axes(command: str, payload: bytes) -> frozenset[str] | None:
    """Return the axes that a command switches off; empty: all axes. None: another command."""
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


def id_in(payload: bytes) -> Id:
    """Return the client's identifier, also of a command that is refused; None: no usable one."""
    if len(payload) > LONGEST_PAYLOAD:
        return None
    try:
        return msgspec.json.decode(payload, type=_WithId).id
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None


def shown_payload(payload: bytes) -> str:
    """Return the beginning of a received payload, as text."""
    return payload[:LONGEST_SHOWN].decode(errors="replace")


@dataclass(slots=True)
class _Waiting:
    """A command that was received and not answered yet."""

    connection: BrokerConnection
    message: MQTTMessage
    command: str
    payload: bytes
    disables: frozenset[str] | None
    """The axes that it switches off; None for every other command."""
    missed: int = 0
    """Number of commands before it that were not executed and that no answer has reported."""
    repeated: int = 0
    """Number of equal commands that it replaces."""
    answer: CommandResult | None = None
    """The answer, if it is known before the command's turn."""

    @property
    def shown(self) -> str:
        return f"{self.command[:64]} {shown_payload(self.payload)}".strip()


class Commander:
    """Queues and executes commands; outlives connections."""

    def __init__(self, topics: Topics, orders: Orders, log: LogEvent) -> None:
        self._waiting: deque[_Waiting | asyncio.Event] = deque()
        """In the order of arrival. An event is set when all commands before it have been answered."""
        self._has_more = asyncio.Event()
        self._topics = topics
        self._orders = orders
        self._log = log
        self._rate = bucket_of(PER_S, BURST)
        self._missed = 0
        """Commands that came too fast, since the last one that was admitted."""
        self._too_many = 0
        """Commands that were not executed and not reported yet."""
        self._last_of_them = ""
        self._retained_seen: set[str] = set()

    def take(self, connection: BrokerConnection, message: MQTTMessage) -> None:
        """Queue a command, or report that it is not executed. Does not block."""
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
                text = (
                    f"too many commands: at most {BURST} at once and {PER_S:g} a second are allowed; this "
                    "command and the next ones are ignored"
                )
                entry.answer = CommandResult(command[:64], None, id_in(payload), problems=(text,))
                self._wait(entry)

    async def run(self) -> None:
        """Execute waiting commands until cancelled; then report those that still wait as not executed."""
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
        """Execute and answer the waiting commands in the order of arrival."""
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
        """Wait until the commands that wait now have been answered."""
        done = asyncio.Event()
        self._wait(done)
        await done.wait()

    def _wait(self, entry: "_Waiting | asyncio.Event") -> None:
        self._waiting.append(entry)
        self._has_more.set()

    def _same_waiting(self, axes: frozenset[str]) -> "_Waiting | None":
        """Return the waiting disable of the same axes, if many commands wait.

        None if another command waits behind it, which may switch on again what is to be off.
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
        """Count a command that is not executed, and report the count with the last command."""
        self._too_many += 1
        self._last_of_them = last
        if self._too_many == 1:
            asyncio.get_running_loop().call_later(REPORT_AFTER_S, self._report_too_many)

    def _report_too_many(self) -> None:
        count, self._too_many = self._too_many, 0
        if count:  # otherwise the end has reported them
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
        with contextlib.suppress(BrokerError):  # the connection is lost, and the event is reported
            await entry.connection.publish(topic, encode(data), qos=1, correlation=correlation)

    def _may_answer(self, topic: str) -> bool:
        """Whether an answer may go to a topic.

        Not to our own: it would be taken for status or for a command.
        """
        is_own = topic == self._topics.root or topic.startswith(f"{self._topics.root}/")
        return bool(topic) and not is_own and not any(sign in topic for sign in "+#\0")

    def _ignore_retained(self, command: str, topic: str) -> None:
        counted = command if command in COMMANDS else "other"
        if counted not in self._retained_seen:
            self._retained_seen.add(counted)
            self._log(
                MQTT_COMMAND_IGNORED,
                command=command[:64],
                detail="publish commands without retain, because a retained one would be executed again at "
                f"every start; remove this one {_how_to_clear(topic)}",
            )


def _how_to_clear(topic: str) -> str:
    """Return a shell command that clears a retained topic. A topic is untrusted text."""
    if topic.isprintable() and len(topic) <= LONGEST_TOPIC_SHOWN:
        return f"with: mosquitto_pub -r -n -t {shlex.quote(topic)}"
    return f"with an empty retained message to its topic, which cannot be typed ({topic[:64]!a})"
