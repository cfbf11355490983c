"""``pitch-gateway budget CONFIG``."""

import typer

from gateway.budget.sequence import Blocks
from gateway.cli.arguments import AsJson, Config
from gateway.cli.configuration import load_or_exit
from gateway.cli.options import takes_options
from gateway.cli.output import Format, print_lines, show


@takes_options
def budget(
    config: Config,
    *,
    blocks: Blocks,
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
    from gateway.cli.budget_output import lines
    from gateway.commissioning.budget import MisfitError, work_out

    loaded = load_or_exit(config, checks_times=False)
    try:
        found = work_out(loaded, blocks)
    except MisfitError as error:
        print_lines((f"{config}: {problem}" for problem in error.problems), err=True)
        raise typer.Exit(1) from None
    show(found, Format.INDENTED if as_json else Format.TEXT, lines(found))
    if found.problems:
        raise typer.Exit(1)
