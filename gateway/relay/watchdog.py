"""The watchdog of the service manager is fed with proofs that the relay gets on, not with the time.

A beat comes over the same kind of timer as the deadlines of the exchanges, on the same loop; it feeds only
where every line has done what was due, every listener still takes those who knock, and every port is looked
after. A line that has nothing to do gets on.
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
"""What is due is done within microseconds; so late it is not late but forgotten."""
BEATS: Final = 4
"""In the time after which the manager loses patience: one that comes late does no harm."""
UNWATCHED_NS: Final = 5 * NS_PER_S
"""Pause between two beats where no watchdog is wanted: they only keep the manager's status up to date."""
BEATS_TO_ACCEPT: Final = 2
"""Who still waits after so many beats, with nobody let in meanwhile, knocks in vain."""
_WAITING: Final = struct.Struct("8x4x4x4x4xI")
"""``tcpi_unacked`` of ``struct tcp_info``: of a listening socket, how many connections wait to be accepted
(``tcp_get_info`` in the kernel's ``net/ipv4/tcp.c``)."""


class Accepting:
    """Whether a listener still takes connections; asked at each beat."""

    def __init__(self, listener: TcpListener) -> None:
        self._listener = listener
        self._accepted = -1
        self._in_vain = 0

    def why_stuck(self) -> str:
        """Say why nobody can connect, "" where all is well."""
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
    """Feeds the watchdog as long as ``why_stuck``, which is given the time in ns, has nothing to say.

    ``on_stuck`` is called once each time that it has. ``show_status`` returns the manager's status text.
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
        """Beat no more."""
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
