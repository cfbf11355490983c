"""Cross terms: an axis acts by its last accepted target; without one, its term is held, then fades."""

from itertools import pairwise
from typing import Any

import pytest

from gateway.compensation.settings import Setpoints, ThermalSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.axis.axis import join_terms
from gateway.exchange.commands import SetReference
from gateway.exchange.control import set_temperature
from gateway.exchange.plan import AxisPlan, CrossPlan, Reference
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from gateway.status.axis import CrossStatus
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan, read, write
from tests.exchange.record_bench import RecordBench

FLAT = make_table([0, 1000], [0.0, 0.0], [0.0, 0.0], Units.MM)
TRAVEL = (0.0, 1000.0)
Y_COMMAND = PositionField(0x0706, RegisterType.INT32, WordOrder.LOW_FIRST)
Y_ACTUAL = PositionField(0x0720, RegisterType.INT32, WordOrder.LOW_FIRST)
SQUARENESS = CrossPlan("y", (0.0, 1000.0), (0.0, 0.1), fresh_s=60.0)
"""100 µm over 1 m of y."""
SAG = CrossPlan("y", (0.0, 500.0, 1000.0), (0.0, 0.02, 0.0), fresh_s=60.0)


def x_plan(**changes: Any) -> AxisPlan:
    return axis_plan(**{"table": FLAT, "travel": TRAVEL, "cross": (SQUARENESS,), **changes})


def y_plan(**changes: Any) -> AxisPlan:
    more = {"name": "y", "command": (Y_COMMAND,), "actual": (Y_ACTUAL,), "table": None, "travel": TRAVEL}
    return axis_plan(**{**more, **changes})


def go_y(bench: Bench, counts: float) -> None:
    assert bench.ask(write(Y_COMMAND, counts)) == write(Y_COMMAND, counts)[:5]
    bench.memory.put(Y_ACTUAL, bench.memory.get(Y_COMMAND))
    bench.wait(1000.0)


def told(bench: Bench) -> float:
    return bench.memory.get(COMMAND)


def terms(bench: Bench) -> Any:
    found = bench.line.axes[0].correction.terms
    assert found is not None
    return found


def test_an_axis_that_is_out_of_square_is_corrected_by_where_the_other_one_is() -> None:
    bench = Bench(x_plan(), y_plan())
    assert bench.reach(100_000) == 100_000  # nobody knows yet where y is
    go_y(bench, 400_000)
    assert bench.reach(200_000) == 200_040
    assert bench.actual() == 200_000
    go_y(bench, 1_000_000)
    assert bench.reach(300_000) == 300_100
    assert bench.actual() == 300_000


def test_the_nominal_position_counts_and_not_the_corrected_one() -> None:
    steep = make_table([0, 1000], [0.0, 5.0], [0.0, 5.0], Units.MM)
    bench = Bench(x_plan(), y_plan(table=steep, max_correction=5.0))
    go_y(bench, 500_000)
    assert bench.memory.get(Y_COMMAND) == 502_500
    assert bench.reach(200_000) == 200_050


def test_a_new_target_of_the_other_axis_does_not_move_this_one() -> None:
    bench = Bench(x_plan(), y_plan())
    bench.move(200_000)
    go_y(bench, 400_000)
    seen = [pdu for pdu in bench.seen if pdu[1:3] == COMMAND.address.to_bytes(2, "big")]
    bench.wait(1000.0)
    assert len(seen) == 1
    assert bench.actual() == 200_000
    assert bench.reach(200_000) == 200_000  # M4
    assert bench.reach(200_001) == 200_041


def test_a_short_way_is_left_as_soon_as_the_other_axis_has_another_target() -> None:
    bench = Bench(x_plan(), y_plan())
    go_y(bench, 400_000)
    for counts in (100_000, 200_000, 300_000):
        assert bench.reach(counts) == counts + 40
    assert bench.ask(write(Y_COMMAND, 500_000))
    assert bench.reach(400_000) == 400_050  # no second has passed


