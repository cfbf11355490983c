"""Signs of a mistake in a valid table; ``gateway.catalogue.remarks`` has the meaning of each code."""

from collections.abc import Callable, Iterator, Sequence
from collections.abc import Set as AbstractSet
from itertools import combinations, pairwise
from pathlib import Path
from statistics import fmean, median
from typing import Final, NamedTuple

from msgspec import Struct

from gateway.compensation.settings import default_max_correction
from gateway.compensation.table import CorrectionTable
from gateway.tabfile.decoded import (
    BRANCHES,
    Decoded,
    Lint,
    LintSeverity,
    SourceRow,
    bends,
    corrections,
    line_of,
    second_differences,
    steepest,
)
from gateway.tabfile.names import axis_of_name

REVERSED_ROUGHNESS: Final = 0.5
"""The reversed second list must fit this much better to be reported."""
SLIP_VALUE: Final = 0.001
SLIP_MEDIAN: Final = 0.1
"""A value below the first among values around the second is probably in another unit."""
OUTLIER_FACTOR: Final = 8.0
SHORT: Final = 18
"""Tables up to this size are judged by omitting points: one mistake bends half of a short table."""
SHORT_FACTOR: Final = 4.0
"""A point is an outlier beyond this multiple of the sharpest bend that remains without it."""
REGULAR: Final = 0.25
"""Points are about even if the least distance is at least this share of the widest."""
SHORT_FLOOR_MM: Final = 0.003
"""Among few points, scatter of a micron is chance."""
LEAST_LEFT: Final = 4
"""Fewer points bend too seldom to show what is usual."""
LEAST_AGAIN: Final = 6
"""A second search needs this many points beside the outliers. Among fewer, sound points often stand out."""
FEW: Final = 6
"""One in this many points may be a mistake; more than that is a rough curve."""
REVERSAL_FACTOR: Final = 3.0
"""Times the distance of the other points' lost motion from its median."""
REVERSAL_FLOOR_MM: Final = 0.003
OUTLIER_FLOOR_MM: Final = 0.001
"""Bends below a micron are the rounding of the file, not outliers."""
UNCOVERED: Final = 1e-5
"""A stretch below this fraction of the travel is the rounding of a length in counts."""
EVEN_SHARE: Final = 0.6
"""A grid is meant to be even if at least this share of its distances is one step."""
STEP_TOLERANCE: Final = 1e-3
"""Distances within this fraction of each other are one step: positions are rounded in some files."""
SHOWN_HOLES: Final = 3
NOISE: Final = 1e-9
"""Rounding of sums, relative to the largest correction."""


class _Subject(Struct, frozen=True):
    """The input of the checks."""

    name: str
    table: CorrectionTable
    source: Decoded

    @property
    def rows(self) -> Sequence[SourceRow]:
        return self.source.rows

    @property
    def unit(self) -> str:
        return self.table.units.value

    @property
    def span(self) -> float:
        return self.table.last - self.table.first


def run_lints(name: str, table: CorrectionTable, source: Decoded) -> tuple[Lint, ...]:
    """Return the remarks of the reader and the findings of all checks, in the order of the checks."""
    subject = _Subject(name, table, source)
    return (*source.remarks, *(lint for check in _CHECKS for lint in check(subject)))


def _warning(code: str, message: str, line: int | None = None) -> Lint:
    return Lint(code, LintSeverity.WARNING, message, line)


def _slope(subject: _Subject) -> Iterator[Lint]:
    limit = subject.source.context.max_slope
    slope, before, after = steepest(subject.rows)
    if abs(slope) > limit:
        message = (
            f"slope of {slope:.4g} between {before.position:g} and {after.position:g} {subject.unit}, "
            f"above max_slope {limit:g}: correct the values there, or raise max_slope if the screw is "
            "really so bad"
        )
        yield Lint("L1", LintSeverity.ERROR, message, after.forward_line)


