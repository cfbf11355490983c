"""``pitch-gateway measure CONFIG --axis X``."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from signal import SIGINT
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from gateway.cli.arguments import Config
from gateway.cli.configuration import load_or_exit
from gateway.cli.options import takes_options
from gateway.commissioning.measure.options import MeasureOptions

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from gateway.commissioning.measure.measuring import Measured, Measuring
    from gateway.metrology.cycle import Stop
    from gateway.metrology.readings import Reading

STOPPED_BY_SIGNAL: Final = 128
"""Added to the number of a signal, this is the exit code of a command that it stopped, as in a shell."""


@takes_options
def measure(
    config: Config,
    *,
    options: MeasureOptions,
    yes: Annotated[
        bool, typer.Option("--yes", help="Do not ask before the axis moves: for scripts.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Say everything that happens as lines of JSON.")
    ] = False,
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
    from gateway.commissioning.measure.errors import EndedEarlyError, MeasureError
    from gateway.commissioning.measure.measuring import Measuring

    loaded = load_or_exit(config)
    try:
        measuring = Measuring(loaded, options)
        if measuring.look():
            for text in measuring.preview():
                typer.echo(text, err=True)
            if not yes:
                _ask(config)
            _run(measuring, as_json=as_json)
        _show(_result(config, measuring), as_json=as_json)
    except EndedEarlyError as error:
        typer.echo(f"{config}: {error}", err=True)
        if error.took:
            path = measuring.readings_file
            typer.echo(
                f"{error.took} readings are in {path}; go on with: pitch-gateway measure {config} "
                f"--axis {options.choice.axis} --resume {path} and the same instrument",
                err=True,
            )
        raise typer.Exit(1 if error.stopped_by is None else STOPPED_BY_SIGNAL + error.stopped_by) from None
    except MeasureError as error:
        typer.echo(f"{config}: {error}", err=True)
        raise typer.Exit(1) from None


def _ask(config: Path) -> None:
    """Ask whether the axis may move. Raises AxisError: it may not, or nobody can be asked."""
    from gateway.commissioning.measure.errors import AxisError

    if not sys.stdin.isatty():
        raise AxisError("nobody can be asked whether it may move: run it on a terminal, or give --yes")
    try:
        may_move = typer.confirm("Is the way free, and may it move?", err=True)
    except typer.Abort as error:  # Ctrl-C, or the end of the input
        typer.echo(f"\n{config}: nothing was moved", err=True)
        is_signal = isinstance(error.__context__, KeyboardInterrupt)
        raise typer.Exit(STOPPED_BY_SIGNAL + SIGINT if is_signal else 1) from None
    if not may_move:
        raise AxisError("nothing was moved")


def _run(measuring: "Measuring", *, as_json: bool) -> None:
    """Let the axis be measured, and show what happens. Raises MeasureError."""
    from gateway.commissioning.measure.instruments import Keyboard

    units = measuring.units.value
    is_bar = sys.stderr.isatty() and not isinstance(measuring.instrument, Keyboard)
    showing = AsJson(units) if as_json else AsBar(units) if is_bar else AsLines(units)
    try:
        measuring.run(showing, can_ask=sys.stdin.isatty())
    finally:
        showing.end()


def _result(config: Path, measuring: "Measuring") -> "Measured":
    """Return what the readings lead to; Ctrl-C ends the command. Raises MeasureError."""
    try:
        return measuring.result()
    except KeyboardInterrupt:
        path = measuring.readings_file
        typer.echo(
            f"{config}: Ctrl-C before all results were made; no reading is missing in {path}: "
            f"--resume {path} makes the results of them",
            err=True,
        )
        raise typer.Exit(STOPPED_BY_SIGNAL + SIGINT) from None


def _show(measured: "Measured", *, as_json: bool) -> None:
    from gateway.cli.table_output import results_text

    found = measured.outcome
    if as_json:
        AsJson(found.survey.units.value).happened("result", measured.as_data())
    else:
        results_text(
            found.evaluation, None, ("with the table" if found.is_refined else "without a table", "")
        )
        for line in found.lines():
            typer.echo(line)
    for note in measured.notes:
        typer.echo(note, err=as_json)


# --- what is seen of a run while it goes on: a ``Showing`` of gateway.commissioning.measure.running --------


class AsLines:
    """A line for each reading, on standard error."""

    def __init__(self, units: str) -> None:
        self._units = units
        self._total = 0
        self._done = 0

    def say(self, text: str) -> None:
        """See ``Showing``."""
        typer.echo(text, err=True)

    def begin(self, total: int, done: int) -> None:
        """See ``Showing``."""
        self._total, self._done = total, done

    def going(self, stop: "Stop") -> None:
        """See ``Showing``."""

    def waiting(self, stop: "Stop") -> None:
        """See ``Showing``."""

    def took(self, reading: "Reading") -> None:
        """See ``Showing``."""
        self._done += 1
        self.say(line_of(self._done, self._total, reading, self._units))

    def happened(self, event: str, facts: Mapping[str, Any]) -> None:
        """See ``Showing``."""

    def end(self) -> None:
        """See ``Showing``."""


class AsBar(AsLines):
    """A bar on a terminal, with the lines above it."""

    def __init__(self, units: str) -> None:
        super().__init__(units)
        self._bar: Progress | None = None
        self._task: TaskID | None = None

    def say(self, text: str) -> None:
        """See ``Showing``."""
        if self._bar is None:
            super().say(text)
        else:
            self._bar.console.print(text, highlight=False, markup=False)

    def begin(self, total: int, done: int) -> None:
        """See ``Showing``."""
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        super().begin(total, done)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns, console=Console(stderr=True))
        self._task = self._bar.add_task("", total=total, completed=done)
        self._bar.start()

    def going(self, stop: "Stop") -> None:
        """See ``Showing``."""
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, description=f"to {stop.nominal:.9g} {self._units}")

    def took(self, reading: "Reading") -> None:
        """See ``Showing``."""
        super().took(reading)
        if self._bar is not None and self._task is not None:
            self._bar.advance(self._task)

    def end(self) -> None:
        """See ``Showing``."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


