"""One request on its way to one unit: all that is known about it before it is sent."""

from typing import NamedTuple

from gateway.exchange.access import Access
from gateway.exchange.known import Known
from gateway.exchange.meaning import Meaning
from gateway.exchange.unit import UnitMap


class Request(NamedTuple):
    """A request, the registers that it touches, and what it means for each axis of the unit."""

    unit: UnitMap
    pdu: bytes
    access: Access
    meanings: list[Meaning]
    known: Known
    now_ns: int
    arrived_ns: int
    """When it came from its controller; no two requests of a line came at the same instant."""
