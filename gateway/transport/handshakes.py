"""How many handshakes a listener takes: they cost more than anything else that a stranger can ask for.

The numbers leave a controller that comes back room for every retry, and a flood a few percent of one CPU, in
a thread beside the loop.
"""

from collections.abc import Callable
from typing import Final

from gateway.limits import TokenBucket, bucket_of
from gateway.transport.limits import PerHost

AT_ONCE: Final = 32
MADE_ROOM: Final = f"it was the longest of {AT_ONCE} handshakes, and made room for another one"
AT_ONCE_OF_A_HOST: Final = 8
PER_S: Final = 20
"""In a second, in the mean, over all hosts; as many may come at once."""
PER_S_OF_A_HOST: Final = 5
BURST_OF_A_HOST: Final = 10
SPARE_PER_S: Final = 5
"""For addresses that have tried nothing for two seconds, when the others take all that there are."""
HOSTS: Final = 256
"""So many hosts have a measure of their own, all others one together: hosts must not fill the memory."""


class HandshakeLimits:
    """Says of each new connection whether its handshake may begin; time is an argument.

    An address that has come in before has only its own measure: strangers cannot use that up. Whoever never
    ends his handshakes keeps nobody out: when there are as many as may be at once, the oldest one of a host
    that has most of them makes room. An honest one ends within milliseconds.
    """

    def __init__(self) -> None:
        self._all = bucket_of(PER_S, PER_S)
        self._spare = bucket_of(SPARE_PER_S, SPARE_PER_S)
        self._admitted: dict[str, None] = {}
        """Addresses that came in, the newest last."""
        self._hosts = PerHost(lambda: bucket_of(PER_S_OF_A_HOST, BURST_OF_A_HOST), TokenBucket.is_full, HOSTS)
        self._running: dict[str, list[Callable[[], None]]] = {}
        """How each is ended, the oldest first, by host; first the host that has had some for longest."""
        self.running = 0

    def why_not(self, host: str, now_ns: int, give_up: Callable[[], None]) -> str:
        """Return why a handshake of ``host`` may not begin now; "" where it begins.

        ``give_up`` is called where it has to make room for another one, and calls :meth:`ended`.
        """
        if len(self._running.get(host, ())) >= AT_ONCE_OF_A_HOST:
            return f"too many handshakes: {AT_ONCE_OF_A_HOST} at once from one address"
        bucket = self._hosts.of(host, now_ns)
        if not bucket.has_one(now_ns):
            return f"too many handshakes: {PER_S_OF_A_HOST} a second from one address"
        shared = self._shared(host, bucket, now_ns)
        if shared is not None and not shared.has_one(now_ns):
            return f"too many handshakes: {PER_S} a second"
        if self.running >= AT_ONCE:
            max(self._running.values(), key=len)[0]()
        bucket.take(now_ns)
        if shared is not None:
            shared.take(now_ns)
        self.running += 1
        self._running.setdefault(host, []).append(give_up)
        return ""

    def ended(self, host: str, give_up: Callable[[], None]) -> None:
        """Note that a handshake that had begun came to its end, a good or a bad one."""
        self.running -= 1
        self._running[host].remove(give_up)
        if not self._running[host]:
            del self._running[host]

    def came_in(self, host: str) -> None:
        """Note that a handshake of ``host`` came to a good end."""
        self._admitted.pop(host, None)
        self._admitted[host] = None
        if len(self._admitted) > HOSTS:
            del self._admitted[next(iter(self._admitted))]

    def _shared(self, host: str, own: TokenBucket, now_ns: int) -> TokenBucket | None:
        """Return the measure that a host shares with others; None: it has only its own."""
        if host in self._admitted:
            return None
        return self._spare if own.is_full(now_ns) and not self._all.has_one(now_ns) else self._all
