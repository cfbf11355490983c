"""The axes of a group: what the first trigger fixes, what it needs before, and what it changes (M11).

``axis.gantry`` has the state machine: what is fixed, and for how long. This file drives it when a request is
sent (:func:`leave_in_group`) and when it ends (:func:`end_in_group`).

Once the first axis has started, no trigger of the others may be refused. So what their triggers need is done
before (:func:`next_of_groups`). Their references are read. Their staged targets are rewritten with the words
that the decision gives, each with one added write (M2). If that is refused, unanswered or not allowed, the
first trigger is refused, and nothing moves.
"""

from collections.abc import Iterable, Sequence

from gateway.catalogue import exchange_events, refusals
from gateway.drives.motion import Action
from gateway.exchange.added_frames import AddedFrame, Purpose, homed_read, read_field, read_word
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.axis import MOVES_OTHERWISE, Axis
from gateway.exchange.axis.gantry import Gantry, GantryEvent
from gateway.exchange.axis.interlock import Block
from gateway.exchange.axis.member import Fixed
from gateway.exchange.axis.motion import MAY_BE_ELSEWHERE, MotionState
from gateway.exchange.axis.registers import JOIN_NS
from gateway.exchange.decode import AxisCommand
from gateway.exchange.field_counts import counts_of
from gateway.exchange.kept_words import is_other, keeps_other_words, may_have_gone_to, spec_of_words
from gateway.exchange.prepare import check_may_act, may_run_distances, target_lost
from gateway.exchange.prerequisites import read_for_staged, render_run, rewrite_for_run, staged_words
from gateway.exchange.refusal import RefusedRequestError, refused
from gateway.exchange.render import needs_poll
from gateway.exchange.request import Request, written_part


def join_groups(axes: Sequence[Axis], groups: Iterable[Iterable[str]]) -> None:
    """Connect the axes of each group with each other, and with what its first trigger fixes."""
    by_name = {axis.plan.name: axis for axis in axes}
    for names in groups:
        members = [by_name[name] for name in names if name in by_name]
        gantry = Gantry([axis.release for axis in members])
        for axis in members:
            axis.join(tuple([other for other in members if other is not axis]), gantry)


# --- what is fixed -----------------------------------------------------------------------------------------


def settle_group(axis: Axis, now_ns: int) -> None:
    """Bring its group up to date: one reference for all, and no decision that has ended."""
    gantry = axis.member.gantry
    if gantry is None:
        return
    axis.follow_group()
    if gantry.is_over(now_ns):
        gantry.happens(GantryEvent.EXPIRED)
    elif gantry.is_under_way and _is_group_through(axis, now_ns):
        gantry.happens(GantryEvent.WHOLE)


def leave_in_group(command: AxisCommand, now_ns: int) -> None:
    """A request to an axis of a group is sent: it fixes values for all, uses the fixed ones, or ends them."""
    axis, gantry = command.axis, command.axis.member.gantry
    if gantry is None:
        return
    if command.action in MOVES_OTHERWISE:
        gantry.happens(GantryEvent.ENDED)
    elif command.targets or command.runs or command.runs_target:
        is_first = gantry.is_open
        if is_first:
            gantry.fix(axis.plan.name, now_ns)
            keeps_words = _keeps_other_words(command)
            for each in (axis, *axis.peers):
                run = None if each is axis else command.peer_runs.get(each.plan.name)
                each.member.fix(run, keeps_words=keeps_words)
        elif not _keeps_other_words(command):
            for each in (axis, *axis.peers):
                each.member.keep_no_other_words()
        fixed = axis.member.fixed
        if not is_first and gantry.has_put_off and fixed is not None and not fixed.has_gone:
            detail = f"it goes as {gantry.led_by} has gone; what was asked for since comes into force then"
            axis.reports.report(exchange_events.GROUP_HELD, detail)
        gantry.happens(GantryEvent.LEFT)


def end_in_group(request: Request, command: AxisCommand, outcome: Outcome, code: int, now_ns: int) -> None:
    """A request to an axis of a group has ended: the axis has started, was refused, or got a target."""
    axis, gantry, fixed = command.axis, command.axis.member.gantry, command.axis.member.fixed
    if gantry is None or fixed is None:
        return
    if command.targets or command.runs or command.runs_target:
        if outcome is Outcome.ACKNOWLEDGED or outcome is Outcome.BROADCAST:
            missing = _missing_words(command, fixed, now_ns)
            axis.member.go_as_fixed(missing, now_ns)
            is_whole = _is_group_through(axis, now_ns)
            gantry.happens(GantryEvent.WHOLE if is_whole else GantryEvent.WENT)
        else:
            is_refusal = outcome is Outcome.EXCEPTION
            is_undone = is_refusal and axis.writes_nothing(code, reads_too=request.reads_too)
            if not is_undone and not any(each.member.has_gone for each in (axis, *axis.peers)):
                axis.member.may_go_as_fixed()
                _report_unconfirmed_first(axis, gantry, code)
            else:
                report_skew(axis, code)
            gantry.happens(GantryEvent.REFUSED if is_undone else GantryEvent.UNCONFIRMED)
    elif outcome is Outcome.ACKNOWLEDGED:
        is_distance = axis.targets.last_run.is_relative
        if fixed.has_gone:
            is_other = any(is_distance or not axis.motion.holds_target(each) for each in command.written)
        else:
            is_other = fixed.may_have_gone
            is_other = is_other and any(not _holds_unconfirmed(axis, each) for each in command.written)
        if is_other:
            gantry.happens(GantryEvent.AGAIN)


