"""What is sent for a request (M1 to M5, M8, M10).

:func:`prepare` renders the positions that a request writes and completes partial ones. Its results count only
after the drive has acknowledged the request.
"""

from gateway.catalogue import exchange_events, refusals
from gateway.catalogue.entry import RefusalEntry
from gateway.drives.motion import Action, Form
from gateway.exchange.access import Access
from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.axis import MOVES_OTHERWISE, Axis
from gateway.exchange.axis.interlock import Block
from gateway.exchange.axis.motion import RepeatKind
from gateway.exchange.axis.registers import Completeness, NextPart
from gateway.exchange.decode import AxisCommand, Staging
from gateway.exchange.kept_words import may_keep_words, spec_of_words
from gateway.exchange.refusal import RefusedRequestError, refused
from gateway.exchange.render import (
    RefusedPositionError,
    RenderContext,
    base_of,
    is_position_withheld,
    lacks_poll,
    render,
    render_distance,
    render_limit,
    render_repeat,
)
from gateway.exchange.request import (
    Prefetched,
    Request,
    Span,
    Standstill,
    key_of,
    mask_written,
    part_of,
    written_part,
)
from gateway.exchange.unit import FieldHit, FieldRole, MappedField
from gateway.modbus.pdu import (
    MAX_READ_REGISTERS,
    MAX_READ_WRITE_WRITE_REGISTERS,
    MAX_WRITE_REGISTERS,
    ExceptionCode,
    FunctionCode,
)

# --- what is sent ------------------------------------------------------------------------------------------


def prepare(request: Request, *, has_stop: bool = False) -> None:
    """Compute what is sent for a request.

    ``has_stop``: its frame stops an axis, of this unit or another one, and passes whatever else it does (M3).
    A target that is not corrected for its run is flagged then.

    Two things of an axis that do not depend on the reply are updated here: terms that are due, and the offset
    with which a stream begins. All else is done when the request is sent and when it ends.

    Raises:
        RefusedRequestError: the request must not reach the drive.
    """
    access = request.frame.access
    runs = request.prefetched.runs
    for command in request.commands:
        if not has_stop:
            check_may_act(request, command)
        elif command.runs_alone and command.axis.plan.name not in runs:
            command.run_uncorrected()
    if access.write_quantity:
        _prepare_write(request, has_stop=has_stop)
    for command in request.commands:
        axis = command.axis
        if axis.plan.name in runs:
            command.runs.append(_leaving(runs[axis.plan.name], request.now_ns))
        if axis.peers:
            command.peer_runs = request.prefetched.peer_runs
        for target in (*command.targets, *command.runs):
            command.epochs[target.number] = axis.fields[target.number].epoch
    if access.read_quantity:
        try:
            _prepare_read(request)
        except RefusedRequestError as error:
            if not has_stop:
                raise
            request.read_refusal = error


def _leaving(run: Rendering, now_ns: int) -> Rendering:
    """Return what a trigger runs, with the time of the trigger: the drive could not start earlier."""
    move = run.move
    return run if move is None else run._replace(move=move._replace(state=move.state._replace(at_ns=now_ns)))


def _prepare_write(request: Request, *, has_stop: bool) -> None:
    """Render what a request writes; refuse what it must not write, unless it stops an axis."""
    frame, access = request.frame, request.frame.access
    stopped = [command.axis for command in request.commands if command.is_stop] if has_stop else []
    changed: list[tuple[FieldHit, bytes]] = []
    for own in frame.by_axis:
        axis = own.axis
        for hit in own.fields:
            role = hit.mapped.role
            if role is FieldRole.REMAPPING:
                _check_counts(hit, access)
                for each in frame.unit.axes:
                    request.of(each).remaps = True
            elif role is not FieldRole.COMMAND and axis not in stopped and not axis.passes_unchanged:
                try:
                    changed += _prepare_other(request, hit)
                except RefusedRequestError:
                    if not has_stop:
                        raise
                    _pass_blindly(request, hit)
    if not (frame.is_clear or has_stop) and any(not axis.passes_unchanged for axis in frame.unit.axes):
        name = frame.unit.axes[0].plan.name
        raise refused(refusals.UNKNOWN_WIDTH, name, access="write", address=access.write_address)
    for own in frame.by_axis:
        if own.commands:
            parts = request.of(own.axis).parts
            for hit in own.commands:
                parts.append(part_of(hit, frame.pdu, access))
    for command in request.commands:
        command.untracked.extend(command.partly_written)
        try:
            changed += _prepare_targets(request, command)
        except RefusedRequestError:
            if not has_stop:
                raise
            _pass_targets(request, command)
    if changed:
        _send_rendered(request, changed, has_stop=has_stop)


