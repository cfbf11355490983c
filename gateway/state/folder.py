"""The state folder: its files, how they survive a power cut, and its possible problems."""

import contextlib
import errno
import os
import stat
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeGuard

from gateway.catalogue import starts
from gateway.files import FileRefusedError, kind_of, read_regular_file
from gateway.state.include import IncludeError, included_files, merged

DEFAULT_STATE: Final = "state"
"""Folder of the state, relative to the configuration file."""
LARGEST_CONFIGURATION: Final = 4_000_000
"""Bytes. A configuration has a few thousand; a larger file is something else."""
LARGEST_STATE: Final = 200_000_000
"""Bytes: of a compiled file."""
PLAN_NAME: Final = "plan.msgpack"
ANOTHER: Final = "choose another folder with [gateway] state"
LEAST_FREE_BYTES: Final = 64 * 1024
"""With less free space on its disk a folder is full: a compiled plan has about ten kilobytes."""
_REMEDIES: Final = {
    errno.ENOSPC: "free space on its disk",
    errno.EDQUOT: "free space: this user may have no more on its disk",
    errno.EROFS: "mount its disk read-write",
    errno.ENOTDIR: "a file is where a folder should be: move it away",
    errno.EEXIST: "a file is where a folder should be: move it away",
    errno.EISDIR: "a folder is where a file should be: move it away",
    errno.ENOENT: "make the folder that the path or its link leads to",
    errno.EACCES: "give this user write permission to the folder",
    errno.EPERM: "give this user write permission to the folder",
    errno.ETIMEDOUT: "check its disk",
}
"""By error number (errno(3)); for all other errors only another folder helps."""


class StateError(Exception):
    """The state cannot be read or written; one sentence with the path and the remedy."""


def state_folder(config: Path) -> Path:
    """Return the state folder of a configuration, without checking anything else of it.

    Raises:
        StateError: the configuration cannot be read, or is not TOML; or a file that it includes, if the
            folder may be named there.
    """
    try:
        own = _toml_of(config, config)
    except FileRefusedError as error:
        raise StateError(str(error)) from None
    named = _named(own if names_state(own) else merged(configuration_files(config).values()))
    if not _is_a_name(named):
        raise StateError(f"{starts.NO_FOLDER_NAME.begin(found=named)}; allowed: a folder")
    return config.parent / named


def configuration_files(config: Path) -> dict[Path, dict[str, Any]]:
    """Return the content of each file of a configuration: what it includes, in that order, then itself.

    Raises:
        StateError: a file cannot be read, or is not TOML.
    """
    try:
        own = _toml_of(config, config)
        elements = included_files(config, own)
    except (FileRefusedError, IncludeError) as error:
        raise StateError(str(error)) from None
    found = {}
    for path in (path for paths in elements for path in paths):
        try:
            found[path] = _toml_of(path, config)
        except (FileRefusedError, StateError) as error:
            raise StateError(f"{path}: {error}") from None
    return {**found, config: own}


def _toml_of(path: Path, config: Path) -> dict[str, Any]:
    content = read_regular_file(path, LARGEST_CONFIGURATION, "a configuration file")
    try:
        return tomllib.loads(content.decode("utf-8-sig").replace("\r\n", "\n"))
    except (ValueError, RecursionError) as error:
        raise StateError(
            f"{starts.NOT_TOML.begin()}: {error}; pitch-gateway check {config} says where"
        ) from None


def state_folder_anyway(config: Path, document: Mapping[str, Any]) -> Path:
    """Return the state folder of a configuration; the default if it names none that is possible."""
    named = _named(document)
    return config.parent / (named if _is_a_name(named) else DEFAULT_STATE)


def names_state(document: Mapping[str, Any]) -> bool:
    """Whether a file names the state folder; what it includes cannot name another one then."""
    section = document.get("gateway")
    return isinstance(section, dict) and "state" in section


def _named(document: Mapping[str, Any]) -> object:
    section = document.get("gateway", {})
    return section.get("state", DEFAULT_STATE) if isinstance(section, dict) else None


def _is_a_name(named: object) -> TypeGuard[str]:
    return isinstance(named, str) and bool(named) and "\0" not in named


def read_state(path: Path) -> bytes:
    """Return the content of a compiled file, or of one of its sources.

    Raises:
        FileRefusedError: missing, no permission, no regular file, or too large.
    """
    return read_regular_file(path, LARGEST_STATE, "a file")


