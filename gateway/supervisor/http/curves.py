"""Tables and their curves, as numbers and as a drawing."""

import asyncio
import math
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from gateway.compensation.correction_spec import spec_of_table
from gateway.compensation.errors import SettingsError, TableError
from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import CorrectionTable
from gateway.files import FileRefusedError
from gateway.state.folder import read_state
from gateway.state.tables import WrongTableError, checked, table_path
from gateway.status.axis import AxisStatus, Shares
from gateway.supervisor.http.answers import JSON, json_bytes, not_there, problem, shortened
from gateway.supervisor.http.documents import Window

# --- The curve of an axis in force: the table with its gain, on the controller's scale

FEWEST: Final = 10
MOST: Final = 10_000
DECIMALS: Final = 9
"""Of a length: finer than a double resolves a metre in mm, and coarser than the rest after an offset is
subtracted."""


class NoCurveError(Exception):
    """There is no curve. The message says why."""


@dataclass(frozen=True, slots=True)
class PlottedCurve:
    """Points of a table with the correction at each. No point is interpolated.

    Lengths in the axis's units.
    """

    positions: tuple[float, ...]
    """Nominal: on the controller's scale, as the positions of the status."""
    forward: tuple[float, ...]
    backward: tuple[float, ...]
    indexes: tuple[int, ...]
    """Index of each point in the table, from 0."""
    table_points: int

    @property
    def is_whole(self) -> bool:
        """Whether the curve has every point of the table."""
        return len(self.positions) == self.table_points


def read_curve(state: Path, digest: str, axis: AxisStatus, settings: AxisSettings, most: int) -> PlottedCurve:
    """Return at most ``most`` points of the compiled table ``digest``; blocks.

    ``axis`` is the axis's part of the status model, which contains the gain in force.

    Raises:
        NoCurveError: the compiled table cannot be read, or is not a table.
    """
    try:
        table = checked(read_state(table_path(state, digest)))
        in_force = spec_of_table(table, settings).curve
    except (FileRefusedError, WrongTableError, TableError, SettingsError) as error:
        raise NoCurveError(f"compiled table {digest}: {error}") from error
    assert in_force is not None, "a table makes a curve"
    return _curve(in_force.table, axis.gain, settings.machine_offset, most)


def _curve(table: CorrectionTable, gain: Shares, machine_offset: float, most: int) -> PlottedCurve:
    indexes = tuple(thinned(table, max(FEWEST, most)))
    return PlottedCurve(
        positions=tuple(round(table.positions[i] - machine_offset, DECIMALS) for i in indexes),
        forward=_scaled(table.forward, indexes, gain.forward),
        backward=_scaled(table.backward, indexes, gain.backward),
        indexes=indexes,
        table_points=len(table.positions),
    )


def _scaled(values: Sequence[float], indexes: Sequence[int], gain: float) -> tuple[float, ...]:
    return tuple(round(gain * values[i], DECIMALS) + 0.0 for i in indexes)  # no -0.0


def thinned(table: CorrectionTable, most: int) -> Iterator[int]:
    """Yield ascending indexes of at most ``most`` points: the ends, and the extremes of each interval.

    So the highest and the lowest correction of each branch are always included.
    """
    count = len(table.positions)
    if count <= most:
        yield from range(count)
        return
    branches = (table.forward,) if table.is_unidirectional else (table.forward, table.backward)
    stretches = (most - 2) // (2 * len(branches))
    yield 0
    for k in range(stretches):
        begin, end = 1 + k * (count - 2) // stretches, 1 + (k + 1) * (count - 2) // stretches
        found: set[int] = set()
        for branch in branches:
            values = list(branch[begin:end])
            found |= {begin + values.index(min(values)), begin + values.index(max(values))}
        yield from sorted(found)
    yield count - 1


