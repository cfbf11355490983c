"""Serial ports made of pseudo terminals, at the paths of a configuration, and their bytes on the loop."""

import asyncio
import os
import termios
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from gateway.simulator.errors import SimulatorError

READ_BYTES: Final = 4096
MAX_UNREAD_BYTES: Final = 1024
"""Bytes kept for a port that no program reads; a serial wire would have lost them long before."""


class Pty:
    """A pair of descriptors: this process holds the master; the program that opens ``path`` gets the slave.

    The slave stays open here too: otherwise the master fails each time the other program closes its port.
    """

    def __init__(self) -> None:
        self.master_fd, self._slave_fd = os.openpty()
        for fd in (self.master_fd, self._slave_fd):
            tty.setraw(fd)
            os.set_blocking(fd, False)
        self.path = os.ttyname(self._slave_fd)
        self._links: list[Path] = []

    def link(self, path: Path) -> None:
        """Make ``path`` a symbolic link to the slave; :meth:`close` removes it.

        Raises:
            OSError: the link cannot be made.
        """
        path.symlink_to(self.path)
        self._links.append(path)

    def close(self) -> None:
        """Close both ends and remove the links."""
        for path in self._links:
            if path.is_symlink() and str(path.readlink()) == self.path:
                path.unlink()
        self._links.clear()
        for fd in (self.master_fd, self._slave_fd):
            with suppress(OSError):
                os.close(fd)


class PortLinks:
    """Creates missing ports, and removes them again, with the folders made for them."""

    def __init__(self) -> None:
        self._ptys: list[Pty] = []
        self._folders: list[Path] = []

    def make(self, path: Path) -> Pty:
        """Create a port at ``path``.

        Raises:
            SimulatorError: the path exists already, or is not writable.
        """
        if path.is_symlink() and not path.exists():
            _attempt(path, path.unlink)  # Left by a killed simulation: a dangling link.
        if path.exists():
            raise SimulatorError(
                f"{path} exists already: stop the program that made it, or name another path in the "
                "configuration"
            )
        self._make_folders(path)
        pty = Pty()
        self._ptys.append(pty)
        _attempt(path, lambda: pty.link(path))
        return pty

    def close(self) -> None:
        """Remove every port and folder."""
        for pty in self._ptys:
            pty.close()
        self._ptys.clear()
        for folder in reversed(self._folders):
            with suppress(OSError):  # Another program has put something into it.
                folder.rmdir()
        self._folders.clear()

    def _make_folders(self, path: Path) -> None:
        for folder in reversed(path.absolute().parents):
            if not folder.exists():
                _attempt(path, folder.mkdir)
                self._folders.append(folder)


def _attempt(path: Path, action: Callable[[], object]) -> None:
    try:
        action()
    except OSError as error:
        raise SimulatorError(
            f"cannot make a port at {path}: {error.strerror or error}; name a path that may be written, "
            f"such as /tmp/{path.name}"
        ) from error


def open_serial(path: str) -> int:
    """Open the slave of a pty raw and non-blocking, without old input.

    Raises:
        OSError: there is no such port, or no permission.
    """
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    tty.setraw(fd)
    termios.tcflush(fd, termios.TCIOFLUSH)
    return fd


class FdChannel:
    """A descriptor on the running loop: bytes in by callback, bytes out without blocking.

    It does not own the descriptor: the opener closes it, after :meth:`close`.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._unsent = bytearray()
        self._loop = asyncio.get_running_loop()

    def listen(self, on_bytes: Callable[[bytes], None], on_lost: Callable[[], None] | None = None) -> None:
        """Pass on received bytes from now on; ``on_lost`` is called when the port is gone."""
        self._loop.add_reader(self._fd, self._read, on_bytes, on_lost)

    def send(self, data: bytes) -> None:
        """Write what the port takes now, and the rest when there is room."""
        if self._unsent:
            self._unsent += data[: MAX_UNREAD_BYTES - len(self._unsent)]
            return
        sent = self._try_write(data)
        if sent < len(data):
            self._unsent += data[sent:]
            self._loop.add_writer(self._fd, self._write_rest)

    def close(self) -> None:
        """Leave the loop; the descriptor stays open."""
        self._loop.remove_reader(self._fd)
        self._loop.remove_writer(self._fd)

    def _read(self, on_bytes: Callable[[bytes], None], on_lost: Callable[[], None] | None) -> None:
        try:
            data = os.read(self._fd, READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            on_bytes(data)
            return
        self.close()
        if on_lost is not None:
            on_lost()

    def _try_write(self, data: bytes | bytearray) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)  # The other end is gone; the bytes are lost, as on a pulled plug.

    def _write_rest(self) -> None:
        del self._unsent[: self._try_write(self._unsent)]
        if not self._unsent:
            self._loop.remove_writer(self._fd)
