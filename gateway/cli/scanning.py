"""Looks for drives on a serial line on which nobody speaks: how it is set, and which unit ids answer.

One register is read, of one unit id after the other, at one setting after the other; nothing is written. Any
answer counts, also one that refuses: only a drive that is set alike makes a whole frame.
"""

import struct
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

from gateway.cli.first_configuration import PARITIES, Serial, format_words
from gateway.cli.listening.ear import settings_to_try
from gateway.cli.probing.readings import LAST_UNIT_ID
from gateway.modbus.pdu import FunctionCode
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.master import GarbledError, ModbusMaster, SilentError

FIRST_UNIT_IDS: Final = range(1, 9)
"""Asked at each setting: one of the drives of a machine has one of these."""
WAIT_MS: Final = 60.0
"""For an answer, beyond what its bytes take."""
DRAIN_MS: Final = 20.0
ASKED_CHARACTERS: Final = 8 + 7
"""Of a read of one register and its reply."""


class Scanned(NamedTuple):
    """A setting at which drives answer, and their unit ids."""

    serial: Serial
    unit_ids: tuple[int, ...]


async def scan(
    device: str, offered: Serial, address: int, unit_ids: Iterable[int], say: Callable[[str], None]
) -> Scanned | None:
    """Return the first setting at which something answers, with everybody who does; None: nobody does.

    ``offered`` is tried first. ``address``: the register that is read. ``unit_ids`` are asked at each setting
    too. ``say`` gets a line for each setting.

    Raises:
        TransportError: the port is absent, in use or not allowed.
        LostError: the port went away.
    """
    usual = (
        Serial(each.baudrate, PARITIES[each.parity], offered.stop_bits)
        for each in settings_to_try(None, None)
    )
    first = tuple(dict.fromkeys((*FIRST_UNIT_IDS, *unit_ids)))
    for serial in dict.fromkeys((offered, *usual)):
        found = await _answering(device, serial, address, first)
        if found:
            said = f"an answer from unit id {found[0]}; asking the others up to {LAST_UNIT_ID}"
            say(f"{format_words(serial)}: {said}")
            others = [each for each in range(1, LAST_UNIT_ID + 1) if each not in first]
            found += await _answering(device, serial, address, others)
            return Scanned(serial, tuple(sorted(found)))
        say(f"{format_words(serial)}: no answer")
    return None


async def _answering(device: str, serial: Serial, address: int, unit_ids: Iterable[int]) -> list[int]:
    """Return who answers at a setting."""
    assert serial.baudrate is not None
    assert serial.stop_bits is not None
    letter = next(letter for letter, word in PARITIES.items() if word == serial.parity)
    endpoint = SerialEndpoint(device, serial.baudrate, letter, stop_bits=serial.stop_bits)
    wire_ms = 1000.0 * ASKED_CHARACTERS * endpoint.bits_per_character / serial.baudrate
    read = struct.pack(">BHH", FunctionCode.READ_HOLDING_REGISTERS, address, 1)
    found = []
    async with ModbusMaster(endpoint, WAIT_MS + wire_ms, drain_ms=DRAIN_MS) as master:
        for unit_id in unit_ids:
            try:
                await master.exchange(unit_id, read)
            except (SilentError, GarbledError):
                continue
            found.append(unit_id)
    return found
