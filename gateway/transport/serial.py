"""Serial ports: pyserial opens and configures them, then the loop reads and writes the descriptor.

The adapter switches the RS-485 direction, or with ``rs485`` the kernel's driver does. A program would switch
RTS too late, by whole characters.
"""

import asyncio
import errno
import fcntl
import os
import termios
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import serial

from gateway.catalogue import starts
from gateway.status.line import LatencySettings
from gateway.transport.adopting import KeptSerial
from gateway.transport.channel import Receiver
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.errors import AbsentError, RefusedError, TransportError
from gateway.transport.low_latency import flag_note, set_rs485, tune
from gateway.transport.permissions import no_device
from gateway.transport.reconnector import Reconnector
from gateway.transport.serial_channel import PTY_MAJORS, SerialChannel, is_pty

NO_RS485: Final = (
    "the driver of {} has no RS-485 mode: remove rs485 if the adapter switches automatically, as most USB "
    "adapters do; otherwise use a port with an RS-485 driver (a UART of the board)"
)
_IFLAG, _CC = 0, 6
"""Indices in the list of ``termios.tcgetattr``."""


class SerialPort:
    """Keeps the port of ``endpoint`` open; an adapter may be unplugged and come back.

    The configured path is resolved again each time: a link under ``/dev/serial/by-id`` finds its adapter
    under any new number.
    """

    def __init__(
        self,
        endpoint: SerialEndpoint,
        receiver: Receiver,
        on_failure: Callable[[str], None],
        on_slow: Callable[[str], None] | None = None,
    ) -> None:
        self._endpoint = endpoint
        self._receiver = receiver
        self._reconnector = Reconnector(self._attempt, self._was_heard, on_failure)
        self._on_slow = on_slow
        self._slow: tuple[str, ...] = ()
        self._settings = LatencySettings()
        self._channel: SerialChannel | None = None
        self.notes: tuple[str, ...] = ()
        """Requested settings that the port does not have."""
        self.kept: int | None = None
        """A descriptor of the port that is already open: the first opening takes it."""
        self.on_open: Callable[[int], None] = _ignore_descriptor
        """Gets the descriptor of each opening, before the first byte."""
        self.on_lost: Callable[[], None] = _drop_nothing
        """Called when the port was lost; not when it is closed."""

    @property
    def latency(self) -> LatencySettings:
        """The driver settings that delay bytes, as read back at the last opening."""
        return self._settings

    @property
    def is_open(self) -> bool:
        """Whether the port is open now."""
        return self._channel is not None and not self._channel.lost.done()

    @property
    def is_kept_up(self) -> bool:
        """Whether it is still kept open: only a bug of ours ends that."""
        return self._reconnector.is_running

    @property
    def failure(self) -> str:
        """Why the last attempt to open the port failed; empty while it is open."""
        return self._reconnector.failure

    @property
    def opens(self) -> int:
        """How often the port was opened."""
        return self._reconnector.opens

    async def open(self) -> None:
        """Open the port; if it is absent, open it as soon as it appears.

        Raises:
            RefusedError: in use, no permission, not a serial port. Later these are only retried.
        """
        lost: asyncio.Future[None] | None = None
        try:
            lost = self._open()
        except AbsentError as error:
            self._reconnector.failed(error.detail)
        self._reconnector.start(lost)

    async def close(self) -> None:
        """Close, and stop retrying."""
        await self._reconnector.stop()
        self.on_lost = _drop_nothing
        if self._channel is not None:
            await self._channel.drained()
            self._channel.close()

    def _was_heard(self) -> bool:
        return self._channel is not None and self._channel.bytes_received > 0

    async def _attempt(self) -> "asyncio.Future[None]":
        return self._open()

    def _open(self) -> "asyncio.Future[None]":
        self._channel = None
        kept, self.kept = self.kept, None
        port, opened = open_port(self._endpoint, kept)
        self.notes, self._settings = (*opened.notes, *opened.slow), opened.settings
        self._report_slow(opened.slow)
        self._channel = SerialChannel(port, self._endpoint, self._receiver)
        self.on_open(port.fileno())
        self._channel.lost.add_done_callback(lambda _: self.on_lost())
        self._channel.begin()
        return self._channel.lost

    def _report_slow(self, slow: tuple[str, ...]) -> None:
        """Report what delays bytes; not again when an adapter comes back with the same settings."""
        is_news, self._slow = slow != self._slow, slow
        if slow and is_news and self._on_slow is not None:
            self._on_slow("; ".join(slow))


