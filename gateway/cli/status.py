"""``pitch-gateway status CONFIG``."""

import json
from typing import Annotated

import typer

from gateway.cli.arguments import Config
from gateway.cli.commanding import ask_or_exit


def status(
    config: Config,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print the whole status as JSON.")] = False,
) -> None:
    """Show what the gateway that runs CONFIG does: one look, which changes nothing.

    The gateway, its lines with their controllers, its axes with positions in their units, and how long the
    gateway itself took for their frames (microseconds), beside the budget. ``--json`` has everything;
    docs/operating.md and docs/latency.md explain the keys.

    Exit code 1 when no gateway runs.

    Examples:
        pitch-gateway status gateway.toml

        pitch-gateway status gateway.toml --json | jq .axes.x.latency
    """
    from gateway.ipc.messages import GetStatus, Status

    reply = ask_or_exit(config, GetStatus())
    assert isinstance(reply, Status), "a request for the status is answered by it"
    if as_json:
        typer.echo(json.dumps(reply.status, indent=2, ensure_ascii=False))
        return
    from rich.console import Console

    from gateway.cli.status_output import show_status

    show_status(Console(highlight=False, soft_wrap=False), reply.status)
