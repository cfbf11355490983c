"""Temperatures that are read over Modbus, each on its own connection."""

import asyncio
from collections.abc import Callable
from typing import Final

from gateway.config.terms_model import TemperatureSource
from gateway.modbus.pdu import is_exception
from gateway.modbus.registers import PositionField
from gateway.transport.errors import TransportError
from gateway.transport.master import ModbusMaster, NoReplyError

PATIENCE_MS: Final = 2000.0
EXCEPTION_SIZE: Final = 2
"""Bytes of an exception PDU. A device may send fewer or more."""


async def read_on(
    source: TemperatureSource, take: Callable[[float], None], complain: Callable[[str], None]
) -> None:
    """Poll a register for ever; reconnect after a lost connection.

    ``take`` gets each value; ``complain`` gets the reason if there is none.
    """
    while True:
        try:
            await _read_connected(source, take, complain)
        except (TransportError, NoReplyError, OSError) as error:
            text = str(error)
            complain(text if text.startswith(f"{source.modbus} ") else f"{source.modbus}: {text}")
        await asyncio.sleep(source.every_s)


async def _read_connected(
    source: TemperatureSource, take: Callable[[float], None], complain: Callable[[str], None]
) -> None:
    assert source.modbus is not None
    assert source.address is not None
    field = PositionField(source.address, source.type, source.words)
    request = bytes((source.function,)) + source.address.to_bytes(2, "big") + bytes((0, field.words))
    async with ModbusMaster(source.modbus, timeout_ms=PATIENCE_MS) as master:
        while True:
            reply = await master.exchange(source.unit_id, request)
            if is_exception(reply) and len(reply) == EXCEPTION_SIZE:
                complain(f"{source.modbus}: exception {reply[1]:#04x}")
            elif len(reply) != 2 + 2 * field.words or reply[0] != source.function:
                complain(f"{source.modbus}: found {reply.hex(' ')}")
            else:
                take(field.unpack(reply[2:]) * source.scale)
            await asyncio.sleep(source.every_s)
