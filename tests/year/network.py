"""TCP between the process and the world: connections whose bytes take their time, break and stall.

A connection has an end in the process, a descriptor, and an end in the world, a :class:`Peer`. For asyncio
the first is a :class:`Socket`, with the methods that its loop, its transports and the gateway call.
"""

import errno
import os
import random
import select
import socket
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from tests.year.machine import Descriptor, Machine, S

Address = tuple[str, int]
HOST: Final = "10.0.0.1"
"""The machine of the gateway."""
LEAST_NS, MOST_NS = 60_000, 400_000
"""The way of a packet."""
GIVEN_UP_NS: Final = 10 * S
"""Data that is unacknowledged for so long ends a connection (TCP_USER_TIMEOUT, which the gateway sets)."""
_FIRST_PORT: Final = 40_000


class Peer:
    """The end of a connection in the world."""

    stream: "Stream | None" = None

    def opened(self) -> None:
        """It is connected."""

    def received(self, data: bytes) -> None:
        """Bytes have come."""

    def closed(self) -> None:
        """The connection has ended, or was refused; after this nothing comes."""

    def send(self, data: bytes) -> int:
        """Send to the process; return when it arrives, 0: never."""
        return 0 if self.stream is None else self.stream.carry_in(data)

    def close(self, *, is_reset: bool = False) -> None:
        """End the connection: in order, or by a reset."""
        stream, self.stream = self.stream, None
        if stream is not None:
            stream.end_by_peer(is_reset=is_reset)


class Stream(Descriptor):
    """The end of a connection in the process."""

    def __init__(self, network: "Network", local: Address, remote: Address) -> None:
        super().__init__(network.machine)
        self._network = network
        self.local, self.remote = local, remote
        self.peer: Peer | None = None
        self._received = bytearray()
        self._is_end = False
        self.error = 0
        self.stalled_until_ns = 0
        self._in_ns = self._out_ns = 0
        """When the newest bytes of each direction arrive."""

    def connected(self, peer: Peer) -> None:
        """It is connected with this peer."""
        self.peer, peer.stream = peer, self
        self._network.streams.append(self)
        self._show()

    def read(self, size: int) -> bytes:
        """As read(2)."""
        if self._received:
            data = bytes(self._received[:size])
            del self._received[:size]
            self._show()
            return data
        if self.error:
            raise OSError(self.error, os.strerror(self.error))
        if self._is_end:
            return b""
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    def write(self, data: bytes) -> int:
        """As write(2): the system takes everything."""
        if self.error:
            raise OSError(self.error, os.strerror(self.error))
        peer = self.peer
        if peer is not None:
            self._network.tell("tcp out", self.remote, data)
            self._out_ns = self._arrival(self._out_ns)
            self.machine.at(self._out_ns, self._deliver, peer, data)
        return len(data)

    def carry_in(self, data: bytes) -> int:
        """Bytes of the peer are on their way to the process, now and then in two pieces; return when."""
        network = self._network
        pieces = [data]
        if len(data) > 1 and network.rng.random() < network.splits:
            cut = network.rng.randrange(1, len(data))
            pieces = [data[:cut], data[cut:]]
        for piece in pieces:
            self._in_ns = self._arrival(self._in_ns)
            self.machine.at(self._in_ns, self._arrive, piece)
        return self._in_ns

    def end_by_peer(self, *, is_reset: bool) -> None:
        """The peer has ended it: the process learns it behind all bytes, or at once."""
        self.peer = None
        self._in_ns = self._arrival(self._in_ns)
        self.machine.at(self._in_ns, self._end, errno.ECONNRESET if is_reset else 0)

    def stall(self, ns: int) -> None:
        """Let nothing arrive for a while; if it is too long the connection breaks."""
        self.stalled_until_ns = max(self.stalled_until_ns, self.machine.now_ns + ns)
        if ns >= GIVEN_UP_NS:
            self.machine.after(GIVEN_UP_NS, self._break)

    def close(self) -> None:
        """As close(2)."""
        super().close()
        if self in self._network.streams:
            self._network.streams.remove(self)
        peer, self.peer = self.peer, None
        if peer is not None:
            self._out_ns = self._arrival(self._out_ns)
            self.machine.at(self._out_ns, self._closed, peer)

    def _closed(self, peer: Peer) -> None:
        if peer.stream is self:
            peer.stream = None
            peer.closed()

    def _deliver(self, peer: Peer, data: bytes) -> None:
        if peer.stream is self:
            peer.received(data)

    def _arrive(self, data: bytes) -> None:
        if self.number in self.machine.descriptors and not self.error:
            self._received += data
            self._show()

    def _end(self, error: int) -> None:
        self._is_end, self.error = True, error
        if error:
            self._received.clear()
        self._show()

    def _break(self) -> None:
        peer = self.peer
        if self.stalled_until_ns > self.machine.now_ns and peer is not None:
            self.peer = None
            self._end(errno.ETIMEDOUT)
            peer.stream = None
            peer.closed()

    def _show(self) -> None:
        if self.machine.descriptors.get(self.number) is not self:
            return
        events = select.EPOLLOUT
        if self._received or self._is_end:
            events |= select.EPOLLIN
        if self._is_end:
            events |= select.EPOLLRDHUP
        if self.error:
            events |= select.EPOLLERR | select.EPOLLHUP
        self.show(events)

    def _arrival(self, before_ns: int) -> int:
        rng = self._network.rng
        soonest_ns = max(self.machine.now_ns, self.stalled_until_ns)
        return max(soonest_ns + rng.randrange(LEAST_NS, MOST_NS), before_ns + 1)


