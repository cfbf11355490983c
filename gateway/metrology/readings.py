"""Readings of an instrument, the facts in its file, and which readings belong together.

A file of ``pitch-gateway measure`` says ``# compensation: off``, or ``active`` with the SHA-256 of the active
table; a person may write ``off`` or ``on``. Without this line nothing is assumed.
"""

import re
from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import inf, isfinite
from statistics import fmean, median
from typing import Final, NamedTuple

from gateway.compensation.direction import Direction
from gateway.compensation.units import MM_PER_INCH, Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.standard import Standard

NEAR: Final = 0.01
"""Targets closer than this share of the usual distance are one target in two spellings; with several files it
is the distance of the finest."""
APPROACHES = (Direction.FORWARD, Direction.BACKWARD)
COMPENSATION: Final = "compensation"
STATED: Final = (COMPENSATION, "axis")
"""The facts that are evaluated, in lower case."""
_OFF: Final = ("off", "none", "no", "without")
_ON: Final = ("on", "active", "yes", "with")
_DIGEST: Final = re.compile(r"\b[0-9a-f]{64}\b")


@dataclass(frozen=True, slots=True)
class Reading:
    """One stop at a target, and the position of the nut by the instrument: in machine units, from one zero.

    ``run`` counts the passes over the targets, from 1; each direction has its own count. ``block`` is the
    nominal length of the gauge block between the instrument and its stop, included in ``measured``; below 0
    if that gap closes while the axis moves forward.
    """

    target: float
    direction: Direction
    measured: float
    run: int = 1
    temperature_c: float | None = None
    """Of the screw or the machine at the time of the reading; None if unknown."""
    block: float = 0.0

    @property
    def deviation(self) -> float:
        """Measured less target: positive if the nut went too far (ISO 230-2 clause 3)."""
        return self.measured - self.target


@dataclass(frozen=True, slots=True)
class Survey:
    """All readings of one axis in one set-up, in the order of measurement.

    ``facts`` are the other data in the instrument's file: machine, serial number, date, temperature, by the
    names in the file. ``source`` is the file, or what took the readings. ``remarks`` name what is odd about
    the readings but does not prevent their use, with a remedy.

    With a ``standard`` the readings are differences: each run is one placement of the instrument and its
    stop, with its own unknown zero (:mod:`gateway.metrology.differences`).
    """

    readings: tuple[Reading, ...]
    units: Units
    axis: str | None = None
    source: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    standard: Standard | None = None

    @property
    def targets(self) -> list[float]:
        """Every target once, in ascending order."""
        return sorted({each.target for each in self.readings})

    @property
    def span(self) -> float:
        """From the lowest target to the highest."""
        targets = self.targets
        return targets[-1] - targets[0]

    def in_units(self, units: Units) -> "Survey":
        """Return the same readings in other units.

        Raises:
            ValueError: between a length and an angle.
        """
        if units is self.units:
            return self
        factor = self.units.convert_factor(units)
        readings = (
            replace(
                each,
                target=each.target * factor,
                measured=each.measured * factor,
                block=each.block * factor,
            )
            for each in self.readings
        )
        return replace(self, readings=tuple(readings), units=units)


class Small(NamedTuple):
    """``factor`` converts a length in units of the axis to this one; ``key`` is its name in plain data."""

    name: str
    key: str
    factor: float

    def text(self, length: float) -> str:
        """Return the text of a length with its unit.

        >>> small_unit(Units.MM).text(0.00123)
        '1.23 µm'
        """
        return f"{length * self.factor:.2f} {self.name}"


_SMALL: Final = {
    Units.MM: Small("µm", "um", 1000.0),
    Units.INCH: Small("µm", "um", MM_PER_INCH * 1000.0),
    Units.DEGREE: Small("arcsec", "arcsec", 3600.0),
}


def small_unit(units: Units) -> Small:
    """Return the small unit of an axis."""
    return _SMALL[units]


@dataclass(frozen=True, slots=True)
class MeanCorrections:
    """Corrections at the measured targets, lowest target first; None where a direction has no reading."""

    targets: tuple[float, ...]
    forward: tuple[float | None, ...]
    backward: tuple[float | None, ...]


