"""tools/state_machine.py and tools/diagram.py: what the page of states says is what the tables say."""

import re
import sys
from dataclasses import replace
from enum import Enum
from typing import Final

import pytest

from gateway.exchange.axis.motion import MOTION_AFTER, MotionEvent, MotionState
from gateway.exchange.transaction import PHASE_AFTER
from tools import docs, state_machine
from tools.diagram import ANY, Box, Layout, LayoutError, Route, drawn

LAMP: Final = Layout(
    "lamp.svg",
    "A lamp",
    500,
    200,
    nodes={"dark": (100, 100), "lit": (400, 100)},
    routes={
        ("dark", "lit"): Route(((170, 90), (330, 90)), (250, 80), "middle"),
        ("lit", "dark"): Route(((330, 110), (170, 110)), (250, 130), "middle"),
    },
)
SWITCHED: Final = {("dark", "lit"): ("press",), ("lit", "dark"): ("press", "burn out")}


def lamp(layout: Layout = LAMP, states: tuple[str, ...] = ("dark", "lit")) -> str:
    return drawn(layout, states, {}, SWITCHED)


def test_a_picture_has_each_state_and_each_event() -> None:
    texts = re.findall(r">([^<]+)</text>", lamp())
    assert texts == ["dark", "lit", "press", "press, burn out"]
    assert lamp() == lamp()


def test_it_needs_nothing_from_elsewhere_and_knows_light_and_dark() -> None:
    for text in state_machine.pictures().values():
        assert re.findall(r'https?://[^"]+', text) == ["http://www.w3.org/2000/svg"]
        assert 'font-family="sans-serif"' in text
        assert "@media (prefers-color-scheme: dark)" in text
        assert 'width="900"' in text


def route(*points: tuple[float, float]) -> Route:
    return Route(points, (250, 80), "middle")


@pytest.mark.parametrize(
    ("layout", "says"),
    [
        (replace(LAMP, nodes={"dark": (100, 100)}), "lamp.svg: the layout has no place for the state lit"),
        (
            replace(LAMP, nodes={**LAMP.nodes, "dim": (250, 20)}),
            "lamp.svg: the layout has a place for the state dim, which there is not",
        ),
        (
            replace(LAMP, routes={("dark", "lit"): LAMP.routes["dark", "lit"]}),
            "lamp.svg: the layout has no way for the arrow lit → dark",
        ),
        (replace(LAMP, nodes={**LAMP.nodes, "lit": (230, 100)}), "lamp.svg: dark lies on lit"),
        (replace(LAMP, width=460), "lamp.svg: lit lies beyond the edge"),
        (
            replace(LAMP, routes={**LAMP.routes, ("dark", "lit"): route((170, 90), (320, 90))}),
            "lamp.svg: the arrow dark → lit does not touch lit",
        ),
        (
            replace(LAMP, routes={**LAMP.routes, ("dark", "lit"): route((100, 80), (100, 130), (330, 90))}),
            "lamp.svg: the arrow dark → lit goes through dark",
        ),
        (
            replace(LAMP, routes={**LAMP.routes, ("lit", "dark"): route((330, 110), (170, 110))}),
            "lamp.svg: the label of dark → lit lies on the label of lit → dark",
        ),
        (
            replace(
                LAMP,
                routes={
                    **LAMP.routes,
                    ("lit", "dark"): Route(((330, 110), (170, 110)), (250, 114), "middle"),
                },
            ),
            "lamp.svg: the arrow lit → dark goes through the label of lit → dark",
        ),
    ],
)
def test_what_has_no_place_or_lies_on_something_else_is_named(layout: Layout, says: str) -> None:
    with pytest.raises(LayoutError) as error:
        lamp(layout)
    assert str(error.value).removesuffix("; mend its layout") == says


def test_a_frame_is_around_the_states_of_its_group_and_no_others() -> None:
    layout = replace(LAMP, frames={"bright": Box(20, 50, 300, 100)})
    with pytest.raises(LayoutError, match="dark is inside the frame of bright"):
        drawn(layout, ("dark", "lit"), {"bright": ["lit"]}, SWITCHED)


