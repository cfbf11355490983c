"""The commands of ``pitch-gateway``, each in its own file."""

import platform
import select
import sys
from collections import UserDict
from importlib import import_module
from inspect import cleandoc
from typing import Annotated, Any, Final

import typer
from typer.core import TyperGroup
from typer.main import get_group

from gateway.cli.version import version_line

COMMANDS: Final = (
    "demo",
    "run",
    "relay",
    "supervise",
    "check",
    "budget",
    "probe",
    "measure",
    "signtest",
    "listen",
    "status",
    "explain",
    "enable",
    "disable",
    "reference",
    "reload",
    "journal",
    "evidence",
    "provision",
    "capture",
    "record",
    "replay",
    "init",
    "token",
    "service",
    "simulate",
    "table",
    "drives",
    "certificate",
)
"""In the order of ``--help``. Each has its module in ``gateway.cli``, with a function of its name, or with an
``app`` if it has subcommands."""
ANYWHERE: Final = frozenset({"status", "explain", "table", "drives"})
"""Commands that need nothing of Linux: they run on Windows and macOS too."""


class _Loaded(UserDict[str, Any]):
    """The commands by name, each loaded on first use, so that none waits for the imports of others."""

    def __init__(self) -> None:
        super().__init__(dict.fromkeys(COMMANDS))

    def __getitem__(self, name: str) -> Any:
        if (command := super().__getitem__(name)) is None:
            command = self.data[name] = _load(name)
        return command


def _load(name: str) -> Any:
    if not hasattr(select, "epoll") and name not in ANYWHERE:
        return _not_here(name)
    module = import_module(f"gateway.cli.{name}")
    one = typer.Typer(rich_markup_mode="rich")
    if hasattr(module, "app"):
        one.add_typer(module.app, name=name, cls=_Subcommands)
    else:
        one.command(name)(getattr(module, name))
    command = get_group(one).commands[name]
    for each in (command, *getattr(command, "commands", {}).values()):
        each.help = _flowing(each.help or "")
    return command


def _not_here(name: str) -> Any:
    """Return what takes the place of a command that needs Linux."""
    one = typer.Typer()

    @one.command(
        name,
        help="Only on Linux.",
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    )
    def refuse() -> None:
        system = platform.system()
        sys.stderr.write(
            f"error: pitch-gateway {name} needs Linux, and this is {system}; run it on the gateway's machine"
            + (", or in WSL\n" if system == "Windows" else "\n")
        )
        raise typer.Exit(1)

    return get_group(one).commands[name]


def _flowing(text: str) -> str:
    """Return a help with each paragraph as one line, wrapped by the terminal; examples do not change."""
    paragraphs = cleandoc(text).split("\n\n")
    return "\n\n".join(
        each if "\n " in each or each.startswith(" ") else " ".join(each.split("\n")) for each in paragraphs
    )


class _Group(TyperGroup):
    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _Loaded()


class _Subcommands(TyperGroup):
    """The commands of a command."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is meant; an unknown one fails with the names of all."""
        is_known = args[0].startswith("-") or self.get_command(ctx, args[0]) is not None
        if not is_known and not ctx.resilient_parsing:
            ctx.fail(f"No such command {args[0]!r}. Its commands: {', '.join(self.list_commands(ctx))}.")
        return super().resolve_command(ctx, args)


app = typer.Typer(
    name="pitch-gateway",
    cls=_Group,
    help="Leadscrew error compensation in the Modbus cable between a motion controller and its drives.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(value: bool) -> None:
    if value:
        sys.stdout.write(version_line())
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    """Leadscrew error compensation in the Modbus cable between a motion controller and its drives."""
