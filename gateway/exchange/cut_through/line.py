"""What the line does for a request under cut-through, which occupies the line from its first byte on."""

from collections.abc import Callable

from gateway.exchange.axis.acknowledge import SteadyTarget
from gateway.exchange.cut_through.requests import leave_on
from gateway.exchange.line_context import LineContext
from gateway.exchange.ports import ControllerPort
from gateway.exchange.transaction import FastPath, Step, Transaction


class ForwardingLine:
    """What the line does for a request under cut-through.

    ``go_on`` makes the line start what waits.
    """

    def __init__(self, context: LineContext, go_on: Callable[[int], None]) -> None:
        self._response_timeout_ns = context.response_timeout_ns
        self._link = context.link
        self._waiting = context.waiting
        self._transactions = context.transactions
        self._scheduler = context.scheduler
        self._silent_units = context.silent_units
        self._link_state = context.link_state
        self._rest = context.rest
        self._tap = context.tap
        self._go_on = go_on

    def may_forward(self, port: ControllerPort, now_ns: int) -> bool:
        """Whether a request of a port may be forwarded now: if complete, it would be sent immediately."""
        if self._transactions.current is not None or self._rest.until_ns is not None:
            return False
        if not self._link_state.is_up or self._link_state.is_stopping:
            return False
        if self._silent_units.silences or not self._waiting.only_others:
            return False
        return port.is_motion and port.gate is None and self._link.may_forward(now_ns)

    def begin(self, port: ControllerPort, expected: bytes, now_ns: int) -> Transaction | None:
        """Begin to forward a request that is expected to be this one: unit id and PDU.

        Requests that come meanwhile wait, as behind one that was sent (W6).
        """
        if self._scheduler.gaps.is_watching:
            self._scheduler.motion_came(now_ns)
        transaction = Transaction(port, 0, expected[0], expected[1:], now_ns)
        return transaction if self._transactions.begin(transaction) else None

    def forward(self, transaction: Transaction, piece: bytes, now_ns: int) -> None:
        """Send bytes that do not complete it."""
        unit_id = transaction.unit_id
        self._transactions.send(transaction, Step.PIECE, unit_id, b"", now_ns, piece=piece)

    def commit(
        self, transaction: Transaction, path: FastPath, pdu: bytes, target: SteadyTarget | None, now_ns: int
    ) -> bytes | None:
        """The request has come in completely: let its rest be sent on its fast path; see ``RequestJudge``."""
        port = transaction.port
        assert port is not None
        self._transactions.come_whole(transaction, port, pdu, now_ns)
        sent_pdu = leave_on(path, transaction, target, now_ns)
        if sent_pdu is not None:
            if self._tap is not None:  # recorded as a stored request would be
                self._tap.request(port, transaction.transaction_id, transaction.unit_id, pdu, now_ns)
            transaction.path = path
        return sent_pdu

    def forward_last(self, transaction: Transaction, pdu: bytes, piece: bytes, now_ns: int) -> None:
        """Send its last bytes; ``pdu``: the complete request as it was sent."""
        path, port, unit_id = transaction.path, transaction.port, transaction.unit_id
        assert path is not None
        assert port is not None
        patience_ns = max(self._response_timeout_ns, port.patience_ns)
        self._transactions.send(
            transaction, Step.LAST_PIECE, unit_id, pdu, now_ns, patience_ns=patience_ns, piece=piece
        )
        if transaction.target is not None:
            path.left(transaction)

    def aborted(self, transaction: Transaction, until_ns: int, now_ns: int) -> None:
        """A request was aborted: nothing is sent before the silence behind it is over.

        If all of it comes, it is handled after that silence like any other request.
        """
        if self._transactions.current is transaction:
            self._transactions.free_wire()
        self._transactions.never_left(transaction, now_ns)
        self._rest.hold_after_abort(until_ns)
        self._scheduler.gaps.ended(transaction, now_ns, until_ns)
        self._go_on(now_ns)
