"""How steep the table is: how much faster or slower than commanded the drive moves because of it."""

from itertools import pairwise
from typing import TYPE_CHECKING

from gateway.report.envelope import thinned, thinning_note
from gateway.report.figures.panel import Panel, dress, legend, say_thinned
from gateway.report.findings import Findings
from gateway.report.ink import BACKWARD_STYLE, BOTH_STYLE, FORWARD_STYLE
from gateway.report.words import GAP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from gateway.compensation.table import CorrectionTable


def slope_panel(found: Findings) -> Panel | None:
    """Return the slope of the corrections between the points, if there is a table."""
    table = found.story.table
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
                say_thinned(axes, len(values))
            axes.plot(edges, slopes, gid=name, label=name, **line)
        legend(axes)

    about = (
        f"By how much the correction changes per {found.story.units.value} of travel. The steepest is "
        f"{table.max_slope() * found.scale.factor:.3g}{GAP}{unit}: there the drive moves "
        f"{table.max_slope() * 100:.2g}{GAP}% faster or slower than it was commanded."
    )
    about += thinning_note(len(table.positions))
    return Panel("slope", "Slope of the corrections", about, draw, is_half=True)


def _steps(
    table: "CorrectionTable", values: "Sequence[float]", factor: float
) -> tuple[list[float], list[float]]:
    """Return a line of steps: constant between two points, a jump at each."""
    edges: list[float] = []
    slopes: list[float] = []
    for (low, high), (before, after) in zip(pairwise(table.positions), pairwise(values), strict=True):
        edges += [low, high]
        slopes += [(after - before) / (high - low) * factor] * 2
    return thinned(edges, slopes)
