"""What repeats along a screw: its lead, turns of gear and motor; and whether targets can show it.

An error that repeats with each turn looks the same at targets that lie whole turns apart: it is aliased, and
no calculation finds it. It shows at targets that meet all angles of the turn: random ones, or a fine run over
two turns.
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
"""Of the lead: once a turn (a bent or drunken screw), twice a turn (thrust bearing, coupling)."""
NEAR_MULTIPLE: Final = 0.1
"""Of a turn: distances that are whole turns but for so much meet the same angle again."""
SLOW: Final = 0.25
"""Of a turn: on an even grid an error that is so near to whole turns a step looks like a wave of four steps
and more. As long as it is the same all along the screw it is told from one, no longer."""
SAME_ANGLES: Final = 0.8
"""Share of the distances that are near multiples, from which on a period is aliased."""
NARROW: Final = 0.9
"""Mean of the angles as vectors: above it they lie in one place of the turn, and of what repeats with it so
little is seen that less than two thirds would be said to be there."""
SHORTEST_MM: Final = 2.0
"""Where no lead is told: what turns is taken to do so once in this length or in a longer one."""
LEAST_EVEN: Final = 3
"""Fewer targets are no grid."""
RESOLVED: Final = 0.4
"""Of a turn: targets that follow each other so closely for a whole turn show what repeats with it."""
FINE_POINTS: Final = 8
"""Of a turn, in a fine run."""
FINE_TURNS: Final = 2


@dataclass(frozen=True, slots=True)
class Period:
    """A length after which an error may repeat, and what turns once in it."""

    length: float
    name: str


def periods_of(lead: float | None, lengths: Iterable[float] = ()) -> tuple[Period, ...]:
    """Return what may repeat: one turn of the screw and half of one, and each further turn that is named.

    Raises:
        ReadingsError: a lead or another period that is no length.

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
    """Return the length of the longest; None where nothing may repeat."""
    return max((each.length for each in periods), default=None)


def _check(what: str, length: float) -> None:
    if not (isfinite(length) and length > 0.0):
        raise ReadingsError(f"{what} {length:g}: it must be a length above 0, in the units of the readings")


def is_aliased(targets: Sequence[float], period: float) -> bool:
    """Whether targets meet an error of this period always at the same angle, or so nearly that it looks slow.

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
    """Return the mean of the angles as vectors: 1 where all are the same, near 0 where all are met."""
    angles = [2 * pi * position / period for position in positions]
    return hypot(sum(map(cos, angles)), sum(map(sin, angles))) / len(angles)


def _is_resolved(turns: Iterable[float]) -> bool:
    """Whether distances, in turns, that follow each other are small enough for a whole turn.

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
    """Return which periods the targets can show, and which are aliased."""
    given = list(periods)
    aliased = tuple(each for each in given if is_aliased(targets, each.length))
    return tuple(each for each in given if each not in aliased), aliased


def even_step(targets: Sequence[float]) -> float | None:
    """Return the distance of targets on an even grid; None where they are on none."""
    gaps = [high - low for low, high in pairwise(targets)]
    if not gaps or max(gaps) - min(gaps) > 1e-3 * max(gaps):
        return None
    return sum(gaps) / len(gaps)


def _grid(targets: Sequence[float]) -> tuple[float, list[float]]:
    """Return the step of the grid that lies nearest to targets, and how far each lies from it.

    Some of its places may have no target.

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
    """Return what targets do not tell from a slower curve: of what is told, and of the step of a grid.

    On an even grid what repeats with its step looks the same at each target, whatever is told beside it.
    Where something is told, nothing is taken to turn slower than that. A fine run beside the grid shows it,
    and a grid so fine that only turns which no screw has look slow on it hides nothing.

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
    """Return the step of the grid that targets lie on, where they do and nothing else shows what it hides."""
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
    """Whether targets meet only two opposite angles of a turn: of its sine and cosine they show one.

    >>> [meets_two_angles([0, step, 2 * step, 3 * step], 20.0) for step in (10, 30, 12, 4)]
    [True, True, False, False]
    """
    if len(targets) < LEAST_EVEN or _is_resolved((high - low) / period for low, high in pairwise(targets)):
        return False
    return _narrowness(targets, period / 2) > NARROW >= _narrowness(targets, period)


def _is_fine(step: float, units: Units) -> bool:
    """Whether only turns that no screw has look slow on such a grid."""
    return units is not Units.DEGREE and step <= (1.0 - SLOW) * units.from_mm(SHORTEST_MM)


def may_be_more(targets: Sequence[float], periods: Iterable[Period], units: Units) -> float:
    """Return how many times as much as it seems may be left, where no lead is told; 1 where one is.

    Of a turn as long as the step of the grid that targets lie near, they show the share by which its angles
    differ.

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
    """Return where to measure two turns, and in which steps: in the middle, where nothing else ends.

    >>> fine_run([0, 100, 200, 300, 400], 5.0)
    (200, 210.0, 0.625)
    """
    low, high = targets[0], targets[-1]
    start = min(targets, key=lambda target: abs(target - (low + high) / 2))
    if start + FINE_TURNS * lead > high:
        start = low
    return start, start + FINE_TURNS * lead, lead / FINE_POINTS


def aliased_warning(targets: Sequence[float], aliased: Sequence[Period], unit: str) -> str:
    """Say that an error was not seen, and what to measure to see it."""
    longest = max(aliased, key=lambda each: each.length)
    names = " and ".join(each.name for each in aliased)
    step = even_step(targets)
    where = f"the targets lie {step:.6g} {unit} apart" if step else "nearly all distances of the targets are"
    how = "a multiple, or near one, of" if step else "whole turns of"
    low, high, fine = fine_run(targets, longest.length)
    return (
        f"{where}, {how} {names}: an error that repeats so looks the same at each of them (aliased) and "
        f"was not seen. Measure two turns finely, --from {low:.9g} --to {high:.9g} --step {fine:.6g}, and "
        f"give both files; or take random targets with --spread {longest.length:g}"
    )


def slow_warning(targets: Sequence[float], slow: Sequence[Period], unit: str) -> str:
    """Say which wave an error looks like, and what to measure instead."""
    step, _ = _grid(targets)
    looks = []
    for each in slow:
        periods_apart = step / each.length
        looks.append(f"{each.name} like one of {step / abs(periods_apart - round(periods_apart)):.4g} {unit}")
    spread = max(each.length for each in slow)
    return (
        f"the targets lie {_about(targets, step)} {unit} apart: there an error that repeats looks like a "
        f"slower wave, {' and '.join(looks)}, and is told from it only as long as it is the same all along "
        f"the screw. Take random targets with --spread {spread:g}"
    )


def _about(targets: Sequence[float], step: float) -> str:
    return f"{step:.6g}" if even_step(targets) else f"about {step:.4g}"


def lead_warnings(targets: Sequence[float], periods: Iterable[Period], units: Units) -> list[str]:
    """Say what targets will not show of what is told, and of what is not."""
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
    """Say of a grid which errors it does not show, and what to do; ``is_given``: a lead is."""
    remedy = f"Take random targets with --spread {step:.6g}"
    if not is_given:
        remedy += ", and tell the lead of the screw: --lead"
    return (
        f"the targets lie {_about(targets, step)} {unit} apart: an error that repeats every {step:.6g}, "
        f"{step / 2:.6g}, {step / 3:.6g}… {unit} looks the same at each of them and was not seen. {remedy}"
    )
