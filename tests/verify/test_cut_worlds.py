"""A request that leaves while it arrives, and what may come between, from each state on its way."""

from collections.abc import Sequence

import pytest

from gateway.exchange.cut_through import Turn
from tests.verify.designs import BY_NAME
from tests.verify.designs_frames import SEEN_THERE
from tests.verify.errors import BrokenRuleError
from tests.verify.explore import Walk
from tests.verify.test_verify import ACK, PLAIN
from tests.verify.wires_cut import CutPipe, CutWorld
from tests.verify.world import Happening

pytestmark = PLAIN
LED = (("lead",),)
LEAVING = (("lead",), ("more",))
WORLDS = sorted(name for name, design in BY_NAME.items() if design.is_cut)


def let_happen(name: str, events: Sequence[Happening]) -> CutWorld:
    """Return a world in which events have happened; ``settle``: what is on the wire is acknowledged."""
    world = CutWorld(BY_NAME[name])
    for event in events:
        if event == ("settle",):
            while world.state.wire is not None:
                world.happen(ACK)
            continue
        assert event in world.happenings(), event
        world.happen(event)
        world.keep()
    return world


def ends_of(world: CutWorld) -> set[Turn]:
    """Return how requests have ended that were not just stored."""
    cuts = world.sides[0].line.cuts
    assert cuts is not None
    return {turn for turn, count in cuts.requests.items() if count and turn is not Turn.KEPT}


@pytest.mark.parametrize("steps", [LED, LEAVING], ids=["led", "leaving"])
@pytest.mark.parametrize("half", [("half", 0, "to", 0, 0), ("half", 0, "read", 0)], ids=["to", "read"])
@pytest.mark.parametrize(
    ("name", "then", "end"),
    [
        ("b-rtu-cut-to", (("tail",), ACK), Turn.COMMITTED),
        ("b-rtu-cut-to", (("tail_bad",), ("wait",)), Turn.BAD),
        ("b-rtu-cut-to", (("stall",), ("tail",), ("wait",), ACK), Turn.STALLED),
        ("b-rtu-cut-to", (("wait",), ("tail",), ("wait",)), Turn.STALLED),
        ("b-rtu-cut-to", (("noise",), ("tail",), ("wait",), ACK), Turn.MET),
        ("b-rtu-cut-anew", (("anew", "read", 0), ("wait",), ACK), Turn.ANEW),
        ("b-rtu-cut-link", (("disconnect", 0), ("wait",)), Turn.GONE),
        ("b-rtu-cut-link", (("unplug",), ("tail",), ("plug",)), Turn.LOST),
    ],
)
def test_a_request_that_leaves_ends_as_it_should_from_each_state(
    name: str, half: Happening, steps: Sequence[Happening], then: Sequence[Happening], end: Turn
) -> None:
    assert ends_of(let_happen(name, (*SEEN_THERE, half, *steps, *then))) == {end}


@pytest.mark.parametrize("change", ["table", "switch"])
def test_another_table_spoils_a_target_and_no_read(change: str) -> None:
    to, read = ("half", 0, "to", 0, 0), ("half", 0, "read", 0)
    for steps, end in ((LED, Turn.REFUSED), (LEAVING, Turn.CHANGED)):
        for half, found in ((to, end), (read, Turn.COMMITTED)):
            world = let_happen("b-rtu-cut-changes", (*SEEN_THERE, half, *steps, (change,), ("tail",)))
            assert ends_of(world) == {found}


@pytest.mark.parametrize("steps", [LED, LEAVING], ids=["led", "leaving"])
def test_a_stop_spoils_a_read_that_leaves_and_another_read_waits_for_it(steps: Sequence[Happening]) -> None:
    before = (("ask", 0, "read", 0), ACK, ("half", 0, "read", 0), *steps)
    world = let_happen("b-rtu-cut-stop", (*before, ("ask", 1, "stop", 0), ("tail",), ("wait",), ("settle",)))
    assert ends_of(world) == {Turn.OVERTAKEN}
    world = let_happen("b-rtu-cut-stop", (*before, ("ask", 1, "read", 0), ("tail",), ACK, ACK))
    assert ends_of(world) == {Turn.COMMITTED}


@pytest.mark.parametrize("steps", [LED, LEAVING], ids=["led", "leaving"])
def test_a_gateway_that_is_killed_leaves_nothing_behind_that_could_be_a_frame(
    steps: Sequence[Happening],
) -> None:
    half = ("half", 0, "to", 0, 0)
    world = let_happen("b-rtu-cut-killed", (*SEEN_THERE, half, *steps, ("kill",), ("settle",)))
    assert not world.is_leaving
    assert ends_of(world) == set()


@pytest.mark.parametrize("name", WORLDS)
def test_no_rule_is_broken_on_its_ways(name: str) -> None:
    assert Walk(BY_NAME[name]).along().broken == []


def heard(*pieces: str) -> list[bytes]:
    """Return the requests that a drive takes out of what comes."""
    taken: list[bytes] = []
    pipe = CutPipe(lambda _number, _unit_id, pdu: taken.append(pdu))
    for piece in pieces:
        pipe.write(bytes.fromhex(piece))
    return taken


def test_the_witness_takes_whole_frames_and_sees_what_is_none() -> None:
    # 01 03 05 20 00 02 has the check sum C5 0D; both bytes inverted: 3A F2.
    assert heard("01 03", "05 20 00 02 C5 0D") == [bytes.fromhex("03 05 20 00 02")]
    assert heard("01 03 05 20 00 02", "3A F2") == []
    with pytest.raises(BrokenRuleError, match="neither a frame"):
        heard("01 03 05 20 00 02", "C5 F2")
    with pytest.raises(BrokenRuleError, match="no silence"):
        heard("01 03 05 20 00 02 3A F2", "01")
    with pytest.raises(BrokenRuleError, match="may be a frame"):
        heard("01 10 01 EC")