def _size(subject: _Subject) -> Iterator[Lint]:
    limit = subject.source.context.correction_limit(subject.table.units, subject.span)
    branch, row = max(
        ((branch, row) for branch in BRANCHES for row in subject.rows),
        key=lambda pair: abs(pair[1].forward if pair[0] == "forward" else pair[1].backward),
    )
    correction = row.forward if branch == "forward" else row.backward
    if abs(correction) > limit * (1 + NOISE):
        message = (
            f"{branch} correction of {correction:.6g} {subject.unit} at {row.position:g}, above "
            f"max_correction {limit:.6g}: correct the value (or its unit), or raise max_correction"
        )
        yield Lint("L12", LintSeverity.ERROR, message, line_of(row, branch))


def _swapped(subject: _Subject) -> Iterator[Lint]:
    differences = [row.forward - row.backward for row in subject.rows]
    mean, noise = fmean(differences), NOISE * subject.table.max_correction()
    negative = sum(difference < -noise for difference in differences)
    positive = sum(difference > noise for difference in differences)
    # By count: one mistake makes the mean negative, and exchanging the columns would ruin all other points.
    if mean < -noise and negative > positive:
        yield _warning(
            "L2",
            "swap the columns, or check the direction and the sign of the measurement: forward - backward "
            f"is {mean:.6g} {subject.unit} on average, but lost motion makes it positive",
        )


def _reversed(subject: _Subject) -> Iterator[Lint]:
    forward, backward = (corrections(subject.rows, branch) for branch in BRANCHES)
    as_given, as_reversed = _roughness(forward, backward), _roughness(forward, backward[::-1])
    if not backward[-1] and backward[0] and abs(subject.rows[-1].position) <= NOISE * subject.span:
        return  # it must end with 0 at home; reversed it would not
    if as_reversed < REVERSED_ROUGHNESS * as_given and as_given > NOISE * subject.table.max_correction():
        yield _warning(
            "L3",
            "put both lists in the same order: forward - backward is "
            f"{as_given / as_reversed if as_reversed else float('inf'):.2g} times smoother with the "
            "backward list reversed, so it was probably logged from the other end",
        )


def _roughness(forward: Sequence[float], backward: Sequence[float]) -> float:
    differences = [f - b for f, b in zip(forward, backward, strict=True)]
    return sum(abs(after - before) for before, after in pairwise(differences))


def _unit_slip(subject: _Subject) -> Iterator[Lint]:
    if subject.source.are_positions:
        return
    values = [
        (value, line)
        for row in subject.rows
        for value, line in ((row.forward_value, row.forward_line), (row.backward_value, row.backward_line))
    ]
    unit = subject.source.value_unit
    if median(abs(value) for value, _ in values) >= SLIP_MEDIAN:
        for value, line in values:
            if 0 < abs(value) < SLIP_VALUE:
                yield _warning(
                    "L4",
                    f"check the unit of value {value:g} and correct it: the other values are "
                    f"{SLIP_MEDIAN:g} {unit} or more",
                    line,
                )
    smallest, largest = subject.source.plausible
    # A change that is large on a short axis is usual on a long one.
    units, length = subject.table.units, subject.source.context.length(subject.span)
    largest *= default_max_correction(units, length) / default_max_correction(units, 0.0)
    worst, line = max(values, key=lambda pair: abs(pair[0]))
    if worst and not smallest <= abs(worst) <= largest:
        bound = f"at least {smallest:g}" if abs(worst) < smallest else f"at most {largest:g}"
        yield _warning(
            "L4",
            f"write the values in {unit}: the largest is {worst:g} {unit}, expected {bound}, so they are "
            "probably in another unit",
            line,
        )


def _home(subject: _Subject) -> Iterator[Lint]:
    """At home the measurement is 0 by construction (TB058, table of home cases)."""
    home = _home_of(subject.table)
    if home is None:
        return
    row = subject.rows[home.row]
    if abs(home.correction) > NOISE * max(subject.table.max_correction(), NOISE):
        yield _warning(
            "L5",
            f"{home.value} correction at home is {home.correction:.6g} {subject.unit}, not 0, and shifts "
            "the whole axis: subtract it from all values, unless this shift is intended",
            line_of(row, home.branch),
        )


class _Home(NamedTuple):
    """The correction at home: its branch, the name of its value, and the nearest point."""

    branch: str
    value: str
    correction: float
    row: int


