"""Errors that repeat along a screw (lead, gear and motor revolutions), and whether targets can show them.

An error that repeats with each revolution looks the same at targets that are whole revolutions apart: it is
aliased, and no calculation finds it. It shows at targets that meet all angles of the revolution: random ones,
or a fine run over two revolutions.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import ceil, cos, hypot, isfinite, pi, sin, sqrt
from statistics import fmean, median
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError

HARMONICS: Final = (1, 2)
"""Of the lead: once a revolution (a bent or drunken screw), twice (thrust bearing, coupling)."""
NEAR_MULTIPLE: Final = 0.1
"""Of a revolution: distances this close to whole revolutions meet the same angle again."""
SLOW: Final = 0.25
"""Of a revolution. If a grid step is this close to whole revolutions, the error looks like a wave of four or
more steps. It can only be distinguished from such a wave while it is the same all along the screw."""
SAME_ANGLES: Final = 0.8
"""A period is aliased if at least this share of the distances are near multiples of it."""
NARROW: Final = 0.9
"""Mean of the angles as vectors. Above it the angles are in one part of the revolution. The targets then show
so little of the repeating error that the result would be less than two thirds of it."""
SHORTEST_MM: Final = 2.0
"""Without a given lead: the shortest assumed length of a revolution."""
LEAST_EVEN: Final = 3
"""Fewer targets are not a grid."""
RESOLVED: Final = 0.4
"""Of a revolution: targets this close to each other over a full revolution show what repeats with it."""
FINE_POINTS: Final = 8
"""Points in a revolution, in a fine run."""
FINE_TURNS: Final = 2


@dataclass(frozen=True, slots=True)
class Period:
    """A possible period of an error, and the part that turns once in it."""

    length: float
    name: str


def periods_of(lead: float | None, lengths: Iterable[float] = ()) -> tuple[Period, ...]:
    """Return the possible periods: one and half a revolution of the screw, and each further given length.

    Raises:
        ReadingsError: a lead or another period that is not a valid length.

    >>> [(each.length, each.name) for each in periods_of(5.0, [1.25])]
    [(5.0, 'lead 5'), (2.5, 'half of lead 5'), (1.25, 'period 1.25')]
    """
    found = {}
    if lead is not None:
        _check("lead", lead)
        found[lead] = Period(lead, f"lead {lead:g}")
        found[lead / 2] = Period(lead / 2, f"half of lead {lead:g}")
    for period in lengths:
        _check("period", period)
        found.setdefault(period, Period(period, f"period {period:g}"))
    return tuple(found.values())


def longest(periods: Iterable[Period]) -> float | None:
    """Return the longest length; None without a period."""
    return max((each.length for each in periods), default=None)


def _check(what: str, length: float) -> None:
    if not (isfinite(length) and length > 0.0):
        raise ReadingsError(f"{what} {length:g}: it must be a length above 0, in the units of the readings")


def is_aliased(targets: Sequence[float], period: float) -> bool:
    """Whether targets meet an error of this period at the same angle, or so nearly that it looks slow.

    >>> [is_aliased([0, step, 2 * step, 3 * step], 5.0) for step in (10, 10.1, 4)]
    [True, True, False]
    """
    turns = [(high - low) / period for low, high in pairwise(targets)]
    if _is_resolved(turns):
        return False
    near = sum(
        periods_apart > 0.5 and abs(periods_apart - round(periods_apart)) < NEAR_MULTIPLE
        for periods_apart in turns
    )
    return _narrowness(targets, period) > NARROW or near >= SAME_ANGLES * len(turns)


def _narrowness(positions: Sequence[float], period: float) -> float:
    """Return the mean of the angles as vectors: 1 if all are equal, near 0 if they are spread."""
    angles = [2 * pi * position / period for position in positions]
    return hypot(sum(map(cos, angles)), sum(map(sin, angles))) / len(angles)


def _is_resolved(turns: Iterable[float]) -> bool:
    """Whether successive distances, in revolutions, are small enough over a full revolution.

    >>> _is_resolved([2.0, 2.0, *[0.125] * 16, 2.0]), _is_resolved([0.4, 0.4, 2.0, 0.4, 0.4])
    (True, False)
    """
    reach = 0.0
    for periods_apart in turns:
        reach = reach + periods_apart if periods_apart <= RESOLVED else 0.0
        if reach >= 1.0:
            return True
    return False


def shown_by(
    targets: Sequence[float], periods: Iterable[Period]
) -> tuple[tuple[Period, ...], tuple[Period, ...]]:
    """Return the periods that the targets can show, and the aliased ones."""
    given = list(periods)
    aliased = tuple(each for each in given if is_aliased(targets, each.length))
    return tuple(each for each in given if each not in aliased), aliased


def even_step(targets: Sequence[float]) -> float | None:
    """Return the distance of targets on an even grid; None if they are not on one."""
    gaps = [high - low for low, high in pairwise(targets)]
    if not gaps or max(gaps) - min(gaps) > 1e-3 * max(gaps):
        return None
    return sum(gaps) / len(gaps)


def _grid(targets: Sequence[float]) -> tuple[float, list[float]]:
    """Return the step of the nearest even grid, and the distance of each target from it.

    Some grid positions may have no target.

    >>> step, moved = _grid([0.0, 10.2, 19.8, 40.0])
    >>> round(step, 3), [round(each, 2) for each in moved]
    (9.977, [-0.04, 0.18, -0.19, 0.05])
    """
    gaps = [high - low for low, high in pairwise(targets)]
    usual = median(gaps)
    counts = [0, *accumulate(max(round(gap / usual), 1) for gap in gaps)]
    middle, mean = fmean(counts), fmean(targets)
    step = sum((k - middle) * (x - mean) for k, x in zip(counts, targets, strict=True)) / sum(
        (k - middle) ** 2 for k in counts
    )
    return step, [x - mean - step * (k - middle) for k, x in zip(counts, targets, strict=True)]


def looks_slow(targets: Sequence[float], period: float) -> bool:
    """Whether targets on an even grid, or nearly on one, show an error of this period as a slower wave.

    >>> [looks_slow([0, step, 2 * step, 3 * step], 5.0) for step in (6, 7, 2.5)]
    [True, False, False]
    >>> looks_slow([0.0, 6.1, 11.9, 24.0], 5.0)
    True
    """
    if len(targets) < LEAST_EVEN or _is_resolved((high - low) / period for low, high in pairwise(targets)):
        return False
    step, moved = _grid(targets)
    periods_apart = step / period
    return (
        periods_apart > 0.5
        and abs(periods_apart - round(periods_apart)) <= SLOW
        and _narrowness(moved, period) > NARROW
    )


def unseen(targets: Sequence[float], periods: Iterable[Period], units: Units) -> tuple[Period, ...]:
    """Return the periods that look like a slower curve: of the given ones, and of the step of a grid.

    On an even grid an error that repeats with the step looks the same at each target, whatever periods are
    given. With given periods, none slower is assumed. A fine run beside the grid shows the error. A fine grid
    hides nothing if only periods that no screw has look slow on it.

    >>> [each.name for each in unseen([0.0, 20.0, 40.0, 60.0], (), Units.MM)]
    ['the step of 20 and its whole fractions']
    >>> [each.name for each in unseen([0.0, 10.0, 20.0, 30.0], [Period(40.0, "lead 40")], Units.MM)]
    ['the step of 10 and its whole fractions']
    >>> unseen([0.0, 1.5, 3.0, 4.5], (), Units.MM)
    ()
    """
    given = tuple(periods)
    hidden = tuple(
        each
        for each in given
        if is_aliased(targets, each.length)
        or looks_slow(targets, each.length)
        or meets_two_angles(targets, each.length)
    )
    return hidden + _of_the_step(targets, given, units)


def _of_the_step(targets: Sequence[float], given: Sequence[Period], units: Units) -> tuple[Period, ...]:
    """Return the step of the targets' grid, if they have one and nothing else shows what it hides."""
    if len(targets) < LEAST_EVEN:
        return ()
    step, moved = _grid(targets)
    if _is_fine(step, units):
        return ()
    longest = step
    if given:
        longest = step / ceil(step / max(each.length for each in given) - 1e-9)
    is_shown = _is_resolved((high - low) / longest for low, high in pairwise(targets))
    if is_shown or _narrowness(moved, longest) <= NARROW:
        return ()
    return (Period(step, f"the step of {step:.6g} and its whole fractions"),)


