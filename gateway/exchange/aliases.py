"""Unit ids that may reach an axis under another name than its own.

A broadcast reaches every drive of a serial line. A Modbus/TCP drive may answer to 0 and 255 beside the unit
id that it was given (Messaging on TCP/IP implementation guide V1.0b, p. 23). Neither may carry a position
around the correction.
"""

from collections.abc import Iterable
from typing import Final

from gateway.exchange.access import Access
from gateway.exchange.meaning import meanings
from gateway.exchange.unit import UnitMap
from gateway.modbus.pdu import BROADCAST_UNIT_ID

ANY_TCP_DRIVE: Final = frozenset({BROADCAST_UNIT_ID, 0xFF})


def why_not_passed(
    units: Iterable[UnitMap], unit_id: int, pdu: bytes, access: Access, *, is_serial: bool
) -> str:
    """Return why a request to a unit id without axes must not pass; empty when it may."""
    if is_serial:
        if unit_id == BROADCAST_UNIT_ID and _writes_position(units, access):
            return "a broadcast cannot carry a position that each axis corrects differently"
    elif unit_id in ANY_TCP_DRIVE and (
        _writes_position(units, access) or _reads_position(units, access) or _acts(units, pdu, access)
    ):
        return f"unit id {unit_id} is not mapped, and may reach an axis that is corrected"
    return ""


def _writes_position(units: Iterable[UnitMap], access: Access) -> bool:
    return any(
        not hit.place.axis.passes_unchanged
        for unit in units
        for hit in unit.written(access.write_address, access.write_quantity).fields
    )


def _acts(units: Iterable[UnitMap], pdu: bytes, access: Access) -> bool:
    """Whether a request sets a mode or makes the drive of an axis that is corrected act. Stops may pass."""
    found = [m for unit in units if unit.has_rules for m in meanings(unit, pdu, access, may_have_risen=True)]
    return any(not m.axis.passes_unchanged and not m.is_stop for m in found)


def _reads_position(units: Iterable[UnitMap], access: Access) -> bool:
    return any(
        not hit.place.axis.passes_unchanged
        for unit in units
        for hit in unit.read(access.read_address, access.read_quantity).fields
    )
