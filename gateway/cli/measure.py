"""``pitch-gateway measure CONFIG --axis X``."""

import sys
from pathlib import Path
from signal import SIGINT
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import Config
from gateway.cli.configuration import load_or_exit
from gateway.cli.options import takes_options
from gateway.cli.output import STOPPED_BY_SIGNAL, print_lines, print_words
from gateway.commissioning.measure.options import MeasureOptions

if TYPE_CHECKING:
    from gateway.commissioning.measure.measuring import Measuring, RunResult


@takes_options
def measure(
    config: Config,
    *,
    options: MeasureOptions,
    yes: Annotated[
        bool, typer.Option("--yes", help="Do not ask before the axis moves; for scripts.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print each step as a line of JSON.")] = False,
) -> None:
    """Measure an axis: move it to targets through the gateway that runs CONFIG, and read an instrument.

    THE AXIS MOVES. The command asks first; Ctrl-C stops the axis at any time. Readings come from the
    keyboard, from a growing CSV file, or from a serial gauge. Each reading is saved when it is taken. At the
    end you get the results of ISO 230-2, the table, and its differences from the active table. For a first
    table, switch the compensation off (pitch-gateway disable). With compensation on, the active table is
    refined.

    --method block-walk needs one gauge block and a dial: it leads from placement to placement, and says
    before the first one how good the table can become. b takes a placement back that slipped.

    Exit code 1 if the run did not finish; 130 or 143 if a signal stopped it.

    Examples:
        pitch-gateway measure gateway.toml --axis x --from -290 --to -15 --step 25

        pitch-gateway measure gateway.toml --axis x --from -298 --to -2 --targets 9 --spread 5 --csv laser.csv

        pitch-gateway measure gateway.toml --axis x --from -298 --to -2 --step 8 --table-step 25 --out x.tab

        pitch-gateway measure gateway.toml --axis x --resume x.readings.csv --gauge /dev/ttyUSB0

        pitch-gateway measure gateway.toml --axis x --method block-walk --from -290 --to -10 --block 50 \
            --dial-range 10 --block-grade 1 --lead 5
    """
    from gateway.commissioning.measure.errors import EndedEarlyError, MeasureError
    from gateway.commissioning.measure.measuring import Measuring

    loaded = load_or_exit(config)
    try:
        measuring = Measuring(loaded, options)
        if measuring.check_ready():
            print_lines(measuring.preview(), err=True)
            if not yes:
                _ask(config)
            _run(measuring, as_json=as_json)
        _show(_result(config, measuring), as_json=as_json)
    except EndedEarlyError as error:
        typer.echo(f"{config}: {error}", err=True)
        if error.took:
            path = measuring.readings_file
            typer.echo(
                f"{error.took} readings are in {path}; continue with the same instrument: pitch-gateway "
                f"measure {config} --axis {options.choice.axis} --resume {path}",
                err=True,
            )
        raise typer.Exit(1 if error.stopped_by is None else STOPPED_BY_SIGNAL + error.stopped_by) from None
    except MeasureError as error:
        typer.echo(f"{config}: {error}", err=True)
        raise typer.Exit(1) from None


def _ask(config: Path) -> None:
    """Ask whether the axis may move. Raises AxisError: it may not, or there is no terminal."""
    from gateway.commissioning.measure.errors import AxisError

    if not sys.stdin.isatty():
        raise AxisError(
            "cannot ask for confirmation: stdin is not a terminal; run it on a terminal, or give --yes"
        )
    try:
        may_move = typer.confirm("Is the travel free of obstacles, and may the axis move?", err=True)
    except typer.Abort as error:  # Ctrl-C, or the end of the input
        typer.echo(f"\n{config}: nothing was moved", err=True)
        is_signal = isinstance(error.__context__, KeyboardInterrupt)
        raise typer.Exit(STOPPED_BY_SIGNAL + SIGINT if is_signal else 1) from None
    if not may_move:
        raise AxisError("nothing was moved")


def _run(measuring: "Measuring", *, as_json: bool) -> None:
    """Run the measurement, and show its events. Raises MeasureError."""
    from gateway.cli.measure_progress import AsBar, AsDial, AsJson, AsLines
    from gateway.commissioning.measure.instruments import Keyboard

    units = measuring.units.value
    is_bar = sys.stderr.isatty() and not isinstance(measuring.instrument, Keyboard)
    lines = AsDial(units, measuring.gap) if measuring.gap else AsBar(units) if is_bar else AsLines(units)
    showing = AsJson(units) if as_json else lines
    try:
        measuring.run(showing, can_ask=sys.stdin.isatty())
    finally:
        showing.end()


def _result(config: Path, measuring: "Measuring") -> "RunResult":
    """Return the result of the readings; Ctrl-C ends the command. Raises MeasureError."""
    try:
        return measuring.result()
    except KeyboardInterrupt:
        path = measuring.readings_file
        typer.echo(
            f"{config}: stopped by Ctrl-C before all results were made; {path} has all readings: "
            f"--resume {path} makes the results",
            err=True,
        )
        raise typer.Exit(STOPPED_BY_SIGNAL + SIGINT) from None


def _show(measured: "RunResult", *, as_json: bool) -> None:
    from gateway.cli.measure_progress import AsJson
    from gateway.cli.table_output import PLAIN_WIDTH, results_lines

    found = measured.outcome
    if as_json:
        AsJson(found.survey.units.value).happened("result", measured.as_data())
    else:
        titles = "with the table" if found.is_refined else "without a table", ""
        print_words(results_lines(found.evaluation, None, titles), PLAIN_WIDTH)
        print_lines(found.lines())
    print_lines(measured.notes, err=as_json)
