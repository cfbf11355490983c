"""The silence that drives want before a request: what of it a controller waits for, worked out by hand."""

from dataclasses import replace

import pytest

from gateway.budget.line import ControllerBudget, line_budget
from gateway.budget.sequence import What
from gateway.budget.verdict import Grade, judge
from gateway.exchange.plan import AxisPlan, LineTiming, Role
from gateway.state.plan import LinePlan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from tests.budget.budget_bench import TABLE, TCP, axis, controller, line, serial

IMPOSSIBLE, CLOSE = Grade.IMPOSSIBLE, Grade.CLOSE
RTU = serial(9600)


def gapped(
    gap_ms: float,
    master: SerialEndpoint | TcpEndpoint = TCP,
    *,
    timeout_ms: float = 1000.0,
    role: Role = Role.MOTION,
    axes: tuple[AxisPlan, ...] = (),
) -> LinePlan:
    """Drives on TCP that want a silence: nothing else takes any time on their side."""
    link = controller(master, timeout_ms=timeout_ms, role=role)
    return line(TCP, link, axes=axes, timing=LineTiming(gap_ms=gap_ms))


def only(plan: LinePlan) -> ControllerBudget:
    return line_budget(plan).controllers[0]


def gaps_ms(plan: LinePlan) -> list[float]:
    return [each.legs.gap_ns / 1e6 for each in only(plan).exchanges]


def waits_ms(plan: LinePlan) -> list[float]:
    return [each.legs.waited_ns / 1e6 for each in only(plan).exchanges]


def test_an_exchange_that_follows_at_once_waits_for_the_gap() -> None:
    """Of 60 ms, half of the gateway's 1 ms has gone on the way back and half on the way there."""
    plan = gapped(60.0)
    assert gaps_ms(plan) == [59.0, 59.0]
    assert waits_ms(plan) == [60.0, 60.0]
    assert only(plan).round.total_ns == 120_000_000


def test_the_controllers_own_wire_hides_a_part_of_the_gap() -> None:
    """9600 8E1: 13 and 8 bytes to write, 8 and 9 to read, 4.01042 ms before the controller sends again."""
    plan = gapped(60.0, RTU)
    # Before the write: 60 - (0.5 + 10.3125 + 4.01042 + 14.89583 + 0.5).
    # Before the read: 60 - (0.5 + 9.16667 + 4.01042 + 9.16667 + 0.5).
    assert gaps_ms(plan) == pytest.approx([29.78125, 36.65625], abs=1e-5)
    # 1 + 29.78125 + 9.16667 and 1 + 36.65625 + 10.3125: the controller's own silence is over by then.
    assert waits_ms(plan) == pytest.approx([39.94792, 47.96875], abs=1e-5)
    assert only(plan).round.total_ns == pytest.approx(120_000_000, abs=5)


def test_a_gap_that_the_controllers_wire_hides_whole_costs_nothing() -> None:
    assert gaps_ms(gapped(23.0, RTU)) == [0.0, 0.0]
    # 26.354 ms until the read: 23.34375 and what is left of the silence before a reply, 4.01042 - 1.
    assert gaps_ms(gapped(26.3, RTU)) == [0.0, 0.0]


# One read after the other: 0.5 + 3.01042 + 10.3125 + 4.01042 + 9.16667 + 0.5 = 27.5 ms from an answer to the
# next request. As long as nothing is held the gateway waits 3.01042 ms before each reply, later none.
@pytest.mark.parametrize(
    ("gap_ms", "held_ms", "round_ms"),
    [(27.0, 0.0, 27.5), (28.0, 28.0 - 24.48958, 28.0), (40.0, 40.0 - 24.48958, 40.0)],
)
def test_a_round_of_one_exchange_comes_as_often_as_the_gap_lets_it(
    gap_ms: float, held_ms: float, round_ms: float
) -> None:
    plan = gapped(gap_ms, RTU, role=Role.MONITOR)
    assert gaps_ms(plan) == pytest.approx([held_ms], abs=1e-5)
    assert only(plan).round.total_ns / 1e6 == pytest.approx(round_ms, abs=1e-5)


def test_what_no_pause_saves_is_counted_without_the_gap() -> None:
    # Over RTU at 9600: 9.167 for the echo of the write, 10.313 for the reading and what silence is left of
    # 4.01042 ms before each of them, for nothing else takes any time.
    assert [each.least_ns for each in only(gapped(60.0)).exchanges] == [0, 0]
    found = [each.least_ns / 1e6 for each in only(gapped(60.0, RTU)).exchanges]
    assert found == pytest.approx([13.17708, 14.32292], abs=1e-5)


@pytest.mark.parametrize(
    ("master", "timeout_ms", "grade"),
    [
        (TCP, 59.9, CLOSE),
        (TCP, 60.0, None),
        # The read waits 47.969 ms, with its request 57.135 ms; on a quiet line 14.323.
        (RTU, 14.3, IMPOSSIBLE),
        (RTU, 14.4, CLOSE),
        (RTU, 47.9, CLOSE),
        (RTU, 48.0, CLOSE),
        (RTU, 57.1, CLOSE),
        (RTU, 57.2, None),
    ],
)
def test_a_time_out_against_the_gap(
    master: SerialEndpoint | TcpEndpoint, timeout_ms: float, grade: Grade | None
) -> None:
    found = judge(gapped(60.0, master, timeout_ms=timeout_ms))
    assert [each.grade for each in found] == ([] if grade is None else [grade])


def test_a_gap_that_no_time_out_allows_stands_in_the_sum() -> None:
    [judgement] = judge(gapped(60.0, timeout_ms=50.0))
    assert judgement.found == (
        "timeout_ms = 50, and the reply to write target of axis x comes 60.0 ms after its request "
        "(1.00 gateway + 59.0 silence since the exchange before)"
    )
    assert judgement.remedy == (
        "gap_ms no longer than the drives need, or a controller that pauses as long; "
        "or let the controller wait longer than 61 ms, if it can"
    )


def test_frames_of_the_gateways_own_keep_a_gap_as_well() -> None:
    """The read of the position before a target that moves at once: 60 ms held, then 60 ms after it."""
    plan = gapped(60.0, timeout_ms=100.0, axes=(replace(axis(), table=TABLE),))
    [judgement] = judge(plan)
    assert judgement.grade is CLOSE
    assert "comes 60.0 ms after its request" in judgement.found
    assert judgement.found.endswith(", with frames added by the gateway 60.0 ms later")
    assert judgement.remedy.endswith("or let the controller wait longer than 121 ms, if it can")


def test_a_target_is_older_by_the_gap_when_the_drive_has_it() -> None:
    """1 ms of the gateway's and 59 of the gap; nothing else takes time on TCP."""
    [judgement] = judge(gapped(60.0, axes=(replace(axis(), deadline_ms=59.9),)))
    assert (judgement.grade, judgement.key) == (CLOSE, ("axis", "x", "deadline_ms"))
    assert "60.0 ms after the gateway (1.00 gateway + 59.0 silence since the exchange" in judgement.found
    assert judge(gapped(60.0, axes=(replace(axis(), deadline_ms=60.0),))) == ()


def test_a_gap_stands_between_another_controllers_exchange_and_ones_own() -> None:
    links = (controller(TCP), controller(TCP, "hmi", role=Role.MONITOR))
    plan = line(TCP, *links, timing=LineTiming(gap_ms=60.0))
    assert line_budget(plan).longest_other_ns(0) == 60_000_000
    [read] = line_budget(plan).controllers[1].exchanges
    assert read.step.what is What.POSITION
