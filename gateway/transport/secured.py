"""TLS on an accepted connection, between its bytes and the reader of the Modbus frames.

A handshake is about a hundred times the work of an exchange. So it runs in a thread, one at a time for each
listener; OpenSSL lets the loop run meanwhile. Records are opened and sealed on the loop, in the call that
brought them: that takes a few microseconds.

The TLS of asyncio is not used. It begins a handshake before any check of whether the peer may connect, and
runs it on the loop. It limits neither the handshakes nor the bytes that arrive meanwhile.
"""

import asyncio
import ssl
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateway.clock import boot_ns, now_utc
from gateway.transport.certificates import Identity, identity_of
from gateway.transport.channel import CLOSED, Channel, Receiver
from gateway.transport.connections import RequestProgress
from gateway.transport.endpoints import host_of
from gateway.transport.handshakes import MADE_ROOM, HandshakeLimits
from gateway.transport.tls import ServerContexts, reason_of

HANDSHAKE_S: Final = 5.0
"""A controller on the same network needs a few milliseconds."""
RECORD_HEADER: Final = 5
HANDSHAKE_RECORD: Final = 0x16
"""The first byte of every TLS connection (RFC 8446, 5.1)."""
MOST_STEPS: Final = 64
"""Records of a peer in one handshake: about ten are usual."""
MOST_WAITING: Final = 65_536
"""Bytes that may arrive while the thread is busy: certificate chains are a few thousand."""
READ_BYTES: Final = 4096
NO_CERTIFICATE: Final = "PEER_DID_NOT_RETURN_A_CERTIFICATE"


@dataclass(frozen=True, slots=True)
class Failure:
    """A failed handshake. ``reason`` is one of few values: it may be a counter's key."""

    host: str
    peer: str
    reason: str
    is_certificate: bool = False
    """Whether the certificate was the reason."""
    identity: Identity | None = None
    """The client, if at least its authority is the right one."""


class _Step(NamedTuple):
    identity: Identity | None = None
    error: ssl.SSLError | None = None


class TlsServer:
    """What the connections of one listener share.

    ``receiver_for`` returns the receiver for a peer, or None if its certificate does not admit it.
    ``on_failed`` gets every failed handshake, ``on_too_many`` the host and the limit when one may not begin.
    All are called on the loop.
    """

    def __init__(
        self,
        contexts: ServerContexts,
        receiver_for: Callable[[Identity], Receiver | None],
        on_failed: Callable[[Failure], None],
        on_too_many: Callable[[str, str], None],
    ) -> None:
        self.contexts = contexts
        self.receiver_for = receiver_for
        self.on_failed = on_failed
        self.on_too_many = on_too_many
        self.limits = HandshakeLimits()
        self.handshakes = 0
        """Number of successful handshakes."""
        self.sessions: dict[SecuredConnection, Identity] = {}
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="handshakes")

    def connection(self) -> "SecuredConnection":
        """Return the receiver of an accepted connection."""
        return SecuredConnection(self)

    def begin(self, step: Callable[[], _Step], done: Callable[["asyncio.Future[_Step]"], None]) -> None:
        """Run a step of a handshake in the thread; ``done`` gets it on the loop."""
        asyncio.get_running_loop().run_in_executor(self._thread, step).add_done_callback(done)

    def renew(self, done: Callable[[], None]) -> None:
        """Have the thread check whether the files have changed, as before a handshake; then call ``done``."""
        looked = asyncio.get_running_loop().run_in_executor(self._thread, self.contexts.current)
        looked.add_done_callback(lambda _: done())

    def close(self) -> None:
        """Begin no more steps."""
        self._thread.shutdown(wait=False, cancel_futures=True)


