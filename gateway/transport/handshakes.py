"""Limits of the handshakes of a listener: no other request of an unknown client costs more.

The limits leave a returning controller room for every retry. A flood takes a few percent of one CPU, in a
thread beside the loop.
"""

from collections.abc import Callable
from typing import Final

from gateway.limits import TokenBucket, bucket_of
from gateway.transport.limits import PerHost

AT_ONCE: Final = 32
MADE_ROOM: Final = f"it was the longest of {AT_ONCE} handshakes, and its place was needed for another one"
AT_ONCE_OF_A_HOST: Final = 8
PER_S: Final = 20
"""Per second, on average, over all hosts; as many may begin at the same time."""
PER_S_OF_A_HOST: Final = 5
BURST_OF_A_HOST: Final = 10
SPARE_PER_S: Final = 5
"""For addresses without an attempt for two seconds, when other hosts use up the total."""
HOSTS: Final = 256
"""This many hosts have their own limit, all others a common one: hosts must not fill the memory."""


class HandshakeLimits:
    """Decides for each new connection whether its handshake may begin; time is an argument.

    An address that was admitted before has only its own limit: unknown clients cannot use it up. A client
    that never ends its handshakes locks out no other. When the maximum runs, the oldest handshake of the host
    with most of them is ended. An honest handshake takes milliseconds.
    """

    def __init__(self) -> None:
        self._all = bucket_of(PER_S, PER_S)
        self._spare = bucket_of(SPARE_PER_S, SPARE_PER_S)
        self._admitted: dict[str, None] = {}
        """Admitted addresses, the newest last."""
        self._hosts = PerHost(lambda: bucket_of(PER_S_OF_A_HOST, BURST_OF_A_HOST), TokenBucket.is_full, HOSTS)
        self._running: dict[str, list[Callable[[], None]]] = {}
        """For each host, the functions that end its running handshakes, the oldest first. The first host has
        had handshakes for longest."""
        self.running = 0

    def why_not(self, host: str, now_ns: int, give_up: Callable[[], None]) -> str:
        """Return why a handshake of ``host`` may not begin now; "" if it begins.

        ``give_up`` is called to end it in favour of another one, and calls :meth:`ended`.
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
        """Record that a handshake has ended, with success or without."""
        self.running -= 1
        self._running[host].remove(give_up)
        if not self._running[host]:
            del self._running[host]

    def came_in(self, host: str) -> None:
        """Record a successful handshake of ``host``."""
        self._admitted.pop(host, None)
        self._admitted[host] = None
        if len(self._admitted) > HOSTS:
            del self._admitted[next(iter(self._admitted))]

    def _shared(self, host: str, own: TokenBucket, now_ns: int) -> TokenBucket | None:
        """Return the limit that a host shares with others; None: it has only its own."""
        if host in self._admitted:
            return None
        return self._spare if own.is_full(now_ns) and not self._all.has_one(now_ns) else self._all
