"""One opening of a serial port: its bytes, in one system call each; see ``transport.serial``."""

import asyncio
import contextlib
import errno
import fcntl
import io
import termios
from typing import Final

from gateway import system
from gateway.clock import boot_ns
from gateway.times import NS_PER_S
from gateway.transport.channel import Channel, Receiver
from gateway.transport.endpoints import SerialEndpoint

_read: Final = system.read
_write: Final = system.write
RECEIVE_BYTES: Final = 1024
"""Four of the largest RTU frames (256 bytes)."""
DRAIN_TIMEOUT_S: Final = 1.0


class SerialChannel(Channel):
    """One opening of a serial port; passes what it reads to ``receiver``."""

    def __init__(self, port: io.RawIOBase, endpoint: SerialEndpoint, receiver: Receiver) -> None:
        self._port = port
        self._fd = port.fileno()
        self._receiver = receiver
        self._received = receiver.received
        self._loop = asyncio.get_running_loop()
        self._unsent = bytearray()
        self._empty: asyncio.Future[None] | None = None
        self._is_over = False
        """It has ended, or is about to."""
        self.peer = endpoint.device
        self.is_pty = system.is_pty(self._fd)
        self.wire_ns_per_byte = 0 if self.is_pty else character_ns(endpoint)
        self.bytes_received = 0
        self.lost: asyncio.Future[None] = self._loop.create_future()

    def begin(self) -> None:
        """Start reading, and call the receiver's ``opened``."""
        self._loop.add_reader(self._fd, self._readable)
        self._receiver.opened(self, boot_ns())

    def write(self, data: bytes) -> None:
        """See ``Channel``."""
        if self._is_over:
            return
        if not len(self._unsent):
            try:
                sent = _write(self._fd, data)
            except BlockingIOError:
                sent = 0
            except OSError as error:
                self._lose(_why_lost(error))
                return
            if sent == len(data):
                return
            data = data[sent:]
            self._loop.add_writer(self._fd, self._writable)
        self._unsent += data

    def has_gone(self, *, asks: bool) -> bool:
        """See ``Channel``: unknown on a wire."""
        return False

    def close(self) -> None:
        """Close immediately. Bytes that the driver has taken are still sent."""
        self._end("closed")

    async def drained(self) -> None:
        """Wait until the driver has taken everything, for ``DRAIN_TIMEOUT_S`` at most."""
        if self._unsent and not self.lost.done():
            self._empty = self._loop.create_future()
            await asyncio.wait(
                [self._empty, self.lost], timeout=DRAIN_TIMEOUT_S, return_when="FIRST_COMPLETED"
            )

    def _readable(self) -> None:
        try:
            data = _read(self._fd, RECEIVE_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(_why_lost(error))
            return
        if not data:  # readable without data: the device has gone
            self._end("unplugged")
            return
        now_ns = boot_ns()
        self.bytes_received += len(data)
        self._received(data, now_ns)

    def _writable(self) -> None:
        try:
            sent = _write(self._fd, bytes(self._unsent))
        except BlockingIOError:
            return
        except OSError as error:
            self._end(_why_lost(error))
            return
        del self._unsent[:sent]
        if not self._unsent:
            self._loop.remove_writer(self._fd)
            if self._empty is not None and not self._empty.done():
                self._empty.set_result(None)

    def _lose(self, reason: str) -> None:
        """End soon: a caller of ``write`` must not get the loss inside its own call."""
        self._is_over = True
        self._loop.call_soon(self._end, reason)

    def _end(self, reason: str) -> None:
        if self.lost.done():
            return
        self._is_over = True
        self._loop.remove_reader(self._fd)
        self._loop.remove_writer(self._fd)
        with contextlib.suppress(OSError, termios.error):
            fcntl.ioctl(self._fd, termios.TIOCNXCL)
        self._port.close()
        self.lost.set_result(None)
        self._receiver.closed(reason, boot_ns())


def character_ns(endpoint: SerialEndpoint) -> int:
    """Return the duration of one character on the wire, in ns.

    >>> character_ns(SerialEndpoint("/dev/ttyS0", 19200, "E"))  # 11 bits
    572916
    """
    return endpoint.bits_per_character * NS_PER_S // endpoint.baudrate


def _why_lost(error: OSError) -> str:
    return "unplugged" if error.errno in (errno.EIO, errno.ENXIO, errno.ENODEV) else str(error)
