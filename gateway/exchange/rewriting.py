"""Rewriting of one request.

A :class:`Rewriting` is made when a request is about to be sent and holds the state of that moment: the words
that were rendered, the readback maps then in force, and what the controller really asked for.
"""

from dataclasses import dataclass, field
from typing import Final

from gateway.compensation.readback import Readback
from gateway.exchange.access import Access
from gateway.exchange.axis import AxisExchange, RefusedPositionError, Rendering
from gateway.exchange.parts import Known, nominal_words
from gateway.exchange.shadow import Shadow
from gateway.exchange.unit import NO_HITS, FieldHit, FieldPlace, FieldRole, Hits, UnitMap
from gateway.modbus.pdu import (
    MAX_READ_REGISTERS,
    MAX_READ_WRITE_WRITE_REGISTERS,
    MAX_WRITE_REGISTERS,
    ExceptionCode,
    FunctionCode,
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
    command_hits: list[FieldHit] = field(default_factory=list)
    """Every command field that the request writes."""
    remaps: bool = False
    """Whether the request writes a register that moves other registers about."""
    read_hits: Hits = NO_HITS
    read_span: Span = NO_SPAN
    readbacks: dict[str, Readback] = field(default_factory=dict)
    """By axis; an axis that passed 1:1 at the moment of the request is not here."""

    @property
    def writes(self) -> bool:
        """Whether the request writes a command field."""
        return bool(self.command_hits)

    @property
    def reads_unmapped(self) -> bool:
        """Whether the request reads a position that is not mapped, and so passes as it is (M10)."""
        return any(hit.place.role is FieldRole.GUARDED for hit in self.read_hits.fields)


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
    access, pdu = rewriting.access, rewriting.request_pdu
    fields = unit.hits(access.write_address, access.write_quantity).fields
    if not fields:
        return
    commands: list[tuple[FieldHit, bytes | None]] = []
    for hit in fields:
        if hit.place.role is FieldRole.COMMAND:
            rewriting.command_hits.append(hit)
            words = nominal_words(hit, pdu, access, known, now_ns) if access.is_consistent else None
            commands.append((hit, words))
        elif hit.place.role is FieldRole.REMAPPING:
            rewriting.remaps = True
        elif not hit.place.axis.passes_unchanged:
            _refuse_guarded(hit)
    again = [axis for axis in unit.axes if _is_image_again(axis, commands)]
    rendered = [
        (hit, rendering)
        for hit, words in commands
        if (rendering := _render(hit, words, rewriting, known, now_ns, is_again=hit.place.axis in again))
        is not None
    ]
    rewriting.renderings += [rendering for _, rendering in rendered]
    changed = [(hit, r) for hit, r in rendered if not hit.place.axis.passes_unchanged]
    if changed:
        rewriting.sent_pdu = _written_pdu(pdu, access, changed)


def _refuse_guarded(hit: FieldHit) -> None:
    """Refuse to write a position around the correction (M10).

    Raises:
        RefusedRequestError: unless the axis lets such writes pass.
    """
    plan = hit.place.axis.plan
    if hit.place.role is not FieldRole.GUARDED:
        reason = f"{_at(hit)} reports a position; writing it would move the frame"
    elif plan.passes_unmapped:
        return
    else:
        reason = f'{_at(hit)} holds a position that is not mapped (unmapped = "pass" lets it through)'
    raise RefusedRequestError(ExceptionCode.ILLEGAL_DATA_ADDRESS, plan.name, reason)


def _at(hit: FieldHit) -> str:
    return f"register {hit.place.field.address:#06x}"


def _render(
    hit: FieldHit,
    words: bytes | None,
    rewriting: Rewriting,
    known: Known,
    now_ns: int,
    *,
    is_again: bool,
) -> Rendering | None:
    """Render one command field; None for a 1:1 write that leaves its content unknown."""
    place = hit.place
    axis, shadow, name = place.axis, place.shadow, place.axis.plan.name
    assert shadow is not None
    is_passing = axis.passes_unchanged
    if words is None:
        if is_passing and not shadow.is_torn:
            rewriting.touched_blindly.append((axis, shadow))
            return None
        if not rewriting.access.is_consistent:
            raise RefusedRequestError(
                ExceptionCode.ILLEGAL_DATA_VALUE,
                name,
                f"the counts of a write to {_at(hit)} contradict each other",
            )
        raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, name, _why_incomplete(hit, known))
    if is_again:
        return axis.render_repeat(shadow, is_passing=is_passing)
    try:
        return axis.render(place.number, words, now_ns, known.actual.get(name), is_passing=is_passing)
    except RefusedPositionError as error:
        if is_passing:
            rewriting.touched_blindly.append((axis, shadow))
            return None
        raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, name, str(error)) from error


def _why_incomplete(hit: FieldHit, known: Known) -> str:
    if hit.place.shadow is not None and hit.place.shadow.is_torn:
        return f"a part of the position at {_at(hit)} was lost before: write all of it again"
    if id(hit.place.shadow) not in known.command_words:
        return f"part of the position at {_at(hit)} was written and the rest is not known"
    return (
        f"part of the position at {_at(hit)} was written and the rest is not certain: what the drive holds "
        "may lie across a word's border from what was commanded; write all of it in one frame"
    )


def _is_image_again(axis: AxisExchange, commands: list[tuple[FieldHit, bytes | None]]) -> bool:
    """Whether a request writes nothing into the axis's command fields but what they hold already (M4).

    A cyclic image with several command fields is judged as a whole; one field rewritten alone is a target.
    """
    own = [(hit.place.shadow, words) for hit, words in commands if hit.place.axis is axis]
    return any(shadow is axis.last_shadow for shadow, _ in own) and all(
        shadow is not None and words is not None and axis.is_repeat(shadow, words) for shadow, words in own
    )


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
        if not axis.passes_unchanged and hit.place.role.is_position:
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
