"""Rewriting of one request, and turning its reply back.

A :class:`Rewriting` is made when a request is about to be sent and holds the state of that moment: the words
that were rendered, the readback maps then in force, and what the controller really asked for.
"""

from dataclasses import dataclass, field
from typing import Final

from gateway.compensation.readback import Readback
from gateway.exchange.access import Access
from gateway.exchange.axis import Actual, AxisExchange, RefusedPositionError, Rendering, Shadow
from gateway.exchange.unit import NO_HITS, FieldHit, FieldPlace, FieldRole, Hits, UnitMap
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import (
    MAX_READ_REGISTERS,
    MAX_READ_WRITE_WRITE_REGISTERS,
    MAX_WRITE_REGISTERS,
    ExceptionCode,
    FunctionCode,
    exception_pdu,
    is_exception,
)
from gateway.modbus.registers import PositionField


class RefusedRequestError(Exception):
    """A request that the gateway answers itself: with ``code``, and nothing was sent."""

    def __init__(self, code: ExceptionCode, axis: str, reason: str) -> None:
        super().__init__(reason)
        self.code = code
        self.axis = axis
        self.reason = reason


@dataclass(frozen=True, slots=True)
class Span:
    """Registers ``address`` to ``address + quantity - 1``."""

    address: int
    quantity: int

    def widened(self, fields: list[PositionField]) -> "Span":
        """Return the smallest span around this one that cuts none of ``fields``."""
        start = min([self.address, *(f.address for f in fields)])
        end = max([self.address + self.quantity, *(f.end for f in fields)])
        return Span(start, end - start)


NO_SPAN: Final = Span(0, 0)


@dataclass(slots=True)
class Rewriting:
    """One request as it came and as it went, with all that is needed to turn its reply back."""

    request_pdu: bytes
    sent_pdu: bytes
    access: Access
    renderings: list[Rendering] = field(default_factory=list)
    touched_blindly: list[tuple[AxisExchange, Shadow]] = field(default_factory=list)
    """Command fields that were written 1:1 in a way that leaves their content unknown."""
    read_hits: Hits = NO_HITS
    read_span: Span = NO_SPAN
    readbacks: dict[str, Readback] = field(default_factory=dict)
    """By axis; an axis that passed 1:1 at the moment of the request is not here."""

    @property
    def writes(self) -> bool:
        """Whether the request writes a command field."""
        return bool(self.renderings or self.touched_blindly)


class Known:
    """What was read for one request before it could be rendered."""

    def __init__(self) -> None:
        self.actual: dict[str, Actual | None] = {}
        """By axis; None: it was tried and could not be had."""
        self.command_words: dict[int, bytes | None] = {}
        """Nominal words by identity of the shadow they belong to; None as above."""


def nominal_words(hit: FieldHit, pdu: bytes, access: Access, known: Known) -> bytes | None:
    """Return all words of a command field once this request is applied, or None when some are not known."""
    field_ = hit.place.field
    data = pdu[access.data_offset :]
    if hit.is_whole and not access.is_mask:
        return data[2 * hit.word : 2 * (hit.word + field_.words)]
    shadow = hit.place.shadow
    assert shadow is not None
    words = shadow.nominal_words or known.command_words.get(id(shadow))
    if words is None:
        return None
    merged = bytearray(words)
    if access.is_mask:
        at = -2 * hit.word
        current = merged[at] << 8 | merged[at + 1]
        and_mask, or_mask = data[0] << 8 | data[1], data[2] << 8 | data[3]
        merged[at : at + 2] = ((current & and_mask) | (or_mask & ~and_mask & 0xFFFF)).to_bytes(2, "big")
        return bytes(merged)
    first = max(0, hit.word)
    last = min(access.write_quantity, hit.word + field_.words)
    merged[2 * (first - hit.word) : 2 * (last - hit.word)] = data[2 * first : 2 * last]
    return bytes(merged)


def prepare(unit: UnitMap, pdu: bytes, access: Access, known: Known, now_ns: int) -> Rewriting:
    """Work out what is sent for a request. Nothing is changed until its reply is there.

    Raises:
        RefusedRequestError: the request must not reach the drive.
    """
    rewriting = Rewriting(pdu, pdu, access)
    if access.write_quantity:
        _prepare_write(unit, rewriting, known, now_ns)
    if access.read_quantity:
        _prepare_read(unit, rewriting)
    return rewriting