def test_make_docs_names_a_state_that_has_no_place(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    layout = state_machine.MOTION_LAYOUT
    nodes = {name: place for name, place in layout.nodes.items() if name != "superseded"}
    monkeypatch.setattr(state_machine, "MOTION_LAYOUT", replace(layout, nodes=nodes))
    monkeypatch.setattr(sys, "argv", ["docs"])
    assert docs.main() == 1
    said = "state-machine-motion.svg: the layout has no place for the state superseded\n"
    assert capsys.readouterr().err == said


def test_the_arrows_of_the_picture_are_the_whole_table() -> None:
    """Each arrow taken apart again: from any state, from those in a frame, or from one."""
    places = list(MotionState)
    arrows = state_machine.arrows_of(
        places, list(MotionEvent), state_machine.flat(MOTION_AFTER), state_machine.GROUPS
    )
    found = {}
    for (source, target), events in arrows.items():
        if source == ANY:
            sources = set(places)
        elif source.startswith("group "):
            sources = set(state_machine.GROUPS[source.removeprefix("group ")])
        else:
            sources = {MotionState(source)}
        for event in events:
            for state in sources - {MotionState(target)}:
                assert (state, MotionEvent(event)) not in found
                found[state, MotionEvent(event)] = MotionState(target)
    assert found == {
        key: then for key, then in state_machine.flat(MOTION_AFTER).items() if then is not key[0]
    }


def cells(text: str, head: str) -> dict[tuple[str, str], str]:
    """Return the cells of the table that begins with a head, by row and column."""
    lines = text[text.index(head) :].split("\n\n", maxsplit=1)[0].strip().splitlines()
    rows = [[cell.strip(" `") for cell in line.strip("|").split("|")] for line in lines]
    return {
        (row[0], column): cell
        for row in rows[2:]
        for column, cell in zip(rows[0][1:], row[1:], strict=True)
        if cell
    }


def test_the_tables_of_the_page_are_the_whole_table() -> None:
    text = state_machine.motion()
    found = cells(text, "| state | not-executed |")
    for (event, _), then in cells(text, "| event, in any").items():
        found |= {(place.value, event): then for place in MotionState}
    expected = {(p.value, e.value): then.value for (p, e), then in state_machine.flat(MOTION_AFTER).items()}
    events = list(MotionEvent)
    expected |= {(p.value, e.value): "×" for p, e in state_machine.absent(MOTION_AFTER, events)}
    assert found == expected


def test_a_reference_shows_the_states_that_it_comes_to() -> None:
    """An absolute encoder is found at the start, and only a set position ends it."""
    text = state_machine.references()
    head = "| state | homing | other-motion | set-at-rest | set-moving | loss | declared |"
    assert cells(text, head) == {
        ("not-referenced", "declared"): "referenced",
        ("referenced", "set-at-rest"): "not-referenced",
        ("referenced", "set-moving"): "not-referenced",
    }
    meaning = "The drive's homed bit. A person cannot declare the reference. At the start: `not-referenced`."
    assert meaning in text


def test_the_phases_and_outcomes_are_those_of_the_table() -> None:
    text = state_machine.transactions()
    steps = cells(text, "| state | frame | added-frame | answered | begins | piece | last-piece |")
    ends = cells(
        text, "| state | acknowledged | exception | other-reply | no-reply | broadcast | never-sent |"
    )
    found = {cell: then for cell, then in {**steps, **ends}.items() if then != "×"}
    assert found == {
        (phase.value, event.value): then.value
        for phase, row in PHASE_AFTER.items()
        for event, then in row.items()
    }


class Tide(Enum):
    LOW = "low"
    """The ``sea`` is
    away."""
    HIGH = "high"


def test_a_meaning_is_the_string_below_and_where_there_is_none_its_state_is_named() -> None:
    with pytest.raises(LayoutError, match=r"tests\.tools\.test_state_machine: Tide\.HIGH has no docstring"):
        state_machine.meanings(Tide)
    assert state_machine.meanings(MotionEvent)[MotionEvent.NOT_DONE] == "Its drive reports: not done."
