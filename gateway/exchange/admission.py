"""Who may send what: the role of a controller, and the stops that go before everything else."""

from gateway.exchange.access import only_reads
from gateway.exchange.dispatch import Units
from gateway.exchange.life import Exchange
from gateway.exchange.meaning import Meaning
from gateway.exchange.plan import Role


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
