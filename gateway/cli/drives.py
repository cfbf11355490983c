"""``pitch-gateway drives``: the drive profiles that come with the gateway."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli import output
from gateway.cli.arguments import AsJson

if TYPE_CHECKING:
    from gateway.drives.profile import Profile

app = typer.Typer(
    invoke_without_command=True,
    rich_markup_mode=None,
)


@app.callback()
def list_drives(context: typer.Context, *, as_json: AsJson = False) -> None:
    """List the drive profiles that come with the gateway.

    Tier A: manuals and independent programs agree. Tier B: sources of one family only. Use each profile as a
    start: check its list of traps before the machine runs.

    Examples:
      pitch-gateway drives

      pitch-gateway drives --json

      pitch-gateway drives show oriental-az
    """
    if context.invoked_subcommand is not None:
        return
    from gateway.drives.described import ProfileList

    output.show(ProfileList(), output.Format.INDENTED if as_json else output.Format.TEXT)


@app.command()
def show(
    name: Annotated[
        str,
        typer.Argument(metavar="NAME", help="Profile of the list, or your own file.", show_default=False),
    ],
    *,
    as_json: AsJson = False,
    as_toml: Annotated[
        bool, typer.Option("--toml", help="Print the profile as a TOML file, to copy and change.")
    ] = False,
) -> None:
    """Show a drive profile: registers, meaning of frames, traps, and the source of each value.

    Examples:
      pitch-gateway drives show oriental-az

      pitch-gateway drives show oriental-az --toml > my-drive.toml

      pitch-gateway drives show ./my-drive.toml --json
    """
    if as_json and as_toml:
        raise typer.BadParameter("give --json or --toml, not both")
    from gateway.drives.described import ProfileShown

    text, profile = _found(name)
    if as_toml:
        typer.echo(text, nl=False)
    else:
        output.show(ProfileShown(name, profile), output.Format.INDENTED if as_json else output.Format.TEXT)


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