def _keeps_other_words(command: AxisCommand) -> bool:
    """Whether the first target of its group keeps words of another switch, table or gain."""
    axis = command.axis
    for rendering in (*command.targets, *command.runs):
        if not rendering.is_distance:
            spec = spec_of_words(axis, rendering.number, rendering.nominal_words)
            if spec is not None and is_other(axis, spec):
                return rendering.move is None or rendering.move.state.spec is spec
    return False


def _holds_unconfirmed(axis: Axis, number: int) -> bool:
    """Whether a command field holds a target to which the axis may have gone, or an incomplete one."""
    image = axis.fields[number]
    if image.nominal_words is None or image.is_incomplete:
        return True  # the rest of it is still to come
    return _may_have_been_sent_to(axis, number, image.nominal_words)


def _is_joined(axis: Axis, first: int, count: int, now_ns: int) -> bool:
    """Whether words of a target, from its word ``first`` on, belong to the target with which it started."""
    fixed = axis.member.fixed
    if fixed is None or now_ns - fixed.part_ns > JOIN_NS:
        return False
    words = (1 << count) - 1 << first
    return fixed.missing & words == words


def _missing_words(command: AxisCommand, fixed: Fixed, now_ns: int) -> int:
    """Return which words of a target have not come yet, for a drive that moves with each part."""
    axis, missing = command.axis, 0
    for part in command.parts:
        if part.first >= 0:
            count = len(part.words) // 2
            is_joined = _is_joined(axis, part.first, count, now_ns)
            all_words = (1 << max(field.words for field in axis.plan.command)) - 1
            missing = (fixed.missing if is_joined else all_words) & ~((1 << count) - 1 << part.first)
    return missing


def _is_group_through(axis: Axis, now_ns: int) -> bool:
    """Whether each axis of its group has started, and no word of its target is missing."""
    for each in (axis, *axis.peers):
        fixed = each.member.fixed
        if fixed is None or not fixed.has_gone:
            return False
        if fixed.missing and now_ns - fixed.part_ns <= JOIN_NS:
            return False
    return True


def _report_unconfirmed_first(axis: Axis, gantry: Gantry, code: int) -> None:
    """Report that the first axis of a group was triggered, and that it is unknown whether it starts."""
    gantry.skew_by(None)
    detail = (
        f"its trigger was sent, and the drive may have obeyed it (exception {code:#04x}): the skew is "
        "not known"
    )
    axis.reports.report(exchange_events.GROUP_SKEWED, detail)


def report_skew(axis: Axis, code: int) -> None:
    """Report that an axis is refused after another one of its group has started. Nothing is stopped (M3)."""
    gantry, fixed = axis.member.gantry, axis.member.fixed
    if gantry is None or not gantry.is_under_way or fixed is None or fixed.has_gone:
        return
    skew: float | None = 0.0
    gone = [peer for peer in axis.peers if peer.member.has_gone]
    for peer in gone:
        way = _way_in_group(peer)
        if way is None or skew is None:
            skew = None
        elif abs(way) > abs(skew):
            skew = way
    if skew == 0.0:
        return  # nothing has moved
    gantry.skew_by(skew)
    names, units = " and ".join(peer.plan.name for peer in gone), axis.plan.settings.units.value
    by = "by an unknown amount" if skew is None else f"by {skew:+.6g} {units}"
    detail = f"{names} has moved, and its own target was refused (exception {code:#04x}): skewed {by}"
    axis.reports.report(exchange_events.GROUP_SKEWED, detail)


def _way_in_group(axis: Axis) -> float | None:
    """How far it was sent since its group started, in units; None: unknown."""
    fixed, accepted = axis.member.fixed, axis.compensation.accepted
    if fixed is None or fixed.nominal_counts is None or accepted is None:
        return None
    return (accepted.nominal_counts - fixed.nominal_counts) / axis.plan.settings.counts_per_unit


