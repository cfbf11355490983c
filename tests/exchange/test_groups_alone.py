"""What the axes of a group know of each other: skew, the end of a decision, words that are kept (M4, M11).

Three axes; 1000 counts per mm. Each is told directly what its drive did.
"""

from dataclasses import replace
from typing import Any, Final

import pytest

from gateway.compensation.correction_spec import NOTHING
from gateway.compensation.settings import Gain
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.gantry import Gantry, GantryEvent
from gateway.exchange.axis.reference import ReferenceEvent
from gateway.exchange.control import switch
from gateway.exchange.group import join_groups, report_skew, settle_group
from gateway.exchange.kept_words import is_other, is_repeat, keeps_other_words, may_keep_words, spec_of_words
from gateway.exchange.plan import CompensationMode, Reference
from tests.exchange.axis_bench import REACHED, acknowledge, an_axis, do, see, target
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan, read, write

NOMINAL: Final = COMMAND.pack(50_000)
OTHER_TABLE: Final = make_table([0, 100], [0.02, 0.02], [-0.02, -0.02], Units.MM)
JOINED_MS: Final = 200
"""Words of one target come within so long."""


def group(*names: str, **changes: Any) -> tuple[Gantry, list[Axis]]:
    """Axes of one group, each at 20 000 counts."""
    axes = [an_axis(name=name, **changes) for name in names]
    join_groups(axes, [names])
    for axis in axes:
        acknowledge(axis, 20_000)
    gantry = axes[0].member.gantry
    assert gantry is not None
    return gantry, axes


def begin(gantry: Gantry, axes: list[Axis], *gone: Axis) -> None:
    """The first trigger is sent, and some axes start."""
    gantry.fix(axes[0].plan.name, 1 * MS)
    for axis in axes:
        axis.member.fix(None, keeps_words=False)
    gantry.happens(GantryEvent.LEFT)
    gantry.happens(GantryEvent.WENT)
    for axis in gone:
        axis.member.go_as_fixed(0, 2 * MS)


def details(axis: Axis) -> list[str]:
    return [event.detail for event in axis.take_events() if event.kind.name == "group-skewed"]


# --- skew --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x_counts", "y_counts", "skewed"),
    [
        (30_000, 50_000, "skewed by +30 mm"),
        (50_000, 30_000, "skewed by +30 mm"),
        (10_000, 25_000, "skewed by -10 mm"),
    ],
)
def test_the_skew_is_the_longest_way_that_an_axis_has_gone(x_counts: int, y_counts: int, skewed: str) -> None:
    gantry, axes = group("x", "y", "z")
    x, y, z = axes
    begin(gantry, axes, x, y)
    acknowledge(x, x_counts)
    acknowledge(y, y_counts)
    report_skew(z, 4)
    [detail] = details(z)
    assert detail.endswith(skewed)
    assert gantry.is_skewed


@pytest.mark.parametrize("lost", [0, 1])
def test_it_is_unknown_where_the_way_of_one_axis_is(lost: int) -> None:
    gantry, axes = group("x", "y", "z")
    x, y, z = axes
    begin(gantry, axes, x, y)
    acknowledge(x, 30_000)
    acknowledge(y, 40_000)
    do(axes[lost], Action.STOP)
    report_skew(z, 4)
    [detail] = details(z)
    assert detail.endswith("skewed by an unknown amount")
    assert gantry.skew is None


def test_it_is_unknown_where_its_start_is() -> None:
    gantry, axes = group("x", "y")
    x, y = axes
    do(x, Action.STOP)
    begin(gantry, axes, x)
    acknowledge(x, 30_000)
    report_skew(y, 4)
    assert [detail.endswith("by an unknown amount") for detail in details(y)] == [True]


def test_where_nothing_has_moved_nothing_is_skewed() -> None:
    gantry, axes = group("x", "y")
    x, y = axes
    begin(gantry, axes, x)
    report_skew(y, 4)
    assert details(y) == []
    assert not gantry.is_skewed


def test_an_axis_that_has_gone_itself_or_before_anything_went_is_not_skewed() -> None:
    gantry, axes = group("x", "y", "z")
    x, y, _ = axes
    report_skew(x, 4)
    begin(gantry, axes, x, y)
    acknowledge(y, 40_000)
    report_skew(x, 4)
    assert details(x) == []
    alone = an_axis()
    report_skew(alone, 4)
    assert details(alone) == []


# --- the end of a decision ---------------------------------------------------------------------------------


