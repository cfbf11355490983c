"""The correction for the temperature of a screw, also while its sensor is silent.

A screw that is fixed at ``fixed_at`` and is warmer than its table by dT puts the axis at ``fixed_at + (x −
fixed_at)·(1 + alpha·dT)``. So ``−alpha·dT·(x − fixed_at)`` is added: a straight line over the position.

dT follows the sensor at most at ``rate_per_min``. It is computed from the time argument, so it does not
matter how often it is computed. When the sensor falls silent, dT is held; after another ``hold_s`` it returns
to 0 at the same rate.
"""

from enum import Enum
from math import isfinite
from typing import Final

from gateway.compensation.errors import TemperatureError
from gateway.compensation.settings import ThermalSettings
from gateway.times import NS_PER_S

S_PER_MIN: Final = 60.0
ROUNDING: Final = 1e-9
"""Share by which a number may exceed a limit after conversion back and forth."""


class TermState(Enum):
    """How well the value of a term is known."""

    WAITING = "waiting"
    """No value has come yet: the term is 0."""
    FOLLOWING = "following"
    HELD = "held"
    """The last value stays in force, although no newer one comes."""
    FADING = "fading"
    """It returns to 0."""
    FADED = "faded"
    """It is 0 again, until a value comes."""


class Thermal:
    """The effective temperature difference of one axis. Time is monotonic, in ns."""

    def __init__(self, settings: ThermalSettings) -> None:
        self.settings = settings
        self.celsius: float | None = None
        """The last value of the sensor."""
        self.difference = 0.0
        """Effective dT, in K."""
        self._taken_ns = 0
        self._at_ns = 0
        self._is_known = False
        self._counts_at_once = True
        """``difference`` comes from no sensor value: the next value applies immediately."""

    def take(self, celsius: float, now_ns: int) -> None:
        """Take a value of the sensor. The first value applies immediately, because none was known before it.

        Raises:
            TemperatureError: it cannot be the temperature of this screw; nothing is changed.
        """
        settings = self.settings
        if not isfinite(celsius) or abs(celsius - settings.reference) > settings.largest_dt:
            raise TemperatureError(
                f"{celsius:.6g} °C is no temperature within {settings.largest_dt:g} K of the reference "
                f"{settings.reference:g} °C"
            )
        self.follow(now_ns)
        if self._counts_at_once:
            self.difference = celsius - settings.reference
        self.celsius = celsius
        self._taken_ns = self._at_ns = now_ns
        self._is_known = True
        self._counts_at_once = False

    def resume(self, difference: float, now_ns: int) -> None:
        """Continue from the difference of another run, as if the sensor had just sent a value.

        An impossible difference was computed with another ``alpha``: it stays until the sensor sends a value,
        which then applies immediately.
        """
        is_of_another_alpha = abs(difference) > self.settings.largest_dt * (1.0 + ROUNDING)
        if is_of_another_alpha and self.celsius is not None:
            return
        if not self._is_known:
            self._taken_ns = now_ns
            self._is_known = True
        self._counts_at_once = is_of_another_alpha
        self.difference = difference
        self._at_ns = now_ns

    def follow(self, now_ns: int) -> float:
        """Return the effective difference now, and continue from there."""
        self.difference = self.difference_at(now_ns)
        self._at_ns = max(self._at_ns, now_ns)
        return self.difference

    def difference_at(self, now_ns: int) -> float:
        """Return the effective difference at a time; nothing changes."""
        difference = self.difference
        if not self._is_known or now_ns <= self._at_ns:
            return difference
        fades_ns = self._fades_ns
        if self.celsius is not None and self._at_ns < fades_ns:
            elapsed_ns = min(now_ns, fades_ns) - self._at_ns
            difference = self._towards(self.celsius - self.settings.reference, difference, elapsed_ns)
        if now_ns > fades_ns:
            difference = self._towards(0.0, difference, now_ns - max(self._at_ns, fades_ns))
        return difference

    def age_s(self, now_ns: int) -> float | None:
        """Return the age of the last sensor value; None if there was none."""
        return None if self.celsius is None else max(0, now_ns - self._taken_ns) / NS_PER_S

    def state(self, now_ns: int) -> TermState:
        """Return how well the difference is known."""
        if not self._is_known:
            return TermState.WAITING
        if now_ns - self._taken_ns <= self.settings.timeout_s * NS_PER_S:
            return TermState.FOLLOWING
        if now_ns <= self._fades_ns:
            return TermState.HELD
        return TermState.FADING if self.difference_at(now_ns) else TermState.FADED

    @property
    def _fades_ns(self) -> int:
        return self._taken_ns + int((self.settings.timeout_s + self.settings.hold_s) * NS_PER_S)

    def _towards(self, goal: float, difference: float, elapsed_ns: int) -> float:
        most = self.settings.rate_per_min / S_PER_MIN * elapsed_ns / NS_PER_S
        if abs(goal - difference) <= most:
            return goal
        return difference + (most if goal > difference else -most)
