"""What cannot be met, what is close and what is only worth knowing, at limits worked out by hand."""

from dataclasses import replace

import pytest

from gateway.budget.sequence import AS_MAPPED, Blocks
from gateway.budget.verdict import Grade, Judgement, judge, of_grade
from gateway.exchange.plan import AxisPlan, LineTiming, Role
from gateway.state.plan import LinePlan
from gateway.transport.endpoints import TcpEndpoint
from tests.budget.budget_bench import TCP, axis, controller, known_axis, line, serial

IMPOSSIBLE, CLOSE, NOTE = Grade.IMPOSSIBLE, Grade.CLOSE, Grade.NOTE


def slow(timeout_ms: float, **changes: object) -> LinePlan:
    """9600 8E1 on both sides."""
    plan = line(serial(9600), controller(serial(9600), timeout_ms=timeout_ms))
    return replace(plan, **changes)  # type: ignore[arg-type]


def one(plan: LinePlan, blocks: Blocks = AS_MAPPED) -> Judgement:
    [judgement] = judge(plan, blocks)
    return judgement


# Write: 14.896 + 9.167 + 9.167 = 33.229 ms after the request, with the gateway's 1 ms 34.229; with its
# request (14.896) it takes 49.125 ms.
@pytest.mark.parametrize(
    ("timeout_ms", "grade"),
    [(33.2, IMPOSSIBLE), (33.3, CLOSE), (34.2, CLOSE), (34.3, CLOSE), (49.1, CLOSE), (49.2, None)],
)
def test_a_time_out_against_the_sum(timeout_ms: float, grade: Grade | None) -> None:
    found = judge(slow(timeout_ms))
    assert [each.grade for each in found] == ([] if grade is None else [grade])


def test_a_time_out_that_cannot_be_met_shows_the_sum_and_what_to_do() -> None:
    judgement = one(slow(30.0))
    assert judgement.key == ("line", "xyz", "controllers", 0, "timeout_ms")
    assert judgement.found == (
        "timeout_ms = 30, but the reply to write target of axis x comes 34.2 ms after its request "
        "(1.00 gateway + 14.9 to the drive + 9.17 from the drive + 9.17 to the controller)"
    )
    # Drives at 115200: the reading is the longest then, 3.5 characters of silence on the controller's side
    # and 10.313 back. The controller at 115200: 1 + 14.896 + 9.167 + 0.764. Both: 1 + 1.241 + 0.764 + 0.764.
    assert judgement.remedy == (
        "drives at 115200 Bd: from 34.2 to 14.3 ms; cnc at 115200 Bd: from 34.2 to 25.8 ms; "
        "both at 115200 Bd: from 34.2 to 3.77 ms; or let the controller wait longer than 35 ms, if it can"
    )


def test_a_controller_that_counts_from_its_first_byte_is_warned_of() -> None:
    judgement = one(slow(40.0))
    assert "write target of axis x takes 49.1 ms with its request" in judgement.found
    # Drives at 115200: 14.896 in, 4.010 of silence, 9.167 back.
    assert judgement.remedy.startswith("drives at 115200 Bd: from 49.1 to 28.1 ms; ")
    assert judgement.remedy.endswith("; or let the controller wait longer than 50 ms, if it can")


def test_frames_of_the_gateways_own_can_make_a_reply_late() -> None:
    """Delta at 9600: the trigger waits 1 + 3 × 9.167; two reads and the target anew add 44.688 + 28.073."""
    plan = slow(101.2, axes=(known_axis("delta-asda"),))
    # 28.5 + 72.760 = 101.260 ms.
    judgement = one(plan)
    assert judgement.grade is CLOSE
    assert "the reply to trigger of axis x comes 28.5 ms" in judgement.found
    assert "with frames added by the gateway 72.8 ms later" in judgement.found
    # Drives at 115200: 4.010 of silence, 9.167 back; 17, 15 and 21 bytes of 95.486 µs, 1.75 ms after each.
    # The controller at 115200: 1 + 2 × 9.167 + 0.764 + 72.760. Both: 1 + 3 × 0.764 + 10.311.
    assert judgement.remedy == (
        "drives at 115200 Bd: from 101 to 23.5 ms; cnc at 115200 Bd: from 101 to 92.9 ms; "
        "both at 115200 Bd: from 101 to 13.6 ms; or let the controller wait longer than 102 ms, if it can"
    )
    assert judge(slow(101.3, axes=(known_axis("delta-asda"),))) == ()


def test_a_master_that_waits_50_ms_is_warned_of_a_block_of_sixteen_at_9600() -> None:
    judgement = one(slow(1000.0), Blocks(target_registers=16))
    assert judgement.grade is NOTE
    assert "comes 66.3 ms after its request" in judgement.found  # 65.31 and the gateway's 1.00
    assert "without the gateway 9.17 ms" in judgement.found
    assert "some masters give up after 50 ms (minimalmodbus" in judgement.found
    assert judgement.remedy.startswith("drives at 115200 Bd: from 66.3 to 14.8 ms; ")


