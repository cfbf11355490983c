"""The reads that the gateway adds of its own accord (W8), and what it learns from them.

There are three: the actual position, when nothing else tells the direction of a move or the offset in force;
the drive's command words, when a controller writes a part of a position whose rest is not known; the homed
bit, when the line came up, after a silence, and before a target when it was last seen a while ago.
"""

from dataclasses import dataclass
from enum import Enum

from gateway.exchange.access import Access
from gateway.exchange.axis import AxisExchange
from gateway.exchange.parts import Known, nominal_words
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
    """Return the next register that must be read before this request can be sent, if any."""
    written = unit.hits(access.write_address, access.write_quantity).fields if access.write_quantity else ()
    read = unit.hits(access.read_address, access.read_quantity).fields if access.read_quantity else ()
    for hit in (*written, *read):
        axis = hit.place.axis
        is_target = hit.place.role is FieldRole.COMMAND and bool(access.write_quantity)
        if axis.plan.name not in known.references and axis.needs_reference(now_ns, is_target=is_target):
            added = homed_read(axis)
            if added is not None:
                return added
    if not access.is_consistent:
        return None
    for hit in written:
        if hit.place.role is FieldRole.COMMAND and hit.place.axis.may_read:
            added = _read_for(hit, pdu, access, known, now_ns)
            if added is not None:
                return added
    return None


def _read_for(hit: FieldHit, pdu: bytes, access: Access, known: Known, now_ns: int) -> AddedRead | None:
    place = hit.place
    axis, shadow, name = place.axis, place.shadow, place.axis.plan.name
    assert shadow is not None
    words = nominal_words(hit, pdu, access, known, now_ns)
    if words is None:
        if axis.passes_unchanged or shadow.is_torn or access.is_mask or id(shadow) in known.command_words:
            return None
        return AddedRead(axis, Purpose.COMMAND, place.field.address, place.field.words, hit)
    if name in known.actual or not axis.needs_actual(words, shadow, place.field, now_ns):
        return None
    actual = axis.plan.actual[0]
    return AddedRead(axis, Purpose.ACTUAL, actual.address, actual.words)


def homed_read(axis: AxisExchange) -> AddedRead | None:
    """Return the read of the homed bit of an axis whose reference hangs on it."""
    bit = axis.plan.bits.get(HOMED_BIT)
    if not axis.reference.follows_bit or not axis.may_read or bit is None:
        return None
    return AddedRead(axis, Purpose.HOMED, bit.address, 1)


def learn(read: AddedRead, reply: bytes, known: Known, now_ns: int) -> bool | None:
    """Take note of the reply to an added read; a refused one is not tried again for this request.

    A drive that will not tell whether it is homed is taken as not homed.

    Returns:
        What a homed bit says when its axis's reference changed with it, else None.
    """
    axis = read.axis
    is_good = len(reply) == 2 + 2 * read.quantity and reply[0] == FunctionCode.READ_HOLDING_REGISTERS
    words = reply[2:] if is_good else None
    if read.purpose is Purpose.HOMED:
        known.references.add(axis.plan.name)
        is_homed = words is not None and axis.plan.bits[HOMED_BIT].is_set(words[0] << 8 | words[1])
        return is_homed if axis.see_homed_bit(now_ns, is_set=is_homed) else None
    if read.purpose is Purpose.ACTUAL:
        field_ = axis.plan.actual[0]
        known.actual[axis.plan.name] = None if words is None else axis.observe_actual(field_, words, now_ns)
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
