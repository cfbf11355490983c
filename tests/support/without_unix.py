"""The program in a Python that lacks what is Unix only, as that of Windows does.

``python -m tests.support.without_unix WORDS`` runs the command WORDS.
"""

import asyncio  # noqa: F401 - these are Python's own, and differ on Windows: they may use what goes below
import importlib.abc
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Sequence
from types import ModuleType
from typing import Final

import numpy as np  # noqa: F401 - asks for the name of a Linux kernel

MODULES: Final = ("curses", "fcntl", "grp", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty")
NAMES: Final[dict[ModuleType, tuple[str, ...]]] = {
    os: (
        "O_CLOEXEC",
        "O_DIRECTORY",
        "O_NOCTTY",
        "O_NOFOLLOW",
        "O_NONBLOCK",
        "chown",
        "fchmod",
        "fchown",
        "fdatasync",
        "fork",
        "geteuid",
        "getgid",
        "getuid",
        "killpg",
        "major",
        "openpty",
        "posix_fallocate",
        "sched_getaffinity",
        "set_blocking",
        "setsid",
        "statvfs",
        "uname",
    ),
    select: tuple(name for name in dir(select) if name.lower().startswith(("epoll", "poll"))),
    signal: ("SIGHUP", "SIGKILL", "SIGPIPE", "SIGUSR1", "SIGUSR2", "SIGWINCH", "pthread_sigmask", "sigwait"),
    socket: ("AF_UNIX",),
    time: ("CLOCK_BOOTTIME", "clock_gettime", "clock_gettime_ns"),
}


class _Missing(importlib.abc.MetaPathFinder):
    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def main() -> None:
    """Take these away, and run the command line."""
    for each in MODULES:
        sys.modules.pop(each, None)
    sys.meta_path.insert(0, _Missing())
    for module, names in NAMES.items():
        for name in names:
            delattr(module, name)
    from gateway.cli.main import main as run

    run()


if __name__ == "__main__":
    main()
