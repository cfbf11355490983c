"""A listener that speaks TLS: handshakes are few at once and end in time, so that none keeps others out."""

import asyncio
import contextlib
import socket
import ssl
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Final

from gateway.supervisor.http.refusals import Refused
from gateway.supervisor.http.wrong_tries import site_of

HANDSHAKE_S: Final = 10.0
SHUTDOWN_S: Final = 2.0
"""For the other side to take its leave."""
PAUSE_S: Final = 0.5
"""After an accept that failed, as without a free descriptor."""
BACKLOG: Final = 128


_DISTRUST: Final = frozenset(
    f"{version}_ALERT_{what}"
    for version in ("SSLV3", "TLSV1", "TLSV13")
    for what in ("BAD_CERTIFICATE", "CERTIFICATE_UNKNOWN", "CERTIFICATE_EXPIRED", "UNKNOWN_CA")
)
"""What a browser says before its user has been asked, and every client to which the authority is unknown."""


@dataclass(frozen=True, slots=True)
class HandshakeLimits:
    """How many handshakes may go on at once; for one more the oldest ends."""

    at_once: int = 64
    from_one_site: int = 16
    time_s: float = HANDSHAKE_S


class TlsListener:
    """Accepts on bound sockets, which it closes at its end; :meth:`run` runs until cancelled.

    asyncio's own server lets any number of connections be in a handshake, and tells nobody of them.
    """

    def __init__(
        self,
        sockets: Iterable[socket.socket],
        context: ssl.SSLContext,
        protocol: Callable[[], asyncio.Protocol],
        refused: Refused,
        limits: HandshakeLimits,
    ) -> None:
        self._sockets = list(sockets)
        self._context = context
        self._protocol = protocol
        self._refused = refused
        self._limits = limits
        self._shaking: dict[asyncio.Task[None], str] = {}
        """The handshakes that go on, the oldest first, with where each comes from."""
        for one in self._sockets:
            one.setblocking(False)
            one.listen(BACKLOG)

    @property
    def handshakes(self) -> int:
        """How many go on."""
        return len(self._shaking)

    async def run(self) -> None:
        """Accept until cancelled."""
        try:
            async with asyncio.TaskGroup() as group:
                for one in self._sockets:
                    group.create_task(self._accept(one))
        finally:
            for one in self._sockets:
                one.close()
            shaking = list(self._shaking)
            for task in shaking:
                task.cancel()
            await asyncio.gather(*shaking, return_exceptions=True)

    async def _accept(self, listening: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        somebody = asyncio.Event()
        loop.add_reader(listening.fileno(), somebody.set)
        try:
            while True:
                # Not `sock_accept`: cancelled in the wrong turn it has a connection, and gives it to nobody.
                await somebody.wait()
                somebody.clear()
                try:
                    connection, address = listening.accept()
                except (BlockingIOError, InterruptedError):
                    continue
                except OSError:
                    # Whoever waits stays there, and would have us called without end.
                    loop.remove_reader(listening.fileno())
                    await asyncio.sleep(PAUSE_S)
                    loop.add_reader(listening.fileno(), somebody.set)
                    continue
                self._take(connection, site_of(address[0]))
                await asyncio.sleep(0)  # the handshakes have their turn too
        finally:
            loop.remove_reader(listening.fileno())

    def _take(self, connection: socket.socket, site: str) -> None:
        self._make_room(site)
        connection.setblocking(False)
        task = asyncio.create_task(self._shake(connection, site))
        self._shaking[task] = site
        task.add_done_callback(partial(self._shaken, connection))

    def _shaken(self, connection: socket.socket, task: "asyncio.Task[None]") -> None:
        self._shaking.pop(task, None)
        if task.cancelled():  # perhaps before it began
            _close(connection)

    def _make_room(self, site: str) -> None:
        """End the oldest handshake from where too many come, or of all where there are too many."""
        of_site = [task for task, other in self._shaking.items() if other == site]
        if len(of_site) >= self._limits.from_one_site:
            oldest = of_site[0]
        elif len(self._shaking) >= self._limits.at_once:
            oldest = next(iter(self._shaking))
        else:
            return
        self._refused(self._shaking.pop(oldest), "too many TLS handshakes at once")
        oldest.cancel()

    async def _shake(self, connection: socket.socket, site: str) -> None:
        is_open = False
        try:
            await asyncio.get_running_loop().connect_accepted_socket(
                self._protocol,
                connection,
                ssl=self._context,
                ssl_handshake_timeout=self._limits.time_s,
                ssl_shutdown_timeout=SHUTDOWN_S,
            )
            is_open = True
        except OSError as error:
            self._refused(site, _why(error))
        finally:
            if not is_open:
                _close(connection)


def _close(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):
        connection.close()


def _why(error: OSError) -> str:
    """Return why a handshake came to nothing, in words without anything that the other side sent.

    >>> _why(ConnectionResetError(104, "Connection reset by peer"))
    'no TLS: the other side went away'
    """
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate: {error.verify_message}"
    if isinstance(error, ssl.SSLError) and error.reason in _DISTRUST:
        return "the other side did not take the certificate of the page"
    if isinstance(error, ssl.SSLError):
        return f"no TLS: {(error.reason or 'not understood').lower().replace('_', ' ')}"
    if isinstance(error, ConnectionAbortedError):
        return "the TLS handshake never ended"
    return "no TLS: the other side went away"