# --- before the first trigger ------------------------------------------------------------------------------


def settle_groups(request: Request, *, has_stop: bool) -> bool:
    """Begin a new round if an axis that has started gets another target; return whether one has begun.

    ``has_stop``: its frame stops an axis, and passes whatever else it does (M3).

    Raises:
        RefusedRequestError: the axis must not get it, so it stays where the last round sent it.
    """
    for command in request.commands:
        gantry, fixed = command.axis.member.gantry, command.axis.member.fixed
        if gantry is None or fixed is None or not (fixed.has_gone or fixed.may_have_gone):
            continue
        if command.runs_target and _goes_elsewhere(request, command):
            if not has_stop:
                check_may_act(request, command)
            gantry.happens(GantryEvent.AGAIN)
            return True
    return False


def next_of_groups(requests: Sequence[Request]) -> AddedFrame | None:
    """Return the next prerequisite of the other axes of a group, if any.

    ``requests``: one request, decoded for each unit that it reaches.

    Raises:
        RefusedRequestError: the first trigger must not be sent, because one of them could not follow.
    """
    firsts = [
        (request, command) for request in requests for command in request.commands if _is_first(command)
    ]
    for request, command in firsts:
        check_may_act(request, command)
        if command.runs_alone:
            staged_words(command)
        _decide_anew(request, command.axis)
        for member in (command.axis, *command.axis.peers):
            added = _reference_of(request, member)
            if added is not None:
                return added
    for request, command in firsts:
        for member in (command.axis, *command.axis.peers):
            added = _poll_at_superseded(request, member) or _poll_at_kept(request, command, member)
            if added is not None:
                return added
    going = [command.axis for _, command in firsts]
    for request, command in firsts:
        for peer in command.axis.peers:
            added = None if peer in going else _prepare_peer(request, peer, command)
            if added is not None:
                return added
    return None


def _poll_at_superseded(request: Request, axis: Axis) -> AddedFrame | None:
    """Return the read that decides if the target from before a loss counts: in a group all do, or none."""
    actual = axis.reach.asked_actual
    superseded = axis.motion.superseded
    is_open = superseded is not None and not superseded.is_declared and axis.motion.seen_at_superseded is None
    if not is_open or actual is None or axis.plan.name in request.prefetched.actual:
        return None
    return read_field(axis, Purpose.POLL, actual)


def _poll_at_kept(request: Request, command: AxisCommand, axis: Axis) -> AddedFrame | None:
    """Return the read that decides if an axis can keep words of another switch, table or gain (M4).

    The target of the axis itself would cause that read too, but too late: the first axis has then started
    with such words.
    """
    actual, name = axis.reach.asked_actual, axis.plan.name
    if actual is None or name in request.prefetched.actual or command.action.is_relative:
        return None
    members = (axis, *axis.peers)
    is_doubtful = axis.motion.state in MAY_BE_ELSEWHERE or needs_poll(axis, request.now_ns, Action.ABSOLUTE)
    if not is_doubtful or not all(keeps_other_words(each) for each in members):
        return None
    return read_field(axis, Purpose.POLL, actual)


def _is_first(command: AxisCommand) -> bool:
    gantry = command.axis.member.gantry
    return gantry is not None and gantry.is_open and command.runs_target


