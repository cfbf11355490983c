"""Targets that wait longer than their axis allows: refused in a stream, sent and counted else (DESIGN 8)."""

import pytest

from gateway.compensation.settings import Setpoints
from gateway.exchange.plan import AxisPlan, Late, default_late
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan, read, stream_plan, write

OTHER = bytes.fromhex("03 1000 0001")


def late_bench(plan: AxisPlan, wait_ms: float, request: bytes) -> Bench:
    """A request that waits for ``wait_ms`` behind another one, and then has its turn."""
    bench = Bench(plan, serial=False)
    bench.ask(write(COMMAND, 0))
    bench.send(OTHER)
    bench.send(request)
    bench.now_ns += int(wait_ms * MS)
    bench.link.sent.clear()
    bench.line.reply(1, bytes.fromhex("03 02 0000"), bench.now_ns)
    bench.port.replies.pop(0)
    return bench


def test_what_is_right_for_each_kind_of_setpoints_is_the_default() -> None:
    assert default_late(Setpoints.STREAM) is Late.REJECT
    assert default_late(Setpoints.TARGETS) is Late.FORWARD


def test_a_stale_setpoint_is_refused() -> None:
    bench = late_bench(stream_plan(deadline_ms=4.0, late=Late.REJECT), 4.1, write(COMMAND, 500))
    assert bench.link.sent == []
    assert bench.port.take() == bytes.fromhex("90 06")
    assert bench.line.counters.late_targets == 1
    assert bench.line.counters.refused == 1
    event = bench.events[-1]
    assert (event.kind.name, event.axis) == ("late-target", "x")
    assert event.detail == 'it waited 4.1 ms, deadline_ms = 4: refused (late = "reject")'


def test_one_in_time_is_sent() -> None:
    bench = late_bench(stream_plan(deadline_ms=4.0, late=Late.REJECT), 4.0, write(COMMAND, 500))
    assert len(bench.link.sent) == 1
    assert bench.line.counters.late_targets == 0


def test_a_move_is_sent_all_the_same_and_counted() -> None:
    bench = late_bench(axis_plan(deadline_ms=4.0, added_frames=False), 400, write(COMMAND, 500))
    assert bench.link.sent[0][1][:5] == write(COMMAND, 500)[:5]
    assert bench.line.counters.late_targets == 1
    assert (
        bench.events[-1].detail == 'it waited 400.0 ms, deadline_ms = 4: sent all the same (late = "forward")'
    )


@pytest.mark.parametrize("request_", [read(ACTUAL), OTHER, bytes.fromhex("06 1000 0001")])
def test_what_moves_nothing_is_never_late(request_: bytes) -> None:
    bench = late_bench(stream_plan(deadline_ms=4.0, late=Late.REJECT), 400, request_)
    assert bench.link.sent == [(1, request_)]
    assert bench.line.counters.late_targets == 0


def test_after_a_late_one_was_refused_the_next_setpoint_goes_on_from_where_the_drive_is() -> None:
    bench = late_bench(stream_plan(deadline_ms=4.0, late=Late.REJECT), 40, write(COMMAND, 500))
    bench.port.take()
    assert bench.ask(write(COMMAND, 600)) == write(COMMAND, 600)[:5]
    assert bench.seen[-1][:5] == write(COMMAND, 600)[:5]


def test_late_moves_are_counted_each_and_told_once_a_second() -> None:
    bench = late_bench(axis_plan(deadline_ms=4.0, added_frames=False), 10, write(COMMAND, 500))
    bench.serve()
    for _ in range(20):
        bench.send(OTHER)
        bench.send(write(COMMAND, 700))
        bench.now_ns += 100 * MS
        bench.serve()
        bench.port.replies.clear()
    assert bench.line.counters.late_targets == 21
    # 21 late ones within 2.0 s or a little more: the first, and one in each second after it
    assert bench.kinds().count("late-target") == 3
