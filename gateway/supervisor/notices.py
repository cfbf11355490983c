"""What the system tells of a folder by itself: inotify(7), which Python does not know."""

import ctypes
import os
import struct
from pathlib import Path
from typing import Final

_IN_CLOEXEC_NONBLOCK: Final = os.O_CLOEXEC | os.O_NONBLOCK
"""IN_CLOEXEC and IN_NONBLOCK are defined as these (inotify_init(2))."""
_MODIFY, _ATTRIB, _CLOSE_WRITE = 0x2, 0x4, 0x8
_MOVED_FROM, _MOVED_TO, _CREATE, _DELETE = 0x40, 0x80, 0x100, 0x200
_DELETE_SELF, _MOVE_SELF, _IGNORED = 0x400, 0x800, 0x8000
_CHANGES: Final = _MODIFY | _ATTRIB | _CLOSE_WRITE | _MOVED_FROM | _MOVED_TO | _CREATE | _DELETE
_ENDS: Final = _DELETE_SELF | _MOVE_SELF | _IGNORED
"""The folder is another one now, or none."""
_HEAD: Final = struct.Struct("iIII")
"""Struct inotify_event: watch, what happened, cookie, length of the name behind it."""
_READ_BYTES: Final = 65536

_libc = ctypes.CDLL(None, use_errno=True)


def _checked(result: int, folder: Path | None = None) -> int:
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code), None if folder is None else str(folder))
    return result


def create() -> int:
    """Return the descriptor of a new queue; it can be read when there is a notice. Raises OSError."""
    return _checked(_libc.inotify_init1(_IN_CLOEXEC_NONBLOCK))


def add(queue_fd: int, folder: Path) -> None:
    """Have changes of a folder, and of the files in it, told from now on.

    It blocks where the file system does. Raises OSError.
    """
    _checked(_libc.inotify_add_watch(queue_fd, os.fsencode(folder), _CHANGES | _ENDS), folder)


def take(queue_fd: int) -> bool:
    """Take what has been told; returns whether more will be: not after the folder has gone."""
    is_there = True
    while True:
        try:
            data = os.read(queue_fd, _READ_BYTES)
        except BlockingIOError:
            return is_there
        at = 0
        while at < len(data):
            _, what, _, name_bytes = _HEAD.unpack_from(data, at)
            is_there = is_there and not what & _ENDS
            at += _HEAD.size + name_bytes
