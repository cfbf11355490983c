"""Where an axis stops for a measurement: targets, the order of the stops, and a control's program of them.

Targets are deliberately not on an even grid: an error that repeats with every revolution of the screw would
look the same at each of them. The standard's ``P_i = (i - 1) p + r`` moves every target by a random ``r``.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from math import ceil, isfinite
from random import Random
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError

DECIMALS: Final = {Units.MM: 3, Units.INCH: 4, Units.DEGREE: 4}
USUAL_SPREAD: Final = 0.3
"""Of the interval: the default limit for moving targets."""
LEAST_TARGETS: Final = 5
TARGETS_PER_METRE: Final = 5
UNITS_WORDS: Final = {Units.MM: "G21", Units.INCH: "G20", Units.DEGREE: ""}
MAX_TARGETS: Final = 10_000
AXES: Final = "XYZABCUVW"
"""Letters of axes. Any other letter has another meaning in a program: F is a feed, M a function."""
ROUNDING: Final = 1e-9
"""Share of a step by which its decimal notation may differ."""
WORD_DECIMALS: Final = 3
"""Of F and P."""


# --- Targets


def even_targets(low: float, high: float, step: float) -> list[float]:
    """Return ``low``, every step above it, and no more than ``high``.

    Raises:
        ReadingsError: a range or a step for fewer than two targets, or for ten thousand.
    """
    _check_range(low, high)
    # A share of a millionth: 0.1 does not divide 1 exactly, and the tenth target must not be lost.
    count = int((high - low) / step + 1e-6) + 1 if step > 0.0 else 0
    if not 2 <= count <= MAX_TARGETS:
        raise ReadingsError(
            f"a step of {step:g} from {low:g} to {high:g}: it must give 2 to {MAX_TARGETS} targets"
        )
    return [low + index * step for index in range(count)]


def random_targets(
    low: float, high: float, count: int, *, seed: int, spread: float | None = None, decimals: int = 3
) -> list[float]:
    """Return ``count`` targets, each moved up at random by less than ``spread``: ``P_i = (i - 1) p + r``.

    All are between ``low`` and ``high``. The same seed gives the same targets, to repeat a measurement. The
    spread should be the lead of the screw or more, if the intervals allow it.

    Raises:
        ReadingsError: fewer than two targets, or a spread that could change their order.
    """
    _check_range(low, high)
    if not 2 <= count <= MAX_TARGETS:
        raise ReadingsError(f"{count} targets: from 2 to {MAX_TARGETS}")
    if spread is None:
        spread = USUAL_SPREAD * (high - low) / count
    interval = (high - low - spread) / (count - 1)
    if not 0.0 <= spread < interval:
        raise ReadingsError(
            f"a spread of {spread:g} with {count} targets from {low:g} to {high:g}: give fewer targets or "
            f"a smaller spread; it must be smaller than the remaining interval, {interval:.6g}"
        )
    random = Random(seed)
    targets = [round(low + i * interval + random.random() * spread, decimals) for i in range(count)]
    return [min(max(target, low), high) for target in targets]


def enough_targets(length_mm: float) -> int:
    """Return the standard's number of targets for a travel of up to 2 m: five a metre, at least five."""
    return max(LEAST_TARGETS, ceil(TARGETS_PER_METRE * length_mm / 1000.0))


def check_targets(targets: Sequence[float], units: Units, travel: tuple[float, float] | None = None) -> None:
    """Check that targets stay distinct and inside the travel with the decimals of a program.

    Raises:
        ReadingsError: two targets have the same text, or one is outside the travel.
    """
    decimals = DECIMALS[units]
    stops = sorted(targets)
    for low, high in pairwise(stops):
        if round(low, decimals) == round(high, decimals):
            raise ReadingsError(
                f"give fewer targets: with {decimals} decimals {low:.9g} and {high:.9g} are the same"
            )
    if travel is not None and not travel[0] <= stops[0] <= stops[-1] <= travel[1]:
        raise ReadingsError(
            f"the targets go from {stops[0]:g} to {stops[-1]:g}, but the travel is {travel[0]:g} to "
            f"{travel[1]:g}: choose targets further inside"
        )


