"""``pitch-gateway status CONFIG``."""

from typing import Annotated

import typer

from gateway.cli.arguments import Config
from gateway.cli.configuration import state_folder_or_exit
from gateway.cli.output import Format, show


def status(
    config: Config,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print the whole status as JSON.")] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Update until Ctrl-C; with --json: a line for each change.")
    ] = False,
) -> None:
    """Show the state of the running gateway of CONFIG. It changes nothing.

    It shows alarms with their remedies, the gateway, lines with their controllers, and axes with positions in
    their units. It also shows how long the gateway took for frames (microseconds), beside the budget. --json
    has everything; docs/operations.md and docs/latency.md explain the keys.

    Exit code 1 if no gateway runs; 0 after Ctrl-C.

    Examples:
        pitch-gateway status gateway.toml

        pitch-gateway status gateway.toml --watch

        pitch-gateway status gateway.toml --json | jq .axes.x.latency
    """
    from gateway.cli import looking
    from gateway.ipc.client import NoRelayError

    state = state_folder_or_exit(config)
    try:
        if watch:
            looking.watch(looking.looks(config, state), as_json=as_json)
            return
        seen = looking.read_status(config, state)
    except NoRelayError as error:
        typer.echo(f"{config}: {error}", err=True)
        raise typer.Exit(1) from None
    show(seen, Format.INDENTED if as_json else Format.TEXT, looking.words_of(seen))
    if seen.gateway.relay != "up":
        raise typer.Exit(1)
