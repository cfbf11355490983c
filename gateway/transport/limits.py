"""How many connections a listener takes, how fast, and for how long: plain data, and the bucket of a host."""

from dataclasses import dataclass
from typing import Final

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
        self._due_ns: dict[str, int] = {}
        self._served_ns: dict[str, int] = {}
        """When each of these hosts may have another connection forgotten that got its answer."""

    def takes(self, host: str, now_ns: int) -> bool:
        """Count a connection; return whether it comes slowly enough."""
        if host not in self._due_ns and len(self._due_ns) >= HOSTS:
            self._forget_full(now_ns)
            host = host if len(self._due_ns) < HOSTS else ""
        due_ns = max(self._due_ns.get(host, 0), now_ns - self._burst_ns)
        if due_ns > now_ns:
            return False
        self._due_ns[host] = due_ns + self._interval_ns
        return True

    def give_back(self, host: str, now_ns: int) -> None:
        """Forget a connection that got its answer and ended: to connect for each request is no flood."""
        due_ns = self._due_ns.get(host)
        served_ns = max(self._served_ns.get(host, 0), now_ns - self._burst_ns)
        if due_ns is not None and served_ns <= now_ns:
            self._served_ns[host] = served_ns + SERVED_INTERVAL_NS
            self._due_ns[host] = due_ns - self._interval_ns

    def _forget_full(self, now_ns: int) -> None:
        """Forget the hosts whose bucket is full again."""
        full = [host for host, due_ns in self._due_ns.items() if due_ns <= now_ns - self._burst_ns]
        for host in full:
            del self._due_ns[host]
            self._served_ns.pop(host, None)
