"""Another table or gain for an axis: it takes the loop little time, and a refusal changes nothing."""

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Final, overload

import pytest

from gateway.compensation.settings import AxisSettings, Gain, Outside, OutsideKind, Setpoints
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.exchange import control
from gateway.exchange.axis.axis import Axis
from gateway.exchange.commands import Disable, Enable, TableFor
from gateway.exchange.control import ControlError
from gateway.exchange.plan import AxisPlan, CompensationMode, Reference
from gateway.modbus.registers import PositionField, RegisterType
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, axis_plan, stream_plan, write

POINTS = 50_000


class Counting(Sequence[float]):
    """Numbers that count how often one of them is looked at."""

    def __init__(self, numbers: Sequence[float]) -> None:
        self.numbers = array("d", numbers)
        self.looks = 0

    def __len__(self) -> int:
        return len(self.numbers)

    @overload
    def __getitem__(self, index: int) -> float: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[float]: ...

    def __getitem__(self, index: int | slice) -> float | Sequence[float]:
        self.looks += 1 if isinstance(index, int) else len(self.numbers)
        return self.numbers[index]

    def __iter__(self) -> Iterator[float]:
        self.looks += len(self.numbers)
        return iter(self.numbers)


def counting_table(height: float) -> tuple[CorrectionTable, tuple[Counting, ...]]:
    positions = [number / 100 for number in range(POINTS)]
    forward = [height * (number % 2) / 1000 for number in range(POINTS)]
    table = make_table(positions, forward, [c / 2 for c in forward], Units.MM)
    columns = tuple(map(Counting, (table.positions, table.forward, table.backward)))
    digest = f"{int(height):064x}"  # a compiled table brings its own: nobody has to walk over it for one
    counting = replace(table, positions=columns[0], forward=columns[1], backward=columns[2], digest=digest)
    return counting, columns


def axis_with(table: CorrectionTable | None, setpoints: Setpoints) -> Axis:
    settings = AxisSettings(
        units=Units.MM,
        counts_per_unit=1000.0,
        setpoints=setpoints,
        outside=Outside(OutsideKind.FADE, fade_length=10.0),
    )
    command = (PositionField(100, RegisterType.INT32),)
    return Axis(AxisPlan("x", 1, settings, table, CompensationMode.ON, Reference.ABSOLUTE, command))


FOR_X: Final = [TableFor("x", "x.tab", "centroid-3", "0" * 64)]


@pytest.mark.parametrize("setpoints", list(Setpoints))
def test_no_change_reads_every_point_of_a_table(setpoints: Setpoints) -> None:
    old, old_columns = counting_table(1.0)
    new, new_columns = counting_table(2.0)
    axis = axis_with(old, setpoints)
    for counts in (100_000, 120_000, 140_000):
        axis.compensation.commit(axis.compensation.plan(counts, None, 0), counts)
    for column in (*old_columns, *new_columns):
        column.looks = 0
    control.set_tables([axis], FOR_X, [new])
    control.set_gain([axis], "x", Gain(0.5, 0.9))
    control.switch([axis], "x", is_on=False)
    control.switch([axis], "x", is_on=True)
    axis.lose_reference()
    axis.declare_referenced()
    # The ends of both columns, whenever a curve is made of them; 50 000 where somebody walks.
    assert sum(column.looks for column in (*old_columns, *new_columns)) < 100


def test_a_refused_table_leaves_the_old_one() -> None:
    old, _ = counting_table(1.0)
    axis = axis_with(old, Setpoints.TARGETS)
    plan, wanted = axis.plan, axis.compensation.plan(50_000, None, 0).correction_counts
    steep = make_table([0.0, 1.0], [0.0, 0.4], [0.0, 0.4], Units.MM)
    tall = make_table([0.0, 100.0], [0.0, 0.6], [0.0, 0.6], Units.MM)
    for table, said in (
        (tall, r"corrects by 0\.6 mm, more than max_correction = 0\.5"),
        (replace(steep, units=Units.DEGREE), "is in degree, not mm"),
        (replace(steep, facts=steep.facts._replace(max_slope=1.5)), r"has a slope of 1\.5, 1 or more"),
    ):
        with pytest.raises(ControlError, match=said):
            control.set_tables([axis], FOR_X, [table])
        assert axis.plan is plan
    assert axis.compensation.plan(50_000, None, 0).correction_counts == wanted
    with pytest.raises(ControlError, match="there is no axis q here; there are x"):
        control.set_tables([axis], [TableFor("q", "q.tab", "centroid-3", "0" * 64)], [old])


