"""The curve of an axis as a small drawing that needs nothing else: for reports, tickets and dashboards."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from typing import Any, Final

from gateway.supervisor.http.curve import Curve

MEDIA_TYPE: Final = "image/svg+xml"
POINTS: Final = 700
"""More than one for each column of the drawing shows nothing more."""
MOST_DOTS: Final = 60
"""Beyond that single points cannot be told from the line."""
WIDTH, HEIGHT = 760, 340
LEFT, RIGHT, TOP, BOTTOM = 80, 20, 44, 56
FORWARD_COLOUR: Final = "#0b5cad"
BACKWARD_COLOUR: Final = "#b34700"
TEXT_COLOUR: Final = "#333"
GRID_COLOUR: Final = "#ddd"
FINE: Final = {"mm": ("µm", 1000.0), "inch": ("0.001 inch", 1000.0), "degree": ("0.001 degree", 1000.0)}
"""What corrections are shown in, by the units of positions."""

Scale = Callable[[float], float]


def ticks(low: float, high: float, about: int) -> list[float]:
    """Return round numbers from ``low`` to ``high``: 1, 2 or 5 of some power of ten apart.

    >>> ticks(-0.3, 10.2, 6)
    [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
    """
    rough = (high - low) / about
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(step for step in (power, 2 * power, 5 * power, 10 * power) if step >= rough)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(n * step, 12) for n in range(first, last + 1)]


def drawing(name: str, axis: Mapping[str, Any], curve: Curve) -> str:
    """Return an SVG document."""
    unit, per_unit = FINE.get(axis["units"], (axis["units"], 1.0))
    branches = [[per_unit * value for value in branch] for branch in (curve.forward, curve.backward)]
    low, high = _wide(min(0.0, *branches[0], *branches[1]), max(0.0, *branches[0], *branches[1]))
    first, last = curve.positions[0], curve.positions[-1]
    x: Scale = _scale(first, last, LEFT, WIDTH - RIGHT)
    y: Scale = _scale(low, high, HEIGHT - BOTTOM, TOP)
    title = f"Axis {name}: {axis['table']['file'] or 'table'}"
    parts = [
        *_frame(title, curve, first, last, axis["units"]),
        *_grid(ticks(first, last, 8), ticks(low, high, 6), x, y),
        _label(WIDTH / 2, HEIGHT - 12, f"position, {axis['units']}"),
        _label(16, (TOP + HEIGHT - BOTTOM) / 2, f"correction, {unit}", turned=True),
        *_branch(curve.positions, branches[0], x, y, FORWARD_COLOUR, ""),
        *_branch(curve.positions, branches[1], x, y, BACKWARD_COLOUR, "7 4"),
        *_legend(),
    ]
    return "\n".join((*parts, "</svg>", ""))


def _wide(low: float, high: float) -> tuple[float, float]:
    """Leave some room above and below; a table of zeros has some too."""
    room = 0.08 * (high - low) or 1.0
    return low - room, high + room


def _scale(low: float, high: float, at_low: float, at_high: float) -> Scale:
    return lambda value: at_low + (value - low) / (high - low) * (at_high - at_low)


def _frame(title: str, curve: Curve, first: float, last: float, units: str) -> Iterator[str]:
    said = f"{curve.table_points} points from {first:g} to {last:g} {units}; what is added while moving."
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
        f'height="{HEIGHT}" font-family="sans-serif" font-size="13" fill="{TEXT_COLOUR}" role="img">'
    )
    yield f"<title>{_text(title)}</title><desc>{_text(said)}</desc>"
    yield f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>'
    yield f'<text x="{LEFT}" y="24" font-size="15" font-weight="bold">{_text(title)}</text>'


def _grid(across: Sequence[float], up: Sequence[float], x: Scale, y: Scale) -> Iterator[str]:
    for value in across:
        at = x(value)
        yield f'<path d="M{at:.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="{GRID_COLOUR}"/>'
        yield f'<text x="{at:.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">{value:g}</text>'
    for value in up:
        at = y(value)
        colour = "#888" if value == 0.0 else GRID_COLOUR
        yield f'<path d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}" stroke="{colour}"/>'
        yield f'<text x="{LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">{value:g}</text>'


def _branch(
    positions: Sequence[float], values: Sequence[float], x: Scale, y: Scale, *look: str
) -> Iterator[str]:
    colour, dashes = look
    places = [(x(position), y(value)) for position, value in zip(positions, values, strict=True)]
    line = " ".join(f"{across:.1f},{up:.1f}" for across, up in places)
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    yield f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"{dashed}/>'
    for across, up in places if len(places) <= MOST_DOTS else ():
        yield f'<circle cx="{across:.1f}" cy="{up:.1f}" r="3" fill="{colour}"/>'


def _legend() -> Iterator[str]:
    for at, words, colour, dashes in (
        (WIDTH - 260, "forward", FORWARD_COLOUR, ""),
        (WIDTH - 140, "backward", BACKWARD_COLOUR, ' stroke-dasharray="7 4"'),
    ):
        yield f'<path d="M{at} 20h34" stroke="{colour}" stroke-width="2"{dashes}/>'
        yield f'<text x="{at + 40}" y="24">{words}</text>'


def _label(x: float, y: float, words: str, *, turned: bool = False) -> str:
    turn = f' transform="rotate(-90 {x:g} {y:g})"' if turned else ""
    return f'<text x="{x:g}" y="{y:g}" text-anchor="middle"{turn}>{_text(words)}</text>'


def _text(words: str) -> str:
    """Return words for a document: escaped, and without what XML cannot hold."""
    return escape("".join(c if c.isprintable() else "\ufffd" for c in words))
