"""What is sent for a request, and what its controller gets for the reply (M1 to M5, M8, M10).

:func:`prepare` renders the positions that a request writes and makes cut ones whole; nothing of what it finds
counts before the request was acknowledged. :func:`turned_back` puts every position of a reply back on the
controller's scale.
"""

from collections.abc import Iterable
from collections.abc import Set as AbstractSet
from typing import Final

from gateway.drives.motion import Action, Form
from gateway.exchange.access import MEI_HEAD, Access, swapped
from gateway.exchange.axis.acknowledge import Outcome, Rendering
from gateway.exchange.axis.axis import MOVES_OTHERWISE, Axis
from gateway.exchange.axis.axis_request import Staging
from gateway.exchange.axis.motion import Keeping
from gateway.exchange.axis.registers import Completeness, NextPart
from gateway.exchange.events import EventKind
from gateway.exchange.meaning import Meaning
from gateway.exchange.plan import HOMED_BIT
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.rendering import (
    RefusedPositionError,
    Seen,
    base_of,
    is_place_untold,
    lacks_look,
    nominal_limit,
    render,
    render_distance,
    render_limit,
    render_repeat,
)
from gateway.exchange.request import (
    AxisWrite,
    Known,
    Request,
    Rewriting,
    Span,
    Standing,
    key_of,
    mask_written,
    part_of,
    written_part,
)
from gateway.exchange.unit import BitHit, FieldHit, FieldPlace, FieldRole, UnitMap
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.pdu import (
    EXCEPTION_BIT,
    MAX_READ_REGISTERS,
    MAX_READ_WRITE_WRITE_REGISTERS,
    MAX_WRITE_REGISTERS,
    ExceptionCode,
    FunctionCode,
    exception_pdu,
    is_exception,
)
from gateway.modbus.registers import BitTable

READS_BITS: Final = frozenset({FunctionCode.READ_COILS, FunctionCode.READ_DISCRETE_INPUTS})


# --- what is sent ------------------------------------------------------------------------------------------


def prepare(request: Request, *, has_stop: bool = False) -> Rewriting:
    """Work out what is sent for a request.

    ``has_stop``: its frame stops an axis, of this unit or another one, and passes whatever else it does (M3).
    A target that is not corrected for its run is flagged then.

    Of an axis that is brought up to date which its reply decides nothing of: terms that are due, and the
    offset with which a stream begins. The rest is done as the request leaves and as it ends.

    Raises:
        RefusedRequestError: the request must not reach the drive.
    """
    access = request.frame.access
    rewriting = Rewriting(request, request.frame.pdu)
    for meaning in request.meanings:
        if not has_stop:
            check_may_act(meaning)
        written = rewriting.of(meaning.axis)
        if has_stop and meaning.runs_alone and meaning.axis.plan.name not in request.known.runs:
            written.run_uncorrected()
    if access.write_quantity:
        _prepare_write(rewriting, has_stop=has_stop)
    for name, run in request.known.runs.items():
        if name in rewriting.by_axis:
            rewriting.by_axis[name].runs.append(_leaving(run, request.now_ns))
    rewriting.complete()
    for axis, written in rewriting.written:
        if axis.peers:
            written.peer_runs = request.known.peer_runs
        for target in (*written.targets, *written.runs):
            written.epochs[target.number] = axis.fields[target.number].epoch
    if access.read_quantity:
        _prepare_read(rewriting)
    return rewriting


def _leaving(run: Rendering, now_ns: int) -> Rendering:
    """Return what a trigger runs, as old as the trigger: its drive has not had the time to start before."""
    move = run.move
    return run if move is None else run._replace(move=move._replace(state=move.state._replace(at_ns=now_ns)))


