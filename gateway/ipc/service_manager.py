"""What a service tells the manager that started it, and what that one keeps for it: sd_notify(3).

Everything goes out as one datagram that is never waited for: a manager that does not read loses it, and the
gateway goes on. Only that it is ready is told again: a service that is never ready is ended. Without a
manager nothing is sent, and nothing changes.
"""

import contextlib
import os
import socket
from array import array
from collections.abc import Iterator, MutableMapping, Sequence
from typing import Final

from gateway.times import NS_PER_US

FIRST_DESCRIPTOR: Final = 3
"""SD_LISTEN_FDS_START of sd_listen_fds(3)."""
LONGEST_STATUS: Final = 200
"""Characters of a sentence for ``systemctl status``."""
US_PER_S: Final = 1_000_000


class ServiceManager:
    """The manager of this service. ``address`` empty: nobody, and what is told is told to nobody.

    ``watchdog_ns``: so often it wants to hear that the work gets on, 0 where it does not.
    """

    def __init__(self, address: str = "", watchdog_ns: int = 0) -> None:
        self.watchdog_ns = watchdog_ns
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        self._status = ""
        self._owes_ready = False
        """A manager that never hears that the service is ready ends it."""
        if address.startswith(("/", "@")):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)

    @property
    def is_there(self) -> bool:
        """Whether anybody listens."""
        return self._socket is not None

    def ready(self, status: str = "") -> None:
        """Tell that the service does its work now; at once, or along with what is told next."""
        self._owes_ready = True
        self._notify(*self._new_status(status))

    def alive(self, status: str = "") -> None:
        """Feed the watchdog; to be called only where the work got on."""
        self._notify("WATCHDOG=1", *self._new_status(status))

    def show_status(self, status: str) -> None:
        """Show a sentence in the manager's status; the same as before costs nothing."""
        if (news := self._new_status(status)) or self._owes_ready:
            self._notify(*news)

    def stopping(self, patience_s: float = 0.0) -> None:
        """Tell that the service ends, and how much longer than usual that may take."""
        self._owes_ready = False
        more = [f"EXTEND_TIMEOUT_USEC={int(patience_s * US_PER_S)}"] if patience_s > 0 else []
        self._notify("STOPPING=1", *more)

    def store(self, name: str, descriptor: int) -> None:
        """Have a descriptor kept over the next start; the manager must allow it (FileDescriptorStoreMax=)."""
        self._notify("FDSTORE=1", f"FDNAME={name}", descriptors=[descriptor])

    def drop(self, name: str) -> None:
        """Have everything that is kept under a name closed."""
        self._notify("FDSTOREREMOVE=1", f"FDNAME={name}")

    def close(self) -> None:
        """Tell nothing any more; twice is harmless."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _new_status(self, status: str) -> list[str]:
        status = " ".join(status.split())[:LONGEST_STATUS]
        if not status or status == self._status:
            return []
        self._status = status
        return [f"STATUS={status}"]

    def _notify(self, *assignments: str, descriptors: Sequence[int] = ()) -> None:
        if self._socket is None:
            return
        if self._owes_ready:
            assignments = ("READY=1", *assignments)
        message = "\n".join(assignments).encode()
        rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array("i", descriptors))] if descriptors else []
        # A manager that is gone or does not read must not cost the line anything.
        with contextlib.suppress(OSError):
            self._socket.sendmsg([message], rights, socket.MSG_DONTWAIT, self._address)
            self._owes_ready = False


def manager_of(environment: MutableMapping[str, str]) -> ServiceManager:
    """Return the manager that the environment names, and take its name out: children do not speak for us."""
    address = environment.pop("NOTIFY_SOCKET", "")
    for_pid = environment.pop("WATCHDOG_PID", str(os.getpid()))
    every_us = environment.pop("WATCHDOG_USEC", "")
    is_watched = for_pid == str(os.getpid()) and every_us.isdecimal()
    return ServiceManager(address, int(every_us) * NS_PER_US if is_watched else 0)


def handed_over(environment: MutableMapping[str, str]) -> Iterator[tuple[str, int]]:
    """Yield what the manager kept for this process, as name and descriptor (sd_listen_fds(3)); once."""
    for_pid, number = environment.pop("LISTEN_PID", ""), environment.pop("LISTEN_FDS", "")
    names = environment.pop("LISTEN_FDNAMES", "").split(":")
    if for_pid != str(os.getpid()) or not number.isdecimal():
        return
    for offset in range(int(number)):
        descriptor = FIRST_DESCRIPTOR + offset
        try:
            os.set_inheritable(descriptor, False)
        except OSError:
            continue  # promised, and not there
        yield (names[offset] if offset < len(names) else ""), descriptor
