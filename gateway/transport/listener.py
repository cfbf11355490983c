"""The one way in: Modbus TCP, the page, both Unix sockets and simulated drives accept so.

Not the server of asyncio. It accepts a hundred connections in one turn of the loop, tells nobody how many of
them are in a handshake, and bounds them by nothing. And it makes the transport of a connection in a task of
its own: closed before that task ran, it ends with an assertion that nobody sees, and the connection stays
open, read by nobody (CPython, ``asyncio.Server._attach``).
"""

import asyncio
import socket
import ssl
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

BACKLOG: Final = 128
PAUSE_S: Final = 1.0
"""After an accept that failed, as without a free descriptor."""
HANDSHAKE_S: Final = 10.0
SHUTDOWN_S: Final = 2.0
"""For the other side to take its leave of TLS."""


class Listener:
    """Accepts on sockets that listen, one connection in a turn of the loop.

    ``take`` gets each connection, which does not block, with the address of its peer. ``on_failed`` is told
    why none can be accepted: it is tried again after a pause, for whoever waits stays there.
    """

    def __init__(
        self,
        take: Callable[[socket.socket, Any], object],
        on_failed: Callable[[OSError], object] | None = None,
    ) -> None:
        self.sockets: list[socket.socket] = []
        """What it listens with; none before it is opened, and none after it has stopped."""
        self._take = take
        self._on_failed = on_failed or _report_to_loop
        self._pauses: dict[socket.socket, asyncio.TimerHandle] = {}

    def open(self, sockets: Iterable[socket.socket]) -> None:
        """Accept on these from now on; it closes them at its end."""
        self.sockets = list(sockets)
        for listening in self.sockets:
            listening.setblocking(False)
            self._watch(listening)

    def stop(self) -> None:
        """Accept nothing from now on."""
        for pause in self._pauses.values():
            pause.cancel()
        for listening in self.sockets:
            asyncio.get_running_loop().remove_reader(listening.fileno())
            listening.close()
        self.sockets = []

    def _watch(self, listening: socket.socket) -> None:
        asyncio.get_running_loop().add_reader(listening.fileno(), partial(self._accept, listening))

    def _accept(self, listening: socket.socket) -> None:
        try:
            connection, address = listening.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return
        except OSError as error:
            loop = asyncio.get_running_loop()
            loop.remove_reader(listening.fileno())
            self._pauses[listening] = loop.call_later(PAUSE_S, self._watch, listening)
            self._on_failed(error)
            return
        connection.setblocking(False)
        self._take(connection, address)


def _report_to_loop(error: OSError) -> None:
    what = "socket.accept() out of system resource"
    asyncio.get_running_loop().call_exception_handler({"message": what, "exception": error})


@dataclass(frozen=True, slots=True)
class HandshakesAtOnce:
    """How many handshakes may go on at once; for one more the oldest ends."""

    at_once: int = 64
    from_one_site: int = 16
    time_s: float = HANDSHAKE_S


@dataclass(frozen=True, slots=True)
class Tls:
    """What a listener speaks TLS with.

    ``refused`` is told of each handshake that came to nothing, by its site, and why; ``site_of`` returns what
    stands for all addresses that one peer can have.
    """

    context: ssl.SSLContext
    limits: HandshakesAtOnce
    refused: Callable[[str, str], None]
    site_of: Callable[[str], str]


class ProtocolListener(Listener):
    """Gives each connection a protocol of asyncio; over TLS once its handshake has come to a good end."""

    def __init__(self, protocol: Callable[[], asyncio.BaseProtocol], tls: Tls | None = None) -> None:
        super().__init__(self._begin)
        self._protocol = protocol
        self._tls = tls
        self._beginning: dict[asyncio.Task[None], str] = {}
        """Those whose protocol is not told yet, the oldest first; over TLS with where each comes from."""
        self._unowned: set[socket.socket] = set()
        """Of them those that no transport has yet: whoever ends these has to close them."""

    @property
    def handshakes(self) -> int:
        """How many go on."""
        return len(self._beginning)

    def open(self, sockets: Iterable[socket.socket]) -> None:
        """Listen on these from now on.

        Raises:
            OSError: somebody else listens there; they are closed.
        """
        owned = list(sockets)
        try:
            for each in owned:
                each.listen(BACKLOG)
        except OSError:
            for each in owned:
                each.close()
            raise
        super().open(owned)

    async def close(self) -> None:
        """Accept nothing any more, and close every connection whose protocol is not told yet."""
        self.stop()
        beginning = list(self._beginning)
        for task in beginning:
            task.cancel()
        await asyncio.gather(*beginning, return_exceptions=True)

    def _begin(self, connection: socket.socket, address: Any) -> None:
        site = ""
        if self._tls is not None:
            site = self._tls.site_of(address[0])
            self._make_room(self._tls, site)
        task = asyncio.get_running_loop().create_task(self._make(connection, site))
        self._unowned.add(connection)
        self._beginning[task] = site
        task.add_done_callback(partial(self._begun, connection))

    def _begun(self, connection: socket.socket, task: "asyncio.Task[None]") -> None:
        self._beginning.pop(task, None)
        if connection in self._unowned:  # ended before it began
            self._unowned.discard(connection)
            connection.close()

    def _make_room(self, tls: Tls, site: str) -> None:
        """End the oldest handshake from where too many come, or of all where there are too many."""
        of_site = [task for task, other in self._beginning.items() if other == site]
        if len(of_site) >= tls.limits.from_one_site:
            oldest = of_site[0]
        elif len(self._beginning) >= tls.limits.at_once:
            oldest = next(iter(self._beginning))
        else:
            return
        tls.refused(self._beginning.pop(oldest), "too many TLS handshakes at once")
        oldest.cancel()

    async def _make(self, connection: socket.socket, site: str) -> None:
        tls, loop = self._tls, asyncio.get_running_loop()
        self._unowned.discard(connection)
        if tls is None:
            await loop.connect_accepted_socket(self._protocol, connection)
            return
        try:
            await loop.connect_accepted_socket(
                self._protocol,
                connection,
                ssl=tls.context,
                ssl_handshake_timeout=tls.limits.time_s,
                ssl_shutdown_timeout=SHUTDOWN_S,
            )
        except OSError as error:
            tls.refused(site, why_no_handshake(error))


async def bound(host: str, port: int) -> list[socket.socket]:
    """Return a socket for each address of a host, bound and not listening yet.

    Raises:
        OSError: as of ``asyncio.AbstractEventLoop.create_server``, which knows how it is done.
    """
    server = await asyncio.get_running_loop().create_server(
        asyncio.Protocol, host, port, reuse_address=True, start_serving=False
    )
    try:
        return [each.dup() for each in server.sockets]
    finally:
        server.close()


_DISTRUST: Final = frozenset(
    f"{version}_ALERT_{what}"
    for version in ("SSLV3", "TLSV1", "TLSV13")
    for what in ("BAD_CERTIFICATE", "CERTIFICATE_UNKNOWN", "CERTIFICATE_EXPIRED", "UNKNOWN_CA")
)
"""What a browser says before its user has been asked, and every client to which the authority is unknown."""


def why_no_handshake(error: OSError) -> str:
    """Return why a handshake came to nothing, in words without anything that the other side sent.

    >>> why_no_handshake(ConnectionResetError(104, "Connection reset by peer"))
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
