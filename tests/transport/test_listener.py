"""A listener goes on after an accept that failed, and says why no client can connect meanwhile."""

import asyncio
import contextlib
import errno
import resource
import socket
from collections.abc import Iterator

import pytest

from gateway.transport import listener as listening
from gateway.transport.listener import Listener, ProtocolListener, bound


@contextlib.contextmanager
def no_more_descriptors() -> Iterator[None]:
    """As a process that has as many open as it may."""
    with socket.socket() as probe:
        newest = probe.fileno()
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (newest, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


async def test_who_waits_for_a_descriptor_comes_in_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listening, "PAUSE_S", 0.001)
    came: asyncio.Queue[socket.socket] = asyncio.Queue()
    failed: asyncio.Queue[int | None] = asyncio.Queue()
    one = Listener(
        lambda connection, _: came.put_nowait(connection), lambda error: failed.put_nowait(error.errno)
    )
    [where] = await bound("127.0.0.1", 0)
    where.listen()
    one.open([where])
    with socket.create_connection(where.getsockname(), timeout=30), no_more_descriptors():
        async with asyncio.timeout(30):
            assert [await failed.get() for _ in range(3)] == [errno.EMFILE] * 3
        assert came.empty()
    async with asyncio.timeout(30):
        (await came.get()).close()
    one.stop()
    assert one.sockets == []


async def test_the_loop_is_told_where_nobody_else_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listening, "PAUSE_S", 0.001)
    told: asyncio.Queue[dict[str, object]] = asyncio.Queue()
    asyncio.get_running_loop().set_exception_handler(lambda _, context: told.put_nowait(context))
    one = ProtocolListener(asyncio.Protocol)
    one.open(await bound("127.0.0.1", 0))
    with socket.create_connection(one.sockets[0].getsockname(), timeout=30), no_more_descriptors():
        async with asyncio.timeout(30):
            context = await told.get()
    assert context["message"] == "socket.accept() out of system resource"
    await one.close()
