"""How long a request that was held up may still leave: one limit for every such wait."""

from gateway.exchange.plan import ControllerPlan
from gateway.exchange.transaction import NEVER_NS, Transaction
from tests.exchange.line_bench import MS, Port


def test_a_request_that_was_held_up_leaves_while_half_of_its_controllers_time_out_is_left() -> None:
    port = Port(ControllerPlan("plc", timeout_ms=1000.0))
    assert Transaction(port, 1, 1, bytes.fromhex("03 0000 0001"), 7 * MS).leave_by_ns == 507 * MS


def test_a_read_of_the_gateway_itself_has_no_such_limit() -> None:
    assert Transaction(None, 0, 1, bytes.fromhex("03 0000 0001"), 7 * MS).leave_by_ns == NEVER_NS
