"""Driver settings of a serial port that delay received bytes: set to the minimum, and read back.

Sources: ``linux/serial.h`` and ``asm-generic/ioctls.h`` (layouts and numbers; the same on x86 and ARM), the
kernel's ``driver-api/serial/serial-rs485.rst`` and ``ABI/testing/sysfs-tty`` (``rx_trig_bytes``), and
``drivers/usb/serial/ftdi_sio.c`` (the low-latency flag makes its latency timer 1 ms).

The settings belong to the port, not to one opening of it. They are not restored on closing: a killed process
could not do it, and the state of a port must not depend on how its last user ended.
"""

import fcntl
import os
import struct
import termios
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gateway.status.line import LatencySettings, Rs485

SYSFS: Final = Path("/sys")
LEAST_MS: Final = 1
"""The shortest latency timer that an FTDI adapter has."""
LEAST_BYTES: Final = 1
"""The lowest trigger of a receive FIFO: an interrupt for each byte."""
ASYNC_LOW_LATENCY: Final = 0x2000
_SERIAL_STRUCT_BYTES: Final = 72
_SERIAL_FLAGS_AT: Final = 16
TIOCGRS485: Final = 0x542E
TIOCSRS485: Final = 0x542F
_RS485: Final = struct.Struct("=8I")
"""``struct serial_rs485``: flags, two delays in ms, and words that are neither read nor changed here."""
_ENABLED, _RTS_ON_SEND, _RTS_AFTER_SEND, _RX_DURING_TX = 0x01, 0x02, 0x04, 0x10


def tune(handle: int, *, is_low: bool = True, sysfs: Path = SYSFS) -> tuple[LatencySettings, tuple[str, ...]]:
    """Set an open port to its lowest latency if ``is_low``, and read the settings back.

    It is no error if the driver or a missing permission does not allow it.

    Returns:
        The settings, and a remark with its remedy for each setting that costs time.
    """
    folder = tty_folder(handle, sysfs)
    timer, trigger = folder / "device" / "latency_timer", folder / "rx_trig_bytes"
    refused: dict[Path, str] = {}
    if is_low:
        # The flag first: any user of the port may set it, and ftdi_sio then shows a timer of 1 ms.
        _set_low_latency_flag(handle)
        for path, least in ((timer, LEAST_MS), (trigger, LEAST_BYTES)):
            why = _lower(path, least)
            if why:
                refused[path] = why
    settings = LatencySettings(
        ftdi_latency_timer_ms=_number_in(timer),
        async_low_latency=_low_latency_flag(handle),
        rx_trig_bytes=_number_in(trigger),
        rs485=_rs485(handle),
    )
    if not is_low:
        return settings, ()
    name = folder.resolve().name
    return settings, tuple(remarks(settings, name, refused.get(timer, ""), refused.get(trigger, "")))


def set_rs485(handle: int, *, hears_itself: bool) -> Rs485 | None:
    """Set the RS-485 mode of an open port: RTS up while it sends. The delays stay as they are (device tree).

    ``hears_itself``: the receiver stays on meanwhile. Returns the settings in force, as read back; None if
    the driver has no such mode. A driver may accept the call and change nothing.
    """
    content = bytearray(_RS485.size)
    try:
        fcntl.ioctl(handle, TIOCGRS485, content)
        flags, *rest = _RS485.unpack(content)
        flags |= _ENABLED | _RTS_ON_SEND
        flags &= ~(_RTS_AFTER_SEND | _RX_DURING_TX)
        flags |= _RX_DURING_TX if hears_itself else 0
        fcntl.ioctl(handle, TIOCSRS485, _RS485.pack(flags, *rest))
    except OSError:
        return None
    return _rs485(handle)


def tty_folder(handle: int, sysfs: Path = SYSFS) -> Path:
    """Return the sysfs folder of an open terminal, by its device number.

    The number does not depend on the name that it was opened with, so links of ``/dev/serial/by-id`` work
    too.
    """
    number = os.fstat(handle).st_rdev
    return sysfs / "dev" / "char" / f"{os.major(number)}:{os.minor(number)}"


