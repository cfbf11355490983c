"""What the first trigger of a group takes before it leaves: each axis of it must be able to follow (M11).

The other axes may be refused nothing once the first has gone (``axis.beam``). So what their triggers would
need is done before: their references are read, and the targets that they hold are written anew with the words
that the decision gives, each with one named write (M2). Where that is refused, unanswered or not allowed the
first trigger is refused, and nothing moves.
"""

from collections.abc import Sequence

from gateway.drives.motion import Action
from gateway.exchange.added_frames import AddedFrame, Purpose, homed_read, read_word
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.events import EventKind
from gateway.exchange.field_counts import counts_of
from gateway.exchange.meaning import Meaning
from gateway.exchange.prerequisites import read_for_staged, render_run, restage_for_run, staged_words
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.request import Request, written_part
from gateway.exchange.translate import check_may_act, may_run_distances
from gateway.modbus.pdu import ExceptionCode


def settle_groups(request: Request) -> bool:
    """Let a new round begin where an axis that has gone is given another target; return whether one has.

    Raises:
        RefusedRequestError: the axis must not be given it, so it stays where the round has sent it.
    """
    for meaning in request.meanings:
        fixed = meaning.axis.fixed
        has_gone = fixed is not None and (fixed.has_gone or fixed.may_have_gone)
        if has_gone and meaning.action.runs_target and _goes_elsewhere(request, meaning):
            check_may_act(meaning)
            meaning.axis.begin_group_anew()
            return True
    return False


def next_of_groups(requests: Sequence[Request]) -> AddedFrame | None:
    """Return the next frame that has to be exchanged for the other axes of a group, if any.

    ``requests``: one request, as each unit has it that it reaches.

    Raises:
        RefusedRequestError: the first trigger must not leave, for one of them could not follow.
    """
    firsts = [
        (request, meaning) for request in requests for meaning in request.meanings if _is_first(meaning)
    ]
    for request, meaning in firsts:
        check_may_act(meaning)
        if meaning.runs_alone:
            staged_words(meaning)
        _decide_anew(request, meaning.axis)
        for member in (meaning.axis, *meaning.axis.peers):
            added = _reference_of(request, member)
            if added is not None:
                return added
    for request, meaning in firsts:
        for member in (meaning.axis, *meaning.axis.peers):
            added = _look_at_kept(request, member)
            if added is not None:
                return added
    going = [meaning.axis for _, meaning in firsts]
    for request, meaning in firsts:
        for peer in meaning.axis.peers:
            added = None if peer in going else _prepare_peer(request, peer, meaning)
            if added is not None:
                return added
    return None


def _look_at_kept(request: Request, axis: Axis) -> AddedFrame | None:
    """Return the look that tells whether the target of before a loss counts: of a group all do, or none."""
    actual = axis.asked_actual
    retained = axis.motion.superseded
    is_open = retained is not None and not retained.is_declared and axis.motion.seen_at_superseded is None
    if not is_open or actual is None or axis.plan.name in request.known.actual:
        return None
    return AddedFrame(axis, Purpose.LOOK, actual.address, actual.words)


def _is_first(meaning: Meaning) -> bool:
    beam = meaning.axis.beam
    return beam is not None and beam.is_open and meaning.action.runs_target


