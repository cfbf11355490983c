"""Serial ports of the process, and the wires behind them: each character takes its time.

``open_port`` takes the place of that of ``gateway.transport.devices``: pyserial, termios and the settings of
drivers are not simulated.
"""

import errno
import os
import random
import select
from collections.abc import Callable
from typing import Any, Final

from gateway.status.line import LatencySettings
from gateway.transport.endpoints import SerialEndpoint
from tests.year import real_devices
from tests.year.machine import MS, Descriptor, Machine, S

ADAPTER_NS: Final = MS
"""A USB adapter hands bytes over within this time after their last character."""
PAUSE_NS: Final = 750_000
"""The longest pause between two characters of a frame above 19200 Bd (Modbus over serial line, 2.5.1.1)."""
SILENCE_NS: Final = 1_750_000
"""The silence behind a frame there."""


class Port(Descriptor):
    """One opening of a serial port, as the process has it; also what pyserial returns."""

    def __init__(self, wire: "Wire") -> None:
        super().__init__(wire.machine)
        self._wire = wire
        self._received = bytearray()
        self._is_gone = False

    def fileno(self) -> int:
        """See ``serial.Serial``."""
        return self.number

    def read(self, size: int) -> bytes:
        """As read(2) of a terminal."""
        if self._received:
            data = bytes(self._received[:size])
            del self._received[:size]
            if not self._received and not self._is_gone:
                self.show(select.EPOLLOUT)
            return data
        if self._is_gone:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    def write(self, data: bytes) -> int:
        """As write(2) of a terminal: the driver takes everything."""
        if self._is_gone:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        self._wire.leave(data)
        return len(data)

    def close(self) -> None:
        """As close(2): bytes that were not read are lost."""
        super().close()
        if self._wire.port is self:
            self._wire.port = None

    def arrive(self, data: bytes) -> None:
        """Take bytes of the wire."""
        if not self._is_gone:
            self._received += data
            self.show(select.EPOLLIN | select.EPOLLOUT)

    def vanish(self) -> None:
        """The adapter was unplugged."""
        self._is_gone = True
        self._received.clear()
        self.show(select.EPOLLIN | select.EPOLLHUP | select.EPOLLERR)


class Wire:
    """A serial wire: at one end an adapter with this device name, at the other a device of the world.

    ``heard`` gets what the process has sent, when its last character has ended. ``tell`` gets it when the
    process writes it.

    ``is_fine``: a port of the machine itself. The process gets each character as it comes, and a frame may
    leave in pieces. ``heard`` and ``tell`` get it when the silence behind it has passed.
    """

    def __init__(
        self,
        machine: Machine,
        endpoint: SerialEndpoint,
        rng: random.Random,
        tell: Callable[[str, bytes], None],
    ) -> None:
        self.machine, self.endpoint, self._rng, self._tell = machine, endpoint, rng, tell
        self.heard: Callable[[bytes], None] = _ignore
        self.port: Port | None = None
        self.is_plugged = True
        self.splits = 0.0
        self.is_fine = False
        self._frame = b""
        """What has left since the last silence."""
        self.began_ns = 0
        """When the first of it left."""
        self._left_ns = 0
        """When the last of it has."""
        self._character_ns = endpoint.bits_per_character * S // endpoint.baudrate
        self._free_ns = 0
        _WIRES[endpoint.device] = self

    def leave(self, data: bytes) -> None:
        """The process sends."""
        if self.is_fine:
            if self.machine.now_ns > self._left_ns + PAUSE_NS:
                self._end_frame()  # what comes after a longer pause belongs to no frame before
            if not self._frame:
                self.began_ns = self.machine.now_ns
            self._frame += data
            self._left_ns = self._end(len(data))
            self.machine.at(self._left_ns + SILENCE_NS, self._fall_silent)
            return
        self.began_ns = self.machine.now_ns
        self._tell(self.endpoint.device, data)
        self.machine.at(self._end(len(data)), self._hear, data)

    def send(self, data: bytes) -> int:
        """The device sends; return when it has arrived."""
        self._tell(f"from {self.endpoint.device}", data)
        if self.is_fine:
            return self._send_characters(data)
        pieces, end_ns = [data], self._end(len(data))
        if len(data) > 1 and self._rng.random() < self.splits:
            cut = self._rng.randrange(1, len(data))
            pieces = [data[:cut], data[cut:]]
        for number, piece in enumerate(pieces):
            after_ns = (
                self._rng.randrange(ADAPTER_NS // 10, ADAPTER_NS) if number == 0 else self._character_ns
            )
            end_ns += after_ns
            self.machine.at(end_ns, self._arrive, piece)
        return end_ns

    def _send_characters(self, data: bytes) -> int:
        """Send one character after the other."""
        end_ns = 0
        for character in data:
            end_ns = self._end(1)
            self.machine.at(end_ns, self._arrive, bytes((character,)))
        return end_ns

    def _fall_silent(self) -> None:
        if self.machine.now_ns >= self._left_ns + SILENCE_NS:
            self._end_frame()

    def _end_frame(self) -> None:
        frame, self._frame = self._frame, b""
        if frame:
            self._tell(self.endpoint.device, frame)
            self._hear(frame)

    def plug(self, *, is_plugged: bool) -> None:
        """Unplug the adapter, or plug it in again."""
        self.is_plugged = is_plugged
        if not is_plugged and self.port is not None:
            self.port.vanish()

    def _end(self, characters: int) -> int:
        """Return when the last of so many further characters has ended."""
        self._free_ns = max(self._free_ns, self.machine.now_ns) + characters * self._character_ns
        return self._free_ns

    def _hear(self, data: bytes) -> None:
        if self.is_plugged:
            self.heard(data)

    def _arrive(self, data: bytes) -> None:
        if self.port is not None:
            self.port.arrive(data)


_WIRES: Final[dict[str, Wire]] = {}
"""By the device at the side of the process."""


def exchange(one: Wire, other: Wire) -> None:
    """Their adapters change names: behind the device of one there is the wire of the other from now on."""
    names = {wire: name for name, wire in _WIRES.items()}
    _WIRES[names[one]], _WIRES[names[other]] = other, one


def open_port(endpoint: SerialEndpoint, kept: int | None = None) -> tuple[Any, real_devices.Opened]:
    """See ``gateway.transport.devices``."""
    wire = _WIRES.get(endpoint.device)
    if wire is None or not wire.is_plugged:
        raise real_devices.why_not_opened(endpoint, OSError(errno.ENOENT, os.strerror(errno.ENOENT)))
    if wire.port is not None:
        raise real_devices.why_not_opened(endpoint, OSError(errno.EBUSY, os.strerror(errno.EBUSY)))
    wire.machine.check()
    wire.port = Port(wire)
    wire.port.show(select.EPOLLOUT)
    return wire.port, real_devices.Opened((), LatencySettings())


def _ignore(_data: bytes) -> None:
    pass