# --- The order of the stops


class Hands(Enum):
    """What a person does at a stop."""

    CLEAR = "clear"
    """Before the move: take dial, stop and block out of the way of the axis."""
    PLACE = "place"
    """After the move: set up dial and stop against each other."""
    INSERT = "insert"
    """After the move: put the block between dial and stop."""
    REMOVE = "remove"
    """Before the move: take the block out, or the move would crush it."""


@dataclass(frozen=True, slots=True)
class Stop:
    """One stop of a cycle. ``direction`` is that of the move to it; ends are not measuring stops.

    ``run`` counts the cycles, from 1. ``block`` is the length of a block between dial and stop, as in a
    :class:`~gateway.metrology.readings.Reading`. ``before`` and ``after`` are for a person, before the move
    and after it.
    """

    nominal: float
    direction: Direction
    measure: bool
    run: int = 1
    block: float = 0.0
    before: Hands | None = None
    after: Hands | None = None


def bidirectional_cycle(targets: Sequence[float], overrun: float, cycles: int = 1) -> Iterator[Stop]:
    """Yield the stops of a measuring cycle: up through all targets and down again, overrunning both ends.

    With the overrun the axis turns round outside the targets, so that both sides approach the first and last
    target too. It must be greater than the lost motion.

    >>> [(stop.nominal, stop.direction.name) for stop in bidirectional_cycle([0.0, 10.0], 2.0)]
    ... # doctest: +NORMALIZE_WHITESPACE
    [(-2.0, 'BACKWARD'), (0.0, 'FORWARD'), (10.0, 'FORWARD'),
     (12.0, 'FORWARD'), (10.0, 'BACKWARD'), (0.0, 'BACKWARD')]
    """
    ascending = sorted(targets)
    below, above = ascending[0] - overrun, ascending[-1] + overrun
    for run in range(1, cycles + 1):
        yield Stop(below, Direction.BACKWARD, measure=False, run=run)
        for nominal in ascending:
            yield Stop(nominal, Direction.FORWARD, measure=True, run=run)
        yield Stop(above, Direction.FORWARD, measure=False, run=run)
        for nominal in reversed(ascending):
            yield Stop(nominal, Direction.BACKWARD, measure=True, run=run)


def remaining(stops: Sequence[Stop], done: int) -> list[Stop]:
    """Return the remaining stops after ``done`` readings, from the turning point before the next one on.

    From there the axis approaches the next target from the correct side.

    >>> stops = list(bidirectional_cycle([0.0, 10.0], 2.0))
    >>> [stop.nominal for stop in remaining(stops, 1)]
    [-2.0, 10.0, 12.0, 10.0, 0.0]
    >>> remaining(stops, 4)
    []
    """
    turnaround, measured = 0, 0
    for index, stop in enumerate(stops):
        if not stop.measure:
            turnaround = index
        elif measured == done:
            return [stops[turnaround], *stops[index:]]
        else:
            measured += 1
    return []


# --- Programs of a control


@dataclass(frozen=True, slots=True)
class Cycle:
    """How an axis moves through its targets; lengths in ``units``, ``feed`` in units a minute.

    ``overrun`` is the distance beyond the last target before the axis turns round. It must exceed the lost
    motion, or the first target of the way back would be approached from the wrong side. ``dwell`` is in the
    unit of the control's ``G4 P``: seconds on many, milliseconds on others.
    """

    axis: str
    units: Units
    feed: float
    dwell: float
    overrun: float
    runs: int

    def __post_init__(self) -> None:
        """Check for values that no control would run.

        Raises:
            ReadingsError: not a letter of an axis, or a number that is not above 0 in the program's notation.
        """
        if len(self.axis) != 1 or self.axis.upper() not in AXES:
            raise ReadingsError(
                f"axis {self.axis!r}: a program needs the letter of an axis, {', '.join(AXES)}"
            )
        for name, number, decimals in (
            ("feed", self.feed, WORD_DECIMALS),
            ("dwell", self.dwell, WORD_DECIMALS),
            ("overrun", self.overrun, DECIMALS[self.units]),
        ):
            if not (isfinite(number) and round(number, decimals) > 0.0):
                raise ReadingsError(f"{name} {number:g}: it must be above 0, with {decimals} decimals")
        if self.runs < 1:
            raise ReadingsError(f"{self.runs} runs: give at least 1 (each run goes both ways)")


