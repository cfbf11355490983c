"""Ports of this machine for programs that are told where to listen, before they run."""

import itertools
import os
import socket
from typing import Final

FIRST: Final = 10_000
"""Below the ports that the system gives to clients and to port 0, so that nobody takes one meanwhile."""
LAST: Final = 31_999
EACH: Final = 2_000
"""So many for each process of pytest-xdist, which run tests side by side."""

_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_number = itertools.count(os.getpid())


def free_port() -> int:
    """Return a port of the loopback interface that nobody listens on, another one each time."""
    first = FIRST + _worker * EACH % (LAST + 1 - FIRST)
    for number in itertools.islice(_number, EACH):
        port = first + number % EACH
        try:
            socket.create_server(("127.0.0.1", port)).close()
        except OSError:
            continue
        return port
    raise AssertionError(f"all ports from {first} to {first + EACH - 1} are in use")
