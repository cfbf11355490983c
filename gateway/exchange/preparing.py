"""What is sent for a request: positions rendered, cut ones made whole (M1, M2, M8, M10)."""

from gateway.compensation.readback import Readback
from gateway.drives.motion import Form
from gateway.exchange.access import Access
from gateway.exchange.axis import AxisExchange
from gateway.exchange.commands import prepare_commands
from gateway.exchange.effects import check_may_act
from gateway.exchange.parts import written_part
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.rendering import RefusedPositionError, render_limit
from gateway.exchange.request import Request
from gateway.exchange.rewriting import Rewriting, Span, Staging
from gateway.exchange.unit import FieldHit, FieldPlace, FieldRole, UnitMap
from gateway.modbus.pdu import (
    MAX_READ_REGISTERS,
    MAX_READ_WRITE_WRITE_REGISTERS,
    MAX_WRITE_REGISTERS,
    ExceptionCode,
    FunctionCode,
)


def prepare(request: Request) -> Rewriting:
    """Work out what is sent for a request. Nothing is changed until its reply is there.

    Raises:
        RefusedRequestError: the request must not reach the drive.
    """
    rewriting = Rewriting(request, request.pdu)
    for meaning in request.meanings:
        check_may_act(meaning)
    if request.access.write_quantity:
        _prepare_write(rewriting)
    runs = request.known.runs
    if runs:
        rewriting.runs = tuple(runs[m.axis.plan.name] for m in request.meanings if m.axis.plan.name in runs)
    if rewriting.renderings or rewriting.runs:
        targets = (*rewriting.renderings, *rewriting.runs)
        rewriting.losses = {id(target.shadow): target.shadow.losses for target in targets}
    if request.access.read_quantity:
        _prepare_read(request.unit, rewriting)
    return rewriting


def _prepare_write(rewriting: Rewriting) -> None:
    request, access = rewriting.request, rewriting.access
    hits = request.unit.written(access.write_address, access.write_quantity)
    stopped = {id(meaning.axis) for meaning in request.meanings if meaning.is_stop}
    changed: list[tuple[FieldHit, bytes]] = []
    commands: list[FieldHit] = []
    for hit in hits.fields:
        axis, role = hit.place.axis, hit.place.role
        if role is FieldRole.COMMAND:
            commands.append(hit)
        elif role is FieldRole.REMAPPING:
            _check_counts(hit, access)
            rewriting.remaps = True
        elif id(axis) not in stopped and not axis.passes_unchanged:
            if role is FieldRole.LIMIT:
                changed.append((hit, _stage_limit(hit, rewriting)))
            elif not (role is FieldRole.ACTUAL and hit.place.number in axis.plan.settable):
                _refuse_guarded(hit)
    if hits.is_unclear and any(not axis.passes_unchanged for axis in request.unit.axes) and not stopped:
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_ADDRESS,
            request.unit.axes[0].plan.name,
            f"a write at {access.write_address:#06x} runs over an object of unknown width into a mapped one",
        )
    if commands:
        rewriting.command_hits = tuple(commands)
        changed += prepare_commands(rewriting, commands)
    if changed:
        rewriting.sent_pdu = _written_pdu(rewriting.request.pdu, access, changed)


def _check_counts(hit: FieldHit, access: Access) -> None:
    """Refuse what no drive can obey: it must not end the compensation.

    Raises:
        RefusedRequestError: the counts of the request contradict each other, and its axis is corrected.
    """
    if not access.is_consistent and not hit.place.axis.passes_unchanged:
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_VALUE,
            hit.place.axis.plan.name,
            f"the counts of a write to {_at(hit)} contradict each other",
        )


def _stage_limit(hit: FieldHit, rewriting: Rewriting) -> bytes:
    """Render a limit; one of which a part is written alone is refused."""
    axis, shadow = hit.place.axis, hit.place.shadow
    assert shadow is not None
    if not (hit.is_whole and rewriting.access.is_consistent) or rewriting.access.is_mask:
        raise RefusedRequestError(
            ExceptionCode.SERVER_DEVICE_FAILURE,
            axis.plan.name,
            f"a part of the limit at {_at(hit)} was written: write all of it in one frame",
        )
    _, words = written_part(hit, rewriting.request.pdu, rewriting.access)
    try:
        corrected_words = render_limit(axis, hit.place.number, words)
    except RefusedPositionError as error:
        raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, axis.plan.name, str(error)) from error
    rewriting.stagings += (Staging(shadow, words, corrected_words, shadow.losses),)
    return corrected_words


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


def _written_pdu(pdu: bytes, access: Access, rendered: list[tuple[FieldHit, bytes]]) -> bytes:
    """Put rendered words into a request, widening it where it cuts a position (M1)."""
    axis = rendered[0][0].place.axis
    if not access.is_mask and (axis.writes_words_alone or all(hit.is_whole for hit, _ in rendered)):
        patched = bytearray(access.words(pdu))
        for hit, corrected_words in rendered:
            cut = max(0, -2 * hit.word)
            at = 2 * max(0, hit.word)
            part = corrected_words[cut : cut + len(patched) - at]
            patched[at : at + len(part)] = part
        return access.with_words(pdu, bytes(patched))
    span = Span(access.write_address, access.write_quantity)
    whole = span.widened([hit.place.field for hit, _ in rendered])
    words = bytearray(2 * whole.quantity)
    if not access.is_mask:
        at = 2 * (span.address - whole.address)
        words[at : at + 2 * span.quantity] = access.words(pdu)
    for hit, corrected_words in rendered:
        at = 2 * (hit.place.field.address - whole.address)
        words[at : at + len(corrected_words)] = corrected_words
    return _build_write(pdu, whole, bytes(words), axis)


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
    if axis.plan.writes_with is Form.FC06 and span.quantity == 1:
        return bytes((FunctionCode.WRITE_SINGLE_REGISTER,)) + head[:2] + words
    return bytes((FunctionCode.WRITE_MULTIPLE_REGISTERS,)) + head + words


def _prepare_read(unit: UnitMap, rewriting: Rewriting) -> None:
    access = rewriting.access
    span = Span(access.read_address, access.read_quantity)
    hits = unit.read(span.address, span.quantity)
    rewriting.read_hits, rewriting.read_span = hits, span
    if hits.is_unclear and any(not axis.passes_unchanged for axis in unit.axes):
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_ADDRESS,
            unit.axes[0].plan.name,
            f"a read at {span.address:#06x} runs over an object of unknown width into a mapped one",
        )
    if not hits.fields:
        return
    active: list[FieldPlace] = []
    readbacks: dict[str, Readback] = {}
    for hit in hits.fields:
        axis = hit.place.axis
        if not axis.reads_unchanged and hit.place.role.is_position:
            active.append(hit.place)
            readbacks[axis.plan.name] = axis.compensation.readback
    rewriting.readbacks = readbacks
    whole = span.widened([place.field for place in active])
    if whole == span or access.is_mei:
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
    rewriting.read_hits = unit.read(whole.address, whole.quantity)
