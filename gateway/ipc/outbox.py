"""Writing to a connection without waiting: bytes that it does not take yet are kept."""

import asyncio
import socket
from collections.abc import Callable


class Outbox:
    """Writes what the system takes, keeps the rest, and calls ``on_empty`` when that is sent too."""

    def __init__(
        self, connection: socket.socket, on_empty: Callable[[], None], on_lost: Callable[[], None]
    ) -> None:
        self._connection = connection
        self._on_empty = on_empty
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        self._rest = bytearray()

    @property
    def waiting_bytes(self) -> int:
        """Bytes that the other side has not taken yet."""
        return len(self._rest)

    def write(self, data: bytes) -> None:
        """Send, after the bytes that wait already."""
        if self._rest:
            self._rest += data
            return
        sent = self._send(data)
        if sent is not None and sent < len(data):
            self._rest += data[sent:]
            self._loop.add_writer(self._connection.fileno(), self._writable)

    def close(self) -> None:
        """Send nothing any more."""
        if self._rest:
            self._rest.clear()
            self._loop.remove_writer(self._connection.fileno())

    def _writable(self) -> None:
        sent = self._send(self._rest)
        if sent is None:
            return
        del self._rest[:sent]
        if not self._rest:
            self._loop.remove_writer(self._connection.fileno())
            self._on_empty()

    def _send(self, data: bytes | bytearray) -> int | None:
        """Return how many bytes were sent; None if the connection is lost, after ``on_lost`` was called."""
        try:
            return self._connection.send(data)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError:
            self._on_lost()
            return None
