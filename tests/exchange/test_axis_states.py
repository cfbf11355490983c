"""The tables of states: each event in each state, reached and caused by steps of a line."""

from collections.abc import Callable
from itertools import product
from typing import Final

import pytest

from gateway.catalogue import exchange_events
from gateway.compensation.moves import Accepted
from gateway.drives.motion import Action
from gateway.exchange.axis.acknowledge import ON_WIRE_AFTER, OnWire, Outcome, WireEvent
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.impossible import ImpossibleEventError
from gateway.exchange.axis.interlock import BLOCK_AFTER, Block, BlockEvent
from gateway.exchange.axis.motion import MOTION_AFTER, TARGETED, MotionEvent, MotionState
from gateway.exchange.axis.reference import (
    REFERENCE_AFTER,
    REFERENCE_AT_START,
    ReferenceEvent,
    ReferenceState,
)
from gateway.exchange.decode import AxisCommand
from gateway.exchange.plan import Reference
from gateway.exchange.unit import UnitMap
from gateway.modbus.registers import BitField
from tests.exchange.axis_bench import (
    DONE_BIT,
    REACHED,
    acknowledge,
    an_axis,
    do,
    end,
    leave_unacknowledged,
    reached,
    see,
)
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan
from tests.support.tables import walk

# --- where the axis is -------------------------------------------------------------------------------------

PLACES: Final = {
    "?": MotionState.UNKNOWN,
    "S": MotionState.STOPPED,
    "K": MotionState.SUPERSEDED,
    "u": MotionState.UNACKNOWLEDGED,
    "w": MotionState.MOVING,
    "d": MotionState.DONE_REPORTED,
    "t": MotionState.IN_WINDOW,
    "A": MotionState.ARRIVED,
    "L": MotionState.MAY_HAVE_LEFT,
    "a": MotionState.AT_REST,
}
WALK: Final = """
                    ? S K u w d t A L a
acknowledged        w w w w w w w w w w
not-acknowledged    u u u u u u u u u u
not-executed        x x x w x x x x x x
stopped             ? S ? ? S S S S S S
displaced           ? ? ? ? ? ? ? ? ? ?
link-lost           x x K x K K K K K K
reference-changed   x x K x K K K K K K
done                . . . u d . A . a .
done-alone          . . . u A x x . . x
not-done            . . . . . L . L . L
in-window           . x x x t A . . . A
beside              x x x x . . w a . .
elsewhere           x x ? x . ? ? ? ? ?
"""
"""By hand, from M4 to M6 and M9: a letter is where the axis is then, a dot where nothing changes, an x what
cannot be."""


def _walk() -> dict[tuple[MotionState, MotionEvent], MotionState | None]:
    cells = walk(WALK).items()
    return {(PLACES[p], MotionEvent(e)): None if c == "." else PLACES[c] for (p, e), c in cells if c != "x"}


def test_the_table_of_motion_is_what_the_rules_say() -> None:
    assert {(place, e): then for place, row in MOTION_AFTER.items() for e, then in row.items()} == _walk()
    assert list(MOTION_AFTER) == list(MotionState)


CAUSED: Final[dict[MotionEvent, Callable[[Axis], None]]] = {
    MotionEvent.NOT_ACKNOWLEDGED: leave_unacknowledged,
    MotionEvent.STOPPED: lambda axis: do(axis, Action.STOP),
    MotionEvent.DISPLACED: lambda axis: do(axis, Action.OTHER_MOTION),
    MotionEvent.LINK_LOST: lambda axis: axis.lose_link(5 * MS),
    MotionEvent.DONE: lambda axis: axis.motion.observe_done(6 * MS, is_done=True),
    MotionEvent.NOT_DONE: lambda axis: axis.motion.observe_done(6 * MS, is_done=False),
    MotionEvent.IN_WINDOW: lambda axis: see(axis, 50_010),
    MotionEvent.ELSEWHERE: lambda axis: see(axis, 0),
}


def check(axis: Axis) -> None:
    """Check that the data of a state is present in that state, and only in it."""
    motion = axis.motion
    assert (axis.compensation.accepted is not None) is (motion.state in TARGETED)
    assert (motion.superseded is not None) is (motion.state is MotionState.SUPERSEDED)
    assert (motion.unacknowledged is not None) is (motion.state is MotionState.UNACKNOWLEDGED)
    assert motion.state is MotionState.UNACKNOWLEDGED or not motion.has_reported_done
    assert motion.state is MotionState.MOVING or not motion.is_start_known