def _prepare_write(rewriting: Rewriting, *, has_stop: bool) -> None:
    """Render what a request writes; refuse what it must not, unless it stops an axis."""
    request, frame, access = rewriting.request, rewriting.request.frame, rewriting.access
    stopped = [meaning.axis for meaning in request.meanings if meaning.is_stop]
    changed: list[tuple[FieldHit, bytes]] = []
    for own in frame.by_axis:
        axis = own.axis
        for hit in own.fields:
            role = hit.place.role
            if role is FieldRole.REMAPPING:
                _check_counts(hit, access)
                for each in frame.unit.axes:
                    rewriting.of(each).remap()
            elif role is not FieldRole.COMMAND and axis not in stopped and not axis.passes_unchanged:
                try:
                    changed += _prepare_other(rewriting, hit)
                except RefusedRequestError:
                    if not has_stop:
                        raise
                    _pass_blindly(rewriting, hit)
    if not (frame.is_clear or has_stop) and any(not axis.passes_unchanged for axis in frame.unit.axes):
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_ADDRESS,
            frame.unit.axes[0].plan.name,
            f"a write at {access.write_address:#06x} runs over an object of unknown width into a mapped one",
        )
    for own in frame.by_axis:
        if own.commands:
            rewriting.of(own.axis).parts.extend([part_of(hit, frame.pdu, access) for hit in own.commands])
    for write in request.writes:
        rewriting.of(write.axis).blind.extend(write.cut)
        try:
            changed += _prepare_commands(rewriting, write)
        except RefusedRequestError:
            if not has_stop:
                raise
            _pass_targets(rewriting, write)
    if changed:
        _send_rendered(rewriting, changed, has_stop=has_stop)


def _send_rendered(rewriting: Rewriting, changed: list[tuple[FieldHit, bytes]], *, has_stop: bool) -> None:
    """Send the rendered words; beside a stop all as it came, where there is no room for whole positions."""
    try:
        rewriting.send_instead(_written_pdu(rewriting.request.frame.pdu, rewriting.access, changed))
    except RefusedRequestError:
        if not has_stop:
            raise
        for hit, _ in changed:
            _pass_blindly(rewriting, hit)


def _prepare_other(rewriting: Rewriting, hit: FieldHit) -> list[tuple[FieldHit, bytes]]:
    """Render a limit, or refuse to write a position around the correction; return what goes out changed."""
    place = hit.place
    if place.role is FieldRole.LIMIT:
        return [(hit, _stage_limit(hit, rewriting))]
    if not (place.role is FieldRole.ACTUAL and place.number in place.axis.plan.settable):
        _refuse_guarded(hit)
    return []


def _pass_blindly(rewriting: Rewriting, hit: FieldHit) -> None:
    """Let a field go out as it came beside a stop: nobody knows what that makes of its axis (M3)."""
    written, image = rewriting.of(hit.place.axis), hit.place.image
    written.forget_targets()
    written.run_uncorrected()
    if image is not None:
        written.blind.append(image)


def _pass_targets(rewriting: Rewriting, write: AxisWrite) -> None:
    """Let the targets of an axis go out as they came beside a stop of another one (M3)."""
    written = rewriting.of(write.axis)
    written.forget_targets()
    for hit, words, is_run in write.fields:
        _pass_raw(rewriting, hit, words)
        if is_run:
            written.run_uncorrected()


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
    axis, image = hit.place.axis, hit.place.image
    assert image is not None
    if not (hit.is_whole and rewriting.access.is_consistent) or rewriting.access.is_mask:
        raise RefusedRequestError(
            ExceptionCode.SERVER_DEVICE_FAILURE,
            axis.plan.name,
            f"a part of the limit at {_at(hit)} was written: write all of it in one frame",
        )
    _, words = written_part(hit, rewriting.request.frame.pdu, rewriting.access)
    try:
        corrected_words = render_limit(axis, hit.place.number, words)
    except RefusedPositionError as error:
        raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, axis.plan.name, str(error)) from error
    rewriting.of(axis).stagings.append(Staging(image, words, corrected_words, image.epoch))
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


def _build_write(pdu: bytes, span: Span, words: bytes, axis: Axis) -> bytes:
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


def _prepare_read(rewriting: Rewriting) -> None:
    unit, access = rewriting.request.frame.unit, rewriting.access
    span = Span(access.read_address, access.read_quantity)
    hits = unit.read(span.address, span.quantity)
    rewriting.ask(hits, span)
    if hits.is_unclear and any(not axis.passes_unchanged for axis in unit.axes):
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_ADDRESS,
            unit.axes[0].plan.name,
            f"a read at {span.address:#06x} runs over an object of unknown width into a mapped one",
        )
    if not hits.fields:
        return
    active: list[FieldPlace] = []
    for hit in hits.fields:
        axis = hit.place.axis
        if not axis.reads_unchanged and hit.place.role.is_position:
            active.append(hit.place)
            rewriting.readbacks[axis.plan.name] = axis.compensation.readback
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
    rewriting.ask(unit.read(whole.address, whole.quantity), whole)
    rewriting.send_instead(pdu[:1] + head + pdu[5:])


