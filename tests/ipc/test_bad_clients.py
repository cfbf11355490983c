"""What clients can get wrong with descriptors, halves and rights: refused, said once, and nothing leaks."""

import asyncio
import contextlib
import gc
import os
import socket
import tempfile
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path

import pytest

from gateway.exchange.commands import MAX_TABLES, Disable, Enable, SetGain, SetTable, TableFor
from gateway.ipc.address import Peer
from gateway.ipc.handlers import RequestHandlers
from gateway.ipc.messages import (
    Done,
    GetStatus,
    Ping,
    Pong,
    Refused,
    Reply,
    Request,
    Status,
    decode_reply,
    encode,
)
from gateway.ipc.sealed_memory import NotSealedError, map_sealed, seal
from gateway.ipc.server import ControlServer
from gateway.status.model import RelayModel

PATIENCE_S = 20.0
TABLE = TableFor("x", "x.tab", "centroid-3", "0" * 64)


class Counter:
    """What a server did."""

    def __init__(self) -> None:
        self.requests: list[Request] = []
        self.contents: list[list[bytes]] = []
        self.complaints: list[str] = []

    def answer(self, request: Request, _peer: Peer) -> Reply:
        self.requests.append(request)
        if isinstance(request, GetStatus):
            return Status(status=RelayModel())
        return Pong(name="", gateway_version="", pid=1) if isinstance(request, Ping) else Done()

    async def hand_over(self, request: SetTable, descriptors: Sequence[int], _peer: Peer) -> Reply:
        self.requests.append(request)
        self.contents.append([os.pread(descriptor, 100, 0) for descriptor in descriptors])
        return Done(changed=tuple(table.axis for table in request.tables))


@contextlib.asynccontextmanager
async def serving(
    state: Path, counter: Counter, masters: frozenset[int] | None = None
) -> AsyncIterator[ControlServer]:
    desk = RequestHandlers(counter.answer, counter.hand_over, complain=counter.complaints.append)
    if masters is not None:
        desk = RequestHandlers(
            counter.answer, counter.hand_over, complain=counter.complaints.append, masters=masters
        )
    server = ControlServer(state, desk)
    await server.open()
    try:
        yield server
    finally:
        await server.close()


def open_descriptors() -> int:
    gc.collect()  # what other tests left is none of ours
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


async def quiet(server: ControlServer) -> None:
    """Wait until every client is gone."""
    async with asyncio.timeout(PATIENCE_S):
        while server.clients:  # noqa: ASYNC110 - nobody is told
            await asyncio.sleep(0)


