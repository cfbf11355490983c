"""The connections of a listener, their limit, and which one is closed for a new client.

Clients that hold idle connections must not lock out a controller. When the limit is reached, a new client
replaces the connection that has been quiet longest, of the host that has most of them. A host that has more
than half of them makes room for other hosts immediately. Among its own connections, and between hosts with
equally many, that takes a while. So the one connection of a motion controller is closed last. That never
happens within :data:`QUIET_NS` of a request, unless its peer is known to be gone (``peer_probe``).
"""

from collections import Counter
from collections.abc import Callable, Iterable
from enum import Enum
from typing import Final, Protocol, TypeVar, runtime_checkable

from gateway.times import NS_PER_S
from gateway.transport.limits import ConnectionLimits

QUIET_NS: Final = 30 * NS_PER_S
"""A connection may be replaced after this time without a request."""
NEVER_ASKED_NS: Final = 5 * NS_PER_S
"""A connection without any request may be replaced sooner."""
QUIET_OF_MANY_NS: Final = NS_PER_S
"""A host with two connections more than the new client may lose one after this time without a request."""
MAKE_ROOM_EVERY_NS: Final = NS_PER_S // 10
"""Interval of the search for a connection to replace, per host: a flood must not keep the loop busy."""
SWEEP_S: Final = 1.0
"""Interval of the search for connections that must end."""

AnyConnection = TypeVar("AnyConnection")


def longest(
    connections: Iterable[AnyConnection], since: Callable[[AnyConnection], float | None]
) -> AnyConnection | None:
    """Return the item that makes room for a new one: the one waiting longest; None: there is none.

    ``since`` returns since when an item may be replaced, None if it may not.

    >>> longest(["it reads", "asked at 7", "asked at 3"], lambda one: float(one[-1]) if "at" in one else None)
    'asked at 3'
    """
    waiting = [
        (when, number, one) for number, one in enumerate(connections) if (when := since(one)) is not None
    ]
    return min(waiting)[2] if waiting else None


class Closing(Enum):
    """Why a connection was closed."""

    IDLE = "it sent no request (idle_timeout_s)"
    HALF_FRAME = "it did not finish a request"
    VANISHED = "its peer acknowledged nothing for timeout_ms, and its host connected again (max_connections)"
    MADE_ROOM = "it was idle, and its place was needed for another connection (max_connections)"


@runtime_checkable
class RequestProgress(Protocol):
    """The requests of a connection, as its receiver knows them."""

    asked_ns: int
    """When its last whole request came; 0: never."""
    unfinished_ns: int
    """Since when a request is incomplete; 0: none is."""

    @property
    def is_served(self) -> bool:
        """Whether it got a reply; always False if connecting costs more than an exchange."""
        ...


class Connection(Protocol):
    """An accepted connection."""

    host: str
    opened_ns: int

    @property
    def asking(self) -> RequestProgress | None:
        """The requests of the connection; None: unknown, and it may stay."""
        ...

    def abort(self) -> None:
        """Close it immediately."""
        ...


class Connections:
    """The connections of one listener.

    ``patience_ns``: a request that is incomplete after this time ends its connection; 0: never.
    """

    def __init__(
        self, limits: ConnectionLimits, patience_ns: int, on_closed: Callable[[str, Closing], None]
    ) -> None:
        self._max = limits.max_connections
        self._idle_ns = int(limits.idle_timeout_s * NS_PER_S)
        self._patience_ns = patience_ns
        self._on_closed = on_closed
        self._connections: list[Connection] = []
        self._refused = ("", 0)
        """Host and time of the newest client for which no connection could be closed."""

    @property
    def is_empty(self) -> bool:
        """Whether there is no connection."""
        return not self._connections

    def has_room_for(self, host: str, now_ns: int) -> bool:
        """Whether a new connection may be accepted, perhaps in place of another one."""
        if len(self._connections) < self._max:
            return True
        refused_host, refused_ns = self._refused
        if host == refused_host and now_ns - refused_ns < MAKE_ROOM_EVERY_NS:
            return False
        has_room = self._who_makes_room(host, now_ns) is not None
        if not has_room:
            self._refused = host, now_ns
        return has_room

    def take(self, connection: Connection, now_ns: int) -> None:
        """Add a new connection, if necessary in place of another one."""
        other = self._who_makes_room(connection.host, now_ns) if len(self._connections) >= self._max else None
        if other is not None:
            self.close(other, Closing.MADE_ROOM)
        self._connections.append(connection)

    def leave(self, connection: Connection) -> None:
        """Remove a connection that has ended."""
        if connection in self._connections:
            self._connections.remove(connection)

    def sweep(self, now_ns: int) -> None:
        """Close connections that were idle too long, or that do not finish a request."""
        for connection in tuple(self._connections):
            asking = connection.asking
            if asking is None:
                continue
            is_late = self._patience_ns and asking.unfinished_ns
            if is_late and now_ns - asking.unfinished_ns > self._patience_ns:
                self.close(connection, Closing.HALF_FRAME)
            elif self._idle_ns and now_ns - _quiet_since_ns(connection, asking) > self._idle_ns:
                self.close(connection, Closing.IDLE)

    def close(self, connection: Connection, why: Closing) -> None:
        """End a connection, and report why."""
        self.leave(connection)
        self._on_closed(connection.host, why)
        connection.abort()

    def _who_makes_room(self, host: str, now_ns: int) -> Connection | None:
        counts = Counter(connection.host for connection in self._connections)
        most = max(counts.values())
        is_many = most > counts[host] + 1
        is_hoard = most > self._max // 2 and is_many

        def quiet_since_ns(connection: Connection) -> int | None:
            asking = connection.asking
            # The new client's own host makes room if it has as many connections as any other.
            if (
                asking is None
                or counts[connection.host] < most
                or (counts[host] == most and connection.host != host)
            ):
                return None
            since_ns = _quiet_since_ns(connection, asking)
            if not is_hoard and now_ns - since_ns < _least_ns(asking, is_many=is_many):
                return None
            # Connections without any request go before those with one.
            return since_ns if asking.asked_ns else since_ns - QUIET_NS

        return longest(self._connections, quiet_since_ns)


def _quiet_since_ns(connection: Connection, asking: RequestProgress) -> int:
    return max(connection.opened_ns, asking.asked_ns)


def _least_ns(asking: RequestProgress, *, is_many: bool) -> int:
    """Return how long a connection must be quiet before it may be replaced."""
    if asking.asked_ns:
        return QUIET_OF_MANY_NS if is_many else QUIET_NS
    return 0 if is_many else NEVER_ASKED_NS
