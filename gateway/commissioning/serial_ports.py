"""The serial ports of this machine, by permanent names, and a scan of a silent one for drives.

The scan reads one register of one unit id after the other, with one setting after the other; it writes
nothing. Any answer counts, including a refusal: only a drive with the same setting makes a complete frame.
"""

import os
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from gateway.commissioning.first_configuration import Serial, format_words
from gateway.commissioning.listen.serial_line import settings_to_try
from gateway.commissioning.probe.readings import LAST_UNIT_ID
from gateway.modbus.pdu import FunctionCode
from gateway.transport.endpoints import PARITIES, SerialEndpoint
from gateway.transport.master import GarbledError, ModbusMaster, SilentError

LASTING: Final = (
    Path("/dev/pitch-gateway/by-serial"),
    Path("/dev/serial/by-id"),
    Path("/dev/pitch-gateway/by-socket"),
    Path("/dev/serial/by-path"),
)
"""Permanent names from udev, of the adapter or of its socket; ours are part of an installation."""


@dataclass(frozen=True, slots=True)
class Found:
    """A serial port."""

    path: str
    """Its most permanent name."""
    device: str
    """Its present target."""

    def __str__(self) -> str:
        """Return both names, if they differ."""
        return self.path if self.path == self.device else f"{self.path} (now {self.device})"


def serial_ports(lasting: tuple[Path, ...] = LASTING) -> list[Found]:
    """Return the existing serial ports; those without a permanent name by their device."""
    from serial.tools.list_ports import comports

    found: dict[str, Found] = {}
    for folder in lasting:
        for link in sorted(folder.iterdir()) if folder.is_dir() else ():
            device = os.path.realpath(link)
            found.setdefault(device, Found(str(link), device))
    for port in sorted(comports()):
        found.setdefault(port.device, Found(port.device, port.device))
    return list(found.values())


FIRST_UNIT_IDS: Final = range(1, 9)
"""Polled with each setting: one of the drives of a machine has one of these."""
WAIT_MS: Final = 60.0
"""For an answer, in addition to the time of its bytes."""
DRAIN_MS: Final = 20.0
ASKED_CHARACTERS: Final = 8 + 7
"""Of a read of one register and its reply."""


class Scanned(NamedTuple):
    """A setting with answers, and the unit ids of the drives."""

    serial: Serial
    unit_ids: tuple[int, ...]


async def scan(
    device: str, offered: Serial, address: int, unit_ids: Iterable[int], report: Callable[[str], None]
) -> Scanned | None:
    """Return the first setting with an answer, and all unit ids that answer; None: no answer.

    ``offered`` is tried first. ``address``: the register to read. ``unit_ids`` are also polled with each
    setting. ``report`` gets a line for each setting.

    Raises:
        TransportError: the port does not exist, is in use or not allowed.
        LostError: the port was removed.
    """
    usual = (
        Serial(each.baudrate, PARITIES[each.parity], offered.stop_bits)
        for each in settings_to_try(None, None)
    )
    first = tuple(dict.fromkeys((*FIRST_UNIT_IDS, *unit_ids)))
    for serial in dict.fromkeys((offered, *usual)):
        found = await _answering(device, serial, address, first)
        if found:
            text = f"unit id {found[0]} answers; trying the others up to {LAST_UNIT_ID}"
            report(f"{format_words(serial)}: {text}")
            others = [each for each in range(1, LAST_UNIT_ID + 1) if each not in first]
            found += await _answering(device, serial, address, others)
            return Scanned(serial, tuple(sorted(found)))
        report(f"{format_words(serial)}: no answer")
    return None


async def _answering(device: str, serial: Serial, address: int, unit_ids: Iterable[int]) -> list[int]:
    """Return the unit ids that answer with a setting."""
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
