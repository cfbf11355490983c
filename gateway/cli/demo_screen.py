"""The live screen of the demonstration: a panel for each axis, drawn several times a second."""

import asyncio
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.style import Style
from rich.table import Table
from rich.text import Text

from gateway.commissioning.demo.cycle import AxisView, DemoObserver, Judged, View

BLANK: Final = 0x2800
DOTS: Final = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of a braille character by row and column (Unicode, block 2800)."""


@dataclass(frozen=True, slots=True)
class Layer:
    """Points in one colour; later layers colour the characters that they share with earlier ones."""

    points: Sequence[tuple[float, float]]
    style: str


def braille_plot(
    layers: Iterable[Layer], x_range: tuple[float, float], y_limit: float, columns: int, rows: int
) -> Text:
    """Draw points with x in ``x_range`` and y in ±``y_limit``; points outside are on the border.

    >>> braille_plot([Layer([(0.0, 1.0), (1.0, -1.0)], "red")], (0.0, 1.0), 1.0, columns=2, rows=1).plain
    '⠁⢀'
    """
    dots = [[0] * columns for _ in range(rows)]
    styles = [[""] * columns for _ in range(rows)]
    for layer in layers:
        for x, y in layer.points:
            column = _cell((x - x_range[0]) / (x_range[1] - x_range[0]), 2 * columns)
            row = _cell((y_limit - y) / (2 * y_limit), 4 * rows)
            dots[row >> 2][column >> 1] |= DOTS[row & 3][column & 1]
            styles[row >> 2][column >> 1] = layer.style
    return Text("\n").join(_row(*row) for row in zip(dots, styles, strict=True))


def _row(dots: Sequence[int], styles: Sequence[str]) -> Text:
    """Join neighbours of one colour: a terminal needs a colour code only at a change."""
    text = Text()
    cells = zip(dots, styles, strict=True)
    for style, run in groupby(cells, key=lambda cell: cell[1]):
        text.append("".join(chr(BLANK + bits) for bits, _ in run), Style.parse(style))
    return text


def bar(length_um: float, full_um: float, columns: int, style: str) -> Text:
    """Draw a bar of ``length_um``; ``full_um`` fills all columns. Anything above 0 is visible.

    >>> bar(25.0, 100.0, 4, "red").plain
    '█   '
    """
    eighths = round(8 * columns * min(1.0, length_um / full_um)) if full_um > 0 else 0
    eighths = max(eighths, 1 if length_um > 0 else 0)
    blocks = "█" * (eighths >> 3) + (chr(0x2590 - (eighths & 7)) if eighths & 7 else "")
    return Text(blocks.ljust(columns), Style.parse(style))


def _cell(share: float, cells: int) -> int:
    return min(max(int(share * cells), 0), cells - 1)


REFRESH_S: Final = 0.1
UM_PER_MM: Final = 1000.0
LEGEND: Final = (
    "[bold]A worn machine becomes accurate.[/] The controller commands positions; the gateway adds the "
    "correction of the table and subtracts it from every position read back; a laser shows the real "
    "position of the nut.\n[yellow]measured[/] by the laser   [red]without[/] the table   "
    "[green]with[/] the table   [dim]a new machine each round, Ctrl-C ends it[/]"
)
LEGEND_ROWS: Final = 5
PANEL_ROWS: Final = 5
"""Rows of a panel besides its plot: frame, positions, two bars."""
BAR_LABEL_COLUMNS: Final = 26


class Narrator(DemoObserver):
    """Prints on a console which step begins."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def on_phase(self, axis: AxisView) -> None:
        """Print one line."""
        stops = f" ({axis.stops_total} stops)" if axis.stops_total else ""
        line = f"axis {axis.spec.title}: {axis.phase.value}{stops}"
        self._console.print(line, highlight=False, soft_wrap=True)


