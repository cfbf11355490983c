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
    gone: tuple[int, ...] = ()
    """The axes that have gone since."""


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
    if beam is not None:
        return
    members = range(len(world.state.axes))
    for each in members:
        is_old = facts.is_found(world, each) and facts.has_to_ask(world, each, is_target=True)
        if each != number and is_old:  # else it was told that it is not homed, and all of them pass 1:1
            raise BrokenRuleError("the first of a beam goes, and the bit of another one was not read (M11)")
    said = tuple(world.said(each).compensation for each in members)
    found = Beam(said, world.state.table, world.state.is_gain_half)
    world.state = world.state._replace(beam=found)


def ended(world: "World", wire: "Wire", *, is_native: bool) -> None:
    """A frame was answered, or never will be."""
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
        world.state = world.state._replace(beam=beam if beam.gone else None)
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
    if beam is not None and number in beam.gone and world.state.beliefs[port][number].lost:
        world.state = world.state._replace(beam=None)


def broken_off(world: "World") -> None:
    """An axis is stopped or moved otherwise, the link is lost, or the gateway was killed."""
    if world.state.beam is not None:
        world.state = world.state._replace(beam=None)
