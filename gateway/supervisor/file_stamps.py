"""Stamps of the files in the tables folder: cheap, and reliable on network file systems too."""

import errno
import fcntl
import os
import signal
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from gateway.config.signatures import signature_path
from gateway.files import mark_of
from gateway.supervisor.debounce import FileStamp
from gateway.tabfile import TabFileError, TableState, find_table

MOUNTS: Final = Path("/proc/self/mountinfo")
LEASES_OF_SERVERS: Final = frozenset({b"nfs", b"nfs4", b"cifs", b"smb3"})
"""File systems that give a lease only if their server has given them the file. Otherwise nfs4_setlease and
cifs_setlease of Linux refuse it as if there were a writer."""


def ignore_broken_leases() -> None:
    """Ignore SIGIO, which would end the process. Call it on the main thread before the first :func:`scan`."""
    signal.signal(signal.SIGIO, signal.SIG_IGN)


def scan(folder: Path, names: Iterable[str], *, signed: bool = False) -> Mapping[str, FileStamp]:
    """Return the stamp of each file, by name; symlinks are followed. Blocks as long as the file system does.

    If the folder cannot be read, its files count as unreadable, not as gone. ``signed``: each file must have
    a signature (``config.signatures``). A signature is a part of its file whether it must have one or not.
    """
    return {name: _stamp(folder, name, signed=signed) for name in set(names)}


def _stamp(folder: Path, name: str, *, signed: bool) -> FileStamp:
    try:
        found = find_table(folder, name)
    except TabFileError as error:
        return FileStamp(is_there=True, mark=(str(error),))
    if found.state is not TableState.PRESENT:
        return FileStamp(is_there=False)
    table, signature = _stamp_of(found.path), _stamp_of(signature_path(found.path))
    writers = {table.is_being_written, signature.is_being_written}
    return FileStamp(
        is_there=True,
        mark=(table.mark, signature.mark),
        is_being_written=True if True in writers else None if None in writers else False,
        changed_ns=max(table.changed_ns, signature.changed_ns),
        is_signature_due=signed and signature.changed_ns < table.changed_ns,
    )


def _stamp_of(path: Path) -> FileStamp:
    try:
        status = path.stat()
    except FileNotFoundError:
        # The name exists but its target does not: a symlink that is being swapped, or dangles.
        return FileStamp(is_there=True, mark=(path.name, errno.ENOENT))
    except OSError as error:
        return FileStamp(is_there=True, mark=(path.name, error.errno))
    mark = (path.name, *mark_of(status), status.st_mode, status.st_ctime_ns)
    is_file = stat.S_ISREG(status.st_mode)  # opening anything else may have an effect
    is_being_written = is_file and _is_being_written(path)
    if is_being_written and _is_by_server(status.st_dev):
        is_being_written = None
    return FileStamp(
        is_there=True, mark=mark, is_being_written=is_being_written, changed_ns=status.st_mtime_ns
    )


def _is_by_server(device: int) -> bool:
    """Whether a refused lease proves nothing on the file system of a device."""
    number = f"{os.major(device)}:{os.minor(device)}".encode()
    try:
        mounts = [line.split() for line in MOUNTS.read_bytes().splitlines()]
    except OSError:
        return False
    return any(mount[2] == number and mount[mount.index(b"-") + 1] in LEASES_OF_SERVERS for mount in mounts)


def _is_being_written(path: Path) -> bool | None:
    """Whether a program on this machine has a file open for writing; None if the system does not tell.

    The system refuses a read lease exactly then (fcntl(2), F_SETLEASE). The lease is returned immediately. A
    program that opens the file in between breaks the lease, which causes SIGIO: call
    :func:`ignore_broken_leases` first.

    Only the owner of a file gets a lease, and whoever has CAP_LEASE: the service has neither for a table that
    root or another user owns. Some file systems have no leases.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError:
        return False  # nobody can read half of it either
    try:
        fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_RDLCK)
        fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_UNLCK)
    except BlockingIOError:
        return True
    except OSError:
        return None
    finally:
        os.close(descriptor)
    return False