@pytest.mark.parametrize(("way", "event"), list(product(REACHED, CAUSED)))
def test_each_event_is_taken_in_each_state(way: str, event: MotionEvent) -> None:
    axis = an_axis()
    place, steps = REACHED[way]
    for step in steps:
        step(axis)
        check(axis)
    assert axis.motion.state is place
    CAUSED[event](axis)
    check(axis)
    after = _walk().get((place, event)) or place
    if event is MotionEvent.LINK_LOST and (place, event) not in _walk():
        after = MotionState.UNKNOWN  # no target is kept: it is displaced
    assert axis.motion.state is after
    was_done = way == "unacknowledged-done" or (way, event) == ("unacknowledged", MotionEvent.DONE)
    if event in (MotionEvent.DONE, MotionEvent.NOT_DONE, MotionEvent.IN_WINDOW, MotionEvent.ELSEWHERE):
        assert axis.motion.has_reported_done is was_done


SETS_OUT: Final = {
    # way: where it sets out is known, of an axis that was seen since, of one that was not
    "unknown": (False, False),
    "stopped": (True, True),
    "unreferenced": (False, False),
    "out-of-reach": (False, False),
    "unacknowledged": (False, False),
    "unacknowledged-done": (False, False),
    "moving": (False, False),
    "moving-from-a-known-start": (False, False),
    "done-reported": (True, False),
    "in-window": (True, True),
    "arrived": (True, True),
    "may-have-left": (True, False),
    "at-rest": (True, False),
}
"""From M6, by hand: whether it is known where an axis sets out, for a target that is another one. A state in
which it was seen to be at its target is known in either case."""


@pytest.mark.parametrize("way", list(REACHED))
@pytest.mark.parametrize("is_seen", [True, False])
def test_a_move_starts_at_the_known_position_or_at_an_unknown_one(way: str, is_seen: bool) -> None:
    axis = reached(way)
    if is_seen:
        axis.compensation.observe(50_010)
    acknowledge(axis, 55_000)
    check(axis)
    assert axis.motion.state is MotionState.MOVING
    assert axis.motion.is_start_known is SETS_OUT[way][0 if is_seen else 1]
    if way == "unreferenced":
        assert not axis.reference.is_referenced  # it passes 1:1, and is gone to all the same


def test_the_same_target_keeps_the_start_of_the_move_and_another_one_does_not() -> None:
    axis = reached("moving-from-a-known-start")
    for counts, is_known in ((50_000, True), (55_000, False)):
        acknowledge(axis, counts)
        assert axis.motion.state is MotionState.MOVING
        assert axis.motion.is_start_known is is_known


def test_done_alone_is_arrival_if_no_position_is_mapped() -> None:
    axis = an_axis(has_actual=False)
    acknowledge(axis)
    axis.motion.observe_done(3 * MS, is_done=True)
    assert axis.motion.state is MotionState.ARRIVED


@pytest.mark.parametrize(("was_done", "after"), [(False, MotionState.IN_WINDOW), (True, MotionState.ARRIVED)])
def test_a_distance_that_did_not_run_leaves_the_axis_at_its_start(was_done: bool, after: MotionState) -> None:
    axis = an_axis()
    leave_unacknowledged(axis)
    if was_done:
        axis.motion.observe_done(3 * MS, is_done=True)
    see(axis, 1010)
    assert axis.compensation.accepted == Accepted(1000, 1010)
    assert axis.motion.state is after
    check(axis)


def test_a_distance_that_ran_leaves_it_at_its_end() -> None:
    axis = an_axis()
    leave_unacknowledged(axis)
    see(axis, 70_010)
    assert axis.compensation.accepted == Accepted(70_000, 70_010)
    assert axis.motion.state is MotionState.IN_WINDOW
    check(axis)


@pytest.mark.parametrize(
    ("outcome", "code", "after"),
    [
        (Outcome.ACKNOWLEDGED, 0, MotionState.UNKNOWN),
        (Outcome.NO_REPLY, 0x0B, MotionState.UNKNOWN),
        (Outcome.EXCEPTION, 4, MotionState.UNKNOWN),
        (Outcome.EXCEPTION, 1, MotionState.MOVING),  # what a drive does not know it has not done
    ],
)
def test_after_an_unchanged_distance_nothing_is_known(
    outcome: Outcome, code: int, after: MotionState
) -> None:
    axis = an_axis()
    acknowledge(axis)
    command = AxisCommand(axis)
    command.goes_unknown = True
    end(command, outcome, code, 9 * MS)
    assert axis.motion.state is after
    check(axis)


def test_a_sample_from_before_the_motion_shows_nothing() -> None:
    axis = an_axis()
    acknowledge(axis)
    axis.motion.observe_done(1 * MS - 1, is_done=True)
    axis.observe_actual(ACTUAL, ACTUAL.pack(50_010), 1 * MS - 1)
    assert axis.motion.state is MotionState.MOVING