def meets_two_angles(targets: Sequence[float], period: float) -> bool:
    """Whether targets meet only two opposite angles of a period, and so show only its sine or its cosine.

    >>> [meets_two_angles([0, step, 2 * step, 3 * step], 20.0) for step in (10, 30, 12, 4)]
    [True, True, False, False]
    """
    if len(targets) < LEAST_EVEN or _is_resolved((high - low) / period for low, high in pairwise(targets)):
        return False
    return _narrowness(targets, period / 2) > NARROW >= _narrowness(targets, period)


def _is_fine(step: float, units: Units) -> bool:
    """Whether only periods that no screw has look slow on such a grid."""
    return units is not Units.DEGREE and step <= (1.0 - SLOW) * units.from_mm(SHORTEST_MM)


def may_be_more(targets: Sequence[float], periods: Iterable[Period], units: Units) -> float:
    """Return the factor by which the error may exceed its estimate without a given lead; 1 with one.

    Of a period as long as the grid step, targets near the grid show the share by which its angles differ.

    >>> round(may_be_more([0.0, 23.0, 38.0, 62.0, 79.0], (), Units.MM), 2)
    1.85
    """
    if tuple(periods) or len(targets) < LEAST_EVEN:
        return 1.0
    step, moved = _grid(targets)
    if _is_fine(step, units):
        return 1.0
    return 1.0 / sqrt(max(1.0 - _narrowness(moved, step) ** 2, 1e-6))


