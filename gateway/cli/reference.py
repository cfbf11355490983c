"""``pitch-gateway reference CONFIG AXIS``."""

import sys
from typing import Annotated

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.commanding import command


def reference(
    config: Config,
    axis: Annotated[str, typer.Argument(metavar="AXIS", help="Name of the axis.", show_default=False)],
    *,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask; for scripts.")] = False,
    as_json: AsJson = False,
) -> None:
    """Confirm that an axis is referenced: its drive counts from the machine's zero.

    Use it for an axis that was homed while the gateway did not run, or whose drive has no homed bit. If the
    confirmation is wrong, every correction is wrong. The command asks first.

    Exit code 1 if no gateway runs, the answer was no, or the axis cannot be referenced.

    Examples:
        pitch-gateway reference gateway.toml x

        pitch-gateway reference gateway.toml x --yes
    """
    from gateway.exchange.commands import SetReference

    if not yes:
        _confirm(axis)
    command(
        config,
        SetReference(axis=axis),
        "referenced where it stands",
        f"nothing to change: {axis} was referenced already",
        as_json=as_json,
    )


def _confirm(axis: str) -> None:
    if not sys.stdin.isatty():
        raise typer.BadParameter(
            "standard input is no terminal to ask on: give --yes where a script is sure", param_hint="--yes"
        )
    question = f"Has axis {axis} been homed, and does it stand where its drive says?"
    if not typer.confirm(question, err=True):
        typer.echo("nothing was changed", err=True)
        raise typer.Exit(1)
