"""How many connections a listener takes, how fast, and for how long: plain data, and the bucket of a host."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from gateway.limits import TokenBucket
from gateway.times import NS_PER_S

MAX_CONNECTIONS: Final = 64
"""A monitor that opens connections and never closes them must not eat all descriptors."""
CONNECTS_PER_S: Final = 50.0
"""A panel that connects anew for each request does so ten times in a second, a flood thousands of times."""
SERVED_PER_S: Final = 1000.0
"""Of one host: up to so many connections that got an answer are no flood; a line carries less."""
SERVED_INTERVAL_NS: Final = int(NS_PER_S / SERVED_PER_S)
HOSTS: Final = 1024
"""So many hosts are told apart, all others together."""
OTHERS: Final = "others"
"""No host is called so: hosts are addresses."""

Measure = TypeVar("Measure")


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """The limits of one listener."""

    max_connections: int = MAX_CONNECTIONS
    connects_per_s: float = CONNECTS_PER_S
    """Of one host, in the mean; as many as ``max_connections`` at once after a pause. One that got an answer
    before it ended is not counted."""
    idle_timeout_s: float = 0.0
    """A connection that sent no whole request for so long is closed; 0: never."""


DEFAULT_LIMITS: Final = ConnectionLimits()


class PerHost(Generic[Measure]):
    """A measure for each of ``most`` hosts, one together for all others: hosts must not fill the memory.

    A host is forgotten when its place is wanted and ``is_unused`` says that a new measure would say the same.
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
        """Return the measure of a host that comes."""
        if host not in self._hosts and len(self._hosts) >= self._most:
            unused = self._is_unused
            self._hosts = {name: one for name, one in self._hosts.items() if not unused(one, now_ns)}
            if len(self._hosts) >= self._most:
                host = OTHERS
        if host not in self._hosts:
            self._hosts[host] = self._make()
        return self._hosts[host]

    def existing(self, host: str) -> Measure | None:
        """Return the measure that a host has for itself; None: it has none."""
        return self._hosts.get(host)


class ConnectRate:
    """A bucket of connections for each host: one host's flood costs the others nothing."""

    def __init__(self, limits: ConnectionLimits) -> None:
        interval_ns = int(NS_PER_S / limits.connects_per_s)
        burst_ns = interval_ns * max(limits.max_connections - 1, 0)
        # Beside it a bucket of those that are forgotten because they got their answer.
        self._hosts = PerHost(
            lambda: (TokenBucket(interval_ns, burst_ns), TokenBucket(SERVED_INTERVAL_NS, burst_ns)),
            lambda buckets, now_ns: buckets[0].is_full(now_ns),
            HOSTS,
        )

    def takes(self, host: str, now_ns: int) -> bool:
        """Count a connection; return whether it comes slowly enough."""
        come, _ = self._hosts.of(host, now_ns)
        return come.takes(now_ns)

    def give_back(self, host: str, now_ns: int) -> None:
        """Forget a connection that got its answer and ended: to connect for each request is no flood."""
        buckets = self._hosts.existing(host)
        if buckets is None:
            return
        come, served = buckets
        if served.takes(now_ns):
            come.give_back()
