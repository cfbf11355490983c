"""A better table, from readings taken with the old one in use: new = old + (nominal - measured)."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from statistics import pstdev
from typing import TYPE_CHECKING, Final

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.metrology.build import Fit, HomeReference, Recipe, Refusal, build_table, referenced
from gateway.metrology.errors import ReadingsError
from gateway.metrology.lead import Period
from gateway.metrology.outliers import find_outliers
from gateway.metrology.readings import APPROACHES, Survey, was_corrected
from gateway.metrology.residue import LeftOut, predicted_residue
from gateway.metrology.tables import Change, change, correction_at
from gateway.metrology.wrong_runs import settled

if TYPE_CHECKING:
    from gateway.metrology.screw import MeasuredScrew

MOSTLY_GONE: Final = 1 / 3
"""Share of the scatter of all deviations: a table that would leave less was hardly in use."""
CLEARLY: Final = 1.25
"""A table gets new points only if the old ones would leave this many times as much."""
DONE: Final = 0.8
"""Share of what the old table left: if a new one leaves more, such readings bring no improvement."""
SAME_POSITION: Final = 1e-9
"""Of the longest position: two positions in different units that differ by less are equal."""


class Points(Enum):
    """The points of the new table."""

    UNION = "union"
    """Those of the old one and the targets of the readings."""
    TABLE = "table"
    """Those of the old one."""


@dataclass(frozen=True, slots=True)
class Refined:
    """The new table, its difference from the old one, and information for the user."""

    table: CorrectionTable
    change: Change
    notes: tuple[str, ...]
    left_out_before: LeftOut | None = None
    """E that the old table leaves between the targets, in the units of the readings; None: unknown."""
    left_out: LeftOut | None = None
    """The same of the new one."""
    screw: "MeasuredScrew | None" = None
    """The curves of the rest that the readings allow; None: not requested, or too few readings."""
    added: CorrectionTable | None = None
    """The new table less the old one, if there are such curves."""

    @property
    def units(self) -> Units:
        """Units of all of it."""
        return self.table.units


def refine_table(
    table: CorrectionTable,
    survey: Survey,
    *,
    home: HomeReference | None = None,
    points: Points = Points.TABLE,
    one_way: bool = False,
    fit: Fit | None = None,
    periods: tuple[Period, ...] = (),
    refusal: Refusal | None = None,
) -> Refined:
    """Add what is left of the error to the table that left it (TB058: "Always add the error").

    The rest is the mean of ``nominal - measured`` at each target and in each direction, straight between
    targets and constant beyond them, or along the curve that ``fit`` chooses. Turn-around points are
    estimated as in a first table. If harmonics leave clearly less than the points of the old table can
    follow, the new one gets points for them. With ``home`` the correction there does not change, whatever the
    readings say: it is the old table's reference. Refining can be repeated, each time with readings under the
    newest table.

    Args:
        table: the one in use during the measurement, in any unit of the same kind.
        survey: the readings, all with that table in use.
        home: where the correction must not change, in the units of the readings.
        points: the points of the new table.
        one_way: one curve for both directions, as in the old table.
        fit: the curve of the rest; None: lines, and no result for the range between the targets.
        periods: the possible periods of the rest.
        refusal: returns why a new table cannot be written; None: every one can be.

    Raises:
        ReadingsError: readings that make no table.
        TableError: corrections that are not allowed in a table.
        ValueError: between a length and an angle.
    """
    old = table.in_units(survey.units)
    survey = settled(survey)
    rest = build_table(survey.readings, survey.units, one_way=one_way)
    remarks: list[str] = []
    screw = None
    if fit is not None:
        rest, screw, remarks = _followed(survey, rest, fit, periods, one_way=one_way)
    new, more = _at_points(old, rest, points, screw, refusal)
    remarks += more
    if home is not None:
        new = _home_kept(new, old, home)
    unit = survey.units.value
    notes = [*survey.remarks, *_unmeasured(old, rest)]
    notes.extend(f"outlier, kept: {each.describe(unit)}" for each in find_outliers(survey))
    if was_corrected(survey.facts) is None and _looks_uncorrected(old, survey):
        notes.append(
            "use table build instead if these readings were taken WITHOUT the table: they look like it, "
            "because the table would remove most of their error. Then the new table would correct twice"
        )
    notes.extend(remarks)
    before = after = added = None
    if screw is not None:
        added = _less(new, old)
        before, after = screw.left_out(_less(old, old)), screw.left_out(added)
        if screw.leaves(added) > DONE * screw.leaves(_less(old, old)):
            notes.append(
                "give the lead (--lead), or measure more finely: another round at such targets does not "
                "help. The remaining error is the scatter of the readings, or shorter than the distance "
                "between the targets"
            )
    if home is None:
        notes.append("no home reference: the reading at home is in the table like any other reading")
    return Refined(new, change(old, new), tuple(notes), before, after, screw, added)


def _followed(
    survey: Survey, rest: CorrectionTable, fit: Fit, periods: tuple[Period, ...], *, one_way: bool
) -> "tuple[CorrectionTable, MeasuredScrew | None, list[str]]":
    """Return the rest along the curve that leaves least, the model of the screw, and the reasons."""
    from gateway.metrology.fitting import choose
    from gateway.metrology.screw import screw_of

    try:
        screw = screw_of(survey.readings, survey.units, periods)
    except ReadingsError as error:
        if fit in (Fit.SMOOTH, Fit.HARMONICS):
            raise
        return rest, None, [f"{error}: the error that this table leaves between its points is unknown"]
    evidence = choose(screw, rest, Recipe(fit=fit, one_way=one_way))
    return evidence.chosen.table, screw, [*evidence.warnings, *evidence.described(survey.units, "change")]


def _at_points(
    old: CorrectionTable,
    rest: CorrectionTable,
    points: Points,
    screw: "MeasuredScrew | None",
    refusal: Refusal | None,
) -> tuple[CorrectionTable, list[str]]:
    """Return the sum at the requested points, or at more if harmonics need them, and a sentence about it."""
    wide = _union(old.positions, rest.positions)
    new = _sum(old, rest, wide if points is Points.UNION else list(old.positions))
    if screw is None or points is Points.UNION:
        return new, []
    wider = _sum(old, rest, wide)
    leaves_clearly_less = screw.leaves(_less(wider, old)) * CLEARLY < screw.leaves(_less(new, old))
    if not leaves_clearly_less:
        return new, []
    refused = None if refusal is None else refusal(wider)
    if refused is not None:
        remarks = (
            "the points of the old table are too far apart for the error that repeats, and "
            f"{len(wider.positions)} points cannot be written: {refused}"
        )
        return new, [remarks]
    remarks = (
        f"{len(wider.positions)} points instead of {len(new.positions)}: those of the old table are too "
        "far apart for the error that repeats"
    )
    return wider, [remarks]


def _home_kept(new: CorrectionTable, old: CorrectionTable, home: HomeReference) -> CorrectionTable:
    """Return the new table with the correction at home of the old one."""
    was = correction_at(old, home.position, home.direction)
    new = referenced(new, home)
    forward, backward = ([c + was for c in curve] for curve in (new.forward, new.backward))
    return make_table(new.positions, forward, backward, new.units)


def _sum(old: CorrectionTable, rest: CorrectionTable, positions: list[float]) -> CorrectionTable:
    forward, backward = (
        [correction_at(old, x, way) + correction_at(rest, x, way) for x in positions] for way in APPROACHES
    )
    return make_table(positions, forward, backward, old.units)


def _less(new: CorrectionTable, old: CorrectionTable) -> CorrectionTable:
    """Return the difference of the new table from the old one."""
    positions = _union(list(new.positions), old.positions)
    forward, backward = (
        [correction_at(new, x, way) - correction_at(old, x, way) for x in positions] for way in APPROACHES
    )
    return make_table(positions, forward, backward, new.units)


def _looks_uncorrected(old: CorrectionTable, survey: Survey) -> bool:
    """Whether the readings look like the error from which the old table was made; an offset is ignored."""
    shown = [each.deviation for each in survey.readings]
    left = [each.deviation for each in predicted_residue(survey, old).readings]
    return pstdev(left) < pstdev(shown) * MOSTLY_GONE


def _union(points: Sequence[float], targets: Sequence[float]) -> list[float]:
    """Return both in order; a target within rounding of a point is that point."""
    nearer = SAME_POSITION * max(abs(position) for position in (*points, *targets))
    others = []
    for target in targets:
        index = bisect_left(points, target)
        if all(abs(target - near) > nearer for near in points[max(index - 1, 0) : index + 1]):
            others.append(target)
    return sorted([*points, *others])


def _unmeasured(old: CorrectionTable, rest: CorrectionTable) -> list[str]:
    unit = old.units.value
    return [
        f"no reading from {low:.9g} to {high:.9g} {unit}: the change at the nearest target continues there"
        for low, high in ((old.first, rest.first), (rest.last, old.last))
        if high > low
    ]
