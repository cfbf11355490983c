"""Who gets a place at the gateway's socket when all are taken, and what the others are told."""

import asyncio
import contextlib
import json
import os
import re
import socket
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

import pytest

from gateway.exchange.commands import VERSION, SetTable, TableFor
from gateway.ipc.address import Peer
from gateway.ipc.client import NoGatewayError, ask
from gateway.ipc.handlers import RequestHandlers
from gateway.ipc.messages import (
    Done,
    Happened,
    Ping,
    Pong,
    Refused,
    Reply,
    Request,
    Snapshot,
    Subscribe,
    Subscribed,
    decode_reply,
    encode,
)
from gateway.ipc.sealed_memory import seal
from gateway.ipc.server import ALL_TAKEN, ControlServer
from gateway.ipc.session import GAVE_WAY, MAX_CLIENTS, MAX_LISTENERS

PATIENCE_S = 30.0
USER = f"a client (user {os.geteuid()})"


class Client:
    """One connection, and what it is told."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer

    async def told(self) -> Reply | None:
        """Return the next message; None at the end."""
        async with asyncio.timeout(PATIENCE_S):
            line = await self._reader.readline()
        return decode_reply(line) if line else None

    async def asks(self, request: Request) -> Reply | None:
        self._writer.write(encode(request))
        return await self.told()

    def begins(self) -> None:
        """Send half a request."""
        self._writer.write(encode(Ping())[:10])

    def close(self) -> None:
        self._writer.close()


class Site:
    """A server with clients."""

    def __init__(self, server: ControlServer, complaints: list[str]) -> None:
        self.server = server
        self.complaints = complaints
        self.clients: list[Client] = []

    async def client(self) -> Client:
        """Connect, and wait until the server has seen it."""
        before = self.server.clients
        client = Client(*await asyncio.open_unix_connection(str(self.server.path)))
        self.clients.append(client)
        async with asyncio.timeout(PATIENCE_S):
            while self.server.clients == before:  # noqa: ASYNC110 - nobody is told
                await asyncio.sleep(0)
        return client

    async def listener(self) -> Client:
        client = await self.client()
        assert await client.asks(Subscribe(interval_s=60.0)) == Subscribed(interval_s=60.0)
        assert isinstance(await client.told(), Snapshot)
        return client

    async def half(self) -> Client:
        """Connect, and have half a request under way."""
        client = await self.client()
        busy = sum(session.is_busy for session in self.server._clients.sessions)
        client.begins()
        async with asyncio.timeout(PATIENCE_S):
            while sum(each.is_busy for each in self.server._clients.sessions) == busy:  # noqa: ASYNC110 - as above
                await asyncio.sleep(0)
        return client


def descriptors() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def pong(_request: Request, _peer: Peer) -> Pong:
    return Pong(name="", gateway_version="", pid=1)


@contextlib.asynccontextmanager
async def site_in(state: Path) -> AsyncIterator[Site]:
    complaints: list[str] = []
    desk = RequestHandlers(
        lambda _request, _peer: Pong(name="", gateway_version="", pid=1), complain=complaints.append
    )
    server = ControlServer(state, desk)
    await server.open()
    site = Site(server, complaints)
    try:
        yield site
    finally:
        for client in site.clients:
            client.close()
        await server.close()


async def test_the_client_that_was_silent_longest_gives_its_place_to_the_next(tmp_path: Path) -> None:
    async with site_in(tmp_path) as site:
        clients = [await site.client() for _ in range(MAX_CLIENTS)]
        assert isinstance(await clients[0].asks(Ping()), Pong)  # so the second was silent longest
        assert isinstance(await asyncio.to_thread(ask, site.server.path, Ping()), Pong)
        assert await clients[1].told() == Refused(reason=GAVE_WAY)
        assert await clients[1].told() is None
        for client in (clients[0], *clients[2:]):
            assert isinstance(await client.asks(Ping()), Pong)
    assert site.complaints == [f"{USER}: it was silent longest, and its place was needed for another client"]


async def test_a_request_that_nobody_has_read_yet_is_under_way(tmp_path: Path) -> None:
    async with site_in(tmp_path) as site:
        clients = [await site.client() for _ in range(MAX_CLIENTS)]
        # In one turn of the loop: the first has asked, and the server hears of the ninth first.
        with socket.socket(socket.AF_UNIX) as ninth:
            ninth.connect(str(site.server.path))
            clients[0]._writer.write(encode(Ping()))
            listener = site.server._listener
            listener._accept(listener.sockets[0])
            assert isinstance(await clients[0].told(), Pong)
            assert await clients[1].told() == Refused(reason=GAVE_WAY)


async def test_a_client_whose_table_is_looked_at_keeps_its_place(tmp_path: Path) -> None:
    is_looked_at = asyncio.Event()

    async def hand_over(_request: SetTable, _descriptors: Sequence[int], _peer: Peer) -> Reply:
        await is_looked_at.wait()
        return Done(changed=("x",))

    server = ControlServer(tmp_path, RequestHandlers(pong, hand_over))
    await server.open()
    request = SetTable(tables=(TableFor("x", "x.tab", "", ""),))
    mine = seal(b"points", "x")
    giving = asyncio.create_task(asyncio.to_thread(ask, server.path, request, descriptors=[mine]))
    async with asyncio.timeout(PATIENCE_S):
        while not any(session.is_busy for session in server._clients.sessions):  # noqa: ASYNC110 - nobody is told
            await asyncio.sleep(0)
    others = [await asyncio.open_unix_connection(str(server.path)) for _ in range(MAX_CLIENTS)]
    assert await others[0][0].readline() == encode(Refused(reason=GAVE_WAY))
    is_looked_at.set()
    assert await giving == Done(changed=("x",))
    os.close(mine)
    for _, writer in others:
        writer.close()
    await server.close()


async def test_without_an_idle_client_the_next_is_refused_with_the_reason(tmp_path: Path) -> None:
    async with site_in(tmp_path) as site:
        listeners = [await site.listener() for _ in range(MAX_LISTENERS)]
        halves = [await site.half() for _ in range(MAX_CLIENTS - MAX_LISTENERS)]
        said = f"the gateway at {site.server.path} refused the request: {ALL_TAKEN}"
        with pytest.raises(NoGatewayError, match=re.escape(said)):
            await asyncio.to_thread(ask, site.server.path, Ping())
        line = await asyncio.to_thread(_first_line, site.server.path)
        assert json.loads(line) == {"kind": "refused", "reason": ALL_TAKEN, "version": VERSION}
        # Nobody lost anything by it.
        site.server.publish_event(Happened(event="e", severity="info", fields={}, wall_s=1.0))
        for listener in listeners:
            assert isinstance(await listener.told(), Happened)
        for half in halves:
            half._writer.write(encode(Ping())[10:])
            assert isinstance(await half.told(), Pong)
        assert isinstance(await asyncio.to_thread(ask, site.server.path, Ping()), Pong)
    assert site.complaints[0] == f"a client was refused: {ALL_TAKEN}"


def _first_line(path: Path) -> bytes:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(PATIENCE_S)
        connection.connect(str(path))
        with connection.makefile("rb") as file:
            return file.readline()


async def test_listeners_have_half_of_the_places_and_keep_them(tmp_path: Path) -> None:
    assert MAX_LISTENERS * 2 == MAX_CLIENTS
    async with site_in(tmp_path) as site:
        listeners = [await site.listener() for _ in range(MAX_LISTENERS)]
        one_more = await site.client()
        reason = "the largest number of listeners is already subscribed"
        assert await one_more.asks(Subscribe(interval_s=60.0)) == Refused(reason=reason)
        assert await one_more.told() is None
        for _ in range(MAX_CLIENTS - MAX_LISTENERS):
            await site.client()
        for _ in range(3 * MAX_CLIENTS):
            assert isinstance(await asyncio.to_thread(ask, site.server.path, Ping()), Pong)
        site.server.publish_event(Happened(event="e", severity="info", fields={}, wall_s=1.0))
        for listener in listeners:
            assert isinstance(await listener.told(), Happened)


async def test_a_client_whose_tables_meet_a_bug_of_ours_is_dropped(tmp_path: Path) -> None:
    async def hand_over(_request: SetTable, _descriptors: Sequence[int], _peer: Peer) -> Reply:
        raise RuntimeError("can't start new thread")

    caught: list[BaseException | None] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: caught.append(context["exception"]))
    server = ControlServer(tmp_path, RequestHandlers(pong, hand_over))
    await server.open()
    request = SetTable(tables=(TableFor("x", "x.tab", "", ""),))
    mine = seal(b"points", "x")
    before = descriptors()
    with pytest.raises(NoGatewayError, match="closed the connection"):
        await asyncio.to_thread(ask, server.path, request, timeout_s=PATIENCE_S, descriptors=[mine])
    assert server.clients == 0
    assert descriptors() == before
    assert [str(error) for error in caught] == ["can't start new thread"]
    os.close(mine)
    await server.close()
