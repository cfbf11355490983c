"""What switches the contact of ``[alarm_output]``: a coil of a Modbus device, or a GPIO line."""

import contextlib
import errno
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial
from typing import Final

from gateway.config.gateway_model import AlarmOutputSection, GpioLine, why_no_gpio
from gateway.config.line_model import DrivesEndpoint
from gateway.modbus.pdu import is_exception
from gateway.supervisor.in_thread import in_thread

PATIENCE_MS: Final = 1000.0
WRITE_COIL: Final = 5
CLOSED: Final = bytes((0xFF, 0x00))
OPEN: Final = bytes((0x00, 0x00))
CONSUMER: Final = "pitch-gateway"
"""What ``gpioinfo`` shows as the user of the line."""
NO_CHIP: Final = "name one that `gpiodetect` lists as `chip`"
_REMEDIES: Final = {
    errno.ENOENT: NO_CHIP,
    errno.ENODEV: NO_CHIP,
    errno.ENOTTY: NO_CHIP,
    errno.EACCES: "let the supervisor use it: docs/install.md has the group and the udev rule",
    errno.EPERM: "let the supervisor use it: docs/install.md has the group and the udev rule",
    errno.EBUSY: "another program or the kernel has this line: `gpioinfo` names it; take another line",
    errno.EINVAL: "name a line that `gpioinfo` lists and that can be an output",
}
"""By error number (errno(3))."""
Switch = Callable[[bool], Awaitable[str | None]]
"""Closes the contact (True) or opens it. Returns why it was not done, None if it was; raises ContactError."""


class ContactError(Exception):
    """The contact cannot be reached, or not any more; the text says why."""


def name_of(section: AlarmOutputSection) -> str:
    """Return the device of a contact, for messages."""
    return section.gpio.chip if section.gpio is not None else str(section.modbus.endpoint)


def contact_of(section: AlarmOutputSection) -> tuple[str, str]:
    """Return what makes it this contact: the device, and what of it."""
    if section.gpio is not None:
        return section.gpio.chip, f"line {section.gpio.line}"
    return name_of(section), f"unit id {section.unit_id}, coil {section.coil}"


def connected(section: AlarmOutputSection) -> contextlib.AbstractAsyncContextManager[Switch]:
    """Yield what switches the contact.

    Raises:
        ContactError: it cannot be reached, or the connection is lost.
    """
    if section.gpio is not None:
        return _line(section.gpio)
    return _coil(section.modbus, section.unit_id, section.coil or 0)


@contextlib.asynccontextmanager
async def _coil(device: DrivesEndpoint, unit_id: int, coil: int) -> AsyncIterator[Switch]:
    # This loads serial ports and a Modbus master, which few supervisors need.
    from gateway.transport.errors import TransportError
    from gateway.transport.master import ModbusMaster, NoReplyError

    endpoint, head = device.endpoint, bytes((WRITE_COIL, *coil.to_bytes(2, "big")))
    try:
        async with ModbusMaster(endpoint, timeout_ms=PATIENCE_MS) as master:

            async def switch(is_closed: bool) -> str | None:
                request = head + (CLOSED if is_closed else OPEN)
                reply = await master.exchange(unit_id, request)
                if is_exception(reply) and len(reply) > 1:
                    return f"exception {reply[1]:#04x}"
                return None if reply == request else f"found {reply.hex(' ')}"

            yield switch
    except (TransportError, NoReplyError, OSError) as error:
        raise ContactError(str(error).removeprefix(f"{endpoint} ")) from error


@contextlib.asynccontextmanager
async def _line(gpio: GpioLine) -> AsyncIterator[Switch]:
    """Take the line as an output, inactive at first. The kernel takes it back when this process ends."""
    try:
        import gpiod
        from gpiod.line import Direction, Value
    except ImportError:
        raise ContactError(why_no_gpio()) from None
    settings = gpiod.LineSettings(
        direction=Direction.OUTPUT, active_low=gpio.active_low, output_value=Value.INACTIVE
    )
    request = partial(gpiod.request_lines, gpio.chip, consumer=CONSUMER, config={gpio.line: settings})
    try:
        # In threads: a line of an expander on I2C waits for its bus.
        with await in_thread(request) as lines:

            async def switch(is_closed: bool) -> str | None:
                value = Value.ACTIVE if is_closed else Value.INACTIVE
                await in_thread(partial(lines.set_value, gpio.line, value))
                return None

            yield switch
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0, "check the chip with `gpioinfo`")
        raise ContactError(f"line {gpio.line}: {error.strerror or error}; {remedy}") from error
    except ValueError as error:
        raise ContactError(f"line {gpio.line}: {error}; {_REMEDIES[errno.EINVAL]}") from error
