"""Requests that wait for too long: refused, answered, or sent late and counted (DESIGN 8, W7)."""

from pathlib import Path
from typing import Final

import pytest

from gateway.compensation.settings import Setpoints
from gateway.exchange.plan import AxisPlan, ControllerPlan, Late, default_late
from gateway.exchange.transaction import Transaction
from gateway.times import NEVER_NS
from tests.exchange.connection_bench import ConnectionBench
from tests.exchange.connection_bench import controller as tcp_controller
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Port, axis_plan, read, stream_plan, write
from tests.exchange.silent_bench import controller, line, two_axes
from tests.exchange.staged_bench import STAGED
from tests.exchange.staged_bench import STOP_PDU as STOP

# === targets that wait longer than their axis allows =====================================================

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


def test_the_default_of_late_fits_each_kind_of_setpoints() -> None:
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


def test_a_setpoint_in_time_is_sent() -> None:
    bench = late_bench(stream_plan(deadline_ms=4.0, late=Late.REJECT), 4.0, write(COMMAND, 500))
    assert len(bench.link.sent) == 1
    assert bench.line.counters.late_targets == 0


def test_a_late_move_is_sent_nevertheless_and_counted() -> None:
    bench = late_bench(axis_plan(deadline_ms=4.0, added_frames=False), 400, write(COMMAND, 500))
    assert bench.link.sent[0][1][:5] == write(COMMAND, 500)[:5]
    assert bench.line.counters.late_targets == 1
    assert (
        bench.events[-1].detail == 'it waited 400.0 ms, deadline_ms = 4: sent all the same (late = "forward")'
    )


@pytest.mark.parametrize("request_", [read(ACTUAL), OTHER, bytes.fromhex("06 1000 0001")])
def test_a_request_that_moves_nothing_is_never_late(request_: bytes) -> None:
    bench = late_bench(stream_plan(deadline_ms=4.0, late=Late.REJECT), 400, request_)
    assert bench.link.sent == [(1, request_)]
    assert bench.line.counters.late_targets == 0


def test_after_a_refused_late_setpoint_the_next_one_is_sent() -> None:
    bench = late_bench(stream_plan(deadline_ms=4.0, late=Late.REJECT), 40, write(COMMAND, 500))
    bench.port.take()
    assert bench.ask(write(COMMAND, 600)) == write(COMMAND, 600)[:5]
    assert bench.seen[-1][:5] == write(COMMAND, 600)[:5]


def test_each_late_move_is_counted_and_one_a_second_is_reported() -> None:
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


# === requests that wait longer than half of the timeout_ms of their controller ===========================

READ: Final = bytes.fromhex("03 0700 0001")
WRITE: Final = bytes.fromhex("06 0700 0001")
PAGE: Final = Path(__file__).parents[2] / "docs" / "wire-rules.md"
ROWS: Final = (
    "the silence of its own unit id (W6)",
    "a connection that is down, or must rest",
    "writes that are held behind a renewal",
    "a second read of the actual position (W8)",
    "a dead drive of another shape (W11)",
)


def test_a_request_is_sent_only_while_half_of_its_controllers_time_out_is_left() -> None:
    port = Port(ControllerPlan("plc", timeout_ms=1000.0))
    assert Transaction(port, 1, 1, READ, 7 * MS).leave_by_ns == 507 * MS


def test_a_read_of_the_gateway_itself_may_be_sent_at_any_time() -> None:
    assert Transaction(None, 0, 1, READ, 7 * MS).leave_by_ns == NEVER_NS


def test_the_page_has_each_wait_once() -> None:
    part = PAGE.read_text().split("## Too late to send", maxsplit=1)[1].split("\n## ")[0]
    cells = [row.split("|")[1].strip() for row in part.splitlines() if row.startswith("| ")]
    assert tuple(cells[1:]) == ROWS


@pytest.mark.parametrize(("timeout_ms", "leaves"), [(102.0, True), (98.0, False)])
@pytest.mark.parametrize("pdu", [READ, WRITE])
def test_too_late_after_the_silence_of_its_own_unit_id(
    timeout_ms: float, pdu: bytes, *, leaves: bool
) -> None:
    """50 ms of silence: half of 102 ms is behind its end, half of 98 ms is not."""
    bench = line(*two_axes())
    bench.missed(READ, 100, unit_id=2)
    plc = controller("plc2", timeout_ms=timeout_ms)
    bench.send(pdu, plc, unit_id=2)
    assert [reply for _, _, reply in plc.replies] == ([] if leaves else [bytes((pdu[0] | 0x80, 0x0B))])
    bench.wait(50)
    assert bench.link.sent == ([(2, pdu)] if leaves else [])


@pytest.mark.parametrize(("after_ms", "leaves"), [(499, True), (501, False)])
def test_too_late_after_a_connection_that_was_down(after_ms: float, *, leaves: bool) -> None:
    bench = ConnectionBench(axis_plan())
    bench.breaks()
    plc = tcp_controller(timeout_ms=1000.0)
    bench.send(WRITE, plc)
    bench.returns_and_serves(after_ms)
    bench.until(30)
    assert (WRITE in bench.seen) is leaves
    assert plc.take() == (WRITE if leaves else bytes.fromhex("86 0A"))


@pytest.mark.parametrize(("after_ms", "leaves"), [(999, True), (1001, False)])
def test_a_stop_waits_for_a_connection_as_long_as_its_controller(after_ms: float, *, leaves: bool) -> None:
    bench = ConnectionBench(axis_plan(motion=STAGED))
    bench.breaks()
    plc = tcp_controller(timeout_ms=1000.0)
    bench.send(STOP, plc)
    bench.returns_and_serves(after_ms)
    bench.until(100)
    assert (STOP in bench.seen) is leaves
    assert plc.take() == (STOP if leaves else bytes.fromhex("86 0A"))


def test_too_late_while_writes_are_held() -> None:
    bench = ConnectionBench(axis_plan(), retry_ms=0.0)
    slow = tcp_controller("cnc", timeout_ms=200.0)
    while not bench.connection.renewed:
        bench.send(WRITE, slow)
        bench.link.sent.clear()
        bench.until(250)
    bench.returns(20, 201)
    bench.link.sent.clear()
    plc = tcp_controller(timeout_ms=1000.0)
    bench.send(WRITE, plc)
    bench.until(499)
    assert plc.replies == []
    bench.until(301)  # as soon as the named read is given up that is on the wire
    assert plc.take() == bytes.fromhex("86 0A")
    assert (1, WRITE) not in bench.link.sent
