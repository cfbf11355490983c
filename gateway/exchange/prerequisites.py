"""What must be read or written before a request can be sent (M2, M5, M6, W8)."""

from gateway.catalogue import exchange_events, refusals
from gateway.drives.motion import Action
from gateway.exchange.added_frames import (
    POLLS,
    AddedFrame,
    Purpose,
    addresses_to_rewrite,
    homed_read,
    next_rewrite,
    read_field,
    read_word,
    standstill_bit,
)
from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import MAY_BE_ELSEWHERE, TARGETED, KeptOver
from gateway.exchange.decode import AxisCommand
from gateway.exchange.field_counts import counts_of
from gateway.exchange.prepare import check_may_act, render_relative, seen
from gateway.exchange.refusal import RefusedRequestError, refused
from gateway.exchange.render import (
    RefusedPositionError,
    as_it_came,
    base_of,
    counts_from_commanded,
    flagged,
    is_position_withheld,
    may_have_passed,
    needs_actual,
    needs_poll,
    render,
)
from gateway.exchange.request import Prefetched, Request, key_of
from gateway.exchange.unit import FieldHit, FieldRole, MappedField
from gateway.modbus.pdu import ExceptionCode
from gateway.modbus.registers import FieldAccess


def next_frame(request: Request) -> AddedFrame | None:
    """Return the next frame that must be exchanged before this request can be sent, if any.

    Raises:
        RefusedRequestError: the request must not reach the drive.
    """
    access = request.frame.access
    added = _reference_read(request) if request.frame.unit.asks_for_bits else None
    if added is not None:
        return added
    for command in request.commands:
        if command.needs_word is not None and not command.axis.passes_unchanged:
            return read_word(command.axis, command.needs_word)
    if access.write_quantity and access.is_consistent:
        added = _command_read(request)
        if added is not None:
            return added
    for command in request.commands:
        added = None
        if command.runs_alone:
            added = _prepare_run(request, command)
        elif command.action is Action.UNKNOWN and command.number not in command.written:
            added = _prepare_unknown(request, command)
        if added is not None:
            return added
    return None


def run_beside_stop(request: Request) -> None:
    """Find which targets run correctly in a frame that stops another axis: such a frame waits for nothing.

    Other targets would need a read or a write first, or would be refused. They run with the words that the
    drive has (M3).
    """
    for command in request.commands:
        if not command.runs_alone:
            continue
        try:
            is_right = _prepare_run(request, command) is None
        except RefusedRequestError:
            is_right = False
        if not is_right:
            request.prefetched.runs.pop(command.axis.plan.name, None)


def _reference_read(request: Request) -> AddedFrame | None:
    """Return the read of the reference bit, if it is needed before positions pass."""
    unit, access = request.frame.unit, request.frame.access
    written = [hit for own in request.frame.by_axis for hit in own.fields]
    read = unit.read(access.read_address, access.read_quantity).fields
    targets = [command.axis for command in request.commands if command.runs_target]
    targets += [hit.mapped.axis for hit in written if hit.mapped.role is FieldRole.COMMAND]
    # In another mode the bit may mean something else.
    targets += [
        each.axis for each in request.commands if each.writes_mode and each.axis.reference.ends_with_mode
    ]
    others = [hit.mapped.axis for hit in (*written, *read)]
    for axis, is_target in (*((a, True) for a in targets), *((a, False) for a in others)):
        is_asked = axis.plan.name in request.prefetched.references
        if not is_asked and axis.needs_reference(request.now_ns, is_target=is_target):
            added = homed_read(axis)
            if added is not None:
                return added
    return None


def _command_read(request: Request) -> AddedFrame | None:
    """Return what must be read for the command fields that a request writes, if anything.

    That is the rest of a position of which a part is written (M1), and what a target that runs needs.
    """
    access, prefetched = request.frame.access, request.prefetched
    for command in request.commands:
        axis, action = command.axis, command.action
        if not axis.reach.may_read:
            continue
        for hit, words, is_run in command.writes:
            number, field, image = hit.mapped.number, hit.mapped.field, hit.mapped.image
            assert image is not None
            if words is None:
                passes_raw = axis.passes_unchanged and not image.may_be_corrected
                is_of_use = not (passes_raw or image.is_incomplete or access.is_mask)
                is_asked = key_of(hit) in prefetched.command_words
                if is_of_use and not is_asked and field.access is not FieldAccess.WRITE:
                    return AddedFrame(axis, Purpose.COMMAND, field.address, field.words, hit)
            elif is_run and (
                not command.is_again
                or axis.motion.state in MAY_BE_ELSEWHERE
                or needs_poll(axis, request.now_ns, action)
            ):
                added = read_for_run(request, axis, number, words, action)
                if added is not None:
                    return added
    return None


