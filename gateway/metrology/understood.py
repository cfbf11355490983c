"""What a reader has understood of readings, in one line, before anything is made of them."""

from gateway.metrology.deviation import small_unit
from gateway.metrology.readings import APPROACHES, Survey


def understood(survey: Survey) -> str:
    """Say axis, unit, targets, runs of each direction, and the sign by its largest deviations."""
    small = small_unit(survey.units)
    targets = sorted({each.target for each in survey.readings})
    deviations = [each.deviation * small.factor for each in survey.readings]
    runs = " and ".join(
        f"{len({each.run for each in survey.readings if each.direction is way})} {way.name.lower()}"
        for way in APPROACHES
    )
    axis = f"axis {survey.axis}" if survey.axis else "an axis without a name"
    return (
        f"{survey.source}: {axis}, {survey.units.value}, {len(targets)} targets from {targets[0]:.9g} to "
        f"{targets[-1]:.9g}, runs {runs}; deviations {min(deviations):+.4g} to {max(deviations):+.4g} "
        f"{small.name}, positive where the nut went too far"
    )
