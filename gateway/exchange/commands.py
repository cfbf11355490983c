"""The command fields of one request: what each of them becomes (M1 to M5, M8)."""

from collections.abc import Sequence

from gateway.drives.motion import Action, Addressing
from gateway.exchange.axis import AxisExchange, Rendering
from gateway.exchange.effects import MOVES_OTHERWISE
from gateway.exchange.events import EventKind
from gateway.exchange.known import Known, Standing
from gateway.exchange.meaning import Meaning
from gateway.exchange.parts import nominal_words, written_part
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.relative import base_of
from gateway.exchange.rendering import (
    RefusedPositionError,
    Seen,
    is_repeat,
    render,
    render_distance,
    render_repeat,
)
from gateway.exchange.request import Request
from gateway.exchange.rewriting import Rewriting, Staging
from gateway.exchange.unit import FieldHit
from gateway.modbus.pdu import ExceptionCode

Written = tuple[FieldHit, bytes | None]
"""A command field, and all its nominal words once the request is applied; None: not known."""


def prepare_commands(rewriting: Rewriting, hits: Sequence[FieldHit]) -> list[tuple[FieldHit, bytes]]:
    """Render the command fields of a request.

    Returns:
        The fields whose words go out changed, with all their corrected words.

    Raises:
        RefusedRequestError: the request must not reach the drive.
    """
    request = rewriting.request
    meanings = {id(meaning.axis): meaning for meaning in request.meanings}
    axes = {id(hit.place.axis): hit.place.axis for hit in hits}
    changed: list[tuple[FieldHit, bytes]] = []
    has_stop = any(meaning.is_stop for meaning in request.meanings)
    for key, axis in axes.items():
        own = [hit for hit in hits if hit.place.axis is axis]
        for hit in own:
            if _is_no_part(hit):
                assert hit.place.shadow is not None
                rewriting.touched_blindly += ((axis, hit.place.shadow),)
        written: list[Written] = [
            (hit, nominal_words(hit, request) if request.access.is_consistent else None)
            for hit in own
            if not _is_no_part(hit)
        ]
        try:
            changed += _prepare_axis(rewriting, axis, meanings.get(key), written)
        except RefusedRequestError:
            if not has_stop:
                raise
            for hit, words in written:  # a stop of another axis is in the same frame: it is never refused
                _pass_raw(rewriting, hit, words)
    return changed


def _is_no_part(hit: FieldHit) -> bool:
    """Whether a cut position is none at all: where addresses are commands or objects, there are no halves."""
    is_object = hit.place.axis.plan.addressing is Addressing.OBJECTS
    return not hit.is_whole and (is_object or hit.place.field.block is not None)


def _prepare_axis(
    rewriting: Rewriting,
    axis: AxisExchange,
    meaning: Meaning | None,
    written: list[Written],
) -> list[tuple[FieldHit, bytes]]:
    if meaning is None:
        return _run(rewriting, axis, Action.ABSOLUTE, written)
    if meaning.action in MOVES_OTHERWISE:
        for hit, words in written:
            _pass_raw(rewriting, hit, words)
        return []
    running = meaning.running
    changed = _run(rewriting, axis, meaning.action, [w for w in written if w[0] in running])
    for hit, words in written:
        if hit not in running:
            changed += _stage(rewriting, meaning, hit, words)
    return changed


# --- targets that the drive goes to --------------------------------------------------------------------


def _run(
    rewriting: Rewriting,
    axis: AxisExchange,
    action: Action,
    written: list[Written],
) -> list[tuple[FieldHit, bytes]]:
    again = not axis.motion.plan.waits_for_trigger and not action.is_relative and is_again(axis, written)
    changed = []
    for hit, words in written:
        if words is None:
            _refuse_unknown(rewriting, hit)
            continue
        rendering = _render(rewriting, hit, words, action, is_again=again)
        if rendering is None:
            continue
        rewriting.renderings += (rendering,)
        if not axis.passes_unchanged or rendering.corrected_words != words:
            changed.append((hit, rendering.corrected_words))
    return changed


def _render(
    rewriting: Rewriting,
    hit: FieldHit,
    words: bytes,
    action: Action,
    *,
    is_again: bool,
) -> Rendering | None:
    """Render one command field; None for a 1:1 write that leaves its content unknown."""
    place = hit.place
    axis, shadow, request = place.axis, place.shadow, rewriting.request
    assert shadow is not None
    if is_again:
        return render_repeat(axis, shadow, is_passing=axis.passes_unchanged)
    try:
        if action.is_relative:
            rendering = render_relative(request, axis, place.number, words, action)
            if rendering is None:
                rewriting.stagings += (Staging(shadow, words, words, shadow.losses),)
                rewriting.moved_unknown += (axis,)
            return rendering
        return render(axis, place.number, words, seen(request, axis))
    except RefusedPositionError as error:
        if axis.passes_unchanged:
            rewriting.touched_blindly += ((axis, shadow),)
            return None
        name = axis.plan.name
        raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, name, str(error)) from error


def seen(request: Request, axis: AxisExchange) -> Seen:
    """Return what a target is rendered with: the time, and an actual position that was read for it."""
    return Seen(request.now_ns, request.known.actual.get(axis.plan.name))


