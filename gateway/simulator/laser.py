"""The simulated laser interferometer: it sees the nut, not the encoder."""

import random
from typing import Final

from gateway.simulator.mechanics import Mechanics

UM_PER_MM: Final = 1000.0


class Laser:
    """Reads the true displacement of a nut from the place where the laser was zeroed, with seeded noise.

    Lengths in millimetres; ``noise_um`` is the standard deviation of one reading.
    """

    def __init__(self, mechanics: Mechanics, *, noise_um: float = 0.0, seed: int = 0) -> None:
        self._mechanics = mechanics
        self._noise_mm = noise_um / UM_PER_MM
        self._rng = random.Random(seed)
        self._zero_mm = mechanics.nut_mm

    def zero(self, now_s: float) -> None:
        """Take the nut's place at ``now_s`` as 0."""
        self._mechanics.advance(now_s)
        self._zero_mm = self._mechanics.nut_mm

    def true_mm(self, now_s: float) -> float:
        """Displacement of the nut without noise: what no instrument can know."""
        self._mechanics.advance(now_s)
        return self._mechanics.nut_mm - self._zero_mm

    def read_mm(self, now_s: float) -> float:
        """One reading."""
        return self.true_mm(now_s) + (self._rng.gauss(0.0, self._noise_mm) if self._noise_mm else 0.0)
