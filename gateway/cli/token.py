"""``pitch-gateway token FILE``."""

from pathlib import Path
from typing import Annotated

import typer

from gateway.files import FileRefusedError, write_file
from gateway.secret_files import new_secret


def token(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File for the token.", show_default=False)],
    *,
    force: Annotated[bool, typer.Option("--force", help="Replace the token in an existing file.")] = False,
) -> None:
    """Write a new random token into a file that only your user can read.

    A token gives read access to the status page: name its file in http.tokens. Programs send it as
    "Authorization: Bearer …"; people type it once. The command does not print the token.

    --force replaces the token of an existing file. A running gateway notices the change: the old token is no
    longer valid, and its users are logged out.

    Exit code 0 if the token is written; 1 if the file exists or cannot be written.

    Examples:
        pitch-gateway token people.token

        pitch-gateway token /etc/pitch-gateway/prometheus.token

        pitch-gateway token people.token --force
    """
    try:
        write_file(file, new_secret(), force=force, is_secret=True)
    except FileExistsError:
        typer.echo(f"{file}: exists already; --force replaces its token", err=True)
        raise typer.Exit(1) from None
    except FileRefusedError as error:
        typer.echo(f"{file}: {error}", err=True)
        raise typer.Exit(1) from None
    except OSError as error:
        why = error.strerror or error
        typer.echo(f"{file}: cannot be written ({why}); name a file in your own folder", err=True)
        raise typer.Exit(1) from None
    typer.echo(f"{file}: new token written")
