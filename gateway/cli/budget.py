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
            help="Size of a block of registers that the controller also reads from each drive in each round.",
        ),
    ] = 0,
    target_registers: Annotated[
        int,
        typer.Option(
            min=0,
            max=MOST_WRITTEN,
            show_default="as many as the position has",
            help="Size of the block in which the controller writes a target.",
        ),
    ] = 0,
    as_json: AsJson = False,
) -> None:
    """Compute the cycle time of each line, before anything is wired.

    The times come from baud rates, frames, silences and the gateway's own share (budget_us). Each exchange is
    shown step by step in milliseconds, then a round over all axes, and the same without the gateway. A drive
    takes its response_ms; an unknown response_ms counts as 0, and so does the time of programs.
    docs/latency.md explains the columns.

    Exit code 1 if a timeout_ms or deadline_ms is too short.

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
