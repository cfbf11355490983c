"""What docs/state-machine.md has from the code: states, events, the tables of both, and two pictures."""

import ast
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Final, TypeVar

from gateway.exchange.answers import REACH_AFTER, Reach, Sign
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.interlock import BLOCK_AFTER, Block, BlockEvent
from gateway.exchange.axis.motion import (
    ON_WAY,
    TARGETED,
    WAS_THERE,
    WHEREABOUTS_AFTER,
    Happening,
    Whereabouts,
)
from gateway.exchange.axis.reference import REFERENCE_AFTER, REFERENCE_AT_START, Referenced, ReferenceEvent
from gateway.exchange.plan import Reference
from gateway.exchange.transaction import OUTCOMES, PHASE_AFTER, STOP_AFTER, Phase, Stopping, Transaction
from tools.diagram import ANY, Arrows, Box, Layout, LayoutError, Route, drawn
from tools.markers import table

ROOT: Final = Path(__file__).parents[1]

State = TypeVar("State", bound=Enum)
Event = TypeVar("Event", bound=Enum)

GROUPS: Final[Mapping[str, frozenset[Whereabouts]]] = {
    "targeted": TARGETED,
    "on its way": ON_WAY,
    "was there": WAS_THERE,
    "unproven": frozenset({Whereabouts.UNPROVEN, Whereabouts.UNPROVEN_AT_REST}),
}
"""States from which an event often leads to the same one: the picture has a frame around each."""
STEPS: Final[Mapping[tuple[Phase, Phase], str]] = {
    (Phase.WAITING, Phase.PREREQUISITE): "leave",
    (Phase.WAITING, Phase.SENT): "leave",
    (Phase.LEAVING, Phase.SENT): "leave",
    (Phase.WAITING, Phase.LEAVING): "lead",
    (Phase.PREREQUISITE, Phase.WAITING): "learn",
    (Phase.WAITING, Phase.ENDED): "end",
    (Phase.PREREQUISITE, Phase.ENDED): "end",
    (Phase.LEAVING, Phase.ENDED): "end",
    (Phase.SENT, Phase.ENDED): "end",
}
"""The method of ``Transaction`` that takes each step which ``PHASE_AFTER`` allows."""

