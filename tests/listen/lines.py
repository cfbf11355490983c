"""Simulated lines on pseudo terminals, misread where the ear is set to another baud rate than they have."""

import os
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Final, Self

from gateway.modbus.rtu import encode_rtu
from tests.listen.uart import received

FRAME_PAUSE_S: Final = 0.004
"""Between two frames; on a real line 3.5 characters at least."""
RATES: Final = {
    getattr(termios, f"B{rate}"): rate
    for rate in (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)
}
Frames = Iterator[tuple[int, bytes]]
"""Unit ids and PDUs, requests and replies as they follow each other."""


class SimulatedLine:
    """A line that speaks on and on at one baud rate; an ear opens ``path``. Enter it to start it.

    A pseudo terminal has no baud rate, but its other end sees what the ear has set: what is sent is what a
    UART at that rate would make of it. It has no parity and no errors of frame.
    """

    def __init__(self, baudrate: int, frames: Callable[[], Frames]) -> None:
        self._baudrate = baudrate
        self._frames = frames
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._speak)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._is_over.set()
        self._thread.join()
        os.set_blocking(self._master, False)
        try:
            self.was_sent = os.read(self._master, 1)
        except BlockingIOError:
            self.was_sent = b""
        os.close(self._master)
        os.close(self._slave)

    was_sent = b""
    """What the ear sent: nothing, ever."""

    def _speak(self) -> None:
        while True:
            for unit_id, pdu in self._frames():
                heard_at = RATES.get(termios.tcgetattr(self._master)[5], self._baudrate)
                characters = received(encode_rtu(unit_id, pdu), (self._baudrate, "N"), (heard_at, "N"))
                os.write(self._master, bytes(one.value for one in characters))
                if self._is_over.wait(FRAME_PAUSE_S):
                    return


class Registers:
    """A drive whose axis goes half way at the next look, and arrives at the one after it."""

    def __init__(self, command: int, actual: int, *, is_low_first: bool = False) -> None:
        self.command, self.actual = command, actual
        self._is_low_first = is_low_first
        self._at = 0

    def _words(self, counts: int) -> bytes:
        data = counts.to_bytes(4, "big", signed=True)
        return data[2:] + data[:2] if self._is_low_first else data

    def goes(self, unit_id: int, targets: tuple[int, ...]) -> Frames:
        """Say what passes while it goes to targets one after the other."""
        for target in targets:
            head = b"\x10" + self.command.to_bytes(2, "big") + b"\x00\x02"
            yield unit_id, head + b"\x04" + self._words(target)
            yield unit_id, head
            for counts in ((self._at + target) // 2, target):
                yield unit_id, b"\x03" + self.actual.to_bytes(2, "big") + b"\x00\x02"
                yield unit_id, b"\x03\x04" + self._words(counts)
            self._at = target