class AsJson(AsLines):
    """A line of JSON on standard output for everything that happens; sentences on standard error."""

    def begin(self, total: int, done: int) -> None:
        """See ``Showing``."""
        super().begin(total, done)
        self.happened("begin", {"readings": total, "done": done})

    def going(self, stop: "Stop") -> None:
        """See ``Showing``."""
        self.happened("going", {"target": stop.nominal, "measure": stop.measure, "run": stop.run})

    def waiting(self, stop: "Stop") -> None:
        """See ``Showing``."""
        way = stop.direction.name.lower()
        self.happened("waiting", {"target": stop.nominal, "direction": way, "run": stop.run})

    def took(self, reading: "Reading") -> None:
        """See ``Showing``."""
        self._done += 1
        facts = {"target": reading.target, "direction": reading.direction.name.lower(), "run": reading.run}
        self.happened("reading", {**facts, "measured": reading.measured})

    def happened(self, event: str, facts: Mapping[str, Any]) -> None:
        """See ``Showing``."""
        sys.stdout.write(json.dumps({"event": event, **facts}) + "\n")
        sys.stdout.flush()


def line_of(number: int, total: int, reading: "Reading", units: str) -> str:
    """Return a reading as a person reads it.

    >>> from gateway.compensation.direction import Direction
    >>> from gateway.metrology.readings import Reading
    >>> line_of(3, 110, Reading(50.0, Direction.FORWARD, 50.0123), "mm")
    '3/110  run 1  50 mm forward: 50.0123, deviation +0.0123'
    """
    way = reading.direction.name.lower()
    return (
        f"{number}/{total}  run {reading.run}  {reading.target:.9g} {units} {way}: "
        f"{reading.measured:.9g}, deviation {reading.deviation:+.4f}"
    )
