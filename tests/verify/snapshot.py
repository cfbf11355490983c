"""The state of a running line: kept, put back and compared. All that knows how the gateway is built is here.

A line is a graph of objects. What is there before the first frame stays for good (*standing* objects); what
comes and goes with frames hangs from it (*passing* objects: exchanges, readings). A snapshot holds the values
of all attributes that can change, by reference: nothing is copied, and putting it back writes into the same
objects what differs. For comparing, the same values are turned into hashable ones: instants become ages that
saturate, identities become ordinals, and what cannot matter is left out.
"""

from array import array
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import is_dataclass
from enum import Enum
from hashlib import blake2b
from operator import attrgetter, is_
from types import MemberDescriptorType, MethodType, ModuleType
from typing import Any, Final, NamedTuple

from msgspec import Struct

from gateway.compensation.axis import AxisCompensation
from gateway.exchange.axis.acknowledge import ON_WIRE_AFTER, SteadyTarget
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.gantry import GANTRY_AFTER
from gateway.exchange.axis.impossible import IGNORED
from gateway.exchange.axis.interlock import BLOCK_AFTER, Block
from gateway.exchange.axis.motion import MOTION_AFTER
from gateway.exchange.axis.reference import REFERENCE_AFTER
from gateway.exchange.axis.registers import Completeness
from gateway.exchange.cut_through.forward import Forwarder, RequestWay
from gateway.exchange.cut_through.frame import ForwardState
from gateway.exchange.line import LineExchange
from gateway.exchange.status import compensation_state, direction_state
from gateway.exchange.transaction import PHASE_AFTER, STOP_AFTER, Phase, Stopping
from gateway.times import NS_PER_MS

FIRST_INSTANT: Final = 10**17
"""Clocks of worlds begin beyond it: an integer as large is an instant, whatever it is called."""
LARGEST_NUMBER: Final = 1 << 40
"""Registers and durations are smaller; between the two lie identities of objects."""
UNIT_NS: Final = 10 * NS_PER_MS
"""Ages are compared in such units; everything in a world happens at multiples of a tick of several."""

