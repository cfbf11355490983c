"""The tables of states, walked: each happening in each state, reached and caused by what a line does."""

from collections.abc import Callable
from itertools import pairwise, product
from typing import Final

import pytest

from gateway.compensation.moves import Accepted
from gateway.drives.motion import Action
from gateway.exchange.added_frames import AddedFrame, read_word
from gateway.exchange.axis.acknowledge import Outcome, Rendering
from gateway.exchange.axis.axis_request import AxisRequest, Command
from gateway.exchange.axis.interlock import BLOCK_AFTER, Block, BlockEvent
from gateway.exchange.axis.motion import AT_REST, TARGETED, WHEREABOUTS_AFTER, Happening, Whereabouts
from gateway.exchange.axis.reference import (
    FOUND,
    HOMING,
    IN_DOUBT,
    REFERENCE_AFTER,
    REFERENCE_AT_START,
    Referenced,
    ReferenceEvent,
)
from gateway.exchange.axis.transitions import Axis
from gateway.exchange.plan import ControllerPlan, Reference
from gateway.exchange.transaction import OUTCOMES, PHASE_AFTER, Phase, Stopping, Transaction
from gateway.modbus.registers import BitField
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Port, axis_plan

# --- where the axis is -------------------------------------------------------------------------------------

PLACES: Final = {
    "?": Whereabouts.UNKNOWN,
    "S": Whereabouts.STOPPED,
    "H": Whereabouts.RETAINED,
    "O": Whereabouts.OUT_OF_REACH,
    "u": Whereabouts.UNPROVEN,
    "r": Whereabouts.UNPROVEN_AT_REST,
    "w": Whereabouts.UNDER_WAY,
    "s": Whereabouts.SET_OUT,
    "d": Whereabouts.DONE_SAID,
    "t": Whereabouts.SEEN_THERE,
    "A": Whereabouts.ARRIVED,
    "L": Whereabouts.MAY_HAVE_LEFT,
    "a": Whereabouts.STANDS_AGAIN,
}
WALK: Final = """
                    ? S H O u r w s d t A L a
acknowledged        w w w w w w w w w w w w w
acknowledged-at-rest s s s s s s s s s s s s s
unacknowledged      u u u u u u u u u u u u u
ran-not             . . . . w w . . . . . . .
stopped             ? S ? ? ? ? S S S S S S S
displaced           ? ? ? ? ? ? ? ? ? ? ? ? ?
out-of-reach        ? ? . . ? ? O O O O O O O
reference-changed   . . H H . . H H H H H H H
done                . . . . r . d d . A . a .
done-alone          . . . . r . A A . . . . .
fell                . . . . . . . . L . L . L
there               . . . . . . t t A . . . A
near                . . . . . . . . . w a . .
away                . . ? ? . . . . ? ? ? ? ?
"""
"""By hand, from M4 to M6 and M9: a letter is where the axis is then, a dot where nothing changes."""


def _walk() -> dict[tuple[Whereabouts, Happening], Whereabouts]:
    head, *rows = WALK.strip("\n").splitlines()
    columns = [PLACES[letter] for letter in head.split()]
    found = {}
    for row in rows:
        name, *cells = row.split()
        for place, cell in zip(columns, cells, strict=True):
            if cell != ".":
                found[place, Happening(name)] = PLACES[cell]
    return found


def test_the_table_of_whereabouts_is_what_the_rules_say() -> None:
    assert _walk() == WHEREABOUTS_AFTER


DONE_BIT: Final = {"done": BitField(0x30, 0)}


def an_axis(*, has_actual: bool = True) -> Axis:
    return Axis(axis_plan(bits=DONE_BIT, done_drop_ms=0.0, actual=(ACTUAL,) if has_actual else ()))


