"""A TCP proxy before a drive that forwards every byte unchanged, and listens.

It forwards a byte before it evaluates it; it adds, delays and repeats nothing. Each connection of a
controller is one connection to the drive.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from gateway.commissioning.listen.overhearing import Overheard, Overhearing
from gateway.commissioning.listen.traffic import TrafficStatistics
from gateway.modbus.mbap import MbapDecoder
from gateway.transport.endpoints import TcpEndpoint
from gateway.transport.errors import AbsentError, RefusedError
from gateway.transport.listener import ProtocolListener, bound
from gateway.transport.tcp import why_not_reached

CHUNK_BYTES: Final = 4096
CONNECT_S: Final = 5.0
MOST_OPEN_REQUESTS: Final = 64
"""Of one connection; older requests are dropped."""


class MbapConversation:
    """Requests and replies of one Modbus/TCP connection, paired by transaction id."""

    def __init__(self) -> None:
        self._requests = MbapDecoder()
        self._replies = MbapDecoder()
        self._open: dict[int, tuple[int, bytes]] = {}

    def from_controller(self, data: bytes) -> list[Overheard]:
        """Take bytes from the controller."""
        heard = []
        for number, unit_id, pdu in self._requests.feed(data):
            self._open.pop(number, None)
            self._open[number] = (unit_id, pdu)
            if len(self._open) > MOST_OPEN_REQUESTS:
                del self._open[next(iter(self._open))]
            heard.append(Overheard(unit_id, pdu, is_reply=False))
        return heard

    def from_drive(self, data: bytes) -> list[Overheard]:
        """Take bytes from the drive. A reply counts for the unit id of its request."""
        heard = []
        for number, unit_id, pdu in self._replies.feed(data):
            asked, request = self._open.pop(number, (unit_id, b""))
            heard.append(Overheard(asked, pdu, is_reply=True, request=request))
        return heard


class RtuConversation:
    """The same for a device server that carries RTU frames."""

    def __init__(self) -> None:
        self._line = Overhearing()

    def from_controller(self, data: bytes) -> list[Overheard]:
        """Take bytes from the controller: reply bytes that are incomplete by now will stay so."""
        return self._line.feed(data)

    def from_drive(self, data: bytes) -> list[Overheard]:
        """Take bytes from the drive."""
        return self._line.feed(data)


class Proxy:
    """Listens on ``near``, connects to ``far`` for each connection, counts in ``statistics``."""

    def __init__(
        self,
        near: TcpEndpoint,
        far: TcpEndpoint,
        statistics: TrafficStatistics,
        report: Callable[[str], None],
    ) -> None:
        self._near = near
        self._far = far
        self._statistics = statistics
        self._report = report
        self._listener = ProtocolListener(self._protocol)
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def port(self) -> int:
        """Its port."""
        port: int = self._listener.sockets[0].getsockname()[1]
        return port

    async def open(self) -> None:
        """Listen. Raises AbsentError or RefusedError: the address is not on this computer, or in use."""
        try:
            self._listener.open(await bound(self._near.host, self._near.port))
        except OSError as error:
            kind = AbsentError if isinstance(error, FileNotFoundError) else RefusedError
            raise kind(f"cannot listen on {self._near}: {error.strerror or error}") from error

    async def close(self) -> None:
        """Stop listening, and close every connection."""
        await self._listener.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _protocol(self) -> asyncio.StreamReaderProtocol:
        return asyncio.StreamReaderProtocol(asyncio.StreamReader(), self._accepted)

    async def _accepted(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            await self._carry(reader, writer)
        except asyncio.CancelledError:
            pass  # asyncio's own streams would report it as an error
        finally:
            self._tasks.discard(task)
            writer.close()

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer = writer.get_extra_info("peername")
        try:
            async with asyncio.timeout(CONNECT_S):
                to_drive, from_us = await asyncio.open_connection(self._far.host, self._far.port)
        except OSError as error:
            why = why_not_reached(self._far, error)
            self._report(f"{why}; the connection of {peer[0]} is closed")
            return
        self._report(f"{peer[0]} is connected")
        conversation = RtuConversation() if self._far.rtu else MbapConversation()
        try:
            async with asyncio.TaskGroup() as ways:
                ways.create_task(self._pass(reader, from_us, conversation.from_controller))
                ways.create_task(self._pass(to_drive, writer, conversation.from_drive))
        finally:
            from_us.close()
            self._report(f"{peer[0]} has disconnected")

    async def _pass(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        heard: Callable[[bytes], list[Overheard]],
    ) -> None:
        """Forward one direction until its end, and then end the other side."""
        with suppress(OSError):
            while data := await reader.read(CHUNK_BYTES):
                writer.write(data)
                self._statistics.add(heard(data))
                await writer.drain()
        with suppress(OSError, RuntimeError):
            writer.write_eof()