LEFT_OUT: Final = {
    "plan": "compared by value where an axis has it; elsewhere it never changes",
    "counters": "figures for the status",
    "meter": "figures for the status",
    "hunting": "decides only whether an event is told",
    "_counters": "figures for the status",
    "_units": "what registers mean, and ways prepared from it: a cache",
    "_on_event": "a function of the world",
    "_link": "the world's",
    "units": "the same as _units, in the context of a line",
    "on_event": "the same as _on_event",
    "link": "the same as _link",
    "_refusals": "how often was told of a refusal",
    "_withdrawals": "the same of requests that were not sent",
    "_reports": "how often was told of something",
    "_reported": "how often was told of something",
    "_judged": "how often was told of something",
    "replies": "the world's",
    "written": "the world's",
    "stamps": "figures for the status",
    "asked_ns": "figures for the status",
    "_asked": "the same",
    "answered_ns": "figures for the status",
    "askers": "the same",
    "writer_conflicts": "figures for the status",
    "damage": "figures for the status",
    "whole": "the same",
    "_asked_unit_id": "of these figures",
    "_damaged_before": "the same",
    "requests": "figures for the status",
    "totals": "the same",
    "on_change": "a function of the world",
    "report_no_gain": "the same",
    "_before_last": "of a run of targets, which ends before a state is kept",
    "_position": "the same",
    "_extreme": "the same",
}
"""Attributes that are neither kept nor compared, by name."""
NOT_COMPARED: Final = {
    "_host_bytes": "how much of what is compared waits",
    "_left_ns": "of a frame that is cut through: for the count of torn ones and for what is learned alone",
    "_off_ns": "the same",
    "written_need_ns": "for what is learned alone",
    "own_ns": "the same",
    "_port_counts": "the same",
    "since_ns": "only told: axes keep their own",
    "timeouts": "only told: how many there were in a row is in the state",
    "_map": "a cache",
    "_map_key": "the key of a cache",
    "_arrived_ns": "only keeps the instants of requests apart",
    "_lost_ns": "counts only against requests that came before it: they are compared with it",
    "_heard_ns": "the same",
    "epoch": "counts only against what was sent before: that is compared with it",
    "blocked_in_epoch": "the same",
    "_at_ns": "of a run of targets, which ends before a state is kept",
    "reported_rewrite_ns": "counts a minute, longer than any trace; whether there is one the world knows",
    "at_ns": "moves a blend by time only, which no world has; of a target in a record ``World.key`` has it",
    "transaction_id": "only the reply carries it",
    "started_ns": "figures of an exchange",
    "queue_ns": "figures of an exchange",
    "added_ns": "figures of an exchange",
    "deadline_ns": "follows from when it was sent and from who waits",
    "_generation": "how often a record was written",
    "generation": "the same, in a record that was read: only told",
    "_specs": "a cache",
    "_good_reply": "a cache: what is the same is good again",
    "_replied_unit_id": "the key of a cache",
    "_replied_pdu": "the same",
    "_replied_frame": "a cache",
    "_specs_bytes": "a cache",
    "_tilts": "a cache",
    "_has_tail": "whether zeros have to be written again; no world has slopes of lines",
    "_is_boot_known": "whether the boot has to be written again",
    "_rendering": "a cache of the draft",
    "frame": "what the bytes of a request say: they are compared",
    "frames": "the same",
    "early_ns": "figures of an exchange",
    "led_by": "of a group: only told",
    "has_put_off": "the same",
    "is_skewed": "the same",
    "skew": "the same",
    "loss": "how a link ended: to a serial port, which no world closes in order, each is the same",
    "lost": "the same",
    "up_ns": "of connections alone, which no world has",
    "down_ns": "the same",
    "has_closed_soon": "of connections alone, which no world has",
    "_is_reported": "whether it was reported that the line is up again",
    "_detail": "what is told of one that is down",
}
"""Attributes that are put back and not compared, by name."""
NEEDS: Final[dict[str, Callable[[Any], bool]]] = {
    "_since_ns": lambda each: each.completeness is Completeness.PARTS_LOST,
    "_missing": lambda each: each.is_incomplete,
    "_parts": lambda each: each.completeness in (Completeness.PARTS_LOST, Completeness.PARTS_BUFFERED),
    "silent_until_ns": lambda each: each.silent_since_ns is not None,
    "heard_ns": lambda each: each.compensation.accepted is not None or each.unacknowledged is not None,
    "last_ns": lambda each: not each.is_shared,
    "bit_seen_ns": lambda each: each.follows_homed_bit,
    "homing_since_ns": lambda each: each.is_homing,
    "block_code": lambda each: each.is_blocked,
    "staged": lambda each: each.addresses or each.coils,  # else no trigger runs what was staged
    "_drained_at_last_ns": lambda each: each.is_draining,
    "_steady_map": lambda each: each.is_steady,
    "_last_byte_ns": lambda each: each._buffer,
    "_is_behind_frame": lambda each: each._buffer,
    "_last_ns": lambda each: (
        isinstance(each._way, RequestWay)
        and each._frame is not None
        and each._frame.state is ForwardState.BEGUN
    ),
    "_now_ns": lambda each: not isinstance(each, Forwarder),
}
"""Attributes that count only while something else holds; else they are taken for nothing."""
ONLY_OF_A_RECORD: Final = ("_way",)
"""Attributes that only a record asks for: compared where axes have one."""
DERIVED: Final[dict[str, Callable[[Any], Any]]] = {
    "silent_since_ns": lambda each: (
        None
        if each.silent_since_ns is None
        else (
            each.silent_until_ns - each.silent_since_ns > each.longest_silence_ns,
            each.silent_since_ns,
        )
    ),
}
"""What counts of attributes beside their values: a difference that saturated ages do not show."""
HORIZON_TICKS: Final = {
    "_since_ns": 3,
    "sent_off_ns": 2,
    "seen_ns": 2,
    "silent_until_ns": 2,
    "silent_since_ns": 3,
    "_frame_end_ns": 1,
}
"""Ages beyond which nothing asks, where that is earlier than the horizon of the world, in its ticks."""
LIVE_COUNTERS: Final = ("epoch", "blocked_in_epoch")
"""Numbers that only grow. What was sent carries one of its time and is compared with what it is by now."""
LIVE_INSTANTS: Final = ("_lost_ns", "_heard_ns")
"""The same for instants; what carries them is called as follows."""
CARRIED_INSTANT: Final = "arrived_ns"
CARRIED_COUNTERS: Final = ("epoch", "epochs")
SAME_INSTANTS: Final = ("newest_ns", "follows_ns")
"""Instants that are only asked whether they are one of the live ones: nothing came in between."""
SAME: Final = (("state.spec", "_wanted"),)
"""Attributes of an object of which it counts whether they are one and the same object."""
BY_VALUE: Final[dict[str, Callable[[Any], object]]] = {
    "Curve": lambda each: each.table,
    "CorrectionMap": lambda each: (each.terms, each.offset, each.tilt),
}
"""Classes whose objects never change, and what makes one as good as another."""
SETTINGS: Final = (".plan", ".motion", ".settings", ".table", ".registers", ".rights", ".unit", ".access")
"""Modules whose frozen objects are configuration: equal ones are the same."""


