"""The small unit in which deviations are said: micrometres, and arc seconds of rotary axes."""

from typing import Final, NamedTuple

from gateway.compensation.units import MM_PER_INCH, Units


class Small(NamedTuple):
    """``factor`` turns a length in the units of the axis into this one; ``key`` is its name in plain data."""

    name: str
    key: str
    factor: float

    def text(self, length: float) -> str:
        """Write a length with its unit.

        >>> small_unit(Units.MM).text(0.00123)
        '1.23 µm'
        """
        return f"{length * self.factor:.2f} {self.name}"


_SMALL: Final = {
    Units.MM: Small("µm", "um", 1000.0),
    Units.INCH: Small("µm", "um", MM_PER_INCH * 1000.0),
    Units.DEGREE: Small("arcsec", "arcsec", 3600.0),
}


def small_unit(units: Units) -> Small:
    """Return the small unit of an axis."""
    return _SMALL[units]
