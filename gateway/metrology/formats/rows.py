"""The common result of all readers, and its checks: lines with a target, a direction and a reading."""

from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from statistics import fmean, median
from typing import Final, NamedTuple

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.readings import APPROACHES, NEAR, Reading, Survey
from gateway.tabfile.csv_text import MAX_PROBLEMS
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.text import SourceText

FAR: Final = 0.5
"""A reading further from its target than this share of the way to the next belongs to another target."""

LEAST_BLOCKS: Final = 3
"""Fewer sizes may be repeated by chance."""
TOGETHER: Final = 0.03
"""Of the way to the next block: readings of one block are this close together."""
MOST_ASTRAY: Final = 2
"""More stops beside those of their block are not mistakes."""
LEAST_STOPS: Final = 3
"""With two sizes for one block it is unknown which is wrong."""
_MOST_DECIMALS: Final = 9


class Row(NamedTuple):
    """One reading and its line."""

    line: int
    target: float
    direction: Direction
    run: int
    measured: float
    temperature_c: float | None = None


def to_survey(
    source: SourceText,
    rows: Sequence[Row],
    units: Units,
    *,
    axis: str | None = None,
    facts: Mapping[str, str] | None = None,
    remarks: Sequence[str] = (),
) -> Survey:
    """Check rows and make a survey of them; odd but usable values become a remark.

    Raises:
        TabFileError: no reading, a target with two spellings, a repeated reading, targets of a run out of
            order, a reading that belongs to another target.
    """
    if not rows:
        raise source.error("no reading", "a line for each stop: target, direction, run, reading")
    rows, grouped = _at_blocks(source, rows)
    if grouped:
        remarks = (*remarks, f"{source.name}: {grouped}")
    _check_spelling(source, rows)
    _check_duplicates(source, rows)
    _check_order(source, rows)
    _check_distance(source, rows)
    return Survey(
        readings=tuple(
            Reading(row.target, row.direction, row.measured, row.run, row.temperature_c) for row in rows
        ),
        units=units,
        axis=axis,
        source=source.name,
        facts=dict(facts or {}),
        remarks=(*remarks, *_exchanged(source, rows), *_missing(source, rows)),
    )


def _at_blocks(source: SourceText, rows: Sequence[Row]) -> tuple[Sequence[Row], str]:
    """Move readings over gauge blocks to their blocks, if the runs stopped at different numbers.

    A person may set a gauge to 0 at each block and write down the DRO. The targets then differ in each run,
    and the sizes are always the same few. A person who moves to a block and also reads the dial has two
    varying columns. A run has one stop for each block. The stops of a block are close together and far from
    all others. The deviation does not change; it is moved from a position a few micrometres away to the
    block. Return a sentence about the change; empty for none.

    Raises:
        TabFileError: only one or two stops do not fit this pattern.
    """
    stops = Counter((row.direction, row.run) for row in rows)
    count = max(stops.values())
    targets = sorted({row.target for row in rows})
    if count < LEAST_BLOCKS or len(targets) <= count or len(stops) < 2:
        return rows, ""
    groups = _nearest(targets, count)
    between = min(after[0] - before[-1] for before, after in pairwise(groups))
    varying = sum(len(group) > 1 for group in groups)
    # If few of them vary, numbers were mistyped.
    if 2 * varying < count:
        return rows, ""
    if max(group[-1] - group[0] for group in groups) > TOGETHER * between:
        _check_astray(source, rows, groups, TOGETHER * between)
        return rows, ""
    _check_sizes(source, rows, groups, TOGETHER * between)
    blocks = {}
    for group in groups:
        read = [row.measured for row in rows if group[0] <= row.target <= group[-1]]
        blocks.update(dict.fromkeys(group, _roundest(group, read)))
    moved = [
        row._replace(target=blocks[row.target], measured=blocks[row.target] + row.measured - row.target)
        for row in rows
    ]
    sizes = sorted(set(blocks.values()))
    remark = (
        f"readings over {len(sizes)} gauge blocks from {sizes[0]:.9g} to {sizes[-1]:.9g}: the blocks are "
        "the targets, and each reading belongs to the nearest block"
    )
    first = {row.run: row.target for row in sorted(rows, key=lambda row: row.line, reverse=True)}
    starts = sorted(first.values())
    if starts[0] < starts[-1]:
        remark += f"; the runs begin at {starts[0]:.9g} to {starts[-1]:.9g}, which adds to the scatter"
    return moved, remark


