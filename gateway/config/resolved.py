"""A configuration without its secrets."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gateway.config.compile import leaves
from gateway.config.findings import marks_at
from gateway.config.sections import NAMED, SINGLE
from gateway.config.toml import KeyPath
from gateway.drives.strict import Mark
from gateway.secret_files import CREDENTIAL


def written_secrets(tables: Mapping[str, Any], folder: Path) -> set[str]:
    """Return what stands where the file of a secret is to be named, and is no file.

    A person may have written the secret itself. A credential is none. ``folder``: that of the configuration.
    """
    named = {
        value
        for key, value in leaves(tables)
        if isinstance(value, str) and _names_a_secret(key) and not value.startswith(CREDENTIAL)
    }
    return {value for value in named if not _is_there(folder / value)}


def _names_a_secret(key: KeyPath) -> bool:
    kind = str(key[0])
    model = {**SINGLE, **NAMED}.get(kind)
    return model is not None and Mark.SECRET in marks_at(model, key[1 + (kind in NAMED) :])


def _is_there(path: Path) -> bool:
    """Whether there is such a file; where this user may not look there is one."""
    try:
        path.lstat()
    except PermissionError:
        return True
    except (OSError, ValueError):
        return False
    return True