def target(axis: Axis, counts: int, *, is_distance: bool = False) -> Rendering:
    move = axis.compensation.plan(counts, None, 0)
    start = Accepted(1000, 1010) if is_distance else None
    return Rendering(
        0, COMMAND.pack(counts), COMMAND.pack(counts + 10), counts + 10, move, is_distance, start
    )


def see(axis: Axis, counts: int) -> None:
    axis.observe_actual(ACTUAL, ACTUAL.pack(counts), 5 * MS)


def do(axis: Axis, action: Action) -> None:
    command = Command(
        action=action,
        number=None,
        words={},
        coils={},
        unclear_words=frozenset(),
        written=(),
        modes_written=(),
        epoch=0,
        is_doubtful=False,
    )
    axis.finish(AxisRequest(0, command), Outcome.ACKNOWLEDGED, 0, 1 * MS)


def acknowledge(axis: Axis, counts: int = 50_000) -> None:
    axis.acknowledge(target(axis, counts), 1 * MS)


def leave_unproven(axis: Axis) -> None:
    axis.leave_unproven(target(axis, 70_000, is_distance=True), 1 * MS)


REACHED: Final[dict[Whereabouts, tuple[Callable[[Axis], None], ...]]] = {
    Whereabouts.UNKNOWN: (acknowledge, lambda axis: do(axis, Action.OTHER_MOTION)),
    Whereabouts.STOPPED: (acknowledge, lambda axis: do(axis, Action.STOP)),
    Whereabouts.RETAINED: (acknowledge, lambda axis: axis.wait_for_peers(waits=True)),
    Whereabouts.OUT_OF_REACH: (acknowledge, lambda axis: axis.lose_link(2 * MS)),
    Whereabouts.UNPROVEN: (leave_unproven,),
    Whereabouts.UNPROVEN_AT_REST: (leave_unproven, lambda axis: axis.observe_done(3 * MS, is_done=True)),
    Whereabouts.UNDER_WAY: (acknowledge,),
    Whereabouts.SET_OUT: (
        lambda axis: acknowledge(axis, 40_000),
        lambda axis: do(axis, Action.STOP),
        acknowledge,
    ),
    Whereabouts.DONE_SAID: (acknowledge, lambda axis: axis.observe_done(3 * MS, is_done=True)),
    Whereabouts.SEEN_THERE: (acknowledge, lambda axis: see(axis, 50_010)),
    Whereabouts.ARRIVED: (
        acknowledge,
        lambda axis: axis.observe_done(3 * MS, is_done=True),
        lambda axis: see(axis, 50_010),
    ),
    Whereabouts.MAY_HAVE_LEFT: (
        acknowledge,
        lambda axis: axis.observe_done(3 * MS, is_done=True),
        lambda axis: axis.observe_done(4 * MS, is_done=False),
    ),
    Whereabouts.STANDS_AGAIN: (
        acknowledge,
        lambda axis: axis.observe_done(3 * MS, is_done=True),
        lambda axis: axis.observe_done(4 * MS, is_done=False),
        lambda axis: axis.observe_done(4 * MS, is_done=True),
    ),
}
CAUSED: Final[dict[Happening, Callable[[Axis], None]]] = {
    Happening.UNACKNOWLEDGED: leave_unproven,
    Happening.STOPPED: lambda axis: do(axis, Action.STOP),
    Happening.DISPLACED: lambda axis: do(axis, Action.OTHER_MOTION),
    Happening.OUT_OF_REACH: lambda axis: axis.lose_link(5 * MS),
    Happening.DONE: lambda axis: axis.observe_done(6 * MS, is_done=True),
    Happening.FELL: lambda axis: axis.observe_done(6 * MS, is_done=False),
    Happening.THERE: lambda axis: see(axis, 50_010),
    Happening.AWAY: lambda axis: see(axis, 0),
}


