"""What a request changes in its axes: when it is sent, when it ends, and when it was never sent (M3, M7).

Only a complete normal reply proves that the drive obeyed. After any other end the drive may have written the
data or not, unless an exception proves that it did not (``Axis.writes_nothing``). So each function here calls
the methods of ``Axis`` for what is proven and for what stays unknown.
"""

from collections.abc import Sequence

from gateway.drives.motion import Action
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.axis import MOVES_OTHERWISE, Axis
from gateway.exchange.axis.reference import ReferenceEvent
from gateway.exchange.axis.registers import Loss
from gateway.exchange.decode import AxisCommand, Part
from gateway.exchange.group import end_in_group, leave_in_group, report_skew
from gateway.exchange.request import Request
from gateway.modbus.pdu import ABSENT

# --- when it is sent ---------------------------------------------------------------------------------------


def leave(request: Request, now_ns: int) -> int:
    """A request is sent next: record what must be known if the process dies before the reply.

    Returns:
        The number of axes for which it has a meaning that the register map does not know.
    """
    return sum([_leave_to(command, now_ns) for command in request.commands])


def _leave_to(command: AxisCommand, now_ns: int) -> bool:
    axis = command.axis
    leave_in_group(command, now_ns)
    for rendering in (*command.targets, *command.runs):
        axis.send_target(rendering)
    if command.is_stop:  # an axis found on its way counts as stopped anyway (``Recall.may_have_stopped``)
        is_target_unknown = command.sets_position_too or axis.acknowledgement.pending is not None
    else:
        runs_unknown = command.runs_alone and not command.runs
        is_target_unknown = command.action in MOVES_OTHERWISE or command.is_doubtful or runs_unknown
    if is_target_unknown:
        axis.send_motion()
    if command.untracked or command.goes_unknown or command.remaps:
        axis.send_motion()
    is_unknown = command.action is Action.UNKNOWN and not axis.passes_unchanged
    if is_unknown:
        _report_unknown(command)
    return is_unknown


def _report_unknown(command: AxisCommand) -> None:
    """Report a frame with a meaning that the register map does not know: once for the same contents."""
    axis, words = command.axis, dict(command.words)
    mode = None if command.number is None else axis.rules.plan.mode(command.number)
    word = None if mode is None else axis.rules.word(mode.address)
    if mode is not None and word is not None:
        words.setdefault(mode.address, word)
    axis.reports.report_unknown(tuple(sorted(words.items())))


# --- when it ends ------------------------------------------------------------------------------------------


def finish(request: Request, outcome: Outcome, code: int, now_ns: int) -> None:
    """Apply the end of a request that was sent; ``code``: its exception code, if it ended with one."""
    for command in request.commands:
        axis = command.axis
        if outcome is Outcome.ACKNOWLEDGED:
            _obeyed(request, command, now_ns)
        else:
            _not_obeyed(request, command, outcome, code, now_ns)
        if command.modes_written and axis.reference.ends_with_mode and _leaves_homing(command):
            axis.reference_happens(ReferenceEvent.OTHER_MOTION)  # its bit was read before
        axis.acknowledgement.conclude(axis.motion.unacknowledged)
        end_in_group(request, command, outcome, code, now_ns)
        if command.remaps:
            for member in (axis, *axis.peers):
                member.end()


def _leaves_homing(command: AxisCommand) -> bool:
    """Whether a request writes a mode that does not home, or one that is unknown."""
    for mode in command.axis.rules.plan.modes:
        if mode is not None and mode.address in command.modes_written:
            word = command.words.get(mode.address)
            if word is None or mode.action(word) is not Action.HOME:
                return True
    return False


