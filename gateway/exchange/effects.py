"""What a request leaves behind on an axis beside its positions: stops, homing, modes, blocks."""

from typing import Final

from gateway.drives.motion import Action
from gateway.exchange.events import EventKind
from gateway.exchange.meaning import Meaning
from gateway.exchange.refusal import RefusedRequestError
from gateway.modbus.pdu import ExceptionCode

MOVES_OTHERWISE: Final = frozenset(
    {
        Action.STOP,
        Action.HOME,
        Action.SET_POSITION,
        Action.STORED,
        Action.OTHER_MOTION,
        Action.UNKNOWN,
    }
)
"""Actions after which the last target does not say any more where the axis is."""


def check_may_act(meaning: Meaning) -> None:
    """Refuse what must not run: a stored position, a trigger whose target was lost.

    Raises:
        RefusedRequestError: with the exception code of the lost target, or 4.
    """
    axis = meaning.axis
    motion = axis.motion
    action = meaning.action
    if action is Action.STORED and not (axis.passes_unchanged or motion.plan.passes_stored_moves):
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
    axis, motion, action = meaning.axis, meaning.axis.motion, meaning.action
    runs_unseen = meaning.runs_alone or (action is Action.UNKNOWN and not meaning.commands)
    if runs_unseen and axis.blocked_by is not None:
        return axis.blocked_by
    if not action.runs_target and action is not Action.UNKNOWN:
        return None
    mode = None if meaning.number is None else motion.plan.mode(meaning.number)
    lost_mode = motion.lost_mode(meaning.number)
    if lost_mode is not None and mode is not None and mode.address not in meaning.words:
        return lost_mode
    return axis.blocked_by_peer if action.runs_target else None


def note_done(meaning: Meaning, now_ns: int) -> None:
    """Take note of a request that the drive acknowledged in full."""
    axis, motion, action = meaning.axis, meaning.axis.motion, meaning.action
    motion.note_words(dict(meaning.words), meaning.losses)
    motion.note_coils(dict(meaning.coils))
    motion.doubt(dict.fromkeys(meaning.unclear_words, 0), {})
    for hit in meaning.commands:
        motion.staged = hit.place.number
    if action.runs_target:
        axis.reference.note_homing_ended()
        motion.last_run = action
        mode = None if meaning.number is None else motion.plan.mode(meaning.number)
        if mode is not None and mode.resets_to is not None:
            motion.note_words({mode.address: mode.resets_to}, meaning.losses)
    if action in MOVES_OTHERWISE:
        _move_otherwise(meaning, now_ns)
    elif meaning.is_doubtful:
        axis.forget_place(now_ns, keeps_branch=True)  # the reading counts on it already
    is_whole = all(hit.place.shadow and not hit.place.shadow.is_torn for hit in meaning.commands)
    if meaning.commands and is_whole and motion.release(meaning.losses):
        axis.tell(EventKind.AXIS_RELEASED, "a complete target was accepted: its triggers pass again")


def note_failed(
    meaning: Meaning,
    code: int,
    now_ns: int,
    *,
    is_refusal: bool,
    is_run_known: bool,
    is_broadcast: bool = False,
) -> None:
    """Take note of a request that was sent and not acknowledged; what a refusal proves, the map says (M7)."""
    axis = meaning.axis
    if not (is_refusal and axis.writes_nothing(code)):
        axis.motion.doubt({**meaning.words, **dict.fromkeys(meaning.unclear_words, 0)}, dict(meaning.coils))
        if meaning.action in MOVES_OTHERWISE:
            _move_otherwise(meaning, now_ns, is_certain=False)
        elif meaning.runs_alone and not is_run_known:
            axis.forget_place(now_ns)
    if not (is_broadcast or (axis.passes_unchanged and is_refusal)):
        block(meaning, code)


def note_unknown(found: list[Meaning]) -> int:
    """Report frames that mean something the register map does not know; return how many there are."""
    unknown = [m for m in found if m.action is Action.UNKNOWN and not m.axis.passes_unchanged]
    for meaning in unknown:
        words = _contents(meaning)
        if meaning.axis.motion.told_unknown != words:
            meaning.axis.motion.told_unknown = words
            shown = ", ".join(f"{address:#06x} = {word:#06x}" for address, word in words)
            what = (
                f"the register map does not know {shown}" if shown else "nobody can tell what a frame means"
            )
            meaning.axis.tell(EventKind.UNKNOWN_MODE, f"{what}: it passed untouched")
    return len(unknown)


def _contents(meaning: Meaning) -> tuple[tuple[int, int], ...]:
    """Return the mode and trigger registers that decided, with what they hold."""
    motion = meaning.axis.motion
    words = dict(meaning.words)
    mode = None if meaning.number is None else motion.plan.mode(meaning.number)
    held = None if mode is None else motion.word(mode.address)
    if mode is not None and held is not None:
        words.setdefault(mode.address, held)
    return tuple(sorted(words.items()))


def block(meaning: Meaning, code: int) -> None:
    """A target, its mode or a part of it was lost: its triggers are refused from now on (M3)."""
    axis, motion = meaning.axis, meaning.axis.motion
    # The others of a beam must not go alone (M11); a run refused for their sake holds nobody up.
    is_run_of_beam = bool(axis.peers) and meaning.action.runs_target and axis.blocked_by_peer is None
    may_stand = motion.plan.waits_for_trigger or bool(axis.peers)
    if not may_stand or not (meaning.commands or meaning.writes_mode or is_run_of_beam):
        return
    for mode in motion.plan.modes:
        if mode is not None and (mode.address in meaning.words or mode.address in meaning.unclear_words):
            motion.lose_mode(mode.address, code)
    if (meaning.commands or is_run_of_beam) and motion.block(code, is_first=axis.blocked_by_peer is None):
        axis.tell(
            EventKind.AXIS_BLOCKED,
            f"a target or its mode was lost (exception {code:#04x}): triggers are refused until a complete "
            "one was accepted; stops always pass",
        )


def _move_otherwise(meaning: Meaning, now_ns: int, *, is_certain: bool = True) -> None:
    axis, action = meaning.axis, meaning.action
    is_at_rest = axis.is_moving is not True
    was_referenced = axis.is_referenced
    moved_ns = None if action in (Action.STOP, Action.SET_POSITION) else now_ns
    axis.forget_place(moved_ns, keeps_branch=action is Action.STOP)
    if action in (Action.HOME, Action.SET_POSITION):
        axis.doubt_words()
        axis.actual = None  # it was counted from another zero
        axis.begin_stream_anew()
    if action is Action.HOME:
        axis.reference.note_homing(now_ns)
        if not is_certain:
            axis.reference.note_homing_ended()
    elif action is Action.SET_POSITION:
        axis.reference.note_position_set(is_at_rest=is_at_rest and is_certain)
    else:
        axis.reference.note_homing_ended()
        axis.motion.runs_stored |= action is Action.STORED
    axis.follow_reference(was_referenced=was_referenced)
