"""ISO 230-2: accuracy and repeatability of positioning, from readings at targets approached from both sides.

With the deviation ``x`` = measured - target of every run: at each target and in each direction the mean and
the sample standard deviation ``s`` (n - 1); ``B`` is the difference of both means. Over all targets::

    R(d) = max 4 s(d)                          R = max over targets of max(2 s(f) + 2 s(b) + |B|, R(f), R(b))
    E(d) = max mean(d) - min mean(d)           E = the same over both directions together
    A(d) = max (mean(d) + 2 s) - min (mean(d) - 2 s)      A = the same over both directions together
    M    = max (mean of both means) - min of it           B = max |B|

Source: the formulas of ISO 230-2 (clauses 2 and 4) as two public calculators and the literature give them;
the standard itself was not at hand. All results are in the units of the readings.
"""

from dataclasses import dataclass
from statistics import fmean, stdev

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.readings import APPROACHES, Survey, check_reading


@dataclass(frozen=True, slots=True)
class Approach:
    """Deviations at one target, approached in one direction; ``s`` is None with fewer than two runs."""

    deviations: tuple[float, ...]
    mean: float
    s: float | None


@dataclass(frozen=True, slots=True)
class TargetStatistics:
    """One target; None where a direction has no reading."""

    target: float
    forward: Approach | None
    backward: Approach | None

    @property
    def reversal(self) -> float | None:
        """``B`` at this target: mean forward less mean backward."""
        if self.forward is None or self.backward is None:
            return None
        return self.forward.mean - self.backward.mean

    @property
    def mean(self) -> float | None:
        """Mean of both means."""
        if self.forward is None or self.backward is None:
            return None
        return (self.forward.mean + self.backward.mean) / 2


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Results by the standard's names; None where the readings do not carry one.

    One run each way makes no ``s``, so neither ``R`` nor ``A``; one direction has neither ``B`` nor ``M``,
    and a target without one of its approaches leaves no ``R``, ``E``, ``M`` or ``A`` of both.
    """

    units: Units
    targets: tuple[TargetStatistics, ...]
    reversal: float | None
    """B"""
    mean_reversal: float | None
    """Mean of B over the targets, signed."""
    repeatability_forward: float | None
    repeatability_backward: float | None
    repeatability: float | None
    """R"""
    systematic_forward: float | None
    systematic_backward: float | None
    systematic: float | None
    """E"""
    mean_systematic: float | None
    """M"""
    accuracy_forward: float | None
    accuracy_backward: float | None
    accuracy: float | None
    """A"""


def evaluate(survey: Survey) -> Evaluation:
    """Evaluate readings after ISO 230-2.

    Raises:
        ReadingsError: no readings, or one that is no number.
    """
    found: dict[tuple[float, Direction], list[float]] = {}
    for number, reading in enumerate(survey.readings, start=1):
        check_reading(reading, number)
        found.setdefault((reading.target, reading.direction), []).append(reading.deviation)
    if not found:
        raise ReadingsError("no readings: measure every target from both sides")
    targets = tuple(
        TargetStatistics(target, *(_approach(found.get((target, way))) for way in APPROACHES))
        for target in sorted({target for target, _ in found})
    )
    forward = [target.forward for target in targets if target.forward]
    backward = [target.backward for target in targets if target.backward]
    reversals = [reversal for target in targets if (reversal := target.reversal) is not None]
    both = [each for target in targets for each in (target.forward, target.backward)]
    # Bidirectional is what was approached from both sides everywhere.
    bidirectional = [each for each in both if each is not None] if None not in both else []
    return Evaluation(
        units=survey.units,
        targets=targets,
        reversal=max(map(abs, reversals), default=None),
        mean_reversal=fmean(reversals) if reversals else None,
        repeatability_forward=_repeatability(forward),
        repeatability_backward=_repeatability(backward),
        repeatability=_bidirectional_repeatability(targets),
        systematic_forward=_spread([(each.mean, each.mean) for each in forward]),
        systematic_backward=_spread([(each.mean, each.mean) for each in backward]),
        systematic=_spread([(each.mean, each.mean) for each in bidirectional]),
        mean_systematic=_spread([(mean, mean) for target in targets if (mean := target.mean) is not None])
        if bidirectional
        else None,
        accuracy_forward=_accuracy(forward),
        accuracy_backward=_accuracy(backward),
        accuracy=_accuracy(bidirectional),
    )


def _approach(deviations: list[float] | None) -> Approach | None:
    if deviations is None:
        return None
    return Approach(tuple(deviations), fmean(deviations), stdev(deviations) if len(deviations) > 1 else None)


def _spread(bounds: list[tuple[float, float]]) -> float | None:
    return max(high for _, high in bounds) - min(low for low, _ in bounds) if bounds else None


def _repeatability(approaches: list[Approach]) -> float | None:
    spreads = [4 * each.s for each in approaches if each.s is not None]
    return max(spreads) if spreads and len(spreads) == len(approaches) else None


def _bidirectional_repeatability(targets: tuple[TargetStatistics, ...]) -> float | None:
    spreads = []
    for target in targets:
        forward, backward, reversal = target.forward, target.backward, target.reversal
        if forward is None or backward is None or reversal is None:
            return None
        if forward.s is None or backward.s is None:
            return None
        spreads.append(max(2 * (forward.s + backward.s) + abs(reversal), 4 * forward.s, 4 * backward.s))
    return max(spreads, default=None)


def _accuracy(approaches: list[Approach]) -> float | None:
    bounds = [(each.mean - 2 * each.s, each.mean + 2 * each.s) for each in approaches if each.s is not None]
    return _spread(bounds) if len(bounds) == len(approaches) else None