# --- what must not run -------------------------------------------------------------------------------------


def check_may_act(meaning: Meaning) -> None:
    """Refuse what must not run: a stored position, a trigger whose target was lost.

    Raises:
        RefusedRequestError: with the exception code of the lost target, or 4.
    """
    axis = meaning.axis
    action = meaning.action
    if action is Action.STORED and not (axis.passes_unchanged or axis.plan.motion.passes_stored_moves):
        raise RefusedRequestError(
            ExceptionCode.SERVER_DEVICE_FAILURE,
            axis.plan.name,
            "it runs a position that the drive keeps, and nobody knows which correction that carries "
            '(stored_moves = "uncorrected" lets it pass)',
            EventKind.STORED_MOVE,
        )
    if meaning.is_stop or axis.passes_unchanged:
        return
    code = _blocking_code(meaning)
    if code is not None:
        raise RefusedRequestError(
            code,
            axis.plan.name,
            "a trigger, but a target, its mode or a part of it was lost before: write all of it again",
            EventKind.AXIS_BLOCKED,
        )


def _blocking_code(meaning: Meaning) -> int | None:
    """Return the exception code with which an action is refused; None where it may go on.

    What writes a whole target and runs it may go on, unless its mode was lost or another axis of the group
    has lost its target: the beam would rack.
    """
    axis, action = meaning.axis, meaning.action
    runs_unseen = meaning.runs_alone or (action is Action.UNKNOWN and not meaning.commands)
    if runs_unseen and axis.blocked_by is not None:
        return axis.blocked_by
    if not action.runs_target and action is not Action.UNKNOWN:
        return None
    mode = None if meaning.number is None else axis.plan.motion.mode(meaning.number)
    lost_mode = axis.rules.lost_mode(meaning.number)
    if lost_mode is not None and mode is not None and mode.address not in meaning.words:
        return lost_mode
    return axis.blocked_by_peer if action.runs_target else None


# --- targets that the drive goes to --------------------------------------------------------------------


def _prepare_commands(rewriting: Rewriting, write: AxisWrite) -> list[tuple[FieldHit, bytes]]:
    """Render the command fields of one axis: those that run, then those that the drive only holds.

    Returns:
        The fields whose words go out changed, with all their corrected words.

    Raises:
        RefusedRequestError: the request must not reach the drive.
    """
    request, axis, action = rewriting.request, write.axis, write.action
    written = rewriting.of(axis)
    changed: list[tuple[FieldHit, bytes]] = []
    if action in MOVES_OTHERWISE:
        for hit, words, _ in write.fields:
            _pass_raw(rewriting, hit, words)
        return changed
    for hit, words, is_run in write.fields:
        if not is_run:
            continue
        number, image = hit.place.number, hit.place.image
        assert image is not None
        # What was refused before would run with it (M3): the trigger is in this frame, or is this word.
        runs_lost_part = image.is_torn and not hit.is_whole and axis.plan.motion.waits_for_trigger
        if words is None or (runs_lost_part and image.completeness is Completeness.PART_REFUSED):
            _refuse_unknown(rewriting, hit)
            continue
        rendering: Rendering | None
        try:
            if write.is_again and not lacks_look(axis, seen(request, axis)):
                rendering = render_repeat(axis, number)
            elif action.is_relative:
                rendering = render_relative(request, axis, number, words, action)
            else:
                rendering = render(axis, number, words, seen(request, axis))
        except RefusedPositionError as error:
            if axis.passes_unchanged:
                written.blind.append(image)
                continue
            name = axis.plan.name
            raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, name, str(error)) from error
        is_complete = _is_complete(hit, rewriting.access)
        if rendering is None:  # a distance passes as it is, and nobody knows where it leads
            written.stagings.append(Staging(image, words, words, image.epoch))
            written.go_anywhere()
            if not is_complete:
                changed.append((hit, words))
            continue
        written.targets.append(rendering)
        if not (axis.passes_unchanged and is_complete) or rendering.corrected_words != words:
            changed.append((hit, rendering.corrected_words))
    for hit, words, is_run in write.fields:
        if not is_run:
            assert write.meaning is not None
            changed += _stage(rewriting, write.meaning, hit, words)
    return changed