def _prepare_write(unit: UnitMap, rewriting: Rewriting, known: Known, now_ns: int) -> None:
    access = rewriting.access
    fields = unit.hits(access.write_address, access.write_quantity).fields
    if not fields:
        return
    rendered: list[tuple[FieldHit, Rendering]] = []
    for hit in fields:
        if hit.place.axis.passes_unchanged:
            _note_unchanged(hit, rewriting, known, now_ns)
        else:
            rendered.append((hit, _render(hit, rewriting, known, now_ns)))
    if rendered:
        rewriting.renderings += [rendering for _, rendering in rendered]
        rewriting.sent_pdu = _written_pdu(rewriting.request_pdu, access, rendered)


def _note_unchanged(hit: FieldHit, rewriting: Rewriting, known: Known, now_ns: int) -> None:
    """Follow a 1:1 write in the shadow, so that status and the first correction later know of it."""
    place, access = hit.place, rewriting.access
    if place.role is not FieldRole.COMMAND:
        return
    words = nominal_words(hit, rewriting.request_pdu, access, known) if access.is_consistent else None
    assert place.shadow is not None
    if words is None:
        rewriting.touched_blindly.append((place.axis, place.shadow))
        return
    try:
        fresh = known.actual.get(place.axis.plan.name)
        rewriting.renderings.append(place.axis.render(place.number, words, now_ns, fresh, is_passing=True))
    except RefusedPositionError:
        rewriting.touched_blindly.append((place.axis, place.shadow))


def _render(hit: FieldHit, rewriting: Rewriting, known: Known, now_ns: int) -> Rendering:
    place, access = hit.place, rewriting.access
    name = place.axis.plan.name
    at = f"register {place.field.address:#06x}"
    if place.role is not FieldRole.COMMAND:
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_ADDRESS,
            name,
            f"{at} reports a position; writing it would move the frame",
        )
    if not access.is_consistent:
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_VALUE, name, f"the counts of a write to {at} contradict each other"
        )
    words = nominal_words(hit, rewriting.request_pdu, access, known)
    if words is None:
        raise RefusedRequestError(
            ExceptionCode.SERVER_DEVICE_FAILURE,
            name,
            f"part of the position at {at} was written and the rest is not known",
        )
    try:
        return place.axis.render(place.number, words, now_ns, known.actual.get(name), is_passing=False)
    except RefusedPositionError as error:
        raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, name, str(error)) from error


def _written_pdu(pdu: bytes, access: Access, rendered: list[tuple[FieldHit, Rendering]]) -> bytes:
    """Put rendered words into a request, widening it where it cuts a position (M1)."""
    if not access.is_mask and all(hit.is_whole for hit, _ in rendered):
        patched = bytearray(pdu)
        for hit, rendering in rendered:
            at = access.data_offset + 2 * hit.word
            patched[at : at + len(rendering.corrected_words)] = rendering.corrected_words
        return bytes(patched)
    span = Span(access.write_address, access.write_quantity)
    whole = span.widened([hit.place.field for hit, _ in rendered])
    words = bytearray(2 * whole.quantity)
    if not access.is_mask:
        at = 2 * (span.address - whole.address)
        words[at : at + 2 * span.quantity] = pdu[access.data_offset :]
    for hit, rendering in rendered:
        at = 2 * (hit.place.field.address - whole.address)
        words[at : at + len(rendering.corrected_words)] = rendering.corrected_words
    return _build_write(pdu, whole, bytes(words), rendered[0][1].axis)


def _build_write(pdu: bytes, span: Span, words: bytes, axis: AxisExchange) -> bytes:
    is_read_write = pdu[0] == FunctionCode.READ_WRITE_MULTIPLE_REGISTERS
    limit = min(
        axis.plan.max_registers, MAX_READ_WRITE_WRITE_REGISTERS if is_read_write else MAX_WRITE_REGISTERS
    )
    if span.quantity > limit:
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_ADDRESS,
            axis.plan.name,
            f"this write cuts a position, and {span.quantity} registers are more than the drive's {limit}",
        )
    head = span.address.to_bytes(2, "big") + span.quantity.to_bytes(2, "big") + bytes((len(words),))
    if is_read_write:
        return pdu[:5] + head + words
    if axis.plan.write_function == FunctionCode.WRITE_SINGLE_REGISTER and span.quantity == 1:
        return bytes((FunctionCode.WRITE_SINGLE_REGISTER,)) + head[:2] + words
    return bytes((FunctionCode.WRITE_MULTIPLE_REGISTERS,)) + head + words


