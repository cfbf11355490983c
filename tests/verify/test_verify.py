"""The walk itself: it closes, it sees, it says what it saw; and its lists of what is left out are alive."""

import gc
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import Any

import pytest

from gateway.catalogue import exchange_events
from gateway.catalogue.entry import entries_of
from gateway.compiled import is_compiled
from gateway.drives.motion import NextTarget
from tests.soak import IS_FULL
from tests.verify import snapshot
from tests.verify import world as world_module
from tests.verify.designs import BY_NAME, CLOSES, CLOSES_LATER, CLOSING, DESIGNS, LATER, MADE, PAIRS
from tests.verify.errors import BrokenRuleError
from tests.verify.explore import Broken, Walk, as_test, play, replay, shortened
from tests.verify.screw import WORN
from tests.verify.sometimes import NOT_MET, missing
from tests.verify.wires import world_of
from tests.verify.world import Design, Happening, World

ACK = ("drive", "ack")
TO_0, TO_1 = ("ask", 0, "to", 0, 0), ("ask", 0, "to", 0, 1)
TINY = replace(BY_NAME["s-both"], name="tiny", checks_way_back=True)
SMALL = ("s-two-units", "s-starts", "s-scaled-halves", "b-rtu", "b-rtu-pairs")
"""Each closes in seconds."""
LARGER = ("s-down", "s-carry", "s-stored", "s-killed-within", "b-requests", "s-warm", "b-rtu-late-size")
"""Each closes in a quarter of a minute: ``make soak``, as ``make verify`` does with all that close."""
BEGUN = [design for design in (*CLOSING, *PAIRS, *MADE, *LATER) if design.name not in {*SMALL, *LARGER}]
"""Of the others the beginning is walked; it is part of what is walked of those above."""


@pytest.fixture(autouse=True)
def keeps_what_it_has_met() -> Iterator[None]:
    """A walk keeps all of it: to look for garbage in there again and again is in vain."""
    gc.disable()
    yield
    gc.enable()


def each_of(*designs: Design) -> list[Any]:
    """Return worlds as parameters."""
    return [pytest.param(design, id=design.name) for design in designs]


def test_a_tiny_world_closes_and_has_a_way_back_from_everywhere() -> None:
    outcome = Walk(TINY).breadth_first()
    assert outcome.is_closed
    assert not outcome.broken
    assert outcome.settled
    assert outcome.states > 500
    assert outcome.without_way_back == 0


@pytest.mark.parametrize(
    "design", each_of(*(BY_NAME[name] for name in (*SMALL, *(LARGER if IS_FULL else ()))))
)
def test_a_small_world_closes_and_breaks_no_rule(design: Design) -> None:
    outcome = Walk(design).breadth_first()
    assert outcome.is_closed
    assert not outcome.broken, outcome.broken[0]


@pytest.mark.parametrize("design", each_of(*(BY_NAME[name] for name in LARGER)))
def test_no_rule_is_broken_far_into_a_larger_world(design: Design) -> None:
    outcome = Walk(design).breadth_first(depth=10)
    assert not outcome.broken, outcome.broken[0]


@pytest.mark.parametrize("design", each_of(*BEGUN))
def test_no_rule_is_broken_at_the_beginning_of_a_world_that_closes(design: Design) -> None:
    outcome = Walk(design).breadth_first(depth=3)
    assert not outcome.broken, outcome.broken[0]


def test_worlds_that_close_have_all_pairs_of_what_the_large_ones_have_at_once() -> None:
    closed = {pair for name in (*CLOSES, *CLOSES_LATER) for pair in pairs_of(BY_NAME[name])}
    large = {pair for design in DESIGNS if not design.ways for pair in pairs_of(design)}
    assert len(CLOSES) >= 120
    assert sorted(large - closed) == []


def pairs_of(design: Design) -> set[tuple[str, ...]]:
    """Each two of what controllers ask, drives answer and else happens; a drive that may be silent is one."""
    found = {*design.menu, *design.answers, *design.happenings}
    if not design.is_answered:
        found.add("silence")
    return set(combinations(sorted(found), 2))


@pytest.mark.parametrize("design", each_of(*DESIGNS))
def test_no_rule_is_broken_within_a_few_events(design: Design) -> None:
    outcome = Walk(design).breadth_first(depth=4)
    assert not outcome.broken, outcome.broken[0]


def test_random_steps_in_a_small_world_break_no_rule() -> None:
    assert not Walk(BY_NAME["staged"]).random(3000).broken


def test_putting_a_state_back_gives_the_same_state_and_the_same_future() -> None:
    world = World(BY_NAME["direct"])
    play_in(world, TO_1, ACK)
    before = world.keep()
    play_in(world, ACK, ("arrive", 0), TO_0, ACK)
    after = world.key(world.keep())
    world.restore(before)
    assert world.key(world.keep()) == world.key(before)
    play_in(world, ACK, ("arrive", 0), TO_0, ACK)
    assert world.key(world.keep()) == after


