"""Exchanges and rounds, worked out by hand, and what must hold whatever the numbers are."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.budget.line import ControllerBudget, ExchangeBudget, line_budget
from gateway.budget.sequence import Blocks, What, Why
from gateway.budget.verdict import remedies
from gateway.compensation.settings import Setpoints
from gateway.exchange.plan import AxisPlan, LineTiming, Role
from gateway.state.plan import LinePlan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from tests.budget.budget_bench import TABLE, TCP, axis, controller, known_axis, line, serial

SLOW = line(serial(9600), controller(serial(9600)))


def only(plan: LinePlan, blocks: Blocks | None = None) -> ControllerBudget:
    return line_budget(plan, blocks or Blocks()).controllers[0]


def target_of(plan: LinePlan, blocks: Blocks | None = None) -> ExchangeBudget:
    [exchange] = [each for each in only(plan, blocks).exchanges if each.step.what is What.TARGET]
    return exchange


def ms(span_ns: int) -> float:
    return span_ns / 1e6


def test_one_write_leg_by_leg() -> None:
    """FC16 of two registers at 9600 8E1 on both sides: 13 and 8 bytes, 1.1458 ms each."""
    exchange = target_of(SLOW)
    legs = exchange.legs
    assert (exchange.request_bytes, exchange.reply_bytes) == (13, 8)
    assert (legs.request_in_ns, legs.request_out_ns) == (14_895_833, 14_895_833)
    assert (legs.reply_in_ns, legs.reply_out_ns) == (9_166_667, 9_166_667)
    assert (legs.gateway_ns, legs.drive_ns) == (1_000_000, 0)
    assert (legs.silence_ns, legs.request_tail_ns, legs.reply_tail_ns) == (0, 0, 0)
    assert ms(legs.total_ns) == pytest.approx(49.125, abs=1e-5)
    assert ms(legs.waited_ns) == pytest.approx(34.22917, abs=1e-5)
    assert ms(exchange.least_ns) == pytest.approx(33.22917, abs=1e-5)
    assert ms(exchange.direct.total_ns) == pytest.approx(24.0625, abs=1e-5)
    assert ms(exchange.direct.waited_ns) == pytest.approx(9.16667, abs=1e-5)


def test_a_block_of_sixteen_at_9600_is_too_long_for_a_master_that_waits_50_ms() -> None:
    """41 bytes out and 8 back: 46.98 and 9.17 ms. Direct it waits 9.17 ms, through the gateway 65.31."""
    exchange = target_of(SLOW, Blocks(target_registers=16))
    assert exchange.legs.request_out_ns == 46_979_167
    assert ms(exchange.least_ns) == pytest.approx(46.97917 + 9.16667 + 9.16667, abs=1e-5)
    # Drives at 115200: 3.915 + 0.764 + 9.167 + 1.000 ms.
    faster = {each.what: ms(each.waited_ns) for each in remedies(SLOW, 0, Blocks(target_registers=16))}
    assert faster["drives at 115200 Bd"] == pytest.approx(14.84549, abs=1e-5)
    # The controller at 115200: its reply in 0.764 instead of 9.167 ms.
    assert faster["cnc at 115200 Bd"] == pytest.approx(57.90972, abs=1e-5)
    assert next(iter(faster)) == "drives at 115200 Bd"


def test_a_round_between_two_wires() -> None:
    """The silence on the drives' side hides behind the controller's wire; the controller's own does not."""
    cycle = only(SLOW).round
    # Write 49.125, read 9.16667 + 1 + 9.16667 + 10.3125 + 10.3125 = 39.95833; twice 4.01042 of silence.
    assert ms(cycle.total_ns) == pytest.approx(49.125 + 39.95833 + 2 * 4.01042, abs=1e-4)
    assert ms(cycle.direct_ns) == pytest.approx(24.0625 + 19.47917 + 2 * 4.01042, abs=1e-4)


def test_a_round_from_tcp_has_all_silences_of_the_drives_and_hides_the_gateway_behind_them() -> None:
    cycle = only(line(serial(9600), controller(TCP))).round
    assert ms(cycle.total_ns) == pytest.approx(24.0625 + 19.47917 + 2 * 4.01042, abs=1e-4)
    assert cycle.direct_ns == pytest.approx(cycle.total_ns, abs=5)


def test_a_drive_that_wants_10_ms_between_frames() -> None:
    """At 115200 on both sides the controller's wire hides only a part of them."""
    timing = LineTiming(gap_ms=10.0)
    cycle = only(line(serial(115200), controller(serial(115200)), timing=timing)).round
    # 21 and 17 bytes of 95.486 µs on the drives' side, and 10 ms after each.
    assert ms(cycle.total_ns) == pytest.approx(38 * 0.0954861 + 20.0, abs=1e-4)
    assert cycle.direct_ns == pytest.approx(cycle.total_ns, abs=5)  # they want it from any master


def test_tcp_on_both_sides_costs_the_gateway_alone() -> None:
    cycle = only(line(TCP, controller(TCP))).round
    assert (cycle.total_ns, cycle.direct_ns) == (2_000_000, 0)


