"""TCP on both sides: the relay's loop handles sockets itself, other loops use raw asyncio protocols.

For a plain ``asyncio.Protocol`` the loop allocates 256 KiB at every read, which costs more than the rest of
an exchange. A ``BufferedProtocol`` reads into existing memory.
"""

import asyncio
import contextlib
import errno
import os
import socket
from collections.abc import Callable, Iterable
from enum import Enum
from ipaddress import IPv4Network, IPv6Network
from typing import Final, cast

from gateway.catalogue import starts
from gateway.clock import boot_ns
from gateway.status.line import LatencySettings
from gateway.times import NS_PER_S
from gateway.transport.channel import CLOSED, CLOSED_BY_PEER, Channel, Receiver
from gateway.transport.connections import MAKE_ROOM_EVERY_NS, SWEEP_S, Closing, Connections, RequestProgress
from gateway.transport.direct import MORE_BYTES, RECEIVE_BYTES, DirectSocket, FarEnd
from gateway.transport.endpoints import TcpEndpoint, address_of
from gateway.transport.errors import AbsentError, RefusedError
from gateway.transport.limits import DEFAULT_LIMITS, ConnectionLimits, ConnectRate
from gateway.transport.listener import ProtocolListener, bound
from gateway.transport.loop import RelayLoop
from gateway.transport.peer_probe import PeerProbe, PeerVerdict
from gateway.transport.permissions import is_permission, no_port
from gateway.transport.reconnector import Reconnector

CONNECT_TIMEOUT_S: Final = 3.0
LOOKS: Final = 4
"""Checks of a peer within its time to acknowledge, because one probe may be lost."""
SHORTEST_PROBE_S: Final = 0.025
"""Shortest interval of these checks."""
BROKEN_OFF: Final = "broken off"
KEEPALIVE_IDLE_S: Final = 10
KEEPALIVE_INTERVAL_S: Final = 3
KEEPALIVE_COUNT: Final = 3
USER_TIMEOUT_MS: Final = 10_000
"""Data that is unacknowledged for this time ends the connection. So a pulled cable is found within seconds,
and the new connection starts without the back-off that retransmission would have reached by then."""


