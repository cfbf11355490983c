"""Baud rates that no device has."""

from collections.abc import Iterator
from typing import Final

from gateway.config.check_lines import controller_key
from gateway.config.findings import Findings
from gateway.config.sections import Sections
from gateway.config.toml_lines import KeyPath

USUAL_RATES: Final = frozenset(
    {
        *(50, 75, 110, 134, 150, 200, 300, 600, 1200, 1800, 2400, 4800, 7200, 9600, 14400, 19200, 28800),
        *(31250, 38400, 45450, 57600, 76800, 93750, 100_000, 115_200, 125_000, 128_000, 153_600, 187_500),
        *(200_000, 230_400, 250_000, 256_000, 307_200, 312_500, 375_000, 400_000, 460_800, 500_000, 576_000),
        *(600_000, 614_400, 625_000, 750_000, 800_000, 921_600),
        *(1_000_000, 1_152_000, 1_250_000, 1_500_000, 1_562_500, 2_000_000, 2_500_000, 3_000_000, 3_500_000),
        *(4_000_000, 5_000_000, 6_000_000, 8_000_000, 10_000_000, 12_000_000),
    }
)
"""Of terminals and modems, of RS-485 buses, and what the clocks of adapters and drives divide down to."""


def check_ports(findings: Findings, sections: Sections) -> None:
    """Warn of rates that are none."""
    for key, rate in _rates(findings, sections):
        if rate not in USUAL_RATES:
            nearest = min(USUAL_RATES, key=lambda usual: abs(usual - rate))
            findings.warn(
                key,
                f"{rate} is no baud rate that devices have",
                f"look in the manual of the device; the nearest usual one is {nearest}",
            )


def _rates(findings: Findings, sections: Sections) -> Iterator[tuple[KeyPath, int]]:
    for name, line in sections.lines.items():
        if line.drives.rtu is not None:
            yield ("line", name, "drives", "baudrate"), line.drives.baudrate
        for index, controller in enumerate(line.controllers):
            if controller.rtu is not None:
                key = controller_key(findings, name, controller.name, index)
                yield (*key, "baudrate"), controller.baudrate