@pytest.mark.parametrize("way", list(REACHED))
def test_an_axis_is_at_rest_only_if_a_bit_or_position_shows_it(way: str) -> None:
    axis = reached(way)
    says_so = {"unacknowledged-done", "done-reported", "in-window", "arrived", "may-have-left", "at-rest"}
    assert axis.motion.is_at_rest is (way in says_so)


# --- impossible events -------------------------------------------------------------------------------------


def test_an_impossible_event_raises_an_error_in_a_test() -> None:
    axis = an_axis()
    with pytest.raises(ImpossibleEventError, match="motion: beside cannot be in unknown"):
        axis.motion.happens(MotionEvent.BESIDE)
    with pytest.raises(ImpossibleEventError, match="reference: silence cannot be in referenced"):
        axis.reference.happens(ReferenceEvent.SILENCE)
    with pytest.raises(ImpossibleEventError, match="motion: unacknowledged without what belongs to it"):
        axis.motion.enter(MotionState.UNACKNOWLEDGED)
    with pytest.raises(ImpossibleEventError, match="motion: moving without what belongs to it"):
        axis.motion.enter(MotionState.MOVING)


@pytest.mark.usefixtures("in_production")
def test_an_impossible_event_is_reported_in_production_and_the_worst_is_assumed() -> None:
    bench = Bench(axis_plan(bits={"homed": BitField(0x30, 0)}, referenced=Reference.DRIVE_BIT))
    axis = bench.line.axes[0]

    def now() -> tuple[MotionState, bool, bool, bool]:
        check(axis)
        reference = axis.reference
        return (
            axis.motion.state,
            reference.is_referenced,
            reference.is_unconfirmed,
            axis.interlock.is_blocked,
        )

    axis.see_homed_bit(0, is_set=True)
    acknowledge(axis)
    assert now() == (MotionState.MOVING, True, False, False)
    axis.motion.happens(MotionEvent.NOT_EXECUTED)
    assert now() == (MotionState.UNKNOWN, False, True, True)  # the bit is read before positions pass
    axis.see_homed_bit(5 * MS, is_set=True)
    write_whole(axis, epoch=axis.interlock.epoch)
    assert now() == (MotionState.UNKNOWN, True, False, False)
    acknowledge(axis)
    axis.motion.enter(MotionState.SUPERSEDED)
    assert now() == (MotionState.UNKNOWN, False, True, True)
    bench.ask(b"\x03\x00\x50\x00\x01")
    told = [each for each in bench.events if each.kind is exchange_events.INTERNAL_FAULT]
    assert [each.detail for each in told] == [
        "motion: not-executed cannot be in moving",
        "motion: superseded without what belongs to it",
    ]
    assert bench.line.counters.internal_faults == 2


# --- whether the axis is referenced ------------------------------------------------------------------------

REFERENCES: Final = {
    "l": ReferenceState.NOT_REFERENCED,
    "h": ReferenceState.HOMING,
    "f": ReferenceState.REFERENCED,
}
REFERENCE_WALK: Final = {
    Reference.ABSOLUTE: """
                 l f
    homing       . .
    other-motion . .
    set-at-rest  . l
    set-moving   . l
    loss         . .
    declared     f .
    """,
    Reference.SET_POSITION: """
                 l f
    homing       . l
    other-motion . .
    set-at-rest  f .
    set-moving   . l
    loss         . l
    declared     f .
    """,
    Reference.HOMING: """
                 l h f
    bit-set      x f x
    homing       h . h
    other-motion . l .
    set-at-rest  . l l
    set-moving   . l l
    loss         . l l
    declared     f f .
    """,
    Reference.DRIVE_BIT: """
                 l h f
    bit-set      f f .
    bit-clear    . l l
    homing       h . h
    other-motion . l .
    set-at-rest  . l l
    set-moving   . l l
    loss         . l .
    silence      . . .
    """,
}
"""By hand, from M9; a dot where the state stays, x and rows that are not there: what cannot be."""


@pytest.mark.parametrize("kind", Reference)
def test_the_table_of_references_is_what_the_rules_say(kind: Reference) -> None:
    expected = {
        (REFERENCES[state], ReferenceEvent(event)): None if cell == "." else REFERENCES[cell]
        for (state, event), cell in walk(REFERENCE_WALK[kind]).items()
        if cell != "x"
    }
    table = REFERENCE_AFTER[kind]
    assert {(state, e): then for state, row in table.items() for e, then in row.items()} == expected
    assert REFERENCE_AT_START[kind] in {state for state, _ in expected}


UNCONFIRMED: Final = """
             u c
bit-set      c c
bit-clear    c c
homing       u u
other-motion u c
set-at-rest  u u
set-moving   u u
loss         u u
silence      u u
"""
"""By hand, from M9: whether the bit of the drive has to be read before positions pass, whatever the state."""


