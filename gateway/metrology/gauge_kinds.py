"""The kinds of gauges, and how each is usually connected; ``metrology.gauges`` reads what they write."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final


class GaugeKind(Enum):
    """How a gauge writes a reading."""

    MITUTOYO = "mitutoyo"
    SYLVAC = "sylvac"
    MILLIMAR = "millimar"
    PATTERN = "pattern"
    """A pattern of one's own."""


@dataclass(frozen=True, slots=True)
class GaugeDefaults:
    """How a gauge is usually connected, and what asks it for a reading; "" where a button sends it."""

    baudrate: int
    data_bits: int
    parity: str
    stop_bits: int
    request: str


DEFAULTS: Final[Mapping[GaugeKind, GaugeDefaults]] = {
    GaugeKind.MITUTOYO: GaugeDefaults(9600, 8, "N", 1, ""),
    GaugeKind.SYLVAC: GaugeDefaults(4800, 7, "E", 2, "?\r"),
    GaugeKind.MILLIMAR: GaugeDefaults(9600, 7, "E", 2, "M1?\r"),
    GaugeKind.PATTERN: GaugeDefaults(9600, 8, "N", 1, ""),
}
