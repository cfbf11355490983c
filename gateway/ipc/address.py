"""The socket of a gateway: its path, its owner, and what a killed gateway leaves behind."""

import contextlib
import os
import socket
import stat
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.catalogue import starts
from gateway.state.folder import FolderProblem, problem_of
from gateway.state.lock import take_lock

SOCKET_NAME: Final = "relay.sock"
SUPERVISOR_SOCKET_NAME: Final = "supervisor.sock"
LOCK_NAME: Final = "relay.lock"
LONGEST_PATH: Final = 107
"""Bytes: ``sun_path`` of unix(7) has 108 with the zero at its end."""
BACKLOG: Final = 16
ROOT_UID: Final = 0
_CREDENTIALS: Final = struct.Struct("3i")
"""``struct ucred`` of unix(7): process, user, group."""
_NO_LOGIN: Final = 2**32 - 1
"""``loginuid`` of proc(5) for a process that no user started by a log-in. ``sudo`` does not change it."""


class SocketError(Exception):
    """The socket cannot be used; one sentence with the path and the remedy."""


def socket_path(state: Path, name: str = SOCKET_NAME) -> Path:
    """Return the path of a socket in a state folder: the relay's, or that of ``name``.

    Raises:
        SocketError: the path is too long for a socket.
    """
    problem = why_too_long(state, name)
    if problem is not None:
        raise SocketError(str(problem))
    return _socket_path(state, name)


def why_too_long(state: Path, name: str = SOCKET_NAME) -> FolderProblem | None:
    """Return why the path of a socket in a state folder is too long, None if it is not."""
    path = _socket_path(state, name)
    length = len(os.fsencode(path))
    if length <= LONGEST_PATH:
        return None
    return FolderProblem(
        f"{starts.PATH_TOO_LONG.begin(path=path, length=length)} has {LONGEST_PATH} at most",
        "give [gateway] state a shorter folder, for example /run/pitch-gateway",
    )


def _socket_path(state: Path, name: str) -> Path:
    return Path(os.path.abspath(state)) / name  # noqa: PTH100 - links stay links, they may be shorter


class SocketFile:
    """The file of one gateway's socket, from :meth:`take` to :meth:`leave`.

    A lock beside the socket distinguishes a running gateway from a killed one: the system releases it however
    the process ends. Without ``lock_name`` the caller has a lock already.
    """

    def __init__(self, state: Path, name: str = SOCKET_NAME, lock_name: str | None = LOCK_NAME) -> None:
        self.path = socket_path(state, name)
        self._lock_name = lock_name
        self.is_after_crash = False
        """Whether the previous owner did not finish: its socket was still there."""
        self._lock_fd: int | None = None
        self._inode = 0

    def take(self) -> socket.socket:
        """Return a listening socket that only this user may use.

        Raises:
            SocketError: another gateway uses it, or the folder cannot be made or written.
        """
        try:
            self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._lock()
            self._remove_stale()
            return self._listen()
        except OSError as error:
            self.leave()
            raise SocketError(str(problem_of(error, self.path.parent))) from error
        except SocketError:
            self.leave()
            raise

    @property
    def is_missing(self) -> bool:
        """Whether another program has removed the socket: no client can connect. The lock is still held."""
        return bool(self._inode) and not os.path.lexists(self.path)

    def make_again(self) -> socket.socket:
        """Return another listening socket, in place of one that is missing.

        Raises:
            SocketError: it cannot be made; with the remedy.
        """
        try:
            return self._listen()
        except OSError as error:
            raise SocketError(str(problem_of(error, self.path.parent))) from error

    def leave(self, *, is_finished: bool = True) -> None:
        """Release the lock, and remove the socket if it is still the one that was made here.

        The socket stays if work is unfinished: the next gateway then knows it, as after a kill.
        """
        if self._inode and is_finished:
            with contextlib.suppress(OSError):
                if self.path.lstat().st_ino == self._inode:
                    self.path.unlink()
        self._inode = 0
        if self._lock_fd is not None:
            os.close(self._lock_fd)
            self._lock_fd = None

    def _lock(self) -> None:
        if self._lock_name is None:
            return
        try:
            self._lock_fd = take_lock(self.path.with_name(self._lock_name))
        except BlockingIOError:
            raise self._in_use() from None

    def _remove_stale(self) -> None:
        try:
            mode = self.path.lstat().st_mode
        except FileNotFoundError:
            return
        if not stat.S_ISSOCK(mode):
            raise SocketError(f"{starts.NO_SOCKET.begin(path=self.path)}; move it away")
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
            other.setblocking(False)
            try:
                other.connect(str(self.path))
            except ConnectionRefusedError:
                self.path.unlink()  # its owner has gone
                self.is_after_crash = True
                return
            except BlockingIOError:
                pass  # its owner is too busy to accept
        raise self._in_use()

    def _listen(self) -> socket.socket:
        listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            listening.bind(str(self.path))
            self._inode = self.path.lstat().st_ino
            self.path.chmod(0o600)  # before any client can connect
            listening.setblocking(False)
            listening.listen(BACKLOG)
        except OSError:
            listening.close()
            raise
        return listening

    def _in_use(self) -> SocketError:
        return SocketError(
            f"{starts.GATEWAY_RUNS.begin(place=self.path)}: stop it first, or give this one its own folder "
            "with [gateway] state"
        )


@dataclass(frozen=True, slots=True)
class Peer:
    """The process that made a connection, as the system reports it."""

    uid: int
    pid: int

    def as_fields(self) -> dict[str, object]:
        """Return who it is, for an event. The program is known only while it runs and may be seen."""
        program = _read_of(self.pid, "comm")
        login = _read_of(self.pid, "loginuid")
        return {
            "user": self.uid,
            "pid": self.pid,
            **({"program": program} if program else {}),
            **({"login": int(login)} if login.isdecimal() and int(login) != _NO_LOGIN else {}),
        }


def peer_of(connection: socket.socket) -> Peer:
    """Return who is at the other end of a connection."""
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, uid, _ = _CREDENTIALS.unpack(credentials)
    return Peer(uid, pid)


def _read_of(pid: int, name: str) -> str:
    """Return a small file of a process; "" if it has ended or may not be seen."""
    try:
        return Path(f"/proc/{pid}/{name}").read_text("utf-8", "replace").strip()
    except OSError:
        return ""
