"""``pitch-gateway run CONFIG``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import Config
from gateway.relay.log import LogFormat

if TYPE_CHECKING:
    from gateway.ipc.plan import GatewayPlan


def run(
    config: Config,
    *,
    log_format: Annotated[
        LogFormat, typer.Option("--log-format", help="How the log is written; auto: console on a terminal.")
    ] = LogFormat.AUTO,
    status_every: Annotated[
        float, typer.Option("--status-every", min=0.0, help="Seconds between status lines; 0: none.")
    ] = 0.0,
) -> None:
    """Run the gateway in the foreground until it is stopped (Ctrl-C, SIGTERM).

    It listens, connects to the drives and corrects. The log goes to stderr; the event ``ready`` says that all
    listeners are open, and where. Drives and serial adapters that are not there yet are waited for. A stop
    finishes the exchange on the wire first; a second signal ends at once.

    Exit code 0 after a stop; 1 when the configuration is bad, a port cannot be opened, or on a second signal.

    Examples:
        pitch-gateway run gateway.toml

        pitch-gateway run gateway.toml --status-every 1

        pitch-gateway run gateway.toml --log-format json 2> gateway.log
    """
    from gateway.relay.errors import StartError
    from gateway.relay.log import note_writer
    from gateway.relay.run import run_relay

    plan = _checked(config)
    try:
        run_relay(plan, note_writer(log_format), status_every)
    except StartError as error:
        for problem in error.problems:
            typer.echo(f"{config}: {problem}", err=True)
        raise typer.Exit(1) from None


def _checked(config: Path) -> "GatewayPlan":
    from gateway.config.load import load
    from gateway.config.problems import ConfigErrors

    try:
        loaded = load(config)
    except ConfigErrors as errors:
        for problem in errors.problems:
            typer.echo(problem, err=True)
        raise typer.Exit(1) from None
    for warning in loaded.warnings:
        typer.echo(f"warning: {warning}", err=True)
    return loaded.plan
