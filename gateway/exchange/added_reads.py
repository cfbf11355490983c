"""The reads that the gateway adds of its own accord (W8), and what it learns from them.

There are three: the actual position, when nothing else tells the direction of a move or the offset in force;
the drive's command words, when a controller writes a part of a position whose rest is not known; the homed
bit, after the line came up.
"""

from dataclasses import dataclass
from enum import Enum

from gateway.exchange.access import Access
from gateway.exchange.axis import AxisExchange
from gateway.exchange.rewriting import Known, nominal_words
from gateway.exchange.unit import FieldHit, FieldRole, UnitMap
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import FunctionCode

HOMED_BIT = "homed"


class Purpose(Enum):
    """Why a register is read."""

    ACTUAL = "actual"
    COMMAND = "command"
    HOMED = "homed"


@dataclass(frozen=True, slots=True)
class AddedRead:
    """One FC03 read of ``quantity`` registers for one axis."""

    axis: AxisExchange
    purpose: Purpose
    address: int
    quantity: int
    hit: FieldHit | None = None

    @property
    def pdu(self) -> bytes:
        """The request."""
        head = bytes((FunctionCode.READ_HOLDING_REGISTERS,))
        return head + self.address.to_bytes(2, "big") + self.quantity.to_bytes(2, "big")


def next_read(unit: UnitMap, pdu: bytes, access: Access, known: Known, now_ns: int) -> AddedRead | None:
    """Return the next register that must be read before this write can be rendered, if any."""
    if not access.write_quantity or not access.is_consistent:
        return None
    for hit in unit.hits(access.write_address, access.write_quantity).fields:
        axis = hit.place.axis
        if hit.place.role is not FieldRole.COMMAND or not axis.may_read:
            continue
        read = _read_for(hit, pdu, access, known, now_ns)
        if read is not None:
            return read
    return None


def _read_for(hit: FieldHit, pdu: bytes, access: Access, known: Known, now_ns: int) -> AddedRead | None:
    place = hit.place
    axis, name = place.axis, place.axis.plan.name
    words = nominal_words(hit, pdu, access, known)
    if words is None:
        if axis.passes_unchanged or id(place.shadow) in known.command_words:
            return None
        return AddedRead(axis, Purpose.COMMAND, place.field.address, place.field.words, hit)
    if name in known.actual or not axis.needs_actual(words, place.field, now_ns):
        return None
    actual = axis.plan.actual[0]
    return AddedRead(axis, Purpose.ACTUAL, actual.address, actual.words)


def homed_read(axis: AxisExchange) -> AddedRead | None:
    """Return the read of the homed bit of an axis whose reference hangs on it."""
    bit = axis.plan.bits.get(HOMED_BIT)
    if not axis.follows_homed_bit or not axis.may_read or bit is None:
        return None
    return AddedRead(axis, Purpose.HOMED, bit.address, 1)


def learn(read: AddedRead, reply: bytes, known: Known, now_ns: int) -> bool | None:
    """Take note of the reply to an added read; a refused one is not tried again for this request.

    Returns:
        What a homed bit says when its axis's reference changed with it, else None.
    """
    axis = read.axis
    is_good = len(reply) == 2 + 2 * read.quantity and reply[0] == FunctionCode.READ_HOLDING_REGISTERS
    words = reply[2:] if is_good else None
    if read.purpose is Purpose.HOMED:
        if words is None:
            return None
        is_homed = axis.plan.bits[HOMED_BIT].is_set(words[0] << 8 | words[1])
        return is_homed if axis.set_referenced(is_homed) else None
    if read.purpose is Purpose.ACTUAL:
        if words is not None:
            axis.observe_actual(axis.plan.actual[0], words, now_ns)
        known.actual[axis.plan.name] = axis.actual if words is not None else None
        return None
    assert read.hit is not None
    known.command_words[id(read.hit.place.shadow)] = _nominal_command(read.hit, words)
    return None


def _nominal_command(hit: FieldHit, words: bytes | None) -> bytes | None:
    if words is None:
        return None
    axis = hit.place.axis
    try:
        return axis.nominal_words(hit.place.field, words, axis.compensation.readback)
    except RegisterRangeError:
        return None
