"""The kinds of gauges, for who only has to name them; ``metrology.gauges`` reads what they write."""

from enum import Enum


class GaugeKind(Enum):
    """How a gauge writes a reading."""

    MITUTOYO = "mitutoyo"
    SYLVAC = "sylvac"
    MILLIMAR = "millimar"
    PATTERN = "pattern"
    """A pattern of one's own."""
