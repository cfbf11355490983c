"""Which serial ports this machine has, by the names that they keep when they are plugged in again."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

LASTING: Final = (
    Path("/dev/pitch-gateway/by-serial"),
    Path("/dev/serial/by-id"),
    Path("/dev/pitch-gateway/by-socket"),
    Path("/dev/serial/by-path"),
)
"""Where udev keeps names that stay, of the adapter or of its socket; ours come with an installation."""


@dataclass(frozen=True, slots=True)
class Found:
    """A serial port."""

    path: str
    """Its most lasting name."""
    device: str
    """What it leads to today."""

    def __str__(self) -> str:
        """Return both names, where they differ."""
        return self.path if self.path == self.device else f"{self.path} (now {self.device})"


def serial_ports(lasting: tuple[Path, ...] = LASTING) -> list[Found]:
    """Return the serial ports that are there; those that have no lasting name by their device."""
    from serial.tools.list_ports import comports

    found: dict[str, Found] = {}
    for folder in lasting:
        for link in sorted(folder.iterdir()) if folder.is_dir() else ():
            device = os.path.realpath(link)
            found.setdefault(device, Found(str(link), device))
    for port in sorted(comports()):
        found.setdefault(port.device, Found(port.device, port.device))
    return list(found.values())
