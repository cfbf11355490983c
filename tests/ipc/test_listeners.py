"""Whoever subscribes is told; whoever does not listen costs a bounded buffer and nothing else."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from gateway.ipc.address import Peer
from gateway.ipc.handlers import LONGEST_WAIT_S, RequestHandlers
from gateway.ipc.listener import EVENTS_KEPT
from gateway.ipc.messages import (
    GetStatus,
    Happened,
    Ping,
    Pong,
    Refused,
    Reply,
    Request,
    Snapshot,
    Status,
    Subscribe,
    Subscribed,
    decode_reply,
    encode,
)
from gateway.ipc.server import ControlServer
from gateway.ipc.session import MAX_LISTENERS
from gateway.status.model import GatewayStatus, RelayModel

PATIENCE_S = 20.0
SLOW = Subscribe(interval_s=60.0)
"""One snapshot at once, and none after it while a test lasts."""


def numbered(number: int, ballast: str = "") -> RelayModel:
    """A status that can be told from others."""
    return RelayModel(gateway=GatewayStatus(name=str(number), version=ballast))


def number_of(message: Snapshot) -> int:
    return int(message.status.gateway.name)


class Counting:
    """A status that counts how often it was asked for."""

    def __init__(self) -> None:
        self.asked = 0
        self.ballast = ""

    def status(self) -> RelayModel:
        self.asked += 1
        return numbered(self.asked, self.ballast)


def pong(request: Request, _peer: Peer) -> Reply:
    return (
        Status(status=RelayModel())
        if isinstance(request, GetStatus)
        else Pong(name="", gateway_version="", pid=1)
    )


@contextlib.asynccontextmanager
async def serving(state: Path, model: Counting, idle_s: float = 30.0) -> AsyncIterator[ControlServer]:
    server = ControlServer(state, RequestHandlers(pong, status=model.status), idle_s)
    await server.open()
    try:
        yield server
    finally:
        await server.close()


class Ear:
    """A client that reads when a test wants it to."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self.writer = writer

    async def next(self) -> Reply:
        async with asyncio.timeout(PATIENCE_S):
            return decode_reply(await self._reader.readline())


@contextlib.asynccontextmanager
async def listening(server: ControlServer, request: Subscribe = SLOW) -> AsyncIterator[Ear]:
    reader, writer = await asyncio.open_unix_connection(str(server.path), limit=4_000_000)
    writer.write(encode(request))
    ear = Ear(reader, writer)
    try:
        assert await ear.next() == Subscribed(interval_s=request.interval_s)
        yield ear
    finally:
        writer.close()
        with contextlib.suppress(OSError):
            await writer.wait_closed()


def happened(number: int) -> Happened:
    return Happened(event="e", severity="info", fields={"number": number}, wall_s=1.0)


async def test_snapshots_come_by_themselves_and_events_as_they_happen(tmp_path: Path) -> None:
    async with serving(tmp_path, Counting()) as server, listening(server, Subscribe(interval_s=0.05)) as ear:
        assert await ear.next() == Snapshot(status=numbered(1))
        assert await ear.next() == Snapshot(status=numbered(2))
        server.publish_event(happened(7))
        while not isinstance(message := await ear.next(), Happened):
            assert isinstance(message, Snapshot)
        assert message == happened(7)


async def test_a_listener_may_ask_too_and_may_be_silent_for_long(tmp_path: Path) -> None:
    interval = Subscribe(interval_s=0.05)
    async with serving(tmp_path, Counting(), idle_s=0.1) as server, listening(server, interval) as ear:
        # Four snapshots are 0.15 s: longer than a client that only asks may be silent.
        numbers = [number_of(message) async for message in _snapshots(ear, 4)]
        assert numbers == [1, 2, 3, 4]
        ear.writer.write(encode(Ping()))
        while not isinstance(message := await ear.next(), Pong):
            assert isinstance(message, Snapshot)


