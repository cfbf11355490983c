"""Files that a person named: reading a regular file of a sensible size, and nothing else; making a new one.

A FIFO would wait for ever for somebody to write into it, a device such as ``/dev/zero`` would fill the
memory, and opening a serial port may switch a machine. So a name is looked at before it is opened, and what
was opened is looked at again.
"""

import os
import stat
from pathlib import Path
from typing import BinaryIO, Final

_KINDS: Final = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


class FileRefusedError(Exception):
    """A file that is not read: what it is (``found``) and what to do (``remedy``)."""

    def __init__(self, found: str, remedy: str) -> None:
        super().__init__(f"{found}; {remedy}")
        self.found = found
        self.remedy = remedy


def read_regular_file(path: Path, limit_bytes: int, what: str) -> bytes:
    """Return the whole content of a regular file; ``what`` is named where another file is needed.

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
    """Open a regular file for reading; ``what`` is named where another file is needed.

    Raises:
        FileRefusedError: missing, no permission, or no regular file.
    """
    try:
        _refuse_irregular(path.stat(), what)
        # Non-blocking: should the name have become a FIFO meanwhile, opening it must not wait either.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        file = open(descriptor, "rb")  # noqa: PTH123, SIM115 - a descriptor, and the caller closes it
        try:
            _refuse_irregular(os.fstat(descriptor), what)
        except FileRefusedError:
            file.close()
            raise
    except FileNotFoundError:
        raise FileRefusedError("no such file", f"give the path of {what}") from None
    except PermissionError:
        remedy = "give this user read permission to the file and its folders"
        raise FileRefusedError("may not be read", remedy) from None
    except (OSError, ValueError) as error:
        why = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise FileRefusedError(f"cannot be read ({why})", f"give the path of {what}") from None
    return file


def kind_of(mode: int) -> str:
    """Say what a file that is no regular file is.

    >>> kind_of(stat.S_IFIFO)
    'a FIFO'
    """
    return next((words for is_kind, words in _KINDS if is_kind(mode)), "no regular file")


def create(path: Path, mode: int = 0o600) -> int:
    """Make a file that is not there yet, and return its descriptor, open for writing.

    Raises:
        OSError: it exists, or cannot be made.
    """
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)


def mark_of(status: os.stat_result) -> tuple[int, ...]:
    """Return by what new content of a file is noticed, without a look into it."""
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns


def _refuse_irregular(status: os.stat_result, what: str) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise FileRefusedError("a folder", f"give the path of {what} in it")
    if not stat.S_ISREG(status.st_mode):
        raise FileRefusedError(f"{kind_of(status.st_mode)}, not a regular file", f"give the path of {what}")
