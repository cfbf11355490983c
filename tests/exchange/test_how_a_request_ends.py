"""What the end of a request changes in its axis: what is proven, and what is left open (M7)."""

from typing import Any, Final

import pytest

from gateway.drives.motion import Action, ModePlan, MotionPlan
from gateway.exchange.access import Access
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.axis.reference import ReferenceState
from gateway.exchange.decode import AxisCommand, DecodedRequest, Part, Staging
from gateway.exchange.effects import leave
from gateway.exchange.plan import CompensationMode, Reference
from gateway.exchange.request import NOTHING_PREFETCHED, Request
from gateway.exchange.unit import FieldHit, UnitMap
from gateway.modbus.registers import BitField
from tests.exchange.axis_bench import REACHED, WRITE, an_axis, end, see, target
from tests.exchange.line_bench import COMMAND, MS, Bench, axis_plan

NOMINAL: Final = COMMAND.pack(50_000)
CORRECTED: Final = COMMAND.pack(50_010)
MODE: Final = 0x32
STAGED: Final = MotionPlan(is_staged=True, modes=(ModePlan(MODE, actions={1: Action.ABSOLUTE}),))
ACK, REFUSED, SILENT, BROADCAST = Outcome.ACKNOWLEDGED, Outcome.EXCEPTION, Outcome.NO_REPLY, Outcome.BROADCAST
OPEN: Final = (SILENT, BROADCAST, Outcome.OTHER_REPLY)


def reached(axis: Axis, way: str) -> Axis:
    for step in REACHED[way][1]:
        step(axis)
    return axis


def writes(axis: Axis, action: Action = Action.IGNORE, **changes: Any) -> AxisCommand:
    """A command that writes the command field of the axis."""
    unit = UnitMap([axis])
    hits: tuple[FieldHit, ...] = unit.written(COMMAND.address, 2).by_axis[0].commands
    return AxisCommand(axis, action, 0, hits, **changes)


def kinds(axis: Axis) -> list[str]:
    return [event.kind.name for event in axis.take_events()]


# --- when it is sent ---------------------------------------------------------------------------------------


def test_a_frame_of_unknown_meaning_is_reported_with_the_mode_that_is_known() -> None:
    axis = an_axis(motion=STAGED)
    axis.rules.store_read(MODE, 9)
    command = AxisCommand(axis, Action.UNKNOWN, 0, words={0x30: 7})
    frame = DecodedRequest(
        UnitMap([axis]), WRITE, Access(write_address=COMMAND.address, write_quantity=2), {}
    )
    assert leave(Request(frame, [command], NOTHING_PREFETCHED, 0, arrived_ns=0), 1 * MS) == 1
    [event] = axis.take_events()
    assert event.kind.name == "unknown-mode"
    assert "0x0030 = 0x0007, 0x0032 = 0x0009" in event.detail


# --- when it was obeyed ------------------------------------------------------------------------------------


def test_a_stream_that_began_is_reported_when_its_first_setpoint_was_taken() -> None:
    axis = an_axis()
    axis.reports.begin_stream(0.5, 0.0)
    command = AxisCommand(axis, Action.ABSOLUTE, 0)
    command.targets.append(target(axis, 50_000))
    end(command, SILENT, 0x0B, 1 * MS)
    assert "stream-began" not in kinds(axis)
    end(command, ACK, 0, 2 * MS)
    assert "stream-began" in kinds(axis)


def test_registers_and_coils_are_known_as_they_were_written() -> None:
    axis = an_axis(motion=STAGED)
    axis.rules.store_read(0x31, 5)
    end(AxisCommand(axis, words={MODE: 1}, coils={0x40: 1}, unclear_words=frozenset({0x31})), ACK, 0, 1 * MS)
    assert (axis.rules.word(MODE), axis.rules.coil(0x40), axis.rules.word(0x31)) == (1, 1, None)


@pytest.mark.parametrize("outcome", OPEN)
def test_they_are_unknown_where_the_drive_may_have_taken_them(outcome: Outcome) -> None:
    axis = an_axis(motion=STAGED)
    axis.rules.store_words({MODE: 1, 0x31: 5}, 0)
    axis.rules.store_coils({0x40: 1})
    command = AxisCommand(axis, words={MODE: 2}, coils={0x40: 0}, unclear_words=frozenset({0x31}))
    end(command, outcome, 0x0B, 1 * MS)
    assert (axis.rules.word(MODE), axis.rules.coil(0x40), axis.rules.word(0x31)) == (None, None, None)


