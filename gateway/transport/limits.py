"""How many connections a listener takes, how fast, and for how long: plain data, and the bucket of a host."""

from dataclasses import dataclass
from typing import Final

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


class ConnectRate:
    """A bucket of connections for each host: one host's flood costs the others nothing."""

    def __init__(self, limits: ConnectionLimits) -> None:
        self._interval_ns = int(NS_PER_S / limits.connects_per_s)
        self._burst_ns = self._interval_ns * max(limits.max_connections - 1, 0)
        self._hosts: dict[str, TokenBucket] = {}
        self._served: dict[str, TokenBucket] = {}
        """How many connections of each of these hosts are forgotten that got their answer."""

    def takes(self, host: str, now_ns: int) -> bool:
        """Count a connection; return whether it comes slowly enough."""
        if host not in self._hosts and len(self._hosts) >= HOSTS:
            self._forget_full(now_ns)
            host = host if len(self._hosts) < HOSTS else ""
        if host not in self._hosts:
            self._hosts[host] = TokenBucket(self._interval_ns, self._burst_ns)
        return self._hosts[host].takes(now_ns)

    def give_back(self, host: str, now_ns: int) -> None:
        """Forget a connection that got its answer and ended: to connect for each request is no flood."""
        bucket = self._hosts.get(host)
        if bucket is None:
            return
        if host not in self._served:
            self._served[host] = TokenBucket(SERVED_INTERVAL_NS, self._burst_ns)
        if self._served[host].takes(now_ns):
            bucket.give_back()

    def _forget_full(self, now_ns: int) -> None:
        """Forget the hosts whose bucket is full again."""
        self._hosts = {host: bucket for host, bucket in self._hosts.items() if not bucket.is_full(now_ns)}
        self._served = {host: bucket for host, bucket in self._served.items() if host in self._hosts}
