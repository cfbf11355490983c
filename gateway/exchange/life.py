"""One exchange from arrival to reply, and the queue of those that wait."""

from collections import deque
from collections.abc import Callable, Iterator
from typing import Final

from gateway.exchange.added_frames import AddedFrame
from gateway.exchange.known import Known
from gateway.exchange.plan import Role
from gateway.exchange.ports import ControllerPort
from gateway.exchange.rewriting import Rewriting
from gateway.times import NS_PER_MS

QUEUE_LIMIT: Final = 32
"""Requests of one connection that may wait; the next gets exception 6 (Messaging guide V1.0b, p. 29)."""


class Exchange:
    """One request with its reply. ``port`` is None for a read that the gateway added by itself."""

    __slots__ = (
        "added",
        "arrived_ns",
        "deadline_ns",
        "is_orphan",
        "is_stop",
        "known",
        "overtaken_by",
        "pdu",
        "port",
        "rewritings",
        "sent_ns",
        "transaction_id",
        "unit_id",
        "wire_unit_id",
    )

    def __init__(
        self,
        port: ControllerPort | None,
        transaction_id: int,
        unit_id: int,
        pdu: bytes,
        arrived_ns: int,
        *,
        added: AddedFrame | None = None,
    ) -> None:
        self.port = port
        self.transaction_id = transaction_id
        self.unit_id = unit_id
        self.wire_unit_id = unit_id
        """Of the frame that is on the wire for it."""
        self.pdu = pdu
        self.arrived_ns = arrived_ns
        self.sent_ns = 0
        self.deadline_ns = 0
        self.is_orphan = False
        """Its controller has gone or gone on: the reply is taken note of and then dropped."""
        self.overtaken_by = ""
        """Why it must not be sent any more, although its controller waits for it."""
        self.is_stop = False
        self.rewritings: tuple[Rewriting, ...] = ()
        """What it makes of each unit that it reaches; a broadcast reaches several."""
        self.added = added
        """A frame of the gateway's own that goes first, or alone."""
        self.known: Known | None = None

    def is_same_stop(self, other: "Exchange") -> bool:
        """Whether both are stops that say the same to the same drive."""
        return self.is_stop and self.unit_id == other.unit_id and self.pdu == other.pdu

    def why_given_up(self, now_ns: int) -> str:
        """Return why its controller does not wait for it any more; empty while it does (W5).

        A stop goes out all the same: to stop once too often does no harm.
        """
        if self.is_stop:
            return ""
        if self.is_orphan:
            return "its controller gave up on it"
        if self.port is not None and now_ns - self.arrived_ns > self.port.plan.timeout_ms * NS_PER_MS:
            return "it waited longer than its controller's timeout_ms"
        return ""


class WaitingExchanges:
    """Exchanges that wait for the line: stops first, then our own, then motion, then the others.

    Each controller's requests keep their order.
    """

    def __init__(self) -> None:
        self._stops: deque[Exchange] = deque()
        self._own: deque[Exchange] = deque()
        self._motion: deque[Exchange] = deque()
        self._others: deque[Exchange] = deque()

    @property
    def _queues(self) -> tuple[deque[Exchange], ...]:
        return (self._stops, self._own, self._motion, self._others)

    def __bool__(self) -> bool:
        return bool(self._motion or self._others or self._own or self._stops)

    def __len__(self) -> int:
        return sum(map(len, self._queues))

    def __iter__(self) -> Iterator[Exchange]:
        for queue in self._queues:
            yield from queue

    def add(self, exchange: Exchange) -> None:
        """Queue an exchange behind those of its rank."""
        if exchange.port is None:
            self._own.append(exchange)
        elif exchange.port.plan.role is Role.MOTION:
            self._motion.append(exchange)
        else:
            self._others.append(exchange)

    @property
    def has_stops(self) -> bool:
        """Whether a stop waits."""
        return bool(self._stops)

    def add_stop(self, stop: Exchange) -> bool:
        """Queue a stop in front of everything; return False when the same one waits more often than enough.

        It takes the place of those like it whose controllers have given up.
        """
        self.withdraw(lambda each: each.is_same_stop(stop) and each.is_orphan)
        if self.count(stop.port) >= QUEUE_LIMIT and any(each.is_same_stop(stop) for each in self):
            return False
        self._stops.append(stop)
        return True

    def put_back(self, exchange: Exchange) -> None:
        """Queue an exchange before those of its rank: it was its turn already."""
        is_motion = exchange.port is not None and exchange.port.plan.role is Role.MOTION
        (self._motion if is_motion else self._others).appendleft(exchange)

    def pop(self) -> Exchange:
        """Take the next one."""
        for queue in self._queues:
            if queue:
                return queue.popleft()
        raise IndexError("nothing waits")

    def count(self, port: ControllerPort | None) -> int:
        """Return how many requests of one connection wait."""
        return sum(1 for exchange in self if exchange.port is port)

    def withdraw(self, condition: Callable[[Exchange], bool]) -> list[Exchange]:
        """Take out and return every exchange that meets a condition."""
        taken: list[Exchange] = []
        for queue in self._queues:
            if not queue:
                continue
            kept = [exchange for exchange in queue if not condition(exchange)]
            if len(kept) != len(queue):
                taken += [exchange for exchange in queue if condition(exchange)]
                queue.clear()
                queue.extend(kept)
        return taken
