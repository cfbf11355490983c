"""A service manager for tests: it hears what a service tells, keeps its descriptors, and gives them back."""

import contextlib
import os
import socket
import subprocess
import sys
import time
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from tests.support.processes import started

ROOT = Path(__file__).parents[2]
SECONDS: Final = 30.0
LAUNCH: Final = """
import fcntl, os, sys
kept = [fcntl.fcntl(int(number), fcntl.F_DUPFD, 200) for number in sys.argv[1].split(",") if number]
for place, number in enumerate(kept):
    os.dup2(number, 3 + place)
os.environ["LISTEN_PID"] = os.environ["WATCHDOG_PID"] = str(os.getpid())
os.execv(sys.argv[2], sys.argv[2:])
"""
"""Puts what was kept where sd_listen_fds(3) has it, and becomes the service; only then its id is known."""


class Manager:
    """What systemd is to a service; ``told`` has everything that was told, in order."""

    def __init__(self, folder: Path, watchdog_us: int = 0) -> None:
        self.told: list[dict[str, str]] = []
        self.kept: list[tuple[str, int]] = []
        self._watchdog_us = watchdog_us
        self._address = str(folder / "notify")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(self._address)

    def close(self) -> None:
        self._socket.close()
        for _, descriptor in self.kept:
            os.close(descriptor)

    @contextlib.contextmanager
    def service(self, *command: str) -> "Iterator[subprocess.Popen[Any]]":
        """Start a service with what it gave to keep before; it is killed at the end."""
        kept = [descriptor for _, descriptor in self.kept]
        environment = {
            **os.environ,
            "NOTIFY_SOCKET": self._address,
            "WATCHDOG_USEC": str(self._watchdog_us) if self._watchdog_us else "",
            "LISTEN_FDS": str(len(kept)),
            "LISTEN_FDNAMES": ":".join(name for name, _ in self.kept),
        }
        launched = [sys.executable, "-c", LAUNCH, ",".join(map(str, kept)), sys.executable, *command]
        with started(
            launched, cwd=ROOT, env=environment, pass_fds=kept, stderr=subprocess.PIPE, text=True
        ) as process:
            yield process
            process.kill()

    def next(self, patience_s: float = SECONDS) -> dict[str, str]:
        """Take the next message; raises TimeoutError where none comes."""
        self._socket.settimeout(patience_s)
        message, rights, _, _ = self._socket.recvmsg(4096, socket.CMSG_SPACE(64))
        assignments = dict(line.split("=", 1) for line in message.decode().split("\n"))
        descriptors = array("i")
        for _, _, data in rights:
            descriptors.frombytes(data)
        if assignments.get("FDSTOREREMOVE") == "1":
            self._forget(assignments["FDNAME"])
        for descriptor in descriptors:
            self.kept.append((assignments["FDNAME"], descriptor))
        self.told.append(assignments)
        return assignments

    def until(self, **wanted: str) -> dict[str, str]:
        """Take messages until one has these assignments."""
        end_s = time.monotonic() + SECONDS
        while time.monotonic() < end_s:
            message = self.next()
            if wanted.items() <= message.items():
                return message
        raise AssertionError(f"{wanted} was not told: {self.told}")

    def falls_silent(self, patience_s: float) -> bool:
        """Take what still comes; returns whether the watchdog is not fed any more for so long."""
        end_s = time.monotonic() + SECONDS
        fed_s = time.monotonic()
        while time.monotonic() < end_s:
            with contextlib.suppress(TimeoutError):
                if "WATCHDOG" in self.next(patience_s):
                    fed_s = time.monotonic()
            if time.monotonic() - fed_s >= patience_s:
                return True
        return False

    def _forget(self, name: str) -> None:
        for kept in [each for each in self.kept if each[0] == name]:
            os.close(kept[1])
            self.kept.remove(kept)


@contextlib.contextmanager
def managing(folder: Path, watchdog_us: int = 0) -> Iterator[Manager]:
    with contextlib.closing(Manager(folder, watchdog_us)) as manager:
        yield manager
