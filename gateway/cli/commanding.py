"""Sending a command to the gateway of a configuration, and reporting the result."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.configuration import state_folder_or_exit
from gateway.cli.output import Format, show
from gateway.plain import JsonObject

if TYPE_CHECKING:
    from gateway.ipc.messages import Reply, Request

Axes = Annotated[
    list[str] | None,
    typer.Argument(metavar="[AXIS]...", help="Names of axes; none: all axes.", show_default=False),
]


def ask_or_exit(config: Path, request: "Request", *, as_json: bool = False) -> "Reply":
    """Return the reply of the gateway that runs CONFIG; without one, report that and exit with code 1.

    With ``as_json`` standard output reports it too, in the form of a command that changed nothing.
    """
    from gateway.ipc.client import NoRelayError, ask_relay

    state = state_folder_or_exit(config)
    try:
        return ask_relay(config, state, request)
    except NoRelayError as error:
        problem = str(error)
    if as_json:
        show(_Commanded([], [problem]), Format.JSON)
    typer.echo(f"{config}: {problem}", err=True)
    raise typer.Exit(1)


def command(
    config: Path, request: "Request", done: str, nothing: str, *, as_json: bool, waits: str = ""
) -> None:
    """Send a command and report the changed axes; exit code 1 if it failed for any axis.

    ``waits`` is said in place of ``done`` of an axis on which the change has no effect yet.
    """
    from gateway.ipc.messages import Done

    reply = ask_or_exit(config, request, as_json=as_json)
    assert isinstance(reply, Done), "a command is answered by what it did"
    found = _Commanded(reply.changed, reply.problems, done, nothing, waits, reply.comes)
    show(found, Format.JSON if as_json else Format.TEXT)
    for problem in reply.problems:
        typer.echo(f"{config}: {problem}", err=True)
    if reply.problems:
        raise typer.Exit(1)


@dataclass(frozen=True, slots=True)
class _Commanded:
    """The result of a command."""

    changed: Sequence[str]
    problems: Sequence[str]
    done: str = ""
    """The new state of a changed axis."""
    nothing: str = ""
    """The text if no axis changed and there was no problem."""
    waits: str = ""
    comes: Mapping[str, str] = field(default_factory=dict)
    """How the change comes into force, by axis."""

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return {"changed": list(self.changed), "problems": list(self.problems)}

    def lines(self) -> Iterator[str]:
        """Yield it in words, without the problems."""
        from gateway.exchange.control import NOT_IN_FORCE

        for axis in self.changed:
            yield f"{axis}: {self.waits if self.comes.get(axis) == NOT_IN_FORCE else self.done}"
        if not self.changed and not self.problems:
            yield self.nothing