def test_they_are_as_before_where_an_exception_proves_it() -> None:
    """Code 1: the drive does not know the function."""
    axis = an_axis(motion=STAGED)
    axis.rules.store_words({MODE: 1}, 0)
    end(AxisCommand(axis, Action.OTHER_MOTION, words={MODE: 2}), REFUSED, 1, 1 * MS)
    assert axis.rules.word(MODE) == 1
    axis = reached(an_axis(), "arrived")
    end(AxisCommand(axis, Action.OTHER_MOTION), REFUSED, 1, 2 * MS)
    assert axis.motion.state is MotionState.ARRIVED


def test_a_run_ends_a_homing_and_what_was_staged_is_run() -> None:
    axis = an_axis(referenced=Reference.HOMING, bits={"homed": BitField(0x30, 3)}, motion=STAGED)
    axis.begin_homing(1 * MS, is_certain=True)
    axis.targets.mark_staged()
    end(AxisCommand(axis, Action.RELATIVE, 0), ACK, 0, 2 * MS)
    assert axis.reference.state is ReferenceState.NOT_REFERENCED
    assert not axis.targets.holds_unrun
    assert axis.targets.last_run is Action.RELATIVE


@pytest.mark.parametrize("outcome", [ACK, SILENT])
@pytest.mark.parametrize(
    ("action", "passes", "is_unsure"),
    [(Action.STORED, False, True), (Action.STORED, True, False), (Action.OTHER_MOTION, False, False)],
)
def test_a_stored_position_was_not_corrected(
    outcome: Outcome, action: Action, passes: bool, is_unsure: bool
) -> None:
    bench = Bench(axis_plan(compensation=CompensationMode.SHADOW if passes else CompensationMode.ON))
    bench.move(20_000, 50_000)
    [axis] = bench.line.axes
    was_unsure = [axis.compensation.is_unsure]
    end(AxisCommand(axis, action), outcome, 0x0B, bench.now_ns)
    was_unsure.append(axis.compensation.is_unsure)
    assert was_unsure == [False, is_unsure]


@pytest.mark.parametrize("outcome", [ACK, SILENT])
@pytest.mark.parametrize(("mode", "is_unsure"), [(CompensationMode.ON, True), (CompensationMode.OFF, False)])
def test_words_that_were_not_corrected_for_an_axis_make_it_unsure(
    outcome: Outcome, mode: CompensationMode, is_unsure: bool
) -> None:
    axis = an_axis(compensation=mode)
    see(axis, 20_000)
    was_unsure = axis.compensation.is_unsure
    command = AxisCommand(axis)
    command.run_uncorrected()
    end(command, outcome, 0x0B, 2 * MS)
    assert axis.motion.state is MotionState.UNKNOWN
    assert axis.compensation.is_unsure is (was_unsure or is_unsure)


def test_an_axis_that_goes_anywhere_with_words_of_its_own_keeps_its_branch() -> None:
    axis = reached(an_axis(), "arrived")
    was_unsure = axis.compensation.is_unsure
    command = AxisCommand(axis)
    command.go_anywhere()
    end(command, ACK, 0, 2 * MS)
    assert axis.motion.state is MotionState.UNKNOWN
    assert axis.compensation.is_unsure is was_unsure


@pytest.mark.parametrize("outcome", [ACK, SILENT])
@pytest.mark.parametrize("is_incomplete", [False, True])
def test_a_field_that_was_written_blindly_is_unknown(outcome: Outcome, is_incomplete: bool) -> None:
    axis = reached(an_axis(), "arrived")
    image = axis.fields[0]
    if is_incomplete:
        image.lose_all_words()
    epoch = image.epoch
    command = AxisCommand(axis)
    command.untracked.append(image)
    end(command, outcome, 0x0B, 2 * MS)
    assert image.nominal_words is None
    assert axis.motion.state is MotionState.UNKNOWN
    assert image.epoch == epoch + is_incomplete  # words that were lost before are older than these


