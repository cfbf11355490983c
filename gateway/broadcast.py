"""A queue for a reader that may be slow: it keeps the newest, and counts what it has dropped."""

from collections import deque
from collections.abc import Iterable
from typing import Generic, TypeVar

Item = TypeVar("Item")


class NewestQueue(Generic[Item]):
    """Keeps the newest ``most`` items. A reader that is slow, stopped or hung costs no more than these."""

    __slots__ = ("_most", "dropped", "items")

    def __init__(self, most: int) -> None:
        self._most = most
        self.items: deque[Item] = deque()
        """Those that wait, the oldest first."""
        self.dropped = 0
        """How many were dropped since :meth:`take_dropped`."""

    def put(self, item: Item) -> None:
        """Append one; the oldest goes for it where ``most`` wait."""
        if len(self.items) >= self._most:
            self.items.popleft()
            self.dropped += 1
        self.items.append(item)

    def extend(self, items: Iterable[Item]) -> None:
        """Append several."""
        for item in items:
            self.put(item)

    def take_all(self) -> tuple[Item, ...]:
        """Remove and return all that wait."""
        taken = tuple(self.items)
        self.items.clear()
        return taken

    def take_dropped(self) -> int:
        """Return how many were dropped since the last call."""
        dropped, self.dropped = self.dropped, 0
        return dropped