def seen(request: Request, axis: Axis) -> Seen:
    """Return what a target is rendered with: the time, and an actual position that was read for it."""
    fresh = request.known.actual.get(axis.plan.name)
    return Seen(request.now_ns, fresh, is_place_untold(axis, request.known))


def render_relative(
    request: Request, axis: Axis, number: int, words: bytes, action: Action
) -> Rendering | None:
    """Render a relative move; None where it passes as it is, and nobody knows where it leads.

    Raises:
        RefusedPositionError: where it would end must not be gone to (M8).
        RefusedRequestError: nobody knows where it starts (M5).
    """
    base = base_of(axis, action, request.known)
    is_passing = axis.passes_unchanged
    if base is not None:
        return render_distance(axis, number, words, base, seen(request, axis), is_passing=is_passing)
    if is_passing:
        return None
    is_moving = request.known.standing.get(axis.plan.name) is Standing.MOVES
    why = "the axis moves" if is_moving else "nothing tells where the axis is"
    if axis.plan.motion.passes_unknown_relative:
        axis.tell(EventKind.BASE_UNKNOWN, f"a relative move passed unchanged: {why}")
        return None
    raise RefusedRequestError(
        ExceptionCode.SERVER_DEVICE_BUSY,
        axis.plan.name,
        f'a relative move, and {why} (relative_unknown = "pass" lets it through unchanged)',
        EventKind.BASE_UNKNOWN,
    )


# --- targets that the drive only holds -----------------------------------------------------------------


def _pass_raw(rewriting: Rewriting, hit: FieldHit, words: bytes | None) -> None:
    """Let words go out as they came: in a stop, homing or unknown frame they are no target (M2)."""
    axis, image = hit.place.axis, hit.place.image
    assert image is not None
    if words is None:
        rewriting.of(axis).blind.append(image)
        return
    access, in_drive = rewriting.access, None
    is_whole = hit.is_whole and not access.is_mask
    if is_whole or (axis.passes_unchanged and _is_complete(hit, access)):
        in_drive = words
    elif not access.is_mask:
        in_drive = _merged(image.corrected_words, *written_part(hit, rewriting.request.frame.pdu, access))
    written = mask_written(hit, rewriting.request.frame.pdu, access)
    rewriting.of(axis).stagings.append(Staging(image, words, in_drive, image.epoch, written))


def _is_complete(hit: FieldHit, access: Access) -> bool:
    """Whether the drive holds what its controller means once a write of a position went out as it came.

    What a part or a mask leaves as it is has to stand there as the controller wrote it: not corrected, and
    no word of it lost.
    """
    image = hit.place.image
    assert image is not None
    is_whole = hit.is_whole and not access.is_mask
    return is_whole or not (image.may_be_corrected or image.is_torn)


def _stage(
    rewriting: Rewriting, meaning: Meaning, hit: FieldHit, words: bytes | None
) -> list[tuple[FieldHit, bytes]]:
    """Render a staged target as well as it can be foreseen; its trigger computes it anew (M2)."""
    axis, image, request = hit.place.axis, hit.place.image, rewriting.request
    assert image is not None
    if words is None:
        is_refused = image.next_part(request.arrived_ns) is NextPart.REFUSED
        if rewriting.access.is_mask or is_refused or not rewriting.access.is_consistent:
            _refuse_unknown(rewriting, hit)
        else:  # its trigger is refused until the other parts have come
            part = part_of(hit, request.frame.pdu, rewriting.access)
            rewriting.of(axis).buffered_parts.append(part)
        return []
    mask = mask_written(hit, request.frame.pdu, rewriting.access)
    motion = axis.motion
    kept = motion.superseded if motion.keeping(hit.place.number, words) is Keeping.SAME_WORDS else None
    waits_for_other_words = bool(axis.plan.motion.starts_on) and not hit.is_whole
    is_complete = _is_complete(hit, rewriting.access) or axis.writes_words_alone
    if waits_for_other_words or (axis.passes_unchanged and is_complete and kept is None):
        _pass_raw(rewriting, hit, words)
        return []
    if axis.passes_unchanged and kept is None:
        rewriting.of(axis).stagings.append(Staging(image, words, words, image.epoch, mask))
        return [(hit, words)]
    corrected_words = _foreseen(request, meaning, hit, words) if kept is None else kept.corrected_words
    in_drive: bytes | None = corrected_words
    if axis.writes_words_alone and not hit.is_whole:
        first, written = written_part(hit, request.frame.pdu, rewriting.access)
        in_drive = _merged(
            image.corrected_words, first, corrected_words[2 * first : 2 * first + len(written)]
        )
    rewriting.of(axis).stagings.append(Staging(image, words, in_drive, image.epoch, mask))
    return [(hit, corrected_words)]


