"""``pitch-gateway drives``: the drive profiles that come with the gateway."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from gateway.drives.profile import Profile

app = typer.Typer(
    invoke_without_command=True,
    rich_markup_mode=None,
)
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


@app.callback()
def list_drives(context: typer.Context, *, as_json: AsJson = False) -> None:
    """List the drive profiles that come with the gateway.

    Tier A: manuals and independent programs agree. Tier B: one family of sources. Take every one as a start:
    go through its traps before the machine is run.

    Examples:
      pitch-gateway drives

      pitch-gateway drives --json

      pitch-gateway drives show oriental-az
    """
    if context.invoked_subcommand is not None:
        return
    from gateway.cli.drives_output import list_data, list_lines

    if as_json:
        typer.echo(json.dumps(list_data(), indent=2, ensure_ascii=False))
        return
    for line in list_lines():
        typer.echo(line)


@app.command()
def show(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="A profile of the list, or a file of your own.", show_default=False
        ),
    ],
    *,
    as_json: AsJson = False,
    as_toml: Annotated[
        bool, typer.Option("--toml", help="Print the profile as a file to copy and change.")
    ] = False,
) -> None:
    """Show a drive profile: its map, what frames mean, its traps, and where each value comes from.

    Examples:
      pitch-gateway drives show oriental-az

      pitch-gateway drives show oriental-az --toml > my-drive.toml

      pitch-gateway drives show ./my-drive.toml --json
    """
    if as_json and as_toml:
        raise typer.BadParameter("--json and --toml exclude each other")
    from gateway.cli.drives_output import profile_data, profile_lines

    text, profile = _found(name)
    if as_toml:
        typer.echo(text, nl=False)
    elif as_json:
        typer.echo(json.dumps(profile_data(name, profile), indent=2, ensure_ascii=False))
    else:
        for line in profile_lines(name, profile):
            typer.echo(line)


def _found(name: str) -> "tuple[str, Profile]":
    from gateway.config.drive_files import near_names, read_profile
    from gateway.config.problems import ConfigErrors
    from gateway.drives import library

    if library.is_name(name):
        if name in library.names():
            return library.text_of(name), library.shipped(name)
        typer.echo(f'there is no profile "{name}"; {near_names(name)}', err=True)
        raise typer.Exit(1)
    try:
        profile = read_profile(Path(name))
    except ConfigErrors as errors:
        typer.echo(str(errors), err=True)
        raise typer.Exit(1) from None
    return Path(name).read_text(encoding="utf-8-sig"), profile