def _goes_elsewhere(request: Request, command: AxisCommand) -> bool:
    """Whether a request sends an axis that has started to another position than before."""
    axis = command.axis
    accepted, fixed = axis.compensation.accepted, axis.member.fixed
    is_unconfirmed = fixed is not None and fixed.may_have_gone
    if command.action.is_relative or (accepted is None and not is_unconfirmed):
        return True
    if command.runs_alone:
        words = None if command.number is None else axis.fields[command.number].nominal_words
        return words is None or not _is_at(axis, command.number or 0, words)
    for hit, words, is_run in command.writes:
        if not is_run or (words and _is_at(axis, hit.mapped.number, words)):
            continue
        access = request.frame.access
        if hit.is_whole or access.is_mask or not access.is_consistent:
            return True
        first, part = written_part(hit, request.frame.pdu, access)
        if not _is_joined(axis, first, len(part) // 2, request.now_ns):
            return True
    return False


def _is_at(axis: Axis, number: int, words: bytes) -> bool:
    """Whether a target is the one to which its axis has gone, or may have."""
    field, accepted = axis.plan.command[number], axis.compensation.accepted
    if accepted is None:
        return _may_have_been_sent_to(axis, number, words)
    return counts_of(field, field.unpack(words)) == accepted.nominal_counts


def _may_have_been_sent_to(axis: Axis, number: int, words: bytes) -> bool:
    """Whether a target is the one that its axis was sent in this round, without a proof that it goes there.

    If it was the target from before a loss again, the axis is in ``SUPERSEDED``; else in ``UNACKNOWLEDGED``.
    """
    return may_have_gone_to(axis, number, words) or axis.motion.superseded_as(number, words) is not None


def _decide_anew(request: Request, axis: Axis) -> None:
    """Drop what was prepared for this request if another correction has come into force meanwhile."""
    prefetched, members = request.prefetched, (axis, *axis.peers)
    is_other = False
    for each in members:
        name, is_referenced = each.plan.name, each.member.goes_as_referenced
        requested = each.correction.requested
        keeps, before = keeps_other_words(each), prefetched.decided_by.get(name)
        if before is not None:
            is_other |= before[0] is not is_referenced or before[1] is not requested or before[2] is not keeps
        prefetched.decided_by[name] = (is_referenced, requested, keeps)
    for each in members if is_other else ():
        prefetched.runs.pop(each.plan.name, None)
        prefetched.peer_runs.pop(each.plan.name, None)


def _reference_of(request: Request, axis: Axis) -> AddedFrame | None:
    is_asked = axis.plan.name in request.prefetched.references
    if is_asked or not axis.needs_reference(request.now_ns, is_target=True):
        return None
    return homed_read(axis)


def _prepare_peer(request: Request, axis: Axis, first: AxisCommand) -> AddedFrame | None:
    """Return the next frame that an axis needs, so that it holds its target with the words that it must run.

    It will run its target as the first trigger of the group runs that of the first axis: from the field of
    the same number, with the same kind of move, where the trigger decides that.

    A target before which the axis was stopped may be meant to run later or not: it holds up no other axis.
    """
    number, motion = axis.rules.staged, axis.plan.motion
    if not (motion.is_staged or motion.starts_on):
        return None  # its drive holds no waiting target: each position that is written moves it
    count = len(axis.plan.command)
    if first.number is not None and 1 < count > first.number:
        number = first.number
    words = None if number is None else axis.fields[number].nominal_words
    fields = axis.fields if number is None else (axis.fields[number],)
    is_incomplete = any(field.is_incomplete for field in fields)
    if number is None or words is None or is_incomplete:
        may_pass = axis.passes_unchanged or motion.passes_stored_moves
        # The target of this axis was refused because of the others, or was taken over with theirs, or all
        # axes have lost their own. It must come again, and may come after the first trigger. Otherwise, where
        # one frame writes and runs a target, all axes would wait for each other.
        block = axis.interlock.block
        may_come_later = block is Block.OF_GROUP or (block is Block.OWN is first.axis.interlock.block)
        may_come_later = may_come_later and not any(each.has_part for each in fields)
        # A controller that writes and runs a target in one frame never writes the held target again alone.
        is_awaited = axis.targets.holds_unrun and not (may_come_later and not first.runs_alone)
        if (is_awaited or (is_incomplete and not may_come_later)) and not may_pass:
            why = "its target was lost or forgotten, write it again"
            raise refused(refusals.GROUP_CANNOT_FOLLOW, axis.plan.name, exchange_events.STORED_MOVE, why=why)
        return None
    if not axis.targets.holds_unrun and axis.motion.state is not MotionState.STOPPED:
        return None  # it has run that target already
    try:
        return _prepare_staged(request, axis, number, words, first.action)
    except RefusedRequestError as refusal:
        if not axis.targets.holds_unrun:
            return None
        reason = refusals.GROUP_CANNOT_FOLLOW.sentence(why=refusal.reason)
        raise RefusedRequestError(refusal.code, refusal.axis, reason, refusal.kind) from refusal


def _prepare_staged(
    request: Request, axis: Axis, number: int, words: bytes, first: Action
) -> AddedFrame | None:
    prefetched, name = request.prefetched, axis.plan.name
    run = prefetched.peer_runs.get(name)
    if run is None:
        mode, action = axis.plan.motion.mode(number), first
        lost_mode = axis.rules.lost_mode(number)
        if lost_mode is not None:
            raise target_lost(lost_mode, name)
        if mode is None:
            action = action if may_run_distances(axis) else Action.ABSOLUTE
        elif mode.is_in_frame:
            return None
        else:
            word = axis.rules.word(mode.address)
            if word is None:
                is_asked = not axis.reach.may_read or mode.address in prefetched.rule_words.get(name, {})
                return None if is_asked else read_word(axis, mode.address)
            action = mode.action(word)
        action = Action.ABSOLUTE if action is Action.START else action
        if not action.runs_target or (action.is_relative and not axis.targets.holds_unrun):
            return None
        added = read_for_staged(request, axis, number, words, action)
        if added is not None:
            return added
        run = render_run(request, axis, number, words, action)
        if run is None:
            return None
        prefetched.peer_runs[name] = run
    return rewrite_for_run(axis, run)