def test_a_decision_ends_when_all_have_gone() -> None:
    gantry, axes = group("x", "y")
    x, y = axes
    begin(gantry, axes, x)
    settle_group(x, 3 * MS)
    was_under_way = [gantry.is_under_way]
    y.member.go_as_fixed(0, 3 * MS)
    settle_group(x, 3 * MS)
    was_under_way.append(gantry.is_under_way)
    assert was_under_way == [True, False]
    assert x.member.fixed is None


def test_words_of_a_target_that_have_not_come_are_awaited_for_200_ms() -> None:
    gantry, axes = group("x", "y")
    x, y = axes
    begin(gantry, axes, x)
    y.member.go_as_fixed(0b10, 3 * MS)
    was_under_way = []
    for at_ns in ((3 + JOINED_MS) * MS, (3 + JOINED_MS) * MS + 1):
        settle_group(x, at_ns)
        was_under_way.append(gantry.is_under_way)
    assert was_under_way == [True, False]


def test_a_reference_that_one_has_found_counts_for_all() -> None:
    _, axes = group("x", "y", referenced=Reference.SET_POSITION)
    for axis in axes:
        axis.reference.happens(ReferenceEvent.DECLARED)
    assert all(axis.passes_unchanged for axis in axes)
    settle_group(axes[0], 3 * MS)
    assert not any(axis.passes_unchanged for axis in axes)


def test_an_axis_whose_registers_have_another_meaning_ends_it() -> None:
    gantry, axes = group("x", "y")
    begin(gantry, axes, axes[0])
    axes[1].end()
    assert gantry.is_open


@pytest.mark.parametrize("is_found_again", [False, True])
def test_a_reference_that_was_lost_meanwhile_is_lost_when_it_ends(is_found_again: bool) -> None:
    gantry, axes = group("x", "y", referenced=Reference.SET_POSITION)
    x, _ = axes
    for axis in axes:
        axis.declare_referenced()
    begin(gantry, axes, x)
    x.lose_reference()
    if is_found_again:
        x.declare_referenced()
    see(x, 30_000)
    was_passing = [x.passes_unchanged]
    gantry.happens(GantryEvent.ENDED)
    was_passing.append(x.passes_unchanged)
    assert was_passing == [False, not is_found_again]
    assert (x.motion.actual is None) is is_found_again  # it may be counted from another zero


def test_a_reference_that_was_found_meanwhile_counts_when_it_ends() -> None:
    gantry, axes = group("x", "y", referenced=Reference.SET_POSITION)
    x, y = axes
    begin(gantry, axes, x)
    x.declare_referenced()
    y.declare_referenced()
    was_passing = [x.passes_unchanged]
    gantry.happens(GantryEvent.ENDED)
    was_passing.append(x.passes_unchanged)
    assert was_passing == [True, False]


# --- another switch, table or gain -------------------------------------------------------------------------


def test_another_correction_is_one_with_another_switch_table_or_gain() -> None:
    axis, off = an_axis(), an_axis(compensation=CompensationMode.OFF)
    asked = axis.correction.requested
    same = an_axis().correction.requested
    assert same.curve is not asked.curve
    others = {
        "the same": asked,
        "the same table once more": same,
        "off": NOTHING,
        "another table": an_axis(table=OTHER_TABLE).correction.requested,
        "half of it": replace(asked, gain=Gain(0.5, 0.5)),
        "a new digest": replace(asked, table_digest=b"?"),
    }
    assert [name for name, spec in others.items() if is_other(axis, spec)] == [
        "off",
        "another table",
        "half of it",
    ]
    assert [name for name, spec in others.items() if not is_other(off, spec)] == ["off"]


def test_words_are_a_repeat_where_the_drive_acknowledged_them() -> None:
    def repeats(axis: Axis, number: int = 0, words: bytes = NOMINAL) -> bool:
        return is_repeat(axis, number, words)

    axis = an_axis(command=(COMMAND, replace(COMMAND, address=0x0610)))
    acknowledge(axis)
    assert repeats(axis)
    assert not repeats(axis, words=COMMAND.pack(50_001))
    assert not repeats(axis, 1)
    axis.fields[1].settle(NOMINAL, COMMAND.pack(50_020))
    assert repeats(axis, 1)  # of another field, which holds it
    axis.fields[0].settle(NOMINAL, COMMAND.pack(50_020))
    assert not repeats(axis)  # a word in it was replaced
    axis.fields[1].invalidate()
    assert not repeats(axis, 1)
    stopped = an_axis()
    acknowledge(stopped)
    do(stopped, Action.STOP)
    assert not repeats(stopped)
    lost = an_axis()
    acknowledge(lost)
    lost.fields[0].lose_all_words()
    assert not repeats(lost)