def mean_corrections(readings: Iterable[Reading]) -> MeanCorrections:
    """Return the mean of ``target - measured`` at each target, for each direction of approach.

    Raises:
        ReadingsError: no readings, a number that is not finite, or a reading without a direction.
    """
    groups = checked_approaches(readings)
    found = {key: fmean(each.target - each.measured for each in group) for key, group in groups.items()}
    targets = tuple(sorted({target for target, _ in found}))
    forward, backward = (tuple(found.get((target, way)) for target in targets) for way in APPROACHES)
    return MeanCorrections(targets, forward, backward)


def by_approach(readings: Iterable[Reading]) -> dict[tuple[float, Direction], list[Reading]]:
    """Return the readings at each target in each direction, in their order."""
    found: dict[tuple[float, Direction], list[Reading]] = {}
    for each in readings:
        found.setdefault((each.target, each.direction), []).append(each)
    return found


def checked_approaches(readings: Iterable[Reading]) -> dict[tuple[float, Direction], list[Reading]]:
    """Return the result of :func:`by_approach` after checking the readings.

    Raises:
        ReadingsError: no readings, a number that is not finite, or a reading without a direction.
    """
    all_readings = tuple(readings)
    for number, reading in enumerate(all_readings, start=1):
        check_reading(reading, number)
    if not all_readings:
        raise ReadingsError("no readings: measure every target from both sides")
    return by_approach(all_readings)


def check_reading(reading: Reading, number: int) -> None:
    """Check one reading; ``number`` counts from 1.

    Raises:
        ReadingsError: a number that is not finite, or no direction.
    """
    if not isfinite(reading.target) or not isfinite(reading.measured):
        raise ReadingsError(
            f"reading {number}: target {reading.target}, measured {reading.measured}: "
            "both must be finite numbers"
        )
    if reading.direction not in APPROACHES:
        raise ReadingsError(
            f"reading {number} at {reading.target:.9g}: direction {reading.direction.name.lower()}; "
            "it must be forward or backward, as the target was approached"
        )


def understood(survey: Survey) -> str:
    """Return axis, unit, targets, runs of each direction, and the sign by its largest deviations."""
    small = small_unit(survey.units)
    targets = survey.targets
    if survey.standard is not None:
        axis = f"axis {survey.axis}" if survey.axis else "an axis without a name"
        return (
            f"{survey.source}: {axis}, {survey.units.value}, {len({each.run for each in survey.readings})} "
            f"placements of a block, {survey.standard.describe()}, from {targets[0]:.9g} to {targets[-1]:.9g}"
        )
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


# --- Several surveys of one axis


def merged(surveys: Sequence[Survey]) -> Survey:
    """Return several surveys of one axis as one; the runs of each continue the count of those before.

    Raises:
        ReadingsError: no survey, other units, another axis, with a table and without, or one target in two
            spellings.
    """
    if not surveys:
        raise ReadingsError("no readings: name at least one file")
    first, *others = surveys
    readings = list(first.readings)
    usual = _usual_distance(first)
    for other in others:
        for what, one, two, is_same in (
            ("units", first.units.value, other.units.value, first.units is other.units),
            ("axis", first.axis, other.axis, is_same_axis(first.axis, other.axis)),
            ("block", _block(first), _block(other), first.standard == other.standard),
        ):
            if not is_same:
                raise ReadingsError(
                    f"{first.source} is of {what} {one}, {other.source} of {what} {two}: give only "
                    "readings of one axis in one unit together, and by one block"
                )
        check_together(first.source, first.facts, other.source, other.facts)
        # A fine run of two revolutions may be beside a grid: its targets are closer than those of the grid.
        usual = min(usual, _usual_distance(other))
        if first.standard is None:
            _check_targets(readings, other, NEAR * usual)
        runs = max((reading.run for reading in readings), default=0)
        readings.extend(replace(reading, run=reading.run + runs) for reading in other.readings)
    return replace(
        first,
        readings=tuple(readings),
        axis=next((survey.axis for survey in surveys if survey.axis is not None), None),
        source=", ".join(survey.source for survey in surveys),
        facts={key: fact for survey in reversed(surveys) for key, fact in survey.facts.items()},
        remarks=(*(remark for survey in surveys for remark in survey.remarks), *_doubled(surveys)),
    )


def _block(survey: Survey) -> str:
    return "none" if survey.standard is None else survey.standard.describe()


def _usual_distance(survey: Survey) -> float:
    """Return the median distance of neighbouring targets; infinity with one target."""
    targets = survey.targets
    return median([high - low for low, high in pairwise(targets)] or [inf])


