"""A queue that keeps the newest."""

from hypothesis import given
from hypothesis import strategies as st

from gateway.broadcast import NewestQueue


def test_the_oldest_go_and_are_counted() -> None:
    queue: NewestQueue[int] = NewestQueue(3)
    queue.extend(range(5))
    assert (list(queue.items), queue.take_dropped(), queue.take_dropped()) == ([2, 3, 4], 2, 0)
    assert (queue.take_all(), list(queue.items)) == ((2, 3, 4), [])


@given(st.integers(1, 10), st.lists(st.one_of(st.none(), st.integers()), max_size=100))
def test_what_is_taken_and_dropped_is_what_came_in_its_order(most: int, steps: list[int | None]) -> None:
    """None: the reader takes one."""
    queue: NewestQueue[tuple[int, int]] = NewestQueue(most)
    came, taken = 0, []
    for step in steps:
        if step is not None:
            queue.put((came, step))
            came += 1
        elif queue.items:
            taken.append(queue.items.popleft())
        assert len(queue.items) <= most
    taken += queue.take_all()
    assert len(taken) + queue.dropped == came
    assert taken == sorted(taken, key=lambda each: each[0])
