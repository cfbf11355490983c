"""Feeds the watchdog of the service manager only on proof that the relay makes progress.

A beat uses the same kind of timer as the deadlines of the exchanges, on the same loop. It feeds the watchdog
only if every line has done its due work, every listener accepts connections, and every port is kept open. A
line without work makes progress.
"""

import socket
import struct
from collections.abc import Callable
from typing import Final

from gateway.clock import boot_ns
from gateway.ipc.service_manager import ServiceManager
from gateway.times import NS_PER_S
from gateway.transport.tcp import TcpListener
from gateway.transport.timer import Timer

STUCK_NS: Final = NS_PER_S
"""Due work is done within microseconds; after this time it is not late but forgotten."""
BEATS: Final = 4
"""Beats within the manager's time-out: one late beat does no harm."""
UNWATCHED_NS: Final = 5 * NS_PER_S
"""Interval of the beats without a watchdog: they only update the manager's status."""
BEATS_TO_ACCEPT: Final = 2
"""If clients wait during this many beats and none is accepted, the listener counts as stuck."""
_WAITING: Final = struct.Struct("8x4x4x4x4xI")
"""``tcpi_unacked`` of ``struct tcp_info``: the connections that wait at a listening socket (``tcp_get_info``
in the kernel's ``net/ipv4/tcp.c``)."""


class Accepting:
    """Whether a listener still accepts connections; checked at each beat."""

    def __init__(self, listener: TcpListener) -> None:
        self._listener = listener
        self._accepted = -1
        self._in_vain = 0

    def why_stuck(self) -> str:
        """Return why no client can connect, "" if all is well."""
        listener = self._listener
        if not listener.sockets:
            return "a listener was closed"
        if listener.accepted != self._accepted or not any(map(_has_waiting, listener.sockets)):
            self._accepted, self._in_vain = listener.accepted, 0
            return ""
        self._in_vain += 1
        if self._in_vain < BEATS_TO_ACCEPT:
            return ""
        return f"{listener.addresses[0]}: connections wait, and none is accepted"


class WatchdogFeeder:
    """Feeds the watchdog as long as ``why_stuck``, called with the time in ns, returns "".

    ``on_stuck`` is called with the first reason after a "". ``status`` returns the status text for the
    manager.
    """

    def __init__(
        self,
        manager: ServiceManager,
        why_stuck: Callable[[int], str],
        on_stuck: Callable[[str], None],
        status: Callable[[], str],
    ) -> None:
        self._manager = manager
        self._why_stuck = why_stuck
        self._on_stuck = on_stuck
        self._status = status
        self._reported = ""
        self._every_ns = manager.watchdog_ns // BEATS or UNWATCHED_NS
        self._timer = Timer(self._beat) if manager.is_there else None
        if self._timer is not None:
            self._beat(boot_ns())

    def stop(self) -> None:
        """Stop the beats."""
        if self._timer is not None:
            self._timer.close()
            self._timer = None

    def _beat(self, now_ns: int) -> None:
        assert self._timer is not None
        why = self._why_stuck(now_ns)
        if not why and self._manager.watchdog_ns:
            self._manager.alive(self._status())
        else:
            self._manager.show_status(why or self._status())
        if why and not self._reported:
            self._on_stuck(why)
        self._reported = why
        self._timer.arm(now_ns + self._every_ns)


def _has_waiting(listening: socket.socket) -> bool:
    info = listening.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _WAITING.size)
    waiting: int = _WAITING.unpack(info)[0]
    return waiting > 0
