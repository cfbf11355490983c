"""Files that only the gateway may read: passwords, tokens, keys. Where they are, and who else reads them.

``credential:NAME`` is the file of that name that systemd hands to a service (``LoadCredential=``,
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
"""Variable of the environment in which systemd names the folder."""
_CREDENTIAL: Final = re.compile(r"[A-Za-z0-9._-]{1,255}")
"""What a unit has no other meaning for: a space, a colon or a percent sign would end it or become another."""


def is_credential_name(name: str) -> bool:
    """Whether a name with ``credential:`` before it is one that systemd can hand over, and a unit can have.

    >>> [is_credential_name(f"credential:{name}") for name in ("http-key", "", "..", "a/b", "a b", "%h")]
    [True, False, False, False, False, False]
    """
    credential = name.removeprefix(CREDENTIAL)
    return _CREDENTIAL.fullmatch(credential) is not None and credential not in {".", ".."}


def secret_path(name: str, folder: Path) -> Path:
    """Return where a secret is; ``folder`` is that of the configuration file.

    Raises:
        FileRefusedError: a name that no credential can have, or nobody has handed any over.
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
    """Refuse a secret that every user of the machine may read or write; a missing one is not looked at.

    Who may write a token's file lets himself in.

    Raises:
        FileRefusedError: with the mode and the command that mends it.
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