def make_folder(folder: Path) -> None:
    """Make a folder of the state if there is none; only this user may read it.

    Raises:
        OSError: it cannot be made.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)


def write_if_new(path: Path, content: bytes) -> None:
    """Write a file as :func:`write_whole` does, unless it has this content already."""
    if not path.is_file() or path.read_bytes() != content:
        write_whole(path, content)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that its name has the old content or the new, whatever happens.

    Raises:
        OSError: it cannot be written; the old content is still there.
    """
    import tempfile  # half a MB that a relay, which only reads, does not need

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


@dataclass(frozen=True, slots=True)
class FolderProblem:
    """The problem of a folder, and the remedy."""

    found: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.found}; {self.remedy}"


def problem_of(error: OSError, folder: Path) -> FolderProblem:
    """Return what a system error means for a state folder.

    >>> str(problem_of(OSError(errno.ENOSPC, "No space left on device"), Path("/run/x")))
    '/run/x: No space left on device; free space on its disk, or choose another folder with [gateway] state'
    """
    where = error.filename or folder
    return FolderProblem(
        f"{where}: {error.strerror or error}", _with_another(_REMEDIES.get(error.errno or 0))
    )


def why_no_folder(folder: Path) -> FolderProblem | None:
    """Return why a folder cannot exist at its path, None if it exists or can be made.

    Permissions are not checked: the folder may be used by another user than this one.
    """
    for path in (folder, *folder.parents):
        try:
            mode = path.stat().st_mode
        except NotADirectoryError:
            continue  # something above it is a file
        except FileNotFoundError:
            if not path.is_symlink():
                continue  # it will be made
            found = starts.LINK_TO_NOTHING.begin(path=path, target=path.readlink())
            return FolderProblem(
                f"{found}, which does not exist", _with_another("make the folder that it leads to")
            )
        except PermissionError:
            return None
        except OSError as error:
            return problem_of(error, path)
        if stat.S_ISDIR(mode):
            return None
        kind = "a file" if stat.S_ISREG(mode) else kind_of(mode)
        return FolderProblem(starts.NOT_A_FOLDER.begin(path=path, kind=kind), _with_another("move it away"))
    return None


def identity_of(folder: Path) -> tuple[int, int] | None:
    """Return what distinguishes a folder from another one of its name; None if there is none."""
    try:
        status = folder.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def why_not_usable(folder: Path, identity: tuple[int, int] | None = None) -> FolderProblem | None:
    """Return why nothing more can be stored in a folder, None if it can. Writes nothing.

    ``identity``: its identity when its use began.
    """
    try:
        status = folder.stat()
        disk = os.statvfs(folder)
    except OSError as error:
        return problem_of(error, folder)
    if not stat.S_ISDIR(status.st_mode):
        return why_no_folder(folder)
    if identity is not None and identity != (status.st_dev, status.st_ino):
        found = starts.ANOTHER_FOLDER.begin(folder=folder)
        return FolderProblem(found, "put that one back, or start the gateway anew")
    free_blocks = disk.f_bfree if os.geteuid() == 0 else disk.f_bavail
    is_full = bool(disk.f_blocks) and free_blocks * disk.f_frsize < LEAST_FREE_BYTES
    if disk.f_flag & os.ST_RDONLY:
        code = errno.EROFS
    elif not os.access(folder, os.W_OK | os.X_OK):
        code = errno.EACCES
    elif is_full or (disk.f_files and not disk.f_ffree):
        code = errno.ENOSPC
    else:
        return None
    return problem_of(OSError(code, os.strerror(code)), folder)


def why_open_to_others(folder: Path, owners: frozenset[int] | None) -> FolderProblem | None:
    """Return why another user could add or remove files of a folder, None if none could.

    ``owners`` are its permitted owners; None: any. A missing folder is no problem.
    """
    try:
        status = folder.stat()
    except OSError:
        return None
    if status.st_mode & stat.S_IWOTH:
        mode = f"mode {stat.S_IMODE(status.st_mode):04o}"
        found = f"{starts.OPEN_TO_ALL.begin(folder=folder)} ({mode})"
        return FolderProblem(found, f"who can write there can command axes: chmod o-w {folder}")
    if owners is not None and status.st_uid not in owners:
        owner = starts.ANOTHER_OWNER.begin(folder=folder, user=status.st_uid)
        found = f"{owner}, and this is user {os.geteuid()}"
        return FolderProblem(
            found, f"its owner can command axes: give it to this user or to root, or {ANOTHER}"
        )
    return None


def _with_another(remedy: str | None) -> str:
    return f"{remedy}, or {ANOTHER}" if remedy else ANOTHER
