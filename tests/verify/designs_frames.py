"""Worlds that close, around what registers can hold and what frames can do to them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from gateway.exchange.plan import AxisPlan
from tests.exchange.line_bench import ACTUAL, COMMAND
from tests.verify.world import Design

Plan = Callable[..., AxisPlan]
Make = Callable[..., Design]
STEP_OF_5: Final = replace(COMMAND, scale=5.0)
STEP_OF_2: Final = replace(ACTUAL, scale=2.0)
STEP_OF_10: Final = replace(ACTUAL, scale=10.0)
STEP_OF_A_TENTH: Final = replace(ACTUAL, scale=0.1)


def designs(small: Make, small_staged: Make, plan: Plan, staged: Plan) -> tuple[Design, ...]:
    """Return the worlds, made of the two axes of ``designs`` and of what makes a world small there."""
    return _registers(small, small_staged, plan, staged)


def _registers(small: Make, small_staged: Make, plan: Plan, staged: Plan) -> tuple[Design, ...]:
    """Steps of registers, and borders of their words."""
    return (
        small(
            "s-carry-zero",
            "corrections that carry over zero: every word of the target changes, and its sign",
            targets=(-5, 12),
            menu=("to", "read", "back"),
            checks_way_back=False,
        ),
        small_staged(
            "s-carry-zero-halves",
            "the same word by word",
            menu=("low", "high", "run"),
            happenings=("wait",),
            targets=(12,),
            checks_way_back=False,
        ),
        small(
            "s-scaled",
            "a target's register in steps of 5 counts, a reading in steps of 2: no target is on its grid",
            plan(command=(STEP_OF_5,), actual=(STEP_OF_2,), hysteresis=0.01),
            menu=("to", "read", "back"),
            targets=(-7005, 9005),
        ),
        small(
            "s-scaled-near",
            "the same, nearer than the branches",
            plan(command=(STEP_OF_5,), actual=(STEP_OF_2,), hysteresis=0.01),
            targets=(9005, 9025),
        ),
        small(
            "s-scaled-blind",
            "the same where only the done bit is told: targets that go on in one direction, too",
            plan(command=(STEP_OF_5,), actual=(), hysteresis=0.01),
            menu=("to", "status"),
            targets=(9005, 9025, 9045),
        ),
        small_staged(
            "s-scaled-halves",
            "the same, staged, word by word, over the border of a word of its register",
            staged(
                command=(STEP_OF_5,),
                actual=(STEP_OF_2,),
                hysteresis=0.01,
                max_speed=10000.0,
                counts_per_unit=-1000.0,
            ),
            menu=("low", "high", "run"),
            targets=(5 * 65541,),
            checks_way_back=False,
        ),
        small(
            "s-coarse",
            "a reading in steps of 10 counts: of a target between them the nearest one is read",
            plan(actual=(STEP_OF_10,), hysteresis=0.02),
            targets=(-7003, 8932),
        ),
        small(
            "s-fine",
            "a reading in steps of a tenth of a count",
            plan(actual=(STEP_OF_A_TENTH,)),
            targets=(-7003, 9007),
        ),
    )
