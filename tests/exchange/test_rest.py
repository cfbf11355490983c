"""Why a line rests (W6), walked: each thing that can happen, in each state."""

from collections.abc import Callable
from itertools import product
from typing import Final

import pytest

from gateway.exchange.plan import LineTiming
from gateway.exchange.rest import Rest
from tests.support.tables import walk

MS: Final = 1_000_000
WALK: Final = """
                not        turnaround silence    owed
turnaround      turnaround turnaround turnaround turnaround
drain           silence    silence    silence    silence
settled         .          not        not        .
settled-before  .          .          .          .
link-lost-busy  owed       owed       owed       owed
link-lost-idle  not        not        not        not
link-up         .          .          .          silence
"""
"""By hand, from W6; a dot where nothing changes."""
STEPS: Final[dict[str, Callable[[Rest], None]]] = {
    "turnaround": lambda rest: rest.begin_turnaround(10 * MS),
    "drain": lambda rest: rest.drain(10 * MS),
    "settled": lambda rest: rest.settle(150 * MS),
    "settled-before": lambda rest: rest.settle(49 * MS),
    "link-lost-busy": lambda rest: rest.break_off(needs_silence=True),
    "link-lost-idle": lambda rest: rest.break_off(needs_silence=False),
    "link-up": lambda rest: rest.resume(10 * MS),
}
REACHED: Final[dict[str, Callable[[Rest], None]]] = {
    "not": lambda rest: None,
    "turnaround": lambda rest: rest.begin_turnaround(0),
    "silence": lambda rest: rest.drain(0),
    "owed": lambda rest: rest.expect_late_reply(),
}


def kind(rest: Rest) -> str:
    """Return what can be observed of a rest."""
    if rest.until_ns is None:
        return "owed" if rest.needs_silence else "not"
    assert rest.is_draining is rest.needs_silence
    return "silence" if rest.is_draining else "turnaround"


@pytest.mark.parametrize(("state", "step"), list(product(REACHED, STEPS)))
def test_each_step_leads_from_each_state_to_the_one_that_the_rule_says(state: str, step: str) -> None:
    rest = Rest(LineTiming(drain_ms=50.0, turnaround_ms=100.0))
    REACHED[state](rest)
    assert kind(rest) == state
    STEPS[step](rest)
    after = walk(WALK)[state, step]
    assert kind(rest) == (state if after == "." else after)


def test_a_silence_that_is_disturbed_begins_again_but_not_for_ever() -> None:
    rest = Rest(LineTiming(drain_ms=50.0))
    rest.drain(0)
    ends = []
    for now_ms in (40, 80, 120, 149):
        rest.disturb(now_ms * MS)
        ends.append(rest.until_ns)
    assert ends == [90 * MS, 130 * MS, 150 * MS, 150 * MS]  # three times 50 ms at most
