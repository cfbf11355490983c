"""What is left after compensation, on a scale of its own."""

from typing import TYPE_CHECKING, Final

from gateway.metrology.evaluation import Evaluation
from gateway.report.figures.panel import Panel, dress, legend
from gateway.report.figures.readings import WAYS, draw_approach, edges
from gateway.report.findings import Findings
from gateway.report.ink import QUIET

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROOM: Final = 0.08
"""Of the height, above and below what is shown."""


def residue_panel(found: Findings) -> Panel | None:
    """Return the residue magnified, if there are readings before to compare it with."""
    after = found.after
    if after is None or found.before is None:
        return None
    accuracy, limits = after.accuracy, _limits(found, after)

    def draw(axes: "Axes") -> None:
        dress(axes, found, "deviation")
        for way, colour, style in WAYS:
            draw_approach(axes, found, after, (way, colour, style))
        bounds = _bounds(found)
        if bounds is not None:
            for place, edge in zip(("low", "high"), bounds, strict=True):
                axes.axhline(edge, color=QUIET, linewidth=0.9, linestyle=(0, (6, 3)), gid=f"accuracy-{place}")
        if limits is not None:
            axes.set_ylim(*limits)
        legend(axes)

    about = f"What is left after compensation ({found.after_word}), magnified."
    if accuracy is not None:
        about += (
            f" The dashed lines hold all means with their 2s: they lie {found.scale.rounded(accuracy)} "
            "apart, the accuracy A."
        )
    if limits is not None and not limits[0] <= 0.0 <= limits[1]:
        about += " That all of it lies to one side of 0 is the choice of the zero, at home, and no error."
    return Panel("residue", f"Residue after compensation, magnified ({found.after_word})", about, draw)


def _limits(found: Findings, after: Evaluation) -> tuple[float, float] | None:
    """Return the scale that holds all of it, whether 0 is in it or not; None where nothing differs."""
    values = [found.scale.of(edge) for edge in edges(after)]
    room = (max(values) - min(values)) * ROOM
    return (min(values) - room, max(values) + room) if room else None


def _bounds(found: Findings) -> tuple[float, float] | None:
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