def _prepare_read(unit: UnitMap, rewriting: Rewriting) -> None:
    access = rewriting.access
    span = Span(access.read_address, access.read_quantity)
    hits = unit.hits(span.address, span.quantity)
    rewriting.read_hits, rewriting.read_span = hits, span
    if not hits.fields:
        return
    active: list[FieldPlace] = []
    for hit in hits.fields:
        axis = hit.place.axis
        if not axis.passes_unchanged:
            active.append(hit.place)
            rewriting.readbacks[axis.plan.name] = axis.compensation.readback
    whole = span.widened([place.field for place in active])
    if whole == span:
        return
    limit = min(MAX_READ_REGISTERS, *(place.axis.plan.max_registers for place in active))
    if whole.quantity > limit:
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_ADDRESS,
            active[0].axis.plan.name,
            f"this read cuts a position, and {whole.quantity} registers are more than the drive's {limit}",
        )
    pdu = rewriting.sent_pdu
    head = whole.address.to_bytes(2, "big") + whole.quantity.to_bytes(2, "big")
    rewriting.sent_pdu = pdu[:1] + head + pdu[5:]
    rewriting.read_span = whole
    rewriting.read_hits = unit.hits(whole.address, whole.quantity)


def answer(rewriting: Rewriting, reply: bytes, now_ns: int) -> tuple[bytes, list[tuple[AxisExchange, bool]]]:
    """Turn a drive's reply into the controller's, and take note of what it says.

    Returns:
        The PDU for the controller, and the axes whose reference changed with what it is now.
    """
    acknowledged = _acknowledges(rewriting, reply)
    if rewriting.writes:
        _settle(rewriting, reply, is_acknowledged=acknowledged)
    if not acknowledged:
        return _foreign_reply(rewriting, reply), []
    if not rewriting.access.read_quantity:
        return _native_echo(rewriting.request_pdu, reply), []
    return _turn_back(rewriting, reply, now_ns)


def _acknowledges(rewriting: Rewriting, reply: bytes) -> bool:
    """Whether a reply is the full native success of what was sent (M7)."""
    sent = rewriting.sent_pdu
    if rewriting.access.read_quantity:
        expected = 2 * rewriting.read_span.quantity
        return reply[0] == sent[0] and len(reply) == 2 + expected and reply[1] == expected
    if sent[0] == FunctionCode.WRITE_MULTIPLE_REGISTERS:
        return reply == sent[:5]
    return reply == sent


def _settle(rewriting: Rewriting, reply: bytes, *, is_acknowledged: bool) -> None:
    if is_acknowledged:
        for rendering in rewriting.renderings:
            rendering.axis.commit(rendering)
        for axis, shadow in rewriting.touched_blindly:
            axis.compensation.forget_target()
            shadow.forget()
        return
    is_refusal = len(reply) == 2 and is_exception(reply)
    for axis in written_axes(rewriting):
        if not (is_refusal and axis.plan.exception_writes_nothing):
            axis.forget()


def written_axes(rewriting: Rewriting) -> list[AxisExchange]:
    """Axes whose command fields the request writes."""
    axes = [r.axis for r in rewriting.renderings] + [axis for axis, _ in rewriting.touched_blindly]
    return list({id(axis): axis for axis in axes}.values())


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
            if hit.is_whole:
                _turn_field_back(hit, rewriting, data, now_ns)
    except RegisterRangeError:
        return exception_pdu(rewriting.request_pdu[0], ExceptionCode.SERVER_DEVICE_FAILURE), []
    changed = note_bits(rewriting.read_hits, data)
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


def note_bits(hits: Hits, data: bytes | bytearray) -> list[tuple[AxisExchange, bool]]:
    """Take note of status bits; return the axes whose reference changed, with what it is now."""
    changed = []
    for axis, name, bit, word in hits.bits:
        is_set = bit.is_set(data[2 * word] << 8 | data[2 * word + 1])
        if name == "done" and is_set:
            axis.is_done_seen = axis.compensation.accepted is not None
        elif name == "homed" and axis.follows_homed_bit and axis.set_referenced(is_set):
            changed.append((axis, is_set))
    return changed