def _obeyed(request: Request, command: AxisCommand, now_ns: int) -> None:
    """The drive acknowledged a request completely (M7)."""
    axis = command.axis
    for image, nominal_words, corrected_words, epoch, written in command.stagings:
        image.settle(nominal_words, corrected_words, epoch, written)
    for part in command.buffered_parts:
        part.image.buffer(part.first, part.words, request.arrived_ns, request.follows_ns)
    for rendering in (*command.targets, *command.runs):
        axis.targets.acknowledge(rendering, now_ns, command.epochs.get(rendering.number))
        axis.reports.report_beginning()
    _write_blindly(request, command, now_ns)
    if command.goes_unknown:
        _go_unknown(command, now_ns)
    rules, action = axis.rules, command.action
    if command.words or command.coils or command.unclear_words:
        rules.store_words(dict(command.words), command.epoch)
        rules.store_coils(dict(command.coils))
        rules.invalidate(dict.fromkeys(command.unclear_words, 0), {})
    for number in command.written:
        rules.stage(number)
    if command.runs_target:
        axis.targets.mark_run(action)
        axis.reference_happens(ReferenceEvent.OTHER_MOTION)
    elif command.written:
        axis.targets.mark_staged()
    if command.number is not None and (command.runs_target or action is Action.UNKNOWN):
        mode = rules.plan.mode(command.number)
        if mode is not None and mode.resets_to is not None:  # after any move, known or not
            rules.store_words({mode.address: mode.resets_to}, command.epoch)
    if action in MOVES_OTHERWISE:
        _move_otherwise(command, now_ns, is_certain=True)
    elif command.is_doubtful:
        axis.motion.displace(now_ns, keeps_branch=True)  # readings rely on the branch already
    if command.written and not any(axis.fields[number].is_incomplete for number in command.written):
        axis.release_triggers(command.epoch)
    if command.runs_alone and not command.is_run_known and not _runs_superseded(command):
        axis.motion.displace(now_ns)


def _runs_superseded(command: AxisCommand) -> bool:
    """Whether a request runs the target from before a loss unchanged: its axis does not move."""
    superseded = command.axis.motion.superseded
    if superseded is None:
        return False
    words = (superseded.nominal_words, superseded.corrected_words)
    return any((run.nominal_words, run.corrected_words) == words for run in command.runs)


def _not_obeyed(request: Request, command: AxisCommand, outcome: Outcome, code: int, now_ns: int) -> None:
    """A request was sent and not acknowledged; the register map says what a refusal proves (M7)."""
    axis = command.axis
    is_broadcast = outcome is Outcome.BROADCAST
    is_refusal = outcome is Outcome.EXCEPTION and code not in ABSENT
    is_undone = is_refusal and axis.writes_nothing(code, reads_too=request.reads_too)
    if not is_undone:
        for rendering in command.targets:
            axis.targets.leave_unacknowledged(rendering, now_ns)
        for rendering in command.runs:
            axis.targets.leave_run_unacknowledged(rendering, now_ns)
        for part in command.buffered_parts:
            part.image.invalidate()
        for staging in command.stagings:
            staging.image.leave(staging.nominal_words, staging.corrected_words)
            staging.image.forget()
    if not is_broadcast:
        loss = Loss.REFUSED_UNWRITTEN if is_undone else Loss.REFUSED
        _lose(command.parts, loss, request.arrived_ns, request.follows_ns, now_ns)
    _write_blindly(request, command, now_ns)
    if command.goes_unknown and not is_undone:
        _go_unknown(command, now_ns)
    if not is_undone:
        unclear = dict.fromkeys(command.unclear_words, 0)
        axis.rules.invalidate({**command.words, **unclear}, dict(command.coils))
        if command.action in MOVES_OTHERWISE:
            _move_otherwise(command, now_ns, is_certain=False)
        elif command.runs_alone and not command.is_run_known and not _runs_superseded(command):
            axis.motion.displace(now_ns)
    if is_broadcast and command.runs_target:
        axis.targets.mark_run(command.action)  # no drive answers a broadcast: the target counts as run
    if not (is_broadcast or (axis.passes_unchanged and is_refusal)):
        _block_for(command, code)


