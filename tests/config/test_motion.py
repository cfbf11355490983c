"""Whether an axis can be moved, and known where it is, as its registers and its keys say."""

from pathlib import Path

import pytest

from gateway.exchange.plan import Reference, Role
from tests.config.config_bench import GOOD, edited, line_of, loaded, refusal, refused, warning_of

STOP = "stop = [3]"
STAGED = f"trigger = [{{ address = 2, start = [1], {STOP} }}]\nstaged = true\n"
DISTANCES = 'mode = { source = "sticky", address = 4, absolute = [1], relative_to_commanded = [2] }\n'
STANDS = (("bits.done = { address = 0x0140, bit = 1 }\n", ""),)
ACTUAL = 'actual = [{ address = 0x0520, type = "int32", words = "low-first" }]\n'
WITHOUT_ACTUAL = (ACTUAL, "")
WITHOUT_TABLE = ('table = "cnc10x.tab"\ncompensation = "on"\n', "")
NEVER = ("max_speed = 200.0", 'added_frames = "never"')
ABSOLUTE = ('"drive-bit"', '"absolute"')
STREAM = edited(("max_speed = 200.0", 'setpoints = "stream"'))


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


MAPPED = 'commanded = [{ address = 0x0530, type = "int32" }]\n'
START = "{ address = 2, start = [1] }"
IN_FRAME = 'mode = { source = "in-frame", address = 0x0605, stop = [0], otherwise = "absolute" }'
WITHOUT_WARNING = [
    # words may be written one by one where a trigger or one word is all
    GOOD + 'write = "fc06"\n' + STAGED,
    edited(('0x0606, type = "int32"', '0x0606, type = "int16", scale = 10')) + 'write = "fc06"\n',
    # distances that start at a known place, or pass anyway
    GOOD + DISTANCES,
    edited(WITHOUT_ACTUAL) + DISTANCES + MAPPED,
    edited(*STANDS) + DISTANCES + "bits.moving = { address = 0x0140, bit = 2 }\n",
    edited(("max_speed = 200.0", 'relative_unknown = "pass"'), *STANDS) + DISTANCES,
    edited(WITHOUT_TABLE, *STANDS) + DISTANCES,
    edited(*STANDS) + 'mode = { source = "fixed" }\n',
    # a stop in any trigger or mode, and in the mode of one command
    GOOD + f'trigger = [{START}, {{ coil = 7, otherwise = "stop", ignore = [1] }}]\n',
    GOOD + f'trigger = [{START}]\nmode = {{ source = "sticky", address = 4, stop = [0] }}\n',
    edited(('0x0606, type = "int32",', f'0x0606, type = "int32", {IN_FRAME},')) + f"trigger = [{START}]\n",
    # targets that wait for a trigger, and setpoints that do not
    edited(NEVER, ABSOLUTE, WITHOUT_TABLE) + STAGED,
    STREAM,
    STREAM + STAGED.replace("start =", "follow ="),
]


@pytest.mark.parametrize("text", WITHOUT_WARNING)
def test_what_can_be_moved_as_it_says_is_not_warned_of(tmp_path: Path, text: str) -> None:
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


@pytest.mark.parametrize(
    ("text", "key", "at", "found", "remedy"),
    [
        # staged targets that may not be written anew
        (
            edited(NEVER, ABSOLUTE) + STAGED,
            "axis.x.added_frames",
            "added_frames",
            "",
            "if the correction has changed since its target was written",
        ),
        # a stream that needs a trigger for each setpoint
        (STREAM + STAGED, "axis.x.setpoints", "setpoints", "", "every setpoint needs its own trigger"),
        # triggers without a stop
        (
            GOOD + f"trigger = [{START}]\n",
            "axis.x.registers.trigger",
            "trigger",
            "no value is listed that stops the axis",
            "cannot go before other requests",
        ),
        # an operator that can only read
        (
            edited(('"monitor"', '"operator"')),
            "line.xyz.controllers[2].role",
            '"operator"',
            "the registers of no axis of this line list a stop",
            "it may only read here",
        ),
    ],
)
def test_what_cannot_be_moved_or_stopped_as_it_says_is_warned_of(
    tmp_path: Path, text: str, key: str, at: str, *, found: str, remedy: str
) -> None:
    warning = warning_of(tmp_path, text, key, at=at)
    assert found in warning.found
    assert remedy in warning.remedy


def test_a_done_bit_that_says_nothing_of_arrival_is_warned_of(tmp_path: Path) -> None:
    text = edited(ABSOLUTE, WITHOUT_ACTUAL) + 'done_means = "in-position"\n'
    [warning] = [each for each in loaded(tmp_path, text).warnings if each.key.endswith("done_means")]
    assert warning.line == line_of(text, "done_means")
    assert "map actual" in warning.remedy
    keys = [each.key for each in loaded(tmp_path, edited(ABSOLUTE) + 'done_means = "in-position"\n').warnings]
    assert "axis.x.registers.done_means" not in keys


