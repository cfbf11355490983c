"""Turning a drive's reply back into the controller's, and taking note of what it says."""

from collections.abc import Callable

from gateway.exchange.axis import AxisExchange
from gateway.exchange.parts import note_lost
from gateway.exchange.rewriting import Rewriting
from gateway.exchange.unit import FieldHit, FieldRole, Hits
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import ExceptionCode, FunctionCode, exception_pdu, is_exception


def answer(
    rewriting: Rewriting, reply: bytes, now_ns: int, send: Callable[[bytes], None]
) -> list[tuple[AxisExchange, bool]]:
    """Turn a drive's reply into the controller's, send it, and take note of what it says.

    The controller waits for its reply, so it is sent as soon as it is known: before the state of the axis is
    worked out, unless the same frame also reads positions, which that state turns back.

    Returns:
        The axes whose reference changed with what it is now.
    """
    acknowledged = _acknowledges(rewriting, reply)
    if acknowledged and rewriting.access.read_quantity:
        if rewriting.writes:
            _settle(rewriting, reply, now_ns, is_acknowledged=True)
        pdu, changed = _turn_back(rewriting, reply, now_ns)
        send(pdu)
        return changed
    send(_native_echo(rewriting.request_pdu, reply) if acknowledged else _foreign_reply(rewriting, reply))
    if rewriting.writes:
        _settle(rewriting, reply, now_ns, is_acknowledged=acknowledged)
    return []


def _acknowledges(rewriting: Rewriting, reply: bytes) -> bool:
    """Whether a reply is the full native success of what was sent (M7)."""
    sent = rewriting.sent_pdu
    if rewriting.access.read_quantity:
        expected = 2 * rewriting.read_span.quantity
        return reply[0] == sent[0] and len(reply) == 2 + expected and reply[1] == expected
    if sent[0] == FunctionCode.WRITE_MULTIPLE_REGISTERS:
        return reply == sent[:5]
    return reply == sent


def _settle(rewriting: Rewriting, reply: bytes, now_ns: int, *, is_acknowledged: bool) -> None:
    if is_acknowledged:
        for rendering in rewriting.renderings:
            rendering.axis.commit(rendering, now_ns)
        for axis, shadow in rewriting.touched_blindly:
            axis.compensation.forget_target()
            shadow.forget()
        return
    is_refusal = len(reply) == 2 and is_exception(reply)
    fail(rewriting, now_ns, is_refusal=is_refusal)


def fail(rewriting: Rewriting, now_ns: int, *, is_refusal: bool) -> None:
    """Note that a write was not acknowledged; what a refusal proves, the register map says (M7)."""
    for rendering in rewriting.renderings:
        if not (is_refusal and rendering.axis.plan.exception_writes_nothing):
            rendering.axis.fail(rendering)
    for hit in rewriting.command_hits:
        note_lost(hit, rewriting.request_pdu, rewriting.access, now_ns)
    for axis, shadow in rewriting.touched_blindly:
        axis.compensation.forget_target()
        shadow.forget()


def _foreign_reply(rewriting: Rewriting, reply: bytes) -> bytes:
    """Pass what is no acknowledgement untouched, but for the function code of a recast request (W4)."""
    asked, sent = rewriting.request_pdu[0], rewriting.sent_pdu[0]
    if asked != sent and len(reply) == 2 and reply[0] == sent | 0x80:
        return exception_pdu(asked, reply[1])
    return reply


def _native_echo(request: bytes, reply: bytes) -> bytes:
    """Give the controller the echo that belongs to its own request."""
    if request[0] == FunctionCode.WRITE_MULTIPLE_REGISTERS:
        return request[:5]
    if request[0] in (FunctionCode.WRITE_SINGLE_REGISTER, FunctionCode.MASK_WRITE_REGISTER):
        return request
    return reply


def _turn_back(
    rewriting: Rewriting, reply: bytes, now_ns: int
) -> tuple[bytes, list[tuple[AxisExchange, bool]]]:
    data = bytearray(reply[2:])
    try:
        for hit in rewriting.read_hits.fields:
            if hit.is_whole and hit.place.role.is_position:
                _turn_field_back(hit, rewriting, data, now_ns)
    except RegisterRangeError:
        return exception_pdu(rewriting.request_pdu[0], ExceptionCode.SERVER_DEVICE_FAILURE), []
    changed = note_bits(rewriting.read_hits, data, written_by(rewriting), now_ns)
    skip = 2 * (rewriting.access.read_address - rewriting.read_span.address)
    asked = data[skip : skip + 2 * rewriting.access.read_quantity]
    return bytes((reply[0], len(asked))) + bytes(asked), changed


def _turn_field_back(hit: FieldHit, rewriting: Rewriting, data: bytearray, now_ns: int) -> None:
    place = hit.place
    axis, at, end = place.axis, 2 * hit.word, 2 * (hit.word + place.field.words)
    words = bytes(data[at:end])
    readback = rewriting.readbacks.get(axis.plan.name)
    if readback is not None and rewriting.renderings:
        readback = axis.compensation.readback  # FC23 writes before it reads
    if place.role is FieldRole.ACTUAL and place.number == 0:
        axis.observe_actual(place.field, words, now_ns)
    if readback is None:
        return
    if place.role is FieldRole.COMMAND and place.shadow is not None:
        data[at:end] = axis.command_words(place.shadow, place.field, words, readback)
    else:
        data[at:end] = axis.nominal_words(place.field, words, readback)


def written_by(rewriting: Rewriting) -> set[str]:
    """Names of the axes whose command fields a request writes."""
    return {r.axis.plan.name for r in rewriting.renderings} | {
        a.plan.name for a, _ in rewriting.touched_blindly
    }


def note_bits(
    hits: Hits, data: bytes | bytearray, written: set[str], now_ns: int
) -> list[tuple[AxisExchange, bool]]:
    """Take note of status bits; return the axes whose reference changed, with what it is now.

    The done bit of a frame that wrote a target is still that of the one before.
    """
    changed = []
    for axis, name, bit, word in hits.bits:
        is_set = bit.is_set(data[2 * word] << 8 | data[2 * word + 1])
        if name == "done" and axis.plan.name not in written:
            axis.observe_done(is_set)
        elif name == "homed" and axis.reference.follows_bit and axis.see_homed_bit(now_ns, is_set=is_set):
            changed.append((axis, is_set))
    return changed
