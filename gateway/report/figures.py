"""The pictures of one axis, one subject each: a function returns a :class:`Panel`, or None without data."""

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable
from gateway.metrology.evaluation import Approach, Evaluation
from gateway.metrology.tables import correction_at
from gateway.report.drawing import (
    BACKWARD,
    BACKWARD_STYLE,
    BOTH,
    BOTH_STYLE,
    FOREGROUND,
    FORWARD,
    FORWARD_STYLE,
    QUIET,
    Panel,
    curve,
    draw_thinning,
    dress,
    legend,
    thinned,
    thinning_text,
)
from gateway.report.findings import AxisResults, count_of_readings
from gateway.report.words import GAP

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gateway.metrology.band import Band

_WAYS: Final[tuple[tuple[str, str, dict[str, Any]], ...]] = (
    ("forward", FORWARD, FORWARD_STYLE),
    ("backward", BACKWARD, BACKWARD_STYLE),
)
_ROOM: Final = 0.05
"""Margin above and below, as a share of the height: for readings and for the residue."""
_RESIDUE_ROOM: Final = 0.08
_BEFORE: Final[dict[str, Any]] = {
    "color": QUIET,
    "marker": "s",
    "markersize": 6,
    "markerfacecolor": "none",
    "linestyle": (0, (1, 1.5)),
}
"""Hollow, because points of the table are often at the same positions."""
_AFTER: Final[dict[str, Any]] = {
    "color": FOREGROUND,
    "marker": "D",
    "markerfacecolor": BOTH,
    "linewidth": 0.9,
}


def panels(found: AxisResults) -> list[Panel]:
    """Return the pictures with data, in reading order."""
    made = (
        *readings_panels(found),
        residue_panel(found),
        correction_panel(found),
        backlash_panel(found),
        slope_panel(found),
    )
    return [panel for panel in made if panel is not None]


# --- Readings, before and after


def readings_panels(found: AxisResults) -> list[Panel]:
    """Return the readings before and those after, on the same scale."""
    measured = [each for each in (found.before, found.after) if each is not None]
    # The line of zero deviation is always included.
    limits = _limits([0.0, *(edge for each in measured for edge in _edges(each, found))], _ROOM)
    made = []
    if found.before is not None:
        title = (
            f"{'Before: readings' if found.after is not None else 'Readings'}, {_parts_shown(found.before)}"
        )
        made.append(_readings_panel(found, found.before, "before", title, limits))
    if found.after is not None:
        words = "same scale" if found.before is not None else _parts_shown(found.after)
        title = f"After ({found.after_word}): {words}"
        made.append(_readings_panel(found, found.after, "after", title, limits))
    return made


def _readings_panel(
    found: AxisResults, evaluation: Evaluation, when: str, title: str, limits: tuple[float, float] | None
) -> Panel:
    def draw(axes: "Axes") -> None:
        dress(axes, found, "deviation")
        for way, colour, style in _WAYS:
            _draw_approach(axes, found, evaluation, (way, colour, style))
        if limits is not None:
            axes.set_ylim(*limits)
        legend(axes)

    if when == "after" and found.before is not None:
        about = f"The same after compensation, on the same scale: {count_of_readings(evaluation)}."
    else:
        about = (
            f"Deviation of the nut from each target: {count_of_readings(evaluation)}. Positive: the nut went "
            "too far. Dots are single readings, the line is their mean"
        )
        about += ", the band two standard deviations (2s) to either side." if _has_bands(evaluation) else "."
    if when == "after" and found.axis_data.is_predicted:
        about += " These readings are predicted, not measured."
    is_half = found.before is not None and found.after is not None
    return Panel(f"readings-{when}", title, about, draw, is_half)


def _draw_approach(
    axes: "Axes", found: AxisResults, evaluation: Evaluation, what: tuple[str, str, dict[str, Any]]
) -> None:
    """Draw one direction: band, single readings, mean."""
    way, colour, style = what
    show = found.scale.of
    points = _approaches(evaluation, way)
    if not points:
        return
    targets = [target for target, _ in points]
    means = [show(each.mean) for _, each in points]
    spreads = [each.s for _, each in points]
    if all(s is not None for s in spreads):
        low, high = (
            [mean + side * show(s or 0.0) for mean, s in zip(means, spreads, strict=True)] for side in (-2, 2)
        )
        outline = _outline(targets, low, high)
        axes.fill(*outline, gid=f"band-{way}", color=colour, alpha=0.16, linewidth=0, zorder=1.8)
    readings = [(target, show(one)) for target, each in points for one in each.deviations]
    x, y = thinned([at for at, _ in readings], [deviation for _, deviation in readings])
    axes.scatter(x, y, gid=f"dots-{way}", s=7, color=colour, alpha=0.55, linewidths=0, zorder=2.2)
    curve(axes, targets, means, f"mean-{way}", label=f"moving {way}", zorder=2.5, **style)


