"""How a report is drawn: colours and settings, one panel, its curves, the bytes of a picture (matplotlib).

The colours and settings are the same on every computer. Blue and vermilion of the Okabe-Ito palette differ
for every kind of colour blindness. For black-and-white prints, forward and backward also differ by the mark,
which points in the direction of travel, and by the line. matplotlib is imported only for drawing.
"""

import io
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from gateway.report.findings import AxisResults

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FOREGROUND: Final = "#1b2129"
QUIET: Final = "#57606c"
GRID: Final = "#dfe3e8"
ZERO: Final = "#949ca8"
FORWARD: Final = "#0072b2"
BACKWARD: Final = "#d55e00"
BOTH: Final = "#00795a"
PAPER: Final = "#ffffff"

VARIABLES: Final = {
    FOREGROUND: "--ink",
    QUIET: "--quiet",
    GRID: "--grid",
    ZERO: "--zero",
    FORWARD: "--forward",
    BACKWARD: "--backward",
    BOTH: "--both",
    PAPER: "--card",
}
"""The page's names for the colours; on a page they follow its light or dark scheme."""

FORWARD_STYLE: Final[dict[str, Any]] = {"color": FORWARD, "marker": ">", "linestyle": "-"}
BACKWARD_STYLE: Final[dict[str, Any]] = {"color": BACKWARD, "marker": "<", "linestyle": (0, (4, 1.6))}
BOTH_STYLE: Final[dict[str, Any]] = {"color": BOTH, "marker": "o", "linestyle": "-"}

_SETTINGS: Final[Any] = {
    "font.family": ["DejaVu Sans"],  # part of matplotlib
    "font.size": 8.5,
    "text.parse_math": False,  # a dollar sign in the name of a machine is not a formula
    "text.color": FOREGROUND,
    "axes.labelcolor": FOREGROUND,
    "axes.edgecolor": ZERO,
    "axes.linewidth": 0.8,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.direction": "out",
    "lines.linewidth": 1.3,
    "lines.markersize": 3.6,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "legend.handlelength": 2.3,
    "legend.borderaxespad": 0.2,
    "legend.columnspacing": 1.1,
    "figure.facecolor": PAPER,
    "axes.facecolor": PAPER,
    "savefig.facecolor": PAPER,
    "svg.fonttype": "path",  # the reader's computer may not have the font
}
MOST_POINTS: Final = 2000
"""A picture is at most some thousand pixels wide: more points make it slower, not better."""
MOST_MARKS: Final = 90
"""A curve with more points has no marks, because they would cover it."""
PNG_DPI: Final = 150
FULL_SIZE: Final = (8.0, 3.0)
HALF_SIZE: Final = (3.9, 2.7)
"""Inches. Half of the page width each, less the gap, so that all have the same letter size."""
_METADATA: Final[dict[str, dict[str, None]]] = {
    "svg": {"Date": None, "Creator": None, "Format": None, "Type": None},
    "png": {"Software": None},
}
"""No metadata that changes with the release or the day."""
_TAG: Final = re.compile(r"<svg\b[^>]*>")
_NOT_DRAWN: Final = re.compile(r"\s*<metadata>.*?</metadata>|\s*<!--.*?-->", re.DOTALL)
"""The creator, and each text repeated as a comment."""


@contextmanager
def settings(salt: str) -> Iterator[None]:
    """Draw with exactly these settings; ``salt`` makes the names inside an SVG reproducible."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        mpl.rcParams["svg.hashsalt"] = salt
        yield


# --- Curves and panels


@dataclass(frozen=True, slots=True)
class Panel:
    """One picture. ``about`` is its caption and its text for screen readers.

    ``is_half``: it is readable at half the width, beside its neighbour.
    """

    name: str
    title: str
    about: str
    draw: "Callable[[Axes], None]"
    is_half: bool = False

    def draw_on(self, axes: "Axes", prefix: str) -> None:
        """Draw it; in an SVG, data elements have ids ``prefix``-``name``-..."""
        self.draw(axes)
        for artist in axes.get_children():
            if gid := artist.get_gid():
                artist.set_gid(f"{prefix}-{self.name}-{gid}")


def dress(axes: "Axes", found: AxisResults, quantity: str, unit: str | None = None) -> None:
    """Label both axes with their units and draw the line of zero deviation."""
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
    """Draw a curve; with very many points, without marks and thinned to the picture's resolution."""
    shown_x, shown_y = thinned(positions, values)
    if len(positions) > MOST_MARKS:
        style["marker"] = ""
    if len(shown_x) < len(positions):
        draw_thinning(axes, len(positions))
    axes.plot(shown_x, shown_y, gid=gid, **style)