@dataclass(frozen=True, slots=True)
class Opened:
    """The properties of a port, found when it was opened."""

    notes: tuple[str, ...]
    """Requested settings that it does not have."""
    settings: LatencySettings
    slow: tuple[str, ...] = ()
    """What delays bytes in it, with remedies."""


def open_port(endpoint: SerialEndpoint, kept: int | None = None) -> tuple[serial.Serial, Opened]:
    """Open and configure a port: raw, exclusive, non-blocking, low latency if possible and requested.

    ``kept`` is a descriptor of the port that is already open: it is configured again and emptied. Returns the
    port and its properties.

    Raises:
        AbsentError: no such device now.
        RefusedError: in use, no permission, not a serial port, an impossible format.
    """
    notes: list[str] = []
    try:
        port = _configured(endpoint, notes, kept)
    except (OSError, termios.error, ValueError) as error:
        raise why_not_opened(endpoint, error) from error
    try:
        return port, _finish(port.fileno(), endpoint, notes)
    except RefusedError:
        port.close()
        raise
    except (OSError, termios.error) as error:
        port.close()
        raise why_not_opened(endpoint, error) from error


def _configured(endpoint: SerialEndpoint, notes: list[str], kept: int | None) -> serial.Serial:
    bits, parity = endpoint.data_bits, endpoint.parity
    if (parity != "N" or bits != serial.EIGHTBITS) and _is_pty_path(endpoint.device):
        # The kernel drops both on pseudo terminals, and glibc's tcsetattr then fails with EINVAL.
        notes.append("a pseudo terminal has no parity: runs as 8N")
        bits, parity = serial.EIGHTBITS, serial.PARITY_NONE
    make = serial.Serial if kept is None else partial(KeptSerial, kept)
    return make(
        port=endpoint.device,
        baudrate=endpoint.baudrate,
        bytesize=bits,
        parity=parity,
        stopbits=endpoint.stop_bits,
        exclusive=True,
    )


def _finish(handle: int, endpoint: SerialEndpoint, notes: list[str]) -> Opened:
    attributes = termios.tcgetattr(handle)
    attributes[_IFLAG] &= ~termios.BRKINT  # a break must not flush the bytes received before it
    # pyserial sets VMIN 0; then "no data" and "unplugged" read alike.
    attributes[_CC][termios.VMIN] = 1
    attributes[_CC][termios.VTIME] = 0
    termios.tcsetattr(handle, termios.TCSANOW, attributes)
    if endpoint.rs485:
        in_force = set_rs485(handle, hears_itself=endpoint.echo)
        if in_force is None or not in_force.enabled:
            raise RefusedError(NO_RS485.format(endpoint))
    if is_pty(handle):
        return Opened((*notes, "a pseudo terminal has no low-latency mode"), LatencySettings())
    fcntl.ioctl(handle, termios.TIOCEXCL)  # pyserial's lock is advisory only
    settings, slow = tune(handle, is_low=endpoint.low_latency)
    if endpoint.low_latency and (note := flag_note(settings)):
        notes.append(note)
    return Opened(tuple(notes), settings, slow)


def _ignore_descriptor(_descriptor: int) -> None:
    pass


def _drop_nothing() -> None:
    pass


def _is_pty_path(path: str) -> bool:
    try:
        return os.major(os.stat(path).st_rdev) in PTY_MAJORS  # noqa: PTH116 - follows the link, as open does
    except OSError:
        return False


def why_not_opened(endpoint: SerialEndpoint, error: Exception) -> TransportError:
    """Return the error, with the remedy, for a system error of opening or configuring a port."""
    number = error.errno if isinstance(error, OSError) else None
    device = endpoint.device
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.EIO):
        return AbsentError(
            f"{starts.ABSENT.begin(device=device)}; check that the adapter is plugged in (ls -l "
            "/dev/serial/by-id)"
        )
    if number in (errno.EACCES, errno.EPERM):
        return RefusedError("; ".join(no_device(endpoint)))
    if number in (errno.EAGAIN, errno.EBUSY):
        return RefusedError(
            f"{starts.IN_USE.begin(place=device)}; stop it (fuser -v {device} names it), "
            "a line belongs to one program only"
        )
    text = str(error)
    if (
        number == errno.ENOTDIR
        or "Could not configure port" in text
        or number in (errno.EISDIR, errno.ENOTTY)
    ):
        return RefusedError(starts.NO_SERIAL_PORT.begin(device=device))
    shape = f"{endpoint.baudrate} Bd, {endpoint.data_bits}{endpoint.parity}{endpoint.stop_bits}"
    return RefusedError(f"{starts.CANNOT_BE_SET.begin(device=device, shape=shape)}: {text}")