class Snapshot(NamedTuple):
    """One state of a line. Only good for the lens that took it."""

    now_ns: int
    values: tuple[tuple[Any, ...], ...]
    """Of each standing object."""
    tokens: tuple[int, ...]
    """Of each standing object: what it is worth in a comparison."""
    is_timed: tuple[bool, ...]
    """Of each standing object: whether that changes with time."""
    passing: tuple[tuple[Any, Any], ...]
    """Objects that come and go, each with its content."""

    @property
    def key(self) -> bytes:
        """What states that cannot be told apart have in common."""
        return blake2b(array("I", self.tokens).tobytes(), digest_size=12).digest()


def names_of(kind: type) -> tuple[str, ...]:
    """Return the names of the slots of a class and of those that it stands on; compiled, of its fields."""
    found: dict[str, None] = dict.fromkeys(getattr(kind, "__mypyc_attrs__", ()))
    for each in reversed(kind.__mro__):
        found.update((k, None) for k, v in vars(each).items() if isinstance(v, MemberDescriptorType))
    found.pop("__dict__", None)
    return tuple(found)


def _is_atom(kind: type) -> bool:
    return (
        issubclass(kind, bool | str | bytes | type | ModuleType | MethodType | memoryview)
        or kind is type(None)
        or (
            kind.__module__ in ("builtins", "struct", "functools", "_struct", "operator")
            and not issubclass(kind, list | dict | set | tuple | frozenset | bytearray | int | float)
        )
    )


CONTAINERS: Final = (list, dict, set, deque, bytearray)


def content_of(container: Any) -> tuple[Any, ...]:
    """Return what stands in a list, dict, set, deque or bytearray."""
    if isinstance(container, dict):
        return (*container, *container.values())
    if isinstance(container, bytearray):
        return (bytes(container),)
    return tuple(container)


def _refill(container: Any, content: tuple[Any, ...]) -> None:
    if isinstance(container, dict):
        half = len(content) // 2
        container.clear()
        container.update(zip(content[:half], content[half:], strict=True))
    elif isinstance(container, bytearray):
        container[:] = content[0]
    elif isinstance(container, list):
        container[:] = content
    else:
        container.clear()
        if isinstance(container, set):
            container.update(content)
        else:
            container.extend(content)


class Shape:
    """What is kept and compared of the standing objects of one class."""

    def __init__(self, example: object, *, has_record: bool) -> None:
        kind = type(example)
        found = dict.fromkeys((*names_of(kind), *getattr(example, "__dict__", {})))
        self.names = tuple(n for n in found if n not in LEFT_OUT)
        self.compared = tuple(i for i, name in enumerate(self.names) if name not in NOT_COMPARED)
        if not has_record:
            self.compared = tuple(i for i in self.compared if self.names[i] not in ONLY_OF_A_RECORD)
        self.horizons = {i: HORIZON_TICKS[n] for i, n in enumerate(self.names) if n in HORIZON_TICKS}
        self.derived = {i: DERIVED[n] for i, n in enumerate(self.names) if n in DERIVED}
        self.needs = {i: NEEDS[n] for i, n in enumerate(self.names) if n in NEEDS}
        self.live = tuple(i for i, name in enumerate(self.names) if name in LIVE_COUNTERS)
        self.same_instants = {i for i, name in enumerate(self.names) if name in SAME_INSTANTS}
        self.live_ns = tuple(i for i, name in enumerate(self.names) if name in LIVE_INSTANTS)
        self.has_plan = "plan" in found and hasattr(example.plan, "settings")  # type: ignore[attr-defined]
        if self.has_plan:
            self.names += ("plan",)
            self.compared += (len(self.names) - 1,)
        self.same = tuple(
            (attrgetter(a), attrgetter(b))
            for a, b in SAME
            if a.split(".", maxsplit=1)[0] in found and b in found
        )
        if len(self.names) == 1:
            one = attrgetter(self.names[0])
            self.get: Callable[[Any], tuple[Any, ...]] = lambda each: (one(each),)
        elif self.names:
            self.get = attrgetter(*self.names)
        else:
            self.get = lambda each: ()