def _send_rendered(request: Request, changed: list[tuple[FieldHit, bytes]], *, has_stop: bool) -> None:
    """Send the rendered words; with a stop everything unchanged, if complete positions do not fit."""
    try:
        request.send_instead(_written_pdu(request.frame.pdu, request.frame.access, changed))
    except RefusedRequestError:
        if not has_stop:
            raise
        for hit, _ in changed:
            _pass_blindly(request, hit)


def _prepare_other(request: Request, hit: FieldHit) -> list[tuple[FieldHit, bytes]]:
    """Render a limit, or refuse a write that would bypass the correction; return what is sent differently."""
    mapped = hit.mapped
    if mapped.role is FieldRole.LIMIT:
        return [(hit, _stage_limit(hit, request))]
    if not (mapped.role is FieldRole.ACTUAL and mapped.number in mapped.axis.plan.settable):
        _refuse_guarded(hit)
    return []


def _pass_blindly(request: Request, hit: FieldHit) -> None:
    """Send a field unchanged together with a stop: the effect on its axis is unknown (M3)."""
    written, image = request.of(hit.mapped.axis), hit.mapped.image
    written.forget_targets()
    written.run_uncorrected()
    if image is not None:
        written.untracked.append(image)


def _pass_targets(request: Request, command: AxisCommand) -> None:
    """Send the targets of an axis unchanged together with a stop of another one (M3)."""
    command.forget_targets()
    for hit, words, is_run in command.writes:
        _pass_raw(request, hit, words)
        if is_run:
            command.run_uncorrected()


def _check_counts(hit: FieldHit, access: Access) -> None:
    """Refuse a frame that no drive can execute: it must not end the compensation.

    Raises:
        RefusedRequestError: the counts in the request contradict each other, and its axis is corrected.
    """
    if not access.is_consistent and not hit.mapped.axis.passes_unchanged:
        raise refused(refusals.COUNTS_CONTRADICT, hit.mapped.axis.plan.name, register=_at(hit))


def _stage_limit(hit: FieldHit, request: Request) -> bytes:
    """Render a limit; a partial write of one is refused."""
    axis, image = hit.mapped.axis, hit.mapped.image
    assert image is not None
    if not (hit.is_whole and request.frame.access.is_consistent) or request.frame.access.is_mask:
        raise refused(refusals.PART_OF_LIMIT, axis.plan.name, register=_at(hit))
    _, words = written_part(hit, request.frame.pdu, request.frame.access)
    try:
        corrected_words = render_limit(axis, hit.mapped.number, words)
    except RefusedPositionError as error:
        raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, axis.plan.name, str(error)) from error
    request.of(axis).stagings.append(Staging(image, words, corrected_words, image.epoch))
    return corrected_words


def _refuse_guarded(hit: FieldHit) -> None:
    """Refuse a write of a position that would bypass the correction (M10).

    Raises:
        RefusedRequestError: unless the axis lets such writes pass.
    """
    plan = hit.mapped.axis.plan
    address = hit.mapped.field.address
    if hit.mapped.role is not FieldRole.GUARDED:
        raise refused(refusals.REPORTS_A_POSITION, plan.name, address=address)
    if not plan.passes_unmapped:
        raise refused(refusals.NOT_MAPPED, plan.name, address=address)


def _at(hit: FieldHit) -> str:
    return f"register {hit.mapped.field.address:#06x}"


