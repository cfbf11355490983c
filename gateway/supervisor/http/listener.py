"""One listener of the page: its connections, TLS handshakes and access rules."""

import asyncio
import contextlib
import logging
import socket
import ssl
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

import h11
from starlette.types import ASGIApp
from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle
from uvicorn.server import ServerState

from gateway.config.files import TLS_KEY, NamedFileError, path_of, server_context
from gateway.config.http_model import HttpSection, HttpTlsSection, TokenSection
from gateway.files import mark_of
from gateway.ipc.address import peer_of
from gateway.supervisor.http.answers import (
    HEAD_BYTES,
    SEND_BUFFER_BYTES,
    WRITE_HIGH_BYTES,
    Limits,
    json_bytes,
    shortened,
)
from gateway.supervisor.http.refusals import Refused, ignore_refused
from gateway.transport.certificates import CertificateInForce, read_held
from gateway.transport.connections import longest
from gateway.transport.endpoints import TcpEndpoint

# --- One connection: uvicorn's HTTP/1.1, with a time limit on everything that a client can delay

LEAVING_S: Final = 2.0
"""Time for a client to notice that the server has closed."""
_ASKING: Final = frozenset((h11.IDLE, h11.SEND_BODY))
"""States of the client in which its request is incomplete."""


def last_words(status: str, what: str) -> bytes:
    """Return a complete response for a connection that closes without serving a request."""
    body = json_bytes({"problem": what})
    head = (
        f"HTTP/1.1 {status}\r\nContent-Type: application/json\r\nContent-Length: {len(body)}\r\n"
        "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n"
    )
    return head.encode("ascii") + body