class Kinds(dict[type, Callable[[Any], Any] | None]):
    """How a value of each type is turned into one that can be compared; None: it stays."""

    def __init__(self, find: Callable[[type], Callable[[Any], Any] | None]) -> None:
        super().__init__()
        self._find = find

    def __missing__(self, kind: type) -> Callable[[Any], Any] | None:
        found = self[kind] = self._find(kind)
        return found


class Lens:
    """Takes snapshots of what hangs from some objects, and puts them back."""

    def __init__(
        self, roots: Sequence[object], tick_ns: int, horizon_ticks: int, *, has_record: bool = False
    ) -> None:
        self._tick = tick_ns // UNIT_NS
        self._horizon = self._default_horizon = horizon_ticks * self._tick
        self._has_record = has_record
        self.objects: list[Any] = []
        self._ids: dict[int, int] = {}
        self._shapes: list[Shape | None] = []
        by_class: dict[type, Shape] = {}
        self.met: set[str] = set()
        """Names of all attributes, also of those left out."""
        self._find_standing(roots, by_class)
        self._compensations = [each for each in self.objects if isinstance(each, AxisCompensation)]
        self._kinds = Kinds(self._how)
        self._tokens_of: dict[Any, int] = {}
        self._frozen: dict[int, tuple[Any, Any]] = {}
        self._settings: list[Any] = []
        self._setting_ids: dict[int, tuple[Any, int]] = {}
        self._passing_shapes: dict[type, tuple[str, ...]] = {}
        self._passing: dict[int, tuple[Any, Any]] = {}
        self._passing_tokens: dict[int, Any] = {}
        self._is_timed = False
        self._now = 0
        self._live: list[int] = []
        self._live_ns: list[int | None] = []
        count = len(self.objects)
        self._last: list[tuple[Any, ...]] = [()] * count
        self._last_tokens: list[int] = [0] * count
        self._last_timed: list[bool] = [True] * count
        self._getters = [content_of if s is None else s.get for s in self._shapes]
        self._live_places = [(i, at) for i, s in enumerate(self._shapes) if s is not None for at in s.live]
        self._live_ns_places = [
            (i, at) for i, s in enumerate(self._shapes) if s is not None for at in s.live_ns
        ]

    def _find_standing(self, roots: Sequence[object], by_class: dict[type, Shape]) -> None:
        queue: deque[Any] = deque(roots)
        while queue:
            each = queue.popleft()
            kind = type(each)
            if isinstance(each, tuple):
                if not hasattr(each, "_fields"):
                    queue.extend(each)
                continue
            if id(each) in self._ids or _is_atom(kind) or isinstance(each, int | float | Enum | frozenset):
                continue
            if kind.__name__ in BY_VALUE or self._is_frozen(kind) or callable(each):
                continue
            self._ids[id(each)] = len(self.objects)
            self.objects.append(each)
            if isinstance(each, CONTAINERS):
                self._shapes.append(None)
                queue.extend(content_of(each))
                continue
            shape = by_class.get(kind)
            if shape is None:
                shape = by_class[kind] = Shape(each, has_record=self._has_record)
            self.met.update(names_of(kind), getattr(each, "__dict__", ()))
            self._shapes.append(shape)
            queue.extend(shape.get(each))

    @staticmethod
    def _is_frozen(kind: type) -> bool:
        if issubclass(kind, Struct):
            return kind.__struct_config__.frozen
        return is_dataclass(kind) and bool(kind.__dataclass_params__.frozen)  # type: ignore[attr-defined]

    def share(self, other: "Lens") -> None:
        """Count what states are worth together with another lens, so that both can be compared."""
        self._tokens_of, self._settings = other._tokens_of, other._settings

    # --- taking and putting back -----------------------------------------------------------------------

    def take(self, now_ns: int) -> Snapshot:
        """Return the state as it is now."""
        for compensation in self._compensations:
            assert compensation.state is not None  # which ends a run of targets
        self._now = now_ns
        self._passing = {}
        self._passing_tokens = {}
        last, tokens, timed = self._last, self._last_tokens, self._last_timed
        shapes, is_same = self._shapes, is_
        changed: list[int] = []
        for i, (each, get) in enumerate(zip(self.objects, self._getters, strict=True)):
            values, before = get(each), last[i]
            if len(values) == len(before) and all(map(is_same, values, before)):
                if timed[i]:
                    changed.append(i)
            else:
                last[i] = values
                changed.append(i)
        self._live = []
        self._live_ns = []
        numbers = self._tokens_of
        for i in changed:
            self._is_timed = False
            shape = shapes[i]
            if shape is None:
                found = self._container(self.objects[i], last[i])
            else:
                found = self._standing(self.objects[i], shape, last[i])
            timed[i] = self._is_timed
            number = numbers.get(found)
            if number is None:
                number = numbers[found] = len(numbers)
            tokens[i] = number
        return Snapshot(now_ns, tuple(last), tuple(tokens), tuple(timed), tuple(self._passing.values()))

    def restore(self, snapshot: Snapshot, *, is_live_known: bool = True) -> None:
        """Put a state back. ``is_live_known``: nothing has changed since the last snapshot or restoring."""
        last, is_same = self._last, is_
        for i, values in enumerate(snapshot.values):
            before = last[i]
            if values is before and is_live_known:
                continue
            each, shape = self.objects[i], self._shapes[i]
            if not (is_live_known and before):
                before = self._getters[i](each)
            last[i] = values
            if len(values) == len(before) and all(map(is_same, values, before)):
                continue
            if shape is None:
                _refill(each, values)
                continue
            for name, new, old in zip(shape.names, values, before, strict=True):
                if new is not old:
                    setattr(each, name, new)
        for each, content in snapshot.passing:
            if isinstance(each, CONTAINERS):
                _refill(each, content)
            else:
                self._put_back(each, content)
        self._last_tokens[:] = snapshot.tokens
        self._last_timed[:] = snapshot.is_timed

    def _put_back(self, each: Any, content: tuple[tuple[str, ...], dict[str, Any]]) -> None:
        slots, attributes = content
        for name, value in zip(self._passing_names(type(each)), slots, strict=True):
            setattr(each, name, value)
        if attributes:
            each.__dict__.clear()
            each.__dict__.update(attributes)

    # --- comparing -------------------------------------------------------------------------------------

    def parts(self, now_ns: int) -> dict[str, int]:
        """Return what each compared attribute is worth, by class and name: what splits states shows there."""
        self.take(now_ns)
        found: dict[str, int] = {}
        for number, (each, shape) in enumerate(zip(self.objects, self._shapes, strict=True)):
            name = f"{number} {type(each).__name__}"
            if shape is None:
                values: Iterable[tuple[str, Any]] = ((name, self._container(each, self._last[number])),)
            else:
                compared = self._standing(each, shape, self._last[number])
                names = [shape.names[at] for at in shape.compared] + ["same"] * len(shape.same)
                values = ((f"{name}.{n}", v) for n, v in zip(names, compared, strict=True))
            for key, value in values:
                found[key] = self._tokens_of.setdefault(value, len(self._tokens_of))
        return found

    def token(self, value: Any) -> int:
        """Return what a value of the world is worth in a comparison; its instants are seen from now."""
        found = self._of(value)
        return self._tokens_of.setdefault(found, len(self._tokens_of))

    def _of(self, value: Any) -> Any:
        how = self._kinds[type(value)]
        return value if how is None else how(value)

    def _standing(self, each: Any, shape: Shape, values: tuple[Any, ...]) -> Any:
        kinds, needs = self._kinds, shape.needs
        found: list[Any] = []
        for at in shape.compared:
            value = values[at]
            if needs and at in needs and not needs[at](each):
                found.append(None)
                continue
            if at in shape.same_instants:
                found.append(self._same_instant(value))
                continue
            if at in shape.derived:
                value = shape.derived[at](each)
            how = kinds[type(value)]
            if at in shape.horizons:
                self._horizon = shape.horizons[at] * self._tick
                found.append(value if how is None else how(value))
                self._horizon = self._default_horizon
                continue
            found.append(value if how is None else how(value))
        found += [a(each) is b(each) for a, b in shape.same]
        return tuple(found)

    def _container(self, each: Any, content: tuple[Any, ...]) -> Any:
        kinds = self._kinds
        found = [value if (how := kinds[type(value)]) is None else how(value) for value in content]
        if isinstance(each, dict):
            half = len(found) // 2
            return frozenset(zip(found[:half], found[half:], strict=True))
        return frozenset(found) if isinstance(each, set) else tuple(found)

    def _how(self, kind: type) -> Callable[[Any], Any] | None:
        if issubclass(kind, Enum):
            return lambda value: value._name_
        if _is_atom(kind):
            return None if issubclass(kind, bool | str | bytes) or kind is type(None) else lambda value: None
        if kind is int:
            return self._number
        if kind is float:
            return lambda value: round(value, 6)
        if kind.__name__ in BY_VALUE:
            what = BY_VALUE[kind.__name__]
            return lambda value: self._remembered(value, lambda each: self._of(what(each)))
        if issubclass(kind, tuple):
            return self._tuple if not hasattr(kind, "_fields") else self._fields_of(kind, kind._fields)
        if issubclass(kind, frozenset):
            return lambda value: frozenset(map(self._of, value))
        if self._is_frozen(kind):
            if kind.__module__.endswith(SETTINGS) and kind.__name__ != "FieldHit":
                return self._setting
            is_struct = issubclass(kind, Struct)
            names = kind.__struct_fields__ if is_struct else tuple(kind.__dataclass_fields__)  # type: ignore[attr-defined]
            return self._fields_of(kind, names)
        if issubclass(kind, array):
            return lambda value: value.tobytes()
        if issubclass(kind, CONTAINERS):
            return self._passing_container
        return self._passing_object

    def _number(self, value: int) -> Any:
        if -LARGEST_NUMBER < value < LARGEST_NUMBER:
            return value
        if value >= FIRST_INSTANT:
            self._is_timed = True
            age = (self._now - value + UNIT_NS // 2) // UNIT_NS
            return ("age", min(max(age, -self._horizon), self._horizon))
        return ("id", self._ids.get(value, -1))

    def _tuple(self, value: tuple[Any, ...]) -> Any:
        kinds = self._kinds
        return tuple([each if (how := kinds[type(each)]) is None else how(each) for each in value])

    def _fields_of(self, kind: type, names: tuple[str, ...]) -> Callable[[Any], Any]:
        self.met.update(names)
        special = dict.fromkeys(CARRIED_COUNTERS, self._carried_counter)
        special[CARRIED_INSTANT] = self._carried_instant
        special |= dict.fromkeys(SAME_INSTANTS, self._same_instant)
        hows = tuple(special.get(name) for name in names)
        kept = tuple(i for i, name in enumerate(names) if name not in NOT_COMPARED or hows[i])
        is_tuple = issubclass(kind, tuple)
        get = attrgetter(*names) if len(names) > 1 else lambda each: (getattr(each, names[0]),)
        name = kind.__name__

        def hashable(value: Any) -> Any:
            values = tuple(value) if is_tuple else get(value)
            kinds, found = self._kinds, [name]
            for at in kept:
                if at < len(values):  # some are made with fewer fields than their class names
                    how = hows[at] or kinds[type(values[at])]
                    found.append(values[at] if how is None else how(values[at]))
            return tuple(found)

        return lambda value: self._remembered(value, hashable)

    def _remembered(self, value: Any, hashable: Callable[[Any], Any]) -> Any:
        """Turn an object that never changes, once for all unless instants or passing objects hang from it."""
        known = self._frozen.get(id(value))
        if known is not None:
            return known[1]
        was_timed, self._is_timed = self._is_timed, False
        found = hashable(value)
        if not self._is_timed:
            found = ("#", self._tokens_of.setdefault(found, len(self._tokens_of)))
            if len(self._frozen) > 200_000:
                self._frozen.clear()
            self._frozen[id(value)] = (value, found)
        self._is_timed |= was_timed
        return found

    def _setting(self, value: Any) -> Any:
        known = self._setting_ids.get(id(value))
        if known is not None:
            return known[1]
        at = next(
            (i for i, each in enumerate(self._settings) if type(each) is type(value) and each == value), -1
        )
        if at < 0:
            at = len(self._settings)
            self._settings.append(value)
        if len(self._setting_ids) > 20_000:
            self._setting_ids.clear()
        self._setting_ids[id(value)] = (value, at)
        return at

    # --- what passes -----------------------------------------------------------------------------------

    def _passing_names(self, kind: type) -> tuple[str, ...]:
        names = self._passing_shapes.get(kind)
        if names is None:
            names = self._passing_shapes[kind] = names_of(kind)
            self.met.update(names)
        return names

    def _passing_object(self, each: Any) -> Any:
        at = self._ids.get(id(each))
        if at is not None:
            return ("@", at)
        if callable(each) and not hasattr(each, "__slots__"):
            return None
        self._is_timed = True
        if id(each) in self._passing:
            return self._passing_tokens.get(id(each), "~")
        names = self._passing_names(type(each))
        slots = tuple([getattr(each, name) for name in names])
        attributes = dict(getattr(each, "__dict__", ()))
        self._passing[id(each)] = (each, (slots, attributes))
        self.met.update(attributes)
        found: list[Any] = [type(each).__name__]
        pairs = [*zip(names, slots, strict=True), *sorted(attributes.items())]
        for name, value in pairs:
            if name == "path":
                found.append(value is not None)
            elif name in ("target", "_target"):
                found.append(None if value is None else self._draft(value))
            elif name in CARRIED_COUNTERS:
                found.append(self._carried_counter(value))
            elif name == CARRIED_INSTANT:
                found.append(self._carried_instant(value))
            elif name in SAME_INSTANTS:
                found.append(self._same_instant(value))
            elif name in HORIZON_TICKS:
                self._horizon = HORIZON_TICKS[name] * self._tick
                found.append(self._of(value))
                self._horizon = self._default_horizon
            elif not (name in NOT_COMPARED or name in LEFT_OUT or value is None or value in ("", ())):
                found.append((name, self._of(value)))
        token = self._passing_tokens[id(each)] = tuple(found)
        return token

    def _passing_container(self, each: Any) -> Any:
        at = self._ids.get(id(each))
        if at is not None:
            return ("@", at)
        content = content_of(each)
        self._is_timed = True
        self._passing[id(each)] = (each, content)
        return self._container(each, content)

    def _draft(self, draft: SteadyTarget) -> Any:
        """A target on the fast path carries a counter, and the instant of its sending."""
        said = draft.nominal_words, draft.corrected_words, draft.corrected_counts
        return (*map(self._of, said), self._carried_counter(draft.epoch), draft.steady is not None)

    def _carried_counter(self, value: Any) -> Any:
        self._is_timed = True
        if isinstance(value, dict):
            return frozenset((self._of(k), self._carried_counter(v)) for k, v in value.items())
        if not self._live:
            self._live = [self._last[i][at] for i, at in self._live_places]
        return tuple((value > live) - (value < live) for live in self._live)

    def _carried_instant(self, value: int) -> Any:
        lost = self._live_instants()
        return (self._number(value), tuple((value > each) - (value < each) for each in lost))

    def _same_instant(self, value: int) -> Any:
        return tuple(value == each != 0 for each in self._live_instants())

    def _live_instants(self) -> list[int]:
        self._is_timed = True
        if not self._live_ns:
            self._live_ns = [self._last[i][at] for i, at in self._live_ns_places]
        return [each for each in self._live_ns if each is not None]


# --- what is said of a line ---------------------------------------------------------------------------


class Said(NamedTuple):
    """What a line says of one axis."""

    compensation: str
    direction: str
    is_referenced: bool
    is_reference_told: bool
    """Whether the drive was ever asked, where it decides."""
    is_blocked: bool
    """Whether its triggers are refused, for its own sake or for that of its group."""
    is_own_blocked: bool
    target_counts: float | None
    """The last target that it is told to have."""


def said(line: LineExchange) -> tuple[Said, ...]:
    """Return what a line says of each axis, as its status does."""
    return tuple(said_of(axis) for axis in line.axes)


def _state_apart_from_block(axis: Axis) -> str:
    """Return what decides where targets go; that triggers are refused is said apart."""
    state = compensation_state(axis)
    if state != "blocked":
        return state
    if not axis.correction.is_enabled:
        return "off"
    return state if axis.reference.is_referenced else "unreferenced"


def said_of(axis: Axis) -> Said:
    """Return what a line says of one of its axes, as its status does."""
    accepted = axis.compensation.accepted
    return Said(
        _state_apart_from_block(axis),
        direction_state(axis),
        axis.reference.is_referenced,
        axis.reference.was_reported,
        axis.blocked_by is not None,
        axis.interlock.block is not Block.NONE,
        None if accepted is None else accepted.nominal_counts,
    )


def refused(line: LineExchange) -> int:
    """Return how many requests a line has refused, as its status says."""
    return line.counters.refused


def is_resting(line: LineExchange) -> bool:
    """Whether a line, or the drive on it that was silent last, falls silent before anything else leaves."""
    return line.rest.until_ns is not None or line.silent_units.awaits_late_reply


def stopping_of(line: LineExchange) -> Stopping:
    """Return how often the frame on the wire leaves for a stop, and whether a late reply may come."""
    current = line._transactions.current
    return Stopping.NO if current is None else current.stopping


class OnItsWay(NamedTuple):
    """What is known of the request whose frame, or whose prerequisite, has left."""

    phase: Phase
    may_follow: frozenset[Phase]
    """Phases that its table lets follow where it waits again after a frame that it needed."""
    held_up_ns: int
    """How long it had waited for the line and for frames of the gateway's own, by its figures."""


def on_its_way(line: LineExchange) -> OnItsWay | None:
    """Return what is known of the request that is on the wire; None where nothing is."""
    current = line._transactions.current
    if current is None:
        return None
    may_follow = frozenset(PHASE_AFTER[current.phase].values())
    return OnItsWay(current.phase, may_follow, current.queue_ns + current.added_ns)


def watch_stores(axis: Axis, may_store: Callable[[], bool]) -> None:
    """Ask before each store of a record of an axis; what is asked may raise."""
    assert axis.recall.record is not None
    axis.recall.record._slots._may_store = may_store


def is_sending_unsure(line: LineExchange) -> bool:
    """Whether the frame on the wire carries a target whose branch was assumed; the fast path takes none."""
    exchange = line._transactions.current
    return exchange is not None and _holds_unsure(exchange._requests, 0)


def _holds_unsure(value: Any, depth: int) -> bool:
    if depth > 9:
        return False
    if isinstance(value, dict):
        return any(_holds_unsure(each, depth + 1) for each in value.values())
    if isinstance(value, tuple | list):
        return getattr(value, "is_unsure", False) or any(_holds_unsure(each, depth + 1) for each in value)
    found = (getattr(value, name, None) for name in ("commands", "targets", "runs"))
    return any(_holds_unsure(each, depth + 1) for each in found if each)


TAKEN: Final[set[str]] = set()
"""Names of the rows of tables that were taken and change something."""


class WatchedRows(dict[Any, Any]):
    """The rows of one state, which note what of them is taken."""

    def __init__(self, prefix: str, state: Enum, rows: dict[Any, Any]) -> None:
        super().__init__(rows)
        changing = [event for event, after in rows.items() if after is not IGNORED]
        self.names = {event: f"{prefix}{state.value} + {event.value}" for event in changing}
        self.looked_up: set[Any] = set()
        """Events of which a row was asked for, whether it changes something or not."""

    def __getitem__(self, event: Any) -> Any:
        self._note(event)
        return super().__getitem__(event)

    def get(self, event: Any, default: Any = None) -> Any:
        """See dict."""
        self._note(event)
        return super().get(event, default)

    def _note(self, event: Any) -> None:
        self.looked_up.add(event)
        name = self.names.get(event)
        if name is not None:
            TAKEN.add(name)


_TABLES: Final[tuple[tuple[str, dict[Any, Any]], ...]] = (
    ("", MOTION_AFTER),
    ("", BLOCK_AFTER),
    *((f"{way.value} + ", rows) for way, rows in REFERENCE_AFTER.items()),
    ("gantry: ", GANTRY_AFTER),
    ("on the wire: ", ON_WIRE_AFTER),
    ("request: ", PHASE_AFTER),
    ("stop: ", STOP_AFTER),
)
"""The tables of states, each with what stands before the names of its rows."""


def watch_tables() -> None:
    """Let the tables note what is taken of them."""
    for prefix, table in _TABLES:
        for state, rows in table.items():
            if not isinstance(rows, WatchedRows):
                table[state] = WatchedRows(prefix, state, rows)


def is_watched(table: object) -> bool:
    """Whether it is noted which rows of a table are asked for."""
    return any(each is table for _, each in _TABLES) or table is REFERENCE_AFTER


def all_rows() -> set[str]:
    """Return the names of all rows of the tables that change something."""
    watch_tables()
    return {name for _, table in _TABLES for rows in table.values() for name in rows.names.values()}


def dead_names(met: Iterable[str]) -> list[str]:
    """Return the names in the lists above that no object has."""
    there = set(met)
    listed = {*LEFT_OUT, *NOT_COMPARED, *NEEDS, *LIVE_COUNTERS, *LIVE_INSTANTS, *DERIVED, *HORIZON_TICKS}
    return sorted(listed - there)
