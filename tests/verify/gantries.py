"""What somebody beside a beam writes down of its moves: by which decision each axis has to go (M11).

Nothing of it is worked out by the gateway. The first trigger of a group says what counts for all of its axes;
each one that follows is judged by that, whatever was switched or lost meanwhile (``rules.judge_motion``). So
the axes of a group are never skewed by a correction.
"""

from typing import TYPE_CHECKING, NamedTuple

from tests.verify import facts, rules
from tests.verify.errors import BrokenRuleError

if TYPE_CHECKING:
    from tests.verify.world import Asked, Wire, World


class Gantry(NamedTuple):
    """What the first trigger has fixed."""

    said: tuple[str, ...]
    """The state of the compensation of each axis."""
    table: int
    is_gain_half: bool
    held: tuple[int, ...] = ()
    """The target that each axis held then, in nominal counts, of drives that wait for a trigger."""
    gone: tuple[int, ...] = ()
    """The axes that have gone since."""
    perhaps: tuple[tuple[int, int | None], ...] = ()
    """The axes that were sent off before any had gone for certain, and where to (None: to what their drives
    held): no answer proves that they went, or that they did not."""
    anew: tuple[int, ...] = ()
    """The axes whose drives went by what was fixed."""
    kept: tuple[int, ...] = ()
    """Those whose drives went by words of another switch, table or gain (M4)."""
    is_doubtful: bool = False
    """An axis that has gone was told something of which nobody can say whether it is another target: the same
    round may go on, or a new one may have begun."""
    others: tuple[tuple[tuple[str, ...], int, bool], ...] = ()
    """What a first trigger may have fixed since then."""


def in_force(world: "World", number: int) -> tuple[str, int, bool]:
    """Return by what an axis has to go now."""
    gantry = world.state.gantry
    if gantry is None:
        return world.said(number).compensation, world.state.table, world.state.is_gain_half
    return gantry.said[number], gantry.table, gantry.is_gain_half


def is_fixed(world: "World") -> bool:
    """Whether the references of a group are no question any more."""
    return world.state.gantry is not None


def is_doubtful(world: "World") -> bool:
    """Whether nobody can say if a new round has begun."""
    return world.state.gantry is not None and world.state.gantry.is_doubtful


def others_in_force(world: "World", number: int) -> tuple[tuple[str, int, bool], ...]:
    """Return by what else an axis may have to go where nobody can say whether a new round has begun."""
    gantry = world.state.gantry
    if gantry is None:
        return ()
    return tuple((said[number], table, is_half) for said, table, is_half in gantry.others)


def _asked_now(world: "World") -> tuple[tuple[str, ...], int, bool]:
    said = tuple(world.said(each).compensation for each in range(len(world.state.axes)))
    return said, world.state.table, world.state.is_gain_half


def leaves(world: "World", number: int, nominal_counts: int, *, is_known: bool) -> None:
    """A trigger, or a target that is gone to at once, is about to leave. Raises BrokenRuleError.

    ``is_known``: its controller has written that target; else its drive runs what it keeps.
    """
    gantry, run = world.state.gantry, world.state.axes[number].run
    if not world.design.groups:
        return
    if gantry is not None:
        perhaps = dict(gantry.perhaps)
        is_other = may_be_other = False
        if number in gantry.gone:
            is_other = run is not None and run.nominal_counts != nominal_counts
            may_be_other = run is None or not (run.is_told and is_known)
        elif number in perhaps:
            is_other = perhaps[number] != nominal_counts
            may_be_other = perhaps[number] is None or not is_known
        if may_be_other or gantry.is_doubtful:
            others = dict.fromkeys((*gantry.others, _asked_now(world)))
            gantry = gantry._replace(is_doubtful=True, others=tuple(others))
        elif is_other:
            gantry = None
    if gantry is None:
        for each in range(len(world.state.axes)):
            is_old = facts.is_found(world, each) and facts.has_to_ask(world, each, is_target=True)
            if each != number and is_old:  # else it was told that it is not homed, and all of them pass 1:1
                why = "the first of a beam goes, and the bit of another one was not read (M11)"
                raise BrokenRuleError(why)
        held = tuple(belief.steps * world.design.step_counts for belief in world.state.beliefs[0])
        gantry = Gantry(*_asked_now(world), held if world.design.is_staged else ())
    world.state = world.state._replace(gantry=gantry)