def test_words_that_a_target_may_keep_have_the_correction_of_that_target() -> None:
    axis = an_axis()
    acknowledge(axis)
    in_force = axis.compensation.state.spec
    assert spec_of_words(axis, 0, NOMINAL) is in_force
    assert spec_of_words(axis, 0, COMMAND.pack(50_001)) is None
    axis.lose_link(9 * MS)
    assert spec_of_words(axis, 0, NOMINAL) is in_force
    assert spec_of_words(axis, 0, COMMAND.pack(50_001)) is None


def test_an_open_target_keeps_its_own_correction() -> None:
    """It went to 20 000 without the table, and was sent to 50 000 with it."""
    axis = an_axis()
    axis.correction.enable(is_on=False)
    acknowledge(axis, 20_000)
    axis.correction.enable(is_on=True)
    was_other = [keeps_other_words(axis)]
    axis.targets.leave_unacknowledged(target(axis, 50_000), 9 * MS)
    was_other.append(keeps_other_words(axis))
    assert was_other == [True, False]


def test_a_target_from_before_a_lost_link_keeps_its_correction() -> None:
    axis = an_axis()
    for step in REACHED["out-of-reach"][1]:
        step(axis)
    assert not keeps_other_words(axis)
    axis.correction.enable(is_on=False)
    assert keeps_other_words(axis)


def test_one_axis_of_a_group_keeps_other_words_only_if_all_do() -> None:
    gantry, axes = group("x", "y")
    x, y = axes
    asked = x.correction.requested
    assert may_keep_words(x, asked)
    assert not may_keep_words(x, NOTHING)  # y uses the table
    assert may_keep_words(an_axis(), NOTHING)
    begin(gantry, axes, x)
    assert not may_keep_words(x, NOTHING)
    x.member.release()
    x.member.fix(None, keeps_words=True)
    assert may_keep_words(x, NOTHING)
    for axis in axes:
        axis.member.release()
        axis.correction.enable(is_on=False)
    assert may_keep_words(x, asked)  # y does as well
    x.targets.leave_unacknowledged(target(x, 50_000), 9 * MS)
    assert not may_keep_words(x, asked)  # seen elsewhere, it is rendered anew
    assert not may_keep_words(y, asked)  # so is y


# --- over a line -------------------------------------------------------------------------------------------


class Gantries(Bench):
    """Axis x on unit id 1 and axis y on unit id 2, both at 20 000 and done with it."""

    def __init__(self, **changes: Any) -> None:
        both = (axis_plan(**changes), axis_plan(name="y", unit_id=2, **changes))
        super().__init__(*both, groups=[["x", "y"]])
        for unit_id in (1, 2):
            self.ask(write(COMMAND, 20_000), unit_id=unit_id)
        self.memory.put(ACTUAL, 20_010)
        self.ask(read(ACTUAL))
        self.ask(read(ACTUAL), unit_id=2)
        gantry = self.line.axes[0].member.gantry
        assert gantry is not None
        assert gantry.is_open
        self.gantry = gantry


def test_another_target_for_the_first_axis_begins_a_new_decision() -> None:
    """Switched off after x has started: y goes as x has gone, and x goes 1:1 with its next target."""
    bench = Gantries()
    assert bench.sent_for(write(COMMAND, 50_000)) == write(COMMAND, 50_010)
    since_ns = bench.gantry.since_ns
    switch(bench.line.axes, "x", is_on=False)
    assert bench.sent_for(write(COMMAND, 50_000)) == write(COMMAND, 50_010)  # the same one
    assert bench.gantry.since_ns == since_ns
    assert bench.sent_for(write(COMMAND, 60_000)) == write(COMMAND, 60_000)
    assert bench.gantry.since_ns > since_ns


def test_the_words_of_its_target_begin_none() -> None:
    """50 000 is C350 0000 with its low word first, 120 000 is D4C0 0001."""
    bench = Gantries()
    bench.ask(bytes.fromhex("06 0606 D4C0"))
    since_ns = bench.gantry.since_ns
    bench.ask(bytes.fromhex("06 0607 0001"))
    assert bench.gantry.since_ns == since_ns
    assert bench.memory.get(COMMAND) == 120_010
    bench.ask(bytes.fromhex("06 0606 C350"))  # a word of another one
    assert bench.gantry.since_ns > since_ns


def test_a_word_that_comes_later_is_of_another_target() -> None:
    bench = Gantries()
    bench.ask(bytes.fromhex("06 0606 D4C0"))
    since_ns = bench.gantry.since_ns
    bench.wait(JOINED_MS + 1)
    bench.ask(bytes.fromhex("06 0607 0001"))
    assert bench.gantry.since_ns > since_ns
