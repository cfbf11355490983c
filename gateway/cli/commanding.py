"""Sending a command to the gateway of a configuration, and saying what came of it."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.configuration import state_folder_or_exit
from gateway.cli.output import Format, print_json

if TYPE_CHECKING:
    from gateway.ipc.messages import Reply, Request

Axes = Annotated[
    list[str] | None,
    typer.Argument(metavar="[AXIS]...", help="Names of axes; none: all of them.", show_default=False),
]


def ask_or_exit(config: Path, request: "Request", *, as_json: bool = False) -> "Reply":
    """Return the reply of the gateway that runs CONFIG; without one, say so and end with exit code 1.

    With ``as_json`` standard output says it too, in the form of a command that changed nothing.
    """
    from gateway.ipc.client import NoRelayError, ask_relay

    state = state_folder_or_exit(config)
    try:
        return ask_relay(config, state, request)
    except NoRelayError as error:
        problem = str(error)
    if as_json:
        print_json(_result([], [problem]), Format.JSON)
    typer.echo(f"{config}: {problem}", err=True)
    raise typer.Exit(1)


def command(config: Path, request: "Request", done: str, nothing: str, *, as_json: bool) -> None:
    """Send a command and say which axes changed; exit code 1 when any axis could not be commanded."""
    from gateway.ipc.messages import Done

    reply = ask_or_exit(config, request, as_json=as_json)
    assert isinstance(reply, Done), "a command is answered by what it did"
    if as_json:
        print_json(_result(reply.changed, reply.problems), Format.JSON)
    else:
        _say(reply.changed, done)
        if not reply.changed and not reply.problems:
            typer.echo(nothing)
    for problem in reply.problems:
        typer.echo(f"{config}: {problem}", err=True)
    if reply.problems:
        raise typer.Exit(1)


def _result(changed: Iterable[str], problems: Iterable[str]) -> dict[str, list[str]]:
    return {"changed": list(changed), "problems": list(problems)}


def _say(axes: Iterable[str], done: str) -> None:
    for axis in axes:
        typer.echo(f"{axis}: {done}")
