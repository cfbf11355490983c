"""Protection against root writing files for a gateway of another user, who could not use them."""

import os
import pwd
import shlex
from pathlib import Path

from gateway.catalogue import starts
from gateway.ipc.address import ROOT_UID
from gateway.state.folder import ANOTHER, FolderProblem


def why_not_for_root(folder: Path) -> FolderProblem | None:
    """Return why root must not write into a state folder, None if it may, or if this is not root.

    If root wrote there, the service of the folder's owner would not start any more.
    """
    try:
        uid = folder.stat().st_uid
    except OSError:
        return None
    if os.geteuid() != ROOT_UID or uid == ROOT_UID:
        return None
    name = _name_of(uid)
    found = (
        f"{starts.ANOTHER_OWNER.begin(folder=folder, user=name)}, who could not use what root writes there"
    )
    return FolderProblem(found, f"do it as that user (sudo -u {shlex.quote(name)} …), or {ANOTHER}")


def _name_of(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"#{uid}"
