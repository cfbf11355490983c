"""What a table can follow, and what of it is wanted."""

from enum import Enum
from typing import NamedTuple

from gateway.metrology.lead import Period


class Shape(Enum):
    """What a table follows, the plainest first."""

    LINES = "lines"
    """Straight from target to target."""
    SMOOTH = "smooth"
    """A smooth curve; what scatters about it, noise and short waves alike, is left."""
    HARMONICS = "harmonics"
    """A smooth curve and what repeats with the lead and other turns."""

    @property
    def words(self) -> str:
        """What it is called in a sentence."""
        return {
            Shape.LINES: "lines between the targets",
            Shape.SMOOTH: "a smooth curve",
            Shape.HARMONICS: "a smooth curve with harmonics of the lead",
        }[self]


class LeftOut(NamedTuple):
    """E that a table leaves between the targets, predicted by leaving out, in the units of the readings.

    Of the curves that the readings allow half leave more than ``e``, and nine of ten between ``low`` and
    ``high``. What repeats with ``unseen`` may be in none of them: no target
    tells it from a slower curve.
    """

    e: float
    low: float
    high: float
    unseen: tuple[Period, ...] = ()

    @property
    def without(self) -> str:
        """What is not in the figures, in words; empty where everything is."""
        names = " and ".join(each.name for each in self.unseen)
        if not names:
            return ""
        return f"what repeats with {names} can come on top: these targets do not tell it from a slower curve"


class Fit(Enum):
    """What is wanted; ``AUTO``: what leaves least between the targets."""

    AUTO = "auto"
    LINES = "lines"
    SMOOTH = "smooth"
    HARMONICS = "harmonics"