def _check_astray(
    source: SourceText, rows: Sequence[Row], groups: Sequence[Sequence[float]], reach: float
) -> None:
    """Name the stops that keep those of each block from being close together, if they are few."""
    problems: list[FileProblem] = []
    for group in groups:
        stops = [row for row in rows if group[0] <= row.target <= group[-1]]
        middle = median(row.target for row in stops)
        sound = [row.target for row in stops if abs(row.target - middle) <= reach]
        if max(sound) - min(sound) > reach:
            return
        problems.extend(
            source.problem(
                f"{row.target:.9g}, but the other stops at this block are at {min(sound):.9g} to "
                f"{max(sound):.9g}",
                "stops close to each other at one block: check the digits, or it belongs to another block",
                line=row.line,
            )
            for row in stops
            if abs(row.target - middle) > reach
        )
    if 0 < len(problems) <= MOST_ASTRAY:
        raise TabFileError(*problems)


def _check_sizes(
    source: SourceText, rows: Sequence[Row], groups: Sequence[Sequence[float]], reach: float
) -> None:
    """Name a block with a size that differs from its other stops."""
    problems: list[FileProblem] = []
    for group in groups:
        stops = [row for row in rows if group[0] <= row.target <= group[-1]]
        usual = median(row.measured for row in stops)
        problems.extend(
            source.problem(
                f"{row.measured:.9g} at the stop at {row.target:.9g}, but the others have {usual:.9g}",
                "the same size for one block everywhere",
                line=row.line,
            )
            for row in stops
            if len(stops) >= LEAST_STOPS and abs(row.measured - usual) > reach
        )
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])


def _nearest(targets: Sequence[float], count: int) -> list[Sequence[float]]:
    """Split ascending targets into ``count`` groups at the widest gaps."""
    gaps = sorted(range(1, len(targets)), key=lambda at: targets[at] - targets[at - 1], reverse=True)
    cuts = [0, *sorted(gaps[: count - 1]), len(targets)]
    return [targets[start:end] for start, end in pairwise(cuts)]


def _roundest(targets: Sequence[float], measured: Sequence[float]) -> float:
    """Return the mean of the readings, rounded as far as targets and readings scatter about it.

    If all measured values are one number, that number is the block itself.

    >>> _roundest([25.0031, 25.0095], [25.0, 25.0]), _roundest([25.4031, 25.4095], [25.3996, 25.4006])
    (25.0, 25.4)
    """
    if len(set(measured)) == 1:
        return measured[0]
    middle = fmean(measured)
    reach = max(abs(each - middle) for each in (*targets, *measured))
    for decimals in range(_MOST_DECIMALS):
        if abs(round(middle, decimals) - middle) <= reach:
            return round(middle, decimals)
    return middle


def _check_spelling(source: SourceText, rows: Sequence[Row]) -> None:
    first = {row.target: row for row in reversed(rows)}
    targets = sorted(first)
    gaps = [high - low for low, high in pairwise(targets)]
    if not gaps:
        return
    usual = median(gaps) if len(gaps) > 1 else 0.0
    for low, high in pairwise(targets):
        if high - low < NEAR * max(usual, (targets[-1] - targets[0]) / len(first)):
            one, two = sorted((first[low], first[high]), key=lambda row: row.line)
            raise source.error(
                f"target {two.target:.9g}, but {one.target:.9g} in line {one.line}",
                "the same number for one target in every run, because rounding makes two targets of one; "
                "over gauge blocks, no more targets than one run has stops, and the stops of one block close "
                "together",
                line=two.line,
            )


def _check_duplicates(source: SourceText, rows: Sequence[Row]) -> None:
    seen: dict[tuple[float, Direction, int], int] = {}
    for row in rows:
        key = (row.target, row.direction, row.run)
        if key in seen:
            raise source.error(
                f"a second reading of {row.direction.name.lower()} run {row.run} at {row.target:.9g}; "
                f"the first is in line {seen[key]}",
                "one reading for a target in a run: give the second run its own number, or delete one "
                "reading",
                line=row.line,
            )
        seen[key] = row.line