def render_relative(
    request: Request, axis: AxisExchange, number: int, words: bytes, action: Action
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
    if axis.motion.plan.passes_unknown_relative:
        axis.tell(EventKind.BASE_UNKNOWN, f"a relative move passed unchanged: {why}")
        return None
    raise RefusedRequestError(
        ExceptionCode.SERVER_DEVICE_BUSY,
        axis.plan.name,
        f'a relative move, and {why} (relative_unknown = "pass" lets it through unchanged)',
        EventKind.BASE_UNKNOWN,
    )


def is_again(axis: AxisExchange, written: list[Written]) -> bool:
    """Whether a request writes nothing into the axis's command fields but what they hold already (M4).

    A cyclic image with several command fields is judged as a whole; one field rewritten alone is a target.
    """
    return any(hit.place.shadow is axis.last_shadow for hit, _ in written) and all(
        hit.place.shadow is not None and words is not None and is_repeat(axis, hit.place.shadow, words)
        for hit, words in written
    )


# --- targets that the drive only holds -----------------------------------------------------------------


def _pass_raw(rewriting: Rewriting, hit: FieldHit, words: bytes | None) -> None:
    """Let words go out as they came: in a stop, homing or unknown frame they are no target (M2)."""
    shadow = hit.place.shadow
    assert shadow is not None
    if words is None:
        rewriting.touched_blindly += ((hit.place.axis, shadow),)
        return
    first, part = written_part(hit, rewriting.request.pdu, rewriting.access)
    is_as_written = hit.is_whole or (hit.place.axis.passes_unchanged and not shadow.may_be_corrected)
    held = words if is_as_written else _merged(shadow.corrected_words, first, part)
    rewriting.stagings += (Staging(shadow, words, held, shadow.losses),)


def _stage(
    rewriting: Rewriting, meaning: Meaning, hit: FieldHit, words: bytes | None
) -> list[tuple[FieldHit, bytes]]:
    """Render a staged target as well as it can be foreseen; its trigger computes it anew (M2)."""
    axis, shadow = hit.place.axis, hit.place.shadow
    assert shadow is not None
    if words is None:
        if rewriting.access.is_mask or not rewriting.access.is_consistent:
            _refuse_unknown(rewriting, hit)
        else:  # its trigger is refused until the other parts have come
            rewriting.pending += (hit,)
        return []
    waits_for_other_words = bool(axis.motion.plan.starts_on) and not hit.is_whole
    if axis.passes_unchanged or waits_for_other_words:
        _pass_raw(rewriting, hit, words)
        return []
    corrected_words = _foreseen(rewriting.request, meaning, hit, words)
    held: bytes | None = corrected_words
    if axis.writes_words_alone and not hit.is_whole:
        first, part = written_part(hit, rewriting.request.pdu, rewriting.access)
        held = _merged(shadow.corrected_words, first, corrected_words[2 * first : 2 * first + len(part)])
    rewriting.stagings += (Staging(shadow, words, held, shadow.losses),)
    return [(hit, corrected_words)]


def _foreseen(request: Request, meaning: Meaning, hit: FieldHit, words: bytes) -> bytes:
    axis, number, shadow = hit.place.axis, hit.place.number, hit.place.shadow
    assert shadow is not None
    now = Seen(request.now_ns, None)
    if shadow.nominal_words == words and shadow.corrected_words is not None and not shadow.is_torn:
        return shadow.corrected_words
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


def _expected(meaning: Meaning, number: int) -> tuple[Action, bool]:
    """Return how a staged target will probably be run, and whether that is certain enough to refuse it."""
    motion = meaning.axis.motion
    mode = motion.plan.mode(number)
    if mode is None:
        can_be_relative = any(
            deed.action.is_relative for trigger in motion.plan.triggers for deed in trigger.deeds.values()
        )
        return (motion.last_run, False) if can_be_relative else (Action.ABSOLUTE, True)
    word = meaning.words.get(mode.address, motion.word(mode.address))
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

    Raises:
        RefusedRequestError: unless it may pass.
    """
    axis, shadow = hit.place.axis, hit.place.shadow
    assert shadow is not None
    if axis.passes_unchanged:
        rewriting.touched_blindly += ((axis, shadow),)
        return
    if not rewriting.access.is_consistent:
        raise RefusedRequestError(
            ExceptionCode.ILLEGAL_DATA_VALUE,
            axis.plan.name,
            f"the counts of a write to {_at(hit)} contradict each other",
        )
    reason = _why_incomplete(hit, rewriting.request)
    raise RefusedRequestError(ExceptionCode.SERVER_DEVICE_FAILURE, axis.plan.name, reason)


def _why_incomplete(hit: FieldHit, request: Request) -> str:
    if hit.place.shadow is not None and hit.place.shadow.is_torn:
        return f"a part of the position at {_at(hit)} was lost before: write all of it again"
    if request.access.is_mask or id(hit.place.shadow) not in request.known.command_words:
        return f"part of the position at {_at(hit)} was written and the rest is not known"
    return (
        f"part of the position at {_at(hit)} was written and the rest is not certain: what the drive holds "
        "may lie across a word's border from what was commanded; write all of it in one frame"
    )


def _at(hit: FieldHit) -> str:
    return f"register {hit.place.field.address:#06x}"
