"""What has to be read or written before a request can be sent (M2, M5, M6, W8)."""

from gateway.drives.motion import Action, Addressing
from gateway.exchange.added_frames import (
    AddedFrame,
    Purpose,
    homed_read,
    read_field,
    read_word,
    restage,
)
from gateway.exchange.axis import AxisExchange, Rendering
from gateway.exchange.commands import is_again, render_relative, seen
from gateway.exchange.effects import check_may_act
from gateway.exchange.events import EventKind
from gateway.exchange.field_counts import counts_of
from gateway.exchange.meaning import Meaning
from gateway.exchange.parts import nominal_words
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.relative import base_of, next_base_read
from gateway.exchange.rendering import (
    RefusedPositionError,
    as_it_came,
    is_repeat,
    needs_actual,
    needs_look,
    render,
)
from gateway.exchange.request import Request
from gateway.exchange.unit import FieldHit, FieldRole
from gateway.modbus.pdu import ExceptionCode
from gateway.modbus.registers import FieldAccess


def next_frame(request: Request) -> AddedFrame | None:
    """Return the next frame that must be exchanged before this request can be sent, if any.

    Raises:
        RefusedRequestError: the request must not reach the drive.
    """
    if any(meaning.is_stop for meaning in request.meanings):
        return None  # a stop waits for nothing
    added = _reference_read(request) if request.unit.asks_for_bits else None
    if added is not None:
        return added
    for meaning in request.meanings:
        if meaning.needs_word is not None and not meaning.axis.passes_unchanged:
            return read_word(meaning.axis, meaning.needs_word)
    if request.access.write_quantity and request.access.is_consistent:
        added = _command_read(request)
        if added is not None:
            return added
    for meaning in request.meanings:
        added = None
        if meaning.runs_alone:
            added = _prepare_run(request, meaning)
        elif meaning.action is Action.UNKNOWN and not meaning.commands:
            added = _prepare_unknown(meaning)
        if added is not None:
            return added
    return None


def _reference_read(request: Request) -> AddedFrame | None:
    unit, access, known, now_ns = request.unit, request.access, request.known, request.now_ns
    written = unit.written(access.write_address, access.write_quantity).fields
    read = unit.read(access.read_address, access.read_quantity).fields
    targets = [meaning.axis for meaning in request.meanings if meaning.action.runs_target]
    targets += [hit.place.axis for hit in written if hit.place.role is FieldRole.COMMAND]
    others = [hit.place.axis for hit in (*written, *read)]
    for axis, is_target in (*((a, True) for a in targets), *((a, False) for a in others)):
        if axis.plan.name not in known.references and axis.needs_reference(now_ns, is_target=is_target):
            added = homed_read(axis)
            if added is not None:
                return added
    return None


def _command_read(request: Request) -> AddedFrame | None:
    access = request.access
    meanings = {id(meaning.axis): meaning for meaning in request.meanings}
    written = request.unit.written(access.write_address, access.write_quantity).fields
    hits = [hit for hit in written if hit.place.role is FieldRole.COMMAND and hit.place.axis.may_read]
    for hit in hits:
        own = [other for other in hits if other.place.axis is hit.place.axis]
        added = _read_for(request, hit, own, meanings.get(id(hit.place.axis)))
        if added is not None:
            return added
    return None


def _read_for(
    request: Request, hit: FieldHit, own: list[FieldHit], meaning: Meaning | None
) -> AddedFrame | None:
    """Return what must be read for one of the command fields of its axis that a request writes."""
    place, access, known = hit.place, request.access, request.known
    axis, shadow, field = place.axis, place.shadow, place.field
    assert shadow is not None
    words = nominal_words(hit, request)
    if words is None:
        if axis.passes_unchanged or shadow.is_torn or access.is_mask or id(shadow) in known.command_words:
            return None
        is_object = axis.plan.addressing is Addressing.OBJECTS
        if field.access is FieldAccess.WRITE or field.block is not None or is_object:
            return None  # what is read there is something else
        return AddedFrame(axis, Purpose.COMMAND, field.address, field.words, hit)
    if meaning is not None and hit not in meaning.running:
        return None
    action = Action.ABSOLUTE if meaning is None else meaning.action
    is_doubtful = axis.arrival.may_have_left or needs_look(axis, request.now_ns, action)
    if axis.motion.plan.waits_for_trigger or action.is_relative or is_doubtful:
        return _read_for_run(request, axis, place.number, words, action)
    if is_repeat(axis, shadow, words):
        written = [(each, nominal_words(each, request)) for each in own]
        if is_again(axis, written):
            return None
    return _read_for_run(request, axis, place.number, words, action)