def check(axis: Axis) -> None:
    """What belongs to a place is there in it, and only in it."""
    assert (axis.compensation.accepted is not None) is (axis.whereabouts in TARGETED)
    assert (axis.retained is not None) is (
        axis.whereabouts in (Whereabouts.RETAINED, Whereabouts.OUT_OF_REACH)
    )
    unproven = (Whereabouts.UNPROVEN, Whereabouts.UNPROVEN_AT_REST)
    assert (axis.unproven is not None) is (axis.whereabouts in unproven)


@pytest.mark.parametrize(
    ("place", "happening"), list(product(REACHED, CAUSED)), ids=lambda each: str(each.value)
)
def test_each_happening_is_taken_in_each_place(place: Whereabouts, happening: Happening) -> None:
    axis = an_axis()
    for step in REACHED[place]:
        step(axis)
        check(axis)
    assert axis.whereabouts is place
    CAUSED[happening](axis)
    check(axis)
    after = _walk().get((place, happening), place)
    if (place, happening) == (Whereabouts.UNPROVEN_AT_REST, Happening.FELL):
        after = Whereabouts.UNPROVEN_AT_REST
    assert axis.whereabouts is after


SETS_OUT: Final = """
        ? S H O u r w s d t A L a
seen    w s w w w w w w s s s s s
unseen  w s w w w w w w w s s w w
"""
"""From M6, by hand: whether it is known where an axis sets out, for a target that is another one. A place in
which it was seen to be at its target is known in either row."""


@pytest.mark.parametrize("place", list(REACHED), ids=lambda each: str(each.value))
@pytest.mark.parametrize("row", ["seen", "unseen"])
def test_an_axis_sets_out_from_where_it_is_known_to_stand_or_from_nowhere(
    place: Whereabouts, row: str
) -> None:
    axis = an_axis()
    for step in REACHED[place]:
        step(axis)
    if row == "seen":
        axis.compensation.observe(50_010)
    acknowledge(axis, 55_000)
    check(axis)
    head, *rows = (line.split() for line in SETS_OUT.strip("\n").splitlines())
    [letters] = [cells[1:] for cells in rows if cells[0] == row]
    assert axis.whereabouts is PLACES[letters[[PLACES[letter] for letter in head].index(place)]]
    if place is Whereabouts.RETAINED:
        assert not axis.is_referenced  # it passes 1:1, and is gone to all the same


def test_the_same_target_once_more_makes_an_axis_set_out_from_nowhere_else() -> None:
    axis = an_axis()
    for step in REACHED[Whereabouts.SET_OUT]:
        step(axis)
    for counts, place in ((50_000, Whereabouts.SET_OUT), (55_000, Whereabouts.UNDER_WAY)):
        acknowledge(axis, counts)
        assert axis.whereabouts is place


def test_done_alone_is_arrival_where_no_position_is_mapped() -> None:
    axis = an_axis(has_actual=False)
    acknowledge(axis)
    axis.observe_done(3 * MS, is_done=True)
    assert axis.whereabouts is Whereabouts.ARRIVED


@pytest.mark.parametrize(
    ("was_done", "after"), [(False, Whereabouts.SEEN_THERE), (True, Whereabouts.ARRIVED)]
)
def test_a_distance_that_did_not_run_leaves_the_axis_at_its_start(was_done: bool, after: Whereabouts) -> None:
    axis = an_axis()
    leave_unproven(axis)
    if was_done:
        axis.observe_done(3 * MS, is_done=True)
    see(axis, 1010)
    assert axis.compensation.accepted == Accepted(1000, 1010)
    assert axis.whereabouts is after
    check(axis)


def test_a_distance_that_ran_leaves_it_at_its_end() -> None:
    axis = an_axis()
    leave_unproven(axis)
    see(axis, 70_010)
    assert axis.compensation.accepted == Accepted(70_000, 70_010)
    assert axis.whereabouts is Whereabouts.SEEN_THERE
    check(axis)


