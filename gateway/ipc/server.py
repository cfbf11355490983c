"""The gateway's end of its socket. It never waits: a client that hangs costs a buffer, and is dropped."""

import asyncio
import contextlib
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gateway.ipc.address import Peer, SocketError, SocketFile, peer_of
from gateway.ipc.handlers import RequestHandlers
from gateway.ipc.messages import Happened, Refused, Reply, Request, encode
from gateway.ipc.session import MAX_CLIENTS, Clients, Session
from gateway.transport.listener import Listener

ALL_TAKEN: Final = (
    f"all {MAX_CLIENTS} connections are in use; try again in a moment, or end one of the connected programs"
)
IDLE_S: Final = 30.0
"""A client that sends no whole request for this time, or does not take its replies, is dropped."""


class ControlServer:
    """Listens in a state folder and answers each request in the call that reads it."""

    def __init__(
        self,
        state: Path,
        handlers: RequestHandlers | Callable[[Request, Peer], Reply],
        idle_s: float = IDLE_S,
    ) -> None:
        self._socket_file = SocketFile(state)
        self._clients = Clients(
            handlers if isinstance(handlers, RequestHandlers) else RequestHandlers(handlers), idle_s
        )
        self._listener = Listener(self._accepted, self._nobody_can_connect)
        self._is_pump_due = False
        self._is_missing = False
        """It is missing and could not be made again, which was reported."""

    @property
    def path(self) -> Path:
        """The path of the socket."""
        return self._socket_file.path

    @property
    def is_after_crash(self) -> bool:
        """Whether the gateway before this one did not finish; known once this one is open."""
        return self._socket_file.is_after_crash

    @property
    def clients(self) -> int:
        """How many clients are connected."""
        return len(self._clients.sessions)

    @property
    def has_listeners(self) -> bool:
        """Whether there are subscribers."""
        return bool(self._clients.listeners)

    async def open(self) -> None:
        """Listen.

        Raises:
            SocketError: another gateway uses the socket, or it cannot be made; with the remedy.
        """
        self._listener.open([self._socket_file.take()])

    def renew_socket(self) -> str:
        """Make the socket again if another program has removed it; return what was done, "" if nothing.

        Connected clients stay. To be called every few seconds.
        """
        if not self._socket_file.is_missing:
            self._is_missing = False
            return ""
        try:
            listening = self._socket_file.make_again()
        except SocketError as error:
            told, self._is_missing = self._is_missing, True
            return "" if told else f"{self.path} is missing, and cannot be made again: {error}"
        self._listener.stop()
        self._listener.open([listening])
        return f"{self.path} was missing; it was made again"

    def hang_up(self) -> None:
        """Drop every client and accept no other; the socket stays reserved until :meth:`close`."""
        self._listener.stop()
        for session in tuple(self._clients.sessions):
            session.drop()

    async def close(self, *, is_finished: bool = True) -> None:
        """Drop every client and leave; see ``SocketFile.leave``."""
        self.hang_up()
        self._socket_file.leave(is_finished=is_finished)

    def publish_event(self, happened: Happened) -> None:
        """Send an event to all subscribers: one append each now; it is sent in the next cycle of the loop."""
        for listener in self._clients.listeners:
            listener.publish_event(happened)
            if not self._is_pump_due:
                self._is_pump_due = True
                asyncio.get_running_loop().call_soon(self._pump)

    def _pump(self) -> None:
        self._is_pump_due = False
        for listener in self._clients.listeners:
            listener.pump()

    def _accepted(self, connection: socket.socket, _address: object) -> None:
        if not self._clients.make_room():
            with contextlib.suppress(OSError):
                connection.send(encode(Refused(reason=ALL_TAKEN)))
            connection.close()
            self._clients.complain("clients", f"a client was refused: {ALL_TAKEN}")
            return
        self._clients.sessions.add(Session(self._clients, connection, peer_of(connection)))

    def _nobody_can_connect(self, error: OSError) -> None:
        self._clients.complain("accept", f"no client can connect: {error.strerror or error}")
