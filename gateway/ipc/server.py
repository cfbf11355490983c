"""The gateway's end of its socket. Nothing here waits: a client that hangs costs a buffer, and is dropped."""

import asyncio
import contextlib
import itertools
import os
import socket
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from gateway.ipc.complaints import Complaints
from gateway.ipc.messages import Done, Happened, Refused, Reply, Request, SetTable, encode
from gateway.ipc.place import ROOT_UID, SocketPlace, peer_uid
from gateway.ipc.session import Session

MAX_CLIENTS: Final = 8
"""At once. When they are all there, the one that has been silent longest makes room for the next; where
none is idle the next is refused, with the reason."""
MAX_LISTENERS: Final = MAX_CLIENTS // 2
"""Of them; so that listeners which hang leave room for commands."""
NO_PLACE: Final = (
    f"all {MAX_CLIENTS} places are taken, by listeners and by requests under way; try again in a moment, or "
    "end one of the programs that are connected"
)
IDLE_S: Final = 30.0
"""A client that sends nothing whole for so long, or does not take its replies, is dropped."""
ACCEPT_AGAIN_S: Final = 1.0


async def _no_tables(_request: SetTable, _descriptors: Sequence[int]) -> Reply:
    return Done(problems=("tables are not taken here",))


def _no_status() -> Mapping[str, Any]:
    return {}


def _no_note(_detail: str) -> None:
    pass


@dataclass(frozen=True, slots=True)
class Desk:
    """What a server does for its clients; every function returns at once, but ``hand_over`` may wait.

    It gets the descriptors of a message with it, and may not keep them; they are closed after it.
    """

    answer: Callable[[Request], Reply]
    hand_over: Callable[[SetTable, Sequence[int]], Awaitable[Reply]] = _no_tables
    status: Callable[[], Mapping[str, Any]] = _no_status
    complain: Callable[[str], None] = _no_note
    """Gets a sentence about what was refused; not more than one a minute of each kind."""
    masters: frozenset[int] = field(default_factory=lambda: frozenset((os.geteuid(), ROOT_UID)))
    """User ids that may change something; others may look."""


class ControlServer:
    """Listens in a state folder and answers each request in the call in which it is read."""

    def __init__(self, state: Path, desk: Desk | Callable[[Request], Reply], idle_s: float = IDLE_S) -> None:
        self._place = SocketPlace(state)
        self.desk = desk if isinstance(desk, Desk) else Desk(desk)
        self.idle_s = idle_s
        self.complaints = Complaints(self.desk.complain)
        self._listening: socket.socket | None = None
        self._sessions: set[Session] = set()
        self.turns = itertools.count()
        """Tells which client was heard last."""
        self._is_pump_due = False
        self._later: asyncio.TimerHandle | None = None

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
        return len(self._sessions)

    @property
    def has_listeners(self) -> bool:
        """Whether anybody is told what happens."""
        return any(session.listener is not None for session in self._sessions)

    @property
    def has_room_for_listener(self) -> bool:
        """Whether one more may subscribe."""
        return sum(session.listener is not None for session in self._sessions) < MAX_LISTENERS

    async def open(self) -> None:
        """Listen.

        Raises:
            SocketError: another gateway has the place, or it cannot be made; with the remedy.
        """
        self._listening = self._place.take()
        self._listen()

    def hang_up(self) -> None:
        """Drop every client and take no other; the place stays taken until :meth:`close`."""
        if self._listening is None:
            return
        self._listen(is_on=False)
        if self._later is not None:
            self._later.cancel()
        for session in tuple(self._sessions):
            session.drop()
        self._listening.close()
        self._listening = None

    async def close(self, *, is_finished: bool = True) -> None:
        """Drop every client and leave; see ``SocketPlace.leave``."""
        self.hang_up()
        self._place.leave(is_finished=is_finished)

    def tell(self, happened: Happened) -> None:
        """Tell all listeners that something happened; costs an append for each, and is sent a turn later."""
        for session in self._sessions:
            if session.listener is not None:
                session.listener.tell(happened)
                if not self._is_pump_due:
                    self._is_pump_due = True
                    asyncio.get_running_loop().call_soon(self._pump)

    def forget(self, session: Session) -> None:
        """Note that a connection is closed."""
        self._sessions.discard(session)

    def _pump(self) -> None:
        self._is_pump_due = False
        for session in tuple(self._sessions):
            if session.listener is not None:
                session.listener.pump()

    def _accept(self) -> None:
        assert self._listening is not None
        try:
            connection, _ = self._listening.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return
        except OSError as error:
            # No descriptors left, say: whoever waits stays there, and would have us try again without end.
            self.complaints.add("accept", f"nobody can connect: {error.strerror or error}")
            self._listen(is_on=False)
            self._later = asyncio.get_running_loop().call_later(ACCEPT_AGAIN_S, self._listen)
            return
        connection.setblocking(False)
        if len(self._sessions) >= MAX_CLIENTS and not self._make_room():
            with contextlib.suppress(OSError):
                connection.send(encode(Refused(reason=NO_PLACE)))
            connection.close()
            self.complaints.add("clients", f"a client was refused: {NO_PLACE}")
            return
        self._sessions.add(Session(self, connection, peer_uid(connection)))

    def _make_room(self) -> bool:
        """Have the idle client that was heard longest ago give up its place; whether there is one."""
        idle = [session for session in self._sessions if not session.is_busy]
        if not idle:
            return False
        min(idle, key=lambda session: session.last_turn).give_way()
        return True

    def _listen(self, *, is_on: bool = True) -> None:
        if self._listening is not None:
            loop, descriptor = asyncio.get_running_loop(), self._listening.fileno()
            loop.remove_reader(descriptor)
            if is_on:
                loop.add_reader(descriptor, self._accept)
