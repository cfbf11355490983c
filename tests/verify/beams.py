"""What somebody beside a beam writes down of its moves: by which decision each axis has to go (M11).

Nothing of it is worked out by the gateway. The first trigger of a group says what counts for all of its axes;
each one that follows is judged by that, whatever was switched or lost meanwhile (``rules.judge_motion``). So
the axes of a group are never skewed by a correction.
"""

from typing import TYPE_CHECKING, NamedTuple

from tests.verify import facts, rules
from tests.verify.errors import BrokenRuleError

if TYPE_CHECKING:
    from tests.verify.world import Wire, World


class Beam(NamedTuple):
    """What the first trigger has fixed."""

    said: tuple[str, ...]
    """The state of the compensation of each axis."""
    table: int
    is_gain_half: bool
    held: tuple[int, ...] = ()
    """The target that each axis held then, in nominal counts, of drives that wait for a trigger."""
    gone: tuple[int, ...] = ()
    """The axes that have gone since."""
    perhaps: tuple[int, int] | tuple[()] = ()
    """The axis that was the first, of which no answer proves that it went or did not, and where to."""
    anew: tuple[int, ...] = ()
    """The axes whose drives went by what was fixed."""
    kept: tuple[int, ...] = ()
    """Those whose drives went by words of another switch, table or gain (M4)."""


def in_force(world: "World", number: int) -> tuple[str, int, bool]:
    """Return by what an axis has to go now."""
    beam = world.state.beam
    if beam is None:
        return world.said(number).compensation, world.state.table, world.state.is_gain_half
    return beam.said[number], beam.table, beam.is_gain_half


def is_fixed(world: "World") -> bool:
    """Whether the references of a group are no question any more."""
    return world.state.beam is not None


def leaves(world: "World", number: int, nominal_counts: int) -> None:
    """A trigger, or a target that is gone to at once, is about to leave. Raises BrokenRuleError."""
    beam, run = world.state.beam, world.state.axes[number].run
    if not world.design.groups:
        return
    if beam is not None and number in beam.gone and (run is None or run.nominal_counts != nominal_counts):
        beam = None  # another target: a new round
    elif (
        beam is not None and beam.perhaps and beam.perhaps[0] == number and beam.perhaps[1] != nominal_counts
    ):
        beam = None
    if beam is not None:
        return
    members = range(len(world.state.axes))
    for each in members:
        is_old = facts.is_found(world, each) and facts.has_to_ask(world, each, is_target=True)
        if each != number and is_old:  # else it was told that it is not homed, and all of them pass 1:1
            raise BrokenRuleError("the first of a beam goes, and the bit of another one was not read (M11)")
    said = tuple(world.said(each).compensation for each in members)
    steps = world.design.step_counts
    held = tuple(belief.steps * steps for belief in world.state.beliefs[0]) if world.design.is_staged else ()
    found = Beam(said, world.state.table, world.state.is_gain_half, held)
    world.state = world.state._replace(beam=found)


def goes(world: "World", number: int, nominal_counts: int, *, is_kept: bool) -> None:
    """A drive of a beam goes, by words of another decision or not. Raises BrokenRuleError."""
    beam = world.state.beam
    if beam is None:
        return
    if is_kept and set(beam.anew) - {number}:
        raise BrokenRuleError(
            "an axis keeps words of another decision, and another one went by this one (M11)"
        )
    is_held = bool(beam.held) and beam.held[number] == nominal_counts
    if not is_kept and is_held and set(beam.kept) - {number}:
        raise BrokenRuleError("an axis goes by this decision, and another one kept words of another (M11)")
    if is_kept:
        beam = beam._replace(kept=tuple(sorted({*beam.kept, number})))
    else:
        beam = beam._replace(anew=tuple(sorted({*beam.anew, number})))
    world.state = world.state._replace(beam=beam)


def is_anew(world: "World", number: int) -> bool:
    """Whether another axis does not keep words of another decision: then this one must not (M11)."""
    if world.state.beam is not None and set(world.state.beam.anew) - {number}:
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
    beam = world.state.beam
    if beam is None or wire.owner < 0:
        return
    number = facts.number_of(world, wire.unit_id)
    run = world.state.axes[number].run
    if wire.aim is not None and is_native:
        gone = tuple(sorted({*beam.gone, number}))
        is_whole = len(gone) == len(world.state.axes)
        world.state = world.state._replace(beam=None if is_whole else beam._replace(gone=gone))
    elif wire.aim is not None:
        if beam.gone or beam.perhaps:
            return  # what the first one has fixed
        perhaps = (number, wire.aim.nominal_counts)
        world.state = world.state._replace(beam=None if is_refused else beam._replace(perhaps=perhaps))
    elif rules.writes_target(wire.pdu) and is_native and beam.perhaps and beam.perhaps[0] == number:
        belief = world.state.beliefs[wire.owner][number]
        is_same = beam.perhaps[1] == belief.steps * world.design.step_counts
        world.state = world.state._replace(beam=beam if is_same else None)
    elif rules.writes_target(wire.pdu) and is_native and number in beam.gone:
        # Its next target: a new round begins, unless that is the one to which it has gone.
        belief = world.state.beliefs[wire.owner][number]
        is_same = (
            run is not None and run.is_told and run.nominal_counts == belief.steps * world.design.step_counts
        )
        world.state = world.state._replace(beam=beam if is_same else None)


def refused(world: "World", port: int, number: int) -> None:
    """A trigger was refused of an axis that has gone to a place that nobody knows: a new round."""
    beam = world.state.beam
    is_gone = beam is not None and number in (*beam.gone, *beam.perhaps[:1])
    if is_gone and world.state.beliefs[port][number].lost:
        world.state = world.state._replace(beam=None)


def broken_off(world: "World") -> None:
    """An axis is stopped or moved otherwise, the link is lost, or the gateway was killed."""
    if world.state.beam is not None:
        world.state = world.state._replace(beam=None)
