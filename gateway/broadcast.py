"""A queue for a reader that may be slow: it keeps the newest items and counts the dropped ones."""

from collections import deque
from collections.abc import Iterable
from typing import Generic, TypeVar

Item = TypeVar("Item")


class NewestQueue(Generic[Item]):
    """Keeps the newest ``most`` items: a slow, stopped or hung reader costs no more memory than these."""

    __slots__ = ("_most", "dropped", "items")

    def __init__(self, most: int) -> None:
        self._most = most
        self.items: deque[Item] = deque()
        """The waiting items, the oldest first."""
        self.dropped = 0
        """Items dropped since :meth:`take_dropped`."""

    def put(self, item: Item) -> None:
        """Append an item; if ``most`` items wait, drop the oldest."""
        if len(self.items) >= self._most:
            self.items.popleft()
            self.dropped += 1
        self.items.append(item)

    def extend(self, items: Iterable[Item]) -> None:
        """Append several items."""
        for item in items:
            self.put(item)

    def take_all(self) -> tuple[Item, ...]:
        """Remove and return all waiting items."""
        taken = tuple(self.items)
        self.items.clear()
        return taken

    def take_dropped(self) -> int:
        """Return the number of items dropped since the last call."""
        dropped, self.dropped = self.dropped, 0
        return dropped
