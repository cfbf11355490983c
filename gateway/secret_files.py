"""Files that only the gateway may read: passwords, tokens, keys. Their paths, and a check of their mode.

``credential:NAME`` is the file of that name that systemd gives to a service (``LoadCredential=``,
systemd.exec(5)); every other name is a path, relative to the configuration file.
"""

import os
import re
import stat
from pathlib import Path
from typing import Final

from gateway.files import FileRefusedError

CREDENTIAL: Final = "credential:"
CREDENTIALS_FOLDER: Final = "CREDENTIALS_DIRECTORY"
"""Environment variable in which systemd names the folder."""
RANDOM_BYTES: Final = 32
"""256 bits, 43 characters in base64."""
_CREDENTIAL: Final = re.compile(r"[A-Za-z0-9._-]{1,255}")
"""Characters without another meaning in a unit: a space, a colon or a percent sign has one."""


def new_secret() -> bytes:
    """Return the content of a file with a new token or password: random, on one line."""
    import secrets  # it loads random and hmac, which a relay does not need

    return f"{secrets.token_urlsafe(RANDOM_BYTES)}\n".encode()


def is_credential_name(name: str) -> bool:
    """Whether a name ``credential:NAME`` is possible for systemd and in a unit.

    >>> [is_credential_name(f"credential:{name}") for name in ("http-key", "", "..", "a/b", "a b", "%h")]
    [True, False, False, False, False, False]
    """
    credential = name.removeprefix(CREDENTIAL)
    return _CREDENTIAL.fullmatch(credential) is not None and credential not in {".", ".."}


def secret_path(name: str, folder: Path) -> Path:
    """Return the path of a secret; ``folder`` is that of the configuration file.

    Raises:
        FileRefusedError: a name that no credential can have, or the service has no credentials.
    """
    if not name.startswith(CREDENTIAL):
        return folder / name
    credential = name.removeprefix(CREDENTIAL)
    if not is_credential_name(name):
        raise FileRefusedError(
            f"{name} is no name of a credential",
            "name it as LoadCredential= does, without a folder: letters, digits, . _ and -",
        )
    handed_over = os.environ.get(CREDENTIALS_FOLDER)
    if not handed_over:
        raise FileRefusedError(
            f"{name}: no credentials were handed over",
            f"start it as a service with LoadCredential={credential}:PATH, or give a path",
        )
    return Path(handed_over) / credential


def refuse_open_to_others(path: Path) -> None:
    """Refuse a secret that every user of the machine may read or write; a missing one is not checked.

    A user who may write the file of a token can log in with it.

    Raises:
        FileRefusedError: with the mode and the command that corrects it.
    """
    try:
        mode = path.stat().st_mode
    except OSError:
        return
    rights = ((stat.S_IROTH, "read it", "r"), (stat.S_IWOTH, "write to it", "w"))
    given = [(what, letter) for right, what, letter in rights if mode & right]
    if given:
        may = " and ".join(what for what, _ in given)
        raise FileRefusedError(
            f"every user of this machine may {may} (mode {stat.S_IMODE(mode):04o})",
            f"chmod o-{''.join(letter for _, letter in given)} {path}",
        )
