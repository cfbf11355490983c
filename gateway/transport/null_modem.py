"""Two pseudo terminals joined by a cable, for trials and tests without hardware.

It has no baud rate: bytes arrive as fast as the loop runs. Both programs open their end like a serial port.
"""

import asyncio
import os
import tty
from typing import Final

CHUNK_BYTES: Final = 4096


class NullModem:
    """A cable; ``near`` and ``far`` are the devices at its ends. Close it when done."""

    def __init__(self) -> None:
        self._ends = (_End(), _End())
        self._ends[0].pass_to(self._ends[1])
        self._ends[1].pass_to(self._ends[0])
        self.near, self.far = self._ends[0].device, self._ends[1].device

    def close(self) -> None:
        """Unplug the cable: both devices vanish; programs that use them get a hang-up. Twice is harmless."""
        for end in self._ends:
            end.close()


class _End:
    """One pseudo terminal. The cable keeps it open, so that a program may come and go without a hang-up."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        self._other: _End | None = None
        self._unsent = b""

    def pass_to(self, other: "_End") -> None:
        self._other = other
        self._loop.add_reader(self._master, self._readable)

    def close(self) -> None:
        if self._master < 0:
            return
        self._loop.remove_reader(self._master)
        self._loop.remove_writer(self._master)
        os.close(self._slave)
        os.close(self._master)
        self._master = -1

    def _readable(self) -> None:
        assert self._other is not None
        if not self._other.take(os.read(self._master, CHUNK_BYTES), self):
            self._loop.remove_reader(self._master)  # until the other side has room again

    def take(self, data: bytes, source: "_End") -> bool:
        """Pass bytes to the program at this end; False if some must wait."""
        sent = _write_some(self._master, data)
        if sent == len(data):
            return True
        self._unsent = data[sent:]
        self._loop.add_writer(self._master, self._writable, source)
        return False

    def _writable(self, source: "_End") -> None:
        self._unsent = self._unsent[_write_some(self._master, self._unsent) :]
        if not self._unsent:
            self._loop.remove_writer(self._master)
            source.pass_to(self)


def _write_some(handle: int, data: bytes) -> int:
    try:
        return os.write(handle, data)
    except BlockingIOError:
        return 0
