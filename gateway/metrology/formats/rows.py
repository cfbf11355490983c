"""What every reader of readings returns, checked in one place: lines with a target, a way and a reading."""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from itertools import pairwise
from statistics import median
from typing import Final, NamedTuple

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.readings import APPROACHES, NEAR, Reading, Survey
from gateway.tabfile.text import SourceText

FAR: Final = 0.5
"""A reading further from its target than this share of the way to the next target is another's."""

LEAST_BLOCKS: Final = 3
"""Fewer sizes may come back by chance."""


class Row(NamedTuple):
    """One reading and the line that it stands on."""

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
    """Check rows and make a survey of them; what is odd but usable becomes a remark.

    Raises:
        TabFileError: no reading, a target that is written in two ways, one reading twice, targets of a run
            out of order, a reading that is another target's.
    """
    if not rows:
        raise source.error("no reading", "a line for each stop: target, direction, run, reading")
    rows, grouped = _at_blocks(rows)
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


def _at_blocks(rows: Sequence[Row]) -> tuple[Sequence[Row], str]:
    """Put readings over gauge blocks at their blocks: the gauge is brought to 0, and the DRO is what varies.

    Then what was measured is the same few sizes in all runs, to the last digit, while nearly every target is
    another number. The deviation stays what it is; it belongs to the block instead of to a place a few
    micrometres beside it. Returns what was done, in words; empty where nothing was.
    """
    blocks = sorted({row.measured for row in rows})
    targets = {row.target for row in rows}
    if len(blocks) < LEAST_BLOCKS or len(targets) <= len(blocks) or len(rows) < 2 * len(blocks):
        return rows, ""
    gap = min(high - low for low, high in pairwise(blocks))
    if any(abs(row.target - row.measured) > FAR * gap for row in rows):
        return rows, ""
    if any(sum(row.measured == block for row in rows) < 2 for block in blocks):
        return rows, ""
    moved = [row._replace(target=row.measured, measured=2 * row.measured - row.target) for row in rows]
    starts = sorted({row.target for row in rows if row.measured == blocks[0]})
    said = (
        f"readings over {len(blocks)} gauge blocks from {blocks[0]:.9g} to {blocks[-1]:.9g}: the blocks "
        "are the targets, and the DRO is what varies"
    )
    if len(starts) > 1:
        said += f"; the runs begin at {starts[0]:.9g} to {starts[-1]:.9g}, which counts as scatter"
    return moved, said


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
                f"target {two.target:.9g}, which is {one.target:.9g} in line {one.line}",
                "the same number for one target in every run: a rounding makes two targets of one",
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
                "one reading of a target in a run: give the second run a number of its own, or delete one",
                line=row.line,
            )
        seen[key] = row.line


def _check_order(source: SourceText, rows: Sequence[Row]) -> None:
    """Whichever way a run is listed, its targets rise or fall all along."""
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
                f"{row.direction.name.lower()} run {row.run}: out of order",
                "the targets of a run in one order, rising or falling",
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
            f"{source.name}: every forward run falls and every backward run rises, as if the directions were "
            "exchanged: forward is towards greater machine positions; exchange them, or ignore this where "
            "the lines were sorted"
        )
        return [remark]
    return []


def _missing(source: SourceText, rows: Sequence[Row]) -> list[str]:
    """Name what a whole measurement would have and this one has not."""
    targets = sorted({row.target for row in rows})
    remarks = []
    counts = {way: len({row.run for row in rows if row.direction is way}) for way in APPROACHES}
    if all(counts.values()) and len(set(counts.values())) > 1:
        one, two = (f"{count} {way.name.lower()}" for way, count in counts.items())
        remarks.append(
            f"{source.name}: {one} and {two} runs: measure as many both ways; a mean is of those there"
        )
    for way in APPROACHES:
        of_runs: dict[int, set[float]] = {}
        for row in rows:
            if row.direction is way:
                of_runs.setdefault(row.run, set()).add(row.target)
        name = way.name.lower()
        if not of_runs:
            remarks.append(
                f"{source.name}: no {name} reading at all: measure the other way too, or build a table of "
                "one direction (--one-way)"
            )
            continue
        measured = set().union(*of_runs.values())
        ends = [target for target in sorted({targets[0], targets[-1]}) if target not in measured]
        if ends:
            remarks.append(
                f"{source.name}: no {name} reading at {_listed(ends)}, an end: a table estimates it from its "
                "neighbour"
            )
        inner = [target for target in targets[1:-1] if target not in measured]
        if inner:
            remarks.append(f"{source.name}: no {name} reading at {_listed(inner)}: measure there")
        for run, found in sorted(of_runs.items()):
            lacking = [target for target in targets if target in measured - found]
            if lacking:
                remarks.append(
                    f"{source.name}: {name} run {run} has {len(found)} of {len(measured)} readings, none "
                    f"at {_listed(lacking)}: measure it again, or delete the run; the mean there is of the "
                    "others"
                )
    return remarks


def _listed(targets: Sequence[float]) -> str:
    shown = ", ".join(f"{target:.9g}" for target in targets[:8])
    return shown if len(targets) <= 8 else f"{shown} and {len(targets) - 8} more"