def _written_pdu(pdu: bytes, access: Access, rendered: list[tuple[FieldHit, bytes]]) -> bytes:
    """Put rendered words into a request, and widen it to complete positions (M1)."""
    axis = rendered[0][0].mapped.axis
    if not access.is_mask and (axis.writes_words_alone or all(hit.is_whole for hit, _ in rendered)):
        patched = bytearray(access.words(pdu))
        for hit, corrected_words in rendered:
            skipped = max(0, -2 * hit.word)
            at = 2 * max(0, hit.word)
            part = corrected_words[skipped : skipped + len(patched) - at]
            patched[at : at + len(part)] = part
        return access.with_words(pdu, bytes(patched))
    span = Span(access.write_address, access.write_quantity)
    whole = span.widened([hit.mapped.field for hit, _ in rendered])
    words = bytearray(2 * whole.quantity)
    if not access.is_mask:
        at = 2 * (span.address - whole.address)
        words[at : at + 2 * span.quantity] = access.words(pdu)
    for hit, corrected_words in rendered:
        at = 2 * (hit.mapped.field.address - whole.address)
        words[at : at + len(corrected_words)] = corrected_words
    return _build_write(pdu, whole, bytes(words), axis)


def _build_write(pdu: bytes, span: Span, words: bytes, axis: Axis) -> bytes:
    is_read_write = pdu[0] == FunctionCode.READ_WRITE_MULTIPLE_REGISTERS
    limit = min(
        axis.plan.max_registers, MAX_READ_WRITE_WRITE_REGISTERS if is_read_write else MAX_WRITE_REGISTERS
    )
    if span.quantity > limit:
        raise refused(refusals.WRITE_CUTS, axis.plan.name, quantity=span.quantity, limit=limit)
    head = span.address.to_bytes(2, "big") + span.quantity.to_bytes(2, "big") + bytes((len(words),))
    if is_read_write:
        return pdu[:5] + head + words
    if axis.plan.writes_with is Form.FC06 and span.quantity == 1:
        return bytes((FunctionCode.WRITE_SINGLE_REGISTER,)) + head[:2] + words
    return bytes((FunctionCode.WRITE_MULTIPLE_REGISTERS,)) + head + words


def _prepare_read(request: Request) -> None:
    unit, access = request.frame.unit, request.frame.access
    span = Span(access.read_address, access.read_quantity)
    hits = unit.read(span.address, span.quantity)
    request.ask(hits, span)
    if hits.is_unclear and any(not axis.passes_unchanged for axis in unit.axes):
        name = unit.axes[0].plan.name
        raise refused(refusals.UNKNOWN_WIDTH, name, access="read", address=span.address)
    if not hits.fields:
        return
    active: list[MappedField] = []
    for hit in hits.fields:
        axis = hit.mapped.axis
        if not axis.reads_unchanged and hit.mapped.role.is_position:
            active.append(hit.mapped)
            request.readbacks[axis.plan.name] = axis.compensation.readback
    whole = span.widened([mapped.field for mapped in active])
    if whole == span or access.is_mei:
        return
    limit = min(MAX_READ_REGISTERS, *(mapped.axis.plan.max_registers for mapped in active))
    if whole.quantity > limit:
        raise refused(refusals.READ_CUTS, active[0].axis.plan.name, quantity=whole.quantity, limit=limit)
    pdu = request.sent_pdu
    head = whole.address.to_bytes(2, "big") + whole.quantity.to_bytes(2, "big")
    request.ask(unit.read(whole.address, whole.quantity), whole)
    request.send_instead(pdu[:1] + head + pdu[5:])


# --- what must not run -------------------------------------------------------------------------------------


def check_may_act(request: Request, command: AxisCommand) -> None:
    """Refuse what must not run: a stored position, a trigger whose target was lost.

    Raises:
        RefusedRequestError: with the exception code of the lost target, or 4.
    """
    axis = command.axis
    action = command.action
    if action is Action.STORED and not (axis.passes_unchanged or axis.plan.motion.passes_stored_moves):
        raise refused(refusals.KEPT_POSITION, axis.plan.name, exchange_events.STORED_MOVE)
    if command.is_stop or axis.passes_unchanged:
        return
    code = _blocking_code(request, command)
    if code is not None:
        raise target_lost(code, axis.plan.name)


def target_lost(code: int, axis: str) -> RefusedRequestError:
    """Return the refusal of a trigger whose target was lost; ``code``: that of the loss."""
    return RefusedRequestError(code, axis, refusals.TARGET_LOST.sentence(), exchange_events.AXIS_BLOCKED)