def _foreseen(request: Request, meaning: Meaning, hit: FieldHit, words: bytes) -> bytes:
    axis, number, image = hit.place.axis, hit.place.number, hit.place.image
    assert image is not None
    now = Seen(request.now_ns, None)
    spec = axis.spec_of_words(number, words)
    is_kept = spec is None or axis.may_keep_words(spec)
    # Its trigger would write it anew; one that may not runs what is written now, so that is made anew here.
    is_kept &= axis.plan.added_frames
    if is_kept and image.nominal_words == words and image.corrected_words is not None and not image.is_torn:
        return image.corrected_words
    if axis.motion.keeping(number, words) is Keeping.UNSEEN:
        return words  # its trigger is refused until a reading tells what it is
    action, is_certain = _expected(meaning, number)
    try:
        if action.is_relative:
            base = base_of(axis, action, Known())
            if base is None:
                return words
            return render_distance(axis, number, words, base, now, is_passing=False).corrected_words
        if action is Action.ABSOLUTE or action is Action.FOLLOW:
            return render(axis, number, words, now).corrected_words
    except RefusedPositionError as error:
        if is_certain:
            raise RefusedRequestError(
                ExceptionCode.SERVER_DEVICE_FAILURE, axis.plan.name, str(error)
            ) from error
    return words


def may_run_distances(axis: Axis) -> bool:
    """Whether a trigger of an axis may run what it holds as a distance."""
    triggers = axis.plan.motion.triggers
    return any(deed.action.is_relative for trigger in triggers for deed in trigger.deeds.values())


def _expected(meaning: Meaning, number: int) -> tuple[Action, bool]:
    """Return how a staged target will probably be run, and whether that is certain enough to refuse it."""
    axis = meaning.axis
    motion = axis.plan.motion
    mode = motion.mode(number)
    if mode is None:
        return (axis.last_run, False) if may_run_distances(axis) else (Action.ABSOLUTE, True)
    word = meaning.words.get(mode.address, axis.rules.word(mode.address))
    action = Action.UNKNOWN if word is None or mode.is_in_frame else mode.action(word)
    is_same_frame = mode.address in meaning.words
    return (Action.ABSOLUTE if action is Action.START else action), is_same_frame


def _merged(words: bytes | None, first: int, part: bytes) -> bytes | None:
    if words is None:
        return None
    return words[: 2 * first] + part + words[2 * first + len(part) :]


# --- parts whose rest is not known ---------------------------------------------------------------------


def _refuse_unknown(rewriting: Rewriting, hit: FieldHit) -> None:
    """Refuse a write that leaves a position nobody knows, unless the axis passes 1:1.

    Then too where it leaves words of the drive as they are that may be corrected ones.

    Raises:
        RefusedRequestError: unless it may pass.
    """
    axis, image = hit.place.axis, hit.place.image
    assert image is not None
    is_whole = hit.is_whole and not rewriting.access.is_mask
    if axis.passes_unchanged and (is_whole or not image.may_be_corrected):
        rewriting.of(axis).blind.append(image)
        return
    if not rewriting.access.is_consistent:
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_VALUE,
            axis.plan.name,
            f"the counts of a write to {_at(hit)} contradict each other",
        )
    reason = _why_incomplete(hit, rewriting.request)
    raise RefusedRequestError(
        ExceptionCode.SERVER_DEVICE_FAILURE,
        axis.plan.name,
        reason,
        is_too_early=image.completeness is not Completeness.PART_REFUSED,
    )


def _why_incomplete(hit: FieldHit, request: Request) -> str:
    if hit.place.image is not None and hit.place.image.is_torn:
        return f"a part of the position at {_at(hit)} was lost before: write all of it again"
    if request.frame.access.is_mask or key_of(hit) not in request.known.command_words:
        return f"part of the position at {_at(hit)} was written and the rest is not known"
    return (
        f"part of the position at {_at(hit)} was written and the rest is not certain: what the drive holds "
        "may lie across a word's border from what was commanded; write all of it in one frame"
    )