def test_an_rtu_controller_of_tcp_drives_waits_for_its_own_silence() -> None:
    """The reply may begin 3.5 characters after the request: 4.01 ms, of which the gateway takes one."""
    legs = target_of(line(TCP, controller(serial(9600)))).legs
    assert legs.silence_ns == 4_010_417 - 1_000_000
    assert ms(legs.total_ns) == pytest.approx(14.89583 + 4.01042 + 9.16667, abs=1e-4)


def test_a_frame_of_unknown_length_ends_by_silence_on_both_sides() -> None:
    plan = line(serial(9600), controller(serial(9600)), axes=(known_axis("igus-dryve-d1"),))
    legs = target_of(plan).legs
    assert (legs.request_tail_ns, legs.reply_tail_ns) == (4_010_417, 4_010_417)
    over = line(TcpEndpoint("h", 1, rtu=True), controller(TCP), axes=(known_axis("igus-dryve-d1"),))
    legs = target_of(over).legs
    assert (legs.request_tail_ns, legs.reply_tail_ns) == (0, 5_000_000)


def test_the_gateways_share_is_the_budget_of_the_axis() -> None:
    plan = line(serial(9600), controller(TCP), axes=(replace(axis(), budget_us=250.0),))
    assert target_of(plan).legs.gateway_ns == 250_000


def test_what_a_drive_takes_itself_is_in_every_figure() -> None:
    plan = line(serial(9600), controller(TCP), axes=(replace(axis(), table=TABLE, response_ms=2.5),))
    without = replace(plan, axes=(replace(plan.axes[0], response_ms=None),))
    one, other = line_budget(plan), line_budget(without)
    assert (dict(one.response_ns), dict(other.response_ns)) == ({"x": 2_500_000}, {})
    gains = [
        (target_of(plan).legs.total_ns, target_of(without).legs.total_ns),
        (target_of(plan).direct.waited_ns, target_of(without).direct.waited_ns),
        (one.added[0].hold_ns, other.added[0].hold_ns),
    ]
    assert [longer - shorter for longer, shorter in gains] == [2_500_000] * 3
    # Two exchanges in the round.
    assert only(plan).round.total_ns - only(without).round.total_ns == 5_000_000


def test_who_may_not_move_only_reads() -> None:
    plan = line(serial(9600), controller(TCP, role=Role.MONITOR))
    assert [each.step.what for each in only(plan).exchanges] == [What.POSITION]


def test_a_stream_does_not_ask_whether_a_move_has_ended() -> None:
    one = known_axis("oriental-az")
    streamed = replace(one, settings=replace(one.settings, setpoints=Setpoints.STREAM))
    # Trigger -5, written once, makes each target a move: neither a trigger nor the state in each cycle.
    plan = line(serial(9600), controller(TCP), axes=(streamed,))
    assert [each.step.what for each in only(plan).exchanges] == [What.TARGET, What.POSITION]


def test_frames_of_the_gateways_own_at_9600() -> None:
    plan = line(serial(9600), controller(TCP), axes=(known_axis("delta-asda"),))
    added = {each.added.why: each for each in line_budget(plan).added}
    # The read: 17 bytes and a silence. The target anew: 21 bytes and a silence.
    # Before a distance the state is read, too: 15 bytes and a silence.
    assert ms(added[Why.DIRECTION].hold_ns) == pytest.approx(19.47917 + 4.01042, abs=1e-4)
    assert ms(added[Why.BASE].hold_ns) == pytest.approx(19.47917 + 17.1875 + 2 * 4.01042, abs=1e-4)
    assert ms(added[Why.REWRITE].hold_ns) == pytest.approx(24.0625 + 4.01042, abs=1e-4)
    assert {each.added.before for each in added.values()} == {What.TRIGGER}
    [trigger] = [each for each in only(plan).exchanges if each.step.what is What.TRIGGER]
    assert trigger.added_ns == added[Why.BASE].hold_ns + added[Why.REWRITE].hold_ns


def test_a_distance_reads_whether_the_axis_stands_and_where_also_in_a_stream() -> None:
    one = known_axis("oriental-az")
    streamed = replace(one, settings=replace(one.settings, setpoints=Setpoints.STREAM))
    added = {
        each.added.why: each
        for each in line_budget(line(serial(9600), controller(TCP), axes=(streamed,))).added
    }
    # 8 and 7 bytes for the state, 8 and 9 for the position, a silence after each.
    assert ms(added[Why.BASE].hold_ns) == pytest.approx(32 * 11 / 9.6 + 2 * 4.01042, abs=1e-4)
    assert Why.DIRECTION not in added  # a stream goes by its setpoints


def test_nothing_is_added_without_a_table_or_where_it_is_forbidden() -> None:
    for change in ({"table": None}, {"added_frames": False}):
        plan = line(serial(9600), controller(TCP), axes=(replace(known_axis("delta-asda"), **change),))
        assert line_budget(plan).added == ()


