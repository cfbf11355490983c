"""Lost motion over the travel: of the machine as it was measured, in the table, and what is left of it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from gateway.metrology.evaluation import Evaluation
from gateway.report.envelope import thinning_note
from gateway.report.figures.panel import Panel, curve, dress, legend
from gateway.report.findings import Findings
from gateway.report.ink import BOTH, BOTH_STYLE, INK, QUIET

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BEFORE: Final[dict[str, Any]] = {
    "color": QUIET,
    "marker": "s",
    "markersize": 6,
    "markerfacecolor": "none",
    "linestyle": (0, (1, 1.5)),
}
"""Hollow: the points of the table often lie in the same places."""
_AFTER: Final[dict[str, Any]] = {"color": INK, "marker": "D", "markerfacecolor": BOTH, "linewidth": 0.9}


def backlash_panel(found: Findings) -> Panel | None:
    """Return lost motion over position, if a table or readings of both directions tell it."""
    table = found.story.table
    measured, left = _lost(found.before), _lost(found.after)
    if table is not None and table.is_unidirectional:
        table = None  # it knows nothing of lost motion, and a line at 0 would say that there is none
    if table is None and not measured and not left:
        return None
    show = found.scale.of

    def draw(axes: "Axes") -> None:
        dress(axes, found, "lost motion")
        if measured:
            curve(axes, *_shown(measured, found), "before", label=found.before_word, **_BEFORE)
        if table is not None:
            lost = [show(f - b) for f, b in zip(table.forward, table.backward, strict=True)]
            curve(axes, table.positions, lost, "table", label="table", **BOTH_STYLE)
        if left:
            words = f"after ({found.after_word})"
            curve(axes, *_shown(left, found), "after", label=words, **_AFTER)
        legend(axes)

    about = "How far the nut stays behind when the axis turns round."
    if table is not None:
        largest = found.scale.rounded(table.max_reversal())
        about += f" In the table it is the forward less the backward correction, and reaches {largest}."
        about += thinning_note(len(table.positions))
    return Panel("backlash", "Backlash", about, draw, is_half=True)


def _lost(evaluation: Evaluation | None) -> list[tuple[float, float]]:
    """Return lost motion at each target that was approached from both sides: -B of the standard."""
    if evaluation is None:
        return []
    targets = ((each.target, each.reversal) for each in evaluation.targets)
    return [(target, -reversal) for target, reversal in targets if reversal is not None]


def _shown(points: Sequence[tuple[float, float]], found: Findings) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [found.scale.of(lost) for _, lost in points]