@pytest.mark.parametrize("row", UNCONFIRMED.strip("\n").splitlines()[1:])
@pytest.mark.parametrize("first", [None, ReferenceEvent.BIT_SET, ReferenceEvent.BIT_CLEAR])
def test_the_homed_bit_is_read_after_every_event_that_may_change_it(
    row: str, first: ReferenceEvent | None
) -> None:
    name, unconfirmed, confirmed = row.split()
    reference = Axis(axis_plan(bits=DONE_BIT, referenced=Reference.DRIVE_BIT)).reference
    if first is not None:
        reference.happens(first)
    assert (reference.is_unconfirmed, reference.was_reported) == (first is None, first is not None)
    reference.happens(ReferenceEvent(name))
    assert reference.is_unconfirmed is ((unconfirmed if first is None else confirmed) == "u")
    assert reference.was_reported is (first is not None or name.startswith("bit-"))


@pytest.mark.parametrize("kind", Reference)
def test_referenced_can_be_reached_from_each_state(kind: Reference) -> None:
    """From each state the axis can become referenced."""
    after = REFERENCE_AFTER[kind]
    for state in after:
        ways = {state}
        while ReferenceState.REFERENCED not in ways:
            more = {then for each in ways for then in after[each].values() if then is not None} - ways
            assert more, state
            ways |= more


# --- whether its triggers are refused ----------------------------------------------------------------------

BLOCKED: Final[dict[Block, tuple[Callable[[Axis], None], ...]]] = {
    Block.NONE: (),
    Block.OWN: (lambda axis: axis.block_triggers(4, "lost"),),
    Block.OF_GROUP: (lambda axis: axis.block_triggers(4, "lost", is_own=False),),
}
BLOCK_CAUSED: Final[dict[BlockEvent, Callable[[Axis], None]]] = {
    BlockEvent.LOST: lambda axis: axis.block_triggers(6, "lost"),
    BlockEvent.LOST_OF_GROUP: lambda axis: axis.block_triggers(6, "lost", is_own=False),
    BlockEvent.COMPLETED: lambda axis: write_whole(axis, epoch=axis.interlock.epoch),
}
BLOCK_WALK: Final = walk("""
               none      own   of-group
lost           own       own   own
lost-of-group  of-group  own   of-group
completed      none      none  none
""")
"""By hand, from M3 and M11."""


def write_whole(axis: Axis, *, epoch: int) -> None:
    command = AxisCommand(axis, hits=UnitMap([axis]).written(COMMAND.address, 2).fields)
    command.epoch = epoch
    end(command, Outcome.ACKNOWLEDGED, 0, 1 * MS)


@pytest.mark.parametrize(("block", "event"), list(product(Block, BlockEvent)), ids=lambda each: each.value)
def test_each_loss_blocks_and_each_complete_target_unblocks(block: Block, event: BlockEvent) -> None:
    axis = an_axis()
    for step in BLOCKED[block]:
        step(axis)
    assert axis.interlock.block is block
    axis.take_events()
    BLOCK_CAUSED[event](axis)
    assert axis.interlock.block.value == BLOCK_WALK[block.value, event.value]
    assert axis.interlock.block is (BLOCK_AFTER[block][event] or block)
    if block is not Block.NONE:
        is_its_own_now = (block, event) == (Block.OF_GROUP, BlockEvent.LOST)
        assert axis.interlock.block_code == (6 if is_its_own_now else 4)  # that of the loss which blocks it
    told = {(True, False): ["axis-blocked"], (False, True): ["axis-released"]}.get(
        (block is Block.NONE, axis.interlock.block is Block.NONE), []
    )
    assert [each.kind.name for each in axis.take_events()] == told


def test_a_target_sent_before_a_loss_does_not_unblock() -> None:
    axis = an_axis()
    axis.block_triggers(4, "lost")
    write_whole(axis, epoch=axis.interlock.epoch - 1)
    assert axis.interlock.block is Block.OWN


# --- what is on the wire -----------------------------------------------------------------------------------

WIRE_WALK: Final = """
            nothing target motion
target-sent target  target .
motion-sent motion  motion .
ended       .       nothing nothing
"""
"""By hand: what a record has to say of what is on its way to the drive."""


def test_the_table_of_what_is_on_the_wire_is_what_a_record_says() -> None:
    expected = {
        (OnWire(state), WireEvent(event)): None if cell == "." else OnWire(cell)
        for (state, event), cell in walk(WIRE_WALK).items()
    }
    assert {(state, e): then for state, row in ON_WIRE_AFTER.items() for e, then in row.items()} == expected