class TcpChannel(asyncio.BufferedProtocol, Channel):
    """One TCP connection; passes what it reads to ``receiver``.

    On the relay's loop its bytes bypass the transport (``transport.direct``), which does all the rest.
    """

    def __init__(self, receiver: Receiver) -> None:
        self._receiver = receiver
        self._loop = asyncio.get_running_loop()
        self._buffer = memoryview(b"")
        self._transport: asyncio.Transport | None = None
        self._direct: DirectSocket | None = None
        self._far_end: FarEnd | None = None
        self._why_ended = ""
        self.made_ns = 0
        """When it was made."""
        self._bytes_received = 0
        self.lost: asyncio.Future[None] = self._loop.create_future()

    @property
    def bytes_received(self) -> int:
        """How many bytes have come."""
        return self._bytes_received if self._direct is None else self._direct.bytes_received

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See ``asyncio.BaseProtocol``."""
        self._transport = cast("asyncio.Transport", transport)
        self.made_ns = boot_ns()
        self.peer = _name(transport.get_extra_info("peername"))
        connection: socket.socket = transport.get_extra_info("socket")
        _tune(connection)
        if not isinstance(self._loop, RelayLoop):
            self._far_end = FarEnd(connection.fileno())
            self._buffer = memoryview(bytearray(RECEIVE_BYTES + MORE_BYTES))
            self._receiver.opened(self, boot_ns())
            return
        # Not yet: after this call the transport of Python 3.11.2 (Debian 12) begins to read, paused or not.
        self._loop.call_soon(self._pause_transport)
        self._direct = DirectSocket(self, connection.fileno(), self._receiver, self._loop.selector)
        self._loop.add_reader(self._direct.descriptor, self._direct.readable)
        self._receiver.opened(self._direct, boot_ns())

    def _pause_transport(self) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.pause_reading()

    def get_buffer(self, sizehint: int) -> memoryview:
        """See ``asyncio.BufferedProtocol``."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """See ``asyncio.BufferedProtocol``."""
        now_ns = boot_ns()
        self._bytes_received += nbytes
        self._receiver.received(bytes(self._buffer[:nbytes]), now_ns)

    def pause_writing(self) -> None:
        """Stop reading from a peer that does not take its replies: they would fill the memory."""
        if self._direct is not None:
            self._unwatch(self._direct)
        elif self._transport is not None and not self._transport.is_closing():
            self._transport.pause_reading()

    def eof_received(self) -> None:
        """See ``asyncio.BufferedProtocol``: the transport then closes itself."""
        self._why_ended = CLOSED_BY_PEER

    def end(self) -> None:
        """See ``direct.Connection``."""
        self._why_ended = CLOSED_BY_PEER
        self.close()

    def resume_writing(self) -> None:
        """Continue reading."""
        if self._transport is None or self._transport.is_closing():
            return
        if self._direct is not None:
            self._loop.add_reader(self._direct.descriptor, self._direct.readable)
        else:
            self._transport.resume_reading()

    def connection_lost(self, exc: Exception | None) -> None:
        """See ``asyncio.BaseProtocol``."""
        self._stop_reading()
        self._transport = None
        if not self.lost.done():
            self.lost.set_result(None)
        why = self._why_ended or (_why(exc) if exc else CLOSED)
        self._receiver.closed(why, boot_ns())

    def write(self, data: bytes) -> None:
        """See ``Channel``."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    def leave_over(self, data: bytes) -> None:
        """See ``direct.Connection``."""
        self.write(data)

    def has_left_over(self) -> bool:
        """See ``direct.Connection``."""
        return self._transport is not None and self._transport.get_write_buffer_size() > 0

    def count_received(self) -> int:
        """See ``Channel``."""
        return self.bytes_received

    def has_gone(self, *, asks: bool) -> bool:
        """See ``Channel``: it always queries the system."""
        return self._transport is None or self._far_end is None or self._far_end.has_gone()

    def close(self) -> None:
        """See ``Channel``."""
        self._stop_reading()
        if self._transport is not None:
            self._transport.close()

    def abort(self) -> None:
        """Close immediately; unsent bytes are lost."""
        self._stop_reading()
        if self._transport is not None:
            self._transport.abort()

    def break_off(self, reason: str) -> None:
        """See ``direct.Connection``."""
        self._why_ended = reason
        self.abort()

    def _stop_reading(self) -> None:
        """Release the descriptor before the transport closes it: its number may be reused."""
        if self._direct is not None:
            self._direct.over()
            self._unwatch(self._direct)

    def _unwatch(self, direct: DirectSocket) -> None:
        """Harmless twice; ``remove_reader`` of asyncio refuses the descriptor of an open transport."""
        assert isinstance(self._loop, RelayLoop)
        self._loop.selector.unwatch(direct.descriptor)


