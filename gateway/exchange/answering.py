"""Turning a drive's reply back into the controller's, and taking note of what it says."""

from collections.abc import Callable, Iterable
from collections.abc import Set as AbstractSet
from typing import Final

from gateway.exchange.access import MEI_HEAD, swapped
from gateway.exchange.effects import note_done, note_failed
from gateway.exchange.meaning import Meaning
from gateway.exchange.observing import observe_actual, observe_bit
from gateway.exchange.parts import note_held, note_lost
from gateway.exchange.plan import HOMED_BIT
from gateway.exchange.rendering import nominal_limit
from gateway.exchange.rewriting import Rewriting
from gateway.exchange.unit import BitHit, FieldHit, FieldRole, UnitMap
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import EXCEPTION_BIT, ExceptionCode, FunctionCode, exception_pdu, is_exception
from gateway.modbus.registers import BitTable

READS_BITS: Final = frozenset({FunctionCode.READ_COILS, FunctionCode.READ_DISCRETE_INPUTS})


def answer(rewriting: Rewriting, reply: bytes, now_ns: int, send: Callable[[bytes], None]) -> None:
    """Turn a drive's reply into the controller's, send it, and take note of what it says.

    The controller waits for its reply, so it is sent as soon as it is known: before the state of the axis is
    worked out, unless the same frame also reads positions, which that state turns back.
    """
    acknowledged = _acknowledges(rewriting, reply)
    if acknowledged and rewriting.access.read_quantity:
        if rewriting.writes:
            _settle(rewriting, reply, now_ns, is_acknowledged=True)
        send(_turn_back(rewriting, reply))
        return
    send(_native_echo(rewriting.request.pdu, reply) if acknowledged else _foreign_reply(rewriting, reply))
    if rewriting.writes:
        _settle(rewriting, reply, now_ns, is_acknowledged=acknowledged)


def _acknowledges(rewriting: Rewriting, reply: bytes) -> bool:
    """Whether a reply is the full native success of what was sent (M7)."""
    sent, access = rewriting.sent_pdu, rewriting.access
    if access.is_mei:
        is_same = reply[:8] == sent[:8]
        return is_same and (not access.read_quantity or len(reply) == MEI_HEAD + 2 * access.read_quantity)
    if access.read_quantity:
        expected = 2 * rewriting.read_span.quantity
        return reply[0] == sent[0] and len(reply) == 2 + expected and reply[1] == expected
    if sent[0] in (FunctionCode.WRITE_MULTIPLE_REGISTERS, FunctionCode.WRITE_MULTIPLE_COILS):
        return reply == sent[:5]
    return reply == sent


def _settle(rewriting: Rewriting, reply: bytes, now_ns: int, *, is_acknowledged: bool) -> None:
    if not is_acknowledged:
        is_refusal = len(reply) == 2 and reply[0] == rewriting.sent_pdu[0] | EXCEPTION_BIT
        code = reply[1] if is_refusal else ExceptionCode.SERVER_DEVICE_FAILURE
        fail(rewriting, code, now_ns, is_refusal=is_refusal)
        return
    for staging in rewriting.stagings:
        staging.shadow.settle(staging.nominal_words, staging.corrected_words, staging.losses)
    for hit in rewriting.pending:
        note_held(hit, rewriting.request.pdu, rewriting.access, rewriting.request.arrived_ns)
    for rendering in (*rewriting.renderings, *rewriting.runs):
        rendering.axis.commit(rendering, now_ns, rewriting.losses.get(id(rendering.shadow)))
        rendering.axis.tell_beginning()
    for axis, shadow in rewriting.touched_blindly:
        axis.forget_place(now_ns)
        shadow.forget()
    for axis in rewriting.moved_unknown:
        axis.forget_place(now_ns)
    for meaning in rewriting.request.meanings:
        note_done(meaning, now_ns)
        if meaning.runs_alone and not _is_run_known(rewriting, meaning):
            meaning.axis.forget_place(now_ns)
    _conclude(rewriting)


def _conclude(rewriting: Rewriting) -> None:
    for axis in rewriting.request.unit.axes:
        if axis.memory is not None:
            axis.memory.conclude()


def _is_run_known(rewriting: Rewriting, meaning: Meaning) -> bool:
    """Whether a trigger ran a target whose end is known."""
    runs = [run for run in rewriting.runs if run.axis is meaning.axis]
    return any(run.move is not None or not any(run.nominal_words) for run in runs)


def fail(rewriting: Rewriting, code: int, now_ns: int, *, is_refusal: bool) -> None:
    """Note that a write was not acknowledged; what a refusal proves, the register map says (M7)."""
    for rendering in rewriting.renderings:
        if not (is_refusal and rendering.axis.writes_nothing(code)):
            rendering.axis.fail(rendering, now_ns)
    for rendering in rewriting.runs:
        if not (is_refusal and rendering.axis.writes_nothing(code)):
            rendering.axis.fail_run(rendering, now_ns)
    for hit in rewriting.command_hits:
        note_lost(hit, rewriting.request.pdu, rewriting.access, rewriting.request.arrived_ns)
    for staging in rewriting.stagings:
        staging.shadow.forget()
    for axis, shadow in rewriting.touched_blindly:
        axis.forget_place(now_ns)
        shadow.forget()
    for meaning in rewriting.request.meanings:
        is_run_known = _is_run_known(rewriting, meaning)
        note_failed(meaning, code, now_ns, is_refusal=is_refusal, is_run_known=is_run_known)
    _conclude(rewriting)