class Screen(DemoObserver):
    """Shows rounds until it is cancelled."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._view: View | None = None
        self._finished: View | None = None
        self._live = Live(console=console, auto_refresh=False, vertical_overflow="crop")

    def on_view(self, view: View) -> None:
        """Show this view from now on."""
        self._view = view

    def on_end(self, view: View) -> None:
        """Keep the result for the end."""
        self._finished = view

    async def run(self) -> None:
        """Refresh until cancelled; then leave the last picture, and the result of the last complete round."""
        try:
            with self._live:
                while True:
                    self._live.update(self.picture(), refresh=True)
                    await asyncio.sleep(REFRESH_S)
        finally:
            if self._finished:
                self._console.print(summary(self._finished))

    def picture(self) -> RenderableType:
        """Return the present picture of the screen."""
        view = self._view
        if view is None:
            return Text("starting …")
        rows = (self._console.height - LEGEND_ROWS) // len(view.axes) - PANEL_ROWS
        panels = [axis_panel(axis, self._console.width, max(rows, 0)) for axis in view.axes.values()]
        return Group(Text.from_markup(LEGEND), *panels)


def axis_panel(axis: AxisView, width: int, plot_rows: int) -> Panel:
    """Draw one axis: its errors over its travel, its positions, its progress."""
    columns = max(20, width - 4)
    full_um = max(axis.error_without_um, worst_measured_um(axis), 1.0)
    parts: list[RenderableType] = []
    if plot_rows:
        layers = [
            Layer(_points(axis.measured), "yellow"),
            Layer(_points(axis.without), "red"),
            Layer(_points(axis.corrected), "green"),
        ]
        parts.append(braille_plot(layers, (axis.spec.low, axis.spec.high), full_um, columns, plot_rows))
    parts += [
        _positions(axis),
        _bar_line("without", axis.error_without_um, full_um, columns, "red"),
        _bar_line("with", axis.error_with_um, full_um, columns, "green"),
    ]
    return Panel(
        Group(*parts),
        title=f"axis {axis.spec.title}",
        title_align="left",
        subtitle=_progress(axis),
        subtitle_align="right",
    )


def worst_measured_um(axis: AxisView) -> float:
    """Largest deviation in the laser readings so far."""
    return max((abs(stop.error_um) for stop in axis.measured), default=0.0)


def _points(judged: list[Judged]) -> list[tuple[float, float]]:
    return [(stop.nominal, stop.error_um) for stop in judged]


def _positions(axis: AxisView) -> Text:
    unit = axis.spec.units.value
    decimals = 3 if axis.spec.mm == 1.0 else 4
    added_um = (axis.commanded - axis.nominal) * axis.spec.mm * UM_PER_MM
    exact = f"{axis.inexact_readbacks} readbacks differ" if axis.inexact_readbacks else "readback exact"
    text = Text.from_markup(
        f"commanded [bold]{axis.nominal:+.{decimals}f}[/] {unit} → {axis.commanded:+.{decimals}f} "
        f"({added_um:+.1f} µm), nut at {axis.nut:+.{decimals}f}, {exact}",
        overflow="ellipsis",
    )
    text.no_wrap = True
    return text


def _bar_line(label: str, error_um: float, full_um: float, columns: int, style: str) -> Text:
    line = Text(f"{label:>8} {error_um:7.1f} µm ", style)
    line.append_text(bar(error_um, full_um, max(1, columns - BAR_LABEL_COLUMNS), style))
    return line


def _progress(axis: AxisView) -> Text:
    stops = f" {axis.stops_done}/{axis.stops_total}" if axis.stops_total else ""
    return Text(f"{axis.phase.value}{stops}", style="dim")


def summary(view: View) -> Table:
    """Return the result of a round as a table for a terminal."""
    table = Table(title="Worst error of the nut at random targets, approached from both sides")
    for column in ("axis", "screw", "backlash", "without", "with", "left over", "read back"):
        table.add_column(column, justify="left" if column == "axis" else "right")
    for axis in view.axes.values():
        left_over = axis.error_with_um / axis.error_without_um if axis.error_without_um else 0.0
        table.add_row(
            f"{axis.spec.name}, {axis.spec.controller.value} → {axis.spec.drive.value}",
            f"{axis.pitch_error_um:.0f} µm",
            f"{axis.backlash_um:.0f} µm",
            f"[red]{axis.error_without_um:.1f} µm[/]",
            f"[green]{axis.error_with_um:.1f} µm[/]",
            f"{left_over:.1%}",
            "exact" if axis.is_readback_exact else f"[red]{axis.inexact_readbacks} differ[/]",
        )
    return table
