"""The gateway's end of its socket. Nothing here waits: a client that hangs costs a buffer, and is dropped."""

import asyncio
import contextlib
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gateway.ipc.desk import Desk
from gateway.ipc.messages import Happened, Refused, Reply, Request, encode
from gateway.ipc.place import SocketPlace, peer_uid
from gateway.ipc.session import MAX_CLIENTS, Clients, Session
from gateway.transport.listener import Listener

NO_PLACE: Final = (
    f"all {MAX_CLIENTS} places are taken, by listeners and by requests under way; try again in a moment, or "
    "end one of the programs that are connected"
)
IDLE_S: Final = 30.0
"""A client that sends nothing whole for so long, or does not take its replies, is dropped."""


class ControlServer:
    """Listens in a state folder and answers each request in the call in which it is read."""

    def __init__(self, state: Path, desk: Desk | Callable[[Request], Reply], idle_s: float = IDLE_S) -> None:
        self._place = SocketPlace(state)
        self._clients = Clients(desk if isinstance(desk, Desk) else Desk(desk), idle_s)
        self._listener = Listener(self._accepted, self._nobody_can_connect)
        self._is_pump_due = False

    @property
    def path(self) -> Path:
        """Where it listens."""
        return self._place.path

    @property
    def is_after_a_cut(self) -> bool:
        """Whether the gateway before this one did not finish; known once this one is open."""
        return self._place.is_after_a_cut

    @property
    def clients(self) -> int:
        """How many are connected."""
        return len(self._clients.sessions)

    @property
    def has_listeners(self) -> bool:
        """Whether anybody is told what happens."""
        return bool(self._clients.listeners)

    async def open(self) -> None:
        """Listen.

        Raises:
            SocketError: another gateway has the place, or it cannot be made; with the remedy.
        """
        self._listener.open([self._place.take()])

    def hang_up(self) -> None:
        """Drop every client and take no other; the place stays taken until :meth:`close`."""
        self._listener.stop()
        for session in tuple(self._clients.sessions):
            session.drop()

    async def close(self, *, is_finished: bool = True) -> None:
        """Drop every client and leave; see ``SocketPlace.leave``."""
        self.hang_up()
        self._place.leave(is_finished=is_finished)

    def tell(self, happened: Happened) -> None:
        """Tell all listeners that something happened; costs an append for each, and is sent a turn later."""
        for listener in self._clients.listeners:
            listener.tell(happened)
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
                connection.send(encode(Refused(reason=NO_PLACE)))
            connection.close()
            self._clients.complain("clients", f"a client was refused: {NO_PLACE}")
            return
        self._clients.sessions.add(Session(self._clients, connection, peer_uid(connection)))

    def _nobody_can_connect(self, error: OSError) -> None:
        self._clients.complain("accept", f"no client can connect: {error.strerror or error}")