def test_one_way_of_the_other_axis_sags_and_comes_back() -> None:
    bench = Bench(x_plan(cross=(SAG,)), y_plan())
    for y, added in ((0, 0), (250_000, 10), (500_000, 20), (750_000, 10), (1_000_000, 0), (1_200_000, 0)):
        go_y(bench, y)
        assert bench.reach(100_000 + y // 100 + 1) == 100_000 + y // 100 + 1 + added


def test_two_axes_that_act_on_each_other_do_not_run_in_circles() -> None:
    back = CrossPlan("x", (0.0, 1000.0), (0.0, -0.1), fresh_s=60.0)
    bench = Bench(x_plan(), y_plan(table=FLAT, cross=(back,)))
    for _ in range(3):
        bench.move(500_000)
        go_y(bench, 500_000)
        bench.move(500_001)
        go_y(bench, 500_001)
    assert told(bench) == 500_051
    assert bench.memory.get(Y_COMMAND) == 499_951
    assert bench.actual() == 500_001
    assert Y_ACTUAL.unpack(bench.ask(read(Y_ACTUAL))[2:]) == 500_001


def test_a_cross_term_adds_to_the_thermal_one() -> None:
    bench = Bench(x_plan(thermal=ThermalSettings(11.5e-6, fixed_at=200.0)), y_plan())
    set_temperature(bench.line.axes, "x", 30.0, bench.now_ns)
    go_y(bench, 400_000)
    assert bench.reach(1_000_000) == 1_000_000 + 40 - 92
    assert bench.reach(200_000) == 200_040
    assert bench.actual() == 200_000


def test_the_term_of_another_axis_that_loses_its_reference_is_held_and_then_fades() -> None:
    bench = Bench(x_plan(), y_plan(referenced=Reference.SET_POSITION))
    x, y = bench.line.axes
    bench.line.command(SetReference(axis="y"), bench.now_ns)
    go_y(bench, 400_000)
    assert bench.reach(100_000) == 100_040
    y.lose_reference()
    go_y(bench, 900_000)  # a target of an axis that does not know where it is says nothing
    assert bench.reach(200_000) == 200_040  # held
    bench.wait(55_000.0)
    assert bench.reach(200_500) == 200_540
    bench.wait(33_000.0)  # 90 s: half of it is gone
    assert bench.reach(300_000) == 300_020
    bench.wait(60_000.0)
    assert bench.reach(400_000) == 400_000
    kinds = [(e.kind.name, dict(e.more)["term"]) for e in bench.events if e.kind.name.startswith("term-")]
    assert kinds == [("term-follows", "cross"), ("term-held", "cross"), ("term-fades", "cross")]
    found = terms(bench).status(x.compensation, bench.now_ns)
    assert found.cross == CrossStatus(state="faded", axes=["y"], correction=0.0)
    bench.line.command(SetReference(axis="y"), bench.now_ns)
    go_y(bench, 300_000)
    assert bench.reach(500_000) == 500_030


def test_another_axis_without_a_target_counts_by_its_reading() -> None:
    bench = Bench(x_plan(), y_plan())
    go_y(bench, 400_000)
    bench.move(100_000)
    bench.line.axes[1].forget()  # as a stop, a jog or a move of another kind does
    bench.memory.put(Y_ACTUAL, 600_000)
    bench.ask(read(Y_ACTUAL))
    bench.wait(1000.0)
    assert bench.reach(200_000) == 200_060
    bench.wait(59_000.0)  # that reading is too old now, and what it gave is held
    bench.memory.put(Y_ACTUAL, 900_000)
    assert bench.reach(300_000) == 300_060
    found = terms(bench).status(bench.line.axes[0].compensation, bench.now_ns)
    assert found.cross
    assert found.cross.state == "held"


def test_another_axis_that_is_lost_before_it_ever_counted_is_waited_for() -> None:
    """As if a cable is pulled before the first target: y was read, and x never got a target."""
    bench = Bench(x_plan(), y_plan())
    go_y(bench, 400_000)
    assert [event.kind.name for event in terms(bench).events("x", bench.now_ns)] == ["term-follows"]
    bench.line.link_down(bench.now_ns)
    assert terms(bench).events("x", bench.now_ns) == []
    bench.line.link_up(bench.now_ns)
    bench.serve()
    assert bench.reach(100_000) == 100_000
    go_y(bench, 400_000)
    assert bench.reach(200_000) == 200_040
    assert bench.kinds()[-1] == "term-follows"


def test_units_and_turns_of_the_other_axis_are_its_own() -> None:
    inches = CrossPlan("y", (0.0, 254.0), (0.0, 0.0254), scale=25.4)
    y = y_plan(units=Units.INCH, travel=(0.0, 40.0))
    bench = Bench(x_plan(cross=(inches,)), y)
    go_y(bench, 5_000)  # 5 inches
    assert bench.reach(100_000) == 100_013  # 12.7 µm
    turn = CrossPlan("y", (0.0, 90.0, 180.0, 360.0), (0.0, 0.01, 0.0, 0.0), modulo=360.0)
    bench = Bench(x_plan(cross=(turn,)), y_plan(modulo=360.0))
    go_y(bench, 810_000)  # two turns and 90
    assert bench.reach(100_000) == 100_010


def test_an_axis_of_another_line_counts_as_well() -> None:
    one, other = Bench(x_plan()), Bench(y_plan())
    go_y(other, 400_000)
    assert one.reach(100_000) == 100_000
    join_terms([*one.line.axes, *other.line.axes])
    one.wait(1000.0)
    assert one.reach(200_000) == 200_040


def test_after_a_restart_the_term_of_the_other_axis_continues() -> None:
    bench = RecordBench(x_plan(), y_plan(table=FLAT))
    go_y(bench, 400_000)
    bench.move(100_000)
    bench.actual()
    assert told(bench) == 100_040
    again = bench.restarted()
    assert again.actual() == 100_000
    assert again.reach(100_000) == 100_040
    assert again.reach(200_000) == 200_040
    go_y(again, 500_000)
    assert again.reach(300_000) == 300_050


def test_a_restart_in_which_the_other_axis_is_lost_holds_its_term() -> None:
    bench = RecordBench(x_plan(), y_plan(table=FLAT))
    go_y(bench, 400_000)
    bench.move(100_000)
    again = bench.restarted()
    again.line.axes[1].lose_reference()
    again.line.axes[1].forget()
    assert again.actual() == 100_000
    assert again.reach(200_000) == 200_040


@pytest.mark.parametrize("first", ["x", "y"])
def test_a_stream_follows_another_stream_without_a_step(first: str) -> None:
    stream = {"setpoints": Setpoints.STREAM, "hysteresis": 0.002}
    bench = Bench(x_plan(**stream), y_plan(**stream))
    bench.memory.put(ACTUAL, 100_000)
    bench.memory.put(Y_ACTUAL, 400_000)
    added = []
    for cycle in range(2000):
        x_counts, y_counts = 100_000 + 20 * cycle, 400_000 + 100 * cycle
        orders = [(COMMAND, x_counts), (Y_COMMAND, y_counts)]
        for place, counts in orders if first == "x" else reversed(orders):
            bench.ask(write(place, counts))
        bench.now_ns += 4 * MS
        added.append(told(bench) - x_counts)
    # Where y is first, 40 µm come over 1 mm as any change-over does: π/2 × 4 % of 20 counts at most.
    # Else they follow at 1 %: 0.2 counts a cycle, and then those 0.01 that y goes on.
    assert all(0 <= after - before <= (2 if first == "y" else 1) for before, after in pairwise(added))
    assert added[-1] == round(0.1 * (400_000 + 100 * (1999 - (first == "x"))) / 1000)
    bench.memory.put(ACTUAL, told(bench))
    assert bench.actual() == 100_000 + 20 * 1999