# --- stops ---------------------------------------------------------------------------------------------


# --- who may stop --------------------------------------------------------------------------------------


def test_an_operator_may_read_and_stop(tmp_path: Path) -> None:
    result = loaded(tmp_path, edited(('"monitor"', '"operator"')) + STAGED)
    assert result.warnings == ()
    assert result.plan.lines[0].controllers[1].plan.role is Role.OPERATOR


def test_an_operator_on_an_open_port_may_stop_the_drives(tmp_path: Path) -> None:
    text = edited(('"monitor"', '"operator"'), ("127.0.0.1:1502", "0.0.0.0:1502")) + STAGED
    [warning] = loaded(tmp_path, text).warnings
    assert "may read and stop the drives" in warning.found


# How it is known where an axis is: a way that its registers cannot show is refused, and others are named.


HOME = "trigger = [{ address = 2, start = [1], home = [2], stop = [3] }]\n"
ZERO = "trigger = [{ address = 2, start = [1], set_position = [2], stop = [3] }]\n"


def referenced(way: str, *changes: tuple[str, str]) -> str:
    return edited(('referenced = "drive-bit"', f'referenced = "{way}"'), *changes)


WITHOUT_BITS = (
    ("bits.homed = { address = 0x0140, bit = 6 }\n", ""),
    ("bits.done = { address = 0x0140, bit = 1 }\n", ""),
)


@pytest.mark.parametrize(
    "text",
    [
        referenced("homing") + HOME,
        referenced("homing", WITHOUT_BITS[0]) + HOME,
        referenced("homing", WITHOUT_BITS[1]) + HOME,
        referenced("homing") + 'mode = { source = "sticky", address = 2, absolute = [1], home = [6] }\n',
        referenced("homing") + 'trigger = [{ address = 2, stop = [3], otherwise = "home" }]\n',
    ],
)
def test_homing_needs_something_that_homes_and_a_bit_that_ends_it(tmp_path: Path, text: str) -> None:
    result = loaded(tmp_path, text)
    assert result.warnings == ()
    assert result.plan.lines[0].axes[0].referenced is Reference.HOMING


def test_homing_without_a_value_that_homes_is_refused(tmp_path: Path) -> None:
    problem = refusal(tmp_path, referenced("homing"), "axis.x.referenced", at="referenced")
    assert problem.found == 'referenced = "homing" and no value of registers.mode or registers.trigger homes'
    assert problem.remedy == (
        "list the value that homes the axis under home; with these registers it may be "
        '"absolute" (an absolute encoder) or "drive-bit"'
    )


def test_homing_without_a_bit_that_ends_it_is_refused(tmp_path: Path) -> None:
    problem = refusal(tmp_path, referenced("homing", *WITHOUT_BITS) + HOME, "axis.x.referenced")
    lack = "without registers.bits.homed, registers.bits.homing_done or registers.bits.done"
    assert problem.found == f'referenced = "homing" {lack}'
    assert "homing has ended" in problem.remedy


@pytest.mark.parametrize(
    "text",
    [
        referenced("set-position") + ZERO,
        referenced(
            "set-position", ('0x0520, type = "int32",', '0x0520, type = "int32", set_position = true,')
        ),
    ],
)
def test_a_position_is_set_by_a_trigger_or_by_writing_an_actual(tmp_path: Path, text: str) -> None:
    result = loaded(tmp_path, text)
    assert result.warnings == ()
    assert result.plan.lines[0].axes[0].referenced is Reference.SET_POSITION


def test_set_position_where_nothing_sets_one_is_refused(tmp_path: Path) -> None:
    text = referenced("set-position") + HOME
    problem = refusal(tmp_path, text, "axis.x.referenced", at="referenced")
    assert problem.found == 'referenced = "set-position" and nothing in registers sets a position'
    assert problem.remedy == (
        "list the value that does under set_position of a trigger, or mark an actual with set_position; "
        'with these registers it may be "absolute" (an absolute encoder) or "drive-bit" or "homing"'
    )


def test_a_profile_is_asked_the_same(tmp_path: Path) -> None:
    """This drive has no bits, and its homing values are not known."""
    (tmp_path / "plain.toml").write_text(
        'title = "A plain drive"\n[registers]\ncommand = [{ address = 100, type = "int32" }]\n'
    )
    text = edited(
        ("max_speed = 200.0", 'drive = "./plain.toml"'),
        ('"drive-bit"', '"homing"'),
        text=GOOD[: GOOD.index("[axis.x.registers]")],
    )
    problems = refused(tmp_path, text)
    assert {problem.key for problem in problems} == {"axis.x.referenced"}
    assert len(problems) == 2
    assert all(problem.remedy.endswith('it may be "absolute" (an absolute encoder)') for problem in problems)