def _approaches(evaluation: Evaluation, way: str) -> list[tuple[float, Approach]]:
    """Return the targets that were approached in a direction."""
    found = []
    for target in evaluation.targets:
        approach = target.forward if way == "forward" else target.backward
        if approach is not None:
            found.append((target.target, approach))
    return found


def _outline(targets: list[float], low: list[float], high: list[float]) -> tuple[list[float], list[float]]:
    """Return the corners of a band; its edges are thinned, so each has its own points."""
    (x_low, low), (x_high, high) = thinned(targets, low), thinned(targets, high)
    return [*x_low, *reversed(x_high)], [*low, *reversed(high)]


def _parts_shown(evaluation: Evaluation) -> str:
    return "means, 2s bands" if _has_bands(evaluation) else "means"


def _has_bands(evaluation: Evaluation) -> bool:
    return all(
        approach.s is not None
        for target in evaluation.targets
        for approach in (target.forward, target.backward)
        if approach is not None
    )


def _limits(values: Sequence[float], share: float) -> tuple[float, float] | None:
    """Return the scale for all values, with a margin above and below; None if all values are equal."""
    low, high = min(values), max(values)
    room = (high - low) * share
    return (low - room, high + room) if room else None


def _edges(evaluation: Evaluation, found: AxisResults) -> list[float]:
    """Return all values that a picture of readings must include, as displayed."""
    lengths: list[float] = []
    for target in evaluation.targets:
        for approach in (target.forward, target.backward):
            if approach is not None:
                s = approach.s or 0.0
                lengths += [*approach.deviations, approach.mean - 2 * s, approach.mean + 2 * s]
    return [found.scale.of(length) for length in lengths]


# --- The residue, magnified


def residue_panel(found: AxisResults) -> Panel | None:
    """Return the residue magnified, if there are readings before to compare it with."""
    after = found.after
    if after is None or found.before is None:
        return None
    accuracy, limits = after.accuracy, _limits(_edges(after, found), _RESIDUE_ROOM)

    def draw(axes: "Axes") -> None:
        dress(axes, found, "deviation")
        for way, colour, style in _WAYS:
            _draw_approach(axes, found, after, (way, colour, style))
        bounds = _bounds(found)
        if bounds is not None:
            for end, edge in zip(("low", "high"), bounds, strict=True):
                axes.axhline(edge, color=QUIET, linewidth=0.9, linestyle=(0, (6, 3)), gid=f"accuracy-{end}")
        if limits is not None:
            axes.set_ylim(*limits)
        legend(axes)

    about = f"What is left after compensation ({found.after_word}), magnified."
    if accuracy is not None:
        about += (
            " All means with their 2s lie between the dashed lines. Their distance, "
            f"{found.scale.rounded(accuracy)}, is the accuracy A."
        )
    if limits is not None and not limits[0] <= 0.0 <= limits[1]:
        about += " All of it is on one side of 0 because the zero is at home; this is not an error."
    return Panel("residue", f"Residue after compensation, magnified ({found.after_word})", about, draw)


def _bounds(found: AxisResults) -> tuple[float, float] | None:
    """Return the two lines whose distance is A."""
    if found.after is None or found.after.accuracy is None:
        return None
    both = [
        (approach.mean, approach.s)
        for target in found.after.targets
        for approach in (target.forward, target.backward)
        if approach is not None and approach.s is not None
    ]
    show = found.scale.of
    return show(min(mean - 2 * s for mean, s in both)), show(max(mean + 2 * s for mean, s in both))


# --- The table


def correction_panel(found: AxisResults) -> Panel | None:
    """Return the correction curves, if there is a table."""
    table = found.axis_data.table
    if table is None:
        return None
    show = found.scale.of

    band = found.axis_data.band

    def draw(axes: "Axes") -> None:
        dress(axes, found, "correction")
        if band is not None:
            _draw_band(axes, found, table, band)
        if table.is_unidirectional:
            one = [show(c) for c in table.forward]
            curve(axes, table.positions, one, "both", label="both directions", **BOTH_STYLE)
        else:
            for name, values, style in (
                ("forward", table.forward, FORWARD_STYLE),
                ("backward", table.backward, BACKWARD_STYLE),
            ):
                shown = [show(c) for c in values]
                curve(axes, table.positions, shown, name, label=f"moving {name}", **style)
        legend(axes)

    largest = found.scale.rounded(table.max_correction())
    about = (
        f"What the gateway adds to a commanded position, at {len(table.positions)} points, with straight "
        f"lines between them. The largest correction is {largest}."
    )
    if table.is_unidirectional:
        about += " The table is the same for both directions."
    if band is not None:
        about += (
            " The band around it is its uncertainty (k = 2): in 95 % of cases the correction that the nut "
            "needs is within it."
        )
        if band.unknown:
            about += " It may be wider, because the targets hide a part of the error."
    about += thinning_text(len(table.positions))
    title = "Correction table" if band is None else "Correction table, bands of 95 %"
    return Panel("correction", title, about, draw)