def read_for_run(
    request: Request, axis: Axis, number: int, words: bytes, action: Action
) -> AddedFrame | None:
    """Return what must be read before a complete target can be rendered."""
    prefetched, name = request.prefetched, axis.plan.name
    actual = axis.reach.asked_actual
    superseded = axis.motion.superseded_as(number, words)
    if not action.is_relative and superseded is not None:
        is_seen = axis.motion.is_seen_at_superseded and not axis.motion.is_unseen(request.now_ns)
        if superseded.is_declared or is_seen or actual is None or name in prefetched.actual:
            return None
        return read_field(axis, Purpose.POLL, actual)
    if name not in prefetched.actual and needs_poll(axis, request.now_ns, action):
        if actual is not None:
            return read_field(axis, Purpose.POLL, actual, is_for_distance=action.is_relative)
        _go_unseen(request, axis, action)
    field = axis.plan.command[number]
    counts = counts_of(field, field.unpack(words))
    if action.is_relative:
        if axis.passes_unchanged:
            return None
        added = _next_base_read(axis, action, prefetched, request.now_ns)
        base = base_of(axis, action, prefetched)
        if added is not None or base is None or base.is_at_rest or not counts:
            return added
        counts += base.nominal_counts
    if name in prefetched.actual or not needs_actual(axis, counts, request.now_ns):
        return None
    if actual is None:
        _go_unseen(request, axis, action)
        return None
    return read_field(axis, Purpose.ACTUAL, actual)


def read_for_staged(
    request: Request, axis: Axis, number: int, words: bytes, action: Action
) -> AddedFrame | None:
    """Return what must be read before a staged target can be rendered for its trigger."""
    if axis.passes_unchanged and axis.motion.superseded_as(number, words) is None:
        return None
    return read_for_run(request, axis, number, words, action)


def _go_unseen(request: Request, axis: Axis, action: Action) -> None:
    """Its drive refuses to report its position: for a distance this counts as an unsuccessful read (M5)."""
    if action.is_relative:
        request.prefetched.actual[axis.plan.name] = None


def _prepare_run(request: Request, command: AxisCommand) -> AddedFrame | None:
    """Correct a staged target for its trigger; return the next frame that this needs.

    Raises:
        RefusedRequestError: the trigger must not reach the drive.
    """
    axis, name = command.axis, command.axis.plan.name
    check_may_act(request, command)
    prefetched = request.prefetched
    rendering = prefetched.runs.get(name)
    if rendering is None and (fixed := _fixed_run(command)) is not None:
        actual = axis.motion.actual
        if actual is not None and may_have_passed(axis, fixed.corrected_counts, actual, request.now_ns):
            fixed = flagged(fixed)  # it moved when its words were fixed, and may come from the other side now
        rendering = prefetched.runs[name] = fixed
    if rendering is None:
        added = _read_back(request, command)
        if added is not None:
            return added
        words = staged_words(command)
        if words is None:
            return None
        assert command.number is not None
        added = read_for_staged(request, axis, command.number, words, command.action)
        if added is not None:
            return added
        rendering = render_run(request, axis, command.number, words, command.action)
        if rendering is None:
            return None
        prefetched.runs[name] = rendering
    return rewrite_for_run(axis, rendering)


def _read_back(request: Request, command: AxisCommand) -> AddedFrame | None:
    """Return the read of a target that the drive held before its connection was closed, for its trigger.

    It runs only if the drive still holds exactly the words that it received (``Targets.read_back``).
    """
    axis, number = command.axis, command.number
    superseded = axis.motion.superseded
    if number is None or superseded is None or superseded.number != number or not axis.reach.may_read:
        return None
    # After any other loss the drive may have been switched off, and may hold an older target.
    if superseded.over is not KeptOver.ORDERLY_CLOSE:
        return None
    image, field = axis.fields[number], axis.plan.command[number]
    is_known = image.nominal_words is not None or image.is_incomplete
    hit = FieldHit(MappedField(axis, FieldRole.COMMAND, number, field, image), 0, is_whole=True)
    if is_known or not field.is_readable or key_of(hit) in request.prefetched.command_words:
        return None
    return AddedFrame(axis, Purpose.KEPT, field.address, field.words, hit)


def rewrite_for_run(axis: Axis, rendering: Rendering) -> AddedFrame | None:
    """Return the next write that brings the drive to the words that its trigger runs, if any (M2).

    Raises:
        RefusedRequestError: the target must be rewritten and may not be.
    """
    is_as_written = rendering.corrected_words == rendering.nominal_words
    may_be_corrected = axis.fields[rendering.number].may_be_corrected
    if axis.passes_unchanged and is_as_written and not may_be_corrected:
        return None
    return _next_rewrite(axis, rendering)