@pytest.mark.parametrize(
    ("outcome", "code", "after"),
    [
        (Outcome.ACKNOWLEDGED, 0, Whereabouts.UNKNOWN),
        (Outcome.NO_REPLY, 0x0B, Whereabouts.UNKNOWN),
        (Outcome.EXCEPTION, 4, Whereabouts.UNKNOWN),
        (Outcome.EXCEPTION, 1, Whereabouts.UNDER_WAY),  # what a drive does not know it has not done
    ],
)
def test_a_distance_that_passed_unchanged_leaves_nobody_knowing_where_the_axis_is(
    outcome: Outcome, code: int, after: Whereabouts
) -> None:
    axis = an_axis()
    acknowledge(axis)
    request = AxisRequest(0)
    request.goes_unknown = True
    axis.finish(request, outcome, code, 9 * MS)
    assert axis.whereabouts is after
    check(axis)


def test_a_sample_of_before_the_motion_shows_nothing() -> None:
    axis = an_axis()
    acknowledge(axis)
    axis.observe_done(1 * MS - 1, is_done=True)
    axis.observe_actual(ACTUAL, ACTUAL.pack(50_010), 1 * MS - 1)
    assert axis.whereabouts is Whereabouts.UNDER_WAY


def test_an_axis_is_at_rest_only_where_something_says_so() -> None:
    assert {place for place in Whereabouts if place not in AT_REST} == {
        Whereabouts.UNKNOWN,
        Whereabouts.STOPPED,
        Whereabouts.RETAINED,
        Whereabouts.OUT_OF_REACH,
        Whereabouts.UNPROVEN,
        Whereabouts.UNDER_WAY,
        Whereabouts.SET_OUT,
    }


# --- whether it knows where it is --------------------------------------------------------------------------

REFERENCES: Final = {
    "U": Referenced.UNTOLD,
    "V": Referenced.UNTOLD_HOMING,
    "l": Referenced.LOST,
    "L": Referenced.LOST_IN_DOUBT,
    "h": Referenced.HOMING,
    "H": Referenced.HOMING_IN_DOUBT,
    "f": Referenced.FOUND,
    "F": Referenced.FOUND_IN_DOUBT,
}
REFERENCE_WALK: Final = {
    Reference.ABSOLUTE: """
                 l f
    set-at-rest  . l
    set-moving   . l
    declared     f .
    """,
    Reference.SET_POSITION: """
                 l f
    homing       . l
    set-at-rest  f .
    set-moving   . l
    loss         . l
    declared     f .
    """,
    Reference.HOMING: """
                 l h f
    bit-set      . f .
    homing       h . h
    other-motion . l .
    set-at-rest  . l l
    set-moving   . l l
    loss         . l l
    declared     f f .
    """,
    Reference.DRIVE_BIT: """
                 U V l L H f F
    bit-set      f f f f f . f
    bit-clear    l l . l l l l
    homing       V . H H . H H
    other-motion . U . . L . .
    set-at-rest  . U L . L L L
    set-moving   . U L . L L L
    loss         . U L . L F .
    silence      . . L . . F .
    """,
}
"""By hand, from M9: capital letters are to be asked before positions pass."""


@pytest.mark.parametrize("kind", Reference)
def test_the_table_of_references_is_what_the_rules_say(kind: Reference) -> None:
    head, *rows = REFERENCE_WALK[kind].strip().splitlines()
    columns = [REFERENCES[letter] for letter in head.split()]
    expected = {}
    for row in rows:
        name, *cells = row.split()
        for state, cell in zip(columns, cells, strict=True):
            if cell != ".":
                expected[ReferenceEvent(name), state] = REFERENCES[cell]
    changes = {
        (event, state): after
        for event, by_state in REFERENCE_AFTER[kind].items()
        for state, after in by_state.items()
        if after is not state and state in columns  # no other one is ever reached
    }
    assert changes == expected
    assert REFERENCE_AT_START[kind] in columns
    assert set(changes.values()) <= set(columns)


