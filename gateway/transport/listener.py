"""The one listener of the gateway: Modbus TCP, the page, both Unix sockets and simulated drives use it.

The server of asyncio is not used. It accepts a hundred connections in one cycle of the loop, does not tell
how many are in a handshake, and has no limit for them. It also makes the transport of a connection in a task.
If the connection is closed before that task runs, the task fails with an unseen assertion, and the connection
stays open and unread (CPython, ``asyncio.Server._attach``).
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
"""After an accept that failed, for example without a free descriptor."""
HANDSHAKE_S: Final = 10.0
SHUTDOWN_S: Final = 2.0
"""Time for the other side to close TLS."""


class Listener:
    """Accepts on listening sockets, one connection in a cycle of the loop.

    ``take`` gets each connection, non-blocking, with the address of its peer. ``on_failed`` gets the error of
    a failed accept: the next one follows after a pause, because waiting clients stay in the queue.
    """

    def __init__(
        self,
        take: Callable[[socket.socket, Any], object],
        on_failed: Callable[[OSError], object] | None = None,
    ) -> None:
        self.sockets: list[socket.socket] = []
        """Its sockets; none before it is opened and after it has stopped."""
        self._take = take
        self._on_failed = on_failed or _report_to_loop
        self._pauses: dict[socket.socket, asyncio.TimerHandle] = {}

    def open(self, sockets: Iterable[socket.socket]) -> None:
        """Accept on these from now on; they are closed at its end."""
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
    """How many handshakes may run at the same time; one more ends the oldest."""

    at_once: int = 64
    from_one_site: int = 16
    time_s: float = HANDSHAKE_S


@dataclass(frozen=True, slots=True)
class Tls:
    """The TLS settings of a listener.

    ``refused`` gets the site and the reason of each failed handshake; ``site_of`` returns one name for all
    addresses that one peer can have.
    """

    context: ssl.SSLContext
    limits: HandshakesAtOnce
    refused: Callable[[str, str], None]
    site_of: Callable[[str], str]


class ProtocolListener(Listener):
    """Gives each connection a protocol of asyncio; with TLS, once its handshake has succeeded."""

    def __init__(self, protocol: Callable[[], asyncio.BaseProtocol], tls: Tls | None = None) -> None:
        super().__init__(self._begin)
        self._protocol = protocol
        self._tls = tls
        self._beginning: dict[asyncio.Task[None], str] = {}
        """Connections without a protocol yet, the oldest first; with TLS each with its site."""
        self._unowned: set[socket.socket] = set()
        """Those of them without a transport: the code that ends these must close them."""

    @property
    def handshakes(self) -> int:
        """How many handshakes run."""
        return len(self._beginning)

    def open(self, sockets: Iterable[socket.socket]) -> None:
        """Listen on these from now on.

        Raises:
            OSError: another program listens there; they are closed.
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
        """Accept nothing any more, and close every connection without a protocol."""
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
        """End the oldest handshake of a site that has too many, or of all if there are too many."""
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
        OSError: as of ``asyncio.AbstractEventLoop.create_server``, which does the work.
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
"""What a browser sends before it has asked its user, and every client that does not know the authority."""


def why_no_handshake(error: OSError) -> str:
    """Return why a handshake failed, without any text of the other side.

    >>> why_no_handshake(ConnectionResetError(104, "Connection reset by peer"))
    'no TLS: the client disconnected'
    """
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate: {error.verify_message}"
    if isinstance(error, ssl.SSLError) and error.reason in _DISTRUST:
        return "the client did not accept the certificate of the page"
    if isinstance(error, ssl.SSLError):
        return f"no TLS: {(error.reason or 'not understood').lower().replace('_', ' ')}"
    if isinstance(error, ConnectionAbortedError):
        return "the TLS handshake did not end in time"
    return "no TLS: the client disconnected"
