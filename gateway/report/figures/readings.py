"""All readings with their means and 2s bands, before and after beside each other on one scale."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gateway.metrology.evaluation import Approach, Evaluation
from gateway.report.envelope import thinned
from gateway.report.figures.panel import Panel, curve, dress, legend
from gateway.report.findings import Findings, count_of_readings
from gateway.report.ink import BACKWARD, BACKWARD_STYLE, FORWARD, FORWARD_STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WAYS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("forward", FORWARD, FORWARD_STYLE),
    ("backward", BACKWARD, BACKWARD_STYLE),
)
_ROOM: float = 0.05


def readings_panels(found: Findings) -> list[Panel]:
    """Return the readings before and those after, on the same scale."""
    limits = _limits(found)
    made = []
    if found.before is not None:
        title = f"{'Before: readings' if found.after is not None else 'Readings'}, {_shown(found.before)}"
        made.append(_panel(found, found.before, "before", title, limits))
    if found.after is not None:
        words = "same scale" if found.before is not None else _shown(found.after)
        title = f"After ({found.after_word}): {words}"
        made.append(_panel(found, found.after, "after", title, limits))
    return made


def _panel(
    found: Findings, evaluation: Evaluation, when: str, title: str, limits: tuple[float, float] | None
) -> Panel:
    def draw(axes: "Axes") -> None:
        dress(axes, found, "deviation")
        for way, colour, style in WAYS:
            draw_approach(axes, found, evaluation, (way, colour, style))
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
    if when == "after" and found.story.is_predicted:
        about += " These readings are predicted: nobody measured them."
    is_half = found.before is not None and found.after is not None
    return Panel(f"readings-{when}", title, about, draw, is_half)


def draw_approach(
    axes: "Axes", found: Findings, evaluation: Evaluation, what: tuple[str, str, dict[str, Any]]
) -> None:
    """Draw one direction: band, single readings, mean."""
    way, colour, style = what
    show = found.scale.of
    points = approaches(evaluation, way)
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


def approaches(evaluation: Evaluation, way: str) -> list[tuple[float, Approach]]:
    """Return the targets that were approached in a direction."""
    found = []
    for target in evaluation.targets:
        approach = target.forward if way == "forward" else target.backward
        if approach is not None:
            found.append((target.target, approach))
    return found


def _outline(targets: list[float], low: list[float], high: list[float]) -> tuple[list[float], list[float]]:
    """Return the corners of a band; its edges are thinned, so each has points of its own."""
    (x_low, low), (x_high, high) = thinned(targets, low), thinned(targets, high)
    return [*x_low, *reversed(x_high)], [*low, *reversed(high)]


def _shown(evaluation: Evaluation) -> str:
    return "means, 2s bands" if _has_bands(evaluation) else "means"


def _has_bands(evaluation: Evaluation) -> bool:
    return all(
        approach.s is not None
        for target in evaluation.targets
        for approach in (target.forward, target.backward)
        if approach is not None
    )


def _limits(found: Findings) -> tuple[float, float] | None:
    """Return the scale that holds everything before and after, and the line of no deviation."""
    values = [0.0]
    for evaluation in (found.before, found.after):
        if evaluation is not None:
            values += [found.scale.of(edge) for edge in edges(evaluation)]
    low, high = min(values), max(values)
    room = (high - low) * _ROOM
    return (low - room, high + room) if room else None


def edges(evaluation: Evaluation) -> Sequence[float]:
    """Return everything that a picture of readings must have room for, in the units of the axis."""
    found: list[float] = []
    for target in evaluation.targets:
        for approach in (target.forward, target.backward):
            if approach is not None:
                s = approach.s or 0.0
                found += [*approach.deviations, approach.mean - 2 * s, approach.mean + 2 * s]
    return found
