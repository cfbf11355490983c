"""The whole way from readings to a table, with all information for the user."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from gateway.compensation.errors import TableError
from gateway.compensation.table import CorrectionTable
from gateway.metrology.build import (
    Fit,
    HomeCase,
    HomeReference,
    Recipe,
    Shape,
    build_table,
    referenced,
    with_estimated_ends,
)
from gateway.metrology.doubts import plausibility_warnings
from gateway.metrology.errors import ReadingsError
from gateway.metrology.lead import Period
from gateway.metrology.outliers import Outlier, find_outliers, without_outliers
from gateway.metrology.readings import APPROACHES, Reading, Survey, mean_corrections
from gateway.metrology.resample import fewest_points, on_grid, smoothed, with_point
from gateway.metrology.tables import Change, ResamplingLoss
from gateway.metrology.wrong_runs import settled

if TYPE_CHECKING:
    from gateway.metrology.fitting import FitEvidence
    from gateway.metrology.screw import MeasuredScrew

__all__ = ["Built", "Recipe", "build_from", "from_one_zero"]

STEP_TOLERANCE: Final = 1e-6
"""Share of a step by which targets may differ from an even grid and still count as one."""


@dataclass(frozen=True, slots=True)
class Built:
    """A table and how it was made; ``notes`` describe this in sentences."""

    table: CorrectionTable
    outliers: tuple[Outlier, ...]
    home: HomeReference | None
    change: Change | None
    """By smoothing."""
    loss: ResamplingLoss | None
    """By other points."""
    notes: tuple[str, ...]
    screw: "MeasuredScrew | None" = None
    """What the readings show between the targets; None if not requested, or with too few readings."""
    evidence: "FitEvidence | None" = None
    """Why the table has this curve; None if there was no choice."""


def from_one_zero(
    survey: Survey, periods: tuple[Period, ...], *, drop: bool = False
) -> "tuple[Survey, MeasuredScrew | None]":
    """Return readings from one zero; differences are joined, and their curves are the second result.

    Runs that are wrong as a whole, and placements that slipped, are omitted with ``drop``.

    Raises:
        ReadingsError: see :func:`gateway.metrology.wrong_runs.settled` and
            :func:`gateway.metrology.differences.joined`.
    """
    if survey.standard is None:
        return settled(survey, drop=drop), None
    from gateway.metrology.differences import joined

    found = joined(survey, periods, drop=drop)
    return found.survey, found.screw


def build_from(survey: Survey, recipe: Recipe, screw: "MeasuredScrew | None" = None) -> Built:
    """Make a table from readings; ``screw``: their curves, if they were joined from differences.

    In this order: refuse runs that are wrong as a whole, find outliers (both are dropped if requested), take
    the mean at each target and in each direction, estimate turn-around points, smooth the curves, choose the
    points. Last, the correction at home is subtracted, so that it is 0 there whatever came before.

    Raises:
        ReadingsError: readings or a recipe that make no table.
        TableError: corrections that are not allowed in a table (a slope of 1).
    """
    _check(recipe)
    unit = survey.units.value
    survey, remarks = _with_home(settled(survey, drop=recipe.drop_outliers), recipe)
    outliers = find_outliers(survey)
    readings, emptied = without_outliers(survey, outliers) if recipe.drop_outliers else (survey.readings, ())
    done = "left out" if recipe.drop_outliers else "kept; table build --drop-outliers leaves it out"
    notes = [*survey.remarks, *remarks, *(f"outlier, {done}: {each.describe(unit)}" for each in outliers)]
    notes.extend(
        f"{target:.9g}: left out in both directions, because the outlier was the only reading in one of them"
        for target in emptied
    )
    try:
        table = build_table(
            readings, survey.units, estimate_ends=recipe.estimate_ends, one_way=recipe.one_way
        )
    except (ReadingsError, TableError) as error:
        raise type(error)(f"{survey.source}: {error}" if survey.source else str(error)) from None
    notes.extend(plausibility_warnings(readings, survey.units))
    if recipe.estimate_ends and not recipe.one_way:
        notes.extend(_estimated(Survey(readings, survey.units)))
    change = None
    if recipe.smooth is not None:
        table, change = smoothed(table, recipe.smooth)
        notes.append(
            f"smoothed over {recipe.smooth:g} {unit}: changed by {change.rms:.3g} {unit} (root mean "
            f"square), by at most {change.largest:.3g}, {change.direction.name.lower()} at "
            f"{change.position:.9g}"
        )
    home = recipe.reference(table)
    measured = table
    table, loss = _with_points(table, recipe, home)
    if screw is None:
        screw = _screw(readings, survey, recipe, notes)
    evidence = None
    if screw is not None and recipe.fit is not None:
        evidence = _choose(screw, table, recipe)
        notes.extend(evidence.warnings)
        notes.extend(evidence.described(survey.units, "table"))
        if evidence.chosen.table is not table:
            table, loss = evidence.chosen.table, None
            notes.extend(_uncovered(measured, table, recipe.widen) if recipe.step is not None else ())
    if loss is not None:
        notes.append(
            f"{len(table.positions)} points instead of {len(measured.positions)}: the largest loss is "
            f"{loss.size:.3g} {unit}, {loss.direction.name.lower()} at {loss.position:.9g}"
        )
        notes.extend(_uncovered(measured, table, recipe.widen))
    home = recipe.reference(table)
    if home is None:
        notes.append("no home reference: the corrections are 0 where the instrument was zeroed")
    else:
        table = referenced(table, home)
        way = home.direction.name.lower()
        notes.append(f"home: the {way} correction at {home.position:.9g} is 0")
    return Built(table, outliers, home, change, loss, tuple(notes), screw, evidence)


def _with_home(survey: Survey, recipe: Recipe) -> tuple[Survey, list[str]]:
    """Add the row of home to readings of one direction, if only that row at the switch is missing.

    A sheet of TB058's version 7.17 begins one step from home, where the instrument was set to 0.
    """
    targets = survey.targets
    ways = {reading.direction for reading in survey.readings}
    if recipe.home not in (HomeCase.SWITCH_POSITIVE, HomeCase.SWITCH_NEGATIVE) or len(ways) != 1:
        return survey, []
    first, step = min(targets, key=abs), (targets[-1] - targets[0]) / max(1, len(targets) - 1)
    is_even = all(abs(x - targets[0] - n * step) <= STEP_TOLERANCE * step for n, x in enumerate(targets))
    outward = 1.0 if recipe.home is HomeCase.SWITCH_POSITIVE else -1.0
    if not is_even or not step or abs(first - outward * step) > STEP_TOLERANCE * step:
        return survey, []
    [way] = ways
    runs = sorted({reading.run for reading in survey.readings})
    at_home = tuple(Reading(0.0, way, 0.0, run) for run in runs)
    note = (
        f"no row at home: home is 0, one step from {first:.9g}. Its correction is 0 by definition, because "
        "the instrument was set to 0 there; remove --home if it was set to 0 elsewhere"
    )
    return replace(survey, readings=(*at_home, *survey.readings)), [note]


def _screw(
    readings: Sequence[Reading], survey: Survey, recipe: Recipe, notes: list[str]
) -> "MeasuredScrew | None":
    if recipe.fit is None:
        return None
    from gateway.metrology.screw import screw_of

    try:
        return screw_of(readings, survey.units, recipe.periods)
    except ReadingsError as error:
        if recipe.fit in (Fit.SMOOTH, Fit.HARMONICS):
            raise ReadingsError(f"{survey.source}: {error}" if survey.source else str(error)) from None
        notes.append(f"{error}: the error that this table leaves between its points is unknown")
        return None


def _choose(screw: "MeasuredScrew", table: CorrectionTable, recipe: Recipe) -> "FitEvidence":
    """Choose the curve.

    Raises:
        ReadingsError: harmonics without a period that the targets show.
    """
    from gateway.metrology.fitting import choose, warnings_of

    if recipe.fit is Fit.HARMONICS and Shape.HARMONICS not in screw.shapes:
        why = "; ".join(warnings_of(screw)) if screw.aliased else "give the lead of the screw: --lead"
        raise ReadingsError(f"harmonics: nothing to fit: {why}")
    return choose(screw, table, recipe)


def _check(recipe: Recipe) -> None:
    """Refuse a recipe that contradicts itself."""
    if recipe.step is not None and recipe.tolerance is not None:
        raise ReadingsError("give a step (even grid) or a tolerance (fewest points), not both")
    if recipe.travel is not None and recipe.step is None:
        raise ReadingsError(
            "travel without step: give --step as well, or remove --travel: only an even grid covers the "
            "travel"
        )
    if recipe.travel is not None and not recipe.travel[0] < recipe.travel[1]:
        raise ReadingsError(
            f"a travel from {recipe.travel[0]:g} to {recipe.travel[1]:g}: the lower end first, then the upper"
        )


def _with_points(
    table: CorrectionTable, recipe: Recipe, home: HomeReference | None
) -> tuple[CorrectionTable, ResamplingLoss | None]:
    if recipe.step is not None:
        return on_grid(table, recipe.step, recipe.travel)
    if recipe.tolerance is None:
        return table, None
    if home is None:
        return fewest_points(table, recipe.tolerance)
    # Home becomes 0 at the end: a loss there would shift the whole table, and add the loss everywhere.
    return fewest_points(with_point(table, home.position), recipe.tolerance, keep=[home.position])


def _estimated(survey: Survey) -> list[str]:
    means = mean_corrections(survey.readings)
    filled = with_estimated_ends(means)
    return [
        f"{way.name.lower()} at {target:.9g}: not measured (the axis reverses there); estimated from the "
        f"reversal of its neighbour, {new:+.6g} {survey.units.value} before the home reference"
        for way, olds, news in zip(
            APPROACHES, (means.forward, means.backward), (filled.forward, filled.backward), strict=True
        )
        for target, old, new in zip(means.targets, olds, news, strict=True)
        if old is None and new is not None
    ]


def _uncovered(measured: CorrectionTable, table: CorrectionTable, widen: str) -> list[str]:
    unit = table.units.value
    return [
        f"measured from {low:.9g} to {high:.9g} {unit}, but the table does not cover this, because no "
        f"multiple of the step is there: {widen}"
        for low, high in ((measured.first, table.first), (table.last, measured.last))
        if high > low
    ] + [
        f"no reading from {low:.9g} to {high:.9g} {unit}: the correction of the nearest target is held there"
        for low, high in ((table.first, measured.first), (measured.last, table.last))
        if high > low
    ]