def _blocking_code(request: Request, command: AxisCommand) -> int | None:
    """Return the exception code with which an action is refused; None: it is allowed.

    A request that writes a complete target and runs it is allowed. It is not if its mode was lost, or if
    another axis of the group has lost its target: the gantry would skew. But it is allowed if that axis gets
    its target in the same frame, or if this axis has lost its own too: one of them must be the first.
    """
    axis, action = command.axis, command.action
    runs_unseen = command.runs_alone or (action is Action.UNKNOWN and not command.hits)
    if runs_unseen and axis.blocked_by is not None:
        return axis.blocked_by
    if not command.runs_target and action is not Action.UNKNOWN:
        return None
    lost_mode = axis.rules.lost_mode(command.number)
    if lost_mode is not None and command.number is not None:
        mode = axis.plan.motion.mode(command.number)
        if mode is not None and mode.address not in command.words:
            return lost_mode
    if not axis.peers or not command.runs_target or axis.interlock.block is Block.OWN:
        return None
    beside = [each.axis for each in request.commands if each.runs_target and not each.runs_alone]
    return axis.blocked_by_one_of([peer for peer in axis.peers if peer not in beside])


# --- targets to which the drive goes -----------------------------------------------------------------------


def _prepare_targets(request: Request, command: AxisCommand) -> list[tuple[FieldHit, bytes]]:
    """Render the command fields of one axis: first those that run, then those that the drive only holds.

    Returns:
        The fields with changed words, with all their corrected words.

    Raises:
        RefusedRequestError: the request must not reach the drive.
    """
    axis, action, access = command.axis, command.action, request.frame.access
    if action in MOVES_OTHERWISE:
        return _pass_otherwise(request, command)
    changed: list[tuple[FieldHit, bytes]] = []
    for hit, words, is_run in command.writes:
        if not is_run:
            continue
        number, image = hit.mapped.number, hit.mapped.image
        assert image is not None
        # A part that was refused before would run too (M3): the trigger is in this frame, or is this word.
        runs_lost_part = axis.waits_for_trigger and not hit.is_whole and image.is_incomplete
        if words is None or (runs_lost_part and image.completeness is Completeness.PART_REFUSED):
            _refuse_unknown(request, hit)
            continue
        rendering: Rendering | None
        try:
            if command.is_again and not lacks_poll(axis, seen(request, axis)):
                rendering = render_repeat(axis, number)
            elif action.is_relative:
                rendering = render_relative(request, axis, number, words, action)
            else:
                rendering = render(axis, number, words, seen(request, axis))
        except RefusedPositionError as error:
            if axis.passes_unchanged:
                command.untracked.append(image)
                continue
            name = axis.plan.name
            raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, name, str(error)) from error
        if rendering is None:  # a distance passes unchanged, and its end is unknown
            command.stagings.append(Staging(image, words, words, image.epoch))
            command.go_anywhere()
            if not _is_complete(hit, access):
                changed.append((hit, words))
            continue
        command.targets.append(rendering)
        if rendering.corrected_words != words or not (axis.passes_unchanged and _is_complete(hit, access)):
            changed.append((hit, rendering.corrected_words))
    for hit, words, is_run in command.writes:
        if not is_run:
            changed += _stage(request, command, hit, words)
    return changed


def seen(request: Request, axis: Axis) -> RenderContext:
    """Return what is needed to render a target: the time, and an actual position that was read for it."""
    fresh = request.prefetched.actual.get(axis.plan.name)
    return RenderContext(request.now_ns, fresh, is_position_withheld(axis, request.prefetched))


def render_relative(
    request: Request, axis: Axis, number: int, words: bytes, action: Action
) -> Rendering | None:
    """Render a relative move; None: it passes unchanged, and its end is unknown.

    Raises:
        RefusedPositionError: the axis must not go to its end (M8).
        RefusedRequestError: its start is unknown (M5).
    """
    base = base_of(axis, action, request.prefetched)
    is_passing = axis.passes_unchanged
    if base is not None:
        return render_distance(axis, number, words, base, seen(request, axis), is_passing=is_passing)
    if is_passing:
        return None
    is_moving = request.prefetched.standstill.get(axis.plan.name) is Standstill.MOVES
    why = "the axis moves" if is_moving else "the position of the axis is unknown"
    if axis.plan.motion.passes_unknown_relative:
        axis.reports.report(exchange_events.BASE_UNKNOWN, f"a relative move passed unchanged: {why}")
        return None
    raise refused(refusals.BASE_UNKNOWN, axis.plan.name, exchange_events.BASE_UNKNOWN, why=why)


