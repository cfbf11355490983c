"""The kinds of gauges, and their usual connection; ``metrology.gauges`` reads their lines."""

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
    """A pattern given by the user."""


@dataclass(frozen=True, slots=True)
class GaugeDefaults:
    """The usual connection of a gauge, and its request for a reading; "" if a button sends the reading."""

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