def _goes_elsewhere(request: Request, meaning: Meaning) -> bool:
    """Whether a request sends an axis that has gone to another place than where it went."""
    axis = meaning.axis
    accepted, is_unproven = axis.compensation.accepted, axis.fixed is not None and axis.fixed.may_have_gone
    if meaning.action.is_relative or (accepted is None and not is_unproven):
        return True
    if meaning.runs_alone:
        words = None if meaning.number is None else axis.fields[meaning.number].nominal_words
        return words is None or not _is_at(axis, meaning.number or 0, words)
    for write in request.writes:
        for hit, words, is_run in write.fields if write.axis is axis else ():
            if not is_run or (words and _is_at(axis, hit.place.number, words)):
                continue
            access = request.frame.access
            if hit.is_whole or access.is_mask or not access.is_consistent:
                return True
            first, part = written_part(hit, request.frame.pdu, access)
            if not axis.is_joined(first, len(part) // 2, request.now_ns):
                return True
    return False


def _is_at(axis: Axis, number: int, words: bytes) -> bool:
    """Whether a target is the one to which its axis has gone, or may have."""
    field, accepted = axis.plan.command[number], axis.compensation.accepted
    if accepted is None:
        return axis.may_have_gone_to(number, words)
    return counts_of(field, field.unpack(words)) == accepted.nominal_counts


def _decide_anew(request: Request, axis: Axis) -> None:
    """Forget what was worked out for this request where something else has come into force meanwhile."""
    known, members = request.known, (axis, *axis.peers)
    is_other = False
    for member in members:
        name, is_referenced, wanted = member.plan.name, member.goes_as_referenced, member.wanted
        keeps, before = member.keeps_other_words, known.decided_by.get(name)
        if before is not None:
            is_other |= before[0] is not is_referenced or before[1] is not wanted or before[2] is not keeps
        known.decided_by[name] = (is_referenced, wanted, keeps)
    for member in members if is_other else ():
        known.runs.pop(member.plan.name, None)
        known.peer_runs.pop(member.plan.name, None)


def _reference_of(request: Request, axis: Axis) -> AddedFrame | None:
    is_asked = axis.plan.name in request.known.references
    if is_asked or not axis.needs_reference(request.now_ns, is_target=True):
        return None
    return homed_read(axis)


def _prepare_peer(request: Request, axis: Axis, first: Meaning) -> AddedFrame | None:
    """Return the next frame by which an axis comes to hold its target as it has to run it.

    It will be run as the first trigger of its group runs its own: a target of the same number, by the same
    kind of move where that is the trigger's to say.

    A target that it was stopped on the way to may be meant to run once more, or not: it holds nobody up.
    """
    number, motion = axis.rules.staged, axis.plan.motion
    if not motion.waits_for_trigger:
        return None
    count = len(axis.plan.command)
    if first.number is not None and 1 < count > first.number:
        number = first.number
    words = None if number is None else axis.fields[number].nominal_words
    is_torn = any(field.is_torn for field in (axis.fields if number is None else (axis.fields[number],)))
    if number is None or words is None or is_torn:
        may_pass = axis.passes_unchanged or motion.passes_stored_moves
        if (axis.holds_unrun or is_torn) and not may_pass:
            raise RefusedRequestError(
                ExceptionCode.SERVER_DEVICE_FAILURE,
                axis.plan.name,
                "the first trigger of its group is refused, for this axis could not follow: its target was "
                "lost or forgotten, write it again",
                EventKind.STORED_MOVE,
            )
        return None
    if not axis.holds_unrun and axis.motion.state is not MotionState.STOPPED:
        return None  # it has run that
    try:
        return _prepare_staged(request, axis, number, words, first.action)
    except RefusedRequestError as refusal:
        if not axis.holds_unrun:
            return None
        reason = (
            f"the first trigger of its group is refused, for this axis could not follow: {refusal.reason}"
        )
        raise RefusedRequestError(refusal.code, refusal.axis, reason, refusal.kind) from refusal


def _prepare_staged(
    request: Request, axis: Axis, number: int, words: bytes, first: Action
) -> AddedFrame | None:
    known, name = request.known, axis.plan.name
    run = known.peer_runs.get(name)
    if run is None:
        mode, action = axis.plan.motion.mode(number), first
        lost_mode = axis.rules.lost_mode(number)
        if lost_mode is not None:
            reason = (
                "a trigger, but a target, its mode or a part of it was lost before: write all of it again"
            )
            raise RefusedRequestError(lost_mode, name, reason, EventKind.AXIS_BLOCKED)
        if mode is None:
            action = action if may_run_distances(axis) else Action.ABSOLUTE
        elif mode.is_in_frame:
            return None
        else:
            word = axis.rules.word(mode.address)
            if word is None:
                is_asked = not axis.may_read or mode.address in known.rule_words.get(name, {})
                return None if is_asked else read_word(axis, mode.address)
            action = mode.action(word)
        action = Action.ABSOLUTE if action is Action.START else action
        if not action.runs_target or (action.is_relative and not axis.holds_unrun):
            return None
        added = read_for_staged(request, axis, number, words, action)
        if added is not None:
            return added
        run = render_run(request, axis, number, words, action)
        if run is None:
            return None
        known.peer_runs[name] = run
    return restage_for_run(axis, run)
