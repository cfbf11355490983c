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
        "referenced at its present position",
        f"nothing to change: {axis} was already referenced",
        as_json=as_json,
    )


def _confirm(axis: str) -> None:
    if not sys.stdin.isatty():
        raise typer.BadParameter(
            "cannot ask for confirmation: standard input is not a terminal; in a script, give --yes",
            param_hint="--yes",
        )
    question = f"Has axis {axis} been homed, and is it really at the position that its drive reports?"
    if not typer.confirm(question, err=True):
        typer.echo("nothing was changed", err=True)
        raise typer.Exit(1)