def test_a_table_without_the_lost_motion_that_is_configured_is_refused() -> None:
    from gateway.compensation.backlash import with_backlash
    from gateway.compensation.settings import Backlash, BacklashKind

    flat = make_table([0.0, 100.0], [0.0, 0.0], [0.0, 0.0], Units.MM)
    backlash = Backlash(0.02, BacklashKind.TWO_SIDED)
    axis = axis_with(None, Setpoints.TARGETS)
    axis.plan = replace(axis.plan, settings=replace(axis.plan.settings, backlash=backlash))
    with pytest.raises(ControlError, match="is without its backlash: compile it again"):
        control.set_tables([axis], FOR_X, [flat])
    assert control.set_tables([axis], FOR_X, [with_backlash(flat, backlash)]) == {"x": "next-target"}


def test_the_blend_of_a_change_during_a_setpoint_on_the_wire_is_as_long_as_its_difference_needs() -> None:
    everywhere = make_table([0, 100], [0.4, 0.4], [0.4, 0.4], Units.MM)
    bench = Bench(stream_plan(table=everywhere, max_correction=0.5, reload_distance=0.1))
    control.switch(bench.line.axes, "x", is_on=False)
    told = []
    for number in range(100):
        if number == 5:
            control.switch(bench.line.axes, "x", is_on=True)
        bench.send(write(COMMAND, 50 * number))
        if number == 5:  # the one that begins the change is on its way
            control.switch(bench.line.axes, "x", is_on=False)
        bench.serve()
        bench.port.take()
        told.append(bench.memory.get(COMMAND) - 50 * number)
    # Both changes take 4 x 0.4 mm, 32 setpoints, at most 1.5 x the mean slope: 1.5 x 400 / 32 = 18.75 counts.
    assert max(told) == 400
    assert told[-1] == 0
    assert max(abs(b - a) for a, b in pairwise(told)) <= 20


@pytest.mark.parametrize("way", ["switch", "clear"])
def test_the_readings_of_an_axis_do_not_jump_when_it_is_switched_off(way: str) -> None:
    """0.5 mm lie between what it reads and what 1:1 would be: they fade on the way to its next target."""
    table = make_table([0, 100], [0.5, 0.5], [0.5, 0.5], Units.MM)
    bench = Bench(axis_plan(table=table, max_correction=0.5))
    bench.move(10_000)
    assert bench.memory.get(ACTUAL) == 10_500
    if way == "switch":
        control.switch(bench.line.axes, "x", is_on=False)
    else:
        control.clear_table(bench.line.axes, "x")
    assert bench.actual() == 10_000
    assert bench.command(20_500) == 20_500
    readings = []
    for corrected in (10_500, 13_000, 15_500, 18_000, 20_500):
        bench.memory.put(ACTUAL, corrected)
        readings.append(bench.actual())
    assert readings == [10_000, 12_625, 15_250, 17_875, 20_500]
    for corrected in (20_500, 15_500, 10_500):  # whatever moves it now
        bench.memory.put(ACTUAL, corrected)
        assert bench.actual() == corrected
    bench.ask(write(COMMAND, 30_000))
    bench.memory.put(ACTUAL, 25_000)
    assert bench.actual() == 25_000


@pytest.mark.parametrize(
    ("changes", "gain", "comes"),
    [
        ({}, Gain(0.5, 0.5), "next-target"),
        ({"setpoints": Setpoints.STREAM}, Gain(0.5, 0.5), "blended"),
        ({}, Gain(0.0, 0.0), "next-target"),
        ({"compensation": CompensationMode.SHADOW}, Gain(0.5, 0.5), "not-in-force"),
        ({"compensation": CompensationMode.OFF}, Gain(0.5, 0.5), "not-in-force"),
        ({"table": None}, Gain(0.5, 0.5), "not-in-force"),
        ({"referenced": Reference.SET_POSITION}, Gain(0.5, 0.5), "not-in-force"),
    ],
)
def test_a_gain_says_how_it_comes_into_force(changes: dict[str, Any], gain: Gain, comes: str) -> None:
    axis = Axis(axis_plan(**changes))
    assert control.set_gain([axis], "x", gain) == {"x": comes}


@pytest.mark.parametrize(
    ("changes", "comes"),
    [
        ({}, "next-target"),
        ({"setpoints": Setpoints.STREAM}, "blended"),
        ({"compensation": CompensationMode.SHADOW}, "not-in-force"),
        ({"referenced": Reference.SET_POSITION}, "not-in-force"),
        ({"gain": Gain(0.0, 0.0)}, "not-in-force"),
    ],
)
def test_switching_on_says_how_the_correction_comes_into_force(changes: dict[str, Any], comes: str) -> None:
    axis = Axis(axis_plan(**changes))
    assert control.carry_out([axis], Disable(axes=("x",)), 0) == {"x": ""}
    assert control.carry_out([axis], Enable(axes=("x",)), 0) == {"x": comes}
