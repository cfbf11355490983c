"""What docs/state-machine.md has from the code: states, events, the tables of both, and two pictures."""

import ast
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Final, TypeVar

from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.interlock import BLOCK_AFTER, Block, BlockEvent
from gateway.exchange.axis.motion import (
    MOTION_AFTER,
    TARGETED,
    WAS_THERE,
    MotionEvent,
    MotionState,
)
from gateway.exchange.axis.reference import (
    REFERENCE_AFTER,
    REFERENCE_AT_START,
    ReferenceEvent,
    ReferenceState,
)
from gateway.exchange.cut_through.frame import FORWARD_AFTER, ForwardEvent, ForwardState
from gateway.exchange.plan import Reference
from gateway.exchange.silent_units import REACH_AFTER, Reach, Sign
from gateway.exchange.transaction import PHASE_AFTER, STOP_AFTER, Phase, Step, StopEvent, Stopping
from tools.diagram import ANY, Arrows, Box, Layout, LayoutError, Route, drawn
from tools.markers import table

ROOT: Final = Path(__file__).parents[1]

State = TypeVar("State", bound=Enum)
Event = TypeVar("Event", bound=Enum)

GROUPS: Final[Mapping[str, frozenset[MotionState]]] = {"targeted": TARGETED, "was there": WAS_THERE}
"""States from which an event often leads to the same one: the picture has a frame around each."""
MOTION_LAYOUT: Final = Layout(
    "state-machine-motion.svg",
    "Where an axis is, and what leads from one state to another",
    900,
    650,
    nodes={
        ANY: (138, 50),
        "unknown": (190, 612),
        "stopped": (760, 612),
        "superseded": (500, 612),
        "unacknowledged": (138, 165),
        "moving": (577, 160),
        "done-reported": (350, 310),
        "in-window": (804, 310),
        "arrived": (577, 310),
        "may-have-left": (577, 450),
        "at-rest": (804, 450),
    },
    frames={
        "targeted": Box(258, 95, 634, 425),
        "was there": Box(270, 240, 614, 265),
    },
    routes={
        (ANY, "moving"): Route(((178, 50), (577, 50), (577, 140)), (320, 43), "middle"),
        (ANY, "unacknowledged"): Route(((138, 68), (138, 145)), (144, 96)),
        (ANY, "unknown"): Route(((98, 50), (25, 50), (25, 612), (120, 612)), (72, 605), "middle"),
        ("unacknowledged", "moving"): Route(((208, 165), (507, 165)), (390, 158), "middle"),
        ("unacknowledged", "unknown"): Route(((150, 185), (150, 592)), (144, 470), "end", is_stacked=True),
        ("moving", "done-reported"): Route(((530, 180), (530, 230), (350, 230), (350, 290)), (400, 223)),
        ("moving", "arrived"): Route(((577, 180), (577, 290)), (571, 275), "end"),
        ("moving", "in-window"): Route(((647, 165), (850, 165), (850, 290)), (730, 158), "middle"),
        ("in-window", "moving"): Route(
            ((780, 290), (780, 225), (620, 225), (620, 180)), (715, 219), "middle"
        ),
        ("done-reported", "arrived"): Route(((420, 310), (507, 310)), (463, 303), "middle"),
        ("in-window", "arrived"): Route(((734, 310), (647, 310)), (691, 303), "middle"),
        ("done-reported", "may-have-left"): Route(((350, 330), (350, 450), (507, 450)), (430, 443), "middle"),
        ("arrived", "may-have-left"): Route(((577, 330), (577, 430)), (571, 385), "end"),
        ("may-have-left", "at-rest"): Route(((647, 450), (734, 450)), (691, 443), "middle"),
        ("arrived", "at-rest"): Route(((610, 330), (610, 362), (804, 362), (804, 430)), (720, 355), "middle"),
        ("at-rest", "may-have-left"): Route(
            ((760, 470), (760, 490), (600, 490), (600, 470)), (680, 483), "middle"
        ),
        ("at-rest", "arrived"): Route(((740, 430), (740, 398), (630, 398), (630, 330)), (685, 391), "middle"),
        ("group was there", "unknown"): Route(((270, 400), (242, 400), (242, 592)), (248, 540)),
        ("group targeted", "superseded"): Route(((500, 520), (500, 592)), (506, 548), is_stacked=True),
        ("group targeted", "stopped"): Route(((760, 520), (760, 592)), (766, 560)),
        ("superseded", "unknown"): Route(((430, 612), (260, 612)), (345, 585), "middle", is_stacked=True),
    },
)
PHASES_LAYOUT: Final = Layout(
    "state-machine-phases.svg",
    "The phases of a transaction, and how it may end in each",
    900,
    390,
    nodes={
        "waiting": (110, 170),
        "prerequisite": (400, 60),
        "leaving": (400, 300),
        "sent": (400, 170),
        "ended": (800, 170),
    },
    routes={
        ("waiting", "prerequisite"): Route(((90, 150), (90, 50), (330, 50)), (210, 43), "middle"),
        ("prerequisite", "waiting"): Route(((330, 72), (130, 72), (130, 150)), (210, 91), "middle"),
        ("waiting", "sent"): Route(((180, 170), (330, 170)), (255, 163), "middle"),
        ("sent", "ended"): Route(((470, 170), (730, 170)), (600, 189), "middle", is_stacked=True),
        ("prerequisite", "ended"): Route(((470, 60), (800, 60), (800, 150)), (640, 53), "middle"),
        ("waiting", "leaving"): Route(((130, 190), (130, 300), (330, 300)), (230, 293), "middle"),
        ("leaving", "sent"): Route(((400, 280), (400, 190)), (408, 240)),
        ("leaving", "ended"): Route(((470, 300), (780, 300), (780, 190)), (640, 293), "middle"),
        ("waiting", "ended"): Route(((90, 190), (90, 365), (800, 365), (800, 190)), (300, 358), "middle"),
    },
)


