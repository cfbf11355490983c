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
    ``high``. What repeats with ``unseen`` is in none of them, for no target tells it from a slower curve:
    then the readings hold no upper bound, ``e`` and ``high`` are None, and at least ``low`` is left.
    """

    e: float | None
    low: float
    high: float | None
    unseen: tuple[Period, ...] = ()
    unsettled: str = ""
    """What has to be settled first: runs that do not fit the others."""

    @property
    def unknown(self) -> str:
        """Why the readings do not tell it, in words; empty where they do."""
        if self.unsettled:
            return f"not known from these readings: {self.unsettled}"
        names = " and ".join(each.name for each in self.unseen)
        if not names:
            return ""
        return (
            f"not known from these readings: their targets do not tell what repeats with {names} from a "
            "slower curve"
        )


class Fit(Enum):
    """What is wanted; ``AUTO``: what leaves least between the targets."""

    AUTO = "auto"
    LINES = "lines"
    SMOOTH = "smooth"
    HARMONICS = "harmonics"
