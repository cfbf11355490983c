"""Walks one world from start to end, as a process of its own does."""

import gc

from tests.verify.designs import BY_NAME
from tests.verify.explore import Outcome, Walk


def walked(name: str, depth: int, seconds: float, steps: int, most_broken: int) -> Outcome:
    """Walk one world."""
    gc.disable()  # what is kept is kept for good, and to look through it again and again costs half the time
    walk = Walk(BY_NAME[name], most_broken=most_broken)
    outcome = walk.along()
    if len(outcome.broken) < most_broken:
        outcome = walk.breadth_first(depth or BY_NAME[name].depth, seconds)
    if steps and not outcome.is_closed and len(outcome.broken) < most_broken:
        walk.random(steps, seconds=seconds)
    return outcome


def wandered(name: str, steps: int, most_broken: int) -> Outcome:
    """Take random steps in one world, from the start again and again."""
    gc.disable()
    return Walk(BY_NAME[name], most_broken=most_broken).random(steps)
