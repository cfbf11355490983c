"""What all pictures of a report share: frame, labels, curves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from gateway.report.envelope import stretch_of, thinned
from gateway.report.findings import Findings
from gateway.report.ink import ZERO

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_MARKS: Final = 90
"""With more points than this a curve is a line without marks: they would cover it."""


@dataclass(frozen=True, slots=True)
class Panel:
    """One picture. ``about`` is its caption, and what is read to whoever cannot see it.

    ``is_half``: it is as good at half the width, beside its neighbour.
    """

    name: str
    title: str
    about: str
    draw: "Callable[[Axes], None]"
    is_half: bool = False

    def draw_on(self, axes: "Axes", prefix: str) -> None:
        """Draw it; what holds data is named ``prefix``-``name``-... in an SVG."""
        self.draw(axes)
        for artist in axes.get_children():
            if gid := artist.get_gid():
                artist.set_gid(f"{prefix}-{self.name}-{gid}")


def dress(axes: "Axes", found: Findings, quantity: str, unit: str | None = None) -> None:
    """Label both axes with their units and draw the line of no deviation."""
    axes.set_xlabel(f"position of {found.named} / {found.scale.position}")
    axes.set_ylabel(f"{quantity} / {unit or found.scale.deviation}")
    axes.axhline(0.0, color=ZERO, linewidth=0.9, zorder=1.5, gid="zero")
    axes.margins(x=0.02)


def curve(
    axes: "Axes",
    positions: Sequence[float],
    values: Sequence[float],
    gid: str,
    **style: Any,
) -> None:
    """Draw a curve; one of very many points without marks, and thinned to what a picture can show."""
    shown_x, shown_y = thinned(positions, values)
    if len(positions) > MOST_MARKS:
        style["marker"] = ""
    if len(shown_x) < len(positions):
        say_thinned(axes, len(positions))
    axes.plot(shown_x, shown_y, gid=gid, **style)


def say_thinned(axes: "Axes", count: int) -> None:
    """Say in the picture itself that it does not show every point."""
    label = axes.get_xlabel().partition(";")[0]
    axes.set_xlabel(f"{label}; extremes of each {stretch_of(count)} points")


def legend(axes: "Axes") -> None:
    """Put the legend above the picture, where it covers no data and is seen first."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)


def legend_to_the_right(axes: "Axes") -> None:
    """Make room for a title on the left."""
    drawn = axes.get_legend()
    if drawn is not None:
        drawn.set_loc("lower right")
        drawn.set_bbox_to_anchor((1.0, 1.0), transform=axes.transAxes)
