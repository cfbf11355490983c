"""Machine units. The only file with the length of an inch."""

from enum import Enum
from typing import Final

MM_PER_INCH: Final = 25.4
"""Exact by definition (international inch, 1959)."""


class Units(Enum):
    """Unit of every length of one axis. Files, status and command lines show the value."""

    MM = "mm"
    INCH = "inch"
    DEGREE = "degree"

    def from_mm(self, length_mm: float) -> float:
        """Convert a length in mm into these units; a degree corresponds to a millimetre.

        Defaults of lengths are defined in mm; on a rotary axis the same number is in degrees.

        >>> Units.INCH.from_mm(25.4)
        1.0
        """
        return length_mm / MM_PER_INCH if self is Units.INCH else length_mm

    def convert_factor(self, target: "Units") -> float:
        """Return the factor that converts a length in these units into ``target`` units.

        Raises:
            ValueError: between a length and an angle.

        >>> Units.INCH.convert_factor(Units.MM)
        25.4
        """
        if self is target:
            return 1.0
        if Units.DEGREE in (self, target):
            raise ValueError(f"{self.value} cannot be converted into {target.value}")
        return MM_PER_INCH if target is Units.MM else 1.0 / MM_PER_INCH
