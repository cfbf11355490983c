"""The gateway's end of its socket. Nothing here waits: a client that hangs costs a buffer, and is dropped."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Final, cast

from gateway.ipc.messages import (
    MAX_REQUEST_BYTES,
    Refused,
    Reply,
    Request,
    WrongMessageError,
    decode_request,
    encode,
)
from gateway.ipc.place import SocketPlace

MAX_CLIENTS: Final = 8
"""At once. Whoever comes when they are all there is closed at once."""
IDLE_S: Final = 30.0
"""A client that sends nothing whole for so long, or does not take its replies, is dropped."""
READ_BYTES: Final = 1024
UNTAKEN_BYTES: Final = 65536
"""Replies that wait for a client; beyond that nothing more is read from it."""


class ControlServer:
    """Listens in a state folder and answers each request with what ``answer`` returns, in the same call."""

    def __init__(self, state: Path, answer: Callable[[Request], Reply], idle_s: float = IDLE_S) -> None:
        self._place = SocketPlace(state)
        self._answer = answer
        self._idle_s = idle_s
        self._server: asyncio.Server | None = None
        self._clients: set[_Client] = set()

    @property
    def path(self) -> Path:
        """Where it listens."""
        return self._place.path

    @property
    def clients(self) -> int:
        """How many are connected."""
        return len(self._clients)

    async def open(self) -> None:
        """Listen.

        Raises:
            SocketError: another gateway has the place, or it cannot be made; with the remedy.
        """
        loop = asyncio.get_running_loop()
        self._server = await loop.create_unix_server(self._client, sock=self._place.take())

    async def close(self) -> None:
        """Drop every client and remove the socket."""
        if self._server is None:
            return
        self._server.close()
        lost = [client.lost for client in self._clients]
        for client in tuple(self._clients):
            client.drop()
        if lost:
            await asyncio.wait(lost)
        await self._server.wait_closed()
        self._server = None
        self._place.leave()

    def _client(self) -> "_Client":
        return _Client(self._clients, self._answer, self._idle_s)


class _Client(asyncio.BufferedProtocol):
    """One connection."""

    def __init__(self, clients: set["_Client"], answer: Callable[[Request], Reply], idle_s: float) -> None:
        self._clients = clients
        self._answer = answer
        self._idle_s = idle_s
        self._buffer = memoryview(bytearray(READ_BYTES))
        self._data = b""
        self._transport: asyncio.Transport | None = None
        loop = asyncio.get_running_loop()
        self.lost: asyncio.Future[None] = loop.create_future()
        self._idle = loop.call_later(idle_s, self.drop)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)  # uvloop's are no subclass
        self._transport.set_write_buffer_limits(high=UNTAKEN_BYTES)
        self._clients.add(self)
        if len(self._clients) > MAX_CLIENTS:
            self.drop()

    def connection_lost(self, exc: Exception | None) -> None:
        self._idle.cancel()
        self._transport = None
        self._clients.discard(self)
        if not self.lost.done():
            self.lost.set_result(None)

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self._data += bytes(self._buffer[:nbytes])
        self._next()

    def pause_writing(self) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.pause_reading()

    def resume_writing(self) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()

    def drop(self) -> None:
        """Close at once."""
        if self._transport is not None:
            self._transport.abort()

    def _next(self) -> None:
        """Answer one request; more that came with it wait for a turn of the loop each, as frames do."""
        if self._transport is None or self._transport.is_closing():
            return
        line, end, rest = self._data.partition(b"\n")
        if len(line) > MAX_REQUEST_BYTES:
            self._refuse(f"a request of more than {MAX_REQUEST_BYTES} bytes")
        elif end:
            self._data = rest
            self._take(line)
            if rest:
                asyncio.get_running_loop().call_soon(self._next)

    def _take(self, line: bytes) -> None:
        try:
            request = decode_request(line)
        except WrongMessageError as error:
            self._refuse(str(error))
            return
        self._idle.cancel()
        self._idle = asyncio.get_running_loop().call_later(self._idle_s, self.drop)
        self._send(self._answer(request))

    def _refuse(self, reason: str) -> None:
        self._data = b""
        self._send(Refused(reason=reason))
        if self._transport is not None:
            self._transport.close()

    def _send(self, reply: Reply) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(encode(reply))