def _check_order(source: SourceText, rows: Sequence[Row]) -> None:
    """In each run, in either direction, the targets must rise or fall throughout."""
    last: dict[tuple[Direction, int], tuple[Row, float]] = {}
    for row in rows:
        key = (row.direction, row.run)
        if key not in last:
            last[key] = (row, 0.0)
            continue
        before, sense = last[key]
        step = row.target - before.target
        if step * sense < 0.0:
            raise source.error(
                f"target {row.target:.9g} after {before.target:.9g} (line {before.line}) in "
                f"{row.direction.name.lower()} run {row.run}, out of order",
                "the targets of a run in order, ascending or descending",
                line=row.line,
            )
        last[key] = (row, step)


def _check_distance(source: SourceText, rows: Sequence[Row]) -> None:
    targets = sorted({row.target for row in rows})
    for row in rows:
        at = bisect_left(targets, row.target)
        gaps = [abs(row.target - targets[i]) for i in (at - 1, at + 1) if 0 <= i < len(targets)]
        if gaps and abs(row.measured - row.target) > FAR * min(gaps):
            nearest = min(targets, key=lambda target: abs(row.measured - target))
            whose = f", the reading of target {nearest:.9g}" if nearest != row.target else ""
            away = row.measured - row.target
            raise source.error(
                f"{row.measured:.9g} at target {row.target:.9g}{whose}: {away:+.9g} away",
                "a reading near its target, in the same unit and from the same zero",
                line=row.line,
            )


def _exchanged(source: SourceText, rows: Sequence[Row]) -> list[str]:
    """Name directions that all runs contradict: forward ones listed downwards, backward ones upwards."""
    runs: dict[tuple[Direction, int], list[float]] = {}
    for row in rows:
        runs.setdefault((row.direction, row.run), []).append(row.target)
    senses = {
        way: {targets[-1] > targets[0] for (of, _), targets in runs.items() if of is way and len(targets) > 1}
        for way in APPROACHES
    }
    if senses == {Direction.FORWARD: {False}, Direction.BACKWARD: {True}}:
        remark = (
            f"{source.name}: exchange the directions, or ignore this if the lines were sorted: every "
            "forward run descends and every backward run ascends, but forward is towards greater machine "
            "positions"
        )
        return [remark]
    return []


def _missing(source: SourceText, rows: Sequence[Row]) -> list[str]:
    """Name what a complete measurement would have and this one does not."""
    targets = sorted({row.target for row in rows})
    remarks = []
    counts = {way: len({row.run for row in rows if row.direction is way}) for way in APPROACHES}
    if all(counts.values()) and len(set(counts.values())) > 1:
        one, two = (f"{count} {way.name.lower()}" for way, count in counts.items())
        remarks.append(
            f"{source.name}: {one} and {two} runs: measure the same number in both directions; a mean uses "
            "the runs that exist"
        )
    for way in APPROACHES:
        of_runs: dict[int, set[float]] = {}
        for row in rows:
            if row.direction is way:
                of_runs.setdefault(row.run, set()).add(row.target)
        name = way.name.lower()
        if not of_runs:
            remarks.append(
                f"{source.name}: no {name} reading: measure also in this direction, or build a table of "
                "one direction (--one-way)"
            )
            continue
        measured = set().union(*of_runs.values())
        ends = [target for target in sorted({targets[0], targets[-1]}) if target not in measured]
        if ends:
            remarks.append(
                f"{source.name}: no {name} reading at {_listed(ends)}, an end: a table estimates it from "
                "the neighbour"
            )
        inner = [target for target in targets[1:-1] if target not in measured]
        if inner:
            remarks.append(f"{source.name}: no {name} reading at {_listed(inner)}: measure there")
        for run, found in sorted(of_runs.items()):
            lacking = [target for target in targets if target in measured - found]
            if lacking:
                remarks.append(
                    f"{source.name}: {name} run {run} has {len(found)} of {len(measured)} readings, none "
                    f"at {_listed(lacking)}: measure it again, or delete the run; the mean there uses the "
                    "other runs"
                )
    return remarks


def _listed(targets: Sequence[float]) -> str:
    shown = ", ".join(f"{target:.9g}" for target in targets[:8])
    return shown if len(targets) <= 8 else f"{shown} and {len(targets) - 8} more"