def endless_steps(axis: str, step: float, dwell: float, decimals: int) -> str:
    """Return TB058's program: one step, a pause to read the instrument, and again until the limit.

    Raises:
        ReadingsError: a step of 0, or one whose rounding would add up to another target.

    >>> print(endless_steps("X", 0.5, 5, 4), end="")
    G91X.5
    G4P5
    M102
    """
    if not step or not isfinite(step):
        raise ReadingsError(f"a step of {step:g}: it must not be 0; its sign is the direction")
    if abs(step - round(step, decimals)) > ROUNDING * abs(step):
        raise ReadingsError(
            f"give a step with at most {decimals} decimals, or --write cycle: the rounding of step "
            f"{step:.9g} would add up with each move"
        )
    return f"G91{axis.upper()}{_short(step, decimals)}\nG4P{_short(dwell, WORD_DECIMALS)}\nM102\n"


def cycle_program(targets: Sequence[float], cycle: Cycle, travel: tuple[float, float] | None = None) -> str:
    """Return a program for all runs: stop at every target upwards, overrun, stop at each downwards.

    The first move goes below the lowest target, so that this target too is approached from below.

    Raises:
        ReadingsError: it would leave the travel, or two targets have the same text.
    """
    check_targets(targets, cycle.units)
    low, high = min(targets) - cycle.overrun, max(targets) + cycle.overrun
    if travel is not None and not travel[0] <= low < high <= travel[1]:
        raise ReadingsError(
            f"the cycle goes from {low:g} to {high:g} with its overrun of {cycle.overrun:g}, but the "
            f"travel is {travel[0]:g} to {travel[1]:g}: choose targets further inside, or a smaller overrun"
        )
    return "".join(f"{line}\n" for line in _cycle_lines(targets, cycle))


def _cycle_lines(targets: Sequence[float], cycle: Cycle) -> Iterator[str]:
    decimals, axis = DECIMALS[cycle.units], cycle.axis.upper()
    first, *stops = bidirectional_cycle(targets, cycle.overrun, cycle.runs)
    yield " ".join(filter(None, (UNITS_WORDS[cycle.units], "G90 G94")))
    yield f"G1 {axis}{fixed(first.nominal, decimals)} F{_short(cycle.feed, WORD_DECIMALS)}"
    for stop in (*stops, first):
        yield f"G1 {axis}{fixed(stop.nominal, decimals)}"
        if stop.measure:
            yield f"G4 P{_short(cycle.dwell, WORD_DECIMALS)}"
    yield "M30"


def fixed(number: float, decimals: int) -> str:
    """Return the text of a position; a number that rounds to zero has no sign.

    >>> fixed(-0.0001, 3), fixed(12.5, 3)
    ('0.000', '12.500')
    """
    return f"{round(number, decimals) + 0.0:.{decimals}f}"


def _short(number: float, decimals: int) -> str:
    """Return the text of a number as in TB058: without zeros that carry no information.

    >>> _short(0.5, 4), _short(-0.5, 4), _short(25, 4), _short(5.0, 3), _short(0.0, 3)
    ('.5', '-.5', '25', '5', '0')
    """
    text = f"{number:.{decimals}f}".rstrip("0").rstrip(".")
    sign, digits = ("-", text[1:]) if text.startswith("-") else ("", text)
    digits = digits.removeprefix("0") if digits.startswith("0.") else digits
    return f"{sign}{digits}"


def _check_range(low: float, high: float) -> None:
    if not (isfinite(low) and isfinite(high) and low < high):
        raise ReadingsError(f"targets from {low:g} to {high:g}: the lower end first, then the upper")
