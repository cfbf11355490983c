"""One exchange from arrival to reply, and the queue of those that wait."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from gateway.compensation.readback import Readback
from gateway.exchange.added_frames import AddedFrame
from gateway.exchange.axis import Rendering
from gateway.exchange.draft import Draft, rendering_of, rewriting_of
from gateway.exchange.known import Known
from gateway.exchange.plan import Role
from gateway.exchange.ports import ControllerPort
from gateway.exchange.rewriting import Rewriting
from gateway.exchange.way import Way
from gateway.times import NS_PER_MS

QUEUE_LIMIT: Final = 32
"""Requests of one connection that may wait; the next gets exception 6 (Messaging guide V1.0b, p. 29)."""


class Exchange:
    """One request with its reply. ``port`` is None for a read that the gateway added by itself."""

    # Defaults of the class: most exchanges leave most of them alone, and one is made for each request.
    sent_ns = 0
    deadline_ns = 0
    started_ns = 0
    """When its turn came, after it had waited or after a frame that it needed; 0: as it arrived."""
    queue_ns = 0
    """How long it waited for the line."""
    added_ns = 0
    """How long frames of the gateway's own held it up."""
    excused_ns = 0
    """How much of that no deadline counts: a look at where the axis stands."""
    is_orphan = False
    """Its controller has gone or gone on: the reply is taken note of and then dropped."""
    overtaken_by = ""
    """Why it must not be sent any more, although its controller waits for it."""
    is_stop = False
    added: AddedFrame | None = None
    """A frame of the gateway's own that goes first, or alone."""
    known: Known | None = None
    way: Way | None = None
    """The short way on which it was sent; None: it went the long one."""
    draft: Draft | None = None
    """The target that it carries, on the short way."""
    readbacks: Sequence[Readback | None] = ()
    """Of each position that it reads, on the short way: as they were when it was sent."""
    _rewritings: tuple[Rewriting, ...] = ()
    _rendering: Rendering | None = None

    def __init__(
        self, port: ControllerPort | None, transaction_id: int, unit_id: int, pdu: bytes, arrived_ns: int
    ) -> None:
        self.port = port
        self.transaction_id = transaction_id
        self.unit_id = unit_id
        self.wire_unit_id = unit_id
        """Of the frame that is on the wire for it."""
        self.pdu = pdu
        self.arrived_ns = arrived_ns

    @property
    def is_motion(self) -> bool:
        """Whether a motion controller asked for it."""
        return self.port is not None and self.port.plan.role is Role.MOTION

    @property
    def rewritings(self) -> tuple[Rewriting, ...]:
        """What it makes of each unit that it reaches; a broadcast reaches several."""
        if self.draft is not None and not self._rewritings:
            request = (self.pdu, self.sent_ns, self.arrived_ns)
            self._rewritings = (rewriting_of(self.draft, self.drafted(), request),)
        return self._rewritings

    @rewritings.setter
    def rewritings(self, rewritings: tuple[Rewriting, ...]) -> None:
        self._rewritings = rewritings

    def drafted(self) -> Rendering:
        """Return the target that it carries on the short way: always the same object."""
        if self._rendering is None:
            assert self.draft is not None
            self._rendering = rendering_of(self.draft)
        return self._rendering

    def start(self, now_ns: int) -> None:
        """Note that it is its turn: after it waited for the line, or for a frame that goes first."""
        if self.added is not None or self.known is not None:
            self.added_ns += now_ns - (self.started_ns or self.arrived_ns)
        else:
            self.queue_ns = now_ns - self.arrived_ns
        self.started_ns = now_ns

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
        self._queues = (self._stops, self._own, self._motion, self._others)
        self.total = 0
        """How many wait: a number of its own, for it is looked at with each request."""

    @property
    def only_others(self) -> bool:
        """Whether nothing waits but what monitors and operators read."""
        return self.total == len(self._others)

    def first_of_others(self) -> list[Exchange]:
        """Return the first one of each monitor or operator, oldest first."""
        first: dict[int, Exchange] = {}
        for exchange in self._others:
            first.setdefault(id(exchange.port), exchange)
        return list(first.values())

    def take(self, exchange: Exchange) -> None:
        """Take out one that is known to wait among the others."""
        self._others.remove(exchange)
        self.total -= 1

    def __len__(self) -> int:
        return self.total

    def __iter__(self) -> Iterator[Exchange]:
        for queue in self._queues:
            yield from queue

    def add(self, exchange: Exchange) -> None:
        """Queue an exchange behind those of its rank."""
        self.total += 1
        if exchange.port is None:
            self._own.append(exchange)
        elif exchange.port.plan.role is Role.MOTION:
            self._motion.append(exchange)
        else:
            self._others.append(exchange)

    def add_own(self, frame: AddedFrame | None, now_ns: int) -> None:
        """Queue a frame of the gateway's own, if there is one."""
        if frame is not None:
            exchange = Exchange(None, 0, frame.axis.plan.unit_id, frame.pdu, now_ns)
            exchange.added = frame
            self.add(exchange)

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
        self.total += 1
        return True

    def put_back(self, exchange: Exchange) -> None:
        """Queue an exchange before those of its rank: it was its turn already."""
        is_motion = exchange.port is not None and exchange.port.plan.role is Role.MOTION
        self.total += 1
        (self._motion if is_motion else self._others).appendleft(exchange)

    def pop(self) -> Exchange:
        """Take the next one."""
        for queue in self._queues:
            if queue:
                self.total -= 1
                return queue.popleft()
        raise IndexError("nothing waits")

    def count(self, port: ControllerPort | None) -> int:
        """Return how many requests of one connection wait."""
        return sum(1 for exchange in self if exchange.port is port)

    def give_up(self, port: ControllerPort) -> list[Exchange]:
        """Take out and return what a controller does not wait for any more; its stops stay, without it."""
        taken = self.withdraw(lambda each: each.port is port and not each.is_stop)
        for exchange in self:
            exchange.is_orphan |= exchange.port is port
        return taken

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
        self.total -= len(taken)
        return taken
