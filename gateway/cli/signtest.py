"""``pitch-gateway signtest CONFIG --axis X``."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.configuration import load_or_exit
from gateway.cli.output import Format, show

if TYPE_CHECKING:
    from gateway.exchange.plan import AxisPlan

NUMBERS = "--at, --forward-reading and --backward-reading"
MISSING = f"give all numbers of a sign test together: {NUMBERS}"


def signtest(
    config: Config,
    *,
    axis: Annotated[str, typer.Option("--axis", help="The axis.", show_default=False)],
    at: Annotated[float | None, typer.Option("--at", help="Commanded position of both readings.")] = None,
    forward_reading: Annotated[
        float | None, typer.Option("--forward-reading", help="True position, approached from below.")
    ] = None,
    backward_reading: Annotated[
        float | None, typer.Option("--backward-reading", help="True position, approached from above.")
    ] = None,
    uncertainty: Annotated[
        float | None,
        typer.Option("--uncertainty", help="Of a reading, in units of the axis; default: 2 µm or 2 counts."),
    ] = None,
    moved: Annotated[
        float | None,
        typer.Option(
            "--moved",
            help="In place of readings: how far the axis really moved when it was commanded 1 mm (1 "
            "degree, 0.05 inch) further. Checks counts_per_unit.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check with two readings at one position that a table is used with the right sign.

    The most common mistake is a reversed sign: in the table, between its two columns, or in the axis
    direction. The error then doubles. Switch the compensation off (pitch-gateway disable), go to one position
    from below and from above, and read a laser or gauge each time. Its zero must be at the table's zero.
    Without numbers the command says where to measure and asks for them. On a terminal it first asks for a
    move of 1 mm, which shows a counts_per_unit that is wrong by a factor of ten. --moved checks only such a
    move, also for an axis without a table.

    Exit code 0 if the table or the move is right; 1 if it is wrong or cannot be judged.

    Examples:
        pitch-gateway signtest gateway.toml --axis x

        pitch-gateway signtest gateway.toml --axis x --moved 0.99

        pitch-gateway signtest gateway.toml --axis x --at -250 --forward-reading -249.99 --backward-reading -249.981
    """  # noqa: E501 - a line that is copied
    from gateway.commissioning.sign_test import judge_readings
    from gateway.metrology.errors import ReadingsError

    numbers = (at, forward_reading, backward_reading)
    if any(number is None for number in numbers) and any(number is not None for number in numbers):
        raise typer.BadParameter(MISSING)
    if moved is not None:
        if at is not None:
            raise typer.BadParameter(
                "give a move or the readings, not both: a move checks counts_per_unit, the readings "
                "check a table"
            )
        _judge_move(config, _axis(config, axis), moved, as_json=as_json)
        return
    plan = _with_table(config, _axis(config, axis))
    if at is None or forward_reading is None or backward_reading is None:
        try:
            if sys.stdin.isatty():
                _ask_for_a_move(config, plan)
            at, forward_reading, backward_reading = _asked_for(config, plan)
        except typer.Abort:
            if sys.stdin.isatty():
                raise
            raise typer.BadParameter(f"standard input ended before all readings: give {NUMBERS}") from None
    try:
        report = judge_readings(plan, at, forward_reading, backward_reading, uncertainty)
    except ReadingsError as error:
        typer.echo(f"{config}: axis {axis}: {error}", err=True)
        raise typer.Exit(1) from None
    show(report, Format.JSON if as_json else Format.TEXT)
    if not report.test.is_right:
        raise typer.Exit(1)


def _axis(config: Path, name: str) -> "AxisPlan":
    axes = {axis.name: axis for line in load_or_exit(config).plan.lines for axis in line.axes}
    if name not in axes:
        typer.echo(f"{config}: there is no axis {name}; there are {', '.join(axes)}", err=True)
        raise typer.Exit(1)
    return axes[name]


def _with_table(config: Path, plan: "AxisPlan") -> "AxisPlan":
    from gateway.commissioning.sign_test import table_of
    from gateway.metrology.errors import ReadingsError

    try:
        table_of(plan)
    except ReadingsError as error:
        typer.echo(f"{config}: {error}", err=True)
        raise typer.Exit(1) from None
    return plan


def _judge_move(config: Path, plan: "AxisPlan", moved: float, *, as_json: bool = False) -> None:
    """Report whether a trial move had the commanded length; end the command if it had not."""
    from gateway.commissioning.sign_test import judge_move
    from gateway.metrology.errors import ReadingsError

    try:
        found = judge_move(plan, moved)
    except ReadingsError as error:
        typer.echo(f"{config}: axis {plan.name}: {error}", err=True)
        raise typer.Exit(1) from None
    show(found, Format.JSON if as_json else Format.TEXT)
    if found.fault:
        raise typer.Exit(1)


def _ask_for_a_move(config: Path, plan: "AxisPlan") -> None:
    from gateway.metrology.scale import TRIAL_MOVE

    commanded, units = TRIAL_MOVE[plan.settings.units], plan.settings.units.value
    typer.echo(
        f"Axis {plan.name}: command one move up, then {commanded:g} {units} more. Measure the last move "
        "with a dial gauge or a rule. Type a negative number if the axis went down.",
        err=True,
    )
    _judge_move(
        config, plan, typer.prompt(f"It really moved by [{units}]", default=commanded, type=float, err=True)
    )


def _asked_for(config: Path, plan: "AxisPlan") -> tuple[float, float, float]:
    """Ask for the readings on the terminal; return position, forward and backward reading."""
    from gateway.commissioning.sign_test import approach_of, best_position

    units, best, approach = plan.settings.units.value, best_position(plan), approach_of(plan)
    typer.echo(
        f"Axis {plan.name}: switch its compensation off (pitch-gateway disable {config} {plan.name}), "
        "home it, and set the instrument to 0 at the zero of the table.\n"
        f"The best position for this test is {best:.6g} {units}. Go to {best - approach:.6g}, then up "
        f"to {best:.6g}, and read. Go to "
        f"{best + approach:.6g}, then down to {best:.6g}, and read again.",
        err=True,
    )
    at: float = typer.prompt(f"Position [{units}]", default=best, type=float, err=True)
    forward: float = typer.prompt(f"Reading, approached from below, forward [{units}]", type=float, err=True)
    backward: float = typer.prompt(
        f"Reading, approached from above, backward [{units}]", type=float, err=True
    )
    return at, forward, backward