class SecuredConnection(Channel):
    """A ``Receiver`` of records, and the ``Channel`` for the receiver of their content."""

    def __init__(self, tls_server: TlsServer) -> None:
        self._tls_server = tls_server
        self._host = ""
        self._channel: Channel | None = None
        self._receiver: Receiver | None = None
        self._incoming, self._outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._tls: ssl.SSLObject | None = None
        self._waiting = bytearray()
        self._is_counted = self._is_busy = False
        self._steps = 0
        self._timer: asyncio.TimerHandle | None = None
        self._unread_ns = 0
        """When the records without readable content began; 0: the last ones had some."""

    @property
    def is_served(self) -> bool:
        """False: a handshake costs more than the requests after it."""
        return False

    @property
    def asked_ns(self) -> int:
        """See ``connections.RequestProgress``."""
        receiver: object = self._receiver
        return receiver.asked_ns if isinstance(receiver, RequestProgress) else 0

    @property
    def unfinished_ns(self) -> int:
        """See ``connections.RequestProgress``: a record may be incomplete as well.

        A handshake has its own limit.
        """
        receiver: object = self._receiver
        inside = receiver.unfinished_ns if isinstance(receiver, RequestProgress) else 0
        return min(inside or self._unread_ns, self._unread_ns or inside)

    def opened(self, channel: Channel, now_ns: int) -> None:
        """See ``Receiver``."""
        self._channel = channel
        self.peer = channel.peer
        self._host = host_of(self.peer)
        why_not = self._tls_server.limits.why_not(self._host, now_ns, self._make_room)
        if why_not:
            self._tls_server.on_too_many(self._host, why_not)
            self._hang_up()
            return
        self._is_counted = True
        self._timer = asyncio.get_running_loop().call_later(HANDSHAKE_S, self._too_slow)

    def received(self, data: bytes, now_ns: int) -> None:
        """See ``Receiver``."""
        if self._receiver is not None:
            self._incoming.write(data)
            self._open_records(now_ns)
        elif self._channel is not None:
            self._waiting += data
            self._next_step()

    def closed(self, reason: str, now_ns: int) -> None:
        """See ``Receiver``."""
        was_open = self._channel is not None
        self._channel = None
        if was_open and self._receiver is None:
            self._failed("the peer disconnected")
        self._end_handshake()
        self._leave(reason, now_ns)

    def write(self, data: bytes) -> None:
        """See ``Channel``."""
        if self._channel is None or self._tls is None:
            return
        try:
            self._tls.write(data)
        except ssl.SSLError:  # the peer has ended the session
            self._hang_up()
            return
        self._channel.write(self._outgoing.read())

    def has_gone(self, *, asks: bool) -> bool:
        """See ``Channel``."""
        return self._channel is None or self._channel.has_gone(asks=asks)

    def close(self) -> None:
        """See ``Channel``."""
        if self._tls is not None and self._receiver is not None:
            with suppress(ssl.SSLError):  # it does not wait for the answer
                self._tls.unwrap()
        self._hang_up(CLOSED)

    # --- a session -------------------------------------------------------------------------------------

    def _open_records(self, now_ns: int) -> None:
        tls, receiver = self._tls, self._receiver
        assert tls is not None
        assert receiver is not None
        unread_ns = self._unread_ns or now_ns
        try:
            while self._channel is not None:
                data = tls.read(READ_BYTES)
                if not data:
                    self.close()
                    return
                receiver.received(data, now_ns)
                unread_ns = 0
                if not self._incoming.pending and not tls.pending():
                    break
        except ssl.SSLWantReadError:
            pass
        except ssl.SSLError:
            self._hang_up()
            return
        self._unread_ns = unread_ns
        if self._outgoing.pending:  # an answer to a new key
            self._flush()

    # --- a handshake -----------------------------------------------------------------------------------

    def _next_step(self) -> None:
        if self._waiting[0] != HANDSHAKE_RECORD and not self._steps:
            self._failed("no TLS: the data received is not a handshake")
            return
        if len(self._waiting) > MOST_WAITING or self._steps > MOST_STEPS:
            self._failed("a handshake that is too long")
            return
        whole = 0 if self._is_busy else _whole_records(self._waiting)
        if not whole:
            return
        self._incoming.write(self._waiting[:whole])
        del self._waiting[:whole]
        self._is_busy = True
        self._steps += 1
        self._tls_server.begin(self._step, self._stepped)

    def _step(self) -> _Step:
        """Use the bytes received so far; in the thread, which has them exclusively."""
        try:
            if self._tls is None:
                context = self._tls_server.contexts.current()
                self._tls = context.wrap_bio(self._incoming, self._outgoing, server_side=True)
            self._tls.do_handshake()
        except ssl.SSLWantReadError:
            return _Step()
        except ssl.SSLError as error:
            return _Step(error=error)
        certificate = self._tls.getpeercert(binary_form=True)
        assert certificate is not None, "a handshake without a certificate does not succeed"
        return _Step(identity_of(certificate, now_utc()))

    def _stepped(self, step: "asyncio.Future[_Step]") -> None:
        self._is_busy = False
        if step.cancelled() or self._channel is None:
            return
        if (bug := step.exception()) is not None:
            self._failed("a fault of the gateway")
            raise bug
        identity, error = step.result()
        self._flush()
        if error is not None:
            self._refused(error)
        elif identity is not None:
            self._admit(identity)
        elif self._waiting:
            self._next_step()

    def _admit(self, identity: Identity) -> None:
        receiver = None if identity.problem else self._tls_server.receiver_for(identity)
        if receiver is None or self._channel is None:
            if self._tls is not None:
                with suppress(ssl.SSLError):
                    self._tls.unwrap()
            reason = identity.problem or f'its role "{identity.role}" is not in `roles`'
            self._failed(reason, is_certificate=True, identity=identity)
            return
        self._end_handshake()
        self._tls_server.handshakes += 1
        self._tls_server.limits.came_in(self._host)
        self._tls_server.sessions[self] = identity
        self._receiver = receiver
        now_ns = boot_ns()
        receiver.opened(self, now_ns)
        self._incoming.write(self._waiting)
        self._waiting.clear()
        self._open_records(now_ns)

    def _refused(self, error: ssl.SSLError) -> None:
        if isinstance(error, ssl.SSLCertVerificationError):
            self._failed(error.verify_message, is_certificate=True)
        elif error.reason == NO_CERTIFICATE:
            self._failed("it sent no certificate", is_certificate=True)
        else:
            self._failed(reason_of(error))

    def _too_slow(self) -> None:
        if self._channel is not None:
            self._failed(f"a handshake that took longer than {HANDSHAKE_S:g} s")

    def _make_room(self) -> None:
        self._failed(MADE_ROOM)

    def _failed(self, reason: str, *, is_certificate: bool = False, identity: Identity | None = None) -> None:
        self._tls_server.on_failed(Failure(self._host, self.peer, reason, is_certificate, identity))
        self._hang_up()

    def _end_handshake(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._is_counted:
            self._is_counted = False
            self._tls_server.limits.ended(self._host, self._make_room)

    # --- both ------------------------------------------------------------------------------------------

    def _flush(self) -> None:
        data = self._outgoing.read()
        if data and self._channel is not None:
            self._channel.write(data)

    def _hang_up(self, why: str = "closed by the gateway") -> None:
        """Close, after sending what OpenSSL still has to send."""
        self._end_handshake()
        channel = self._channel
        if channel is None:
            return
        if not self._is_busy:  # while it is, the thread may be writing there
            self._flush()
        self._channel = None
        channel.close()
        self._leave(why, boot_ns())

    def _leave(self, reason: str, now_ns: int) -> None:
        self._tls_server.sessions.pop(self, None)
        receiver, self._receiver = self._receiver, None
        if receiver is not None:
            receiver.closed(reason, now_ns)


def _whole_records(data: bytearray) -> int:
    """Return the length of the complete records at the beginning; an incomplete one is not worth a step."""
    end = 0
    while len(data) >= end + RECORD_HEADER:
        length = RECORD_HEADER + int.from_bytes(data[end + 3 : end + RECORD_HEADER], "big")
        if len(data) < end + length:
            break
        end += length
    return end