def curve_as_data(
    name: str, axis: AxisStatus, digest: str, settings: AxisSettings, curve: PlottedCurve
) -> dict[str, Any]:
    """Return a curve as ``/tables/NAME`` shows it."""
    offset = settings.machine_offset
    return {
        "axis": name,
        "units": axis.units,
        "file": axis.table.file,
        "digest": digest,
        "gain": axis.gain,
        "machine_offset": offset,
        "travel": None if settings.travel is None else [round(p - offset, DECIMALS) for p in settings.travel],
        "modulo": settings.modulo or None,
        "table_points": curve.table_points,
        "is_whole": curve.is_whole,
        "indexes": curve.indexes,
        "positions": curve.positions,
        "forward": curve.forward,
        "backward": curve.backward,
    }


# --- The curve of an axis as a small self-contained drawing, for reports, tickets and dashboards

MEDIA_TYPE: Final = "image/svg+xml"
POINTS: Final = 700
"""More than one point for each column of the drawing is not visible."""
MOST_DOTS: Final = 60
"""With more than this, single points merge with the line."""
WIDTH, HEIGHT = 760, 340
LEFT, RIGHT, TOP, BOTTOM = 80, 20, 44, 56
FORWARD_COLOUR: Final = "#0b5cad"
BACKWARD_COLOUR: Final = "#b34700"
TEXT_COLOUR: Final = "#333"
GRID_COLOUR: Final = "#ddd"
FINE: Final = {"mm": ("µm", 1000.0), "inch": ("0.001 inch", 1000.0), "degree": ("0.001 degree", 1000.0)}
"""Display unit and factor of corrections, by the units of positions."""

Scale = Callable[[float], float]


def ticks(low: float, high: float, about: int) -> list[float]:
    """Return round numbers from ``low`` to ``high``: 1, 2 or 5 times a power of ten apart.

    >>> ticks(-0.3, 10.2, 6)
    [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
    """
    rough = (high - low) / about
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(step for step in (power, 2 * power, 5 * power, 10 * power) if step >= rough)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(n * step, 12) for n in range(first, last + 1)]


def drawing(name: str, axis: AxisStatus, curve: PlottedCurve) -> str:
    """Return an SVG document."""
    unit, per_unit = FINE.get(axis.units, (axis.units, 1.0))
    branches = [[per_unit * value for value in branch] for branch in (curve.forward, curve.backward)]
    low, high = _wide(min(0.0, *branches[0], *branches[1]), max(0.0, *branches[0], *branches[1]))
    first, last = curve.positions[0], curve.positions[-1]
    x: Scale = _scale(first, last, LEFT, WIDTH - RIGHT)
    y: Scale = _scale(low, high, HEIGHT - BOTTOM, TOP)
    title = f"Axis {name}: {axis.table.file or 'table'}"
    parts = [
        *_frame(title, curve, first, last, axis.units),
        *_grid(ticks(first, last, 8), ticks(low, high, 6), x, y),
        _label(WIDTH / 2, HEIGHT - 12, f"position, {axis.units}"),
        _label(16, (TOP + HEIGHT - BOTTOM) / 2, f"correction, {unit}", is_rotated=True),
        *_branch(curve.positions, branches[0], x, y, FORWARD_COLOUR, ""),
        *_branch(curve.positions, branches[1], x, y, BACKWARD_COLOUR, "7 4"),
        *_legend(),
    ]
    return "\n".join((*parts, "</svg>", ""))


def _wide(low: float, high: float) -> tuple[float, float]:
    """Add a margin above and below, also for a table of zeros."""
    room = 0.08 * (high - low) or 1.0
    return low - room, high + room


def _scale(low: float, high: float, at_low: float, at_high: float) -> Scale:
    return lambda value: at_low + (value - low) / (high - low) * (at_high - at_low)


def _frame(title: str, curve: PlottedCurve, first: float, last: float, units: str) -> Iterator[str]:
    text = f"{curve.table_points} points from {first:g} to {last:g} {units}; what is added while moving."
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
        f'height="{HEIGHT}" font-family="sans-serif" font-size="13" fill="{TEXT_COLOUR}" role="img">'
    )
    yield f"<title>{_text(title)}</title><desc>{_text(text)}</desc>"
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
    positions: Sequence[float], values: Sequence[float], x: Scale, y: Scale, *style: str
) -> Iterator[str]:
    colour, dashes = style
    points = [(x(position), y(value)) for position, value in zip(positions, values, strict=True)]
    line = " ".join(f"{across:.1f},{up:.1f}" for across, up in points)
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    yield f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"{dashed}/>'
    for across, up in points if len(points) <= MOST_DOTS else ():
        yield f'<circle cx="{across:.1f}" cy="{up:.1f}" r="3" fill="{colour}"/>'


