"""``pitch-gateway budget CONFIG``."""

from typing import Annotated

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.configuration import load_or_exit
from gateway.cli.output import Format, print_lines, show

MOST_READ = 125
MOST_WRITTEN = 123


def budget(
    config: Config,
    *,
    registers: Annotated[
        int,
        typer.Option(
            min=0,
            max=MOST_READ,
            show_default=False,
            help="Registers of a block that the controller also reads from each drive in each round.",
        ),
    ] = 0,
    target_registers: Annotated[
        int,
        typer.Option(
            min=0,
            max=MOST_WRITTEN,
            show_default="as many as the position has",
            help="Registers of the block in which the controller writes a target.",
        ),
    ] = 0,
    as_json: AsJson = False,
) -> None:
    """Work out what cycle time each line can hold, before anything is wired.

    From baud rates, frames, silences and the gateway's own share (budget_us): each exchange leg by leg in
    milliseconds, a round over all axes, and the same without the gateway. What a drive takes itself is its
    response_ms; where that is not known, and for programs, 0 is reckoned with. docs/latency.md explains the
    columns.

    Exit code 1 when a timeout_ms or deadline_ms cannot be met.

    Examples:
        pitch-gateway budget gateway.toml

        pitch-gateway budget gateway.toml --registers 16

        pitch-gateway budget gateway.toml --json | jq '.lines[].controllers[].round.total_ms'
    """
    from gateway.budget.sequence import Blocks
    from gateway.cli.budget_output import lines
    from gateway.commissioning.budget import MisfitError, work_out

    loaded = load_or_exit(config, checks_times=False)
    try:
        found = work_out(loaded, Blocks(registers, target_registers))
    except MisfitError as error:
        print_lines((f"{config}: {problem}" for problem in error.problems), err=True)
        raise typer.Exit(1) from None
    show(found, Format.INDENTED if as_json else Format.TEXT, lines(found))
    if found.problems:
        raise typer.Exit(1)
