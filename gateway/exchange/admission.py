"""Who may send what: the role of a controller, its rights, and the stops that go before everything else."""

from collections.abc import Callable

from gateway.exchange.access import only_reads
from gateway.exchange.dispatch import Units
from gateway.exchange.endings import Endings
from gateway.exchange.events import Event, EventKind
from gateway.exchange.gate import UNSEEN, Denial, Gate
from gateway.exchange.life import QUEUE_LIMIT, Exchange
from gateway.exchange.meaning import Meaning
from gateway.exchange.plan import ControllerPlan, Role
from gateway.exchange.ports import ControllerPort
from gateway.exchange.rights import UNLIMITED
from gateway.exchange.seldom import Seldom, times
from gateway.exchange.writers import Writers
from gateway.modbus.pdu import ExceptionCode


def judge(units: Units, exchange: Exchange, *, is_free: bool) -> tuple[bool, list[Meaning]]:
    """Return whether a controller's role allows a request, and what it stops as far as that matters.

    A motion controller's stop on a free line need not be told from its other requests.
    """
    assert exchange.port is not None
    role, unit_id, pdu = exchange.port.plan.role, exchange.unit_id, exchange.pdu
    if only_reads(pdu):
        return True, []
    stops: list[Meaning] = []
    if units.have_rules and not (is_free and role is Role.MOTION):
        stops = units.stops_of(unit_id, pdu)
    may_stop = role is Role.OPERATOR and bool(stops) and units.only_stops(unit_id, pdu)
    return role is Role.MOTION or may_stop, stops


class Admission:
    """The doors of one line: what is not allowed is refused here, counted, and told of seldom."""

    def __init__(
        self, units: Units, ends: Endings, writers: Writers, on_event: Callable[[Event], None]
    ) -> None:
        self._units = units
        self._ends = ends
        self._writers = writers
        self._on_event = on_event
        self._gates: dict[ControllerPlan, Gate] = {}
        self._told = Seldom()

    def lets_in(
        self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int
    ) -> bool:
        """Return whether a controller's rights allow a request; what they do not is answered."""
        gate = port.gate
        if gate is UNSEEN:
            self._writers.came(port)
            gate = port.gate = self._gate_of(port.plan)
        if gate is None:
            return True
        denial = gate.denial(unit_id, pdu)
        if denial is None and gate.is_too_often(now_ns) and not self._stops(unit_id, pdu):
            denial = gate.too_often
        if denial is None:
            return True
        exchange = Exchange(port, transaction_id, unit_id, pdu, now_ns)
        if port.plan.role is Role.MOTION:
            self._ends.note_unsent(exchange, denial.code)
        self._deny(exchange, denial, now_ns)
        return False

    def gone(self, port: ControllerPort, now_ns: int) -> None:
        """Note that a connection is gone; a serial port may come back."""
        if port.gate is not UNSEEN:
            port.gate = UNSEEN
            self._writers.gone(port, now_ns)

    def deny_role(self, exchange: Exchange, now_ns: int) -> None:
        """Refuse what the role of a controller does not allow."""
        assert exchange.port is not None
        detail = f"a request that may write, from a {exchange.port.plan.role.value}"
        if exchange.port.plan.role is Role.OPERATOR:
            detail = "a request that does more than read and stop, from an operator"
        self._deny(exchange, Denial(ExceptionCode.ILLEGAL_FUNCTION, "role", detail), now_ns)

    def deny_queue(self, exchange: Exchange, now_ns: int) -> None:
        """Refuse what has no room left to wait in."""
        self._ends.note_unsent(exchange, ExceptionCode.SERVER_DEVICE_BUSY)
        detail = f"{QUEUE_LIMIT} of its requests wait already"
        self._deny(exchange, Denial(ExceptionCode.SERVER_DEVICE_BUSY, "", detail), now_ns)

    def _deny(self, exchange: Exchange, denial: Denial, now_ns: int) -> None:
        port = exchange.port
        assert port is not None
        count = self._told.due((port.plan.name, denial.key), now_ns)
        if count:
            more = (
                ("controller", port.plan.name),
                ("peer", port.peer),
                ("function_code", exchange.pdu[0]),
                ("unit_id", exchange.unit_id),
                ("key", denial.key),
            )
            key = f" ({denial.key})" if denial.key else ""
            detail = f"{port.writer} may not do this: {denial.detail}{key}{times(count)}"
            self._on_event(Event(EventKind.REQUEST_REFUSED, None, detail, more))
        self._ends.deny(exchange, denial.code)

    def _stops(self, unit_id: int, pdu: bytes) -> bool:
        return self._units.have_rules and bool(self._units.stops_of(unit_id, pdu))

    def _gate_of(self, plan: ControllerPlan) -> Gate | None:
        """Return what all connections of a controller share, so that they share its rate."""
        if plan.rights == UNLIMITED:
            return None
        gate = self._gates.get(plan)
        if gate is None:
            gate = self._gates[plan] = Gate(plan.rights, self._units.broadcast_unit_ids)
        return gate
