"""The clients of the socket: requests in, with their descriptors; replies and events out."""

import array
import asyncio
import contextlib
import itertools
import os
import select
import socket
from collections.abc import Mapping, Sequence
from typing import Final

from gateway.clock import monotonic_ns
from gateway.exchange.commands import MAX_TABLES, Command, Disable, SetTable
from gateway.ipc.address import Peer
from gateway.ipc.handlers import ASKED_AGAIN_S, LONGEST_WAIT_S, RequestHandlers
from gateway.ipc.listener import Subscriber
from gateway.ipc.messages import (
    MAX_REQUEST_BYTES,
    GetStatus,
    GetTapes,
    Ping,
    Refused,
    Reply,
    Request,
    Subscribe,
    Subscribed,
    Tapes,
    WrongMessageError,
    decode_request,
    encode,
)
from gateway.ipc.outbox import Outbox
from gateway.limits import Reports
from gateway.transport.connections import longest

MAX_CLIENTS: Final = 8
"""Number at the same time. At the limit, the idle client that has been silent longest is closed for the next
one. If none is idle, the next one is refused, with the reason."""
MAX_LISTENERS: Final = MAX_CLIENTS // 2
"""Subscribers among the clients: subscribers that hang must leave room for commands."""
READ_BYTES: Final = 4096
UNTAKEN_BYTES: Final = 65536
"""Replies that wait for a client; beyond that its requests are not read."""
GAVE_WAY: Final = "all connections were in use, and this client was silent longest: connect again"
_DESCRIPTOR_BYTES: Final = array.array("i").itemsize
_ANCILLARY_BYTES: Final = socket.CMSG_SPACE((MAX_TABLES + 1) * _DESCRIPTOR_BYTES)
"""Room for one too many; the system closes any further ones itself."""


class Clients:
    """All clients and what they share: the request handlers and the limits."""

    def __init__(self, handlers: RequestHandlers, idle_s: float) -> None:
        self.handlers = handlers
        self.idle_s = idle_s
        self._complaints: Reports[str] = Reports()
        self.sessions: set[Session] = set()
        self.activity_numbers = itertools.count()
        """Shows which client was last active."""

    def complain(self, kind: str, detail: str) -> None:
        """Log the first refusal of a kind, then one a minute with the number since."""
        if sentence := self._complaints.sentence(kind, detail, monotonic_ns()):
            self.handlers.complain(sentence)

    @property
    def listeners(self) -> list[Subscriber]:
        """The subscribers."""
        return [session.listener for session in self.sessions if session.listener is not None]

    @property
    def has_room_for_listener(self) -> bool:
        """Whether one more client may subscribe."""
        return len(self.listeners) < MAX_LISTENERS

    def make_room(self) -> bool:
        """Whether one more client may connect; at the limit, close the idle client that is silent longest."""
        if len(self.sessions) < MAX_CLIENTS:
            return True
        silent = longest(self.sessions, lambda one: None if one.is_busy else one.last_activity)
        if silent is None:
            return False
        silent.give_way()
        return True