# --- meanings ----------------------------------------------------------------------------------------------


@cache
def _tree(module: str) -> ast.Module:
    path = ROOT.joinpath(*module.split(".")).with_suffix(".py")
    return ast.parse(path.read_bytes())


def _class(found: type) -> ast.ClassDef:
    [node] = [
        each
        for each in _tree(found.__module__).body
        if isinstance(each, ast.ClassDef) and each.name == found.__name__
    ]
    return node


def meanings(enum: type[Enum]) -> dict[Enum, str]:
    """Return what each member means: the string below it in the source.

    Raises:
        LayoutError: one has none.
    """
    found: dict[Enum, str] = {}
    body = _class(enum).body
    for node, below in zip(body, [*body[1:], None], strict=True):
        if not (isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)):
            continue
        name = node.targets[0].id
        if name.startswith("_"):
            continue
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            found[enum[name]] = _one_line(str(below.value.value))
        else:
            raise LayoutError(f"{enum.__module__}: {enum.__name__}.{name} has no docstring")
    return found


def _one_line(text: str) -> str:
    return " ".join(text.split()).replace("``", "`")


def _rows_of(members: Iterable[Enum]) -> list[tuple[str, ...]]:
    return [(f"`{member.value}`", meanings(type(member))[member]) for member in members]


# --- parts of the page -------------------------------------------------------------------------------------


def flat(rows: Mapping[State, Mapping[Event, State | None]]) -> dict[tuple[State, Event], State]:
    """Return what a table changes, by state and event."""
    return {
        (state, event): then for state, row in rows.items() for event, then in row.items() if then is not None
    }


def absent(
    rows: Mapping[State, Mapping[Event, State | None]], events: Iterable[Event]
) -> frozenset[tuple[State, Event]]:
    """Return the pairs of state and event for which a table has no row: they cannot be."""
    return frozenset((state, event) for state, row in rows.items() for event in events if event not in row)


def motion() -> str:
    """Return the states, events and table of where an axis is."""
    events = list(MotionEvent)
    return _machine(list(MotionState), events, flat(MOTION_AFTER), absent(MOTION_AFTER, events))


def blocks() -> str:
    """Return the states, events and table of what blocks triggers."""
    events = list(BlockEvent)
    return _machine(list(Block), events, flat(BLOCK_AFTER), absent(BLOCK_AFTER, events))


def references() -> str:
    """Return the states, events and tables of the reference, by each way in which it is known."""
    parts = [
        table(("state", "means"), _rows_of(ReferenceState)),
        table(("event", "means"), _rows_of(ReferenceEvent)),
    ]
    for kind, description in meanings(Reference).items():
        assert isinstance(kind, Reference)
        rows = REFERENCE_AFTER[kind]
        events = [event for event in ReferenceEvent if any(event in row for row in rows.values())]
        parts.append(
            f"### `{kind.value}`\n\n{description} At the start: `{REFERENCE_AT_START[kind].value}`.\n\n"
            + _tables(list(rows), events, flat(rows), absent(rows, events))
        )
    return "\n".join(parts)


def transactions() -> str:
    """Return the phases of a transaction, what takes it from one to the next, and how it may end in each."""
    phases, after = list(Phase), flat(PHASE_AFTER)
    parts = [table(("phase", "means"), _rows_of(Phase))]
    for name, events in (("step", list(Step)), ("outcome", list(Outcome))):
        parts.append(table((name, "means"), _rows_of(events)))
        parts.append(_tables(phases, events, after, absent(PHASE_AFTER, events)))
    return "\n".join(parts)


