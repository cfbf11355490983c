"""Draws states and what leads from one to the other as SVG: the same bytes for the same tables.

Where a box stands and which way an arrow takes is said by hand in a :class:`Layout`; which arrows there are
and what is written on them comes from the tables. What the layout does not place, what it places and nobody
asked for, and what would lie on something else is an error that names it.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from html import escape
from itertools import combinations, pairwise
from typing import Final, NamedTuple

Point = tuple[float, float]
Arrows = Mapping[tuple[str, str], tuple[str, ...]]
"""From where to where, and the events that lead there. An end is a state, ``any`` or ``group NAME``."""

ANY: Final = "any"
"""The box from which an arrow starts that starts in every state."""
NODE: Final = (140.0, 40.0)
ANY_NODE: Final = (80.0, 36.0)
LINE_HEIGHT: Final = 16.0
LETTER: Final = 7.7
"""Width of a letter of a label, in a wide font (DejaVu Sans, 13 px)."""

STYLE: Final = """\
    .paper { fill: #ffffff; stroke: #c9d1d9 }
    .state { fill: #f3f6fa; stroke: #1f2933; stroke-width: 1.6 }
    .any { fill: #ffffff; stroke: #1f2933; stroke-width: 1.6; stroke-dasharray: 5 4 }
    .frame { fill: none; stroke: #12633f; stroke-width: 1.4; stroke-dasharray: 2 4 }
    .arrow { fill: none; stroke: #46525e; stroke-width: 1.5 }
    .head { fill: #46525e }
    .ink { fill: #1f2933 }
    .event { fill: #9a3b06; font-size: 13px }
    .caption { fill: #12633f; font-size: 13px; font-style: italic }
    @media (prefers-color-scheme: dark) {
      .paper { fill: #161b22; stroke: #30363d }
      .state { fill: #21262d; stroke: #c9d1d9 }
      .any { fill: #161b22; stroke: #c9d1d9 }
      .frame { stroke: #5cc492 }
      .arrow { stroke: #b6c2cf }
      .head { fill: #b6c2cf }
      .ink { fill: #e6edf3 }
      .event { fill: #ff9a5c }
      .caption { fill: #5cc492 }
    }
"""
"""The colours of docs/pictures/wiring.svg."""


class LayoutError(Exception):
    """A picture that cannot be drawn as it is laid out; the message names what is wrong."""


class Box(NamedTuple):
    """A rectangle: its left and upper edge, and its size."""

    x: float
    y: float
    width: float
    height: float

    def smaller(self, by: float) -> "Box":
        """Return the box within this one."""
        return Box(self.x + by, self.y + by, self.width - 2 * by, self.height - 2 * by)

    def has_on_edge(self, point: Point) -> bool:
        """Whether a point lies on an edge."""
        return self.meets(point, point) and not self.smaller(0.01).meets(point, point)

    def meets(self, start: Point, end: Point) -> bool:
        """Whether a straight line has a point in the box (Liang and Barsky)."""
        first, last = 0.0, 1.0
        for low, size, a, b in (
            (self.x, self.width, start[0], end[0]),
            (self.y, self.height, start[1], end[1]),
        ):
            if a == b:
                if not low <= a <= low + size:
                    return False
                continue
            enters, leaves = sorted(((low - a) / (b - a), (low + size - a) / (b - a)))
            first, last = max(first, enters), min(last, leaves)
        return first <= last

    def overlaps(self, other: "Box") -> bool:
        """Whether two boxes have an area in common."""
        return (
            self.x < other.x + other.width
            and other.x < self.x + self.width
            and self.y < other.y + other.height
            and other.y < self.y + self.height
        )


class Route(NamedTuple):
    """The way of an arrow, and where its events stand."""

    points: tuple[Point, ...]
    label: Point
    """Of the first line: its baseline, at the side that ``anchor`` says."""
    anchor: str = "start"
    is_stacked: bool = False
    """Each event has a line of its own."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Where everything in a picture stands."""

    name: str
    """Of the file."""
    title: str
    width: float
    height: float
    nodes: Mapping[str, Point]
    """The centre of each state."""
    routes: Mapping[tuple[str, str], Route]
    frames: Mapping[str, Box] = field(default_factory=dict)
    """Around the states of each group."""


def drawn(layout: Layout, states: Iterable[str], groups: Mapping[str, Iterable[str]], arrows: Arrows) -> str:
    """Return the picture.

    Raises:
        LayoutError: something has no place in the layout, or lies on something else.
    """
    states = list(states)
    uses_any = any(source == ANY for source, _ in arrows)
    nodes = [*states, *([ANY] if uses_any else [])]
    _compare(layout, "place for the state", nodes, layout.nodes)
    _compare(layout, "frame for the group", groups, layout.frames)
    _compare(layout, "way for the arrow", map(_named, arrows), map(_named, layout.routes))
    boxes = {name: _node_box(name, layout.nodes[name]) for name in nodes}
    for problem in _problems(layout, boxes, groups, arrows):
        raise LayoutError(f"{layout.name}: {problem}; mend its layout")
    return "".join(f"{line}\n" for line in _lines(layout, boxes, arrows))


def _named(ends: tuple[str, str]) -> str:
    return f"{ends[0]} → {ends[1]}"


def _compare(layout: Layout, what: str, needed: Iterable[str], placed: Iterable[str]) -> None:
    needed, placed = list(needed), list(placed)
    for name in needed:
        if name not in placed:
            raise LayoutError(f"{layout.name}: the layout has no {what} {name}")
    for name in placed:
        if name not in needed:
            raise LayoutError(f"{layout.name}: the layout has a {what} {name}, which there is not")


def _node_box(name: str, centre: Point) -> Box:
    width, height = ANY_NODE if name == ANY else NODE
    return Box(centre[0] - width / 2, centre[1] - height / 2, width, height)


def _label(route: Route, events: tuple[str, ...]) -> list[tuple[Point, str]]:
    x, y = route.label
    lines = [f"{event}," for event in events[:-1]] + [events[-1]] if route.is_stacked else [", ".join(events)]
    return [((x, y + number * LINE_HEIGHT), line) for number, line in enumerate(lines)]


def _label_boxes(route: Route, events: tuple[str, ...]) -> Iterator[Box]:
    for (x, y), line in _label(route, events):
        width = LETTER * len(line)
        left = {"start": x, "middle": x - width / 2, "end": x - width}[route.anchor]
        yield Box(left, y - 11.0, width, 14.0)


def _caption(frame: Box) -> Point:
    return frame.x + 8.0, frame.y + 17.0


def _problems(
    layout: Layout, boxes: Mapping[str, Box], groups: Mapping[str, Iterable[str]], arrows: Arrows
) -> Iterator[str]:
    """Yield what lies on something else, or does not begin or end where it should."""
    ends = {**boxes, **{f"group {name}": frame for name, frame in layout.frames.items()}}
    texts = [
        (f"the label of {_named(key)}", box)
        for key, events in arrows.items()
        for box in _label_boxes(layout.routes[key], events)
    ]
    for name, frame in layout.frames.items():
        x, y = _caption(frame)
        texts.append((f"the caption of {name}", Box(x, y - 11.0, LETTER * len(name), 14.0)))
        for state, box in boxes.items():
            is_inside = frame.x < box.x and box.x + box.width < frame.x + frame.width
            is_inside = is_inside and frame.y < box.y and box.y + box.height < frame.y + frame.height
            if is_inside is not (state in groups[name]):
                yield f"{state} is {'inside' if is_inside else 'outside'} the frame of {name}"
    things = [*boxes.items(), *texts]
    paper = Box(0, 0, layout.width, layout.height).smaller(4)
    for name, box in things:
        if box.x < paper.x or box.y < paper.y:
            yield f"{name} lies beyond the edge"
        if box.x + box.width > paper.x + paper.width or box.y + box.height > paper.y + paper.height:
            yield f"{name} lies beyond the edge"
    for (name, box), (other_name, other) in combinations(things, 2):
        if box.overlaps(other):
            yield f"{name} lies on {other_name}"
    for key in arrows:
        points = layout.routes[key].points
        for end, point in zip(key, (points[0], points[-1]), strict=True):
            if not ends[end].has_on_edge(point):
                yield f"the arrow {_named(key)} does not touch {end}"
        for start, stop in pairwise(points):
            for name, box in things:
                if box.smaller(1.0).meets(start, stop):
                    yield f"the arrow {_named(key)} goes through {name}"


def _lines(layout: Layout, boxes: Mapping[str, Box], arrows: Arrows) -> Iterator[str]:
    width, height = f"{layout.width:g}", f"{layout.height:g}"
    told = "; ".join(f"{_named(key)}: {', '.join(events)}" for key, events in arrows.items())
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
        f'height="{height}" role="img" aria-labelledby="t d" font-family="sans-serif" font-size="14">'
    )
    yield f'  <title id="t">{escape(layout.title)}</title>'
    yield f'  <desc id="d">{escape(told)}</desc>'
    yield f"  <style>\n{STYLE}  </style>"
    yield "  <defs>"
    yield '    <marker id="head" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" markerHeight="8"'
    yield '        orient="auto">'
    yield '      <path class="head" d="M0 1 L10 5 L0 9 z"/>'
    yield "    </marker>"
    yield "  </defs>"
    yield f"  {_rect('paper', Box(0, 0, layout.width, layout.height).smaller(0.5))}"
    for name, frame in layout.frames.items():
        yield f"  {_rect('frame', frame)}"
        x, y = _caption(frame)
        yield f'  <text class="caption" x="{x:g}" y="{y:g}">{escape(name)}</text>'
    for key in arrows:
        points = " L".join(f"{x:g} {y:g}" for x, y in layout.routes[key].points)
        yield f'  <path class="arrow" d="M{points}" marker-end="url(#head)"/>'
    for name, box in boxes.items():
        yield f"  {_rect('any' if name == ANY else 'state', box)}"
        x, y = box.x + box.width / 2, box.y + box.height / 2 + 5
        yield f'  <text class="ink" x="{x:g}" y="{y:g}" text-anchor="middle">{escape(name)}</text>'
    for key, events in arrows.items():
        route = layout.routes[key]
        for (x, y), line in _label(route, events):
            at = f'x="{x:g}" y="{y:g}" text-anchor="{route.anchor}"'
            yield f'  <text class="event" {at}>{escape(line)}</text>'
    yield "</svg>"


def _rect(kind: str, box: Box) -> str:
    return (
        f'<rect class="{kind}" x="{box.x:g}" y="{box.y:g}" width="{box.width:g}" height="{box.height:g}" '
        'rx="6"/>'
    )
