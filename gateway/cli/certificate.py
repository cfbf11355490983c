"""``pitch-gateway certificate``: the user's own authority for Modbus/TCP Security."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from gateway.cli import output
from gateway.cli.arguments import AsJson

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)

Folder = Annotated[
    Path,
    typer.Argument(metavar="DIR", help="Folder of the authority and its certificates.", show_default=False),
]


@app.callback()
def certificates() -> None:
    """Make and show the certificates for TLS between controllers and gateway.

    DIR is the folder of the authority. Its key, ca.key, signs everyone who may move the machine. Keep the
    folder on a computer outside the machine's network, and copy only the files that each side needs.
    docs/tls.md has the steps.

    Examples:
      pitch-gateway certificate ca machine-ca

      pitch-gateway certificate server machine-ca --host mill-1.local --host 192.168.0.5

      pitch-gateway certificate controller machine-ca cnc --role Operator
    """


@app.command()
def ca(
    folder: Folder,
    *,
    name: Annotated[str, typer.Option("--name", help="Name of the authority.")] = "pitch-gateway CA",
) -> None:
    """Make an authority, valid for ten years: ca.pem, its key ca.key, and an empty list crl.pem.

    Examples:
      pitch-gateway certificate ca machine-ca

      pitch-gateway certificate ca machine-ca --name "Hall 2"
    """
    from gateway.clock import now_utc
    from gateway.commissioning.certificates import found_authority, make_authority

    now = now_utc()
    with _problems():
        _print_written(*found_authority(folder, lambda: make_authority(name, now), now))


@app.command()
def server(
    folder: Folder,
    *,
    hosts: Annotated[
        list[str],
        typer.Option("--host", help="Name or address that controllers connect to; repeat it for each."),
    ],
    name: Annotated[str, typer.Option("--name", help="Name of the files.")] = "server",
) -> None:
    """Make the certificate of a gateway, valid for 825 days: NAME.pem and NAME.key.

    Examples:
      pitch-gateway certificate server machine-ca --host mill-1.local --host 192.168.0.5

      pitch-gateway certificate server machine-ca --host 192.168.0.6 --name mill-2
    """
    from gateway.clock import now_utc
    from gateway.commissioning.certificates import make_server, read_authority, write_signed

    now = now_utc()
    with _problems():
        signed = make_server(read_authority(folder, now), name, hosts, now)
        _print_written(*write_signed(folder, name, signed))


@app.command()
def controller(
    folder: Folder,
    name: Annotated[
        str,
        typer.Argument(metavar="NAME", help="Name of the controller and of its files.", show_default=False),
    ],
    *,
    role: Annotated[str, typer.Option("--role", help="A role of the key roles in the configuration.")],
) -> None:
    """Make the certificate of a controller with its role, valid for 825 days: NAME.pem and NAME.key.

    Examples:
      pitch-gateway certificate controller machine-ca cnc --role Operator

      pitch-gateway certificate controller machine-ca panel --role Viewer
    """
    from gateway.clock import now_utc
    from gateway.commissioning.certificates import make_controller, read_authority, write_signed

    now = now_utc()
    with _problems():
        signed = make_controller(read_authority(folder, now), name, role, now)
        _print_written(*write_signed(folder, name, signed))


@app.command()
def revoke(
    folder: Folder,
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Name of the files of a certificate.", show_default=False)
    ],
) -> None:
    """Add a certificate to crl.pem. A gateway with this list as `revoked` then refuses it.

    An open connection stays open: close it at the controller, or restart the gateway.

    Examples:
      pitch-gateway certificate revoke machine-ca cnc
    """
    from gateway.clock import now_utc
    from gateway.commissioning.certificates import revoke as revoke_in

    with _problems():
        _print_written(revoke_in(folder, name, now_utc()))


@app.command()
def show(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="PEM file.", show_default=False)],
    *,
    as_json: AsJson = False,
) -> None:
    """Show the certificates in a file: owner, role and end of validity; or the number of revoked ones.

    Examples:
      pitch-gateway certificate show machine-ca/cnc.pem

      pitch-gateway certificate show /etc/pitch-gateway/server.pem --json | jq .certificates[0].until
    """
    from gateway.clock import now_utc
    from gateway.commissioning.certificates import read_file
    from gateway.files import FileRefusedError

    try:
        found = read_file(file, now_utc())
    except FileRefusedError as error:
        typer.echo(f"{file}: {error}", err=True)
        raise typer.Exit(1) from None
    output.show(found, output.Format.INDENTED if as_json else output.Format.TEXT)


def _print_written(*files: Path) -> None:
    for file in files:
        typer.echo(file)


@contextmanager
def _problems() -> Iterator[None]:
    """Report an impossible action in the folder, and end with exit code 1; a wrong name is wrong usage."""
    from gateway.commissioning.certificates import FolderError
    from gateway.options import OptionError

    try:
        yield
    except OptionError as error:
        raise typer.BadParameter(str(error)) from None
    except FolderError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from None
