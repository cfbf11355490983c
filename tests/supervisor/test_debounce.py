"""When a table file may be read: sights of it at times that the test makes up."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.supervisor.debounce import (
    GONE_S,
    STILL_S,
    STILL_UNSEEN_S,
    FileDebounce,
    FileStability,
    FileStamp,
)

A, B = FileStamp(is_there=True, mark=("a",)), FileStamp(is_there=True, mark=("b",))
WRITTEN_B = FileStamp(is_there=True, mark=("b",), is_being_written=True)
UNSEEN_B = FileStamp(is_there=True, mark=("b",), is_being_written=None)
GONE = FileStamp(is_there=False)
MOVING, READY, SAME = FileStability.MOVING, FileStability.READY, FileStability.SAME


def states(start: FileStamp, looks: Sequence[tuple[float, FileStamp]]) -> list[FileStability]:
    """Return what each look says of a file that stood still and was read as ``start``."""
    debounce = FileDebounce()
    debounce.observe(start, -GONE_S)
    debounce.take(start, 0.0)
    return [debounce.observe(stamp, now_s) for now_s, stamp in looks]


def test_a_file_that_was_read_is_read_once() -> None:
    assert states(A, [(0.0, A), (100.0, A)]) == [SAME, SAME]


def test_a_file_is_read_when_it_has_stood_still() -> None:
    looks = [(1.0, B), (1.0 + STILL_S - 0.01, B), (1.0 + STILL_S, B)]
    assert states(A, looks) == [MOVING, MOVING, READY]


def test_each_change_begins_the_wait_anew() -> None:
    growing = [(0.4 * n, FileStamp(is_there=True, mark=(n,))) for n in range(1, 151)]  # for a minute
    assert set(states(A, growing)) == {MOVING}
    last_s, last = growing[-1]
    assert states(A, [*growing, (last_s + STILL_S, last)])[-1] is READY


def test_what_somebody_writes_is_not_read_however_still_it_is() -> None:
    looks = [(0.0, WRITTEN_B), (100.0, WRITTEN_B), (100.1, B), (100.1 + STILL_S, B)]
    assert states(A, looks) == [MOVING, MOVING, MOVING, READY]


def test_where_nobody_tells_who_writes_a_file_it_is_read_after_ten_seconds() -> None:
    assert STILL_UNSEEN_S == 10.0
    assert states(A, [(0.0, UNSEEN_B), (9.99, UNSEEN_B), (10.0, UNSEEN_B)]) == [MOVING, MOVING, READY]


def test_what_was_read_early_where_nobody_tells_is_read_once_more_after_ten_seconds() -> None:
    debounce = FileDebounce()
    debounce.take(UNSEEN_B, 0.0)
    assert [debounce.observe(UNSEEN_B, now_s) for now_s in (9.99, 10.0)] == [SAME, READY]


def test_a_file_that_is_not_stable_for_thirty_seconds_is_overdue_until_it_was_read() -> None:
    debounce = FileDebounce()
    debounce.take(A, 0.0)
    assert debounce.observe(WRITTEN_B, 1.0) is MOVING
    other = FileStamp(is_there=True, mark=("c",), is_being_written=True)
    assert debounce.observe(other, 20.0) is MOVING  # it changes meanwhile
    assert [debounce.is_overdue(now_s) for now_s in (30.9, 31.0)] == [False, True]
    debounce.observe(B, 40.0)
    assert debounce.observe(B, 40.5) is READY
    assert not debounce.is_overdue(100.0)


def test_a_file_is_gone_after_five_seconds() -> None:
    assert GONE_S == 5.0
    assert states(A, [(0.0, GONE), (4.99, GONE), (5.0, GONE)]) == [MOVING, MOVING, READY]


def test_an_editor_that_moves_the_file_away_and_back_changes_nothing() -> None:
    assert states(A, [(0.0, GONE), (2.0, GONE), (3.0, A)]) == [MOVING, MOVING, SAME]


def test_a_file_that_comes_back_after_it_was_gone_is_read_again() -> None:
    looks = [(0.0, A), (STILL_S, A)]
    assert states(GONE, looks) == [MOVING, READY]


def test_nothing_was_read_at_the_start() -> None:
    debounce = FileDebounce()
    assert [debounce.observe(A, now_s) for now_s in (0.0, STILL_S)] == [MOVING, READY]


STAMPS = st.sampled_from([A, B, WRITTEN_B, UNSEEN_B, GONE])


@given(st.lists(st.tuples(st.floats(0.0, 2.0), STAMPS), max_size=30))
def test_whatever_comes_ready_means_another_file_that_stood_still(
    steps: list[tuple[float, FileStamp]],
) -> None:
    debounce = FileDebounce()
    debounce.observe(A, -STILL_S)
    debounce.take(A, 0.0)
    now_s, since_s, last = 0.0, 0.0, A
    for step_s, stamp in steps:
        now_s += step_s
        if stamp != last:
            last, since_s = stamp, now_s
        if debounce.observe(stamp, now_s) is READY:
            assert stamp != A
            assert not stamp.is_being_written
            assert now_s - since_s >= {A: 0.5, B: 0.5, UNSEEN_B: 10.0, GONE: 5.0}[stamp]


@pytest.mark.parametrize("stamp", [A, GONE])
def test_a_file_that_was_taken_is_the_same(stamp: FileStamp) -> None:
    assert states(stamp, [(7.0, stamp)]) == [SAME]


def test_what_was_read_before_it_stood_still_is_read_once_more() -> None:
    debounce = FileDebounce()
    debounce.take(A, 0.0)  # changed in the same tick of the file system's clock, it would look like this
    assert [debounce.observe(A, now_s) for now_s in (0.1, STILL_S)] == [SAME, READY]
    debounce.take(A, STILL_S)
    assert debounce.observe(A, 100.0) is SAME


def test_what_was_read_early_is_not_read_while_somebody_writes_it() -> None:
    debounce = FileDebounce()
    debounce.take(B, 0.0)
    looks = [(0.1, WRITTEN_B), (1.0, WRITTEN_B), (1.1, B), (1.1 + STILL_S, B)]
    states = [debounce.observe(stamp, now_s) for now_s, stamp in looks]
    assert states == [SAME, SAME, SAME, READY]


def test_what_could_not_be_read_is_read_as_soon_as_it_stands_still() -> None:
    debounce = FileDebounce()
    debounce.observe(A, 0.0)
    debounce.take(A, 10.0)
    debounce.forget()
    assert debounce.observe(A, 10.1) is READY
