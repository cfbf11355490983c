"""The correction as the witness computes it: straight lines between points, nothing of the gateway's."""

import random
from bisect import bisect_right
from itertools import pairwise
from typing import NamedTuple

TRAVEL_MM = 100.0


class Screw(NamedTuple):
    """Corrections in mm over machine position, for both directions; held outside."""

    positions: tuple[float, ...]
    forward: tuple[float, ...]
    backward: tuple[float, ...]

    def correction_mm(self, machine_mm: float, *, is_forward: bool) -> float:
        """What has to be added at a position on the way in one direction."""
        curve = self.forward if is_forward else self.backward
        xs = self.positions
        if machine_mm <= xs[0]:
            return curve[0]
        if machine_mm >= xs[-1]:
            return curve[-1]
        i = bisect_right(xs, machine_mm) - 1
        share = (machine_mm - xs[i]) / (xs[i + 1] - xs[i])
        return curve[i] + share * (curve[i + 1] - curve[i])


def random_screw(rng: random.Random) -> Screw:
    """A worn screw: slopes below 0.5 %, 2 to 60 µm of backlash, which is always lost motion."""
    count = rng.randint(4, 14)
    inner = sorted(rng.sample(range(3, 98), count))
    xs = (0.0, *(x + rng.random() * 0.9 for x in inner), TRAVEL_MM)
    middle = [rng.uniform(-0.1, 0.1)]
    for a, b in pairwise(xs):
        step = (b - a) * rng.uniform(-0.004, 0.004)
        middle.append(max(-0.3, min(0.3, middle[-1] + step)))
    half = [rng.uniform(0.001, 0.03) for _ in xs]
    for i in range(1, len(xs)):  # backlash may not change faster than the screw itself
        room = (xs[i] - xs[i - 1]) * 0.001
        half[i] = max(half[i - 1] - room, min(half[i - 1] + room, half[i]))
    return Screw(
        xs,
        tuple(m + h for m, h in zip(middle, half, strict=True)),
        tuple(m - h for m, h in zip(middle, half, strict=True)),
    )
