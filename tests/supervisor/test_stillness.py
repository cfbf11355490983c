"""When a table file may be read: sights of it at times that the test makes up."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.supervisor.stillness import GONE_S, STILL_S, Sight, State, Stillness

A, B = Sight(is_there=True, mark=("a",)), Sight(is_there=True, mark=("b",))
WRITTEN_B = Sight(is_there=True, mark=("b",), is_being_written=True)
GONE = Sight(is_there=False)


def states(start: Sight, looks: Sequence[tuple[float, Sight]]) -> list[State]:
    """Return what each look says of a file that stood still and was read as ``start``."""
    stillness = Stillness()
    stillness.look(start, -GONE_S)
    stillness.take(start, 0.0)
    return [stillness.look(sight, now_s) for now_s, sight in looks]


def test_a_file_that_was_read_is_read_once() -> None:
    assert states(A, [(0.0, A), (100.0, A)]) == [State.SAME, State.SAME]


def test_a_file_is_read_when_it_has_stood_still() -> None:
    looks = [(1.0, B), (1.0 + STILL_S - 0.01, B), (1.0 + STILL_S, B)]
    assert states(A, looks) == [State.MOVING, State.MOVING, State.READY]


def test_each_change_begins_the_wait_anew() -> None:
    growing = [(0.4 * n, Sight(is_there=True, mark=(n,))) for n in range(1, 151)]  # for a minute
    assert set(states(A, growing)) == {State.MOVING}
    last_s, last = growing[-1]
    assert states(A, [*growing, (last_s + STILL_S, last)])[-1] is State.READY


def test_what_somebody_writes_is_not_read_however_still_it_is() -> None:
    looks = [(0.0, WRITTEN_B), (100.0, WRITTEN_B), (100.1, B), (100.1 + STILL_S, B)]
    assert states(A, looks) == [State.MOVING, State.MOVING, State.MOVING, State.READY]


def test_a_file_is_gone_after_five_seconds() -> None:
    assert GONE_S == 5.0
    assert states(A, [(0.0, GONE), (4.99, GONE), (5.0, GONE)]) == [State.MOVING, State.MOVING, State.READY]


def test_an_editor_that_moves_the_file_away_and_back_changes_nothing() -> None:
    assert states(A, [(0.0, GONE), (2.0, GONE), (3.0, A)]) == [State.MOVING, State.MOVING, State.SAME]


def test_a_file_that_comes_back_after_it_was_gone_is_read_again() -> None:
    looks = [(0.0, A), (STILL_S, A)]
    assert states(GONE, looks) == [State.MOVING, State.READY]


def test_nothing_was_read_at_the_start() -> None:
    stillness = Stillness()
    assert [stillness.look(A, now_s) for now_s in (0.0, STILL_S)] == [State.MOVING, State.READY]


@given(st.lists(st.tuples(st.floats(0.0, 2.0), st.sampled_from([A, B, WRITTEN_B, GONE])), max_size=30))
def test_whatever_comes_ready_means_another_file_that_stood_still(steps: list[tuple[float, Sight]]) -> None:
    stillness = Stillness()
    stillness.look(A, -STILL_S)
    stillness.take(A, 0.0)
    now_s, since_s, last = 0.0, 0.0, A
    for step_s, sight in steps:
        now_s += step_s
        if sight != last:
            last, since_s = sight, now_s
        if stillness.look(sight, now_s) is State.READY:
            assert sight != A
            assert not sight.is_being_written
            assert now_s - since_s >= (STILL_S if sight.is_there else GONE_S)


@pytest.mark.parametrize("sight", [A, GONE])
def test_a_file_that_was_taken_is_the_same(sight: Sight) -> None:
    assert states(sight, [(7.0, sight)]) == [State.SAME]


def test_what_was_read_before_it_stood_still_is_read_once_more() -> None:
    stillness = Stillness()
    stillness.take(A, 0.0)  # changed in the same tick of the file system's clock, it would look like this
    assert [stillness.look(A, now_s) for now_s in (0.1, STILL_S)] == [State.SAME, State.READY]
    stillness.take(A, STILL_S)
    assert stillness.look(A, 100.0) is State.SAME


def test_what_was_read_early_is_not_read_while_somebody_writes_it() -> None:
    stillness = Stillness()
    stillness.take(B, 0.0)
    looks = [(0.1, WRITTEN_B), (1.0, WRITTEN_B), (1.1, B), (1.1 + STILL_S, B)]
    states = [stillness.look(sight, now_s) for now_s, sight in looks]
    assert states == [State.SAME, State.SAME, State.SAME, State.READY]


def test_what_could_not_be_read_is_read_as_soon_as_it_stands_still() -> None:
    stillness = Stillness()
    stillness.look(A, 0.0)
    stillness.take(A, 10.0)
    stillness.forget()
    assert stillness.look(A, 10.1) is State.READY
