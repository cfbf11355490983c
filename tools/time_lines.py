"""Draws docs/pictures/cut-through.svg: a write of a position and its reply, stored and cut through.

Every character is a box; where it stands follows from ``exchange.cut_through.delay`` and the budget's margin.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from gateway.budget.line import delay_of
from gateway.exchange.cut_through.delay import (
    CRC_BYTES,
    FrameShape,
    acknowledgement_shape,
    stored_ns,
    write_shape,
)
from gateway.modbus.rtu_arrival import BLOCK_HEAD
from gateway.times import NS_PER_MS, NS_PER_S
from tools.diagram import STYLE

BAUDRATE: Final = 9600
CHARACTER_NS: Final = round(11 * NS_PER_S / BAUDRATE)
REQUEST: Final = write_shape(2, 0, 2, is_early=True)
REPLY: Final = acknowledgement_shape()

TITLE: Final = "A write of a position and its reply at 9 600 baud: without a gateway, stored, cut through"
FONTS: Final = 'font-family="DejaVu Sans, Verdana, sans-serif"'
LEFT, TOP, WIDTH = 190.0, 46.0, 940.0
LANE, BOX, PANEL_GAP = 24.0, 16.0, 44.0
PX_PER_MS: Final = 14.2
COLOURS: Final = """\
    .head-byte { fill: #c9d8ea; stroke: #1f2933; stroke-width: 0.8 }
    .position-byte { fill: #e8a33d; stroke: #1f2933; stroke-width: 0.8 }
    .crc-byte { fill: #12633f; stroke: #1f2933; stroke-width: 0.8 }
    .tick { stroke: #c9d1d9; stroke-width: 1 }
    @media (prefers-color-scheme: dark) {
      .head-byte { fill: #35506e; stroke: #c9d1d9 }
      .position-byte { fill: #b97a1a; stroke: #c9d1d9 }
      .crc-byte { fill: #5cc492; stroke: #c9d1d9 }
      .tick { stroke: #30363d }
    }
"""


@dataclass(frozen=True)
class Frame:
    """A frame on a lane."""

    lane: int
    begins_ns: int
    shape: FrameShape

    @property
    def ends_ns(self) -> int:
        """When its last bit is there."""
        return self.begins_ns + self.shape.length * CHARACTER_NS


@dataclass(frozen=True)
class Panel:
    """One way from the controller to the drive and back."""

    name: str
    lanes: tuple[str, ...]
    frames: tuple[Frame, ...]

    @property
    def ends_ns(self) -> int:
        """When the controller has all of the reply."""
        return self.frames[-1].ends_ns


DIRECT_LANES: Final = ("controller → drive", "drive → controller")
LANES: Final = ("controller → gateway", "gateway → drive", "drive → gateway", "gateway → controller")


def through(name: str, request_delay_ns: int, reply_delay_ns: int) -> Panel:
    """Return the way through a gateway in which frames begin to leave so long after they began to come."""
    came = Frame(0, 0, REQUEST)
    left = Frame(1, request_delay_ns, REQUEST)
    answered = Frame(2, left.ends_ns, REPLY)
    return Panel(name, LANES, (came, left, answered, Frame(3, answered.begins_ns + reply_delay_ns, REPLY)))


def panels() -> tuple[Panel, ...]:
    """Return the three ways, for two wires of the same baud rate and a drive that answers at once."""
    asked = Frame(0, 0, REQUEST)
    delays = [delay_of(shape, CHARACTER_NS, CHARACTER_NS).delay_ns for shape in (REQUEST, REPLY)]
    whole = [stored_ns(shape, CHARACTER_NS) for shape in (REQUEST, REPLY)]
    return (
        Panel("without a gateway", DIRECT_LANES, (asked, Frame(1, asked.ends_ns, REPLY))),
        through("stored", *whole),
        through("cut through", *delays),
    )


def picture() -> str:
    """Return the picture as SVG."""
    drawn: list[str] = []
    y = TOP
    for panel in panels():
        drawn += _panel(panel, y)
        y += LANE * len(panel.lanes) + PANEL_GAP
    height = y + 26
    ticks = [_tick(ms, y - PANEL_GAP + 8) for ms in range(0, 55, 5)]
    size = f"0 0 {WIDTH:g} {height:g}"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{size}" {FONTS} font-size="13" role="img">',
        f"  <title>{TITLE}</title>",
        f"  <style>\n{STYLE}{COLOURS}  </style>",
        f'  <rect class="paper" x="0.5" y="0.5" width="{WIDTH - 1:g}" height="{height - 1:g}" rx="6"/>',
        *ticks,
        *drawn,
        *_legend(height - 14),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _x(at_ns: int) -> float:
    return LEFT + PX_PER_MS * at_ns / NS_PER_MS


def _tick(ms: int, bottom: float) -> str:
    x = _x(ms * NS_PER_MS)
    return (
        f'  <path class="tick" d="M{x:.1f} {TOP - 8:g} V{bottom:g}"/>'
        f'<text class="ink" x="{x:.1f}" y="{TOP - 16:g}" text-anchor="middle" font-size="11">{ms} ms</text>'
    )


def _panel(panel: Panel, top: float) -> Iterator[str]:
    yield f'  <text class="event" x="12" y="{top + 6:g}" font-weight="bold">{panel.name}</text>'
    for lane, name in enumerate(panel.lanes):
        y = top + LANE * (lane + 0.95)
        where = f'x="{LEFT - 10:g}" y="{y:g}" text-anchor="end" font-size="12"'
        yield f'  <text class="ink" {where}>{name}</text>'
    for frame in panel.frames:
        yield from _frame(frame, top + LANE * (frame.lane + 0.4))
    last = panel.frames[-1]
    y = top + LANE * (last.lane + 0.95)
    said = f"{panel.ends_ns / NS_PER_MS:.1f} ms"
    yield f'  <text class="event" x="{_x(panel.ends_ns) + 6:.1f}" y="{y:g}">{said}</text>'


def _frame(frame: Frame, y: float) -> Iterator[str]:
    for index in range(frame.shape.length):
        x = _x(frame.begins_ns + index * CHARACTER_NS)
        width = PX_PER_MS * CHARACTER_NS / NS_PER_MS - 1.2
        kind = _kind(frame.shape, index)
        yield f'  <rect class="{kind}" x="{x:.1f}" y="{y:g}" width="{width:.1f}" height="{BOX:g}" rx="2"/>'


def _kind(shape: FrameShape, index: int) -> str:
    if index >= shape.length - CRC_BYTES:
        return "crc-byte"
    return "position-byte" if shape is REQUEST and index >= BLOCK_HEAD else "head-byte"


def _legend(y: float) -> Iterator[str]:
    x = LEFT
    for kind, said in (("head-byte", "head"), ("position-byte", "position"), ("crc-byte", "check sum")):
        yield f'  <rect class="{kind}" x="{x:g}" y="{y - 11:g}" width="14" height="12" rx="2"/>'
        yield f'  <text class="ink" x="{x + 20:g}" y="{y:g}" font-size="12">{said}</text>'
        x += 110