def draw_thinning(axes: "Axes", count: int) -> None:
    """Say in the picture that it does not show every point."""
    label = axes.get_xlabel().partition(";")[0]
    axes.set_xlabel(f"{label}; extremes of each {stretch_of(count)} points")


def legend(axes: "Axes") -> None:
    """Put the legend above the picture, where it covers no data and is seen first."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)


def legend_to_the_right(axes: "Axes") -> None:
    """Put the legend to the right, so that a title fits on the left."""
    drawn = axes.get_legend()
    if drawn is not None:
        drawn.set_loc("lower right")
        drawn.set_bbox_to_anchor((1.0, 1.0), transform=axes.transAxes)


def thinned(positions: Sequence[float], values: Sequence[float]) -> tuple[list[float], list[float]]:
    """Return a curve of at most :data:`MOST_POINTS` points that looks the same.

    Of each group of neighbouring points the smallest and the largest stay, in their order, and also both
    ends: no peak is lost. A shorter curve is returned unchanged.

    >>> x, y = thinned(range(10_000), [0.0] * 7_000 + [9.0] + [0.0] * 2_999)
    >>> len(x) <= MOST_POINTS, max(y), x[y.index(9.0)], x[0], x[-1]
    (True, 9.0, 7000, 0, 9999)
    """
    count = len(positions)
    if count <= MOST_POINTS:
        return list(positions), list(values)
    stretch = stretch_of(count)
    kept = {0, count - 1}
    for start in range(0, count, stretch):
        part = range(start, min(start + stretch, count))
        kept |= {min(part, key=values.__getitem__), max(part, key=values.__getitem__)}
    order = sorted(kept)
    return [positions[i] for i in order], [values[i] for i in order]


def stretch_of(count: int) -> int:
    """Return how many neighbouring points of ``count`` form one group: two points of the picture."""
    return -(-count // ((MOST_POINTS - 2) // 2))


def thinning_text(count: int) -> str:
    """Return a note that a curve of ``count`` points was thinned; empty if it was not."""
    if count <= MOST_POINTS:
        return ""
    return f" Of each {stretch_of(count)} of the {count} points only the smallest and the largest are drawn."


# --- Bytes


def panel_svg(panel: Panel, prefix: str) -> str:
    """Draw one panel as a separate SVG; every id in it begins with ``prefix``."""
    from matplotlib.figure import Figure

    with settings(f"{prefix}-{panel.name}"):
        figure = Figure(figsize=HALF_SIZE if panel.is_half else FULL_SIZE, layout="constrained")
        panel.draw_on(figure.add_subplot(), prefix)
        return svg_of(figure, f"{prefix}-{panel.name}-")


def svg_of(figure: "Figure", prefix: str) -> str:
    """Return a figure as SVG text from its first tag on; every id in it begins with ``prefix``."""
    text = saved(figure, "svg").decode()
    text = _NOT_DRAWN.sub("", text[text.index("<svg") :])
    text = re.sub(rf'\bid="(?!{prefix})', f'id="{prefix}', text)
    text = re.sub(r'(xlink:)?href="#', f'href="#{prefix}', text)
    return re.sub(r"url\(#", f"url(#{prefix}", text)


def saved(figure: "Figure", form: str) -> bytes:
    """Render a figure as ``svg`` or ``png``."""
    stream = io.BytesIO()
    with warnings.catch_warnings():
        # A character that the font does not have is drawn as a box: a machine's name may contain any.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        _settle(figure)
        figure.savefig(stream, format=form, dpi=PNG_DPI, metadata=_METADATA[form])
    return stream.getvalue()


def _settle(figure: "Figure") -> None:
    """Round the layout to millionths: its solver leaves different last digits each time."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    parts = list(figure.subfigs)
    while parts:
        part = parts.pop()
        part.bbox_relative.set_points(part.bbox_relative.get_points().round(6))
        parts += part.subfigs
    for axes in figure.axes:
        x, y, width, height = (round(side, 6) for side in axes.get_position().bounds)
        axes.set_position((x, y, width, height))


def opening_tag(svg: str) -> str:
    """Return the first tag of an SVG."""
    found = _TAG.match(svg)
    assert found is not None, "matplotlib writes an svg tag"
    return found[0]
