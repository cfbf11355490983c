"""A request or reply that leaves while it arrives, and what may come between, from each state on its way."""

from collections.abc import Sequence
from typing import Final

import pytest

from gateway.exchange.cut_through.frame import ForwardEvent
from tests.verify.designs import BY_NAME
from tests.verify.designs_frames import ODDLY_ACKNOWLEDGED, SEEN_THERE, TAIL
from tests.verify.designs_rules import ask
from tests.verify.errors import BrokenRuleError
from tests.verify.explore import Walk
from tests.verify.sometimes import FORWARD_ENDS
from tests.verify.test_verify import ACK
from tests.verify.wires_cut import ForwardingPipe, ForwardingSide, ForwardingWorld
from tests.verify.world import Happening

HEAD = (("delay",),)
LEAVING = (("delay",), ("more",))
WORLDS = sorted(name for name, design in BY_NAME.items() if design.is_cut)


def let_happen(name: str, events: Sequence[Happening]) -> ForwardingWorld:
    """Return a world in which events have happened; ``settle``: what is on the wire is acknowledged."""
    world = ForwardingWorld(BY_NAME[name])
    for event in events:
        if event == ("settle",):
            while world.state.wire is not None:
                world.happen(ACK)
            continue
        assert event in world.happenings(), event
        world.happen(event)
        world.keep()
    return world


def ends_of(world: ForwardingWorld) -> set[ForwardEvent]:
    """Return how requests have ended that were not just stored."""
    forwarding = world.sides[0].line.forwarding
    assert forwarding is not None
    return {
        event
        for event, count in forwarding.requests.ended.items()
        if count and event is not ForwardEvent.KEPT
    }


def ends_of_replies(world: ForwardingWorld) -> set[ForwardEvent]:
    """The same of replies."""
    forwarding = world.sides[0].line.forwarding
    assert forwarding is not None
    return {
        event for event, count in forwarding.replies.ended.items() if count and event is not ForwardEvent.KEPT
    }


@pytest.mark.parametrize("steps", [HEAD, LEAVING], ids=["head", "leaving"])
@pytest.mark.parametrize("half", [("half", 0, "to", 0, 0), ("half", 0, "read", 0)], ids=["to", "read"])
@pytest.mark.parametrize(
    ("name", "then", "end"),
    [
        ("b-rtu-cut-to", (("tail",), ACK), ForwardEvent.COMMITTED),
        ("b-rtu-cut-to", (("tail_bad",), ("wait",)), ForwardEvent.BAD),
        ("b-rtu-cut-to", (("stall",), ("tail",), ("wait",), ACK), ForwardEvent.STALLED),
        ("b-rtu-cut-to", (("wait",), ("tail",), ("wait",)), ForwardEvent.STALLED),
        ("b-rtu-cut-to", (("noise",), ("tail",), ("wait",), ACK), ForwardEvent.MET),
        ("b-rtu-cut-anew", (("anew", "read", 0), ("wait",), ACK), ForwardEvent.ANEW),
        ("b-rtu-cut-stuck", (("stuck", "read", 0), ("wait",), ACK), ForwardEvent.STALLED),
        ("b-rtu-cut-link", (("disconnect", 0), ("wait",)), ForwardEvent.GONE),
        ("b-rtu-cut-link", (("unplug",), ("tail",), ("plug",)), ForwardEvent.LOST),
    ],
)
def test_a_request_that_leaves_ends_as_it_should_from_each_state(
    name: str, half: Happening, steps: Sequence[Happening], then: Sequence[Happening], end: ForwardEvent
) -> None:
    assert ends_of(let_happen(name, (*SEEN_THERE, half, *steps, *then))) == {end}


@pytest.mark.parametrize("change", ["table", "switch"])
def test_another_table_spoils_a_target_and_no_read(change: str) -> None:
    to, read = ("half", 0, "to", 0, 0), ("half", 0, "read", 0)
    for steps, end in ((HEAD, ForwardEvent.REFUSED), (LEAVING, ForwardEvent.CHANGED)):
        for half, found in ((to, end), (read, ForwardEvent.COMMITTED)):
            world = let_happen("b-rtu-cut-changes", (*SEEN_THERE, half, *steps, (change,), ("tail",)))
            assert ends_of(world) == {found}


