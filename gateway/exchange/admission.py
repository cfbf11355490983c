"""Who may send what: a controller's role, its rights, and the stops that go before everything else."""

from collections.abc import Callable
from typing import Final

from gateway.catalogue import exchange_events
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.registers import Loss
from gateway.exchange.decode import AxisCommand
from gateway.exchange.dispatch import UnitMaps
from gateway.exchange.events import Event
from gateway.exchange.gate import UNSEEN, Denial, Gate
from gateway.exchange.ownership import Ownership
from gateway.exchange.plan import ControllerPlan, Role
from gateway.exchange.ports import ControllerPort
from gateway.exchange.queue import WAITING_BYTES
from gateway.exchange.rights import UNLIMITED
from gateway.exchange.transaction import Answer, Transaction, Transactions
from gateway.limits import Reports, others_of_pairs, times
from gateway.modbus.pdu import ExceptionCode

NO_ROOM: Final = Denial(
    ExceptionCode.SERVER_DEVICE_BUSY, "", f"{WAITING_BYTES >> 10} KiB of requests of its host wait already"
)
"""The refusal of a request for which there is no room to wait."""


def judge(units: UnitMaps, transaction: Transaction, *, is_free: bool) -> tuple[bool, list[AxisCommand]]:
    """Return whether a controller's role allows a request, and the stops in it, if they matter.

    On a free line the stops of a motion controller do not matter: they are sent like its other requests.
    """
    assert transaction.port is not None
    role = transaction.port.plan.role
    if transaction.only_reads:
        return True, []
    stops: list[AxisCommand] = []
    if units.have_rules and not (is_free and role is Role.MOTION):
        stops = units.stops_of(units.frames_of(transaction))
    may_stop = role is Role.OPERATOR and bool(stops) and units.only_stops(units.frames_of(transaction))
    return role is Role.MOTION or may_stop, stops


def role_denial(role: Role) -> Denial:
    """Return why a role does not allow a request."""
    detail = f"a request that may write, from a {role.value}"
    if role is Role.OPERATOR:
        detail = "a request that does more than read and stop, from an operator"
    return Denial(ExceptionCode.ILLEGAL_FUNCTION, "role", detail)


class Admission:
    """Access control of one line: refuses and counts forbidden requests; its reports are rate-limited."""

    def __init__(
        self,
        units: UnitMaps,
        transactions: Transactions,
        ownership: Ownership,
        on_event: Callable[[Event], None],
    ) -> None:
        self._units = units
        self._transactions = transactions
        self._ownership = ownership
        self._on_event = on_event
        self._gates: dict[ControllerPlan, Gate] = {}
        self._reports: Reports[tuple[str, str]] = Reports(others=others_of_pairs)

    def denial(self, transaction: Transaction, now_ns: int) -> Denial | None:
        """Return why the rights of its controller forbid an arriving request; None: they allow it."""
        port = transaction.port
        assert port is not None
        gate = port.gate
        if gate is UNSEEN:
            self._ownership.came(port)
            gate = port.gate = self._gate_of(port.plan)
        if gate is None:
            return None
        denial = gate.denial(transaction.unit_id, transaction.pdu, is_odd=transaction.is_odd)
        if denial is None and gate.is_too_often(now_ns):
            units = self._units
            is_stop = units.have_rules and units.stops_of(units.frames_of(transaction))
            denial = None if is_stop else gate.too_often
        return denial

    def denial_of_waiting(self, transaction: Transaction) -> Denial:
        """Return why a request is refused that was denied on arrival and then waited for its turn."""
        port = transaction.port
        assert port is not None
        gate = port.gate
        denial = None
        if gate is not None:
            denial = gate.denial(transaction.unit_id, transaction.pdu, is_odd=transaction.is_odd)
        if denial is None:
            denial = NO_ROOM if port.is_motion or transaction.only_reads else role_denial(port.plan.role)
        return denial

    def gone(self, port: ControllerPort, now_ns: int, *, is_broken: bool) -> None:
        """Record that a connection is gone; a serial port may come back."""
        if port.gate is not UNSEEN:
            port.gate = UNSEEN
            self._ownership.gone(port, now_ns, is_broken=is_broken)

    def report(self, transaction: Transaction, denial: Denial, now_ns: int) -> None:
        """Report a forbidden request, and the number of similar ones."""
        port = transaction.port
        assert port is not None
        count = self._reports.due((port.plan.name, denial.key), now_ns)
        if not count:
            return
        more = (
            ("controller", port.plan.name),
            ("peer", port.peer),
            ("function_code", transaction.pdu[0]),
            ("unit_id", transaction.unit_id),
            ("key", denial.key),
        )
        key = f" ({denial.key})" if denial.key else ""
        detail = f"{port.writer} was refused: {denial.detail}{key}{times(count)}"
        self._on_event(Event(exchange_events.REQUEST_REFUSED, None, detail, more))

    def refuse(self, transaction: Transaction, denial: Denial, now_ns: int) -> None:
        """Answer a forbidden request. It is a loss (M3) only for a motion controller."""
        self._transactions.finish(
            transaction,
            Outcome.NEVER_SENT,
            now_ns,
            code=denial.code,
            answer=Answer.DENIAL,
            loss=Loss.DENIED if transaction.is_motion else None,
        )

    def _gate_of(self, plan: ControllerPlan) -> Gate | None:
        """Return the gate that all connections of a controller share, and so its rate."""
        if plan.rights == UNLIMITED:
            return None
        gate = self._gates.get(plan)
        if gate is None:
            gate = self._gates[plan] = Gate(plan.rights, self._units.broadcast_unit_ids)
        return gate