def test_states_that_differ_only_in_the_time_of_day_are_the_same() -> None:
    worlds = [World(BY_NAME["direct"]) for _ in range(2)]
    keys = []
    for world, waits in zip(worlds, (9, 23), strict=True):
        play_in(world, TO_1, ACK, ACK, ("arrive", 0), *[("wait",)] * waits)
        kept = world.keep()
        tokens = [snapshot_tokens(world), kept.state]
        keys.append(tokens)
    assert keys[0] == keys[1]


def test_the_lists_of_what_is_left_out_name_only_what_there_is() -> None:
    met: set[str] = set()
    recorded = replace(BY_NAME["killed"], menu=("to", "read", "status"), targets=(9007, 19013))
    arrived = (TO_0, ACK, ACK, ("arrive", 0), ("ask", 0, "read", 0), ACK, ("ask", 0, "status", 0), ACK)
    for design, events in (
        (recorded, (*arrived, TO_1, ACK, ("kill",), ACK)),
        (BY_NAME["pipelined"], (TO_1, ("ask", 0, "run", 0), ACK, ACK)),
        (BY_NAME["b-requests"], (TO_0, ACK, ACK)),
        (BY_NAME["b-rtu"], (TO_0, ACK, ACK)),
        (BY_NAME["b-rtu-cut"], (("ask", 0, "read", 0), ACK, ("half", 0, "read", 0), ("delay",), ("tail",))),
        (BY_NAME["s-silent"], (TO_0, ("wait",))),
        (BY_NAME["s-group"], (TO_0, ACK)),
    ):
        world = world_of(design)
        for event in events:
            play_in(world, event)
            world.key(world.keep())
        met |= world.sides[0].lens.met
    assert snapshot.dead_names(met) == []


def test_a_broken_gateway_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(BY_NAME["direct"])
    link = world.sides[0].link
    send = link.send_request

    def send_twice(unit_id: int, pdu: bytes) -> None:
        send(unit_id, pdu)
        send(unit_id, pdu)

    monkeypatch.setattr(link, "send_request", send_twice)
    with pytest.raises(BrokenRuleError, match="two frames"):
        play_in(world, TO_1)


def test_a_wrong_branch_is_seen() -> None:
    world = World(BY_NAME["direct"])
    world.screws = (WORN._replace(forward_mm=WORN.backward_mm, backward_mm=WORN.forward_mm),)
    with pytest.raises(BrokenRuleError, match="wrong branch"):
        play_in(world, TO_1, ACK, ACK)


def test_what_a_broken_rule_does_not_need_is_left_out_of_its_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    swapped = WORN._replace(forward_mm=WORN.backward_mm, backward_mm=WORN.forward_mm)
    monkeypatch.setattr(world_module, "SCREWS", (swapped,))
    wait, read = ("wait",), ("ask", 0, "read", 0)
    long = (wait, read, ACK, wait, wait, TO_1, ACK, ACK)
    assert shortened(BY_NAME["direct"], Broken("on the wrong branch", long)).trace == long  # another rule
    world = world_of(BY_NAME["direct"])
    with pytest.raises(BrokenRuleError) as broken:
        play_in(world, *long)
    assert shortened(BY_NAME["direct"], Broken(str(broken.value), long)).trace == (TO_1, ACK, ACK)


def test_a_gateway_dies_before_the_store_that_is_chosen_and_what_had_left_is_carried_out_or_not() -> None:
    before = (TO_0, ACK, ACK, ("arrive", 0), TO_1)
    design = BY_NAME["s-killed-within-near"]
    # The read is answered: the first store says that 9019, 9184 forward, is on its way, and comes before it.
    for number, is_obeyed, goes_counts in ((1, True, None), (2, False, None), (2, True, 9184)):
        world = play(design, *before, ("kill_at", number, is_obeyed, "drive", "ack"))
        assert world.state.axes[0].goes_counts == goes_counts


def test_a_drive_that_keeps_the_next_target_until_it_is_at_the_one_before_is_seen_to_come_from_there() -> (
    None
):
    """Where its map says so the way begins at the target before, else where the axis is."""
    design = replace(BY_NAME["s-status"], targets=(9007, 5003), is_buffered=True)
    under_way = (TO_0, ACK, ACK)  # to 9172, at 1501
    with pytest.raises(BrokenRuleError, match="5108, which is on the wrong branch"):
        play(design, *under_way, TO_1, ACK, ACK)  # by the reading forward, and it comes from 9172
    arrived = (("arrive", 0), ("ask", 0, "read", 0), ACK, ("ask", 0, "status", 0), ACK)
    world = play(design, *under_way, *arrived, TO_1, ACK)
    assert world.state.axes[0].goes_counts == 4888  # backward
    (plan,) = design.plans
    said = replace(design, plans=(replace(plan, next_target=NextTarget.QUEUED),))
    waiting = play(said, *under_way, TO_1, ACK).state.axes[0].next_run
    assert waiting is not None
    assert waiting.end_counts == 4888
    assert not waiting.is_unsure