@pytest.mark.parametrize("steps", [HEAD, LEAVING], ids=["head", "leaving"])
def test_a_stop_spoils_a_read_that_leaves_and_another_read_waits_for_it(steps: Sequence[Happening]) -> None:
    before = (("ask", 0, "read", 0), ACK, ("half", 0, "read", 0), *steps)
    world = let_happen("b-rtu-cut-stop", (*before, ("ask", 1, "stop", 0), ("tail",), ("wait",), ("settle",)))
    assert ends_of(world) == {ForwardEvent.OVERTAKEN}
    world = let_happen("b-rtu-cut-stop", (*before, ("ask", 1, "read", 0), ("tail",), ACK, ACK))
    assert ends_of(world) == {ForwardEvent.COMMITTED}


@pytest.mark.parametrize("steps", [HEAD, LEAVING], ids=["head", "leaving"])
def test_a_gateway_that_is_killed_leaves_nothing_behind_that_could_be_a_frame(
    steps: Sequence[Happening],
) -> None:
    half = ("half", 0, "to", 0, 0)
    world = let_happen("b-rtu-cut-killed", (*SEEN_THERE, half, *steps, ("kill",), ("settle",)))
    assert not world.is_leaving
    assert ends_of(world) == set()


@pytest.mark.parametrize("steps", [HEAD, LEAVING], ids=["head", "leaving"])
def test_a_stop_of_another_axis_spoils_a_target_that_leaves_and_goes_first(
    steps: Sequence[Happening],
) -> None:
    stop = ("ask", 1, "stop", 1)
    before = (*SEEN_THERE, ("half", 0, "to", 0, 0), *steps, stop)
    world = let_happen("b-rtu-cut-beside", (*before, ("tail",)))
    assert world.state.wire is None  # a silence of three times 3.5 characters comes first
    world = let_happen("b-rtu-cut-beside", (*before, ("tail",), ("wait",)))
    assert world.state.wire is not None
    assert (world.state.wire.unit_id, world.state.wire.pdu) == (2, world.pdu("stop"))
    assert ends_of(world) == {ForwardEvent.OVERTAKEN}
    world.happen(ACK)
    assert world.state.wire is not None  # all of the target came: it is a request as any other
    assert world.state.wire.pdu.hex(" ") == "10 06 06 00 02 04 23 d4 00 00"


def test_a_target_with_another_head_than_was_expected_is_spoilt() -> None:
    before = (*SEEN_THERE, ("half", 0, "to", 0, 0), *HEAD)
    world = let_happen(
        "b-rtu-cut-to", (*before, ("tail_odd",), ("ask", 0, "read", 0), ("wait",), ("settle",))
    )
    assert ends_of(world) == {ForwardEvent.UNFIT}


COMING: Final = (("split",), ("reply_delay",))
COME: Final = (*COMING, ("reply_more",))


@pytest.mark.parametrize("steps", [COMING, COME], ids=["head", "leaving"])
@pytest.mark.parametrize("asked", [("ask", 0, "to", 0, 0), ("ask", 0, "read", 0)], ids=["to", "read"])
@pytest.mark.parametrize(
    ("name", "then", "end"),
    [
        ("b-rtu-cut-back", (TAIL,), ForwardEvent.COMMITTED),
        ("b-rtu-cut-back-bad", (("reply_bad",), ("wait",)), ForwardEvent.BAD),
        ("b-rtu-cut-back", (("reply_stall",), TAIL), ForwardEvent.STALLED),
        ("b-rtu-cut-back-silent", (("wait",), TAIL), ForwardEvent.STALLED),
        ("b-rtu-cut-back-again", (("ask", 0, "read", 0), TAIL, ("settle",)), ForwardEvent.ANEW),
        ("b-rtu-cut-back-link", (("disconnect", 0), TAIL), ForwardEvent.LOST),
        ("b-rtu-cut-back-link", (("unplug",), ("plug",)), ForwardEvent.GONE),
    ],
)
def test_a_reply_that_leaves_ends_as_it_should_from_each_state(
    name: str, asked: Happening, steps: Sequence[Happening], then: Sequence[Happening], end: ForwardEvent
) -> None:
    before = SEEN_THERE
    if name.endswith("bad"):
        before, asked = (
            (*ask("read"), *ask("status")),
            asked if asked[2] == "read" else ("ask", 0, "status", 0),
        )
    world = let_happen(name, (*before, asked, *steps, *then))
    assert ends_of_replies(world) == {end}
    assert not world.is_replying