# --- targets that the drive only holds ---------------------------------------------------------------------


def _pass_otherwise(request: Request, command: AxisCommand) -> list[tuple[FieldHit, bytes]]:
    """Pass the words of a frame that does something else than to run a target; return changed ones.

    Raises:
        RefusedRequestError: it writes a part of an unknown position, and may run it.
    """
    axis, changed = command.axis, []
    for hit, words, _ in command.writes:
        is_sure = _is_complete(hit, request.frame.access)
        is_sure |= axis.writes_words_alone and not axis.rules.following
        if command.action is Action.UNKNOWN and not is_sure:
            changed += _pass_whole(request, hit, words)
        else:
            _pass_raw(request, hit, words)
    return changed


def _pass_raw(request: Request, hit: FieldHit, words: bytes | None) -> None:
    """Send words unchanged: in a stop, homing or unknown frame they are no target (M2)."""
    axis, image = hit.mapped.axis, hit.mapped.image
    assert image is not None
    if words is None:
        request.of(axis).untracked.append(image)
        return
    access, in_drive = request.frame.access, None
    is_whole = hit.is_whole and not access.is_mask
    if is_whole or (axis.passes_unchanged and _is_complete(hit, access)):
        in_drive = words
    elif not access.is_mask:
        in_drive = _merged(image.corrected_words, *written_part(hit, request.frame.pdu, access))
    written = mask_written(hit, request.frame.pdu, access)
    request.of(axis).stagings.append(Staging(image, words, in_drive, image.epoch, written))


def _pass_whole(request: Request, hit: FieldHit, words: bytes | None) -> list[tuple[FieldHit, bytes]]:
    """Complete a part of a position in an unknown frame: a drive may follow it, to a mixed position (M1).

    Raises:
        RefusedRequestError: the rest of the position is unknown.
    """
    image = hit.mapped.image
    assert image is not None
    is_alone = hit.mapped.axis.writes_words_alone  # its drive takes no whole position
    if words is None or is_alone or image.completeness is Completeness.PART_REFUSED:
        _refuse_unknown(request, hit)
        return []
    written = mask_written(hit, request.frame.pdu, request.frame.access)
    request.of(hit.mapped.axis).stagings.append(Staging(image, words, words, image.epoch, written))
    return [(hit, words)]


def _is_complete(hit: FieldHit, access: Access) -> bool:
    """Whether the drive holds what its controller means after a write of a position was sent unchanged.

    The words that a partial write or a mask leaves must be as the controller wrote them: not corrected, and
    none of them lost.
    """
    image = hit.mapped.image
    assert image is not None
    is_whole = hit.is_whole and not access.is_mask
    return is_whole or not (image.may_be_corrected or image.is_incomplete)


def _stage(
    request: Request, command: AxisCommand, hit: FieldHit, words: bytes | None
) -> list[tuple[FieldHit, bytes]]:
    """Render a staged target as far as its run can be predicted; its trigger renders it again (M2)."""
    axis, image = hit.mapped.axis, hit.mapped.image
    assert image is not None
    if words is None:
        is_refused = image.next_part(request.arrived_ns) is NextPart.REFUSED
        if request.frame.access.is_mask or is_refused or not request.frame.access.is_consistent:
            _refuse_unknown(request, hit)
        else:  # its trigger is refused until the other parts have come
            part = part_of(hit, request.frame.pdu, request.frame.access)
            request.of(axis).buffered_parts.append(part)
        return []
    mask = mask_written(hit, request.frame.pdu, request.frame.access)
    motion = axis.motion
    kept = motion.superseded if axis.repeat_kind(hit.mapped.number, words) is RepeatKind.SAME_WORDS else None
    waits_for_other_words = bool(axis.plan.motion.starts_on) and not hit.is_whole
    is_complete = _is_complete(hit, request.frame.access) or axis.writes_words_alone
    if waits_for_other_words or (axis.passes_unchanged and is_complete and kept is None):
        _pass_raw(request, hit, words)
        return []
    if axis.passes_unchanged and kept is None:
        request.of(axis).stagings.append(Staging(image, words, words, image.epoch, mask))
        return [(hit, words)]
    corrected_words = _foreseen(request, command, hit, words) if kept is None else kept.corrected_words
    in_drive: bytes | None = corrected_words
    if axis.writes_words_alone and not hit.is_whole:
        first, written = written_part(hit, request.frame.pdu, request.frame.access)
        in_drive = _merged(
            image.corrected_words, first, corrected_words[2 * first : 2 * first + len(written)]
        )
    request.of(axis).stagings.append(Staging(image, words, in_drive, image.epoch, mask))
    return [(hit, corrected_words)]


