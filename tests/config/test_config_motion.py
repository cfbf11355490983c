"""Whether an axis can be moved as its registers and its keys say: triggers, distances, stops, halves."""

from pathlib import Path

import pytest

from gateway.exchange.plan import Role
from tests.config.config_bench import GOOD, edited, line_of, loaded, refusal, warning_of

STOP = "stop = [3]"
STAGED = f"trigger = [{{ address = 2, start = [1], {STOP} }}]\nstaged = true\n"
DISTANCES = 'mode = { source = "sticky", address = 4, absolute = [1], relative_to_commanded = [2] }\n'
STANDS = (("bits.done = { address = 0x0140, bit = 1 }\n", ""),)
ACTUAL = 'actual = [{ address = 0x0520, type = "int32", words = "low-first" }]\n'
WITHOUT_ACTUAL = (ACTUAL, "")
WITHOUT_TABLE = ('table = "cnc10x.tab"\ncompensation = "on"\n', "")
NEVER = ("max_speed = 200.0", 'added_frames = "never"')
ABSOLUTE = ('"drive-bit"', '"absolute"')


def test_everything_about_motion_reaches_the_plan(tmp_path: Path) -> None:
    text = edited(("max_speed = 200.0", 'stored_moves = "uncorrected"\nrelative_unknown = "pass"'))
    text += STAGED + DISTANCES
    text += 'limits = [{ address = 0x10, type = "int32" }]\naliases = [{ address = 0x20, type = "int32" }]\n'
    result = loaded(tmp_path, text)
    assert result.warnings == ()
    [axis] = result.plan.lines[0].axes
    assert axis.motion.is_staged
    assert axis.motion.passes_stored_moves
    assert axis.motion.passes_unknown_relative
    assert [field.address for field in (*axis.limits, *axis.aliases)] == [0x10, 0x20]


# --- words written one by one --------------------------------------------------------------------------


def test_words_that_would_move_the_axis_one_by_one_are_refused(tmp_path: Path) -> None:
    problem = refusal(tmp_path, GOOD + 'write = "fc06"\n', "axis.x.registers.write", at="write")
    assert problem.found == 'write = "fc06", a command of 2 registers (int32) and staged = false'
    assert "the first word alone would move the axis" in problem.remedy
    assert "staged = true" in problem.remedy


def test_words_that_a_drive_would_follow_one_by_one_are_refused(tmp_path: Path) -> None:
    follows = f"trigger = [{{ address = 2, start = [1], follow = [7], {STOP} }}]\nstaged = true\n"
    text = GOOD + 'write = "fc06"\n' + follows
    problem = refusal(tmp_path, text, "axis.x.registers.trigger[1].follow", at="trigger")
    assert "each word alone would move the axis" in problem.remedy


@pytest.mark.parametrize(
    "text",
    [
        GOOD + 'write = "fc06"\n' + STAGED,
        edited(('0x0606, type = "int32"', '0x0606, type = "int16", scale = 10')) + 'write = "fc06"\n',
    ],
)
def test_words_may_be_written_one_by_one_where_a_trigger_or_one_word_is_all(
    tmp_path: Path, text: str
) -> None:
    assert loaded(tmp_path, text).warnings == ()


# --- distances -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "lack"),
    [
        (edited(NEVER, ABSOLUTE) + DISTANCES, 'added_frames = "never" does not allow'),
        (edited(ABSOLUTE) + "safe_read = false\n" + DISTANCES, "safe_read = false does not allow"),
        (edited(WITHOUT_ACTUAL) + DISTANCES, "neither commanded nor actual is mapped"),
        (
            edited((ACTUAL, ACTUAL.replace(" }]", ', access = "write" }]'))) + DISTANCES,
            "commanded and actual cannot be read with a request of their own",
        ),
        (
            edited((ACTUAL, ACTUAL.replace(" }]", ", block = 0x051F }]"))) + DISTANCES,
            "commanded and actual cannot be read with a request of their own",
        ),
        (edited(*STANDS) + DISTANCES, "neither bits.done nor bits.moving is mapped"),
    ],
)
def test_distances_from_a_place_that_nothing_tells_are_warned_of(
    tmp_path: Path, text: str, lack: str
) -> None:
    warning = warning_of(tmp_path, text, "axis.x.registers.mode.relative_to_commanded", at="mode =")
    assert lack in warning.found
    assert "refused until an absolute move is accepted" in warning.remedy