def stops() -> str:
    """Return whether a request is a stop, how often it leaves for that, and where each event leads."""
    events = list(StopEvent)
    return _machine(list(Stopping), events, flat(STOP_AFTER), absent(STOP_AFTER, events))


def reaches() -> str:
    """Return how far a unit id is from answering, what is seen of it, and where that leads."""
    return _machine(list(Reach), list(Sign), REACH_AFTER)


def cuts() -> str:
    """Return how far a frame has come that leaves while it arrives, and where each event leads."""
    events = list(ForwardEvent)
    return _machine(list(ForwardState), events, flat(FORWARD_AFTER), absent(FORWARD_AFTER, events))


def _machine(
    states: Sequence[State],
    events: Sequence[Event],
    after: Mapping[tuple[State, Event], State],
    absent: frozenset[tuple[State, Event]] = frozenset(),
) -> str:
    return "\n".join(
        (
            table(("state", "means"), _rows_of(states)),
            table(("event", "means"), _rows_of(events)),
            _tables(states, events, after, absent),
        )
    )


def _tables(
    states: Sequence[State],
    events: Sequence[Event],
    after: Mapping[tuple[State, Event], State],
    absent: frozenset[tuple[State, Event]] = frozenset(),
) -> str:
    """Return what each event makes of each state; first those that make the same of all."""
    common = {event: then for event in events if (then := _of_any(states, event, after)) is not None}
    others = [event for event in events if event not in common]
    parts = []
    if common:
        lines = [(f"`{event.value}`", f"`{then.value}`") for event, then in common.items()]
        parts.append(table(("event, in any state", "leads to"), lines))
    if others:
        rows = [
            (
                f"`{state.value}`",
                *("×" if (state, e) in absent else _cell(after.get((state, e))) for e in others),
            )
            for state in states
        ]
        parts.append(table(("state", *(str(event.value) for event in others)), rows))  # narrow enough
    return "\n".join(parts)


def _cell(state: Enum | None) -> str:
    return "" if state is None else str(state.value)


def _of_any(
    states: Sequence[State], event: Event, after: Mapping[tuple[State, Event], State]
) -> State | None:
    """Return what an event makes of every state; None where that is not one."""
    found = {after.get((state, event)) for state in states}
    return found.pop() if len(found) == 1 else None


def _reached(start: State, after: Mapping[tuple[State, Event], State]) -> list[State]:
    """Return the states that are reached from one, in the order of their definition."""
    reached = {start}
    while more := {then for (state, _), then in after.items() if state in reached} - reached:
        reached |= more
    return [state for state in type(start) if state in reached]


# --- pictures ----------------------------------------------------------------------------------------------


def arrows_of(
    states: Sequence[State],
    events: Sequence[Event],
    after: Mapping[tuple[State, Event], State],
    groups: Mapping[str, frozenset[State]],
) -> Arrows:
    """Return the arrows of a table, from as few ends as possible: any state, a group, or a state."""
    arrows: dict[tuple[str, str], tuple[str, ...]] = {}
    for event in events:
        for target in states:
            sources = {state for state in states if after.get((state, event)) is target} - {target}
            for source in _ends(sources, target, states, groups):
                key = (source, str(target.value))
                arrows[key] = (*arrows.get(key, ()), str(event.value))
    return arrows


def _ends(
    sources: set[State], target: State, states: Sequence[State], groups: Mapping[str, frozenset[State]]
) -> list[str]:
    if sources and sources | {target} == set(states):
        return [ANY]
    ends = []
    left = set(sources)
    for name, group in sorted(groups.items(), key=lambda each: -len(each[1])):
        if group <= left:
            ends.append(f"group {name}")
            left -= group
    return [*ends, *(str(state.value) for state in states if state in left)]


def pictures() -> dict[str, str]:
    """Return the pictures, by the names of their files.

    Raises:
        LayoutError: one cannot be drawn as it is laid out; the message names what has no place.
    """
    places = list(MotionState)
    arrows = arrows_of(places, list(MotionEvent), flat(MOTION_AFTER), GROUPS)
    groups = {name: [str(state.value) for state in group] for name, group in GROUPS.items()}
    phases = [str(phase.value) for phase in Phase]
    steps = arrows_of(list(Phase), [*Step, *Outcome], flat(PHASE_AFTER), {})
    return {
        MOTION_LAYOUT.name: drawn(MOTION_LAYOUT, [str(place.value) for place in places], groups, arrows),
        PHASES_LAYOUT.name: drawn(PHASES_LAYOUT, phases, {}, steps),
    }
