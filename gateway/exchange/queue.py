"""The waiting transactions of a line: stops first, then the gateway's own, then motion, then the others."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Final

from gateway.exchange.added_frames import AddedFrame
from gateway.exchange.ports import ControllerPort
from gateway.exchange.transaction import Transaction

WAITING_BYTES: Final = 1 << 16
"""Limit for the waiting requests of one host; above it they get exception 6 (Messaging guide V1.0b, p.
29)."""
REQUEST_BYTES: Final = 64
"""Counted for each request besides its PDU: 240 of the longest fit, or 949 that read registers."""


class WaitingQueue:
    """The queue of one line. See the module. Each controller's requests keep their order."""

    def __init__(self) -> None:
        self._stops: deque[Transaction] = deque()
        self._own: deque[Transaction] = deque()
        self._motion: deque[Transaction] = deque()
        self._others: deque[Transaction] = deque()
        self._queues = (self._stops, self._own, self._motion, self._others)
        self._host_bytes: dict[str, int] = {}
        """Waiting bytes, by host."""
        self._port_counts: dict[ControllerPort, int] = {}
        """Waiting requests, by connection; none is 0."""
        self.total = 0
        """Number of waiting requests; kept, because each request checks it."""

    @property
    def only_others(self) -> bool:
        """Whether only reads of monitors and operators wait."""
        return self.total == len(self._others)

    def has(self, port: ControllerPort) -> bool:
        """Whether anything of a connection waits."""
        return port in self._port_counts

    def first_of_others(self) -> list[Transaction]:
        """Return the first one of each monitor or operator, oldest first."""
        first: dict[int, Transaction] = {}
        for transaction in self._others:
            first.setdefault(id(transaction.port), transaction)
        return list(first.values())

    def take(self, transaction: Transaction) -> None:
        """Remove one that is known to wait."""
        for queue in self._queues:
            if transaction in queue:
                queue.remove(transaction)
                self._left(transaction)
                return

    def __len__(self) -> int:
        return self.total

    def holds(self, transaction: Transaction) -> bool:
        """Whether it waits."""
        return any(each is transaction for each in self)

    def __iter__(self) -> Iterator[Transaction]:
        for queue in self._queues:
            yield from queue

    def add(self, transaction: Transaction) -> None:
        """Queue a transaction behind those of its rank."""
        self._came(transaction)
        if transaction.port is None:
            self._own.append(transaction)
        elif transaction.port.is_motion:
            self._motion.append(transaction)
        else:
            self._others.append(transaction)

    def add_own(self, frame: AddedFrame | None, now_ns: int) -> None:
        """Queue a frame of the gateway, if there is one."""
        if frame is not None:
            transaction = Transaction(None, 0, frame.axis.plan.unit_id, frame.pdu, now_ns)
            transaction.added = frame
            self.add(transaction)

    @property
    def stops(self) -> Iterable[Transaction]:
        """The stops among the waiting transactions."""
        return self._stops

    @property
    def has_stops(self) -> bool:
        """Whether a stop waits."""
        return bool(self._stops)

    def add_stop(self, stop: Transaction) -> bool:
        """Queue a stop before everything else; return whether it was queued.

        It is not if its host has reached its limit and an equal stop waits already.
        """
        port = stop.port
        if port is not None and self.is_full(port) and any(each.is_same_stop(stop) for each in self):
            return False
        self.add_again(stop)
        return True

    def add_again(self, stop: Transaction) -> None:
        """Queue a stop before everything else, behind the waiting stops."""
        self._stops.append(stop)
        self._came(stop)

    def put_back(self, transaction: Transaction) -> None:
        """Queue a transaction before those of its rank: its turn had come already."""
        is_motion = transaction.port is not None and transaction.port.is_motion
        self._came(transaction)
        (self._motion if is_motion else self._others).appendleft(transaction)

    def pop(self) -> Transaction:
        """Remove and return the next one."""
        for queue in self._queues:
            if queue:
                transaction = queue.popleft()
                self._left(transaction)
                return transaction
        raise IndexError("nothing waits")

    def is_full(self, port: ControllerPort, times: int = 1) -> bool:
        """Whether a connection's host has reached its limit, or ``times`` as much."""
        return self._host_bytes.get(_host(port), 0) >= times * WAITING_BYTES

    def _came(self, transaction: Transaction) -> None:
        self.total += 1
        if transaction.port is not None:
            host = _host(transaction.port)
            self._host_bytes[host] = self._host_bytes.get(host, 0) + len(transaction.pdu) + REQUEST_BYTES
            self._port_counts[transaction.port] = self._port_counts.get(transaction.port, 0) + 1

    def _left(self, transaction: Transaction) -> None:
        self.total -= 1
        if transaction.port is not None:
            host = _host(transaction.port)
            held = self._host_bytes[host] - len(transaction.pdu) - REQUEST_BYTES
            if held:
                self._host_bytes[host] = held
            else:
                del self._host_bytes[host]
            count = self._port_counts.pop(transaction.port) - 1
            if count:
                self._port_counts[transaction.port] = count

    def give_up(self, port: ControllerPort, *, is_gone: bool) -> list[Transaction]:
        """Remove and return what a controller does not wait for any more; its stops stay, without it.

        ``is_gone``: it has disconnected. Otherwise it has sent another request, and its broadcasts stay too:
        an RTU controller never waits for them.
        """
        taken = self.withdraw(
            lambda each: each.port is port and not each.is_stop and (is_gone or not each.is_broadcast)
        )
        for transaction in self:
            if transaction.port is port and transaction.is_stop:
                transaction.give_up()
        return taken

    def withdraw(self, condition: Callable[[Transaction], bool]) -> list[Transaction]:
        """Remove and return every transaction that meets a condition."""
        taken: list[Transaction] = []
        for queue in self._queues:
            if not queue:
                continue
            kept = [transaction for transaction in queue if not condition(transaction)]
            if len(kept) != len(queue):
                taken += [transaction for transaction in queue if condition(transaction)]
                queue.clear()
                queue.extend(kept)
        for transaction in taken:
            self._left(transaction)
        return taken


def _host(port: ControllerPort) -> str:
    """Return the key by which a connection's requests are counted: serial ports have no host."""
    return port.peer or port.name
