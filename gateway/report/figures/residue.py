"""What is left after compensation, on a scale of its own."""

from typing import TYPE_CHECKING

from gateway.report.figures.panel import Panel, dress, legend
from gateway.report.figures.readings import WAYS, draw_approach
from gateway.report.findings import Findings
from gateway.report.ink import QUIET

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def residue_panel(found: Findings) -> Panel | None:
    """Return the residue magnified, if there are readings before to compare it with."""
    after = found.after
    if after is None or found.before is None:
        return None
    accuracy = after.accuracy

    def draw(axes: "Axes") -> None:
        dress(axes, found, "deviation")
        for way, colour, style in WAYS:
            draw_approach(axes, found, after, (way, colour, style))
        bounds = _bounds(found)
        if bounds is not None:
            for place, edge in zip(("low", "high"), bounds, strict=True):
                axes.axhline(edge, color=QUIET, linewidth=0.9, linestyle=(0, (6, 3)), gid=f"accuracy-{place}")
        legend(axes)

    about = f"What is left after compensation ({found.after_word}), magnified."
    if accuracy is not None:
        about += (
            f" The dashed lines hold all means with their 2s: they lie {found.scale.rounded(accuracy)} "
            "apart, the accuracy A."
        )
    return Panel("residue", f"Residue after compensation, magnified ({found.after_word})", about, draw)


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