@contextlib.asynccontextmanager
async def serving_between_frames(state: Path, leaving: list[bool]) -> AsyncIterator[ControlServer]:
    """Serve, and say whether a frame is leaving as the list has it; in the end its last."""

    def is_leaving() -> bool:
        return leaving.pop(0) if len(leaving) > 1 else leaving[0]

    def answer(request: Request, peer: Peer) -> Reply:
        return Status(status=status()) if isinstance(request, GetStatus) else pong(request, peer)

    def status() -> RelayModel:
        return numbered(len(leaving))

    desk = RequestHandlers(answer, status=status, has_to_wait=is_leaving)
    server = ControlServer(state, desk)
    await server.open()
    try:
        yield server
    finally:
        await server.close()


async def test_a_snapshot_waits_until_no_frame_is_leaving(tmp_path: Path) -> None:
    leaving = [True, True, True, False]
    async with serving_between_frames(tmp_path, leaving) as server, listening(server) as ear:
        assert await ear.next() == Snapshot(status=numbered(1))
    assert leaving == [False]


async def test_a_status_waits_until_no_frame_is_leaving_and_what_is_asked_behind_it_with_it(
    tmp_path: Path,
) -> None:
    leaving = [False, True, True, True, False]
    async with serving_between_frames(tmp_path, leaving) as server, listening(server) as ear:
        assert await ear.next() == Snapshot(status=numbered(4))  # at once
        ear.writer.write(encode(GetStatus()) + encode(Ping()))
        assert await ear.next() == Status(status=numbered(1))
        assert isinstance(await ear.next(), Pong)


async def test_a_status_comes_where_a_frame_is_always_leaving(tmp_path: Path) -> None:
    async with serving_between_frames(tmp_path, [True]) as server, listening(server) as ear:
        began_s = asyncio.get_running_loop().time()
        assert isinstance(await ear.next(), Snapshot)
        ear.writer.write(encode(GetStatus()))
        assert isinstance(await ear.next(), Status)
        # The snapshot has waited since it was subscribed to, a moment before; the status for all of it.
        assert asyncio.get_running_loop().time() - began_s >= LONGEST_WAIT_S


async def test_to_subscribe_again_changes_the_interval(tmp_path: Path) -> None:
    async with serving(tmp_path, Counting()) as server, listening(server, SLOW) as ear:
        assert await ear.next() == Snapshot(status=numbered(1))
        ear.writer.write(encode(Subscribe(interval_s=0.05)))
        assert await ear.next() == Subscribed(interval_s=0.05)
        # The second snapshot would have come after a minute, longer than a test waits.
        assert [number_of(message) async for message in _snapshots(ear, 3)] == [2, 3, 4]


async def test_what_happens_brings_the_next_snapshot_forward(tmp_path: Path) -> None:
    async with serving(tmp_path, Counting()) as server, listening(server, SLOW) as ear:
        assert await ear.next() == Snapshot(status=numbered(1))
        for number in (7, 8):
            server.publish_event(happened(number))
        assert [await ear.next(), await ear.next()] == [happened(7), happened(8)]
        assert await ear.next() == Snapshot(status=numbered(2))  # one for both


async def _snapshots(ear: Ear, count: int) -> AsyncIterator[Snapshot]:
    for _ in range(count):
        message = await ear.next()
        assert isinstance(message, Snapshot)
        yield message


async def test_a_listener_that_does_not_read_keeps_the_newest_and_knows_how_many_it_missed(
    tmp_path: Path,
) -> None:
    """Every event is received or counted as dropped, whatever the buffers of the system take."""
    total = 20_000
    async with serving(tmp_path, Counting()) as server:
        with socket.socket(socket.AF_UNIX) as deaf:
            deaf.connect(str(server.path))
            deaf.sendall(encode(SLOW))
            await _until(lambda: server.has_listeners)
            for number in range(total):
                server.publish_event(happened(number))
                if number % 4 == 3:
                    await asyncio.sleep(0)  # a turn of the loop, so that what can be sent is
            [session] = server._clients.sessions
            assert session.listener is not None
            assert len(session.listener._events.items) == EVENTS_KEPT
            assert session._outbox.waiting_bytes < 200  # the rest of one event
            # The last ones wait for it, oldest first, and the next message says how many were dropped.
            messages = await asyncio.to_thread(_read_all, deaf, total - 1)
    events = [message for message in messages if isinstance(message, Happened)]
    dropped = sum(message.dropped for message in messages if isinstance(message, Happened | Snapshot))
    assert dropped > 1000
    assert len(events) + dropped == total
    numbers = [event.fields["number"] for event in events]
    assert numbers == sorted(numbers)
    assert numbers[-EVENTS_KEPT:] == list(range(total - EVENTS_KEPT, total))


