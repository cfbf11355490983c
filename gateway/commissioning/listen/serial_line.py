"""Listening on a serial line: a port opened for reading only, with one setting after the other.

The descriptor cannot be written to. RTS is cleared when the port opens, because an adapter that enables its
transmitter with RTS would block the bus. Characters with a parity or framing error are marked (PARMRK); only
this distinguishes even parity from odd.
"""

import errno
import fcntl
import os
import select
import struct
import termios
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import TracebackType
from typing import Final, NamedTuple, Self

from gateway import system
from gateway.clock import boot_ns
from gateway.commissioning.listen.overhearing import Overheard, Overhearing, Unmarking
from gateway.times import NS_PER_MS, NS_PER_S
from gateway.transport.devices import why_not_opened
from gateway.transport.endpoints import SerialEndpoint

READ_BYTES: Final = 1024
SILENCE_MS: Final = 40
"""After this silence a frame has ended: USB adapters deliver their data every 16 ms."""
DWELL_S: Final = 3.0
"""Time for each setting on a line with little traffic."""
GIVE_UP_BYTES: Final = 96
"""After this many bytes without a complete frame a setting is wrong: usual frames are shorter."""
ENOUGH_FRAMES: Final = 4
GOOD_SHARE: Final = 0.8
"""Of all bytes, in complete frames; with the right setting nearly all are."""
WRONG_SHARE: Final = 0.02
"""Of all characters, with a parity or framing error."""
INPCK_PARMRK: Final = termios.INPCK | termios.PARMRK
PARITY_FLAGS: Final = {"N": 0, "E": termios.PARENB, "O": termios.PARENB | termios.PARODD}
BAUDRATES: Final = (19200, 9600, 115200, 38400, 57600, 4800, 230400, 2400, 460800, 1200, 921600)
"""Those of the known drives, the usual ones first."""
PARITIES: Final = ("E", "N", "O")


class PortSettings(NamedTuple):
    """Settings of a port. Stop bits cannot be detected: a receiver evaluates the first one only."""

    baudrate: int
    parity: str

    def __str__(self) -> str:
        """Return it in the notation of manuals."""
        return f"{self.baudrate} 8{self.parity}"


def settings_to_try(
    baudrate: int | None, parity: str | None, *, has_parity: bool = True
) -> list[PortSettings]:
    """Return the settings to try, the usual ones first; given values are not varied.

    >>> [str(each) for each in settings_to_try(None, None)[:4]]
    ['19200 8E', '19200 8N', '9600 8E', '9600 8N']
    """
    rates = BAUDRATES if baudrate is None else (baudrate,)
    kinds = PARITIES if parity is None else (parity,)
    if not has_parity:
        kinds = ("N",)
    usual = [PortSettings(rate, kind) for rate in rates for kind in kinds if kind != "O" or parity == "O"]
    return usual + [
        each for rate in rates for kind in kinds if (each := PortSettings(rate, kind)) not in usual
    ]


@dataclass(slots=True)
class Trial:
    """The data received with one setting."""

    setting: PortSettings
    line: Overhearing = field(default_factory=Overhearing)
    unmarking: Unmarking = field(default_factory=Unmarking)
    received: int = 0

    def feed(self, data: bytes) -> list[Overheard]:
        """Take received data."""
        characters = self.unmarking.feed(data)
        self.received += len(characters)
        return self.line.feed(characters)

    @property
    def is_right(self) -> bool:
        """Whether this is the setting of the line."""
        line = self.line
        return (
            line.frames >= ENOUGH_FRAMES
            and line.good_bytes >= GOOD_SHARE * (line.good_bytes + line.bad_bytes)
            and self.unmarking.errors <= WRONG_SHARE * self.received
        )

    @property
    def is_hopeless(self) -> bool:
        """Whether more data with this setting would not help."""
        has_wrong = self.unmarking.errors > WRONG_SHARE * self.received
        return self.received >= GIVE_UP_BYTES and (self.line.frames == 0 or has_wrong)


class Sniffer:
    """A port that is only read; entering it opens it.

    Raises AbsentError and RefusedError on opening: does not exist, in use, no permission, not a serial port.
    """

    def __init__(self, device: str) -> None:
        self.device = device
        self.is_pty = False
        """A pseudo terminal has no parity."""
        self._fd = -1

    def __enter__(self) -> Self:
        """Open it, for reading only."""
        try:
            self._fd = os.open(self.device, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                self._claim()
            except (OSError, termios.error):
                os.close(self._fd)
                raise
        except (OSError, termios.error) as error:
            raise why_not_opened(SerialEndpoint(self.device), error) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        os.close(self._fd)

    def _claim(self) -> None:
        if not os.isatty(self._fd):
            raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
        self.is_pty = system.is_pty(self._fd)
        # Two programs that read one port each get a part of its bytes.
        fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not self.is_pty:
            fcntl.ioctl(self._fd, termios.TIOCMBIC, struct.pack("I", termios.TIOCM_RTS))

    def set(self, setting: PortSettings) -> None:
        """Set the port; earlier data are discarded.

        Raises:
            OSError, termios.error: the port does not accept the setting.
        """
        speed = getattr(termios, f"B{setting.baudrate}")
        control = termios.CS8 | termios.CREAD | termios.CLOCAL | PARITY_FLAGS[setting.parity]
        characters: list[bytes | int] = list(termios.tcgetattr(self._fd)[6])
        characters[termios.VMIN], characters[termios.VTIME] = 1, 0
        attributes = [INPCK_PARMRK, 0, control, 0, speed, speed, characters]
        termios.tcsetattr(self._fd, termios.TCSANOW, attributes)
        termios.tcflush(self._fd, termios.TCIFLUSH)

    def read(self, timeout_ms: float) -> bytes:
        """Return the data received within a time, b"" for none.

        Raises:
            OSError: the port was removed.
        """
        poll = select.poll()
        poll.register(self._fd, select.POLLIN)
        if not poll.poll(timeout_ms):
            return b""
        try:
            data = os.read(self._fd, READ_BYTES)
        except BlockingIOError:
            return b""
        if not data:
            raise OSError("unplugged")
        return data


def find_setting(
    sniffer: Sniffer, settings: list[PortSettings], until_ns: int, report: Callable[[str], None]
) -> tuple[Trial | None, list[Overheard]]:
    """Try one setting after the other, repeatedly, until one is right or the time is over.

    Return the right one with its frames; else the one with most complete frames, if any had one. ``report``
    gets a sentence for each tried setting.
    """
    best: Trial | None = None
    heard_best: list[Overheard] = []
    while boot_ns() < until_ns:
        for setting in settings:
            sniffer.set(setting)
            trial = Trial(setting)
            heard = [*_listen(sniffer, trial, min(until_ns, boot_ns() + int(DWELL_S * NS_PER_S)))]
            if trial.is_right:
                return trial, heard
            wrong = trial.unmarking.errors
            report(
                f"{setting}: {trial.received} bytes, {trial.line.frames} whole frames"
                + (f", {wrong} characters with a wrong parity or frame" if wrong else "")
            )
            if trial.line.frames > (best.line.frames if best else 0):
                best, heard_best = trial, heard
            if boot_ns() >= until_ns:
                break
    return best, heard_best


def _listen(sniffer: Sniffer, trial: Trial, until_ns: int) -> Iterator[Overheard]:
    while not (trial.is_right or trial.is_hopeless) and boot_ns() < until_ns:
        data = sniffer.read(min(SILENCE_MS, max(0.0, (until_ns - boot_ns()) / NS_PER_MS)))
        yield from trial.feed(data) if data else trial.line.silent()
