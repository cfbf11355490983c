"""The serial devices of this machine: pyserial opens and configures them, and errors get their remedies.

The adapter switches the RS-485 direction, or with ``rs485`` the kernel's driver does. A program would switch
RTS too late, by whole characters.
"""

import errno
import fcntl
import os
import termios
from dataclasses import dataclass
from functools import partial
from typing import Final

import serial

from gateway import system
from gateway.catalogue import starts
from gateway.status.line import LatencySettings
from gateway.transport.adopting import KeptSerial
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.errors import AbsentError, RefusedError, TransportError
from gateway.transport.low_latency import flag_note, set_rs485, tune
from gateway.transport.permissions import no_device

NO_RS485: Final = (
    "the driver of {} has no RS-485 mode: remove rs485 if the adapter switches automatically, as most USB "
    "adapters do; otherwise use a port with an RS-485 driver (a UART of the board)"
)
_IFLAG, _CC = 0, 6
"""Indices in the list of ``termios.tcgetattr``."""


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
    if system.is_pty(handle):
        return Opened((*notes, "a pseudo terminal has no low-latency mode"), LatencySettings())
    fcntl.ioctl(handle, termios.TIOCEXCL)  # pyserial's lock is advisory only
    settings, slow = tune(handle, is_low=endpoint.low_latency)
    if endpoint.low_latency and (note := flag_note(settings)):
        notes.append(note)
    return Opened(tuple(notes), settings, slow)


def _is_pty_path(path: str) -> bool:
    try:
        return os.major(os.stat(path).st_rdev) in system.PTY_MAJORS  # noqa: PTH116 - follows the link, as open does
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
