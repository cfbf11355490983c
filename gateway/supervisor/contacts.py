"""What switches the contact of ``[alarm_output]``: a coil of a Modbus device."""

import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Final

from gateway.config.gateway_model import AlarmOutputSection
from gateway.modbus.pdu import is_exception

PATIENCE_MS: Final = 1000.0
WRITE_COIL: Final = 5
CLOSED: Final = bytes((0xFF, 0x00))
OPEN: Final = bytes((0x00, 0x00))
Switch = Callable[[bool], Awaitable[str | None]]
"""Closes the contact (True) or opens it. Returns why it was not done, None if it was; raises ContactError."""


class ContactError(Exception):
    """The contact cannot be reached, or not any more; the text says why."""


def name_of(section: AlarmOutputSection) -> str:
    """Return the device of a contact, for messages."""
    return str(section.device.endpoint)


def contact_of(section: AlarmOutputSection) -> tuple[str, str]:
    """Return what makes it this contact: the device, and what of it."""
    return name_of(section), f"unit id {section.unit_id}, coil {section.coil}"


@contextlib.asynccontextmanager
async def connected(section: AlarmOutputSection) -> AsyncIterator[Switch]:
    """Yield what switches the contact.

    Raises:
        ContactError: it cannot be reached, or the connection is lost.
    """
    # This loads serial ports and a Modbus master, which few supervisors need.
    from gateway.transport.errors import TransportError
    from gateway.transport.master import ModbusMaster, NoReplyError

    endpoint, head = section.device.endpoint, bytes((WRITE_COIL, *section.coil.to_bytes(2, "big")))
    try:
        async with ModbusMaster(endpoint, timeout_ms=PATIENCE_MS) as master:

            async def switch(is_closed: bool) -> str | None:
                request = head + (CLOSED if is_closed else OPEN)
                reply = await master.exchange(section.unit_id, request)
                if is_exception(reply) and len(reply) > 1:
                    return f"exception {reply[1]:#04x}"
                return None if reply == request else f"found {reply.hex(' ')}"

            yield switch
    except (TransportError, NoReplyError, OSError) as error:
        raise ContactError(str(error).removeprefix(f"{endpoint} ")) from error