def _go_unknown(command: AxisCommand, now_ns: int) -> None:
    """The axis goes to an unknown position; its branch is flagged if its words were not corrected for it."""
    axis = command.axis
    axis.motion.displace(now_ns)
    if command.is_uncorrected and not axis.passes_unchanged:
        axis.compensation.invalidate()


def _write_blindly(request: Request, command: AxisCommand, now_ns: int) -> None:
    """The content of written command fields is unknown, and so is where the axis goes with them."""
    for image in command.untracked:
        command.axis.motion.displace(now_ns)
        image.forget()
        if image.is_incomplete:  # words lost before are older than what was sent now
            image.lose_all_words(request.arrived_ns)


def _move_otherwise(command: AxisCommand, now_ns: int, *, is_certain: bool) -> None:
    """Something other than a target moves the axis, stops it, or moves its zero."""
    axis = command.axis
    _move_by(axis, command.action, now_ns, is_certain=is_certain)
    may_run_written = command.action is Action.UNKNOWN and bool(command.hits)
    if (command.runs_stored or may_run_written) and not axis.passes_unchanged:
        axis.compensation.invalidate()  # those words were not corrected for it
    if command.sets_position_too:
        _move_by(axis, Action.SET_POSITION, now_ns, is_certain=is_certain)


def _move_by(axis: Axis, action: Action, now_ns: int, *, is_certain: bool) -> None:
    is_at_rest = not axis.motion.is_moving
    moved_ns = None if action in (Action.STOP, Action.SET_POSITION) else now_ns
    axis.motion.displace(moved_ns, keeps_branch=action is Action.STOP)
    if action in (Action.HOME, Action.SET_POSITION):
        axis.move_zero(is_certain=is_certain)
    if action is Action.HOME:
        axis.begin_homing(now_ns, is_certain=is_certain)
    elif action is Action.SET_POSITION:
        is_set_at_rest = is_at_rest and is_certain
        axis.compensation.read_as_set()
        axis.reference_happens(ReferenceEvent.SET_AT_REST if is_set_at_rest else ReferenceEvent.SET_MOVING)
    else:
        axis.reference_happens(ReferenceEvent.OTHER_MOTION)


# --- what was lost -----------------------------------------------------------------------------------------


def lose(
    axis: Axis,
    parts: Sequence[Part],
    command: AxisCommand | None,
    code: int,
    loss: Loss,
    *,
    arrived_ns: int,
    follows_ns: int,
) -> None:
    """A request never reached the drive: what it wrote is lost, and its fields are incomplete (M3)."""
    _lose(parts, loss, arrived_ns, follows_ns, arrived_ns)
    if command is not None:
        if command.runs_target:
            report_skew(axis, code)
        _block_for(command, code)


def _lose(parts: Sequence[Part], loss: Loss, arrived_ns: int, follows_ns: int, now_ns: int) -> None:
    for image, first, words in parts:
        if first < 0:
            image.lose_all_words(arrived_ns)
        else:
            image.lose(loss, first, words, arrived_ns=arrived_ns, follows_ns=follows_ns, now_ns=now_ns)


def _block_for(command: AxisCommand, code: int) -> None:
    """A target, its mode or a part of it was lost: refuse its triggers from now on (M3)."""
    axis = command.axis
    # The other axes of a gantry must not start alone (M11). A run that was refused because of them blocks
    # none of them.
    is_run_of_gantry = bool(axis.peers) and command.runs_target and axis.blocked_by_peer is None
    may_stand = axis.waits_for_trigger or bool(axis.peers)
    if not may_stand or not (command.written or command.writes_mode or is_run_of_gantry):
        return
    for address in command.modes_written:
        axis.lose_mode(address, code)
    if command.written or is_run_of_gantry:
        why = (
            f"a target or its mode was lost (exception {code:#04x}): triggers are refused until a "
            "complete one was accepted; stops always pass"
        )
        # A lost frame that only stages a target blocks the whole group: no other axis may start without this.
        is_own = axis.blocked_by_peer is None or not command.runs_target
        axis.block_triggers(code, why, is_own=is_own)
