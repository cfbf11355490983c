"""Asking a gateway that runs: one request, one reply, over its socket. Blocking, for commands."""

import socket
import time
from pathlib import Path
from typing import Final

from gateway.ipc.messages import (
    MAX_REPLY_BYTES,
    Refused,
    Reply,
    Request,
    WrongMessageError,
    decode_reply,
    encode,
)

TIMEOUT_S: Final = 5.0
CHUNK_BYTES: Final = 65536


class NoGatewayError(Exception):
    """Nobody answers at the socket, or not with what can be understood; with the path and the remedy."""


def ask(path: Path, request: Request, timeout_s: float = TIMEOUT_S) -> Reply:
    """Send a request to the gateway at ``path`` and return its reply.

    Raises:
        NoGatewayError: no gateway there, no permission, no answer in time, or one that is not understood.
    """
    deadline_s = time.monotonic() + timeout_s
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(timeout_s)
            connection.connect(str(path))
            connection.sendall(encode(request))
            line = _read_line(connection, deadline_s)
    except (FileNotFoundError, ConnectionRefusedError, NotADirectoryError):
        raise NoGatewayError(f"no gateway runs: nobody listens at {path}") from None
    except PermissionError:
        raise NoGatewayError(
            f"no permission for {path}: run this as the user that the gateway runs as, or as root"
        ) from None
    except TimeoutError:
        raise NoGatewayError(f"the gateway at {path} did not answer within {timeout_s:g} s") from None
    except OSError as error:
        raise NoGatewayError(f"{path}: {error.strerror or error}") from None
    return _understood(path, line)


def _read_line(connection: socket.socket, deadline_s: float) -> bytes:
    data = bytearray()
    while not data.endswith(b"\n"):
        left_s = deadline_s - time.monotonic()
        if left_s <= 0:
            raise TimeoutError
        connection.settimeout(left_s)
        chunk = connection.recv(CHUNK_BYTES)
        if not chunk or len(data) > MAX_REPLY_BYTES:
            break
        data += chunk
    return bytes(data)


def _understood(path: Path, line: bytes) -> Reply:
    if not line:
        raise NoGatewayError(f"the gateway at {path} closed the connection without an answer; see its log")
    try:
        reply = decode_reply(line)
    except WrongMessageError as error:
        raise NoGatewayError(f"{path} answered with {error}") from None
    if isinstance(reply, Refused):
        raise NoGatewayError(f"the gateway at {path} refused the request: {reply.reason}")
    return reply