# --- the reply ---------------------------------------------------------------------------------------------


def outcome_of(rewriting: Rewriting, reply: bytes) -> tuple[Outcome, int]:
    """Return how a request ended that was replied to, and the exception code that stands for it (M7)."""
    if _acknowledges(rewriting, reply):
        return Outcome.ACKNOWLEDGED, 0
    if len(reply) == 2 and reply[0] == rewriting.sent_pdu[0] | EXCEPTION_BIT:
        return Outcome.EXCEPTION, reply[1]
    return Outcome.OTHER_REPLY, ExceptionCode.SERVER_DEVICE_FAILURE


def reply_without_positions(rewriting: Rewriting, reply: bytes, *, is_acknowledged: bool) -> bytes:
    """Return what the controller gets for a reply that carries no positions (W4).

    An acknowledgement becomes the echo that belongs to its own request. What is none passes untouched; of a
    request that was sent in another form, as an exception in the form that was asked.
    """
    pdu = rewriting.request.frame.pdu
    asked, sent = pdu[0], rewriting.sent_pdu[0]
    if is_acknowledged:
        if asked == FunctionCode.WRITE_MULTIPLE_REGISTERS:
            return pdu[:5]
        is_echoed = asked in (FunctionCode.WRITE_SINGLE_REGISTER, FunctionCode.MASK_WRITE_REGISTER)
        return pdu if is_echoed else reply
    if asked == sent:
        return reply
    is_refusal = len(reply) == 2 and is_exception(reply)
    return exception_pdu(asked, reply[1] if is_refusal else ExceptionCode.SERVER_DEVICE_FAILURE)


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


def turned_back(rewriting: Rewriting, reply: bytes) -> bytes:
    """Return a reply to a read with every position on the controller's scale."""
    access = rewriting.access
    head = MEI_HEAD if access.is_mei else 2
    data = bytearray(swapped(reply[head:]) if access.is_mei else reply[head:])
    try:
        for hit in rewriting.read_hits.fields:
            if hit.is_whole and hit.place.role.is_position:
                _turn_field_back(hit, rewriting, data)
    except RegisterRangeError:
        return exception_pdu(rewriting.request.frame.pdu[0], ExceptionCode.SERVER_DEVICE_FAILURE)
    note_bits(rewriting.read_hits.bits, data, sent_somewhere(rewriting), rewriting.request.now_ns)
    if access.is_mei:
        return reply[:head] + swapped(bytes(data)) if rewriting.read_hits.fields else reply
    skip = 2 * (access.read_address - rewriting.read_span.address)
    asked = data[skip : skip + 2 * access.read_quantity]
    return bytes((reply[0], len(asked))) + bytes(asked)


def _turn_field_back(hit: FieldHit, rewriting: Rewriting, data: bytearray) -> None:
    place = hit.place
    axis, at, end = place.axis, 2 * hit.word, 2 * (hit.word + place.field.words)
    words = bytes(data[at:end])
    readback = rewriting.readbacks.get(axis.plan.name)
    if readback is not None and any(each.targets for each in rewriting.by_axis.values()):
        readback = axis.compensation.readback  # FC23 writes before it reads
    if place.role is FieldRole.ACTUAL and place.number == 0:
        was_undecided = axis.is_recalling
        axis.observe_actual(place.field, words, rewriting.request.now_ns)  # as old as its request
        if was_undecided and readback is not None:
            readback = axis.compensation.readback  # nothing else was in force when the request was sent
    if readback is None:
        return
    if place.role is FieldRole.COMMAND and place.image is not None:
        data[at:end] = axis.read_command_words(place.number, place.field, words, readback)
    elif place.role is FieldRole.LIMIT and place.image is not None:
        data[at:end] = nominal_limit(axis, place.number, words)
    else:
        data[at:end] = axis.nominal_words(place.field, words, readback)


def sent_somewhere(rewriting: Rewriting) -> set[str]:
    """Return the names of the axes that a request sends somewhere."""
    return {name for name, written in rewriting.by_axis.items() if written.sends_somewhere}


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
            axis.observe_bit(name, asked_ns, is_set=is_set)
