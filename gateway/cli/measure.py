"""``pitch-gateway measure CONFIG --axis X``."""

from typing import TYPE_CHECKING

import typer

from gateway.cli.arguments import Config
from gateway.cli.configuration import load_or_exit, state_folder_or_exit
from gateway.cli.measuring import options as given
from gateway.metrology.gauge_kinds import GaugeKind

if TYPE_CHECKING:
    from gateway.cli.measuring.work import Wish


def measure(
    config: Config,
    *,
    axis: given.AxisName,
    controller: given.Controller = None,
    port: given.Port = None,
    low: given.From = None,
    high: given.To = None,
    step: given.Step = None,
    targets: given.Targets = None,
    spread: given.Spread = None,
    lead: given.Lead = None,
    seed: given.Seed = 1,
    runs: given.Runs = 5,
    overrun: given.Overrun = None,
    dwell: given.Dwell = 2.0,
    speed: given.Speed = None,
    window: given.Window = None,
    move_timeout: given.MoveTimeout = 120.0,
    csv: given.CsvFile = None,
    column: given.Column = "1",
    delimiter: given.Delimiter = ",",
    gauge: given.Gauge = None,
    gauge_kind: given.Kind = GaugeKind.SYLVAC,
    gauge_baud: given.Baud = None,
    gauge_request: given.Request = None,
    gauge_pattern: given.Pattern = None,
    gauge_timeout: given.GaugeTimeout = 5.0,
    reading_units: given.ReadingUnits = None,
    is_reversed: given.Reversed = False,
    zero_at: given.ZeroAt = 0.0,
    largest_deviation: given.Largest = None,
    readings: given.Readings = None,
    resume: given.Resume = None,
    out: given.Out = None,
    out_format: given.OutFormat = None,
    table_step: given.TableStep = None,
    force: given.Force = False,
    report: given.ReportFile = None,
    before: given.Before = None,
    yes: given.Yes = False,
    as_json: given.AsJson = False,
) -> None:
    """Measure an axis: drive it to targets through the gateway that runs CONFIG, read an instrument there.

    THE AXIS MOVES. It asks first; Ctrl-C stops it at any time. Readings come from the keyboard, from a CSV
    that grows, or from a serial gauge, and are kept one by one. At the end: results of ISO 230-2, the table,
    and what changes against the active one. Switch the compensation off for a first table
    (pitch-gateway disable); with it on, the active table is refined.

    Exit code 1 when it did not come to its end; 130 or 143 when a signal stopped it.

    Examples:
        pitch-gateway measure gateway.toml --axis x --from -290 --to -15 --step 25

        pitch-gateway measure gateway.toml --axis x --from -298 --to -2 --targets 9 --spread 5 --csv laser.csv

        pitch-gateway measure gateway.toml --axis x --from -298 --to -2 --step 8 --table-step 25 --out x.tab

        pitch-gateway measure gateway.toml --axis x --resume x.readings.csv --gauge /dev/ttyUSB0
    """
    from gateway.cli.measuring.setting import Grid, Reader, Scale
    from gateway.cli.measuring.work import Wish

    grid = Grid(low, high, step, targets, spread, seed, runs, overrun, lead)
    reader = Reader(
        csv, column, delimiter, gauge, gauge_kind, gauge_baud, gauge_request, gauge_timeout, gauge_pattern
    )
    scale = Scale(dwell, window, move_timeout, largest_deviation, is_reversed, zero_at, reading_units)
    wish = Wish(
        config, axis, controller, port, grid, reader, scale, speed, readings, resume, out, out_format,
        table_step, report, before, force, yes, as_json,
    )  # fmt: skip
    _fulfil(wish)


def _fulfil(wish: "Wish") -> None:
    """Do what was asked for; ends the command where that does not come to its end."""
    from gateway.cli.measuring.errors import MeasureError
    from gateway.cli.measuring.work import work

    loaded = load_or_exit(wish.config)
    try:
        code = work(wish, loaded.plan, loaded.sections.axes, state_folder_or_exit(wish.config))
    except MeasureError as error:
        typer.echo(f"{wish.config}: {error}", err=True)
        raise typer.Exit(1) from None
    if code:
        raise typer.Exit(code)
