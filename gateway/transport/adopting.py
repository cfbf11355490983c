"""Taking over sockets and ports that stayed open while no gateway ran.

Everything received meanwhile is discarded: a command that waited for the start of the gateway may no longer
be what its controller wants (W5).
"""

import asyncio
import contextlib
import errno
import fcntl
import os
import socket
import stat
import struct
import termios
from pathlib import Path
from typing import Any, Final

import serial

from gateway.transport.endpoints import TcpEndpoint

MOST_WAITING: Final = 4096
"""The largest queue of connections that Linux allows by default (net.core.somaxconn). Any further connection
came while the queue was being emptied."""
_CLOSE_AT_ONCE: Final = struct.pack("ii", 1, 0)
"""``struct linger`` of socket(7): a reset tells the other end that nothing was accepted."""


async def adopted_listeners(
    descriptors: list[int], endpoint: TcpEndpoint
) -> tuple[list[socket.socket], list[str]]:
    """Return the listeners among ``descriptors``, emptied, and the addresses of the rejected clients.

    The result is all of them or none. Listeners of another endpoint, or not of all its addresses, are closed.

    Raises:
        OSError: the waiting clients cannot be rejected.
    """
    sockets = [each for each in map(_listener, descriptors) if each is not None]
    if not sockets:
        return [], []
    if len(sockets) != len(descriptors) or not await _is_at(sockets, endpoint):
        for each in sockets:
            release(each.detach())
        return [], []
    return sockets, [peer for each in sockets for peer in _rejected(each)]


def adopted_port(descriptors: list[int], device: str) -> int | None:
    """Return the one descriptor that is the port which ``device`` names now, emptied; close the others."""
    found: int | None = None
    for descriptor in descriptors:
        if found is None and _is_port(descriptor, device):
            found = descriptor
        else:
            release(descriptor)
    return found


def release(descriptor: int) -> None:
    """Close a descriptor and release its locks: other copies of it do not prevent a new opening."""
    with contextlib.suppress(OSError):
        if stat.S_ISSOCK(os.fstat(descriptor).st_mode):
            with socket.socket(fileno=os.dup(descriptor)) as same:
                same.shutdown(socket.SHUT_RDWR)  # stops listening, also for other owners
        else:
            fcntl.ioctl(descriptor, termios.TIOCNXCL)
            fcntl.flock(descriptor, fcntl.LOCK_UN)
    os.close(descriptor)


class KeptSerial(serial.Serial):
    """A port that is already open, configured again."""

    def __init__(self, descriptor: int, **settings: Any) -> None:
        self._kept = descriptor
        super().__init__(**settings)

    def open(self) -> None:
        """Apply the settings, but leave the modem lines as they are."""
        self.fd = self._kept
        try:
            os.set_blocking(self.fd, False)
            self._reconfigure_port(force_update=True)  # type: ignore[attr-defined]
            termios.tcflush(self.fd, termios.TCIOFLUSH)
        except BaseException:  # after any error the descriptor may not stay open
            self.close()
            raise
        self.is_open = True

    def close(self) -> None:
        """Close the descriptor; twice is harmless."""
        if self.fd is not None:
            os.close(self.fd)
        self.fd = None
        self.is_open = False


def _listener(descriptor: int) -> socket.socket | None:
    try:
        found = socket.socket(fileno=descriptor)
        if found.type == socket.SOCK_STREAM and found.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
            found.setblocking(False)
            return found
        release(found.detach())
    except OSError:
        release(descriptor)
    return None


async def _is_at(sockets: list[socket.socket], endpoint: TcpEndpoint) -> bool:
    """Whether they listen at the present addresses of the endpoint: those of a host name may have changed."""
    try:
        expected = await asyncio.get_running_loop().getaddrinfo(
            endpoint.host or None, endpoint.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
    except OSError:
        return False
    hosts = {address[4][0] for address in expected}
    names = [each.getsockname() for each in sockets]
    return {name[0] for name in names} == hosts and all(endpoint.port in (0, name[1]) for name in names)


def _rejected(listener: socket.socket) -> list[str]:
    """Close the waiting connections; return their addresses."""
    peers: list[str] = []
    while len(peers) < MOST_WAITING:
        try:
            waiting, peer = listener.accept()
        except BlockingIOError:
            break
        except OSError as error:
            if error.errno == errno.ECONNABORTED:  # the client has closed it
                continue
            raise
        with waiting:
            waiting.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _CLOSE_AT_ONCE)
        peers.append(str(peer[0]))
    return peers


def _is_port(descriptor: int, device: str) -> bool:
    """Whether it is still the device of that path: an adapter that was unplugged may be another device."""
    try:
        kept, named = os.fstat(descriptor), Path(device).stat()
        termios.tcgetattr(descriptor)  # fails if the adapter is gone
    except (OSError, termios.error):
        return False
    return (kept.st_rdev, kept.st_ino, kept.st_dev) == (named.st_rdev, named.st_ino, named.st_dev)
