"""Limits of a listener: number, rate and duration of connections, and the bucket of a host."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from gateway.limits import TokenBucket
from gateway.times import NS_PER_S

MAX_CONNECTIONS: Final = 64
"""A monitor that opens connections and never closes them must not use up all descriptors."""
CONNECTS_PER_S: Final = 50.0
"""A panel that connects for each request does so ten times in a second, a flood thousands of times."""
SERVED_PER_S: Final = 1000.0
"""Per host: connections that got a reply are no flood up to this rate; a line carries fewer."""
SERVED_INTERVAL_NS: Final = int(NS_PER_S / SERVED_PER_S)
HOSTS: Final = 1024
"""This many hosts are counted separately, all others together."""
OTHERS: Final = "others"
"""No host has this name: hosts are addresses."""

Measure = TypeVar("Measure")


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """The limits of one listener."""

    max_connections: int = MAX_CONNECTIONS
    connects_per_s: float = CONNECTS_PER_S
    """Per host, on average; after a pause ``max_connections`` immediately. A connection that got a reply
    before it ended does not count."""
    idle_timeout_s: float = 0.0
    """A connection without a whole request for this time is closed; 0: never."""


DEFAULT_LIMITS: Final = ConnectionLimits()


class PerHost(Generic[Measure]):
    """A measure for each of ``most`` hosts, and a common one for all others: hosts must not fill the memory.

    A host is forgotten when room is needed and ``is_unused`` says that a new measure would be equal.
    """

    def __init__(
        self, make: Callable[[], Measure], is_unused: Callable[[Measure, int], bool], most: int
    ) -> None:
        self._make = make
        self._is_unused = is_unused
        self._most = most
        self._hosts: dict[str, Measure] = {}

    def __len__(self) -> int:
        return len(self._hosts)

    def of(self, host: str, now_ns: int) -> Measure:
        """Return the measure of a host that connects."""
        if host not in self._hosts and len(self._hosts) >= self._most:
            unused = self._is_unused
            self._hosts = {name: one for name, one in self._hosts.items() if not unused(one, now_ns)}
            if len(self._hosts) >= self._most:
                host = OTHERS
        if host not in self._hosts:
            self._hosts[host] = self._make()
        return self._hosts[host]

    def existing(self, host: str) -> Measure | None:
        """Return a host's own measure; None: it has none."""
        return self._hosts.get(host)


class ConnectRate:
    """A bucket of connections for each host: a flood from one host does not affect the others."""

    def __init__(self, limits: ConnectionLimits) -> None:
        interval_ns = int(NS_PER_S / limits.connects_per_s)
        burst_ns = interval_ns * max(limits.max_connections - 1, 0)
        # The second bucket limits the connections that do not count because they got their reply.
        self._hosts = PerHost(
            lambda: (TokenBucket(interval_ns, burst_ns), TokenBucket(SERVED_INTERVAL_NS, burst_ns)),
            lambda buckets, now_ns: buckets[0].is_full(now_ns),
            HOSTS,
        )

    def takes(self, host: str, now_ns: int) -> bool:
        """Count a connection; return whether it is within the rate."""
        come, _ = self._hosts.of(host, now_ns)
        return come.takes(now_ns)

    def give_back(self, host: str, now_ns: int) -> None:
        """Forget a connection that got its reply and ended: one connection for each request is no flood."""
        buckets = self._hosts.existing(host)
        if buckets is None:
            return
        come, served = buckets
        if served.takes(now_ns):
            come.give_back()