def _read_for_run(
    request: Request, axis: AxisExchange, number: int, words: bytes, action: Action
) -> AddedFrame | None:
    """Return what must be read before a whole target can be rendered."""
    known = request.known
    actual = axis.asked_actual
    if actual is not None and axis.plan.name not in known.actual and needs_look(axis, request.now_ns, action):
        return read_field(axis, Purpose.LOOK, actual)
    field = axis.plan.command[number]
    counts = counts_of(field, field.unpack(words))
    if action.is_relative:
        if axis.passes_unchanged:
            return None
        added = next_base_read(axis, action, known)
        base = base_of(axis, action, known)
        if added is not None or base is None or base.is_standing or not counts:
            return added
        counts += base.nominal_counts
    if actual is None or axis.plan.name in known.actual or not needs_actual(axis, counts, request.now_ns):
        return None
    return read_field(axis, Purpose.ACTUAL, actual)


def _prepare_run(request: Request, meaning: Meaning) -> AddedFrame | None:
    """Correct a staged target for its trigger; return the next frame that this takes.

    Raises:
        RefusedRequestError: the trigger must not reach the drive.
    """
    axis, name = meaning.axis, meaning.axis.plan.name
    check_may_act(meaning)
    known = request.known
    rendering = known.runs.get(name)
    if rendering is None:
        words = _staged_words(meaning)
        if words is None:
            return None
        assert meaning.number is not None
        if not axis.passes_unchanged:
            added = _read_for_run(request, axis, meaning.number, words, meaning.action)
            if added is not None:
                return added
        rendering = _render_run(request, meaning, words)
        if rendering is None:
            return None
        known.runs[name] = rendering
    is_as_written = rendering.corrected_words == rendering.nominal_words
    if axis.passes_unchanged and is_as_written and not rendering.shadow.may_be_corrected:
        return None
    return _restage(rendering)


def _prepare_unknown(meaning: Meaning) -> AddedFrame | None:
    """Give the drive the words that the controller wrote before something runs that nobody knows (M2)."""
    axis = meaning.axis
    check_may_act(meaning)
    number = axis.motion.staged if meaning.number is None else meaning.number
    if number is None:
        return None
    shadow = axis.shadows[number]
    if not shadow.may_be_corrected:
        return None
    if shadow.nominal_words is None or shadow.is_torn:
        if meaning.number is None:  # a value that nobody knows may be anything; this one runs the target
            return None
        raise _not_ours(axis)
    return _restage(as_it_came(axis, shadow))


def _restage(rendering: Rendering) -> AddedFrame | None:
    added = restage(rendering)
    if added is not None and rendering.is_distance and _starts(added):
        raise RefusedRequestError(
            ExceptionCode.SERVER_DEVICE_FAILURE,
            rendering.axis.plan.name,
            "the distance has to be written anew, and writing it starts the move: write it in the frame that "
            "runs it",
        )
    if added is not None and not rendering.axis.plan.added_frames:
        raise RefusedRequestError(
            ExceptionCode.SERVER_DEVICE_FAILURE,
            rendering.axis.plan.name,
            'the staged target has to be written anew for its trigger, and added_frames = "never" forbids it',
        )
    return added


def _starts(added: AddedFrame) -> bool:
    written = range(added.address, added.address + added.quantity)
    return any(address in written for address in added.axis.motion.plan.starts_on)


def _staged_words(meaning: Meaning) -> bytes | None:
    """Return the nominal words of the target that a trigger runs; None where it may pass without.

    Raises:
        RefusedRequestError: nobody knows what the drive would run.
    """
    axis, number = meaning.axis, meaning.number
    shadow = None if number is None else axis.shadows[number]
    if shadow is not None and shadow.nominal_words is not None and not shadow.is_torn:
        return shadow.nominal_words
    is_as_written = axis.passes_unchanged and not (shadow and shadow.may_be_corrected)
    if is_as_written or axis.motion.plan.passes_stored_moves:
        return None
    raise _not_ours(axis)


def _not_ours(axis: AxisExchange) -> RefusedRequestError:
    return RefusedRequestError(
        ExceptionCode.SERVER_DEVICE_FAILURE,
        axis.plan.name,
        "a trigger, and its target was not written through the gateway: write it again "
        '(stored_moves = "uncorrected" lets it pass)',
        EventKind.STORED_MOVE,
    )


def _render_run(request: Request, meaning: Meaning, words: bytes) -> Rendering | None:
    axis, number, name = meaning.axis, meaning.number, meaning.axis.plan.name
    assert number is not None
    try:
        if meaning.action.is_relative:
            rendering = render_relative(request, axis, number, words, meaning.action)
            return rendering or as_it_came(axis, axis.shadows[number])
        return render(axis, number, words, seen(request, axis))
    except RefusedPositionError as error:
        if axis.passes_unchanged:
            return None
        raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, name, str(error)) from error
