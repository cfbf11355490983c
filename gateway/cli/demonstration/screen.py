"""The live screen: one panel for each axis, drawn from the view a few times a second."""

import asyncio
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.text import Text

from gateway.cli.demonstration.plot import Layer, bar, braille_plot
from gateway.cli.demonstration.report import summary
from gateway.cli.demonstration.view import AxisView, Judged, Listener, View

REFRESH_S: Final = 0.1
UM_PER_MM: Final = 1000.0
LEGEND: Final = (
    "[bold]A worn machine becomes accurate.[/] The controller commands; the gateway adds what the table says "
    "and takes it out of every reading; a laser sees where the nut truly is.\n"
    "[yellow]measured[/] by the laser   [red]without[/] the table   [green]with[/] the table   "
    "[dim]a new machine each round, Ctrl-C ends it[/]"
)
LEGEND_ROWS: Final = 5
PANEL_ROWS: Final = 5
"""Rows of a panel besides its plot: frame, positions, two bars."""
BAR_LABEL_COLUMNS: Final = 26


class Screen(Listener):
    """Follows rounds until it is told to stop."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._view: View | None = None
        self._finished: View | None = None
        self._live = Live(console=console, auto_refresh=False, vertical_overflow="crop")

    def on_view(self, view: View) -> None:
        """Follow this view from now on."""
        self._view = view

    def on_end(self, view: View) -> None:
        """Keep the result for the end."""
        self._finished = view

    async def run(self) -> None:
        """Refresh until cancelled; then the last picture stays, and the result of the last whole round."""
        try:
            with self._live:
                while True:
                    self._live.update(self.picture(), refresh=True)
                    await asyncio.sleep(REFRESH_S)
        finally:
            if self._finished:
                self._console.print(summary(self._finished))

    def picture(self) -> RenderableType:
        """Return what the screen shows now."""
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
    """Largest deviation that the laser has measured so far."""
    return max((abs(stop.error_um) for stop in axis.measured), default=0.0)


def _points(judged: list[Judged]) -> list[tuple[float, float]]:
    return [(stop.nominal, stop.error_um) for stop in judged]


def _positions(axis: AxisView) -> Text:
    unit = axis.spec.units.value
    places = 3 if axis.spec.mm == 1.0 else 4
    added_um = (axis.told - axis.nominal) * axis.spec.mm * UM_PER_MM
    exact = f"{axis.inexact_readbacks} readbacks differ" if axis.inexact_readbacks else "readback exact"
    text = Text.from_markup(
        f"told [bold]{axis.nominal:+.{places}f}[/] {unit} → {axis.told:+.{places}f} ({added_um:+.1f} µm), "
        f"nut at {axis.nut:+.{places}f}, {exact}",
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