def note_broadcast(rewriting: Rewriting, now_ns: int) -> None:
    """Note a broadcast, which nobody acknowledges: what it did is unknown until it is read (M3)."""
    for rendering in rewriting.renderings:
        rendering.axis.fail(rendering, now_ns)
    for rendering in rewriting.runs:
        rendering.axis.fail_run(rendering, now_ns)
    for staging in rewriting.stagings:
        staging.shadow.forget()
    for axis, shadow in rewriting.touched_blindly:
        axis.forget_place(now_ns)
        shadow.forget()
    for meaning in rewriting.request.meanings:
        is_run_known = _is_run_known(rewriting, meaning)
        note_failed(meaning, 0, now_ns, is_refusal=False, is_run_known=is_run_known, is_broadcast=True)
    _conclude(rewriting)


def _foreign_reply(rewriting: Rewriting, reply: bytes) -> bytes:
    """Pass what is no acknowledgement untouched; of a recast request, in the form that was asked (W4)."""
    asked, sent = rewriting.request.pdu[0], rewriting.sent_pdu[0]
    if asked == sent:
        return reply
    is_refusal = len(reply) == 2 and is_exception(reply)
    return exception_pdu(asked, reply[1] if is_refusal else ExceptionCode.SERVER_DEVICE_FAILURE)


def _native_echo(request: bytes, reply: bytes) -> bytes:
    """Give the controller the echo that belongs to its own request."""
    if request[0] == FunctionCode.WRITE_MULTIPLE_REGISTERS:
        return request[:5]
    if request[0] in (FunctionCode.WRITE_SINGLE_REGISTER, FunctionCode.MASK_WRITE_REGISTER):
        return request
    return reply


def _turn_back(rewriting: Rewriting, reply: bytes) -> bytes:
    """Return a reply to a read with every position on the controller's scale."""
    access = rewriting.access
    head = MEI_HEAD if access.is_mei else 2
    data = bytearray(swapped(reply[head:]) if access.is_mei else reply[head:])
    try:
        for hit in rewriting.read_hits.fields:
            if hit.is_whole and hit.place.role.is_position:
                _turn_field_back(hit, rewriting, data)
    except RegisterRangeError:
        return exception_pdu(rewriting.request.pdu[0], ExceptionCode.SERVER_DEVICE_FAILURE)
    note_bits(rewriting.read_hits.bits, data, written_by(rewriting), rewriting.request.now_ns)
    if access.is_mei:
        return reply[:head] + swapped(bytes(data)) if rewriting.read_hits.fields else reply
    skip = 2 * (access.read_address - rewriting.read_span.address)
    asked = data[skip : skip + 2 * access.read_quantity]
    return bytes((reply[0], len(asked))) + bytes(asked)


def _turn_field_back(hit: FieldHit, rewriting: Rewriting, data: bytearray) -> None:
    place = hit.place
    axis, at, end = place.axis, 2 * hit.word, 2 * (hit.word + place.field.words)
    words = bytes(data[at:end])
    readback = rewriting.readback(axis)
    if readback is not None and rewriting.renderings:
        readback = axis.compensation.readback  # FC23 writes before it reads
    if place.role is FieldRole.ACTUAL and place.number == 0:
        was_undecided = axis.memory is not None and axis.memory.recalled is not None
        observe_actual(axis, place.field, words, rewriting.request.now_ns)  # as old as its request
        if was_undecided and readback is not None:
            readback = axis.compensation.readback  # nothing else was in force when the request was sent
    if readback is None:
        return
    if place.role is FieldRole.COMMAND and place.shadow is not None:
        data[at:end] = axis.command_words(place.shadow, place.field, words, readback)
    elif place.role is FieldRole.LIMIT and place.shadow is not None:
        data[at:end] = nominal_limit(axis, place.shadow, place.number, words)
    else:
        data[at:end] = axis.nominal_words(place.field, words, readback)


def written_by(rewriting: Rewriting) -> set[str]:
    """Names of the axes that a request sends somewhere."""
    return {r.axis.plan.name for r in (*rewriting.renderings, *rewriting.runs)} | {
        a.plan.name for a, _ in rewriting.touched_blindly
    }


def note_discrete(unit: UnitMap | None, request: bytes, reply: bytes, asked_ns: int) -> None:
    """Take note of status bits among coils or discrete inputs that were read (6.1, 6.2)."""
    if unit is None or request[0] not in READS_BITS or len(request) != 5:
        return
    if len(reply) < 3 or reply[0] != request[0] or len(reply) != 2 + reply[1]:
        return
    table = BitTable.COIL if request[0] == FunctionCode.READ_COILS else BitTable.INPUT
    address, quantity = int.from_bytes(request[1:3], "big"), int.from_bytes(request[3:5], "big")
    hits = unit.read_bits(table, address, min(quantity, 8 * reply[1]))
    if hits:
        words = b"".join(bytes((0, reply[2 + i // 8] >> i % 8 & 1)) for i in range(8 * reply[1]))
        note_bits(hits, words, set(), asked_ns)


def note_bits(
    hits: Iterable[BitHit], data: bytes | bytearray, written: AbstractSet[str], asked_ns: int
) -> None:
    """Take note of status bits, a word for each in ``data``: as old as their request.

    The done bit of a frame that wrote a target is still that of the one before.
    """
    for axis, name, bit, word in hits:
        is_set = bit.is_set(data[2 * word] << 8 | data[2 * word + 1])
        if axis.plan.name not in written or name == HOMED_BIT:
            observe_bit(axis, name, asked_ns, is_set=is_set)
