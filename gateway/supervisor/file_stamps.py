"""What the tables folder looks like from outside: cheap, and good on network file systems too."""

import contextlib
import errno
import fcntl
import os
import signal
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path

from gateway.files import mark_of
from gateway.supervisor.debounce import FileStamp
from gateway.tabfile import TabFileError, TableState, find_table


def ignore_broken_leases() -> None:
    """Let SIGIO pass, which would end the process; on its main thread, before the first look."""
    signal.signal(signal.SIGIO, signal.SIG_IGN)


def scan(folder: Path, names: Iterable[str]) -> Mapping[str, FileStamp]:
    """Return the sight of each file, by name; symlinks are followed. Blocks as long as the file system does.

    A folder that cannot be read is seen as files that cannot be: nothing in it is gone.
    """
    return {name: _stamp(folder, name) for name in set(names)}


def _stamp(folder: Path, name: str) -> FileStamp:
    try:
        found = find_table(folder, name)
    except TabFileError as error:
        return FileStamp(is_there=True, mark=(str(error),))
    if found.state is not TableState.PRESENT:
        return FileStamp(is_there=False)
    try:
        status = found.path.stat()
    except FileNotFoundError:
        # The name is there and what it points to is not: a symlink that is being swapped, or dangles.
        return FileStamp(is_there=True, mark=(found.path.name, errno.ENOENT))
    except OSError as error:
        return FileStamp(is_there=True, mark=(found.path.name, error.errno))
    mark = (found.path.name, *mark_of(status), status.st_mode, status.st_ctime_ns)
    is_file = stat.S_ISREG(status.st_mode)  # opening anything else may do something
    return FileStamp(is_there=True, mark=mark, is_being_written=is_file and _is_being_written(found.path))


def _is_being_written(path: Path) -> bool:
    """Whether a program of this machine has a file open for writing; False where that cannot be known.

    A read lease is refused exactly then (fcntl(2), F_SETLEASE); it is given back at once. Whoever opens the
    file in between has it broken, which is told by SIGIO: :func:`ignore_broken_leases` first.
    """
    with contextlib.suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        try:
            fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_RDLCK)
            fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_UNLCK)
        except BlockingIOError:
            return True
        finally:
            os.close(descriptor)
    return False