def _draw_band(axes: "Axes", found: AxisResults, table: CorrectionTable, band: "Band") -> None:
    """Draw the uncertainty to both sides of the corrections, where it was measured."""
    positions = list(band.positions)
    colours = {Direction.FORWARD: FORWARD, Direction.BACKWARD: BACKWARD}
    if table.is_unidirectional:
        colours = {Direction.FORWARD if band.backward is None else Direction.BACKWARD: BOTH}
    for way, colour in colours.items():
        values = band.of(way)
        if values is None:
            continue
        middle = [correction_at(table, x, way) for x in positions]
        low, high = (
            [found.scale.of(c + side * u) for c, u in zip(middle, values, strict=True)] for side in (-1, 1)
        )
        name = f"uncertainty-{way.name.lower()}"
        axes.fill(
            *_outline(positions, low, high), gid=name, color=colour, alpha=0.16, linewidth=0, zorder=1.8
        )


# --- Lost motion


def backlash_panel(found: AxisResults) -> Panel | None:
    """Return lost motion over position, if a table or readings of both directions contain it."""
    table = found.axis_data.table
    measured, left = _lost(found.before), _lost(found.after)
    if table is not None and table.is_unidirectional:
        table = None  # it has no data on lost motion, and a line at 0 would show none
    if table is None and not measured and not left:
        return None
    show = found.scale.of

    def draw(axes: "Axes") -> None:
        dress(axes, found, "lost motion")
        if measured:
            curve(axes, *_points_shown(measured, found), "before", label=found.before_word, **_BEFORE)
        if table is not None:
            lost = [show(f - b) for f, b in zip(table.forward, table.backward, strict=True)]
            curve(axes, table.positions, lost, "table", label="table", **BOTH_STYLE)
        if left:
            words = f"after ({found.after_word})"
            curve(axes, *_points_shown(left, found), "after", label=words, **_AFTER)
        legend(axes)

    about = "How far the nut stays behind when the axis reverses."
    if table is not None:
        largest = found.scale.rounded(table.max_reversal())
        about += f" In the table it is the forward minus the backward correction, and reaches {largest}."
        about += thinning_text(len(table.positions))
    return Panel("backlash", "Backlash", about, draw, is_half=True)


def _lost(evaluation: Evaluation | None) -> list[tuple[float, float]]:
    """Return lost motion at each target that was approached from both sides: -B of the standard."""
    if evaluation is None:
        return []
    targets = ((each.target, each.reversal) for each in evaluation.targets)
    return [(target, -reversal) for target, reversal in targets if reversal is not None]


def _points_shown(
    points: Sequence[tuple[float, float]], found: AxisResults
) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [found.scale.of(lost) for _, lost in points]


# --- The slope of the table


def slope_panel(found: AxisResults) -> Panel | None:
    """Return the slope of the corrections between the points, if there is a table."""
    table = found.axis_data.table
    if table is None:
        return None
    unit = f"{found.scale.deviation}/{found.scale.position}"

    def draw(axes: "Axes") -> None:
        dress(axes, found, "slope", unit)
        branches = [("forward", table.forward, FORWARD_STYLE), ("backward", table.backward, BACKWARD_STYLE)]
        if table.is_unidirectional:
            branches = [("both", table.forward, BOTH_STYLE)]
        for name, values, style in branches:
            edges, slopes = _steps(table, values, found.scale.factor)
            line = {key: style[key] for key in ("color", "linestyle")}
            if len(edges) < 2 * (len(values) - 1):
                draw_thinning(axes, len(values))
            axes.plot(edges, slopes, gid=name, label=name, **line)
        legend(axes)

    about = (
        f"Change of the correction per {found.axis_data.units.value} of travel. The steepest is "
        f"{table.max_slope() * found.scale.factor:.3g}{GAP}{unit}: there the drive moves "
        f"{table.max_slope() * 100:.2g}{GAP}% faster or slower than commanded."
    )
    about += thinning_text(len(table.positions))
    return Panel("slope", "Slope of the corrections", about, draw, is_half=True)


def _steps(table: CorrectionTable, values: Sequence[float], factor: float) -> tuple[list[float], list[float]]:
    """Return a step line: constant between two points, a jump at each."""
    edges: list[float] = []
    slopes: list[float] = []
    for (low, high), (before, after) in zip(pairwise(table.positions), pairwise(values), strict=True):
        edges += [low, high]
        slopes += [(after - before) / (high - low) * factor] * 2
    return thinned(edges, slopes)