def test_the_late_rest_of_half_a_request_is_no_request_and_ends_its_connection() -> None:
    half, tail, wait = ("half", 0, "to", 0, 0), ("tail",), ("wait",)
    world = play(BY_NAME["b-requests"], half, wait, tail)
    assert world.state.wire is not None  # 80 ms: its controller waits yet
    world = play(BY_NAME["b-requests"], half, wait, wait, tail)
    assert world.state.wire is None
    assert world.is_quiet


def test_a_late_reply_answers_no_other_request_in_a_world_of_bytes() -> None:
    obeyed = (TO_0, ACK, ("drive", "obey"), ("wait",), TO_0)
    design = replace(BY_NAME["b-replies"], answers=("ack", "obey"))
    world = play(design, *obeyed)
    wire = world.state.wire
    world.happen(("late",))
    assert world.state.wire == wire
    assert world.state.asked[0]


def test_the_late_rest_of_half_a_request_of_rtu_is_none_and_the_rest_in_time_is_one() -> None:
    half, tail, wait = ("half", 0, "to", 0, 0), ("tail",), ("wait",)
    assert play(BY_NAME["b-rtu"], half, tail).state.wire is not None
    assert play(BY_NAME["b-rtu"], half, wait, tail).state.wire is None  # 31.75 ms of silence have passed
    assert play(BY_NAME["b-rtu"], ("spoil", 0, "to", 0, 0)).state.wire is None  # a bad check sum


def test_a_late_reply_of_another_size_answers_no_other_request_over_a_serial_wire() -> None:
    read, status, wait = ("ask", 0, "read", 0), ("ask", 0, "status", 0), ("wait",)
    late = (read, wait, wait, status, ("late",))  # 03 0520 0002 is given up, and the line was silent since
    world = play(BY_NAME["b-rtu-late-size"], *late)
    assert world.state.wire is not None
    assert world.state.asked[0]
    world = play(BY_NAME["b-rtu-late-size"], *late, ACK)  # 03 02 0110 behind 03 04 0000 0000
    assert world.is_quiet
    world = play(BY_NAME["b-rtu-late-size"], *late[:-1], ("late_glued",))
    assert world.is_quiet


def test_a_trace_is_printed_as_a_test_with_what_went_over_the_wires() -> None:
    trace = (TO_1, ACK)
    assert any("10 06 06 00 02 04 23 2f 00 00" in line for line in replay(BY_NAME["direct"], trace))
    text = as_test(BY_NAME["direct"], Broken("nothing", trace))
    compile(text, "found", "exec")
    assert "('ask', 0, 'to', 0, 1)" in text


@pytest.mark.skipif(is_compiled(), reason="compiled code has its tables by heart")
def test_the_tables_tell_which_of_their_rows_were_taken() -> None:
    snapshot.watch_tables()
    snapshot.TAKEN.clear()
    play(BY_NAME["direct"], TO_1, ACK, ACK, ("arrive", 0), ("ask", 0, "read", 0), ACK)
    others = {each for each in snapshot.TAKEN if ":" in each}
    assert {"unknown + acknowledged", "moving + in-window"} == snapshot.TAKEN - others
    assert {"request: waiting + added-frame", "request: prerequisite + answered"} <= others
    assert {"request: waiting + frame", "request: sent + acknowledged"} <= others
    assert not any(each.startswith(("gantry", "stop")) for each in others)


def play_in(world: World, *events: Happening) -> None:
    """Let events happen in a world that is there already."""
    for event in events:
        assert event in world.happenings(), event
        world.happen(event)


def snapshot_tokens(world: World) -> list[object]:
    """What each standing object is worth, in words that do not depend on the lens."""
    lens = world.sides[0].lens
    names = {number: found for found, number in lens._tokens_of.items()}
    return [resolved(names[token], names) for token in lens.take(world.now_ns).tokens]


def resolved(found: object, names: dict[int, object]) -> object:
    """Put what they stand for in place of the numbers of remembered objects."""
    if isinstance(found, tuple):
        if len(found) == 2 and found[0] == "#":
            return resolved(names[found[1]], names)
        return tuple(resolved(each, names) for each in found)
    return found


def test_what_no_world_meets_is_there_and_what_was_not_met_is_told() -> None:
    wanted = set(missing(()))
    assert "row moving + in-window" in wanted
    assert missing(wanted) == []
    assert missing(wanted - {"row own + completed"}) == ["row own + completed"]
    everything = {f"row {name}" for name in snapshot.all_rows()} | {
        f"event {each.name}" for each in entries_of(exchange_events)
    }
    assert set(NOT_MET) <= everything