def remarks(
    settings: LatencySettings, name: str, timer_refused: str = "", trigger_refused: str = ""
) -> Iterator[str]:
    """Yield what delays bytes on the port ``name`` (``ttyUSB0``), and how to change it.

    ``timer_refused`` and ``trigger_refused`` say why an attempt to set them failed.
    """
    timer_ms, trigger = settings.ftdi_latency_timer_ms, settings.rx_trig_bytes
    if timer_ms is not None and timer_ms > LEAST_MS:
        yield (
            f"ftdi latency timer is {timer_ms} ms: each reply waits up to {timer_ms} ms in the adapter"
            + _remedy(timer_refused, 'SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"')
        )
    rule = f'SUBSYSTEM=="tty", KERNEL=="{name}", ATTR{{rx_trig_bytes}}="1"'
    if trigger is None and trigger_refused:
        yield "rx_trig_bytes is unknown; the default is 8" + _remedy(trigger_refused, rule)
    elif trigger is not None and trigger > LEAST_BYTES:
        yield (
            f"rx_trig_bytes is {trigger}: the end of a reply waits for four characters of silence in the UART"
            + _remedy(trigger_refused, rule)
        )
    rs485 = settings.rs485
    if rs485 is not None and rs485.enabled and rs485.delay_after_send_ms:
        yield (
            "shorten delay_rts_after_send (device tree: rs485-rts-delay): the kernel keeps the RS-485 line "
            f"for {rs485.delay_after_send_ms} ms after each frame, and earlier answers are lost"
        )


def flag_note(settings: LatencySettings) -> str:
    """Return a note if a port did not take the low-latency flag, "" if it did. That alone costs no time."""
    return "" if settings.async_low_latency else "the driver has no low-latency mode"


def _remedy(refused: str, rule: str) -> str:
    if not refused:
        return " (the driver accepts no lower value)"
    return f' (setting it: {refused}); let udev set it: ACTION=="add|change", {rule}'


def _lower(path: Path, least: int) -> str:
    """Lower the number in a file of the kernel; return why that failed, or ""."""
    try:
        found = int(path.read_text())
    except PermissionError as error:  # older kernels show rx_trig_bytes to root only
        return error.strerror or str(error)
    except (OSError, ValueError):
        return ""
    if found <= least:
        return ""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_TRUNC)  # never creates a file
        try:
            os.write(handle, b"%d\n" % least)
        finally:
            os.close(handle)
    except OSError as error:
        return error.strerror or str(error)
    return ""


def _number_in(path: Path) -> int | None:
    """Read a number; None if there is no such file, or the driver shows none (a UART without FIFO)."""
    try:
        return int(path.read_text())
    except (OSError, ValueError):
        return None


def _serial_struct(handle: int) -> bytearray | None:
    content = bytearray(_SERIAL_STRUCT_BYTES)
    try:
        fcntl.ioctl(handle, termios.TIOCGSERIAL, content)
    except OSError:
        return None
    return content


def _low_latency_flag(handle: int) -> bool | None:
    content = _serial_struct(handle)
    if content is None:
        return None
    (flags,) = struct.unpack_from("=i", content, _SERIAL_FLAGS_AT)
    return bool(flags & ASYNC_LOW_LATENCY)


def _set_low_latency_flag(handle: int) -> None:
    """Set it; reading it back shows whether the driver took it."""
    content = _serial_struct(handle)
    if content is None:
        return
    (flags,) = struct.unpack_from("=i", content, _SERIAL_FLAGS_AT)
    if flags & ASYNC_LOW_LATENCY:
        return
    struct.pack_into("=i", content, _SERIAL_FLAGS_AT, flags | ASYNC_LOW_LATENCY)
    try:
        fcntl.ioctl(handle, termios.TIOCSSERIAL, content)
    except OSError:
        return


def _rs485(handle: int) -> Rs485 | None:
    content = bytearray(_RS485.size)
    try:
        fcntl.ioctl(handle, TIOCGRS485, content)
    except OSError:
        return None
    flags, before_ms, after_ms, *_ = _RS485.unpack(content)
    return Rs485(
        enabled=bool(flags & _ENABLED),
        rts_on_send=bool(flags & _RTS_ON_SEND),
        rts_after_send=bool(flags & _RTS_AFTER_SEND),
        rx_during_tx=bool(flags & _RX_DURING_TX),
        delay_before_send_ms=before_ms,
        delay_after_send_ms=after_ms,
    )