class Session:
    """Serves one client from its first byte to its last."""

    def __init__(self, clients: Clients, connection: socket.socket, peer: Peer) -> None:
        self.listener: Subscriber | None = None
        self._clients = clients
        self._connection = connection
        self._peer = peer
        self._data = b""
        self._descriptors: list[int] = []
        self._outbox = Outbox(connection, self._emptied, self.drop)
        self._is_open = True
        self._is_ending = False
        self.last_activity = next(clients.activity_numbers)
        """When it was last active, by the counter of all clients."""
        self._loop = asyncio.get_running_loop()
        self._is_reading = False
        self._handing_over: asyncio.Task[None] | None = None
        """While its tables are taken, or its status must wait, no other request of this client is read."""
        self._idle = self._loop.call_later(clients.idle_s, self.drop)
        self._read_on()

    @property
    def is_busy(self) -> bool:
        """Whether it is a subscriber, or one of its requests is in progress, even incomplete."""
        if self._is_ending:
            return False
        is_asking = self._data or self._descriptors or self._outbox.waiting_bytes
        is_served = self.listener is not None or self._is_handing_over()
        return is_served or bool(is_asking) or self._has_unread()

    def give_way(self) -> None:
        """Send the reason, and close in favour of another client."""
        self._complain("place", "it was silent longest, and its place was needed for another client")
        if not self._is_ending:
            self._send(Refused(reason=GAVE_WAY))
        self.drop()

    def drop(self) -> None:
        """Close immediately."""
        if not self._is_open:
            return
        self._is_open = False
        self._idle.cancel()
        self._outbox.close()
        if self.listener is not None:
            self.listener.close()
        self._read_no_more()
        self._close_descriptors()
        self._connection.close()
        self._clients.sessions.discard(self)

    # --- reading ---------------------------------------------------------------------------------------

    def _read_on(self) -> None:
        if not self._is_reading and self._is_open and not self._is_ending:
            self._is_reading = True
            self._loop.add_reader(self._connection.fileno(), self._readable)

    def _read_no_more(self) -> None:
        if self._is_reading:
            self._is_reading = False
            self._loop.remove_reader(self._connection.fileno())

    def _has_unread(self) -> bool:
        try:
            return bool(self._connection.recv(1, socket.MSG_PEEK))
        except OSError:
            return False

    def _readable(self) -> None:
        try:
            data, ancillary, flags, _ = self._connection.recvmsg(
                READ_BYTES, _ANCILLARY_BYTES, socket.MSG_CMSG_CLOEXEC
            )
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self._end_of_data()
            return
        for level, kind, content in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
                whole = len(content) - len(content) % _DESCRIPTOR_BYTES
                self._descriptors += array.array("i", content[:whole])
        if not data:
            self._end_of_data()
        elif flags & socket.MSG_CTRUNC or len(self._descriptors) > MAX_TABLES:
            self._refuse("descriptor", f"more than {MAX_TABLES} descriptors")
        else:
            self.last_activity = next(self._clients.activity_numbers)
            self._data += data
            self._next()

    def _end_of_data(self) -> None:
        if self._data or self._descriptors:
            self._complain("half", "disconnected in the middle of a message")
        self.drop()

    def _next(self) -> None:
        """Answer one request; each further one waits for a cycle of the loop, as frames do."""
        if not self._is_open or self._is_ending or self._is_handing_over():
            return
        line, end, rest = self._data.partition(b"\n")
        if len(line) > MAX_REQUEST_BYTES:
            self._refuse("long", f"a request of more than {MAX_REQUEST_BYTES} bytes")
        elif not end:
            self._read_on()
        elif self._outbox.waiting_bytes > UNTAKEN_BYTES:
            self._read_no_more()  # until it has taken its replies
        else:
            self._data = rest
            self._take(line)
            if self._is_handing_over():
                self._read_no_more()
            elif rest:
                self._read_no_more()  # a client must not fill the memory with unanswered requests
                self._loop.call_soon(self._next)
            else:
                self._read_on()

    def _is_handing_over(self) -> bool:
        return self._handing_over is not None

    def _emptied(self) -> None:
        if self._is_ending:
            self.drop()
            return
        if self.listener is not None:
            self.listener.pump()
        self._next()

    # --- answering -------------------------------------------------------------------------------------

    def _take(self, line: bytes) -> None:
        try:
            request = decode_request(line)
        except WrongMessageError as error:
            self._refuse("message", str(error))
            return
        if (
            not isinstance(request, Ping | GetStatus | Subscribe)
            and self._peer.uid not in self._clients.handlers.masters
        ):
            self._refuse("user", f"user {self._peer.uid} may read, but not change anything")
            return
        expected = len(request.tables) if isinstance(request, SetTable) else 0
        if len(self._descriptors) != expected:
            self._refuse(
                "descriptor", f"{len(self._descriptors)} descriptors where {expected} belong to the message"
            )
            return
        # What a person gave up must not happen later. Switching off is what stays right even then.
        if isinstance(request, Command) and not isinstance(request, Disable) and self._has_hung_up():
            self._complain("gone", "disconnected before its command was read: it is not carried out")
            self.drop()
            return
        if self.listener is None:
            self._wait_for_it()
        self._answer(request)

    def _has_hung_up(self) -> bool:
        """Whether the client has closed its end, because it got no answer in time.

        A client that only sends no more, and waits for its answers, has not closed it.
        """
        poll = select.poll()
        poll.register(self._connection, 0)  # POLLHUP is always reported
        return any(events & select.POLLHUP for _, events in poll.poll(0))

    def _answer(self, request: Request) -> None:
        handlers = self._clients.handlers
        if isinstance(request, Subscribe):
            self._subscribe(request)
        elif isinstance(request, SetTable):
            self._idle.cancel()
            descriptors, self._descriptors = self._descriptors, []
            self._handing_over = self._loop.create_task(self._hand_over(request, descriptors))
        elif isinstance(request, GetStatus) and handlers.has_to_wait():
            self._handing_over = self._loop.create_task(self._answer_later(request))
        elif isinstance(request, GetTapes):
            self._lend(handlers.tapes())
        else:
            self._send(handlers.answer(request, self._peer))

    def _lend(self, tapes: Mapping[str, int]) -> None:
        """Give it trace buffers to read: their descriptors go with the first byte of the reply."""
        if self._outbox.waiting_bytes:
            self._refuse("tapes", "read the previous reply first")
            return
        data = encode(Tapes(lines=tuple(tapes)))
        try:
            sent = socket.send_fds(self._connection, [data[:1]], list(tapes.values()))
        except OSError:
            self.drop()
            return
        self._outbox.write(data[sent:])

    async def _answer_later(self, request: Request) -> None:
        """Answer as soon as that disturbs no frame, or after the longest delay."""
        latest_s = self._loop.time() + LONGEST_WAIT_S
        while self._clients.handlers.has_to_wait() and self._loop.time() < latest_s:  # noqa: ASYNC110 - no event
            await asyncio.sleep(ASKED_AGAIN_S)
        self._handing_over = None
        if self._is_open:
            self._send(self._clients.handlers.answer(request, self._peer))
            self._next()

    async def _hand_over(self, request: SetTable, descriptors: list[int]) -> None:
        reply: Reply | None = None
        try:
            reply = await self._clients.handlers.hand_over(request, tuple(descriptors), self._peer)
        finally:
            _close(descriptors)
            self._handing_over = None
            if reply is None:  # a bug, or no free thread: the client must not wait for nothing
                self.drop()
        if not self._is_open:
            return
        if self.listener is None:
            self._wait_for_it()
        self._send(reply)
        self._next()

    def _subscribe(self, request: Subscribe) -> None:
        if self.listener is not None:
            self._send(Subscribed(interval_s=request.interval_s))
            self.listener.follow(request.interval_s)
        elif not self._clients.has_room_for_listener:
            self._refuse("subscribe", "the largest number of listeners is already subscribed")
        else:
            self._idle.cancel()  # it may be silent from now on
            self._send(Subscribed(interval_s=request.interval_s))
            self.listener = Subscriber(self._outbox, request.interval_s, self._clients.handlers)

    def _refuse(self, kind: str, reason: str) -> None:
        """Send the reason, close the received descriptors, and end."""
        self._complain(kind, reason)
        self._data = b""
        self._close_descriptors()
        self._read_no_more()
        self._is_ending = True
        self._wait_for_it()
        if self.listener is not None:
            self.listener.close()
        self._send(Refused(reason=reason))
        if not self._outbox.waiting_bytes:
            self.drop()

    def _wait_for_it(self) -> None:
        """Restart its time to send a whole request, or to take its last reply."""
        self._idle.cancel()
        self._idle = self._loop.call_later(self._clients.idle_s, self.drop)

    def _send(self, reply: Reply) -> None:
        if self._is_open:
            self._outbox.write(encode(reply))

    def _complain(self, kind: str, reason: str) -> None:
        self._clients.complain(kind, f"a client (user {self._peer.uid}): {reason}")

    def _close_descriptors(self) -> None:
        _close(self._descriptors)
        self._descriptors.clear()


def _close(descriptors: Sequence[int]) -> None:
    for descriptor in descriptors:
        with contextlib.suppress(OSError):
            os.close(descriptor)
