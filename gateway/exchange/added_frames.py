"""The frames that the gateway adds itself (W8), and what it learns from their replies.

The gateway adds these reads:

- the actual position, if nothing else gives the direction of a move or the offset in force;
- the drive's command words, if a controller writes a part of a position and the rest is unknown;
- the homed bit;
- a mode register that decides what a target means;
- the start of a relative move, and whether the axis is at standstill there;
- any register of a drive that did not answer, before a request that may move it (W11);
- at the start, the position of an axis with a record of the last run.

It adds one kind of write: a staged target again, corrected for its trigger (M2).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

from gateway.drives.motion import Form
from gateway.exchange.access import MEI_HEAD, swapped
from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import Actual
from gateway.exchange.axis.reach import PositionAnswer
from gateway.exchange.field_counts import counts_of
from gateway.exchange.plan import DONE_BIT, MOVING_BIT
from gateway.exchange.reply import nominal_position
from gateway.exchange.request import Prefetched, Standstill
from gateway.exchange.unit import FieldHit
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import (
    MEI_CANOPEN_GENERAL_REFERENCE,
    ExceptionCode,
    FunctionCode,
    is_absence,
    is_exception,
)
from gateway.modbus.registers import BitField, BitTable, PositionField

_FUNCTIONS: Final = {
    Form.FC03: FunctionCode.READ_HOLDING_REGISTERS,
    Form.FC04: FunctionCode.READ_INPUT_REGISTERS,
    Form.FC06: FunctionCode.WRITE_SINGLE_REGISTER,
    Form.FC16: FunctionCode.WRITE_MULTIPLE_REGISTERS,
    Form.MEI: FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT,
}


class Purpose(Enum):
    """Why a frame is added."""

    ACTUAL = "actual"
    POLL = "look"
    """Read the actual position, to check whether an axis that was unseen for a while is still at its
    target."""
    COMMANDED = "commanded"
    COMMAND = "command"
    KEPT = "kept"
    """Read a command field before a trigger, to check whether the drive still holds the target from before
    its connection was closed."""
    HOMED = "homed"
    STANDSTILL = "standing"
    RULE = "rule"
    REWRITE = "restage"
    TRIAL = "trial"
    """Read any register of a drive that does not answer, to check whether it answers again."""


_REPEATED: Final = frozenset({Purpose.ACTUAL, Purpose.POLL, Purpose.HOMED, Purpose.RULE})
"""Reads that are repeated once: they decide what a request does, where its target goes, and whether it is
corrected."""
_NEEDED: Final = frozenset({Purpose.HOMED, Purpose.RULE})
"""Reads without which the gateway would have to guess what a request does."""
LATER: Final = frozenset(
    {
        ExceptionCode.ACKNOWLEDGE,
        ExceptionCode.SERVER_DEVICE_BUSY,
        ExceptionCode.MEMORY_PARITY_ERROR,  # some drives answer a frame with a wrong check sum with it
    }
)
"""Exceptions which mean that the same read may succeed later."""
POLLS: Final = 2
"""Number of position reads at the start that decide whether an axis went to its last target."""
_WRITABLE: Final = frozenset({Purpose.COMMAND, Purpose.KEPT, Purpose.RULE})


@dataclass(frozen=True, slots=True)
class AddedFrame:
    """One read of ``quantity`` registers for one axis, or one write of ``words``."""

    axis: Axis
    purpose: Purpose
    address: int
    quantity: int
    hit: FieldHit | None = None
    bit: BitField | None = None
    words: bytes = b""
    rendering: Rendering | None = None
    """Of the staged target that is written again."""
    is_for_distance: bool = False
    """A poll before a relative move: a position on the way is no base for one."""
    epoch: int = 0
    """Epoch of its field when the frame was made."""
    is_again: bool = False
    """A refused read that is repeated although no request needs it."""

    @property
    def pdu(self) -> bytes:
        """The request."""
        if self.bit is not None and self.bit.table is not BitTable.REGISTER:
            is_coil = self.bit.table is BitTable.COIL
            code = FunctionCode.READ_COILS if is_coil else FunctionCode.READ_DISCRETE_INPUTS
            return bytes((code,)) + self.address.to_bytes(2, "big") + b"\x00\x01"
        form = self._form
        head = bytes((_FUNCTIONS[form],))
        if form is Form.MEI:
            return _general_reference(self.address, self.quantity, self.words)
        head += self.address.to_bytes(2, "big")
        if form is Form.FC06:
            return head + self.words
        head += self.quantity.to_bytes(2, "big")
        return head + bytes((len(self.words),)) + self.words if self.words else head

    @property
    def _form(self) -> Form:
        plan = self.axis.plan
        if self.words:
            return plan.writes_with
        if self.purpose in _WRITABLE and plan.reads_with is Form.FC04:
            return Form.FC03  # what can be written is in holding registers
        return plan.reads_with

    def words_of(self, reply: bytes) -> bytes | None:
        """Return the words in a reply; None: it has none."""
        sent = self.pdu
        if sent[0] == FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT:
            is_good = reply[:8] == sent[:8] and len(reply) > MEI_HEAD and len(reply) == MEI_HEAD + reply[11]
            return swapped(reply[MEI_HEAD:]) if is_good else None
        if sent[0] in (FunctionCode.READ_COILS, FunctionCode.READ_DISCRETE_INPUTS):
            is_good = len(reply) == 3 and reply[0] == sent[0] and reply[1] == 1
            return bytes((0, reply[2] & 1)) if is_good else None
        is_good = len(reply) == 2 + 2 * self.quantity and reply[0] == sent[0]
        return reply[2:] if is_good else None

    def is_acknowledged(self, reply: bytes) -> bool:
        """Whether a reply is the complete normal reply to the write."""
        sent = self.pdu
        if sent[0] == FunctionCode.WRITE_MULTIPLE_REGISTERS:
            return reply == sent[:5]
        if sent[0] == FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT:
            return reply[:8] == sent[:8]
        return reply == sent


def _general_reference(index: int, quantity: int, words: bytes) -> bytes:
    data = swapped(words)
    count = len(data) if words else 2 * quantity
    head = bytes((FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT, MEI_CANOPEN_GENERAL_REFERENCE, bool(words)))
    return head + bytes(2) + index.to_bytes(2, "big") + bytes(4) + bytes((count,)) + data


def read_field(
    axis: Axis, purpose: Purpose, field: PositionField, *, is_for_distance: bool = False
) -> AddedFrame:
    """Return the read of a complete position."""
    return AddedFrame(axis, purpose, field.address, field.words, is_for_distance=is_for_distance)


def once_more(read: AddedFrame) -> AddedFrame:
    """Return the same read again, for no request."""
    return AddedFrame(read.axis, read.purpose, read.address, read.quantity, bit=read.bit, is_again=True)


def read_word(axis: Axis, address: int) -> AddedFrame:
    """Return the read of a mode or trigger register."""
    return AddedFrame(axis, Purpose.RULE, address, 1)


def read_bit(axis: Axis, purpose: Purpose, bit: BitField) -> AddedFrame:
    """Return the read of a status bit."""
    return AddedFrame(axis, purpose, bit.address, 1, bit=bit)


def homed_read(axis: Axis) -> AddedFrame | None:
    """Return the read of the bit on which the reference of an axis depends now."""
    bit = axis.plan.bits.get(axis.reference.bit)
    is_needed = axis.reference.follows_homed_bit or axis.reference.is_homing
    if not is_needed or not axis.reach.may_read or bit is None:
        return None
    return read_bit(axis, Purpose.HOMED, bit)


def trial_read(axes: Sequence[Axis], number: int = 0) -> AddedFrame | None:
    """Return a read that shows whether the drive of some axes is back; None: none is allowed.

    ``number``: of trials that a converter answered so far. Each trial reads another register, because a drive
    may itself refuse one register with the code of a converter.
    """
    reads = list({read.pdu: read for read in _trial_reads(axes)}.values())
    return reads[number % len(reads)] if reads else None


def _trial_reads(axes: Sequence[Axis]) -> Iterator[AddedFrame]:
    for axis in axes:
        if not axis.reach.may_read:
            continue
        plan = axis.plan
        for field in (axis.reach.asked_actual, axis.reach.asked_commanded):
            if field is not None:
                yield read_field(axis, Purpose.TRIAL, field)
        for bit in plan.bits.values():
            yield read_bit(axis, Purpose.TRIAL, bit)
        for field in plan.command:
            if field.is_readable and plan.reads_with is not Form.FC04:
                yield read_field(axis, Purpose.TRIAL, field)


def reads_at_start(axes: Sequence[Axis]) -> list[AddedFrame]:
    """Return what is read when the line comes up: homed bits, then the positions of axes with a record."""
    reads: list[AddedFrame | None] = []
    for axis in axes:
        if axis.recall.record is not None:
            axis.recall.record.go_on()
        reads.append(homed_read(axis))
    for axis in axes:
        actual = axis.reach.asked_actual
        if axis.recall.is_open and actual is not None:
            reads.append(read_field(axis, Purpose.ACTUAL, actual))
    return [read for read in reads if read is not None]


def next_poll(read: AddedFrame, now_ns: int) -> AddedFrame | None:
    """Return the next read at the start, until it is known whether an axis went to its last target.

    A drive that may still be moving is polled. Otherwise its status bit and its position are read, at most
    twice. After that the replies to later requests must show it.
    """
    axis, record = read.axis, read.axis.recall.record
    actual = axis.reach.asked_actual
    if record is None or actual is None or read.purpose not in (Purpose.ACTUAL, Purpose.STANDSTILL):
        return None
    if record.wants_poll:
        return read
    if record.polls > POLLS or not axis.motion.polls_needed(now_ns):
        return None
    record.count_poll()
    bit = standstill_bit(axis) if record.polls == 1 else None
    return read_field(axis, Purpose.ACTUAL, actual) if bit is None else bit


def standstill_bit(axis: Axis) -> AddedFrame | None:
    """Return the read of the bit that shows whether an axis is at standstill, if it has one."""
    bits = axis.plan.bits
    for name in (DONE_BIT, MOVING_BIT):
        if name in bits:
            return read_bit(axis, Purpose.STANDSTILL, bits[name])
    return None


def next_rewrite(axis: Axis, rendering: Rendering) -> AddedFrame | None:
    """Return the next write that brings the drive's words in line with a rendering, if any (M2)."""
    addresses = addresses_to_rewrite(axis, rendering)
    if not addresses:
        return None
    address, corrected_words = addresses[0], rendering.corrected_words
    if axis.plan.writes_with is not Form.FC06:
        return _rewrite_frame(axis, rendering, address, corrected_words)
    start = 2 * (address - axis.plan.command[rendering.number].address)
    return _rewrite_frame(axis, rendering, address, corrected_words[start : start + 2])