class _AcceptedChannel(TcpChannel):
    """A connection that its listener may refuse."""

    def __init__(self, listener: "TcpListener", receiver: Receiver) -> None:
        super().__init__(receiver)
        self._listener = listener
        self._admitted = False
        self.host = ""
        self.opened_ns = boot_ns()
        self.asking = receiver if isinstance(receiver, RequestProgress) else None
        self._probe: PeerProbe | None = None
        self._not_before_ns = 0
        """Its peer is not probed again before this time."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        peername = transport.get_extra_info("peername")
        if not peername or _is_reset(transport.get_extra_info("socket")):
            self._listener.accepted += 1  # it came and went: its request is not carried out (W5)
            cast("asyncio.Transport", transport).abort()
            return
        self.host = peername[0]
        self._admitted = self._listener.admit(self)
        if self._admitted:
            super().connection_made(transport)
        else:
            cast("asyncio.Transport", transport).abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self._probe = None
        if self._admitted:
            super().connection_lost(exc)
        self._listener.forget(self)

    def abort(self) -> None:
        """See ``Connection``."""
        self._why_ended = self._why_ended or BROKEN_OFF
        super().abort()

    @property
    def is_probed(self) -> bool:
        """Whether its peer is being probed."""
        return self._probe is not None

    def peer_has_gone(self) -> bool:
        """Whether its peer has closed or reset it; unread bytes are still read."""
        if self._direct is not None:
            return self._direct.has_gone(asks=True)
        return self.has_gone(asks=True)

    def probe_peer(self, patience_ns: int, now_ns: int) -> None:
        """Begin to probe its peer, unless it has just responded."""
        if self._probe is None and self._transport is not None and now_ns >= self._not_before_ns:
            connection: socket.socket = self._transport.get_extra_info("socket")
            with contextlib.suppress(OSError):  # it is lost at this moment
                self._probe = PeerProbe(connection, patience_ns, now_ns)

    def peer_verdict(self, patience_ns: int, now_ns: int) -> PeerVerdict:
        """Return the verdict on its peer so far."""
        if self._probe is None:
            return PeerVerdict.THERE
        try:
            found = self._probe.check(now_ns)
            if found is not PeerVerdict.UNKNOWN:
                self._probe.end()
        except OSError:  # it is lost at this moment
            found = PeerVerdict.THERE
        if found is not PeerVerdict.UNKNOWN:
            self._probe = None
            self._not_before_ns = now_ns + patience_ns
        return found


class Refusal(Enum):
    """Why a connection was refused."""

    NOT_ALLOWED = "not in `allow`"
    TOO_MANY = "too many connections at once (max_connections)"
    TOO_FAST = "too many connections in a second (connects_per_s)"


class TcpListener:
    """Accepts connections; each one gets its own receiver.

    ``allow`` lists the networks that may connect (empty: all), ``limits`` the number and the rate of
    connections. Other connections are closed immediately and counted in ``refused``; ``on_refused`` gets the
    reason. ``patience_ns`` and ``on_closed`` are as in :class:`Connections`.

    When a host connects while the limit is reached, its other connections are checked. One that its peer has
    closed or reset is removed immediately. A peer that leaves a probe unacknowledged for
    ``acknowledged_within_ns`` is gone (0: no probes). Until then the new client is refused: its request would
    be old when a connection becomes free.
    """

    def __init__(
        self,
        endpoint: TcpEndpoint,
        allow: Iterable[IPv4Network | IPv6Network],
        make_receiver: Callable[[], Receiver],
        on_refused: Callable[[str, Refusal], None],
        *,
        limits: ConnectionLimits = DEFAULT_LIMITS,
        patience_ns: int = 0,
        on_closed: Callable[[str, Closing], None] = lambda _host, _why: None,
        acknowledged_within_ns: int = 0,
    ) -> None:
        self._acknowledged_within_ns = acknowledged_within_ns
        self._looks_s = max(acknowledged_within_ns / (LOOKS * NS_PER_S), SHORTEST_PROBE_S)
        self._probing: asyncio.TimerHandle | None = None
        self._looked_ns = 0
        """When the connections of a new client's host were last checked, and all of them were open."""
        self._rate = ConnectRate(limits)
        self._connections = Connections(limits, patience_ns, on_closed)
        self._sweeping: asyncio.TimerHandle | None = None
        self._endpoint = endpoint
        self._allow = tuple(allow)
        self._make_receiver = make_receiver
        self._on_refused = on_refused
        self._listener = ProtocolListener(lambda: _AcceptedChannel(self, self._make_receiver()))
        self._channels: set[_AcceptedChannel] = set()
        self._is_accepting = True
        self.refused = 0
        self.accepted = 0
        """All connections, admitted or refused."""

    @property
    def addresses(self) -> tuple[TcpEndpoint, ...]:
        """The real listening addresses: with the port that the system chose for 0."""
        names = [listening.getsockname() for listening in self.sockets]
        return tuple(TcpEndpoint(name[0], name[1], self._endpoint.rtu) for name in names)

    @property
    def sockets(self) -> list[socket.socket]:
        """Its listening sockets; none before it is opened."""
        return self._listener.sockets

    @property
    def peers(self) -> list[str]:
        """Addresses of the connected peers."""
        return sorted(channel.peer for channel in self._channels)

    async def open(self, kept: Iterable[socket.socket] = ()) -> None:
        """Listen; ``kept`` are sockets that already listen: then these alone.

        Raises:
            RefusedError: port in use, no permission, no such address; with the remedy.
        """
        try:
            self._listener.open(list(kept) or await bound(self._endpoint.host, self._endpoint.port))
        except OSError as error:
            raise RefusedError(_why_not_listening(self._endpoint, error)) from error

    def stop_accepting(self) -> None:
        """Accept no more connections, not even one in progress; open connections stay."""
        self._is_accepting = False
        for timer in (self._sweeping, self._probing):
            if timer is not None:
                timer.cancel()
        self._listener.stop()

    async def close(self) -> None:
        """Close everything after the written bytes were sent (within a second, else immediately)."""
        self.stop_accepting()
        await self._listener.close()
        lost = [channel.lost for channel in self._channels]
        for channel in tuple(self._channels):
            channel.close()
        if lost:
            await asyncio.wait(lost, timeout=1.0)
        for channel in tuple(self._channels):
            channel.abort()

    def admit(self, channel: _AcceptedChannel) -> bool:
        """Whether a new connection is admitted."""
        if not self._is_accepting:
            return False
        self.accepted += 1
        # First: a client that may not connect at all must not learn how many do.
        if not self._is_allowed(channel.host):
            return self._refuse(channel.host, Refusal.NOT_ALLOWED)
        if not self._has_room_for(channel.host, channel.opened_ns):
            return self._refuse(channel.host, Refusal.TOO_MANY)
        if not self._rate.takes(channel.host, channel.opened_ns):
            return self._refuse(channel.host, Refusal.TOO_FAST)
        self._connections.take(channel, channel.opened_ns)
        self._channels.add(channel)
        if self._sweeping is None:
            self._sweep_later()
        return True

    def forget(self, channel: _AcceptedChannel) -> None:
        """Remove a connection that has ended."""
        if channel in self._channels and channel.asking is not None and channel.asking.is_served:
            self._rate.give_back(channel.host, boot_ns())
        self._channels.discard(channel)
        self._connections.leave(channel)

    def _has_room_for(self, host: str, now_ns: int) -> bool:
        if self._connections.has_room_for(host, now_ns):
            return True
        if now_ns - self._looked_ns < MAKE_ROOM_EVERY_NS:
            return False
        has_room = False
        for channel in tuple(self._channels):
            if channel.host != host:
                continue
            if channel.peer_has_gone():
                self._connections.leave(channel)  # it ends when its bytes were read
                has_room = True
            elif self._acknowledged_within_ns:
                channel.probe_peer(self._acknowledged_within_ns, now_ns)
        if not has_room:
            self._looked_ns = now_ns  # a flood must not keep the loop busy
        self._check_probes_later()
        return has_room

    def _check_probes_later(self) -> None:
        if self._probing is None and any(channel.is_probed for channel in self._channels):
            self._probing = asyncio.get_running_loop().call_later(self._looks_s, self._check_probes)

    def _check_probes(self) -> None:
        self._probing = None
        now_ns = boot_ns()
        for channel in tuple(self._channels):
            if (
                channel.is_probed
                and channel.peer_verdict(self._acknowledged_within_ns, now_ns) is PeerVerdict.GONE
            ):
                self._connections.close(channel, Closing.VANISHED)
        self._check_probes_later()

    def _sweep_later(self) -> None:
        self._sweeping = asyncio.get_running_loop().call_later(SWEEP_S, self._sweep)

    def _sweep(self) -> None:
        self._sweeping = None
        self._connections.sweep(boot_ns())
        if not self._connections.is_empty:
            self._sweep_later()

    def _refuse(self, host: str, why: Refusal) -> bool:
        self.refused += 1
        self._on_refused(host, why)
        return False

    def _is_allowed(self, host: str) -> bool:
        if not self._allow:
            return True
        address = address_of(host)
        return any(address in network for network in self._allow)


