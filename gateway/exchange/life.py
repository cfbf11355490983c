"""One exchange from arrival to reply, and the queue of those that wait."""

from collections import deque
from collections.abc import Callable, Iterator
from typing import Final

from gateway.exchange.added_reads import AddedRead
from gateway.exchange.parts import Known
from gateway.exchange.plan import Role
from gateway.exchange.ports import ControllerPort
from gateway.exchange.rewriting import Rewriting
from gateway.times import NS_PER_MS

QUEUE_LIMIT: Final = 32
"""Requests of one connection that may wait; the next gets exception 6 (Messaging guide V1.0b, p. 29)."""


class Exchange:
    """One request with its reply. ``port`` is None for a read that the gateway added by itself."""

    __slots__ = (
        "added_read",
        "arrived_ns",
        "deadline_ns",
        "is_orphan",
        "known",
        "pdu",
        "port",
        "rewriting",
        "sent_ns",
        "transaction_id",
        "unit_id",
    )

    def __init__(
        self, port: ControllerPort | None, transaction_id: int, unit_id: int, pdu: bytes, arrived_ns: int
    ) -> None:
        self.port = port
        self.transaction_id = transaction_id
        self.unit_id = unit_id
        self.pdu = pdu
        self.arrived_ns = arrived_ns
        self.sent_ns = 0
        self.deadline_ns = 0
        self.is_orphan = False
        """Its controller has gone or gone on: the reply is taken note of and then dropped."""
        self.rewriting: Rewriting | None = None
        self.added_read: AddedRead | None = None
        self.known: Known | None = None

    def why_given_up(self, now_ns: int) -> str:
        """Return why its controller does not wait for it any more; empty while it does (W5)."""
        if self.is_orphan:
            return "its controller gave up on it"
        if self.port is not None and now_ns - self.arrived_ns > self.port.plan.timeout_ms * NS_PER_MS:
            return "it waited longer than its controller's timeout_ms"
        return ""


class WaitingExchanges:
    """Exchanges that wait for the line: the gateway's own first, then motion, then everybody else.

    Each controller's requests keep their order.
    """

    def __init__(self) -> None:
        self._own: deque[Exchange] = deque()
        self._motion: deque[Exchange] = deque()
        self._others: deque[Exchange] = deque()

    def __len__(self) -> int:
        return len(self._own) + len(self._motion) + len(self._others)

    def __iter__(self) -> Iterator[Exchange]:
        yield from self._own
        yield from self._motion
        yield from self._others

    def add(self, exchange: Exchange) -> None:
        """Queue an exchange behind those of its rank."""
        if exchange.port is None:
            self._own.append(exchange)
        elif exchange.port.plan.role is Role.MOTION:
            self._motion.append(exchange)
        else:
            self._others.append(exchange)

    def pop(self) -> Exchange:
        """Take the next one."""
        for queue in (self._own, self._motion, self._others):
            if queue:
                return queue.popleft()
        raise IndexError("nothing waits")

    def count(self, port: ControllerPort) -> int:
        """Return how many requests of one connection wait."""
        return sum(1 for exchange in self if exchange.port is port)

    def withdraw(self, condition: Callable[[Exchange], bool]) -> list[Exchange]:
        """Take out and return every exchange that meets a condition."""
        taken: list[Exchange] = []
        for queue in (self._own, self._motion, self._others):
            if not queue:
                continue
            kept = [exchange for exchange in queue if not condition(exchange)]
            if len(kept) != len(queue):
                taken += [exchange for exchange in queue if condition(exchange)]
                queue.clear()
                queue.extend(kept)
        return taken
