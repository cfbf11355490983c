"""From panels to bytes: matplotlib, imported only here and when something is drawn."""

import io
import re
import warnings
from typing import TYPE_CHECKING, Final

from gateway.report.figures import Panel
from gateway.report.ink import settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PNG_DPI: Final = 150
FULL_SIZE: Final = (8.0, 3.0)
HALF_SIZE: Final = (3.9, 2.7)
"""Inches. Half of the width of a page each, less the gap: letters of one size in all of them."""
_METADATA: Final[dict[str, dict[str, None]]] = {
    "svg": {"Date": None, "Creator": None, "Format": None, "Type": None},
    "png": {"Software": None},
}
"""Nothing that differs from one release or one day to the next."""
_TAG: Final = re.compile(r"<svg\b[^>]*>")
_NOT_DRAWN: Final = re.compile(r"\s*<metadata>.*?</metadata>|\s*<!--.*?-->", re.DOTALL)
"""Who made it, and every text once more as a comment."""


def panel_svg(panel: Panel, prefix: str) -> str:
    """Draw one panel as SVG of its own; every name in it begins with ``prefix``."""
    from matplotlib.figure import Figure

    with settings(f"{prefix}-{panel.name}"):
        figure = Figure(figsize=HALF_SIZE if panel.is_half else FULL_SIZE, layout="constrained")
        panel.draw_on(figure.add_subplot(), prefix)
        return svg_of(figure, f"{prefix}-{panel.name}-")


def svg_of(figure: "Figure", prefix: str) -> str:
    """Return a figure as SVG text from its first tag on; every name in it begins with ``prefix``."""
    text = saved(figure, "svg").decode()
    text = _NOT_DRAWN.sub("", text[text.index("<svg") :])
    text = re.sub(rf'\bid="(?!{prefix})', f'id="{prefix}', text)
    text = re.sub(r'(xlink:)?href="#', f'href="#{prefix}', text)
    return re.sub(r"url\(#", f"url(#{prefix}", text)


def saved(figure: "Figure", form: str) -> bytes:
    """Render a figure as ``svg`` or ``png``."""
    stream = io.BytesIO()
    with warnings.catch_warnings():
        # A sign that the font does not have is drawn as a box: the name of a machine may hold any.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        _settle(figure)
        figure.savefig(stream, format=form, dpi=PNG_DPI, metadata=_METADATA[form])
    return stream.getvalue()


def _settle(figure: "Figure") -> None:
    """Fix the layout at whole millionths: its solver leaves other last digits each time."""
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