class TcpConnector:
    """Keeps a connection to ``endpoint`` up; with ``on_demand`` only once it is requested.

    ``was_of_use`` is called with the start time of a lost connection: after a useful one the next follows
    immediately. By default a connection was useful if anything came on it.
    """

    notes: tuple[str, ...] = ()
    """As of a serial port; a connection has none."""
    latency: LatencySettings | None = None
    """As of a serial port; a connection has no such settings."""

    def __init__(
        self,
        endpoint: TcpEndpoint,
        receiver: Receiver,
        on_failure: Callable[[str], None],
        *,
        was_of_use: Callable[[int], bool] | None = None,
        on_demand: bool = False,
    ) -> None:
        self._endpoint = endpoint
        self._receiver = receiver
        self._is_of_use = was_of_use
        self._reconnector = Reconnector(self._attempt, self._was_of_use, on_failure, on_demand=on_demand)
        self._channel: TcpChannel | None = None

    @property
    def is_open(self) -> bool:
        """Whether there is a connection now."""
        return self._channel is not None and not self._channel.lost.done()

    @property
    def is_kept_up(self) -> bool:
        """Whether it is still kept up: only a bug of this program ends that."""
        return self._reconnector.is_running

    @property
    def failure(self) -> str:
        """Why the last attempt to connect failed; empty while there is a connection."""
        return self._reconnector.failure

    @property
    def opens(self) -> int:
        """How often a connection was made."""
        return self._reconnector.opens

    async def open(self) -> None:
        """Begin to connect. Returns immediately: a drive that is switched off is no error."""
        self._reconnector.start()

    def want(self) -> None:
        """Connect soon, if there is no connection: a caller waits for it."""
        if not self.is_open:
            self._reconnector.want()

    def renew(self) -> None:
        """Abort the connection, with its unsent bytes, and make another one immediately."""
        if self._channel is not None:
            self._channel.abort()
        self._reconnector.want()

    def hang_up(self, *, returns: bool) -> None:
        """Close the connection in order; ``returns``: make another one immediately."""
        if self._channel is not None:
            self._channel.close()
        if returns:
            self._reconnector.want()

    async def close(self) -> None:
        """Close, and stop retrying."""
        await self._reconnector.stop()
        if self._channel is not None and not self._channel.lost.done():
            self._channel.close()
            await asyncio.wait([self._channel.lost], timeout=1.0)
            self._channel.abort()

    def _was_of_use(self) -> bool:
        if self._is_of_use is not None:
            return self._channel is not None and self._is_of_use(self._channel.made_ns)
        return self._channel is not None and self._channel.bytes_received > 0

    async def _attempt(self) -> "asyncio.Future[None]":
        self._channel = None
        self._channel = await connect(self._endpoint, self._receiver)
        return self._channel.lost