def fine_run(targets: Sequence[float], lead: float) -> tuple[float, float, float]:
    """Return where to measure two revolutions, and in which steps: in the middle, away from other ends.

    >>> fine_run([0, 100, 200, 300, 400], 5.0)
    (200, 210.0, 0.625)
    """
    low, high = targets[0], targets[-1]
    start = min(targets, key=lambda target: abs(target - (low + high) / 2))
    if start + FINE_TURNS * lead > high:
        start = low
    return start, start + FINE_TURNS * lead, lead / FINE_POINTS


def aliased_warning(targets: Sequence[float], aliased: Sequence[Period], unit: str) -> str:
    """Return that an error was not seen, and what to measure to see it."""
    longest = max(aliased, key=lambda each: each.length)
    names = " and ".join(each.name for each in aliased)
    step = even_step(targets)
    where = f"the targets are {step:.6g} {unit} apart" if step else "nearly all distances of the targets are"
    how = "a multiple, or near one, of" if step else "whole turns of"
    low, high, fine = fine_run(targets, longest.length)
    return (
        f"{where}, {how} {names}: an error that repeats with this length is equal at all targets and was "
        f"not seen (aliasing). Measure two turns finely, with --from {low:.9g} --to {high:.9g} --step "
        f"{fine:.6g}, and give both files; or use random targets with --spread {longest.length:g}"
    )


def slow_warning(targets: Sequence[float], slow: Sequence[Period], unit: str) -> str:
    """Return which wave an error looks like, and what to measure instead."""
    step, _ = _grid(targets)
    looks = []
    for each in slow:
        periods_apart = step / each.length
        looks.append(f"{each.name} like one of {step / abs(periods_apart - round(periods_apart)):.4g} {unit}")
    spread = max(each.length for each in slow)
    return (
        f"use random targets with --spread {spread:g}: with targets {_about(targets, step)} {unit} apart "
        f"an error that repeats looks like a slower wave, {' and '.join(looks)}. The two can be separated "
        "only if the error is the same along the whole screw"
    )


def _about(targets: Sequence[float], step: float) -> str:
    return f"{step:.6g}" if even_step(targets) else f"about {step:.4g}"


def lead_warnings(targets: Sequence[float], periods: Iterable[Period], units: Units) -> list[str]:
    """Return warnings about given periods that targets will not show, and about the step without any."""
    given, unit = tuple(periods), units.value
    hidden = unseen(targets, given, units)
    aliased = shown_by(targets, given)[1]
    if aliased:
        return [aliased_warning(targets, aliased, unit)]
    slow = [each for each in hidden if each in given]
    if slow:
        return [slow_warning(targets, slow, unit)]
    return [step_warning(targets, each.length, unit, is_given=bool(given)) for each in hidden]


def step_warning(targets: Sequence[float], step: float, unit: str, *, is_given: bool) -> str:
    """Return which errors a grid does not show, and the remedy; ``is_given``: a lead is given."""
    remedy = f"Use random targets with --spread {step:.6g}"
    if not is_given:
        remedy += ", and give the lead of the screw: --lead"
    return (
        f"the targets are {_about(targets, step)} {unit} apart: an error that repeats every {step:.6g}, "
        f"{step / 2:.6g}, {step / 3:.6g}… {unit} is equal at all targets and was not seen. {remedy}"
    )