def _read_all(connection: socket.socket, last: int) -> list[Reply]:
    connection.settimeout(PATIENCE_S)
    data = b""
    while f'"number":{last}}}'.encode() not in data[-400:]:
        data += connection.recv(65536)
    return [decode_reply(line) for line in data.splitlines()]


async def test_snapshots_that_nobody_takes_are_not_even_made(tmp_path: Path) -> None:
    model = Counting()
    model.ballast = "x" * 1_000_000  # more than the system takes at once
    async with serving(tmp_path, model) as server:
        with socket.socket(socket.AF_UNIX) as deaf:
            deaf.connect(str(server.path))
            deaf.sendall(encode(Subscribe(interval_s=0.05)))
            async with listening(server, Subscribe(interval_s=0.05)) as ear:
                while True:  # somebody who does listen is told all the same
                    message = await ear.next()
                    if isinstance(message, Snapshot) and number_of(message) > 5:
                        break
            session = max(server._clients.sessions, key=lambda each: each._outbox.waiting_bytes)
            assert session.listener is not None
            assert session._outbox.waiting_bytes < 1_100_000
            asked, missed = model.asked, session.listener._snapshots_dropped
            model.ballast = ""
            deaf.settimeout(PATIENCE_S)
            data = b""
            while data.count(b"\n") < 3:  # subscribed, the old snapshot, a new one
                data += await asyncio.to_thread(deaf.recv, 65536)
    _, first, second = (decode_reply(line) for line in data.splitlines()[:3])
    assert isinstance(first, Snapshot)
    assert isinstance(second, Snapshot)
    assert number_of(first) <= 2
    assert number_of(second) > asked
    assert second.dropped >= missed


async def test_listeners_leave_room_for_commands(tmp_path: Path) -> None:
    async with serving(tmp_path, Counting()) as server, contextlib.AsyncExitStack() as stack:
        for _ in range(MAX_LISTENERS):
            await stack.enter_async_context(listening(server))
        reader, writer = await asyncio.open_unix_connection(str(server.path))
        writer.write(encode(SLOW))
        reply = decode_reply(await reader.readline())
        assert reply == Refused(reason="the largest number of listeners is already subscribed")
        writer.close()


async def test_a_listener_that_goes_away_is_forgotten(tmp_path: Path) -> None:
    async with serving(tmp_path, Counting()) as server:
        async with listening(server, Subscribe(interval_s=0.05)):
            assert server.has_listeners
        await _until(lambda: not server.clients)
        server.publish_event(happened(1))  # and nobody minds


async def _until(condition: Any) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - nobody is told
            await asyncio.sleep(0)


async def test_a_listener_that_talks_nonsense_and_takes_nothing_is_dropped(tmp_path: Path) -> None:
    async with serving(tmp_path, Counting(), idle_s=0.1) as server:
        with socket.socket(socket.AF_UNIX) as deaf:
            deaf.connect(str(server.path))
            deaf.sendall(encode(SLOW))
            await _until(lambda: server.has_listeners)
            [session] = server._clients.sessions
            async with asyncio.timeout(PATIENCE_S):
                while not session._outbox.waiting_bytes:  # the refusal will have to wait behind it
                    server.publish_event(happened(1))
                    await asyncio.sleep(0)
            deaf.sendall(b"nonsense\n")
            await _until(lambda: not server.clients)