def addresses_to_rewrite(axis: Axis, rendering: Rendering) -> list[int]:
    """Return the registers that must be written so that the drive holds the words of a rendering."""
    image, corrected_words = axis.fields[rendering.number], rendering.corrected_words
    if image.holds(0, corrected_words):
        return []
    field = axis.plan.command[rendering.number]
    if axis.plan.writes_with is not Form.FC06:
        return list(range(field.address, field.end))
    return [
        field.address + word
        for word in range(field.words)
        if not image.holds(word, corrected_words[2 * word : 2 * word + 2])
    ]


def _rewrite_frame(axis: Axis, rendering: Rendering, address: int, words: bytes) -> AddedFrame:
    return AddedFrame(
        axis,
        Purpose.REWRITE,
        address,
        len(words) // 2,
        words=words,
        rendering=rendering,
        epoch=axis.fields[rendering.number].epoch,
    )


def acknowledge_rewritten(frame: AddedFrame) -> None:
    """Record an acknowledged write of a staged target."""
    rendering = frame.rendering
    assert rendering is not None
    number = rendering.number
    first = frame.address - frame.axis.plan.command[number].address
    frame.axis.fields[number].acknowledge_rewrite(rendering.nominal_words, first, frame.words, frame.epoch)


def is_asked_again(read: AddedFrame, reply: bytes, prefetched: Prefetched) -> bool:
    """Whether a refused read may succeed if it is repeated (W8).

    If the drive is busy, or was not reached, the read is repeated once for each request. A position is also
    read again after any other exception, until the drive has refused twice in a row (``READABILITY_AFTER``).
    """
    if read.purpose not in _REPEATED or not is_exception(reply):
        return False
    axis, key = read.axis, (read.axis.plan.name, read.address)
    is_first = not read.is_again and key not in prefetched.refused
    prefetched.refused.add(key)
    if _may_come(read, reply) or is_absence(reply):
        return is_first
    if read.purpose in _NEEDED:
        return False
    axis.reach.update_readability(PositionAnswer.REFUSAL)
    return is_first and not axis.reach.is_unreadable


