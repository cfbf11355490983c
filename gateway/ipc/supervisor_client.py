"""Requests to the supervisor of a running gateway, over its socket. Blocking, for commands."""

import contextlib
import http.client
import json
import socket
from pathlib import Path
from typing import Any, Final

from gateway.ipc.address import SUPERVISOR_SOCKET_NAME, SocketError, socket_path
from gateway.ipc.client import NoGatewayError, check_owner

ANSWER_WITHIN_S: Final = 2.0
"""For a status: a supervisor that is stopped or hangs must not delay it."""
LARGEST_ANSWER: Final = 64_000_000


class NoSupervisorError(Exception):
    """No supervisor answers, or its answer cannot be read; the reason, in a sentence."""


class _LocalConnection(http.client.HTTPConnection):
    """HTTP over a Unix socket."""

    def __init__(self, path: Path, timeout_s: float) -> None:
        super().__init__("localhost", timeout=timeout_s)
        self._path = path

    def connect(self) -> None:
        """Connect to a supervisor of this user or of root."""
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.settimeout(self.timeout)
            connection.connect(str(self._path))
            check_owner(self._path, connection)
        except BaseException:  # also Ctrl-C: the socket may not stay open
            connection.close()
            raise
        self.sock = connection


def ask_supervisor(state: Path, target: str, method: str = "GET", timeout_s: float = ANSWER_WITHIN_S) -> Any:
    """Return the answer of the supervisor with this state folder, as plain data.

    Raises:
        NoSupervisorError: no supervisor, no answer in time, or not the requested one.
    """
    try:
        path = socket_path(state, SUPERVISOR_SOCKET_NAME)
        with contextlib.closing(_LocalConnection(path, timeout_s)) as connection:
            connection.request(method, target)
            response = connection.getresponse()
            body = response.read(LARGEST_ANSWER)
            data = json.loads(body)
    except (SocketError, NoGatewayError) as error:
        raise NoSupervisorError(str(error)) from None
    except TimeoutError:
        raise NoSupervisorError(f"{path}: no answer within {timeout_s:g} s") from None
    except OSError as error:
        raise NoSupervisorError(f"{path}: {error.strerror or error}") from None
    except (http.client.HTTPException, ValueError) as error:
        raise NoSupervisorError(f"{path}: the answer was not understood: {error}") from None
    if response.status != http.client.OK:
        what = data.get("problem") if isinstance(data, dict) else None
        raise NoSupervisorError(f"{path}: {what or response.status}")
    return data