def _fixed_run(command: AxisCommand) -> Rendering | None:
    """Return the words that the first trigger of its group fixed for the target that this one runs (M11).

    None if the axis got another target since, or was moved by something else.
    """
    axis, fixed = command.axis, command.axis.member.fixed
    run = None if fixed is None or fixed.has_gone else fixed.run
    if fixed is None or run is None or run.number != command.number:
        return None
    image = axis.fields[run.number]
    is_same = image.nominal_words == run.nominal_words and not image.is_incomplete
    is_held = (
        is_same and run.is_distance is command.action.is_relative and image.holds(0, run.corrected_words)
    )
    motion = axis.motion
    is_there = motion.state in TARGETED or (
        motion.state is fixed.motion_state and motion.has_reported_done is fixed.had_reported_done
    )
    return run if is_held and is_there else None


def _prepare_unknown(request: Request, command: AxisCommand) -> AddedFrame | None:
    """Before something unknown runs, restore the words that the controller wrote (M2).

    A number that was not written through the gateway may hold a target from an earlier gateway or another
    master: a stored move of any kind (M9).
    """
    axis = command.axis
    check_may_act(request, command)
    if command.number is not None:
        staged_words(command)
    elif command.hits:
        return None
    number = axis.rules.staged if command.number is None else command.number
    if number is None:
        return None
    image = axis.fields[number]
    if not image.may_be_corrected:
        return None
    if image.nominal_words is None or image.is_incomplete:
        if command.number is None:  # an unknown value may mean anything
            return None
        raise refused(refusals.NOT_OURS, axis.plan.name, exchange_events.STORED_MOVE)
    return _next_rewrite(axis, as_it_came(axis, number))


def _next_rewrite(axis: Axis, rendering: Rendering) -> AddedFrame | None:
    """Return the next rewrite of a staged target for its trigger, if any; never of a word that starts (M2).

    No word is rewritten while the drive goes to each position as it is written, or may do so. The axis would
    move before its trigger, with the speed of the last move, and even if the trigger is withdrawn (W5).

    Raises:
        RefusedRequestError: the target must be rewritten and may not be.
    """
    added = next_rewrite(axis, rendering)
    if added is None:
        return None
    starts = not axis.plan.motion.starts_on.isdisjoint(addresses_to_rewrite(axis, rendering))
    if starts or axis.rules.may_go_at_once(rendering.number):
        raise refused(refusals.RESTAGING_STARTS, axis.plan.name)
    if not axis.plan.added_frames:
        raise refused(refusals.RESTAGING_FORBIDDEN, axis.plan.name)
    return added


def staged_words(command: AxisCommand) -> bytes | None:
    """Return the nominal words of the target that a trigger runs; None: it may pass without them.

    Raises:
        RefusedRequestError: it is unknown what the drive would run.
    """
    axis, number = command.axis, command.number
    image = None if number is None else axis.fields[number]
    if image is not None and image.nominal_words is not None and not image.is_incomplete:
        return image.nominal_words
    is_as_written = axis.passes_unchanged and not (image and image.may_be_corrected)
    is_lost = image is not None and image.is_incomplete  # the drive holds something unintended (M3)
    if is_as_written or (axis.plan.motion.passes_stored_moves and not is_lost):
        return None
    raise refused(refusals.NOT_OURS, axis.plan.name, exchange_events.STORED_MOVE)


def render_run(request: Request, axis: Axis, number: int, words: bytes, action: Action) -> Rendering | None:
    """Return a staged target rendered for its trigger; None: it passes unchanged.

    Raises:
        RefusedRequestError: it must not run.
    """
    try:
        if action.is_relative:
            rendering = render_relative(request, axis, number, words, action)
            return rendering or as_it_came(axis, number)
        return render(axis, number, words, seen(request, axis))
    except RefusedPositionError as error:
        if axis.passes_unchanged:
            return None
        name = axis.plan.name
        raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, name, str(error)) from error


def _next_base_read(axis: Axis, action: Action, prefetched: Prefetched, now_ns: int) -> AddedFrame | None:
    """Return the next read that finds the start of a relative move; None: no reading helps."""
    if (
        not axis.reach.may_read
        or is_position_withheld(axis, prefetched)
        or base_of(axis, action, prefetched) is not None
    ):
        return None
    name = axis.plan.name
    bit = None if name in prefetched.standstill else standstill_bit(axis)
    if bit is not None:
        return bit
    actual, commanded = axis.reach.asked_actual, axis.reach.asked_commanded
    if axis.motion.is_distance_unconfirmed and actual is not None:
        is_answered = name in prefetched.actual and not (
            prefetched.polls[name] < POLLS and axis.motion.polls_needed(now_ns)
        )
        return None if is_answered else read_field(axis, Purpose.ACTUAL, actual)
    if counts_from_commanded(axis, action):
        if commanded is not None and name not in prefetched.commanded:
            return read_field(axis, Purpose.COMMANDED, commanded)
    elif actual is not None and name not in prefetched.actual:
        return read_field(axis, Purpose.ACTUAL, actual)
    return None
