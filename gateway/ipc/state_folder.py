"""Files in the state folder: where they are, and how they are written so that a power cut spoils none."""

import contextlib
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeGuard

from gateway.files import FileRefusedError, read_regular_file

DEFAULT_STATE: Final = "state"
"""Folder of the state, relative to the configuration file."""
LARGEST_CONFIGURATION: Final = 4_000_000
"""Bytes. A configuration has a few thousand; whatever is larger is another file."""
LARGEST_STATE: Final = 200_000_000
"""Bytes: of a compiled file."""
PLAN_NAME: Final = "plan.msgpack"
TABLES_NAME: Final = "tables"
TABLE_SUFFIX: Final = ".doubles"


class StateError(Exception):
    """The state cannot be read or written; one sentence with the path and the remedy."""


def state_folder(config: Path) -> Path:
    """Return the state folder of a configuration, with nothing else of it looked at.

    Raises:
        StateError: the configuration cannot be read, or is not TOML.
    """
    try:
        content = read_regular_file(config, LARGEST_CONFIGURATION, "a configuration file")
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
        document: dict[str, Any] = tomllib.loads(text)
    except FileRefusedError as error:
        raise StateError(str(error)) from None
    except (ValueError, RecursionError) as error:
        raise StateError(f"not TOML: {error}; pitch-gateway check {config} says where") from None
    named = _named(document)
    if not _is_a_name(named):
        raise StateError(f"gateway.state: found {named!r}; allowed: a folder")
    return config.parent / named


def state_folder_anyway(config: Path, document: Mapping[str, Any]) -> Path:
    """Return the state folder of a configuration; the default where it names none that can be one."""
    named = _named(document)
    return config.parent / (named if _is_a_name(named) else DEFAULT_STATE)


def _named(document: Mapping[str, Any]) -> object:
    section = document.get("gateway", {})
    return section.get("state", DEFAULT_STATE) if isinstance(section, dict) else None


def _is_a_name(named: object) -> TypeGuard[str]:
    return isinstance(named, str) and bool(named) and "\0" not in named


def read_state(path: Path) -> bytes:
    """Return a file that was compiled, or that something was compiled from.

    Raises:
        FileRefusedError: missing, no permission, no regular file, or too large.
    """
    return read_regular_file(path, LARGEST_STATE, "a file")


def table_path(state: Path, digest: str) -> Path:
    """Return where a compiled table is kept."""
    return state / TABLES_NAME / f"{digest}{TABLE_SUFFIX}"


def make_folder(folder: Path) -> None:
    """Make a folder of the state where there is none; only this user may look into it.

    Raises:
        OSError: it cannot be made.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that its name stands for the old content or for the new, whatever happens.

    Raises:
        OSError: it cannot be written; the old content is still there.
    """
    import tempfile  # half a MB that a relay, which only reads, has no use for

    descriptor, made = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        Path(made).replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            Path(made).unlink()
        raise
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(folder)  # the new name too
    finally:
        os.close(folder)