def test_an_axis_that_moves_at_once_may_need_to_be_read_before_its_target() -> None:
    plan = line(serial(9600), controller(TCP), axes=(replace(axis(), table=TABLE),))
    [added] = line_budget(plan).added
    assert (added.added.why, added.added.before) == (Why.DIRECTION, What.TARGET)


def test_a_broadcast_keeps_the_line_for_its_turnaround() -> None:
    assert line_budget(SLOW).broadcast_ns == 100_000_000
    short = replace(SLOW, timing=LineTiming(turnaround_ms=1.0))
    assert line_budget(short).broadcast_ns == 9_166_667 + 4_010_417  # its own frame and a silence
    assert line_budget(line(TCP, controller(TCP))).broadcast_ns == 0


def test_another_controllers_exchange_can_come_first() -> None:
    plan = line(serial(9600), controller(serial(9600)), controller(TCP, "hmi", role=Role.MONITOR))
    budget = line_budget(plan, Blocks(read_registers=16))
    # 8 and 37 bytes, and the silence before what follows.
    assert budget.longest_other_ns(0) == 9_166_667 + 42_395_833 + 4_010_417
    assert line_budget(SLOW).longest_other_ns(0) == 0


def test_a_line_without_axes_has_only_the_block_that_was_asked_for() -> None:
    plan = replace(SLOW, axes=())
    assert only(plan).exchanges == ()
    [exchange] = only(plan, Blocks(read_registers=16)).exchanges
    assert (exchange.request_bytes, exchange.reply_bytes, exchange.step.axis) == (8, 37, "")


RATES = st.sampled_from([1200, 2400, 9600, 19200, 38400, 57600, 115200, 230400])
ENDS = st.one_of(st.just(TCP), st.builds(serial, RATES, st.sampled_from("NE")))
AXES = st.lists(
    st.sampled_from([axis(), known_axis("oriental-az"), known_axis("tl-r"), known_axis("igus-dryve-d1")]),
    min_size=1,
    max_size=4,
)


def named(axes: list[AxisPlan]) -> tuple[AxisPlan, ...]:
    return tuple(replace(each, name=f"a{n}", unit_id=n + 1) for n, each in enumerate(axes))


@given(drives=ENDS, master=ENDS, axes=AXES, gap_ms=st.floats(0.0, 20.0))
def test_a_round_is_its_exchanges_and_what_the_controller_keeps_and_no_gap_is_longer_than_wanted(
    drives: SerialEndpoint | TcpEndpoint,
    master: SerialEndpoint | TcpEndpoint,
    axes: list[AxisPlan],
    gap_ms: float,
) -> None:
    plan = line(drives, controller(master), axes=named(axes), timing=LineTiming(gap_ms=gap_ms))
    budget = line_budget(plan)
    [found] = budget.controllers
    parts_ns = sum(each.legs.total_ns for each in found.exchanges)
    assert found.round.total_ns == parts_ns + len(found.exchanges) * found.wire.silence_ns
    assert all(0 <= each.legs.gap_ns <= budget.gap_ns for each in found.exchanges)
    # On the drives' wire stands each request, each reply and a whole gap after it.
    drives_ns = sum(
        each.legs.request_out_ns + each.legs.reply_in_ns + budget.gap_ns for each in found.exchanges
    )
    assert found.round.total_ns >= drives_ns


@given(master=ENDS, axes=AXES, slow=RATES, fast=RATES, parity=st.sampled_from("NE"))
def test_faster_drives_never_make_anything_slower(
    master: SerialEndpoint | TcpEndpoint, axes: list[AxisPlan], slow: int, fast: int, parity: str
) -> None:
    slow, fast = sorted((slow, fast))
    before, after = (
        only(line(serial(rate, parity), controller(master), axes=named(axes))) for rate in (slow, fast)
    )
    assert after.round.total_ns <= before.round.total_ns
    for one, other in zip(before.exchanges, after.exchanges, strict=True):
        assert other.legs.waited_ns <= one.legs.waited_ns


@given(drives=ENDS, master=ENDS, axes=AXES)
def test_one_axis_more_never_makes_a_round_shorter(
    drives: SerialEndpoint | TcpEndpoint, master: SerialEndpoint | TcpEndpoint, axes: list[AxisPlan]
) -> None:
    fewer = only(line(drives, controller(master), axes=named(axes)))
    more = only(line(drives, controller(master), axes=named([*axes, axis()])))
    assert more.round.total_ns >= fewer.round.total_ns


@given(drives=ENDS, master=ENDS, axes=AXES)
def test_a_remedy_never_makes_the_round_longer(
    drives: SerialEndpoint | TcpEndpoint, master: SerialEndpoint | TcpEndpoint, axes: list[AxisPlan]
) -> None:
    for remedy in remedies(line(drives, controller(master), axes=named(axes)), 0):
        assert remedy.round_ns <= remedy.round_before_ns
        assert remedy.waited_ns <= remedy.waited_before_ns