def _foreseen(request: Request, command: AxisCommand, hit: FieldHit, words: bytes) -> bytes:
    axis, number, image = hit.mapped.axis, hit.mapped.number, hit.mapped.image
    assert image is not None
    now = RenderContext(request.now_ns, None)
    spec = spec_of_words(axis, number, words)
    is_kept = spec is None or may_keep_words(axis, spec)
    # A trigger rewrites its target if frames may be added. Otherwise it runs what is written now, so that is
    # rendered here.
    is_kept &= axis.plan.added_frames
    if (
        is_kept
        and image.nominal_words == words
        and image.corrected_words is not None
        and not image.is_incomplete
    ):
        return image.corrected_words
    if axis.repeat_kind(number, words) is RepeatKind.UNSEEN:
        return words  # its trigger is refused until a reading shows where the axis is
    action, is_certain = _expected(command, number)
    try:
        if action.is_relative:
            base = base_of(axis, action, Prefetched())
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
    return any(operation.action.is_relative for trigger in triggers for operation in trigger.deeds.values())


def _expected(command: AxisCommand, number: int) -> tuple[Action, bool]:
    """Return the probable action of a staged target, and whether it is certain enough for a refusal."""
    axis = command.axis
    motion = axis.plan.motion
    mode = motion.mode(number)
    if mode is None:
        return (axis.targets.last_run, False) if may_run_distances(axis) else (Action.ABSOLUTE, True)
    word = command.words.get(mode.address, axis.rules.word(mode.address))
    action = Action.UNKNOWN if word is None or mode.is_in_frame else mode.action(word)
    is_same_frame = mode.address in command.words
    return (Action.ABSOLUTE if action is Action.START else action), is_same_frame


def _merged(words: bytes | None, first: int, part: bytes) -> bytes | None:
    if words is None:
        return None
    return words[: 2 * first] + part + words[2 * first + len(part) :]


# --- parts whose rest is unknown ---------------------------------------------------------------------------


def _refuse_unknown(request: Request, hit: FieldHit) -> None:
    """Refuse a write that leaves an unknown position, unless the axis passes 1:1.

    With an axis that passes 1:1 it is refused only if it leaves words in the drive that may be corrected
    ones.

    Raises:
        RefusedRequestError: unless it may pass.
    """
    axis, image = hit.mapped.axis, hit.mapped.image
    assert image is not None
    is_whole = hit.is_whole and not request.frame.access.is_mask
    if axis.passes_unchanged and (is_whole or not image.may_be_corrected):
        request.of(axis).untracked.append(image)
        return
    if not request.frame.access.is_consistent:
        raise refused(refusals.COUNTS_CONTRADICT, axis.plan.name, register=_at(hit))
    raise refused(
        _why_incomplete(hit, request),
        axis.plan.name,
        is_too_early=image.completeness is not Completeness.PART_REFUSED,
        register=_at(hit),
    )


def _why_incomplete(hit: FieldHit, request: Request) -> RefusalEntry:
    if hit.mapped.image is not None and hit.mapped.image.is_incomplete:
        return refusals.PART_LOST
    if request.frame.access.is_mask or key_of(hit) not in request.prefetched.command_words:
        return refusals.REST_UNKNOWN
    return refusals.REST_UNCERTAIN
