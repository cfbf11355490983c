"""``pitch-gateway table program``: targets for a measurement, and programs that stop the axis there."""

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from gateway.cli.options import takes_options
from gateway.cli.table_reading import problems
from gateway.commissioning.table_options import Force
from gateway.commissioning.tables import write_file
from gateway.compensation.units import Units
from gateway.metrology import cycle as maths


class ProgramKind(Enum):
    """The kind of output."""

    CYCLE = "cycle"
    ENDLESS = "endless"
    LIST = "list"


@takes_options
def program(
    out: Annotated[
        Path | None,
        typer.Argument(metavar="OUT", help="File to write; default: standard output.", readable=False),
    ] = None,
    *,
    low: Annotated[float, typer.Option("--from", metavar="LO", help="Lowest target.")],
    high: Annotated[float, typer.Option("--to", metavar="HI", help="Highest target.")],
    kind: Annotated[
        ProgramKind,
        typer.Option(
            "--write",
            help="cycle: both ways with overrun; endless: TB058's loop of one step; list: only targets, "
            "for the software of the laser.",
        ),
    ] = ProgramKind.CYCLE,
    step: Annotated[float | None, typer.Option(help="Distance between even targets.")] = None,
    targets: Annotated[
        int | None, typer.Option(help="Number of targets, with random offsets against periodic errors.")
    ] = None,
    spread: Annotated[
        float | None,
        typer.Option(help="Largest offset of a target: the lead of the screw; default: 0.3 intervals."),
    ] = None,
    seed: Annotated[int, typer.Option(help="The same seed gives the same targets.")] = 1,
    runs: Annotated[int, typer.Option(help="Runs in each direction.")] = 5,
    travel: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LO HI", help="Travel of the axis: a cycle or list that leaves it is refused."),
    ] = None,
    overrun: Annotated[
        float | None,
        typer.Option(help="How far beyond the ends the axis turns round; default: 2 mm or 2 degrees."),
    ] = None,
    dwell: Annotated[float, typer.Option(help="Pause for a reading, in the control's unit of G4 P.")] = 5.0,
    feed: Annotated[
        float | None, typer.Option(help="Units per minute; default: 500 mm or 500 degrees.")
    ] = None,
    axis: Annotated[str, typer.Option("--axis", metavar="LETTER", help="The axis.")] = "X",
    units: Annotated[Units, typer.Option("--units", help="Units of all lengths.")] = Units.MM,
    force: Force = False,
) -> None:
    """Write a program for the control, or a list of targets, for a measurement.

    A cycle stops at every target upwards and downwards, and turns round beyond the ends, so that each target
    is approached from the right side. --targets gives random offsets: an even grid cannot show an error that
    repeats with each turn of the screw.

    Examples:
      pitch-gateway table program x.cnc --from 0 --to 500 --targets 11 --spread 5 --axis X

      pitch-gateway table program --from 0 --to 33 --step 0.5 --write endless --units inch

      pitch-gateway table program targets.txt --from 0 --to 500 --targets 21 --write list --seed 7
    """
    _check(kind, step, targets, travel)
    with problems():
        stops = _Targets(low, high, step, targets, seed, spread).stops(kind, units)
        cycle = maths.Cycle(
            axis=axis,
            units=units,
            feed=units.from_mm(500.0) if feed is None else feed,
            dwell=dwell,
            overrun=units.from_mm(2.0) if overrun is None else overrun,
            runs=runs,
        )
        if kind is ProgramKind.ENDLESS:
            text = maths.endless_steps(axis, step or 0.0, dwell, maths.DECIMALS[units])
        else:
            text = _text(kind, stops, cycle, travel)
        _warn(stops, cycle, kind)
        if out is None:
            typer.echo(text, nl=False)
        else:
            write_file(out, text, force=force)
            _print_written(out, stops, maths.DECIMALS[units])


@dataclass(frozen=True, slots=True)
class _Targets:
    """The stops of the axis, from the options."""

    low: float
    high: float
    step: float | None
    number: int | None
    seed: int
    spread: float | None

    def stops(self, kind: ProgramKind, units: Units) -> list[float]:
        """Return the targets, ascending.

        Raises:
            ReadingsError: the options allow no such targets.
        """
        if self.step is not None:
            step = abs(self.step) if kind is ProgramKind.ENDLESS else self.step
            return maths.even_targets(self.low, self.high, step)
        assert self.number is not None, "one of both was asked for"
        return maths.random_targets(
            self.low,
            self.high,
            self.number,
            seed=self.seed,
            spread=self.spread,
            decimals=maths.DECIMALS[units],
        )


def _check(
    kind: ProgramKind, step: float | None, targets: int | None, travel: tuple[float, float] | None
) -> None:
    """Refuse options that do not go together."""
    if (step is None) == (targets is None):
        raise typer.BadParameter("give --step or --targets", param_hint="--step, --targets")
    if kind is ProgramKind.ENDLESS and travel is not None:
        raise typer.BadParameter(
            "the endless program stops only at the limit of the control: --write cycle", param_hint="--travel"
        )
    if kind is ProgramKind.ENDLESS and step is None:
        raise typer.BadParameter("the endless program makes even steps: give --step", param_hint="--write")


def _text(
    kind: ProgramKind, stops: list[float], cycle: maths.Cycle, travel: tuple[float, float] | None
) -> str:
    if kind is ProgramKind.LIST:
        maths.check_targets(stops, cycle.units, travel)
        return "".join(f"{maths.fixed(stop, maths.DECIMALS[cycle.units])}\n" for stop in stops)
    return maths.cycle_program(stops, cycle, travel)


def _print_written(out: Path, stops: list[float], decimals: int) -> None:
    ends = f"from {stops[0]:.{decimals}f} to {stops[-1]:.{decimals}f}"
    typer.echo(f"{out}: {len(stops)} targets {ends}")


def _warn(stops: list[float], cycle: maths.Cycle, kind: ProgramKind) -> None:
    """Warn on stderr where the axis will go, and which requirements of the standard are not met."""
    unit = cycle.units.value
    if kind is ProgramKind.CYCLE:
        typer.echo(
            f"note: the axis goes from {stops[0] - cycle.overrun:g} to {stops[-1] + cycle.overrun:g} "
            f"{unit}; keep this range free",
            err=True,
        )
        typer.echo(
            "note: its positions are those of the active work offset, a table's those of the machine: "
            "cancel work and tool offsets, so that both are equal",
            err=True,
        )
    if kind is ProgramKind.ENDLESS:
        typer.echo("note: the program repeats itself until the software travel limit stops it", err=True)
        typer.echo(
            f"note: set the control to {unit} (G20 inch, G21 mm), or the step has another length; G91 "
            "stays active after the program: command G90 first",
            err=True,
        )
    if cycle.units is not Units.DEGREE:
        length_mm = (stops[-1] - stops[0]) * cycle.units.convert_factor(Units.MM)
        needed = maths.enough_targets(length_mm)
        if len(stops) < needed:
            typer.echo(f"note: {len(stops)} targets; ISO 230-2 asks for {needed} on this length", err=True)