def is_open(read: AddedFrame, reply: bytes) -> bool:
    """Whether a read was refused in a way that shows nothing: its request is refused with the same code.

    A drive that is busy, or got a damaged frame, says nothing about its homed bit or its mode. A position is
    not needed that much: without it the target is sent and flagged.
    """
    may_come = is_exception(reply) and _may_come(read, reply)
    return is_absence(reply) or (may_come and read.purpose in _NEEDED)


def _may_come(read: AddedFrame, reply: bytes) -> bool:
    """Whether a read that was answered with an exception may succeed later.

    Oriental drives answer with device failure while they are busy. Others always refuse a register so: it
    counts only for a homed bit that was seen before.
    """
    if reply[-1] == ExceptionCode.SERVER_DEVICE_FAILURE:
        return read.purpose is Purpose.HOMED and read.axis.reference.bit_seen_ns > 0
    return reply[-1] in LATER


def learn(read: AddedFrame, reply: bytes, prefetched: Prefetched, asked_ns: int) -> None:
    """Apply the reply to an added read: it shows the state at the time of the read.

    A refused read is not repeated for this request, except by :func:`is_asked_again`.

    A drive that refuses to report whether it is homed counts as not homed, except by :func:`is_open`.
    """
    if read.purpose is Purpose.TRIAL:
        return  # only the arrival of the reply counts
    axis, name, words = read.axis, read.axis.plan.name, read.words_of(reply)
    if read.purpose is Purpose.HOMED:
        prefetched.references.add(name)
        assert read.bit is not None
        axis.observe_bit(
            axis.reference.bit, asked_ns, is_set=words is not None and read.bit.is_set(_word(words))
        )
    elif read.purpose in (Purpose.ACTUAL, Purpose.POLL):
        field = axis.plan.actual[0]
        prefetched.polls[name] = prefetched.polls.get(name, 0) + 1
        if words is not None:
            axis.reach.update_readability(PositionAnswer.POSITION)
        prefetched.actual[name] = None if words is None else axis.observe_actual(field, words, asked_ns)
        actual = prefetched.actual[name]
        if read.purpose is Purpose.POLL and actual is not None:
            axis.motion.take_poll(actual, is_for_distance=read.is_for_distance)
    elif read.purpose is Purpose.COMMANDED:
        field = axis.plan.commanded[0]
        counts = prefetched.commanded[name] = None if words is None else counts_of(field, field.unpack(words))
        if counts is not None and not axis.plan.actual:
            axis.targets.prove_distance(Actual(counts, asked_ns))
    elif read.purpose is Purpose.RULE:
        prefetched.rule_words.setdefault(name, {})[read.address] = None if words is None else _word(words)
        if words is not None:
            axis.rules.store_read(read.address, _word(words))
    elif read.purpose is Purpose.STANDSTILL:
        _learn_standstill(read, words, prefetched, asked_ns)
    else:
        assert read.hit is not None
        if words is not None and read.purpose is Purpose.KEPT:
            axis.targets.read_back(read.hit.mapped.number, words)
        prefetched.command_words[axis.plan.name, read.hit.mapped.number] = _nominal_command(read.hit, words)


def _learn_standstill(read: AddedFrame, words: bytes | None, prefetched: Prefetched, asked_ns: int) -> None:
    axis = read.axis
    assert read.bit is not None
    if words is None:
        prefetched.standstill[axis.plan.name] = Standstill.UNKNOWN
        return
    is_set = read.bit.is_set(_word(words))
    is_done = read.bit is axis.plan.bits.get(DONE_BIT)
    if is_done:
        axis.motion.observe_done(asked_ns, is_done=is_set)
    else:
        axis.motion.observe_motion(asked_ns, moves=is_set)
    if is_set is not is_done:
        prefetched.standstill[axis.plan.name] = Standstill.MOVES
    elif axis.motion.has_started(asked_ns):
        prefetched.standstill[axis.plan.name] = Standstill.CONFIRMED
    else:
        prefetched.standstill[axis.plan.name] = Standstill.SAYS_SO


def _word(words: bytes) -> int:
    return words[0] << 8 | words[1]


def _nominal_command(hit: FieldHit, words: bytes | None) -> bytes | None:
    if words is None:
        return None
    axis = hit.mapped.axis
    try:
        return nominal_position(axis, hit.mapped.field, words, axis.compensation.readback)
    except RegisterRangeError:
        return None