@pytest.mark.parametrize("steps", [COMING, COME], ids=["head", "leaving"])
def test_a_stop_waits_for_a_reply_that_leaves(steps: Sequence[Happening]) -> None:
    before = (("ask", 0, "read", 0), ACK, ("ask", 0, "read", 0), *steps, ("ask", 1, "stop", 0))
    world = let_happen("b-rtu-cut-back-stop", (*before, TAIL))
    assert world.state.wire is not None
    assert world.state.wire.pdu == world.pdu("stop")
    assert ends_of_replies(world) == {ForwardEvent.COMMITTED}


def test_an_acknowledgement_of_other_registers_is_spoilt_where_bytes_of_it_have_left() -> None:
    world = let_happen("b-rtu-cut-back-odd", ODDLY_ACKNOWLEDGED)
    assert ends_of_replies(world) == {ForwardEvent.CHANGED}


@pytest.mark.parametrize("first", ["02 03 04 23", "01 04 04 23", "01 03 06 23", "01 83 04 40"])
def test_what_begins_as_no_reply_to_what_was_asked_never_begins_to_leave(first: str) -> None:
    world = let_happen("b-rtu-cut-back", (*SEEN_THERE, ("ask", 0, "read", 0)))
    side = world.sides[0]
    assert isinstance(side, ForwardingSide)
    kept = side.forwarding.replies.stored[ForwardEvent.KEPT]
    side.hear(bytes.fromhex(first), world.now_ns)
    assert (side.forwarding.replies.stored[ForwardEvent.KEPT], side.forwarding.drives.deadline_ns) == (
        kept + 1,
        None,
    )


def test_a_reply_that_leaves_ends_although_its_controller_begins_another_request() -> None:
    world = let_happen("b-rtu-cut-back", (*SEEN_THERE, ("ask", 0, "read", 0), *COME))
    side = world.sides[0]
    assert isinstance(side, ForwardingSide)
    side.feed(0, bytes.fromhex("01 03 05 20"), world.now_ns)
    world.happen(TAIL)
    assert ends_of_replies(world) == {ForwardEvent.COMMITTED}
    side.feed(0, bytes.fromhex("00 02 C5 0D"), world.now_ns)
    assert side.link.sent == [(1, bytes.fromhex("03 05 20 00 02"))]


def test_a_refusal_is_stored() -> None:
    asked = (*SEEN_THERE, ("ask", 0, "read", 0), ("split", "refuse"))
    world = let_happen("b-rtu-cut-back-odd", asked)
    assert ("reply_delay",) not in world.happenings()
    world.happen(TAIL)
    assert ends_of_replies(world) == set()
    assert world.tally.refusals == {4}


def test_no_rule_is_broken_on_the_ways_of_any_world_and_all_ends_are_met() -> None:
    met: set[str] = set()
    for name in WORLDS:
        walk = Walk(BY_NAME[name])
        assert (name, walk.along().broken) == (name, [])
        met |= {f"cut {each}" for each in walk.world.tally.cuts}
    assert met == FORWARD_ENDS


def heard(*pieces: str) -> list[bytes]:
    """Return the requests that a drive takes out of what comes."""
    taken: list[bytes] = []
    pipe = ForwardingPipe(lambda _number, _unit_id, pdu: taken.append(pdu))
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
