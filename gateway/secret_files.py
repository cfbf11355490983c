"""Files that only the gateway may read: passwords, tokens, keys. Where they are, and who else reads them.

``credential:NAME`` is the file of that name that systemd hands to a service (``LoadCredential=``,
systemd.exec(5)); every other name is a path, relative to the configuration file.
"""

import os
import stat
from pathlib import Path
from typing import Final

from gateway.files import FileRefusedError

CREDENTIAL: Final = "credential:"
CREDENTIALS_FOLDER: Final = "CREDENTIALS_DIRECTORY"
"""Variable of the environment in which systemd names the folder."""


def secret_path(name: str, folder: Path) -> Path:
    """Return where a secret is; ``folder`` is that of the configuration file.

    Raises:
        FileRefusedError: a credential with a folder in its name, or nobody has handed any over.
    """
    if not name.startswith(CREDENTIAL):
        return folder / name
    credential = name.removeprefix(CREDENTIAL)
    if not credential or "/" in credential or credential in {".", ".."}:
        raise FileRefusedError(
            f"{name} is no name of a credential", "name it as LoadCredential= does, without a folder"
        )
    handed_over = os.environ.get(CREDENTIALS_FOLDER)
    if not handed_over:
        raise FileRefusedError(
            f"{name}: no credentials were handed over",
            f"start it as a service with LoadCredential={credential}:PATH, or give a path",
        )
    return Path(handed_over) / credential


def refuse_readable_by_others(path: Path) -> None:
    """Refuse a secret that every user of the machine may read; one that is not there is not looked at.

    Raises:
        FileRefusedError: with the mode and the command that mends it.
    """
    try:
        mode = path.stat().st_mode
    except OSError:
        return
    if mode & stat.S_IROTH:
        raise FileRefusedError(
            f"every user of this machine may read it (mode {stat.S_IMODE(mode):04o})", f"chmod o-r {path}"
        )