def _home_of(table: CorrectionTable) -> _Home | None:
    step = (table.last - table.first) / (len(table.positions) - 1)
    if abs(table.first) <= NOISE * step:
        return _Home("forward", "first forward", table.forward[0], 0)
    if abs(table.last) <= NOISE * step:
        return _Home("backward", "last backward", table.backward[-1], len(table.positions) - 1)
    if not table.first < 0 < table.last:
        return None
    index = table.segment(0.0)
    low, high = table.positions[index : index + 2]
    share = -low / (high - low)
    correction = table.forward[index] * (1 - share) + table.forward[index + 1] * share
    return _Home("forward", "forward", correction, index)


def _is_zero_at_home(subject: _Subject, row: SourceRow, branch: str) -> bool:
    """Whether a value must be 0 by definition, and is 0."""
    home = _home_of(subject.table)
    if home is None or row is not subject.rows[home.row]:
        return False
    # A curve for both directions is checked once, as the forward one.
    if branch != home.branch and not subject.table.is_unidirectional:
        return False
    step = subject.span / (len(subject.rows) - 1)
    return abs(row.position) <= NOISE * step and not corrections([row], branch)[0]


def _outliers(subject: _Subject) -> Iterator[Lint]:
    branches = BRANCHES[:1] if subject.table.is_unidirectional else BRANCHES
    named = set()
    for branch in branches:
        if len(subject.rows) <= SHORT and _is_regular(subject.rows):
            found = _short_outliers(subject, branch)
        else:
            found = _long_outliers(subject, branch)
        for row, lint in found:
            named.add(row.position)
            if not _is_zero_at_home(subject, row, branch):
                yield lint
    if not subject.table.is_unidirectional:
        yield from _odd_reversal(subject, named)


def _is_regular(rows: Sequence[SourceRow]) -> bool:
    """Whether the points are about evenly spaced: only then can bends be compared."""
    gaps = [after.position - before.position for before, after in pairwise(rows)]
    return min(gaps) > REGULAR * max(gaps)


def _long_outliers(subject: _Subject, branch: str) -> Iterator[tuple[SourceRow, Lint]]:
    values = corrections(subject.rows, branch)
    floor = subject.table.units.from_mm(OUTLIER_FLOOR_MM)
    for index, bend, limit in _bent(subject.rows, values, floor):
        row = subject.rows[index]
        yield (
            row,
            _warning(
                "L6",
                f"{branch} correction {values[index]:.6g} at {row.position:g} {subject.unit} does not fit "
                f"its neighbours (bend {bend:.4g}, limit {limit:.4g}): measure there again",
                line_of(row, branch),
            ),
        )


def _bent(
    rows: Sequence[SourceRow], values: Sequence[float], floor: float
) -> Iterator[tuple[int, float, float]]:
    """Yield the points at which many values stand out, each with its bend and the limit, worst first.

    An outlier is removed before the others are judged, because it bends its neighbours too. If there are more
    outliers than one in ``FEW`` points, the curve is rough. Then only its worst point is reported.
    """
    left = list(range(len(rows)))
    found: list[tuple[int, float, float]] = []
    while len(left) > LEAST_LEFT:
        size = bends([rows[index].position for index in left], [values[index] for index in left])
        limit = max(OUTLIER_FACTOR * median(size), floor)
        worst = max(range(len(size)), key=size.__getitem__)
        if size[worst] <= limit:
            break
        # With two mistakes side by side, or one beside an end, a neighbour may bend as much.
        near = [left[at] for at in range(worst, worst + 3)]
        index = min(near, key=lambda each: _rest(rows, values, [at for at in left if at != each]))
        found.append((index, size[worst], limit))
        left.remove(index)
    yield from found if len(found) * FEW <= len(rows) else found[:1]


def _rest(rows: Sequence[SourceRow], values: Sequence[float], left: Sequence[int]) -> float:
    """Return the total bend of the remaining values."""
    return sum(bends([rows[index].position for index in left], [values[index] for index in left]))


