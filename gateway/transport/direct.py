"""Bytes of a TCP connection without asyncio's transport: one system call to read and one to write.

That transport still owns the connection: it closes it, and takes the bytes that the system does not take
immediately.
"""

from typing import Final, Protocol

from gateway import system
from gateway.clock import boot_ns
from gateway.transport.channel import Channel, Receiver
from gateway.transport.selector import HUNG_UP, RelaySelector

_read: Final = system.read
_write: Final = system.write
RECEIVE_BYTES: Final = 479
"""More than the largest Modbus/TCP frame (260 bytes), and small enough for the interpreter's own allocator. A
larger buffer would be a malloc and a free for each read."""
MORE_BYTES: Final = 4096 - RECEIVE_BYTES
"""Read immediately after a full read: unread bytes at closing would reset the connection."""


class FarEnd:
    """The other end of a connection, queried by the descriptor of this end."""

    def __init__(self, descriptor: int) -> None:
        self._poll = system.hang_ups(descriptor)

    def has_gone(self) -> bool:
        """Whether it has closed or reset the connection, also if that was not read yet."""
        return bool(self._poll(0))


class Connection(Protocol):
    """The connection whose bytes these are."""

    @property
    def peer(self) -> str:
        """See ``Channel``."""
        ...

    def close(self) -> None:
        """See ``Channel``."""
        ...

    def end(self) -> None:
        """Close it: the other end has closed it in order."""
        ...

    def break_off(self, reason: str) -> None:
        """End it immediately; its receiver gets the reason later."""
        ...

    def leave_over(self, data: bytes) -> None:
        """Take the bytes that the system did not take; they are sent as soon as possible."""
        ...

    def has_left_over(self) -> bool:
        """Whether some of these bytes are not sent yet."""
        ...


class DirectSocket(Channel):
    """A channel over the descriptor of a connection."""

    def __init__(
        self,
        connection: Connection,
        descriptor: int,
        receiver: Receiver,
        selector: RelaySelector,
    ) -> None:
        self.peer = connection.peer
        self.descriptor = descriptor
        self.bytes_received = 0
        self._connection = connection
        self._received = receiver.received
        self._selector = selector
        self._far_end = FarEnd(descriptor)
        self._has_hung_up = False
        """Whether the other end had hung up, by the system's last report that there was something to read."""
        self._may_have_left_over = False
        self._is_over = False

    def readable(self) -> None:
        """Read the available bytes and pass them on; called by its selector."""
        self._has_hung_up = self._selector.events & HUNG_UP != 0
        try:
            data = _read(self.descriptor, RECEIVE_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(str(error))
            return
        now_ns = boot_ns()
        if not data:
            self._is_over = True
            self._connection.end()
            return
        why_broken = ""
        if len(data) == RECEIVE_BYTES:
            try:
                data += _read(self.descriptor, MORE_BYTES)
            except BlockingIOError:
                pass
            except OSError as error:
                why_broken = str(error)
        self.bytes_received += len(data)
        self._received(data, now_ns)
        if why_broken:
            self._end(why_broken)

    def write(self, data: bytes) -> None:
        """See ``Channel``."""
        if self._is_over:
            return
        if self._may_have_left_over:
            self._may_have_left_over = self._connection.has_left_over()
        if not self._may_have_left_over:
            try:
                sent = _write(self.descriptor, data)
            except BlockingIOError:
                sent = 0
            except OSError as error:
                self._end(str(error))
                return
            if sent == len(data):
                return
            data = data[sent:]
            self._may_have_left_over = True
        self._connection.leave_over(data)

    def count_received(self) -> int:
        """See ``Channel``."""
        return self.bytes_received

    def has_gone(self, *, asks: bool) -> bool:
        """See ``Channel``. The report of ``epoll_wait`` may be older than a standstill."""
        return self._is_over or self._has_hung_up or (asks and self._far_end.has_gone())

    def close(self) -> None:
        """See ``Channel``."""
        self._connection.close()

    def over(self) -> None:
        """Neither read nor write any more: the descriptor number may be reused from now on."""
        self._is_over = True

    def _end(self, reason: str) -> None:
        self._is_over = True
        self._connection.break_off(reason)
