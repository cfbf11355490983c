"""Cut-through between pseudo terminals: whose doing a pause inside of a frame was."""

import pytest

from bench.figures import Interval
from bench.scenarios.cut_ptys import GUARD, Late, Seen, is_excused

MS = 1_000_000
PAUSE = [100 * MS, 400_000]
"""The wire was empty at 99.6 ms, and the next byte came at 100."""
DUE = 100 * MS - 400_000 - GUARD
"""When the frame would have been filled up."""


@pytest.mark.parametrize(
    ("witnesses", "expected"),
    [
        ([], False),
        ([[[DUE, 400_000]], []], True),
        ([[], [[DUE + 100_000, 450_000]]], True),
        # Late, but for less than the pause: the guard has room for that.
        ([[[DUE, 60_000]], [[DUE + 200_000, 399_999]]], False),
        # Twice on one processor, or on two at once.
        ([[[DUE, 150_000], [DUE + 300_000, 250_000]]], True),
        ([[[DUE, 250_000]], [[DUE, 250_000]]], False),
        # Before the frame was to be filled up, and behind the next byte.
        ([[[DUE - 500_000, 700_000]]], False),
        ([[[DUE - 500_000, 900_000]]], True),
        ([[[100 * MS - 100_000, 5 * MS]]], False),
        ([[[100 * MS, 5 * MS]]], False),
    ],
)
def test_a_pause_is_excused_where_one_processor_stood_still_for_as_long(
    witnesses: list[Late], expected: bool
) -> None:
    assert GUARD == 260_416  # a quarter of ten bits at 9 600 baud
    assert is_excused(PAUSE, witnesses) == expected


def test_what_the_gateway_has_torn_by_itself_lies_between_what_is_not_excused_and_all() -> None:
    assert Seen([], torn=5, excused=2).own == Interval(3, 3, 5)
    assert Seen([], torn=2, excused=7).own == Interval(0, 0, 2)
