"""What a controller gets for its drive's reply, and what the gateway learns from it (W4, M7, M10).

:func:`nominal_reply` converts every position in a reply back to the controller's scale
(:func:`nominal_position`).
"""

from collections.abc import Iterable
from collections.abc import Set as AbstractSet
from math import isfinite
from typing import Final

from gateway.compensation.readback import Readback
from gateway.exchange.access import MEI_HEAD, swapped
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.axis import Axis
from gateway.exchange.field_counts import counts_of, raw_of, steps_of
from gateway.exchange.plan import HOMED_BIT
from gateway.exchange.render import nominal_limit
from gateway.exchange.request import Request
from gateway.exchange.unit import BitHit, FieldHit, FieldRole, UnitMap
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import EXCEPTION_BIT, ExceptionCode, FunctionCode, exception_pdu, is_exception
from gateway.modbus.registers import BitTable, PositionField

READS_BITS: Final = frozenset({FunctionCode.READ_COILS, FunctionCode.READ_DISCRETE_INPUTS})


def outcome_of(request: Request, reply: bytes) -> tuple[Outcome, int]:
    """Return the outcome of a request with this reply, and its exception code (M7)."""
    if _acknowledges(request, reply):
        return Outcome.ACKNOWLEDGED, 0
    if len(reply) == 2 and reply[0] == request.sent_pdu[0] | EXCEPTION_BIT:
        return Outcome.EXCEPTION, reply[1]
    return Outcome.OTHER_REPLY, ExceptionCode.SERVER_DEVICE_FAILURE


def reply_without_positions(request: Request, reply: bytes, *, is_acknowledged: bool) -> bytes:
    """Return what the controller gets for a reply without positions (W4).

    An acknowledgement becomes the echo of the controller's own request. Other replies pass unchanged. If the
    request was sent in another form, they become an exception in the original form.
    """
    pdu = request.frame.pdu
    asked, sent = pdu[0], request.sent_pdu[0]
    if is_acknowledged:
        if asked == FunctionCode.WRITE_MULTIPLE_REGISTERS:
            return pdu[:5]
        is_echoed = asked in (FunctionCode.WRITE_SINGLE_REGISTER, FunctionCode.MASK_WRITE_REGISTER)
        return pdu if is_echoed else reply
    if asked == sent:
        return reply
    is_refusal = len(reply) == 2 and is_exception(reply)
    return exception_pdu(asked, reply[1] if is_refusal else ExceptionCode.SERVER_DEVICE_FAILURE)


def _acknowledges(request: Request, reply: bytes) -> bool:
    """Whether a reply is the complete normal reply to what was sent (M7)."""
    sent, access = request.sent_pdu, request.frame.access
    if access.is_mei:
        is_same = reply[:8] == sent[:8]
        return is_same and (not access.read_quantity or len(reply) == MEI_HEAD + 2 * access.read_quantity)
    if access.read_quantity:
        expected = 2 * request.read_span.quantity
        return reply[0] == sent[0] and len(reply) == 2 + expected and reply[1] == expected
    if sent[0] in (FunctionCode.WRITE_MULTIPLE_REGISTERS, FunctionCode.WRITE_MULTIPLE_COILS):
        return reply == sent[:5]
    return reply == sent


def nominal_reply(request: Request, reply: bytes) -> bytes:
    """Return a reply to a read with every position on the controller's scale."""
    access = request.frame.access
    if request.read_refusal is not None:
        return exception_pdu(request.frame.pdu[0], request.read_refusal.code)
    head = MEI_HEAD if access.is_mei else 2
    data = bytearray(swapped(reply[head:]) if access.is_mei else reply[head:])
    try:
        for hit in request.read_hits.fields:
            if hit.is_whole and hit.mapped.role.is_position:
                _make_field_nominal(hit, request, data)
    except RegisterRangeError:
        return exception_pdu(request.frame.pdu[0], ExceptionCode.SERVER_DEVICE_FAILURE)
    observe_bits(request.read_hits.bits, data, sent_somewhere(request), request.now_ns)
    if access.is_mei:
        return reply[:head] + swapped(bytes(data)) if request.read_hits.fields else reply
    skip = 2 * (access.read_address - request.read_span.address)
    asked = data[skip : skip + 2 * access.read_quantity]
    return bytes((reply[0], len(asked))) + bytes(asked)