def test_a_master_that_would_give_up_without_the_gateway_too_is_no_news() -> None:
    # 64 registers at 9600: the reply alone takes 133 × 11 / 9600 = 152 ms.
    assert judge(slow(1000.0), Blocks(read_registers=64)) == ()


def test_a_controller_on_tcp_is_none_of_those_masters() -> None:
    assert judge(line(serial(9600), controller(TCP)), Blocks(target_registers=16, read_registers=40)) == ()


def late(deadline_ms: float, plan: AxisPlan | None = None) -> LinePlan:
    return slow(1000.0, axes=(replace(plan or axis(), deadline_ms=deadline_ms),))


# The gateway may take 1 ms; the whole target is at the drive 14.896 ms after that.
@pytest.mark.parametrize(
    ("deadline_ms", "grade"), [(0.9, IMPOSSIBLE), (1.0, CLOSE), (15.8, CLOSE), (15.9, None), (0.0, None)]
)
def test_a_deadline_against_the_sum(deadline_ms: float, grade: Grade | None) -> None:
    found = judge(late(deadline_ms))
    assert [(each.grade, each.key) for each in found] == (
        [] if grade is None else [(grade, ("axis", "x", "deadline_ms"))]
    )


# The target anew takes 28.073 ms before its trigger can go.
@pytest.mark.parametrize(("deadline_ms", "grade"), [(29.0, IMPOSSIBLE), (29.1, None)])
def test_a_deadline_of_a_trigger_that_waits_for_its_target(deadline_ms: float, grade: Grade | None) -> None:
    found = judge(late(deadline_ms, known_axis("oriental-az")))
    assert [each.grade for each in found] == ([] if grade is None else [grade])
    if found:
        assert found[0].found == (
            "deadline_ms = 29, but a trigger of this axis may be sent 29.1 ms after it came "
            "(1.00 gateway (budget_us) + 28.1 target again for its trigger)"
        )


def two_drives(motion_ms: float, timing: LineTiming, hmi_ms: float = 0.0) -> LinePlan:
    controllers = [controller(TCP, timeout_ms=motion_ms)]
    if hmi_ms:
        controllers.append(controller(TCP, "hmi", role=Role.MONITOR, timeout_ms=hmi_ms))
    return line(serial(115200), *controllers, axes=(axis(), axis("y", 2)), timing=timing)


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        (two_drives(1000.0, LineTiming()), "2000 ms (1000 response_timeout_ms + 1000 drain_ms)"),
        (two_drives(1000.0, LineTiming(500.0, 500.0)), "1000 ms (500 response_timeout_ms + 500 drain_ms)"),
        (two_drives(1000.0, LineTiming(500.0, 499.0)), ""),
        (two_drives(1000.0, LineTiming(300.0)), ""),  # drain_ms as response_timeout_ms
        # The gateway waits for a drive as long as the controller that asked (W7).
        (
            two_drives(1000.0, LineTiming(300.0, 300.0), 800.0),
            "1100 ms (800 timeout_ms of hmi + 300 drain_ms)",
        ),
        (two_drives(1000.0, LineTiming(300.0, 300.0), 300.0), ""),
    ],
)
def test_one_silent_drive_and_the_others(plan: LinePlan, said: str) -> None:
    found = judge(plan)
    assert len(found) == bool(said)
    for judgement in found:
        assert (judgement.grade, judgement.key[-2:]) == (CLOSE, (0, "timeout_ms"))
        told = f"timeout_ms = 1000, and a silent drive keeps writes to others waiting for {said}, "
        assert judgement.found == told + "three times"
        assert "(as in 300 each)" in judgement.remedy


def test_without_trials_a_silent_drive_costs_as_much_each_time() -> None:
    [judgement] = judge(two_drives(1000.0, LineTiming(retry_ms=0.0)))
    assert judgement.found.endswith("(1000 response_timeout_ms + 1000 drain_ms), for each request to it")


def test_a_silent_drive_alone_or_on_tcp_starves_nobody() -> None:
    plan = two_drives(1000.0, LineTiming())
    assert judge(replace(plan, axes=plan.axes[:1])) == ()
    assert judge(replace(plan, drives=TCP)) == ()
    behind_server = replace(plan, drives=TcpEndpoint("h", 4001, rtu=True))
    assert len(judge(behind_server)) == 1
    same_unit = (plan.axes[0], replace(plan.axes[1], unit_id=1))
    assert judge(replace(plan, axes=same_unit)) == ()


def test_grades_can_be_picked() -> None:
    found = judge(slow(30.0))
    assert of_grade(found, IMPOSSIBLE, NOTE) == found
    assert of_grade(found, CLOSE) == ()
