"""``pitch-gateway token FILE``."""

import contextlib
import os
import secrets
from pathlib import Path
from typing import Annotated, Final

import typer

from gateway.files import create

BYTES: Final = 32
"""256 bits, 43 characters in base64."""
MODE: Final = 0o600


def token(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="The file that will hold the token.", show_default=False)
    ],
    *,
    force: Annotated[bool, typer.Option("--force", help="Put a new token into a file that exists.")] = False,
) -> None:
    """Write a new random token into a file that only this user may read.

    With a token somebody may look at the status page: name its file in http.tokens. Programs
    show it as "Authorization: Bearer …", people type it once. The token itself is not printed.

    With --force a file that exists gets another token. A gateway that runs notices that by itself: the
    old token counts for nothing any more, and whoever logged in with it is out.

    Exit code 0 when it is written; 1 when the file exists, or cannot be written.

    Examples:
        pitch-gateway token people.token

        pitch-gateway token /etc/pitch-gateway/prometheus.token

        pitch-gateway token people.token --force
    """
    try:
        _write(file, f"{secrets.token_urlsafe(BYTES)}\n", force=force)
    except FileExistsError:
        typer.echo(f"{file}: exists already; --force puts a new token into it", err=True)
        raise typer.Exit(1) from None
    except OSError as error:
        why = error.strerror or error
        typer.echo(f"{file}: cannot be written ({why}); name a file in a folder of yours", err=True)
        raise typer.Exit(1) from None
    typer.echo(f"{file}: a new token")


def _write(file: Path, text: str, *, force: bool) -> None:
    """Write a file whole: whoever reads it meanwhile finds the old token or the new one.

    Raises:
        FileExistsError: it exists, without ``force``.
        OSError: it cannot be written.
    """
    new = file.with_name(f".{file.name}.{os.getpid()}.new")
    descriptor = create(new, MODE)
    try:
        with os.fdopen(descriptor, "w") as writing:
            if force:
                _be_like(file, descriptor)
            writing.write(text)
            writing.flush()
            os.fsync(descriptor)
        if force and not file.is_dir():
            new.replace(file)
        else:
            os.link(new, file)  # fails where there is one
    finally:
        new.unlink(missing_ok=True)


def _be_like(file: Path, descriptor: int) -> None:
    """Give the new file to whom the old one belongs: the service may be another user than this one."""
    with contextlib.suppress(FileNotFoundError, PermissionError):
        status = file.stat()
        os.fchown(descriptor, status.st_uid, status.st_gid)
        os.fchmod(descriptor, status.st_mode & 0o640 | MODE)