def _make_field_nominal(hit: FieldHit, request: Request, data: bytearray) -> None:
    mapped = hit.mapped
    axis, at, end = mapped.axis, 2 * hit.word, 2 * (hit.word + mapped.field.words)
    words = bytes(data[at:end])
    readback = request.readbacks.get(axis.plan.name)
    if readback is not None and request.commands:
        readback = axis.compensation.readback  # FC23 writes before it reads
    if mapped.role is FieldRole.ACTUAL and mapped.number == 0:
        was_undecided = axis.recall.is_open
        axis.observe_actual(mapped.field, words, request.now_ns)  # as old as its request
        if was_undecided:  # nothing else was in force when the request was sent
            readback = None if axis.reads_unchanged else axis.compensation.readback
    if readback is None:
        return
    if mapped.role is FieldRole.COMMAND and mapped.image is not None:
        data[at:end] = nominal_command(axis, mapped.number, mapped.field, words, readback)
    elif mapped.role is FieldRole.LIMIT and mapped.image is not None:
        data[at:end] = nominal_limit(axis, mapped.number, words)
    else:
        data[at:end] = nominal_position(axis, mapped.field, words, readback)


def nominal_command(axis: Axis, number: int, field: PositionField, words: bytes, readback: Readback) -> bytes:
    """Convert a command field that is read back to what the controller wrote.

    The words also prove that an unacknowledged target arrived (``Targets.prove_by_words``).

    Raises:
        RegisterRangeError: the nominal position does not fit the register.
    """
    if axis.motion.unacknowledged is not None:
        axis.targets.prove_by_words(number, words)
    return axis.fields[number].means(words) or nominal_position(axis, field, words, readback)


def nominal_position(axis: Axis, field: PositionField, words: bytes, readback: Readback) -> bytes:
    """Convert words reported by the drive to the words for the controller.

    Raises:
        RegisterRangeError: the nominal position does not fit the register.
    """
    corrected = field.unpack(words)
    if not isfinite(corrected):
        return words
    corrected_counts = counts_of(field, corrected)
    accepted = axis.compensation.accepted
    if accepted is not None:
        corrected_target = accepted.corrected_counts
        # A register with coarser steps than the target's gives one value for all positions near the target.
        if corrected_counts == corrected_target or corrected == raw_of(field, corrected_target):
            return field.pack(raw_of(field, accepted.nominal_counts))
    correction = readback.correction_counts(corrected_counts)
    if not correction:
        return words
    return field.pack(corrected - steps_of(field, correction))


def sent_somewhere(request: Request) -> set[str]:
    """Return the names of the axes that a request sends somewhere."""
    return {each.axis.plan.name for each in request.commands if each.sends_somewhere}


def observe_discrete(unit: UnitMap | None, request: bytes, reply: bytes, asked_ns: int) -> None:
    """Record status bits among coils or discrete inputs that were read (6.1, 6.2)."""
    if unit is None or request[0] not in READS_BITS or len(request) != 5:
        return
    if len(reply) < 3 or reply[0] != request[0] or len(reply) != 2 + reply[1]:
        return
    table = BitTable.COIL if request[0] == FunctionCode.READ_COILS else BitTable.INPUT
    address, quantity = int.from_bytes(request[1:3], "big"), int.from_bytes(request[3:5], "big")
    hits = unit.read_bits(table, address, min(quantity, 8 * reply[1]))
    if hits:
        words = b"".join(bytes((0, reply[2 + i // 8] >> i % 8 & 1)) for i in range(8 * reply[1]))
        observe_bits(hits, words, set(), asked_ns)


def observe_bits(
    hits: Iterable[BitHit], data: bytes | bytearray, written: AbstractSet[str], asked_ns: int
) -> None:
    """Record status bits, one word for each in ``data``, as old as their request.

    In a frame that wrote a target the done bit still belongs to the target before.
    """
    for axis, name, bit, word in hits:
        is_set = bit.is_set(data[2 * word] << 8 | data[2 * word + 1])
        if axis.plan.name not in written or name == HOMED_BIT:
            axis.observe_bit(name, asked_ns, is_set=is_set)