def say(path: Path, data: bytes, descriptors: Sequence[int] = (), replies: int = 1) -> list[Reply]:
    """Send bytes with descriptors and return so many replies; end of file ends the list."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(PATIENCE_S)
        connection.connect(str(path))
        socket.send_fds(connection, [data], descriptors)
        with connection.makefile("rb") as file:
            lines = [file.readline() for _ in range(replies)]
    return [decode_reply(line) for line in lines if line]


async def refused(path: Path, data: bytes, descriptors: Sequence[int] = ()) -> str:
    [reply] = await asyncio.to_thread(say, path, data, descriptors)
    assert isinstance(reply, Refused), reply
    return reply.reason


async def test_descriptors_arrive_in_their_order_and_are_closed_afterwards(tmp_path: Path) -> None:
    counter = Counter()
    async with serving(tmp_path, counter) as server:
        before = open_descriptors()
        mine = [seal(b"one", "1"), seal(b"two", "2")]
        request = SetTable(tables=(TABLE, TableFor("y", "y.tab", "", "")))
        [reply] = await asyncio.to_thread(say, server.path, encode(request), mine)
        await quiet(server)
        for descriptor in mine:
            os.close(descriptor)
        assert reply == Done(changed=("x", "y"))
        assert counter.contents == [[b"one", b"two"]]
        assert open_descriptors() == before


async def test_requests_behind_a_table_are_answered_after_it(tmp_path: Path) -> None:
    counter = Counter()
    async with serving(tmp_path, counter) as server:
        mine = [seal(b"one", "1")]
        data = encode(SetTable(tables=(TABLE,))) + encode(Ping()) + encode(GetStatus())
        replies = await asyncio.to_thread(say, server.path, data, mine, 3)
        os.close(mine[0])
        assert [type(reply) for reply in replies] == [Done, Pong, Status]


def a_pipe() -> int:
    reading, writing = os.pipe()
    os.close(writing)
    return reading


@pytest.mark.parametrize(
    ("request_", "count", "reason"),
    [
        (Ping(), 1, "1 descriptors where 0 belong to the message"),
        (SetTable(tables=(TABLE,)), 0, "0 descriptors where 1 belong to the message"),
        (SetTable(tables=(TABLE, TABLE)), 1, "1 descriptors where 2 belong to the message"),
        (SetTable(tables=(TABLE,)), MAX_TABLES + 1, f"more than {MAX_TABLES} descriptors"),
        (SetTable(tables=(TABLE,)), 100, f"more than {MAX_TABLES} descriptors"),
    ],
)
async def test_as_many_descriptors_as_tables_or_none_is_looked_at(
    tmp_path: Path, request_: Request, count: int, reason: str
) -> None:
    counter = Counter()
    async with serving(tmp_path, counter) as server:
        before = open_descriptors()
        mine = [a_pipe() for _ in range(count)]
        assert await refused(server.path, encode(request_), mine) == reason
        await quiet(server)
        for descriptor in mine:
            os.close(descriptor)
        assert open_descriptors() == before
        assert counter.requests == []
        assert counter.complaints == [f"a client (user {os.geteuid()}): {reason}"]


async def test_a_client_that_dies_in_the_middle_of_a_message_leaves_nothing(tmp_path: Path) -> None:
    counter = Counter()
    async with serving(tmp_path, counter) as server:
        before = open_descriptors()
        mine = a_pipe()
        for _ in range(50):
            replies = await asyncio.to_thread(_half, server.path, encode(SetTable(tables=(TABLE,))), mine)
            assert replies == b""
        await quiet(server)
        os.close(mine)
        assert open_descriptors() == before
        assert counter.requests == []
        # Said once, however often it happens.
        assert counter.complaints == [
            f"a client (user {os.geteuid()}): disconnected in the middle of a message"
        ]
        [reply] = await asyncio.to_thread(say, server.path, encode(Ping()))
        assert isinstance(reply, Pong)


def _half(path: Path, data: bytes, descriptor: int) -> bytes:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(PATIENCE_S)
        connection.connect(str(path))
        socket.send_fds(connection, [data[:20]], [descriptor])
        connection.shutdown(socket.SHUT_WR)
        return connection.recv(100)


@pytest.mark.parametrize(
    ("request_", "is_done"),
    [
        (Enable(axes=("x",)), False),
        (SetGain(axes=("x",), forward=0.0, backward=0.0), False),
        (Disable(axes=("x",)), True),  # what was to be off is off
    ],
)
async def test_what_a_client_gave_up_is_not_carried_out_later(
    tmp_path: Path, request_: Request, is_done: bool
) -> None:
    counter = Counter()
    async with serving(tmp_path, counter) as server:
        with socket.socket(socket.AF_UNIX) as client:  # closed before the server comes to read it
            client.connect(str(server.path))
            client.sendall(encode(request_))
        assert isinstance((await asyncio.to_thread(say, server.path, encode(Ping())))[0], Pong)
    assert counter.requests == ([request_] if is_done else []) + [Ping()]
    assert [("not carried out" in text) for text in counter.complaints] == ([] if is_done else [True])


async def test_a_client_that_only_sends_no_more_gets_its_answer(tmp_path: Path) -> None:
    counter = Counter()
    async with serving(tmp_path, counter) as server:
        reader, writer = await asyncio.open_unix_connection(str(server.path))
        writer.write(encode(Enable(axes=("x",))))
        writer.write_eof()
        async with asyncio.timeout(PATIENCE_S):
            assert isinstance(decode_reply(await reader.readline()), Done)
        writer.close()
    assert counter.requests == [Enable(axes=("x",))]


async def test_garbage_with_a_descriptor_is_refused_and_the_descriptor_closed(tmp_path: Path) -> None:
    counter = Counter()
    async with serving(tmp_path, counter) as server:
        before = open_descriptors()
        for data in (b"no JSON\n", b'{"kind":"ping","version":1}\n', b"x" * 5000):
            mine = a_pipe()
            await refused(server.path, data, [mine])
            os.close(mine)
        await quiet(server)
        assert open_descriptors() == before
        assert counter.requests == []
        # One of each kind: what is no message, and what is too long; never one for each attempt.
        assert len(counter.complaints) == 2


async def test_another_user_may_look_and_change_nothing(tmp_path: Path) -> None:
    counter = Counter()
    stranger = frozenset({os.geteuid() + 1})  # so that we are the stranger
    async with serving(tmp_path, counter, stranger) as server:
        before = open_descriptors()
        for request in (Ping(), GetStatus()):
            [reply] = await asyncio.to_thread(say, server.path, encode(request))
            assert not isinstance(reply, Refused)
        reason = f"user {os.geteuid()} may read, but not change anything"
        assert await refused(server.path, encode(Disable(axes=("x",)))) == reason
        mine = a_pipe()
        assert await refused(server.path, encode(SetTable(tables=(TABLE,))), [mine]) == reason
        os.close(mine)
        await quiet(server)
        assert counter.requests == [Ping(), GetStatus()]
        assert open_descriptors() == before
    assert counter.complaints == [f"a client (user {os.geteuid()}): {reason}"]


async def test_a_flood_of_requests_is_read_no_faster_than_it_is_answered(tmp_path: Path) -> None:
    counter = Counter()
    async with serving(tmp_path, counter) as server:
        count = 3000
        replies = await asyncio.to_thread(_flood, server.path, encode(Ping()) * count, count)
        assert replies == count
        assert len(counter.requests) == count


def _flood(path: Path, data: bytes, count: int) -> int:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(PATIENCE_S)
        connection.connect(str(path))
        connection.sendall(data)
        with connection.makefile("rb") as file:
            return sum(isinstance(decode_reply(file.readline()), Pong) for _ in range(count))


# --- sealed memory -----------------------------------------------------------------------------------------


def unsealed() -> int:
    descriptor = os.memfd_create("table", os.MFD_ALLOW_SEALING)
    os.write(descriptor, b"content")
    return descriptor


def a_file() -> int:
    with tempfile.TemporaryFile() as file:
        file.write(b"content")
        file.flush()
        return os.dup(file.fileno())


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (unsealed, "the memory is not sealed: its sender could change it or cut it short"),
        (a_file, "the descriptor is not a memfd"),
        (a_pipe, "the descriptor is not a memfd"),
        (lambda: seal(b"", "empty"), "the memory has 0 bytes; allowed: 1 to 100"),
        (lambda: seal(b"x" * 101, "long"), "the memory has 101 bytes; allowed: 1 to 100"),
    ],
)
def test_what_is_no_sealed_memory_is_not_mapped(make: Callable[[], int], said: str) -> None:
    descriptor = make()
    with pytest.raises(NotSealedError, match=said):
        map_sealed(descriptor, 100)
    os.close(descriptor)


def test_sealed_memory_cannot_be_changed_by_its_sender() -> None:
    descriptor = seal(b"content", "table")
    content = map_sealed(descriptor, 100)
    for change in (
        lambda: os.pwrite(descriptor, b"x", 0),
        lambda: os.ftruncate(descriptor, 1),
        lambda: os.ftruncate(descriptor, 100_000),
    ):
        with pytest.raises(PermissionError):
            change()
    os.close(descriptor)
    assert bytes(content) == b"content"
