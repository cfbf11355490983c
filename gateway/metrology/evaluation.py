"""ISO 230-2: accuracy and repeatability of positioning, from readings at targets approached from both sides.

With the deviation ``x`` = measured - target of every run: at each target and in each direction the mean and
the sample standard deviation ``s`` (n - 1); ``B`` is the difference of both means. Over all targets::

    R(d) = max 4 s(d)                          R = max over targets of max(2 s(f) + 2 s(b) + |B|, R(f), R(b))
    E(d) = max mean(d) - min mean(d)           E = the same over both directions together
    A(d) = max (mean(d) + 2 s) - min (mean(d) - 2 s)      A = the same over both directions together
    M    = max (mean of both means) - min of it           B = max |B|

Source: the formulas of ISO 230-2 (clauses 2 and 4) from two public calculators and the literature; the
standard itself was not available. All results are in the units of the readings.

The name of the standard is printed beside figures only if the readings meet its requirements for a test. Up
to 2 m these are: at least five targets a metre and five in all, five runs in each direction at every target,
both directions, and uneven intervals, so that targets have different phases of periodic errors. Beyond 2 m
the intervals are at most 250 mm, with at least one run each way. Source: the standard's text as quoted by
textbooks and instrument makers.
"""

from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, stdev
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.cycle import enough_targets
from gateway.metrology.lead import even_step
from gateway.metrology.readings import APPROACHES, Reading, Survey, checked_approaches
from gateway.plain import JsonObject

NAMES: Final = (
    ("A", "accuracy"),
    ("R", "repeatability"),
    ("E", "systematic error"),
    ("M", "mean systematic error"),
    ("B", "reversal, largest"),
    ("Bm", "reversal, mean"),
)
"""Results of ISO 230-2, and their names."""
RUNS: Final = 5
LONG_MM: Final = 2000.0
LONG_INTERVAL_MM: Final = 250.0


@dataclass(frozen=True, slots=True)
class Approach:
    """Deviations at one target, approached in one direction; ``s`` is None with fewer than two runs."""

    deviations: tuple[float, ...]
    mean: float
    s: float | None


@dataclass(frozen=True, slots=True)
class TargetStatistics:
    """One target; None for a direction without a reading."""

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
    """Results by the standard's names; None if the readings are not sufficient for one.

    One run each way gives no ``s``, so neither ``R`` nor ``A``. One direction gives neither ``B`` nor ``M``.
    A target without one of its approaches gives no ``R``, ``E``, ``M`` or ``A`` of both.
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
    """Evaluate readings by ISO 230-2.

    Raises:
        ReadingsError: no readings, or one that is not a number.
    """
    found = checked_approaches(survey.readings)
    targets = tuple(
        TargetStatistics(target, *(_approach(found.get((target, way))) for way in APPROACHES))
        for target in sorted({target for target, _ in found})
    )
    forward = [target.forward for target in targets if target.forward]
    backward = [target.backward for target in targets if target.backward]
    reversals = [reversal for target in targets if (reversal := target.reversal) is not None]
    both = [each for target in targets for each in (target.forward, target.backward)]
    # Bidirectional results need both directions at every target.
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


def _approach(group: list[Reading] | None) -> Approach | None:
    if group is None:
        return None
    deviations = [each.deviation for each in group]
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


# --- As data


def values_of(found: Evaluation) -> dict[str, tuple[float | None, float | None, float | None]]:
    """Return each result for forward, backward and both."""
    return {
        "A": (found.accuracy_forward, found.accuracy_backward, found.accuracy),
        "R": (found.repeatability_forward, found.repeatability_backward, found.repeatability),
        "E": (found.systematic_forward, found.systematic_backward, found.systematic),
        "M": (None, None, found.mean_systematic),
        "B": (None, None, found.reversal),
        "Bm": (None, None, found.mean_reversal),
    }


def results_json(found: Evaluation) -> JsonObject:
    """Return the results as plain data, in the units of the readings; null for missing results."""
    values = values_of(found)
    return {
        "units": found.units.value,
        "is_iso_230_2": not missing_of(found),
        "missing": list(missing_of(found)),
        "forward": {name: values[name][0] for name in ("A", "R", "E")},
        "backward": {name: values[name][1] for name in ("A", "R", "E")},
        "both": {name: values[name][2] for name, _ in NAMES},
        "targets": [
            {
                "target": each.target,
                "runs": [len(way.deviations) if way else 0 for way in (each.forward, each.backward)],
                "mean": [way.mean if way else None for way in (each.forward, each.backward)],
                "s": [way.s if way else None for way in (each.forward, each.backward)],
                "reversal": each.reversal,
            }
            for each in found.targets
        ],
    }


# --- Requirements of the standard for a test


def missing_of(found: Evaluation) -> tuple[str, ...]:
    """Return the requirements of ISO 230-2 that these readings do not meet; empty: none.

    For rotary axes only runs and directions are checked.
    """
    targets = [each.target for each in found.targets]
    length_mm = (targets[-1] - targets[0]) / found.units.from_mm(1.0)
    is_long = length_mm > LONG_MM
    missing = []
    if found.units is not Units.DEGREE:
        missing += _targets(targets, length_mm, found.units, is_long=is_long)
    one_sided = sum(each.forward is None or each.backward is None for each in found.targets)
    if one_sided == len(targets) and not any(each.forward and each.backward for each in found.targets):
        missing.append("one direction only, both are required")
    elif one_sided:
        missing.append(f"{one_sided} of {len(targets)} targets approached from one side only")
    fewest = min(
        len(way.deviations) for each in found.targets for way in (each.forward, each.backward) if way
    )
    least = 1 if is_long else RUNS
    if fewest < least:
        missing.append(f"{fewest} run{'s' * (fewest != 1)} in each direction, {least} are required")
    if found.units is not Units.DEGREE and len(targets) > 2 and (step := even_step(targets)):
        missing.append(f"even intervals of {step:.6g} {found.units.value}, but irregular ones are required")
    return tuple(missing)


def _targets(targets: list[float], length_mm: float, units: Units, *, is_long: bool) -> list[str]:
    if is_long:
        widest = max(high - low for low, high in pairwise(targets))
        if widest > units.from_mm(LONG_INTERVAL_MM) * (1 + 1e-9):
            return [
                (
                    f"an interval of {widest:.6g} {units.value}, at most {units.from_mm(LONG_INTERVAL_MM):g} "
                    "is allowed"
                )
            ]
        return []
    needed = enough_targets(length_mm)
    return [f"{len(targets)} targets, {needed} are required on this length"] if len(targets) < needed else []


def title_of(found: Evaluation) -> str:
    """Return the title for figures of these readings."""
    return "ISO 230-2" if not missing_of(found) else "by the formulas of ISO 230-2"


def missing_line(found: Evaluation) -> str:
    """Return what is missing in one sentence; empty if nothing is."""
    missing = missing_of(found)
    return f"not a test after ISO 230-2: {'; '.join(missing)}" if missing else ""