def _short_outliers(subject: _Subject, branch: str) -> Iterator[tuple[SourceRow, Lint]]:
    """Name the points without which the others are on a smooth curve: one, two at a time, and again."""
    rows = subject.rows
    left_out: tuple[int, ...] = ()
    while found := _slips(subject, [index for index in range(len(rows)) if index not in left_out], branch):
        left_out = (*left_out, *found)
        if len(rows) - len(left_out) < LEAST_AGAIN:
            break
    for index in left_out:
        row = rows[index]
        value = corrections([row], branch)[0]
        others = [each for at, each in enumerate(rows) if at not in left_out]
        yield (
            row,
            _warning(
                "L6",
                f"{branch} correction {value:.6g} at {row.position:g} {subject.unit} does not fit: the "
                f"other values lead to {_between(others, branch, row.position):.4g} there. Check for a "
                "wrong digit or decimal point, or measure there again",
                line_of(row, branch),
            ),
        )


def _slips(subject: _Subject, left: Sequence[int], branch: str) -> tuple[int, ...]:
    """Return the remaining point, or else the two, that do not fit the others."""
    for many in (1, 2):
        if len(left) - many < LEAST_LEFT + many - 1:
            break
        found = [
            (min(ratios), chosen)
            for chosen in combinations(left, many)
            if (ratios := _ratios(subject, left, chosen, branch)) and min(ratios) > many
        ]
        if found:
            return max(found)[1]
    return ()


def _ratios(subject: _Subject, left: Sequence[int], chosen: tuple[int, ...], branch: str) -> list[float]:
    """Return the distance of points from the line of the others, relative to the usual maximum of these."""
    others = [subject.rows[index] for index in left if index not in chosen]
    usual = max(second_differences(others, branch))
    limit = max(SHORT_FACTOR * usual, subject.table.units.from_mm(SHORT_FLOOR_MM))
    ends = (left[0], left[-1])
    # Beyond its neighbours a point misses their line by the whole bend, between them by half of it.
    return [
        (1 if index in ends else 2)
        * abs(
            corrections([subject.rows[index]], branch)[0]
            - _between(others, branch, subject.rows[index].position)
        )
        / limit
        for index in chosen
    ]


def _between(others: Sequence[SourceRow], branch: str, position: float) -> float:
    """Return the line through the nearest points at a position; beyond them it continues."""
    above = sum(row.position < position for row in others)
    low, high = others[min(max(above, 1), len(others) - 1) - 1 :][:2]
    start, end = corrections([low, high], branch)
    return start + (end - start) * (position - low.position) / (high.position - low.position)


def _odd_reversal(subject: _Subject, named: AbstractSet[float]) -> Iterator[Lint]:
    """Name the points with a lost motion unlike the others', in a short table at most two."""
    differences = [row.forward - row.backward for row in subject.rows]
    floor = subject.table.units.from_mm(REVERSAL_FLOOR_MM)
    if len(differences) > SHORT:
        # A screw may be worn in one region: there the lost motion bends slowly.
        odd, usual = sorted(at for at, _, _ in _bent(subject.rows, differences, floor)), median(differences)
    else:
        odd, usual = _odd(differences, floor)
    for index in odd:
        row = subject.rows[index]
        if row.position not in named:
            yield _warning(
                "L15",
                f"check both corrections at {row.position:g} {subject.unit} for a typing mistake, or "
                f"measure there again: forward - backward is {differences[index]:.6g}, at the other points "
                f"{usual:.6g}",
                row.forward_line,
            )


def _odd(differences: Sequence[float], floor: float) -> tuple[list[int], float]:
    """Return the indices of numbers unlike the others, in order, and the usual value of the others."""
    middle = median(differences)
    farthest = sorted(
        range(len(differences)), key=lambda index: abs(differences[index] - middle), reverse=True
    )
    for many in (1, 2):
        others = [differences[index] for index in farthest[many:]]
        if len(others) < LEAST_LEFT + many - 1:
            break
        usual = median(others)
        limit = max(REVERSAL_FACTOR * many * max(abs(each - usual) for each in others), floor)
        if all(abs(differences[index] - usual) > limit for index in farthest[:many]):
            return sorted(farthest[:many]), usual
    return [], middle