class HttpConnection(H11Protocol):
    """A connection with time limits; :meth:`is_overdue` says when it has exceeded one.

    ``make_room`` says whether a slot is free for the new connection. ``refused`` is called if not, and for
    bytes that are not a request.
    """

    def __init__(
        self,
        config: Config,
        state: ServerState,
        limits: Limits,
        make_room: Callable[[], bool],
        refused: Refused,
    ) -> None:
        super().__init__(config=config, server_state=state, app_state={})
        self._limits = limits
        self._make_room = make_room
        self._refused = refused
        now_s = time.monotonic()
        self._quiet_since_s = now_s
        self._asking_since_s: float | None = now_s
        self._stalled_since_s: float | None = None
        self._closing_since_s: float | None = None
        self._leaving_since_s: float | None = None
        """The final response was sent. Further bytes from the client are ignored."""
        self._has_begun = False

    @property
    def is_idle(self) -> bool:
        """Whether no request is being answered."""
        cycle: RequestResponseCycle | None = self.cycle
        return cycle is None or cycle.response_complete

    @property
    def idle_since_s(self) -> float | None:
        """When the last response was complete, or the connection opened; None while it answers a request."""
        return self._quiet_since_s if self.is_idle else None

    @property
    def stalled_since_s(self) -> float | None:
        """Since when the client has taken nothing of its response; None if it takes it."""
        return self._stalled_since_s

    @property
    def peer(self) -> str:
        """The address of the client."""
        return self.client[0] if self.client else ""

    @property
    def is_slow(self) -> bool:
        """Whether a request has begun and is incomplete."""
        return self._has_begun and self._asking_since_s is not None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See ``asyncio.BaseProtocol``."""
        transport = cast("asyncio.Transport", transport)
        connection: socket.socket = transport.get_extra_info("socket")
        with contextlib.suppress(OSError):  # the client has already gone
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        transport.set_write_buffer_limits(high=WRITE_HIGH_BYTES)
        if connection.family == socket.AF_UNIX:
            self.app_state["peer"] = peer_of(connection)
        certificate = transport.get_extra_info("peercert")
        if certificate:  # the handshake has verified it
            self.app_state["certificate"] = name_in(certificate)
        has_room = self._make_room()
        super().connection_made(transport)
        if not has_room:
            self.connections.discard(self)
            self._refused(self.peer, "too many connections at once")
            transport.write(last_words("503 Service Unavailable", "too many connections; try again later"))
            transport.close()

    def data_received(self, data: bytes) -> None:
        """See ``asyncio.Protocol``."""
        if self.transport.is_closing() or self._leaving_since_s is not None:
            return
        self._has_begun = True
        super().data_received(data)
        if self.conn.their_state not in _ASKING:
            self._asking_since_s = None
        elif self._asking_since_s is None:
            self._asking_since_s = time.monotonic()

    def send_400_response(self, msg: str) -> None:
        """Answer bytes that are not an HTTP request, or a request that is too large, and close."""
        if not self.is_idle:
            self.transport.abort()  # inside a response there is nothing valid to send
            return
        waiting, _ = self.conn.trailing_data
        if len(waiting) > HEAD_BYTES:
            what = f"the head of a request may have at most {HEAD_BYTES} bytes"
            self.transport.write(last_words("431 Request Header Fields Too Large", what))
        else:
            what = "not a request of HTTP/1.1"
            self.transport.write(last_words("400 Bad Request", what))
        self._refused(self.peer, what)
        self._leaving_since_s = time.monotonic()
        # Not closed immediately: with unread input, the system would discard the response.
        if self.transport.can_write_eof():
            self.transport.write_eof()
        elif len(waiting) <= HEAD_BYTES:  # TLS cannot close one direction only; here almost nothing is unread
            self.transport.close()

    def on_response_complete(self) -> None:
        """See ``H11Protocol``."""
        self._quiet_since_s = time.monotonic()
        super().on_response_complete()

    def pause_writing(self) -> None:
        """See ``asyncio.BaseProtocol``."""
        self._stalled_since_s = time.monotonic()
        super().pause_writing()

    def resume_writing(self) -> None:
        """See ``asyncio.BaseProtocol``."""
        self._stalled_since_s = None
        super().resume_writing()

    def is_overdue(self, now_s: float) -> bool:
        """Whether the client has exceeded a time limit."""
        limits = self._limits
        if self._closing_since_s is None and self.transport.is_closing():
            self._closing_since_s = now_s
        return (
            _is_past(self._asking_since_s, limits.whole_request_s, now_s)
            or _is_past(self._leaving_since_s, LEAVING_S, now_s)
            or _is_past(self._stalled_since_s, limits.stalled_s, now_s)
            or _is_past(self._closing_since_s, limits.stalled_s, now_s)
        )

    def drop(self) -> None:
        """Close immediately; unsent bytes are lost."""
        self.transport.abort()

    def leave(self) -> None:
        """Close; bytes that the client does not take are lost."""
        if (
            not self.transport.is_closing()
        ):  # a TLS transport that is closed twice is unusable (CPython, sslproto)
            self.transport.close()
        if self.transport.get_write_buffer_size():
            self.transport.abort()

    def give_way(self) -> None:
        """Close to make room for another connection."""
        self.connections.discard(self)
        self.transport.abort()


def name_in(certificate: Mapping[str, Any]) -> str:
    """Return the subject of a certificate, for the log.

    >>> name_in({"subject": ((("organizationName", "Mills"),), (("commonName", "panel"),))})
    'panel'
    """
    names = [value for part in certificate.get("subject", ()) for key, value in part if key == "commonName"]
    return shortened(names[0]) if names else "without a name"


def _is_past(since_s: float | None, longest_s: float, now_s: float) -> bool:
    return since_s is not None and now_s - since_s > longest_s


def silent_config(app: Any, keep_alive_s: int) -> Config:
    """Return uvicorn settings without logging and without guessing client addresses from headers."""
    config = Config(
        app,
        http=H11Protocol,
        ws="none",
        lifespan="off",
        interface="asgi3",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        date_header=False,
        timeout_keep_alive=keep_alive_s,
        h11_max_incomplete_event_size=HEAD_BYTES,
    )
    config.load()
    return config


# --- An open listener: its connections, and which of them have to close


def silence_uvicorn() -> None:
    """Keep uvicorn's own messages out of the log: malformed requests concern only their senders."""
    for name in ("uvicorn", "uvicorn.error", "uvicorn.access"):
        logger = logging.getLogger(name)
        logger.handlers = [logging.NullHandler()]
        logger.propagate = False