WHEREABOUTS_LAYOUT: Final = Layout(
    "state-machine-whereabouts.svg",
    "Where an axis is, and what leads from one state to another",
    900,
    800,
    nodes={
        ANY: (138, 50),
        "unknown": (190, 612),
        "stopped": (760, 612),
        "out-of-reach": (400, 612),
        "retained": (600, 712),
        "unproven": (138, 165),
        "unproven-at-rest": (138, 290),
        "under-way": (428, 160),
        "set-out": (726, 160),
        "done-said": (350, 310),
        "seen-there": (804, 310),
        "arrived": (577, 310),
        "may-have-left": (577, 450),
        "stands-again": (804, 450),
    },
    frames={
        "targeted": Box(258, 95, 634, 425),
        "on its way": Box(270, 122, 614, 86),
        "was there": Box(270, 240, 614, 265),
        "unproven": Box(50, 112, 180, 228),
    },
    routes={
        (ANY, "under-way"): Route(((178, 60), (428, 60), (428, 140)), (320, 78), "middle"),
        (ANY, "set-out"): Route(((178, 40), (726, 40), (726, 140)), (560, 33), "middle"),
        (ANY, "unproven"): Route(((138, 68), (138, 145)), (144, 96)),
        (ANY, "unknown"): Route(((98, 50), (25, 50), (25, 612), (120, 612)), (72, 605), "middle"),
        ("unproven", "unproven-at-rest"): Route(((138, 185), (138, 270)), (144, 222), is_stacked=True),
        ("group unproven", "under-way"): Route(((230, 165), (358, 165)), (312, 158), "middle"),
        ("group unproven", "unknown"): Route(((150, 340), (150, 592)), (144, 470), "end", is_stacked=True),
        ("group on its way", "done-said"): Route(((350, 208), (350, 290)), (356, 228)),
        ("group on its way", "arrived"): Route(((577, 208), (577, 290)), (583, 228)),
        ("group on its way", "seen-there"): Route(((804, 208), (804, 290)), (798, 228), "end"),
        ("done-said", "arrived"): Route(((420, 310), (507, 310)), (463, 303), "middle"),
        ("seen-there", "arrived"): Route(((734, 310), (647, 310)), (691, 288), "middle", is_stacked=True),
        ("done-said", "may-have-left"): Route(((350, 330), (350, 450), (507, 450)), (430, 443), "middle"),
        ("arrived", "may-have-left"): Route(((577, 330), (577, 430)), (583, 385)),
        ("may-have-left", "stands-again"): Route(
            ((647, 450), (734, 450)), (691, 428), "middle", is_stacked=True
        ),
        ("seen-there", "under-way"): Route(
            ((850, 290), (850, 214), (470, 214), (470, 180)), (700, 200), "middle"
        ),
        ("arrived", "stands-again"): Route(
            ((600, 330), (600, 365), (804, 365), (804, 430)), (720, 358), "middle"
        ),
        ("stands-again", "may-have-left"): Route(
            ((760, 470), (760, 490), (600, 490), (600, 470)), (680, 483), "middle"
        ),
        ("stands-again", "arrived"): Route(
            ((740, 430), (740, 395), (625, 395), (625, 330)), (685, 388), "middle"
        ),
        ("group was there", "unknown"): Route(((270, 400), (242, 400), (242, 592)), (248, 556)),
        ("group targeted", "out-of-reach"): Route(((400, 520), (400, 592)), (406, 560)),
        ("group targeted", "retained"): Route(((600, 520), (600, 692)), (606, 660)),
        ("group targeted", "stopped"): Route(((760, 520), (760, 592)), (766, 560)),
        ("out-of-reach", "retained"): Route(((400, 632), (400, 712), (530, 712)), (394, 690), "end"),
        ("out-of-reach", "unknown"): Route(((330, 612), (260, 612)), (295, 578), "middle", is_stacked=True),
        ("retained", "unknown"): Route(
            ((600, 732), (600, 750), (190, 750), (190, 632)), (395, 743), "middle"
        ),
        ("stopped", "unknown"): Route(((760, 632), (760, 785), (160, 785), (160, 632)), (460, 778), "middle"),
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


def _method_meanings(found: type, names: Iterable[str]) -> dict[str, str]:
    methods = {each.name: each for each in _class(found).body if isinstance(each, ast.FunctionDef)}
    return {name: _one_line(ast.get_docstring(methods[name]) or "") for name in names}


def _one_line(text: str) -> str:
    return " ".join(text.split()).replace("``", "`")


def _rows_of(members: Iterable[Enum]) -> list[tuple[str, ...]]:
    return [(f"`{member.value}`", meanings(type(member))[member]) for member in members]


# --- parts of the page -------------------------------------------------------------------------------------


def whereabouts() -> str:
    """Return the states, happenings and table of where an axis is."""
    return _machine(list(Whereabouts), list(Happening), WHEREABOUTS_AFTER)


def blocks() -> str:
    """Return the states, events and table of what blocks triggers."""
    return _machine(list(Block), list(BlockEvent), BLOCK_AFTER)


def references() -> str:
    """Return the states, events and tables of the reference, by each way in which it is known."""
    parts = [
        table(("state", "means"), _rows_of(Referenced)),
        table(("event", "means"), _rows_of(ReferenceEvent)),
    ]
    for kind, meaning in meanings(Reference).items():
        assert isinstance(kind, Reference)
        after = {
            (state, event): then
            for event, by_state in REFERENCE_AFTER[kind].items()
            for state, then in by_state.items()
        }
        start = REFERENCE_AT_START[kind]
        states = _reached(start, after)
        events = [event for event in ReferenceEvent if event in REFERENCE_AFTER[kind]]
        parts.append(
            f"### `{kind.value}`\n\n{meaning} At the start: `{start.value}`.\n\n"
            + _tables(states, events, after)
        )
    return "\n".join(parts)


def transactions() -> str:
    """Return the phases of a transaction, what takes it from one to the next, and how it may end in each."""
    _check_steps()
    steps = list(dict.fromkeys(STEPS.values()))
    rows = [
        (
            f"`{phase.value}`",
            *(
                ", ".join(f"`{then.value}`" for then in Phase if STEPS.get((phase, then)) == step)
                for step in steps
            ),
        )
        for phase in Phase
    ]
    ends = [
        (
            f"`{phase.value}`",
            ", ".join(f"`{outcome.value}`" for outcome in Outcome if outcome in OUTCOMES[phase]) or "none",
        )
        for phase in Phase
    ]
    events = [(f"`{name}`", text) for name, text in _method_meanings(Transaction, steps).items()]
    return "\n".join(
        (
            table(("phase", "means"), _rows_of(Phase)),
            table(("step", "means"), events),
            table(("phase", *(f"`{step}`" for step in steps)), rows),
            table(("outcome", "means"), _rows_of(Outcome)),
            table(("phase", "outcomes that are possible"), ends),
        )
    )


def stops() -> str:
    """Return whether a request is a stop, how often it leaves for that, and where each may lead."""
    rows = [
        (f"`{state.value}`", ", ".join(f"`{then.value}`" for then in Stopping if then in STOP_AFTER[state]))
        for state in Stopping
    ]
    return "\n".join((table(("state", "means"), _rows_of(Stopping)), table(("state", "leads to"), rows)))


def reaches() -> str:
    """Return how far a unit id is from answering, what is seen of it, and where that leads."""
    return _machine(list(Reach), list(Sign), REACH_AFTER)


def _check_steps() -> None:
    allowed = {(phase, then) for phase, after in PHASE_AFTER.items() for then in after}
    for phase, then in allowed ^ set(STEPS):
        raise LayoutError(
            f"tools/state_machine.py: STEPS and PHASE_AFTER differ in {phase.value} → {then.value}"
        )


def _machine(
    states: Sequence[State], events: Sequence[Event], after: Mapping[tuple[State, Event], State]
) -> str:
    return "\n".join(
        (
            table(("state", "means"), _rows_of(states)),
            table(("event", "means"), _rows_of(events)),
            _tables(states, events, after),
        )
    )


def _tables(
    states: Sequence[State], events: Sequence[Event], after: Mapping[tuple[State, Event], State]
) -> str:
    """Return what each event makes of each state; first those that make the same of all."""
    common = {event: then for event in events if (then := _of_any(states, event, after)) is not None}
    others = [event for event in events if event not in common]
    parts = []
    if common:
        lines = [(f"`{event.value}`", f"`{then.value}`") for event, then in common.items()]
        parts.append(table(("event, in any state", "leads to"), lines))
    if others:
        rows = [(f"`{state.value}`", *(_cell(after.get((state, e))) for e in others)) for state in states]
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


def _phase_arrows() -> Arrows:
    _check_steps()
    return {
        (str(phase.value), str(then.value)): tuple(
            str(outcome.value) for outcome in Outcome if outcome in OUTCOMES[phase]
        )
        if then is Phase.ENDED
        else (step,)
        for (phase, then), step in STEPS.items()
    }


def pictures() -> dict[str, str]:
    """Return the pictures, by the names of their files.

    Raises:
        LayoutError: one cannot be drawn as it is laid out; the message names what has no place.
    """
    places = list(Whereabouts)
    arrows = arrows_of(places, list(Happening), WHEREABOUTS_AFTER, GROUPS)
    groups = {name: [str(state.value) for state in group] for name, group in GROUPS.items()}
    phases = [str(phase.value) for phase in Phase]
    return {
        WHEREABOUTS_LAYOUT.name: drawn(
            WHEREABOUTS_LAYOUT, [str(place.value) for place in places], groups, arrows
        ),
        PHASES_LAYOUT.name: drawn(PHASES_LAYOUT, phases, {}, _phase_arrows()),
    }