@pytest.mark.parametrize(
    "text",
    [
        GOOD + DISTANCES,
        edited(WITHOUT_ACTUAL) + DISTANCES + 'commanded = [{ address = 0x0530, type = "int32" }]\n',
        edited(*STANDS) + DISTANCES + "bits.moving = { address = 0x0140, bit = 2 }\n",
        edited(("max_speed = 200.0", 'relative_unknown = "pass"'), *STANDS) + DISTANCES,
        edited(WITHOUT_TABLE, *STANDS) + DISTANCES,
        edited(*STANDS) + 'mode = { source = "fixed" }\n',
    ],
)
def test_distances_that_start_at_a_known_place_or_pass_anyway_are_not(tmp_path: Path, text: str) -> None:
    assert loaded(tmp_path, text).warnings == ()


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (
            'mode = { source = "sticky", address = 4, absolute = [1], relative_to_actual = [2] }\n',
            "mode.relative_to_actual",
        ),
        (
            f"trigger = [{{ address = 4, relative_to_actual = [1], {STOP} }}]\n",
            "trigger[1].relative_to_actual",
        ),
        (
            f'trigger = [{{ address = 4, otherwise = "relative_to_actual", {STOP} }}]\n',
            "trigger[1].otherwise",
        ),
    ],
)
def test_distances_from_a_measured_position_need_one(tmp_path: Path, text: str, key: str) -> None:
    text = edited(WITHOUT_ACTUAL) + text
    problem = refusal(tmp_path, text, f"axis.x.registers.{key}", at=text.splitlines()[-1])
    assert "registers.actual is not mapped" in problem.found
    assert "map actual" in problem.remedy


# --- targets that wait for a trigger -------------------------------------------------------------------


def test_staged_targets_that_may_not_be_written_anew_are_warned_of(tmp_path: Path) -> None:
    text = edited(NEVER, ABSOLUTE) + STAGED
    warning = warning_of(tmp_path, text, "axis.x.added_frames", at="added_frames")
    assert "if the correction has changed since its target was written" in warning.remedy
    assert loaded(tmp_path, edited(NEVER, ABSOLUTE, WITHOUT_TABLE) + STAGED).warnings == ()


def test_a_stream_that_needs_a_trigger_for_each_setpoint_is_warned_of(tmp_path: Path) -> None:
    stream = edited(("max_speed = 200.0", 'setpoints = "stream"'))
    text = stream + STAGED
    warning = warning_of(tmp_path, text, "axis.x.setpoints", at="setpoints")
    assert "every setpoint needs its own trigger" in warning.remedy
    assert loaded(tmp_path, stream + STAGED.replace("start =", "follow =")).warnings == ()
    assert loaded(tmp_path, stream).warnings == ()


def test_a_done_bit_that_says_nothing_of_arrival_is_warned_of(tmp_path: Path) -> None:
    text = edited(ABSOLUTE, WITHOUT_ACTUAL) + 'done_means = "in-position"\n'
    [warning] = [each for each in loaded(tmp_path, text).warnings if each.key.endswith("done_means")]
    assert warning.line == line_of(text, "done_means")
    assert "map actual" in warning.remedy
    keys = [each.key for each in loaded(tmp_path, edited(ABSOLUTE) + 'done_means = "in-position"\n').warnings]
    assert "axis.x.registers.done_means" not in keys


# --- stops ---------------------------------------------------------------------------------------------


def test_triggers_without_a_stop_are_warned_of(tmp_path: Path) -> None:
    text = GOOD + "trigger = [{ address = 2, start = [1] }]\n"
    warning = warning_of(tmp_path, text, "axis.x.registers.trigger", at="trigger")
    assert warning.found == "no value is listed that stops the axis"
    assert "cannot go before other requests" in warning.remedy


@pytest.mark.parametrize(
    "text",
    [
        'trigger = [{ address = 2, start = [1] }, { coil = 7, otherwise = "stop", ignore = [1] }]\n',
        'trigger = [{ address = 2, start = [1] }]\nmode = { source = "sticky", address = 4, stop = [0] }\n',
    ],
)
def test_a_stop_may_be_in_any_trigger_or_mode(tmp_path: Path, text: str) -> None:
    assert loaded(tmp_path, GOOD + text).warnings == ()


def test_a_mode_of_one_command_may_stop_too(tmp_path: Path) -> None:
    mode = 'mode = { source = "in-frame", address = 0x0605, stop = [0], otherwise = "absolute" }'
    text = edited(('0x0606, type = "int32",', f'0x0606, type = "int32", {mode},'))
    assert loaded(tmp_path, text + "trigger = [{ address = 2, start = [1] }]\n").warnings == ()


# --- who may stop --------------------------------------------------------------------------------------


def test_an_operator_may_read_and_stop(tmp_path: Path) -> None:
    result = loaded(tmp_path, edited(('"monitor"', '"operator"')) + STAGED)
    assert result.warnings == ()
    assert result.plan.lines[0].controllers[1].plan.role is Role.OPERATOR


def test_an_operator_that_can_only_read_is_warned_of(tmp_path: Path) -> None:
    text = edited(('"monitor"', '"operator"'))
    warning = warning_of(tmp_path, text, "line.xyz.controllers[2].role", at='"operator"')
    assert "the registers of no axis of this line list a stop" in warning.found
    assert warning.remedy.startswith("it may only read here")


def test_an_operator_on_an_open_port_may_stop_the_drives(tmp_path: Path) -> None:
    text = edited(('"monitor"', '"operator"'), ("127.0.0.1:1502", "0.0.0.0:1502")) + STAGED
    [warning] = loaded(tmp_path, text).warnings
    assert "may read and stop the drives" in warning.found