class HttpServer:
    """Makes the connections of a listener and enforces their limits.

    :meth:`watch` has to run while the listener is open; :meth:`close` ends it.
    """

    def __init__(self, limits: Limits, refused: Refused = ignore_refused) -> None:
        self.limits = limits
        self.refused = refused
        self.event_readers = 0
        self._state = ServerState()

    def serve(self, app: ASGIApp) -> None:
        """Set the application; call it before the first connection."""
        silence_uvicorn()
        self._config = silent_config(app, self.limits.keep_alive_s)

    def connection(self) -> HttpConnection:
        """Return the protocol of a new connection."""
        return HttpConnection(self._config, self._state, self.limits, self.make_room, self.refused)

    @property
    def _connections(self) -> list[HttpConnection]:
        return [one for one in self._state.connections if isinstance(one, HttpConnection)]

    def make_room(self) -> bool:
        """Whether one more connection is admitted. At the limit, another connection is closed for it.

        That is the connection that has been idle for longest. If none is idle, it is the one that has taken
        nothing of its response for longest. Otherwise a client that sends many requests and reads nothing
        would block all others.
        """
        connections = self._connections
        if len(connections) < self.limits.connections:
            return True
        which, going = "sent no request", longest(connections, lambda one: one.idle_since_s)
        if going is None:
            which, going = "read nothing of its answer", longest(connections, lambda one: one.stalled_since_s)
        if going is None:
            return False
        self.refused(going.peer, f"too many connections at once: the one that {which} for longest")
        going.give_way()
        return True

    @contextlib.contextmanager
    def event_reader(self) -> Iterator[bool]:
        """Count one reader of ``/events`` while it reads; yields whether a slot is free."""
        has_room = self.event_readers < self.limits.event_readers
        self.event_readers += has_room
        try:
            yield has_room
        finally:
            self.event_readers -= has_room

    async def watch(self) -> None:
        """Drop overdue connections until cancelled."""
        while True:
            await asyncio.sleep(self.limits.sweep_s)
            now_s = time.monotonic()
            for one in self._connections:
                if one.is_overdue(now_s):
                    if one.is_slow:
                        self.refused(one.peer, "a request that was not complete in time")
                    one.drop()

    async def close(self) -> None:
        """Drop all connections. Finished responses are already sent, unfinished ones are lost."""
        for one in self._connections:
            one.leave()
        tasks = list(self._state.tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


# --- Where the page is served and who may see it: the configuration with the files that it names


@dataclass(frozen=True, slots=True)
class HttpSettings:
    """Settings of the page. Equal settings need no change of the server."""

    endpoint: TcpEndpoint
    tokens: tuple[TokenSection, ...]
    tls: HttpTlsSection | None
    gateway: str
    """Name of the gateway."""
    folder: Path
    """Base of relative file paths."""
    seen: tuple[tuple[int, ...] | None, ...]
    """Stamps of the TLS files: renewed files have other stamps."""

    @property
    def asks_who(self) -> bool:
        """Whether each request has to authenticate. With client certificates the handshake does it."""
        return bool(self.tokens)

    @property
    def address(self) -> str:
        """The address, for display."""
        return f"{'http' if self.tls is None else 'https'}://{self.endpoint}"

    @property
    def cookie(self) -> str:
        """Name of the session cookie.

        A browser has one cookie store for all gateways behind one host. On one machine they differ by port,
        behind one proxy by name.
        """
        return f"{'' if self.tls is None else '__Host-'}pitch-gateway-{self.gateway}-{self.endpoint.port}"

    def context(self) -> ssl.SSLContext | None:
        """Return the TLS context, None without TLS; blocks. Raises NamedFileError."""
        if self.tls is None:
            return None
        return server_context(self.tls, self.folder, needs_client=not self.tokens)

    def held(self) -> tuple[CertificateInForce, ...]:
        """Return the certificates in the TLS files, with their validity; blocks. Raises NamedFileError."""
        if self.tls is None:
            return ()
        named = {
            "certificate": self.tls.certificate,
            "clients": self.tls.clients,
            "revoked": self.tls.revoked,
        }
        return read_held(
            {
                key: path_of((*TLS_KEY, key), file, self.folder).absolute()
                for key, file in named.items()
                if file is not None
            }
        )


def http_settings_of(section: HttpSection, gateway: str, folder: Path) -> HttpSettings | None:
    """Return the settings of the section for the gateway of that name; None: no page over TCP.

    Relative file paths start at ``folder``.
    """
    endpoint, tls = section.endpoint, section.tls
    if endpoint is None:
        return None
    files = () if tls is None else (tls.certificate, tls.key, tls.clients, tls.revoked)
    seen = tuple(_file_mark(file, folder) for file in files)
    return HttpSettings(endpoint, section.tokens, tls, gateway, folder, seen)


def _file_mark(file: str | None, folder: Path) -> tuple[int, ...] | None:
    try:
        status = path_of(TLS_KEY, file, folder).stat() if file is not None else None
    except (NamedFileError, OSError):
        return None
    return None if status is None else mark_of(status)