def _legend() -> Iterator[str]:
    for at, words, colour, dashes in (
        (WIDTH - 260, "forward", FORWARD_COLOUR, ""),
        (WIDTH - 140, "backward", BACKWARD_COLOUR, ' stroke-dasharray="7 4"'),
    ):
        yield f'<path d="M{at} 20h34" stroke="{colour}" stroke-width="2"{dashes}/>'
        yield f'<text x="{at + 40}" y="24">{words}</text>'


def _label(x: float, y: float, words: str, *, is_rotated: bool = False) -> str:
    rotation = f' transform="rotate(-90 {x:g} {y:g})"' if is_rotated else ""
    return f'<text x="{x:g}" y="{y:g}" text-anchor="middle"{rotation}>{_text(words)}</text>'


def _text(words: str) -> str:
    """Return text for the document: escaped, and without characters that XML forbids."""
    return escape("".join(c if c.isprintable() else "\ufffd" for c in words))


# --- ``/tables/NAME`` and ``/tables/NAME.svg``: curves, computed in a thread and cached

SVG: Final = ".svg"
KEPT_BYTES: Final = 4_000_000
AT_ONCE: Final = 1
"""Tables of millions of points take seconds and a hundred megabytes each. They have a thread of their own, so
that nothing else waits for one."""


class Tables:
    """Answers with the curve of an axis's table."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._kept: OrderedDict[tuple[object, ...], bytes] = OrderedDict()
        self._threads = ThreadPoolExecutor(AT_ONCE, "curves")

    def close(self) -> None:
        """Compute no more curves."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def answer(self, request: Request) -> Response:
        """Answer ``/tables/NAME``."""
        name: str = request.path_params["name"]
        axis_name, is_drawing = name.removesuffix(SVG), name.endswith(SVG)
        model = self._window.broadcast.model
        axes = {} if model is None else model.axes
        if axis_name not in axes:
            names = [f"/tables/{axis}{SVG if is_drawing else ''}" for axis in axes]
            return not_there(f"/tables/{shortened(name)}", names)
        asked = request.query_params.get("points", str(MOST))
        if not asked.isascii() or not asked.isdigit() or not FEWEST <= int(asked[:9]) <= MOST:
            return problem(400, f"points={shortened(asked)}; allowed: {FEWEST} to {MOST}")
        axis, settings = axes[axis_name], self._window.settings_of(axis_name)
        digest = axis.table.compiled
        if not axis.table.points or not digest:
            return problem(404, f"axis {axis_name} has no table")
        if settings is None:
            return problem(503, "the configuration has not been read yet")
        points = min(int(asked), POINTS) if is_drawing else int(asked)
        try:
            body = await self._body(axis_name, axis, digest, settings, points, is_drawing=is_drawing)
        except NoCurveError as error:
            return problem(503, str(error))
        headers = {"Cache-Control": "no-cache"}
        return Response(body, headers=headers, media_type=MEDIA_TYPE if is_drawing else JSON)

    async def _body(
        self,
        name: str,
        axis: AxisStatus,
        digest: str,
        settings: AxisSettings,
        points: int,
        *,
        is_drawing: bool,
    ) -> bytes:
        file, gain = axis.table.file, axis.gain
        key = (name, digest, file, gain, settings, points, is_drawing)
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]

        def worked_out() -> bytes:
            curve = read_curve(self._window.state, digest, axis, settings, points)
            if is_drawing:
                return drawing(name, axis, curve).encode()
            return json_bytes(curve_as_data(name, axis, digest, settings, curve))

        body = await asyncio.get_running_loop().run_in_executor(self._threads, worked_out)
        self._cache(key, body)
        return body

    def _cache(self, key: tuple[object, ...], body: bytes) -> None:
        self._kept[key] = body
        while sum(map(len, self._kept.values())) > KEPT_BYTES and len(self._kept) > 1:
            self._kept.popitem(last=False)
