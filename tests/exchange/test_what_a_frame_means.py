"""What a frame means for an axis, as the tables of ``decode`` say: each frame against what is known (M2)."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import pytest

from gateway.drives.motion import Action, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.access import access_of, coils_written
from gateway.exchange.axis.axis import Axis
from gateway.exchange.decode import NO_ACCESS, AxisCommand, DecodedRequest, Staging, decode
from gateway.exchange.unit import UnitMap
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.axis_bench import target
from tests.exchange.line_bench import COMMAND, axis_plan
from tests.exchange.staged_bench import DEEDS, MODE, STAGED, TRIGGER

SECOND: Final = PositionField(0x0608, RegisterType.INT32, WordOrder.LOW_FIRST)
OTHER_TRIGGER: Final = 0x0510
MODES: Final = ModePlan(
    MODE, actions={1: Action.ABSOLUTE, 2: Action.RELATIVE, 3: Action.OTHER_MOTION, 4: Action.FOLLOW}
)
WITH_MODE: Final = replace(STAGED, modes=(MODES,))
"""Its trigger 1 means an absolute position whatever the mode says, if that runs a target."""
FOLLOWING: Final = {
    0: Operation(Action.IGNORE),
    1: Operation(Action.ABSOLUTE),
    4: Operation(Action.FOLLOW),
    5: Operation(Action.FOLLOW_NEXT),
}
FOLLOWS: Final = MotionPlan(is_staged=True, triggers=(TriggerPlan(TRIGGER, deeds=FOLLOWING),))
TWO_FOLLOW: Final = replace(
    FOLLOWS, triggers=(*FOLLOWS.triggers, TriggerPlan(OTHER_TRIGGER, deeds=FOLLOWING))
)
TWO_BITS: Final = MotionPlan(
    is_staged=True,
    triggers=(
        TriggerPlan(
            TRIGGER,
            mask=0b11,
            deeds={
                0b00: Operation(Action.STOP),
                0b10: Operation(Action.STOP),
                0b01: Operation(Action.ABSOLUTE),
                0b11: Operation(Action.HOME),
            },
        ),
    ),
)
"""Bit 0 clear: it stops, whatever bit 1 says."""
WRITES: Final = "10 0606 0002 04 0001 0000"


def an_axis(motion: MotionPlan, **changes: Any) -> Axis:
    return Axis(axis_plan(motion=motion, **changes))


def decoded(axis: Axis, frame: str, read: Mapping[int, int | None] | None = None) -> list[AxisCommand]:
    pdu = bytes.fromhex(frame)
    request = DecodedRequest(UnitMap([axis]), pdu, access_of(pdu) or NO_ACCESS, coils_written(pdu))
    return decode(request, {} if read is None else {"x": read})


def meaning(axis: Axis, frame: str, read: Mapping[int, int | None] | None = None) -> AxisCommand:
    [command] = decoded(axis, frame, read)
    return command


@pytest.mark.parametrize(
    ("frame", "action"),
    [
        ("05 0019 FF00", Action.STORED),
        ("05 0019 0001", Action.STORED),  # no value of the protocol: a drive may take it for ON
        ("05 0019 0000", Action.STOP),
    ],
)
def test_a_coil_is_off_only_if_its_value_is_0(frame: str, action: Action) -> None:
    deeds = {1: Operation(Action.STORED), 0: Operation(Action.STOP)}
    axis = an_axis(MotionPlan(triggers=(TriggerPlan(0x19, is_coil=True, deeds=deeds),)))
    assert meaning(axis, frame).action is action


@pytest.mark.parametrize(
    ("frame", "before", "action", "unclear"),
    [
        ("16 050E 0000 0001", None, Action.ABSOLUTE, set()),  # all bits are written
        ("16 050E FFF0 0001", 0, Action.ABSOLUTE, set()),
        ("16 050E FFF0 0001", 0x0010, Action.UNKNOWN, set()),  # 0011 is no value that is known
        ("16 050E FFF0 0001", None, Action.UNKNOWN, {TRIGGER}),
        ("16 050E FFF0", 0, Action.UNKNOWN, {TRIGGER}),  # shorter than its function
        ("10 050E 0001 04 0001", 0, Action.UNKNOWN, {TRIGGER}),  # it says four bytes and has two
        ("10 050E 0001 02 0001", 0, Action.ABSOLUTE, set()),
    ],
)
def test_a_trigger_has_the_value_that_it_has_after_the_frame(
    frame: str, before: int | None, action: Action, unclear: set[int]
) -> None:
    axis = an_axis(STAGED)
    if before is not None:
        axis.rules.store_words({TRIGGER: before}, 0)
    command = meaning(axis, frame)
    assert (command.action, set(command.unclear_words)) == (action, unclear)


@pytest.mark.parametrize(
    ("frame", "action"),
    [
        ("16 050E FFFC 0001", Action.ABSOLUTE),  # both bits are written
        ("16 050E FFFC 0000", Action.STOP),
        ("16 050E FFFE 0000", Action.STOP),
        ("16 050E FFFE 0001", Action.UNKNOWN),
        ("16 050E FFFD 0000", Action.UNKNOWN),  # bit 0 is not known
    ],
)
def test_bits_of_an_unknown_trigger_count_if_they_decide(frame: str, action: Action) -> None:
    assert meaning(an_axis(TWO_BITS), frame).action is action


def test_a_mode_in_which_a_drive_moves_without_targets_is_another_motion() -> None:
    assert meaning(an_axis(WITH_MODE), "06 0700 0003").action is Action.OTHER_MOTION
    assert meaning(an_axis(WITH_MODE), "06 0700 0001").action is Action.IGNORE
    no_mode_first = replace(WITH_MODE, modes=(None, MODES))
    axis = an_axis(no_mode_first, command=(COMMAND, SECOND))
    assert meaning(axis, "06 0700 0003").action is Action.OTHER_MOTION


def test_a_frame_that_writes_only_a_limit_means_nothing() -> None:
    axis = an_axis(STAGED, limits=(PositionField(0x0800, RegisterType.INT32, WordOrder.LOW_FIRST),))
    assert decoded(axis, "10 0800 0002 04 0001 0000") == []


@pytest.mark.parametrize(
    ("content", "action", "needed"),
    [
        (None, Action.UNKNOWN, TRIGGER),
        (0, Action.IGNORE, None),
        (4, Action.ABSOLUTE, None),
        (5, Action.ABSOLUTE, None),
        (9, Action.UNKNOWN, None),
    ],
)
def test_a_target_runs_immediately_while_its_trigger_register_says_so(
    content: int | None, action: Action, needed: int | None
) -> None:
    axis = an_axis(FOLLOWS)
    if content is not None:
        axis.rules.store_read(TRIGGER, content)
    command = meaning(axis, WRITES)
    assert (command.action, command.needs_word) == (action, needed)


@pytest.mark.parametrize(
    ("read", "action"), [(4, Action.ABSOLUTE), (0, Action.IGNORE), (None, Action.UNKNOWN)]
)
def test_a_trigger_register_that_was_read_for_a_target_decides_whether_it_runs(
    read: int | None, action: Action
) -> None:
    command = meaning(an_axis(FOLLOWS), WRITES, {TRIGGER: read})
    assert (command.action, command.needs_word) == (action, None)


def test_an_unknown_trigger_register_is_not_requested_if_no_read_may_be_added() -> None:
    command = meaning(an_axis(FOLLOWS, safe_read=False), WRITES)
    assert (command.action, command.needs_word) == (Action.UNKNOWN, None)


def test_a_trigger_register_is_read_only_for_a_written_target() -> None:
    command = meaning(an_axis(TWO_FOLLOW), "06 050E 0001")
    assert (command.action, command.needs_word) == (Action.ABSOLUTE, None)
    follow_next = meaning(an_axis(TWO_FOLLOW), "06 050E 0005")
    assert (follow_next.action, follow_next.needs_word) == (Action.IGNORE, None)


@pytest.mark.parametrize(
    ("mode", "trigger", "action"),
    [
        (1, "0001", Action.ABSOLUTE),
        (2, "0001", Action.ABSOLUTE),  # a move beside a move: that of the trigger
        (3, "0001", Action.OTHER_MOTION),  # what runs no target goes before
        (4, "0001", Action.ABSOLUTE),
        (1, "0002", Action.RELATIVE_TO_COMMANDED),
    ],
)
def test_a_trigger_runs_what_it_and_the_mode_say(mode: int, trigger: str, action: Action) -> None:
    axis = an_axis(WITH_MODE)
    axis.rules.store_read(MODE, mode)
    assert meaning(axis, f"06 050E {trigger}").action is action


@pytest.mark.parametrize(("mode", "action"), [(1, Action.FOLLOW), (2, Action.RELATIVE)])
def test_a_trigger_that_follows_runs_distances_as_such(mode: int, action: Action) -> None:
    axis = an_axis(replace(FOLLOWS, modes=(MODES,)))
    axis.rules.store_read(MODE, mode)
    assert meaning(axis, "06 050E 0004").action is action


@pytest.mark.parametrize(("mode", "action"), [(4, Action.FOLLOW), (1, Action.IGNORE), (None, Action.IGNORE)])
def test_a_mode_that_follows_runs_a_target_without_a_trigger(mode: int | None, action: Action) -> None:
    axis = an_axis(WITH_MODE)
    if mode is not None:
        axis.rules.store_read(MODE, mode)
    assert meaning(axis, WRITES).action is action


@pytest.mark.parametrize(
    ("staged", "fields", "number"),
    [(1, (COMMAND, SECOND), 1), (None, (COMMAND, SECOND), None), (None, (COMMAND,), 0)],
)
def test_a_trigger_without_a_number_runs_the_field_that_was_written_last(
    staged: int | None, fields: tuple[PositionField, ...], number: int | None
) -> None:
    axis = an_axis(STAGED, command=fields)
    if staged is not None:
        axis.rules.stage(staged)
    assert meaning(axis, "06 050E 0001").number == number


BOTH: Final = "10 0606 0004 08 0001 0000 0002 0000"


def test_of_two_targets_in_a_frame_a_drive_with_triggers_runs_the_first() -> None:
    axis = an_axis(FOLLOWS, command=(COMMAND, SECOND))
    axis.rules.store_read(TRIGGER, 4)
    command = meaning(axis, BOTH)
    assert [hit.mapped.number for hit in command.running] == [0]
    assert command.written == (0, 1)


def test_a_drive_without_triggers_runs_both() -> None:
    command = meaning(an_axis(MotionPlan(), command=(COMMAND, SECOND)), BOTH)
    assert [hit.mapped.number for hit in command.running] == [0, 1]
    assert command.action is Action.ABSOLUTE


# --- what is sent for it -----------------------------------------------------------------------------------


def test_an_empty_command_does_nothing() -> None:
    axis = an_axis(STAGED)
    assert AxisCommand(axis).is_empty
    assert not AxisCommand(axis, Action.STOP).is_empty
    assert not AxisCommand(axis, words={TRIGGER: 0}).is_empty
    assert AxisCommand(axis, words={TRIGGER: 0}).is_idle
    assert not AxisCommand(axis, Action.STOP).is_idle
    assert not meaning(an_axis(WITH_MODE), "06 0700 0001").is_idle


def test_the_destination_of_a_command_is_unknown_after_go_anywhere() -> None:
    known, anywhere, uncorrected = (AxisCommand(an_axis(STAGED)) for _ in range(3))
    anywhere.go_anywhere()
    uncorrected.run_uncorrected()
    went = [(each.goes_unknown, each.is_uncorrected) for each in (known, anywhere, uncorrected)]
    assert went == [(False, False), (True, False), (True, True)]


def test_a_target_a_run_or_an_untracked_write_sends_the_axis_somewhere() -> None:
    axis = an_axis(STAGED)
    rendering, image = target(axis, 1000), axis.fields[0]
    commands = [AxisCommand(axis) for _ in range(4)]
    commands[1].targets.append(rendering)
    commands[2].runs.append(rendering)
    commands[3].untracked.append(image)
    assert [command.sends_somewhere for command in commands] == [False, True, True, True]
    commands[1].stagings.append(Staging(image, b"", b"", 0))
    commands[1].forget_targets()
    assert not commands[1].sends_somewhere
    assert commands[1].stagings == []


def test_the_table_of_the_bench_has_no_other_values() -> None:
    """1 absolute, 2 a distance, 100 homing, 101 another zero, 200 stored, 300 a jog, 1000 a stop."""
    actions = {value: meaning(an_axis(STAGED), f"06 050E {value:04X}").action for value in DEEDS}
    assert actions == {value: operation.action for value, operation in DEEDS.items()}