# --- when it was not ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("outcome", OPEN)
def test_of_a_part_or_a_staged_target_without_an_answer_nothing_is_known(outcome: Outcome) -> None:
    axis = an_axis(motion=STAGED)
    image = axis.fields[0]
    image.settle(NOMINAL, NOMINAL)
    part = AxisCommand(axis)
    part.buffered_parts.append(Part(image, 0, NOMINAL[:2]))
    end(part, outcome, 0x0B, 1 * MS)
    assert (image.nominal_words, image.corrected_words) == (NOMINAL, None)
    staging = AxisCommand(axis)
    staging.stagings.append(Staging(image, NOMINAL, CORRECTED, image.epoch))
    end(staging, outcome, 0x0B, 2 * MS)
    assert image.nominal_words is None
    assert image.may_be_corrected


def test_an_exception_that_proves_it_leaves_both_as_they_were() -> None:
    axis = an_axis(motion=STAGED)
    image = axis.fields[0]
    image.settle(NOMINAL, NOMINAL)
    command = AxisCommand(axis)
    command.buffered_parts.append(Part(image, 0, NOMINAL[:2]))
    command.stagings.append(Staging(image, NOMINAL, CORRECTED, image.epoch))
    end(command, REFUSED, 1, 1 * MS)
    assert (image.nominal_words, image.corrected_words) == (NOMINAL, NOMINAL)


@pytest.mark.parametrize("outcome", OPEN)
def test_a_motion_without_an_answer_may_have_begun(outcome: Outcome) -> None:
    axis = reached(an_axis(), "arrived")
    end(AxisCommand(axis, Action.OTHER_MOTION), outcome, 0x0B, 2 * MS)
    assert axis.motion.state is MotionState.UNKNOWN
    staged = reached(an_axis(motion=STAGED), "arrived")
    end(AxisCommand(staged, Action.ABSOLUTE, 0), outcome, 0x0B, 2 * MS)
    assert staged.motion.state is MotionState.UNKNOWN


@pytest.mark.parametrize(("outcome", "is_set"), [(ACK, True), (SILENT, False)])
def test_a_stop_that_sets_the_position_too_may_have_done_so(outcome: Outcome, is_set: bool) -> None:
    axis = an_axis(referenced=Reference.SET_POSITION)
    command = AxisCommand(axis, Action.STOP, sets_position_too=True)
    end(command, outcome, 0x0B, 2 * MS)
    assert axis.reference.is_referenced is is_set
    absolute = reached(an_axis(), "arrived")
    end(AxisCommand(absolute, Action.STOP), outcome, 0x0B, 3 * MS)
    assert absolute.reference.is_referenced
    end(AxisCommand(absolute, Action.STOP, sets_position_too=True), outcome, 0x0B, 4 * MS)
    assert not absolute.reference.is_referenced


@pytest.mark.parametrize(
    ("outcome", "mode", "is_blocked"),
    [
        (SILENT, CompensationMode.ON, True),
        (SILENT, CompensationMode.OFF, True),
        (REFUSED, CompensationMode.ON, True),
        (REFUSED, CompensationMode.OFF, False),  # its controller knows, and no word of ours is in the drive
        (BROADCAST, CompensationMode.ON, False),
        (ACK, CompensationMode.ON, False),
    ],
)
def test_a_staged_target_that_was_lost_blocks_its_triggers(
    outcome: Outcome, mode: CompensationMode, is_blocked: bool
) -> None:
    axis = an_axis(motion=STAGED, compensation=mode)
    end(writes(axis), outcome, 4, 2 * MS)
    assert axis.interlock.is_blocked is is_blocked


def test_a_run_of_the_target_from_before_a_lost_link_leaves_it_there() -> None:
    axis = reached(an_axis(motion=STAGED), "out-of-reach")
    same = target(axis, 50_000)._replace(move=None)
    for run, after in (
        (same, MotionState.SUPERSEDED),
        (same._replace(nominal_words=COMMAND.pack(1)), MotionState.UNKNOWN),
    ):
        command = AxisCommand(axis, Action.ABSOLUTE, 0)
        command.runs.append(run)
        end(command, ACK, 0, 9 * MS)
        assert axis.motion.state is after
