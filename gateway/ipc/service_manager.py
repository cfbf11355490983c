"""Messages of a service to its manager, and the descriptors that the manager keeps for it: sd_notify(3).

Each message is one datagram, without a wait: a manager that does not read loses it, and the gateway
continues. Only the message that it is ready is repeated, because the manager ends a service that never
becomes ready. Without a manager nothing is sent, and nothing changes.
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
    """The manager of this service. ``address`` empty: there is none, and nothing is sent.

    ``watchdog_ns``: longest interval between two signs of life; 0: there is no watchdog.
    """

    def __init__(self, address: str = "", watchdog_ns: int = 0) -> None:
        self.watchdog_ns = watchdog_ns
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        self._status = ""
        self._owes_ready = False
        """The manager ends a service that never becomes ready."""
        if address.startswith(("/", "@")):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)

    @property
    def is_there(self) -> bool:
        """Whether there is a manager."""
        return self._socket is not None

    def ready(self, status: str = "") -> None:
        """Report that the service is ready; immediately, or with the next message."""
        self._owes_ready = True
        self._notify(*self._new_status(status))

    def alive(self, status: str = "") -> None:
        """Feed the watchdog; call it only if the work makes progress."""
        self._notify("WATCHDOG=1", *self._new_status(status))

    def show_status(self, status: str) -> None:
        """Show a sentence in the manager's status; an unchanged one costs nothing."""
        if (news := self._new_status(status)) or self._owes_ready:
            self._notify(*news)

    def stopping(self, patience_s: float = 0.0) -> None:
        """Report that the service ends, and how much longer than usual that may take."""
        self._owes_ready = False
        more = [f"EXTEND_TIMEOUT_USEC={int(patience_s * US_PER_S)}"] if patience_s > 0 else []
        self._notify("STOPPING=1", *more)

    def store(self, name: str, descriptor: int) -> None:
        """Have a descriptor kept until the next start, if the manager allows it (FileDescriptorStoreMax=)."""
        self._notify("FDSTORE=1", f"FDNAME={name}", descriptors=[descriptor])

    def drop(self, name: str) -> None:
        """Have everything closed that is kept under a name."""
        self._notify("FDSTOREREMOVE=1", f"FDNAME={name}")

    def close(self) -> None:
        """Send nothing any more; twice is harmless."""
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
        # A manager that is gone or does not read must not delay the line.
        with contextlib.suppress(OSError):
            self._socket.sendmsg([message], rights, socket.MSG_DONTWAIT, self._address)
            self._owes_ready = False


def manager_of(environment: MutableMapping[str, str]) -> ServiceManager:
    """Return the manager that the environment names, and remove it there: children must not report to it."""
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
            continue  # announced, but not open
        yield (names[offset] if offset < len(names) else ""), descriptor