class Listening(Descriptor):
    """A listening socket of the process."""

    def __init__(self, network: "Network", address: Address) -> None:
        super().__init__(network.machine)
        self.address = address
        self.waiting: deque[Stream] = deque()

    def close(self) -> None:
        """As close(2): connections that wait are reset."""
        super().close()
        for stream in self.waiting:
            stream.close()
        self.waiting.clear()


class Network:
    """Who listens where, and what happens between.

    ``tell`` gets each write of the process: what it is, to whom, its bytes.
    """

    def __init__(
        self, machine: Machine, rng: random.Random, tell: Callable[[str, Address, bytes], None]
    ) -> None:
        self.machine, self.rng, self.tell = machine, rng, tell
        self.splits = 0.0
        """Share of what is sent to the process that arrives in two pieces."""
        self.listening: dict[int, Listening] = {}
        self.servers: dict[Address, Callable[[], Peer | None]] = {}
        """Makes the peer for each connection of the process; None: it is refused."""
        self.streams: list[Stream] = []
        self._port = _FIRST_PORT

    def connect(self, peer: Peer, host: str, port: int) -> None:
        """Connect a peer of this host to a port of the process."""
        self.machine.after(self.rng.randrange(LEAST_NS, MOST_NS), self._connect, peer, host, port)

    def own_port(self) -> int:
        """Return a free port."""
        self._port = self._port + 1 if self._port < 60_000 else _FIRST_PORT
        return self._port

    def _connect(self, peer: Peer, host: str, port: int) -> None:
        listening = self.listening.get(port)
        if listening is None or listening.number not in self.machine.descriptors:
            peer.closed()
            return
        stream = Stream(self, (HOST, port), (host, self.own_port()))
        stream.connected(peer)
        listening.waiting.append(stream)
        listening.show(select.EPOLLIN)
        peer.opened()


class Socket:
    """A socket of the process, as asyncio and the gateway use it."""

    family = socket.AF_INET
    type = socket.SOCK_STREAM
    proto = socket.IPPROTO_TCP

    def __init__(self, network: Network, of: Stream | Listening) -> None:
        self._network = network
        self._of = of
        self._is_closed = False

    def fileno(self) -> int:
        """See ``socket``."""
        return -1 if self._is_closed else self._of.number

    def setblocking(self, flag: bool) -> None:
        """It never blocks."""

    def gettimeout(self) -> float:
        """It never blocks."""
        return 0.0

    def getsockname(self) -> Address:
        """See ``socket``."""
        return self._of.address if isinstance(self._of, Listening) else self._of.local

    def getpeername(self) -> Address:
        """See ``socket``."""
        if not isinstance(self._of, Stream) or self._of.error or (self._of.peer is None and self._is_closed):
            raise OSError(errno.ENOTCONN, os.strerror(errno.ENOTCONN))
        return self._of.remote

    def setsockopt(self, *_: object) -> None:
        """Options change nothing here."""

    def getsockopt(self, level: int, option: int, size: int = 0) -> int | bytes:
        """Return the error of a connection; of everything else zeros."""
        if level == socket.SOL_SOCKET and option == socket.SO_ERROR and isinstance(self._of, Stream):
            return self._of.error
        if level == socket.IPPROTO_TCP and option == socket.TCP_INFO and isinstance(self._of, Listening):
            return bytes(24) + len(self._of.waiting).to_bytes(4, "little") + bytes(max(0, size - 28))
        return bytes(size) if size else 0

    def connect(self, address: Address) -> None:
        """Begin to connect; it can be written when that has ended."""
        stream, network = self._of, self._network
        assert isinstance(stream, Stream)
        stream.remote = address
        network.machine.after(network.rng.randrange(LEAST_NS, MOST_NS), self._connected, stream)
        raise BlockingIOError(errno.EINPROGRESS, os.strerror(errno.EINPROGRESS))

    def _connected(self, stream: Stream) -> None:
        if self._is_closed or self._network.machine.descriptors.get(stream.number) is not stream:
            return
        server = self._network.servers.get(stream.remote)
        peer = None if server is None else server()
        if peer is None:
            stream.error = errno.ECONNREFUSED
            stream.show(select.EPOLLOUT | select.EPOLLERR | select.EPOLLHUP)
            return
        stream.connected(peer)
        peer.opened()

    def listen(self, _backlog: int) -> None:
        """Accept connections from now on."""
        assert isinstance(self._of, Listening)
        self._network.listening[self._of.address[1]] = self._of

    def accept(self) -> "tuple[Socket, Address]":
        """See ``socket``."""
        listening = self._of
        assert isinstance(listening, Listening)
        while listening.waiting:
            stream = listening.waiting.popleft()
            listening.show(select.EPOLLIN if listening.waiting else 0)
            if stream.number in self._network.machine.descriptors:
                return Socket(self._network, stream), stream.remote
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    def dup(self) -> "Socket":
        """Return the same once more: the first one is closed afterwards, without effect."""
        same = Socket(self._network, self._of)
        self._is_closed = True
        return same

    def recv(self, size: int) -> bytes:
        """See ``socket``."""
        return self._of.read(size)

    def recv_into(self, buffer: Any) -> int:
        """See ``socket``."""
        data = self._of.read(len(buffer))
        buffer[: len(data)] = data
        return len(data)

    def send(self, data: bytes) -> int:
        """See ``socket``."""
        return self._of.write(bytes(data))

    def shutdown(self, _how: int) -> None:
        """The peer learns of the end when it is closed."""

    def close(self) -> None:
        """See ``socket``."""
        if not self._is_closed:
            self._is_closed = True
            if self._network.machine.descriptors.get(self._of.number) is self._of:
                self._of.close()
