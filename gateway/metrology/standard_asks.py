"""What ISO 230-2 asks of a test, held against readings before its name is printed beside figures.

Up to 2 m: at least five targets a metre and five in all, five runs in each direction at every target, both
directions, and intervals that are not even, so that periodic errors are met at other phases. Beyond 2 m the
intervals are at most 250 mm and one run each way is the least. Source: the standard's text as textbooks and
makers of instruments give it; the standard itself was not at hand.
"""

from itertools import pairwise
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.cycle import enough_targets
from gateway.metrology.evaluation import Evaluation
from gateway.metrology.lead import even_step

RUNS: Final = 5
LONG_MM: Final = 2000.0
LONG_INTERVAL_MM: Final = 250.0


def missing_of(found: Evaluation) -> tuple[str, ...]:
    """Return what a test after ISO 230-2 would have and these readings have not; empty: nothing is missing.

    Rotary axes are held against runs and directions only.
    """
    targets = [each.target for each in found.targets]
    length_mm = (targets[-1] - targets[0]) / found.units.from_mm(1.0)
    is_long = length_mm > LONG_MM
    missing = []
    if found.units is not Units.DEGREE:
        missing += _targets(targets, length_mm, found.units, is_long=is_long)
    one_sided = sum(each.forward is None or each.backward is None for each in found.targets)
    if one_sided == len(targets) and not any(each.forward and each.backward for each in found.targets):
        missing.append("one direction only, of both")
    elif one_sided:
        missing.append(f"{one_sided} of {len(targets)} targets approached from one side only")
    fewest = min(
        len(way.deviations) for each in found.targets for way in (each.forward, each.backward) if way
    )
    least = 1 if is_long else RUNS
    if fewest < least:
        missing.append(f"{fewest} run{'s' * (fewest != 1)} in each direction, of {least}")
    if found.units is not Units.DEGREE and len(targets) > 2 and (step := even_step(targets)):
        missing.append(
            f"even intervals of {step:.6g} {found.units.value}, where irregular ones are asked for"
        )
    return tuple(missing)


def _targets(targets: list[float], length_mm: float, units: Units, *, is_long: bool) -> list[str]:
    if is_long:
        widest = max(high - low for low, high in pairwise(targets))
        if widest > units.from_mm(LONG_INTERVAL_MM) * (1 + 1e-9):
            return [
                f"an interval of {widest:.6g} {units.value}, of at most {units.from_mm(LONG_INTERVAL_MM):g}"
            ]
        return []
    needed = enough_targets(length_mm)
    return [f"{len(targets)} targets, of {needed} on this length"] if len(targets) < needed else []


def title_of(found: Evaluation) -> str:
    """Return what figures of these readings may be called."""
    return "ISO 230-2" if not missing_of(found) else "by the formulas of ISO 230-2"


def missing_line(found: Evaluation) -> str:
    """Say what is missing, in one sentence; empty where nothing is."""
    missing = missing_of(found)
    return f"no test after ISO 230-2: {'; '.join(missing)}" if missing else ""