def _resolution(subject: _Subject) -> Iterator[Lint]:
    scale = subject.source.context.counts_per_unit
    largest = subject.table.max_correction()
    if scale is not None and 0 < largest * abs(scale) < 1:
        yield _warning(
            "L7",
            f"check the units of the table and counts_per_unit: the largest correction, {largest:.4g} "
            f"{subject.unit}, is only {largest * abs(scale):.2g} counts of the drive, so the table moves "
            "nothing",
        )


def _coverage(subject: _Subject) -> Iterator[Lint]:
    travel = subject.source.context.travel
    if travel is None:
        return
    table, (low, high) = subject.table, travel
    for start, end, forward, backward in (
        (low, table.first, table.forward[0], table.backward[0]),
        (table.last, high, table.forward[-1], table.backward[-1]),
    ):
        if end - start > UNCOVERED * (high - low):
            yield _warning(
                "L8",
                f"travel {start:g} to {end:g} {subject.unit} is not covered, so 'outside' applies there; "
                f"hold (the default) gives {forward:.6g} forward, {backward:.6g} backward",
            )


def _empty_column(subject: _Subject) -> Iterator[Lint]:
    empty = [branch for branch in BRANCHES if not any(corrections(subject.rows, branch))]
    if len(empty) == len(BRANCHES):
        yield _warning("L9", "fill in the table or remove it: all corrections are 0")
    elif empty == ["backward"]:
        yield _warning(
            "L9",
            "all backward corrections are 0, which means no correction here; on some controls (Fagor) it "
            "means the same as forward: if so, copy the other column",
        )
    elif empty:
        yield _warning(
            "L9", "all forward corrections are 0: if this direction was measured, fill in the column"
        )


def _axis(subject: _Subject) -> Iterator[Lint]:
    name = Path(subject.name).name
    source = subject.source
    given = source.context.axis
    claims = [
        (f"file name {name}", axis_of_name(name)),
        (f"AXIS {source.axis}", source.axis),
        (f"the comment (axis {source.comment_axis})", source.comment_axis),
        (f"the configured axis {given}", given.upper() if given else None),
    ]
    stated = [(what, letter) for what, letter in claims if letter is not None]
    for (what, letter), (other, other_letter) in pairwise(stated):
        if letter != other_letter:
            yield _warning(
                "L10", f"check that this is the right file: {what} and {other} name different axes"
            )


def _hole(subject: _Subject) -> Iterator[Lint]:
    """Among points one step apart, a different distance shows a line that was lost or mistyped."""
    distances = [after.position - before.position for before, after in pairwise(subject.rows)]
    step = median(distances)
    uneven = [index for index, width in enumerate(distances) if abs(width - step) > STEP_TOLERANCE * step]
    if len(distances) - len(uneven) < max(2, EVEN_SHARE * len(distances)):
        return
    for index in uneven[:SHOWN_HOLES]:
        before, after = subject.rows[index : index + 2]
        yield _warning(
            "L13",
            f"check for a lost line or a mistyped position: points at {before.position:.8g} and "
            f"{after.position:.8g} {subject.unit} are {distances[index]:.6g} apart, most others {step:.6g}",
            after.forward_line or after.backward_line,
        )


def _beyond(subject: _Subject) -> Iterator[Lint]:
    """Whole segments outside the travel: a repeated line moves the points behind it."""
    travel = subject.source.context.travel
    if travel is None:
        return
    rows, (low, high) = subject.rows, travel
    slack = UNCOVERED * (high - low)
    for row, inner, is_beyond in (
        (rows[0], rows[1], rows[1].position <= low + slack),
        (rows[-1], rows[-2], rows[-2].position >= high - slack),
    ):
        if is_beyond:
            yield _warning(
                "L14",
                f"check for an extra line: points at {row.position:.8g} and {inner.position:.8g} "
                f"{subject.unit} are at the end of travel {low:g} to {high:g} or beyond it, where the axis "
                "never goes",
                row.forward_line or row.backward_line,
            )


_CHECKS: Final[Sequence[Callable[[_Subject], Iterator[Lint]]]] = (
    _slope,
    _swapped,
    _reversed,
    _unit_slip,
    _home,
    _outliers,
    _resolution,
    _coverage,
    _empty_column,
    _axis,
    _size,
    _hole,
    _beyond,
)
