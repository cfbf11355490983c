"""A request to a running gateway: one request, one reply, over its socket. Blocking, for commands."""

import contextlib
import os
import socket
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from gateway.exchange.commands import Disable
from gateway.ipc.address import ROOT_UID, SocketError, peer_of, socket_path
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
MAX_DESCRIPTORS: Final = 253
"""Limit of the system for one message (SCM_MAX_FD)."""


class NoGatewayError(Exception):
    """No reply at the socket, or none that can be read; with the path and the remedy."""


class NobodyListensError(NoGatewayError):
    """No gateway runs at the socket. With any other :class:`NoGatewayError` something may run there."""


class NoRelayError(Exception):
    """The relay of a gateway did not answer; with the reason and the remedy."""


def ask(
    path: Path, request: Request, timeout_s: float = TIMEOUT_S, *, descriptors: Sequence[int] = ()
) -> Reply:
    """Send a request to the gateway at ``path``, with descriptors if it needs them; return the reply.

    Raises:
        NobodyListensError: no gateway there.
        NoGatewayError: that, or another user's gateway; no permission, no reply in time, or one that cannot
            be read.
    """
    line, lent = _answer(path, request, timeout_s, descriptors)
    _close(lent)
    return _understood(path, line)


def ask_relay(config: Path, state: Path, request: Request) -> Reply:
    """Return the reply of the relay that runs ``config`` with this state folder.

    Raises:
        NoRelayError: there is none.
    """
    try:
        return ask(socket_path(state), request)
    except SocketError as error:
        raise NoRelayError(f"gateway.state: {error}") from None
    except NobodyListensError as error:
        raise NoRelayError(f"{error}; start it with: pitch-gateway run {config}") from None
    except NoGatewayError as error:
        raise NoRelayError(str(error)) from None


def borrow(path: Path, request: Request, timeout_s: float = TIMEOUT_S) -> tuple[Reply, list[int]]:
    """Do as :func:`ask`; return the reply and its descriptors, which the caller owns.

    Raises:
        NoGatewayError: as :func:`ask`.
    """
    line, lent = _answer(path, request, timeout_s, ())
    try:
        return _understood(path, line), lent
    except NoGatewayError:
        _close(lent)
        raise


def _close(descriptors: Sequence[int]) -> None:
    for descriptor in descriptors:
        os.close(descriptor)


def _answer(
    path: Path, request: Request, timeout_s: float, descriptors: Sequence[int]
) -> tuple[bytes, list[int]]:
    """Send a request; return the reply line and its descriptors."""
    deadline_s = time.monotonic() + timeout_s
    lent: list[int] = []
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(timeout_s)
            connection.connect(str(path))
            check_owner(path, connection)
            # A gateway at its client limit says so and closes, before it has read anything.
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                data = encode(request)
                sent = socket.send_fds(connection, [data], descriptors)
                connection.sendall(data[sent:])
            return _read_line(connection, deadline_s, lent), lent
    except (FileNotFoundError, ConnectionRefusedError, NotADirectoryError):
        raise NobodyListensError(f"no gateway runs: nothing listens at {path}") from None
    except PermissionError:
        raise NoGatewayError(
            f"no permission for {path}: run this as the user that the gateway runs as, or as root"
        ) from None
    except TimeoutError:
        late = "; it switches off as soon as it goes on" if isinstance(request, Disable) else ""
        raise NoGatewayError(f"the gateway at {path} did not answer within {timeout_s:g} s{late}") from None
    except OSError as error:
        raise NoGatewayError(f"{path}: {error.strerror or error}") from None


def check_owner(path: Path, connection: socket.socket) -> None:
    """Check that a gateway belongs to this user or to root; root may use any gateway.

    Raises:
        NoGatewayError: it belongs to another user.
    """
    uid, own = peer_of(connection).uid, os.geteuid()
    if own != ROOT_UID and uid not in (own, ROOT_UID):
        raise NoGatewayError(
            f"{path} belongs to user {uid}, but this is user {own}, so nothing was sent: run this as the "
            "user that the gateway runs as, or name another folder with [gateway] state"
        )


def _read_line(connection: socket.socket, deadline_s: float, lent: list[int]) -> bytes:
    data = bytearray()
    while not data.endswith(b"\n"):
        left_s = deadline_s - time.monotonic()
        if left_s <= 0:
            raise TimeoutError
        connection.settimeout(left_s)
        try:
            chunk, came, _, _ = socket.recv_fds(
                connection, CHUNK_BYTES, MAX_DESCRIPTORS, socket.MSG_CMSG_CLOEXEC
            )
        except ConnectionResetError:
            break
        lent += came
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