def goes(world: "World", number: int, nominal_counts: int, *, is_kept: bool) -> None:
    """A drive of a beam goes, by words of another decision or not. Raises BrokenRuleError."""
    gantry = world.state.gantry
    if gantry is None or gantry.is_doubtful:
        return
    if is_kept and set(gantry.anew) - {number}:
        raise BrokenRuleError(
            "an axis keeps words of another decision, and another one went by this one (M11)"
        )
    is_held = bool(gantry.held) and gantry.held[number] == nominal_counts
    if not is_kept and is_held and set(gantry.kept) - {number}:
        raise BrokenRuleError("an axis goes by this decision, and another one kept words of another (M11)")
    if is_kept:
        gantry = gantry._replace(kept=tuple(sorted({*gantry.kept, number})))
    else:
        gantry = gantry._replace(anew=tuple(sorted({*gantry.anew, number})))
    world.state = world.state._replace(gantry=gantry)


def is_anew(world: "World", number: int) -> bool:
    """Whether another axis does not keep words of another decision: then this one must not (M11)."""
    gantry = world.state.gantry
    if gantry is not None and (gantry.is_doubtful or set(gantry.anew) - {number}):
        return True
    for other, axis in enumerate(world.state.axes):
        if other == number:
            continue
        run, (compensation, table, is_half) = axis.run, in_force(world, other)
        belief = world.state.beliefs[0][other]
        is_staged_anew = world.design.is_staged and (
            run is None or belief.steps * world.design.step_counts != run.nominal_counts
        )
        is_by_this = run is not None and (
            (run.state in rules.PASSING, run.table, run.is_gain_half)
            == (compensation in rules.PASSING, table, is_half)
        )
        if is_staged_anew or is_by_this or run is None or not run.is_told or axis.tried is not None:
            return True
    return False


def ended(world: "World", wire: "Wire", *, is_native: bool, is_refused: bool = False) -> None:
    """A frame was answered, or never will be. ``is_refused``: so that nothing can have been obeyed."""
    gantry = world.state.gantry
    if gantry is None or wire.owner < 0 or gantry.is_doubtful:
        return
    number = facts.number_of(world, wire.unit_id)
    fixed: Gantry | None = gantry
    if wire.aim is not None and is_native:
        gone = tuple(sorted({*gantry.gone, number}))
        fixed = None if len(gone) == len(world.state.axes) else gantry._replace(gone=gone)
    elif wire.aim is not None:
        if not gantry.gone and not (is_refused and gantry.perhaps):  # else it is what the first one has fixed
            perhaps = {**dict(gantry.perhaps), number: None if wire.aim.is_lost else wire.aim.nominal_counts}
            fixed = None if is_refused else gantry._replace(perhaps=tuple(perhaps.items()))
    elif rules.writes_target(wire.pdu) and is_native and number in (*gantry.gone, *dict(gantry.perhaps)):
        # Its next target: a new round begins, unless that is the one to which it has gone.
        nominal_counts = world.state.beliefs[wire.owner][number].steps * world.design.step_counts
        run = world.state.axes[number].run
        if number in gantry.gone:
            gone_to = None if run is None or not run.is_told else run.nominal_counts
        else:
            gone_to = dict(gantry.perhaps)[number]
        if gone_to is None:
            fixed = gantry._replace(is_doubtful=True)
        elif gone_to != nominal_counts:
            fixed = None
    world.state = world.state._replace(gantry=fixed)


def never_left(world: "World", request: "Asked") -> None:
    """An axis that has gone was asked for what may be another target, and nothing of that left."""
    gantry = world.state.gantry
    runs = request.pdu in rules.RUNS or (rules.writes_target(request.pdu) and not world.design.is_staged)
    if gantry is not None and runs and request.axis in (*gantry.gone, *dict(gantry.perhaps)):
        world.state = world.state._replace(gantry=gantry._replace(is_doubtful=True))


def broken_off(world: "World") -> None:
    """An axis is stopped or moved otherwise, the link is lost, or the gateway was killed."""
    if world.state.gantry is not None:
        world.state = world.state._replace(gantry=None)