def test_every_state_of_a_reference_is_one_thing() -> None:
    assert not FOUND & HOMING
    assert {Referenced.UNTOLD, Referenced.UNTOLD_HOMING} <= IN_DOUBT


@pytest.mark.parametrize("kind", Reference)
def test_no_state_leads_nowhere(kind: Reference) -> None:
    """From each state that is reached there is a way to be referenced."""
    after = REFERENCE_AFTER[kind]
    reached = {REFERENCE_AT_START[kind]}
    while True:
        more = {by_state[s] for by_state in after.values() for s in reached if s in by_state} - reached
        if not more:
            break
        reached |= more
    for state in reached:
        ways = {state}
        while not ways & FOUND:
            more = {by_state[s] for by_state in after.values() for s in ways if s in by_state} - ways
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
    BlockEvent.COMPLETED: lambda axis: write_whole(axis, epoch=axis.epoch),
}
BLOCK_WALK: Final = {
    (Block.NONE, BlockEvent.LOST): Block.OWN,
    (Block.NONE, BlockEvent.LOST_OF_GROUP): Block.OF_GROUP,
    (Block.NONE, BlockEvent.COMPLETED): Block.NONE,
    (Block.OWN, BlockEvent.LOST): Block.OWN,
    (Block.OWN, BlockEvent.LOST_OF_GROUP): Block.OWN,
    (Block.OWN, BlockEvent.COMPLETED): Block.NONE,
    (Block.OF_GROUP, BlockEvent.LOST): Block.OWN,
    (Block.OF_GROUP, BlockEvent.LOST_OF_GROUP): Block.OF_GROUP,
    (Block.OF_GROUP, BlockEvent.COMPLETED): Block.NONE,
}
"""By hand, from M3 and M11."""


def write_whole(axis: Axis, *, epoch: int) -> None:
    command = Command(
        action=Action.IGNORE,
        number=None,
        words={},
        coils={},
        unclear_words=frozenset(),
        written=(0,),
        modes_written=(),
        epoch=epoch,
        is_doubtful=False,
    )
    axis.finish(AxisRequest(0, command), Outcome.ACKNOWLEDGED, 0, 1 * MS)


@pytest.mark.parametrize(("block", "event"), list(product(Block, BlockEvent)), ids=lambda each: each.value)
def test_each_loss_blocks_and_each_complete_target_lets_go(block: Block, event: BlockEvent) -> None:
    axis = an_axis()
    for step in BLOCKED[block]:
        step(axis)
    assert axis.block is block
    BLOCK_CAUSED[event](axis)
    assert axis.block is BLOCK_WALK[block, event]
    assert BLOCK_AFTER.get((block, event), block) is BLOCK_WALK[block, event]
    if block is not Block.NONE:
        assert axis.block_code == 4  # that of the loss which blocked it
    told = {
        (True, False): ["axis-blocked"],
        (False, True): ["axis-released"],
    }.get((block is Block.NONE, axis.block is Block.NONE), [])
    assert [each.kind.value for each in axis.take_events()][len(BLOCKED[block]) :] == told


def test_what_was_sent_before_a_loss_does_not_let_go_of_its_block() -> None:
    axis = an_axis()
    axis.block_triggers(4, "lost")
    write_whole(axis, epoch=axis.epoch - 1)
    assert axis.block is Block.OWN


# --- a transaction -----------------------------------------------------------------------------------------


def a_transaction(phase: Phase) -> Transaction:
    transaction = Transaction(Port(ControllerPlan("cnc")), 1, 1, b"\x03\0\0\0\1", 0)
    if phase is Phase.PREREQUISITE:
        transaction.need(read_word(an_axis(), 0x10))
        transaction.leave(1, 1, MS)
    elif phase is Phase.LEAVING:
        transaction.lead()
    elif phase is Phase.SENT:
        transaction.leave(1, 1, MS)
    elif phase is Phase.ENDED:
        transaction.end(Outcome.NEVER_SENT)
    assert transaction.phase is phase
    return transaction


