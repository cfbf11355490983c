"""Too late to send: one limit for each wait that a controller cannot know of, half of its ``timeout_ms``.

The table is on the page of rules; here each row of it is played, a millisecond before and behind the limit.
"""

from pathlib import Path
from typing import Final

import pytest

from gateway.exchange.plan import ControllerPlan
from gateway.exchange.transaction import NEVER_NS, Transaction
from tests.exchange.connection_bench import ConnectionBench
from tests.exchange.connection_bench import controller as tcp_controller
from tests.exchange.line_bench import MS, Port, axis_plan
from tests.exchange.silent_bench import controller, line, two_axes
from tests.exchange.staged_bench import STAGED
from tests.exchange.staged_bench import STOP_PDU as STOP

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


def test_a_request_that_was_held_up_leaves_while_half_of_its_controllers_time_out_is_left() -> None:
    port = Port(ControllerPlan("plc", timeout_ms=1000.0))
    assert Transaction(port, 1, 1, READ, 7 * MS).leave_by_ns == 507 * MS


def test_a_read_of_the_gateway_itself_has_no_such_limit() -> None:
    assert Transaction(None, 0, 1, READ, 7 * MS).leave_by_ns == NEVER_NS


def test_the_page_has_each_wait_once() -> None:
    part = PAGE.read_text().split("## Too late to send", maxsplit=1)[1].split("\n## ")[0]
    cells = [row.split("|")[1].strip() for row in part.splitlines() if row.startswith("| ")]
    assert tuple(cells[1:]) == ROWS


@pytest.mark.parametrize(("timeout_ms", "leaves"), [(102.0, True), (98.0, False)])
@pytest.mark.parametrize("pdu", [READ, WRITE])
def test_behind_the_silence_of_its_own_unit(timeout_ms: float, pdu: bytes, *, leaves: bool) -> None:
    """50 ms of silence: half of 102 ms is behind its end, half of 98 ms is not."""
    bench = line(*two_axes())
    bench.missed(READ, 100, unit_id=2)
    plc = controller("plc2", timeout_ms=timeout_ms)
    bench.send(pdu, plc, unit_id=2)
    assert [reply for _, _, reply in plc.replies] == ([] if leaves else [bytes((pdu[0] | 0x80, 0x0B))])
    bench.wait(50)
    assert bench.link.sent == ([(2, pdu)] if leaves else [])


@pytest.mark.parametrize(("after_ms", "leaves"), [(499, True), (501, False)])
def test_where_the_connection_is_down(after_ms: float, *, leaves: bool) -> None:
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


def test_where_writes_are_held() -> None:
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
