"""Files named by a user: read only a regular file of limited size; write a file whole.

Opening a FIFO would wait for a writer forever, and a device such as ``/dev/zero`` would fill the memory.
Opening a serial port may switch a machine. So the name is checked before it is opened, and the open file
again.
"""

import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final

_KINDS: Final = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def _flags(*names: str) -> int:
    """Return flags for ``os.open`` together, as far as this system has them (Windows lacks most)."""
    return sum(getattr(os, name, 0) for name in ("O_CLOEXEC", "O_BINARY", *names))


# Non-blocking: if the name has become a FIFO meanwhile, the open must not wait either.
_READS: Final = os.O_RDONLY | _flags("O_NONBLOCK", "O_NOCTTY")
_CREATES: Final = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _flags()


class FileRefusedError(Exception):
    """A file that is not read: what it is (``found``) and what to do (``remedy``)."""

    def __init__(self, found: str, remedy: str) -> None:
        super().__init__(f"{found}; {remedy}")
        self.found = found
        self.remedy = remedy


class FileMissingError(FileRefusedError):
    """There is no such file."""


def read_regular_file(path: Path, limit_bytes: int, what: str) -> bytes:
    """Return the whole content of a regular file; ``what`` names the needed file in errors.

    Raises:
        FileRefusedError: missing, no permission, no regular file, or longer than ``limit_bytes``.
    """
    with open_regular_file(path, what) as file:
        try:
            content = file.read(limit_bytes + 1)
        except OSError as error:
            why = error.strerror or str(error)
            raise FileRefusedError(f"cannot be read ({why})", f"give the path of {what}") from None
    if len(content) > limit_bytes:
        raise FileRefusedError(f"more than {limit_bytes} bytes", f"this is not {what}")
    return content


def open_regular_file(path: Path, what: str) -> BinaryIO:
    """Open a regular file for reading; ``what`` names the needed file in errors.

    Raises:
        FileRefusedError: missing, no permission, or no regular file.
    """
    try:
        _refuse_irregular(path.stat(), what)
        descriptor = os.open(path, _READS)
        file = open(descriptor, "rb")  # noqa: PTH123, SIM115 - a descriptor, and the caller closes it
        try:
            _refuse_irregular(os.fstat(descriptor), what)
        except FileRefusedError:
            file.close()
            raise
    except FileNotFoundError:
        raise FileMissingError("no such file", f"give the path of {what}") from None
    except PermissionError:
        remedy = "give this user read permission to the file and its folders"
        raise FileRefusedError("may not be read", remedy) from None
    except (OSError, ValueError) as error:
        why = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise FileRefusedError(f"cannot be read ({why})", f"give the path of {what}") from None
    return file


def kind_of(mode: int) -> str:
    """Say what a file is that is no regular file.

    >>> kind_of(stat.S_IFIFO)
    'a FIFO'
    """
    return next((words for is_kind, words in _KINDS if is_kind(mode)), "no regular file")


def create(path: Path, mode: int = 0o600) -> int:
    """Create a new file, and return its descriptor, open for writing.

    Raises:
        OSError: it exists, or cannot be created.
    """
    return os.open(path, _CREATES, mode)


def write_file(path: Path, content: bytes, *, force: bool, is_secret: bool = False) -> None:
    """Write a file named by a user, whole or not at all.

    With ``force`` an existing file is replaced in one step, also through a link, and the new file keeps its
    owner and mode. A secret is readable by its owner only, and by the group if the replaced file was.

    Raises:
        FileExistsError: the file exists, and no ``force``.
        FileRefusedError: what would be replaced is no regular file, or the path names no file.
        OSError: it cannot be written; the old file is unchanged.
    """
    existing = None
    if force:
        path = Path(os.path.realpath(path))
        with suppress(FileNotFoundError):
            existing = path.stat()
    if existing is not None and not stat.S_ISREG(existing.st_mode):
        raise FileRefusedError(kind_of(existing.st_mode), "give a regular file, or a new name")
    if not path.name:  # "/", "."
        raise FileRefusedError("a folder", "give a new name in it")
    beside = path.with_name(f".pitch-gateway-{os.urandom(8).hex()}")
    try:
        descriptor = create(beside, 0o600 if is_secret else 0o666)
    except OSError as error:  # the new file is made beside the old one
        raise OSError(error.errno, f"folder {path.parent}: {error.strerror}") from None
    try:
        with os.fdopen(descriptor, "wb") as stream:
            if existing is not None and hasattr(os, "fchown"):  # on Windows the folder gives the rights
                _make_like(descriptor, existing, is_secret=is_secret)
            stream.write(content)
            stream.flush()
            os.fsync(descriptor)
        if force:
            beside.replace(path)
        else:
            _give_free_name(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def _make_like(descriptor: int, existing: os.stat_result, *, is_secret: bool) -> None:
    """Give a new file the owner and mode of the one that it replaces, as far as this user may."""
    mode = stat.S_IMODE(existing.st_mode)
    try:
        os.fchown(descriptor, existing.st_uid, existing.st_gid)
    except OSError:  # only root can change the owner
        if is_secret:  # its group is a different one now
            return
    with suppress(OSError):  # a file system without modes
        os.fchmod(descriptor, mode & 0o640 if is_secret else mode)


def _give_free_name(beside: Path, path: Path) -> None:
    """Give a file its name; FileExistsError if that name has been created meanwhile."""
    try:
        path.hardlink_to(beside)  # unlike a rename it replaces nothing
    except FileExistsError:
        raise
    except OSError:  # FAT has no links
        if os.path.lexists(path):
            raise FileExistsError(path) from None
        beside.replace(path)


def mark_of(status: os.stat_result) -> tuple[int, ...]:
    """Return what changes with new content of a file, without reading it."""
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns


def _refuse_irregular(status: os.stat_result, what: str) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise FileRefusedError("a folder", f"give the path of {what} in it")
    if not stat.S_ISREG(status.st_mode):
        raise FileRefusedError(f"{kind_of(status.st_mode)}, not a regular file", f"give the path of {what}")