async def connect(endpoint: TcpEndpoint, receiver: Receiver) -> TcpChannel:
    """Connect once.

    Raises:
        AbsentError: no answer there.
    """
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            _, channel = await loop.create_connection(
                lambda: TcpChannel(receiver), endpoint.host, endpoint.port
            )
    except TimeoutError as error:
        raise AbsentError(
            f"{starts.NO_ANSWER.begin(endpoint=endpoint, seconds=CONNECT_TIMEOUT_S)} s"
        ) from error
    except OSError as error:
        raise AbsentError(why_not_reached(endpoint, error)) from error
    return channel


def why_not_reached(endpoint: TcpEndpoint, error: OSError) -> str:
    """Return why connecting failed; with the remedy if the host name is unknown."""
    found = starts.NOT_REACHED.begin(endpoint=endpoint)
    if isinstance(error, socket.gaierror):
        return (
            f"{found}: the host name {endpoint.host} is unknown ({error.strerror}); correct it, enter it "
            "in /etc/hosts or the name service, or write the IP address instead"
        )
    why = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error) or "no answer"
    return f"{found}: {why}"


def _why(error: Exception) -> str:
    """Return the system's reason for a broken connection."""
    number = error.errno if isinstance(error, OSError) else None
    return os.strerror(number) if number else str(error)


def _name(peername: tuple[str, int] | None) -> str:
    return str(TcpEndpoint(peername[0], peername[1])) if peername else "?"


def _is_reset(connection: socket.socket) -> bool:
    """Whether the peer reset it before it was accepted; its bytes can still be read."""
    try:
        connection.getpeername()
    except OSError:
        return True
    return False


def _tune(connection: socket.socket) -> None:
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, KEEPALIVE_IDLE_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, KEEPALIVE_INTERVAL_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, KEEPALIVE_COUNT)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, USER_TIMEOUT_MS)


def is_no_address_here(error: OSError) -> bool:
    """Whether listening failed because the machine does not have the address.

    Up to Python 3.12 asyncio keeps the system's error number. Python 3.13 and later omit such an address. If
    no address remains, the error has no number; every other error here has one.
    """
    return error.errno in (errno.EADDRNOTAVAIL, None)


def _why_not_listening(endpoint: TcpEndpoint, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return (
            f"{starts.IN_USE.begin(place=endpoint)}; choose another port or stop that program "
            f"(ss -ltnp 'sport = :{endpoint.port}' names it)"
        )
    if is_permission(error):
        return "; ".join(no_port(endpoint))
    if is_no_address_here(error):
        return f"{starts.NO_ADDRESS_HERE.begin(endpoint=endpoint)}; `ip address` lists its addresses"
    if isinstance(error, socket.gaierror):
        found = starts.UNKNOWN_HOST.begin(host=endpoint.host)
        return f"{found} ({error.strerror}); use an address of this machine"
    return f"{starts.CANNOT_LISTEN.begin(endpoint=endpoint)}: {error.strerror or error}"