def _check_targets(readings: Sequence[Reading], other: Survey, nearer: float) -> None:
    """Check that no target of a further survey repeats an earlier one in another spelling.

    Raises:
        ReadingsError: two are closer than ``nearer``.
    """
    targets = sorted({reading.target for reading in readings})
    for spelt in other.targets:
        at = bisect_left(targets, spelt)
        for near in targets[max(at - 1, 0) : at + 1]:
            if 0.0 < abs(near - spelt) < nearer < inf:
                raise ReadingsError(
                    f"{other.source} has target {spelt:.9g}, but the files before have {near:.9g}: use the "
                    "same number for one target in all files"
                )


def _doubled(surveys: Sequence[Survey]) -> list[str]:
    return [
        f"{other.source}: the same readings as {one.source}: if this is one measurement, name it only "
        "once, or its scatter looks smaller than it is"
        for index, other in enumerate(surveys)
        for one in surveys[:index]
        if one.readings == other.readings
    ]


# --- Evaluated facts: the axis of the readings, and whether a table was in use


def was_corrected(facts: Mapping[str, str]) -> bool | None:
    """Whether a table was in use; None if the facts do not say.

    >>> [was_corrected({"compensation": said}) for said in ("off", "on, table 3", "?")]
    [False, True, None]
    """
    word = re.match(r"[a-z]*", facts.get(COMPENSATION, "").strip().lower())
    if word is None or word[0] not in (*_OFF, *_ON):
        return None
    return word[0] in _ON


def table_digest(facts: Mapping[str, str]) -> str | None:
    """Return the SHA-256 of the table in use, None if the facts do not say."""
    found = _DIGEST.search(facts.get(COMPENSATION, "").lower())
    return found[0] if found else None


def is_same_axis(one: str | None, other: str | None) -> bool:
    """Whether two names may be of one axis; only letters are compared, a longer name is free text.

    >>> is_same_axis("x", "X"), is_same_axis("x", None), is_same_axis("x", "y"), is_same_axis("x", "X-axis")
    (True, True, False, True)
    """
    if not one or not other or len(one) != 1 or len(other) != 1:
        return True
    return one.casefold() == other.casefold()


def check_same_axis(name: str, axis: str | None, other: str, other_axis: str | None) -> None:
    """Check that two files are of one axis. Raises ReadingsError."""
    if not is_same_axis(axis, other_axis):
        raise ReadingsError(
            f"{name} is of axis {axis}, {other} of axis {other_axis}: give two files of one axis, or "
            "correct the line in the file that names the wrong one"
        )


def check_uncorrected(name: str, facts: Mapping[str, str], instead: str) -> None:
    """Check that readings show the whole error of an axis; ``instead`` is the remedy for others.

    Raises:
        ReadingsError: a table was in use.
    """
    if was_corrected(facts):
        raise ReadingsError(
            f"{name}: measured with an active table (# {COMPENSATION}: {facts[COMPENSATION]}), so it shows "
            f"the remaining error, not the error of the axis: {instead}; or correct that line if it is "
            "wrong"
        )


def check_corrected(name: str, facts: Mapping[str, str], table: str, digest: str) -> None:
    """Check that readings show what a table left of the error.

    Raises:
        ReadingsError: no table was in use, or another one.
    """
    if was_corrected(facts) is False:
        raise ReadingsError(
            f"{name}: measured without a table (# {COMPENSATION}: {facts[COMPENSATION]}), so it shows the "
            f"whole error, and with {table} the error would be corrected twice: make a table from these "
            "readings with table build; or correct that line if it is wrong"
        )
    stated = table_digest(facts)
    if stated is not None and stated != digest:
        raise ReadingsError(
            f"{name}: measured with the table of SHA-256 {stated[:12]}…, but {table} has {digest[:12]}…: "
            "give the unchanged table that was active; or remove that line if it is the same table in "
            "another file"
        )


def check_together(name: str, facts: Mapping[str, str], other: str, other_facts: Mapping[str, str]) -> None:
    """Check that readings of two files can be averaged.

    Raises:
        ReadingsError: one was measured with a table, the other without or with another one.
    """
    one, two = was_corrected(facts), was_corrected(other_facts)
    digests = table_digest(facts), table_digest(other_facts)
    if (one is not None and two is not None and one is not two) or (
        all(digests) and digests[0] != digests[1]
    ):
        raise ReadingsError(
            f"{name} was measured with {COMPENSATION} {facts[COMPENSATION]}, {other} with "
            f"{other_facts[COMPENSATION]}, so their readings have no common mean: give them separately"
        )