def leave(transaction: Transaction, added: AddedFrame | None) -> None:
    transaction.need(added)
    transaction.leave(2, 1, MS)


@pytest.mark.parametrize(("phase", "after"), list(product(Phase, Phase)))
def test_a_transaction_goes_on_as_the_table_says(phase: Phase, after: Phase) -> None:
    transaction = a_transaction(phase)
    steps: dict[Phase, Callable[[], None]] = {
        Phase.WAITING: transaction.learn,
        Phase.PREREQUISITE: lambda: leave(transaction, read_word(an_axis(), 0x10)),
        Phase.LEAVING: transaction.lead,
        Phase.SENT: lambda: leave(transaction, None),
        Phase.ENDED: lambda: transaction.end(next(iter(OUTCOMES[phase]))),
    }
    if after in PHASE_AFTER[phase]:
        steps[after]()
        assert transaction.phase is after
    else:
        with pytest.raises((AssertionError, StopIteration)):
            steps[after]()
        assert transaction.phase is phase


@pytest.mark.parametrize(("phase", "outcome"), list(product(Phase, Outcome)))
def test_only_what_left_can_be_answered_and_only_what_did_not_can_be_withdrawn(
    phase: Phase, outcome: Outcome
) -> None:
    transaction = a_transaction(phase)
    may = {
        Phase.WAITING: outcome is Outcome.NEVER_SENT,
        Phase.PREREQUISITE: outcome is Outcome.NEVER_SENT,
        Phase.LEAVING: outcome is Outcome.NEVER_SENT,
        Phase.SENT: outcome is not Outcome.NEVER_SENT,
        Phase.ENDED: False,
    }[phase]
    if may:
        transaction.end(outcome)
        assert transaction.phase is Phase.ENDED
    else:
        with pytest.raises(AssertionError):
            transaction.end(outcome)


@pytest.mark.parametrize(
    ("stopping", "step", "after"),
    [
        ("no", "become_stop", "first"),
        ("no", "leave_early", None),
        ("no", "become_again", None),
        ("first", "become_stop", None),
        ("first", "leave_early", "early"),
        ("first", "become_again", "again"),
        ("early", "become_stop", None),
        ("early", "leave_early", None),
        ("early", "become_again", None),
        ("again", "become_stop", None),
        ("again", "leave_early", None),
        ("again", "become_again", "again"),
        ("once", "become_stop", None),
        ("once", "leave_early", None),
        ("once", "become_again", "once"),
    ],
)
def test_a_stop_leaves_early_once_and_once_more_at_most(stopping: str, step: str, after: str | None) -> None:
    sent_before = a_transaction(Phase.WAITING)
    sent_before.become_stop()
    again = sent_before.once_more()
    assert again.stopping is Stopping.AGAIN
    stop = a_transaction(Phase.WAITING)
    if stopping != "no":
        stop.become_stop(only_stops=stopping != "once")
    if stopping == "early":
        stop.leave_early()
    elif stopping == "again":
        stop.become_again(again)
    assert stop.stopping.value == stopping
    steps: dict[str, Callable[[], None]] = {
        "become_stop": stop.become_stop,
        "leave_early": stop.leave_early,
        "become_again": lambda: stop.become_again(again),
    }
    if after is None:
        with pytest.raises(AssertionError):
            steps[step]()
    else:
        steps[step]()
        assert stop.stopping.value == after


def test_no_way_leads_to_sending_twice() -> None:
    """Walked to the end: on each way from the arrival SENT comes once at most."""
    ways: list[tuple[Phase, ...]] = [(Phase.WAITING,)]
    for _ in range(8):
        ways = [(*way, after) for way in ways for after in PHASE_AFTER[way[-1]]]
        for way in ways:
            assert way.count(Phase.SENT) <= 1
            assert way.count(Phase.LEAVING) <= 1
            assert all(b in PHASE_AFTER[a] for a, b in pairwise(way))
