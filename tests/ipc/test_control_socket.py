"""The gateway's socket: who gets it, who is answered, and who is dropped."""

import asyncio
import contextlib
import os
import socket
import stat
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.exchange.commands import Disable, Enable, SetReference
from gateway.ipc import messages
from gateway.ipc.address import Peer, SocketError, socket_path
from gateway.ipc.client import NoGatewayError, ask
from gateway.ipc.messages import (
    Done,
    Ping,
    Pong,
    Refused,
    Reply,
    Request,
    WrongMessageError,
    decode_reply,
    decode_request,
    encode,
)
from gateway.ipc.server import ControlServer

PATIENCE_S = 30.0


def echo(request: Request, _peer: Peer) -> Reply:
    """Answer with what was asked for."""
    if isinstance(request, Enable):
        return Done(changed=request.axes)
    return Pong(name="bench", gateway_version="0", pid=os.getpid())


@contextlib.asynccontextmanager
async def serving(state: Path, idle_s: float = 30.0) -> AsyncIterator[ControlServer]:
    server = ControlServer(state, echo, idle_s)
    await server.open()
    try:
        yield server
    finally:
        await server.close()


async def talk(path: Path, data: bytes, replies: int) -> list[Reply]:
    """Send bytes as they are and return so many replies."""
    async with asyncio.timeout(PATIENCE_S):
        reader, writer = await asyncio.open_unix_connection(str(path))
        writer.write(data)
        lines = [await reader.readline() for _ in range(replies)]
        writer.close()
        await writer.wait_closed()
    return [decode_reply(line) for line in lines]


async def test_a_request_is_answered_and_only_this_user_may_ask(tmp_path: Path) -> None:
    async with serving(tmp_path / "made" / "state") as server:
        assert stat.S_IMODE(server.path.stat().st_mode) == 0o600
        assert stat.S_IMODE(server.path.parent.stat().st_mode) == 0o700
        reply = await asyncio.to_thread(ask, server.path, Enable(axes=("x", "y")))
        assert reply == Done(changed=("x", "y"))
    assert not server.path.exists()


async def test_requests_that_come_at_once_are_answered_in_order(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        many = [Enable(axes=(f"a{number}",)) for number in range(100)]
        replies = await talk(server.path, b"".join(map(encode, many)), 100)
    assert replies == [Done(changed=request.axes) for request in many]


async def test_a_socket_that_a_killed_gateway_left_is_replaced(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(socket_path(tmp_path)))
    async with serving(tmp_path) as server:
        assert isinstance(await asyncio.to_thread(ask, server.path, Ping()), Pong)


async def test_the_socket_of_a_gateway_that_runs_is_left_alone(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        with pytest.raises(SocketError, match="belongs to a gateway that runs: stop it first"):
            await ControlServer(tmp_path, echo).open()
        assert isinstance(await asyncio.to_thread(ask, server.path, Ping()), Pong)
    async with serving(tmp_path) as server:
        assert isinstance(await asyncio.to_thread(ask, server.path, Ping()), Pong)


async def test_somebody_elses_socket_is_left_alone(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(socket_path(tmp_path)))
        other.listen()
        with pytest.raises(SocketError, match="belongs to a gateway that runs"):
            await ControlServer(tmp_path, echo).open()
        assert socket_path(tmp_path).exists()


async def test_a_socket_that_was_removed_is_made_again(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        reader, writer = await asyncio.open_unix_connection(str(server.path))
        assert server.renew_socket() == ""
        server.path.unlink()
        assert server.renew_socket() == f"{server.path} was missing; it was made again"
        assert stat.S_IMODE(server.path.stat().st_mode) == 0o600
        [reply] = await talk(server.path, encode(Ping()), 1)
        assert isinstance(reply, Pong)
        writer.write(encode(Ping()))  # who was connected still is
        assert isinstance(decode_reply(await reader.readline()), Pong)
        writer.close()
        assert server.renew_socket() == ""
    assert not server.path.exists()


async def test_a_socket_that_cannot_be_made_again_is_said_once(tmp_path: Path) -> None:
    state = tmp_path / "state"
    async with serving(state) as server:
        for path in (server.path, state / "relay.lock"):
            path.unlink()
        state.rmdir()
        told = server.renew_socket()
        assert told.startswith(f"{server.path} is missing, and cannot be made again: {state}")
        assert server.renew_socket() == ""
        state.mkdir()
        assert server.renew_socket() == f"{server.path} was missing; it was made again"


async def test_a_file_in_its_place_is_not_removed(tmp_path: Path) -> None:
    socket_path(tmp_path).write_text("notes")
    with pytest.raises(SocketError, match="exists and is not a socket; move it away"):
        await ControlServer(tmp_path, echo).open()
    assert socket_path(tmp_path).read_text() == "notes"


async def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SocketError, match=r"file.*Not a directory; a file is where a folder should be"):
        await ControlServer(tmp_path / "file" / "state", echo).open()


def test_a_path_that_is_too_long_for_a_socket_is_refused_with_a_remedy() -> None:
    # "/" + n characters + "/relay.sock" (11 bytes): 107 bytes with n = 95.
    assert len(os.fsencode(socket_path(Path("/" + "s" * 95)))) == 107
    with pytest.raises(SocketError, match=r"has 108 bytes.*107 at most; give \[gateway\] state a shorter"):
        socket_path(Path("/" + "s" * 96))
    with pytest.raises(SocketError, match="has 109 bytes"):
        socket_path(Path("/" + "s" * 95 + "é"))


async def test_a_client_that_hangs_is_dropped_and_holds_nobody_up(tmp_path: Path) -> None:
    async with serving(tmp_path, idle_s=0.2) as server:
        reader, writer = await asyncio.open_unix_connection(str(server.path))
        writer.write(encode(Ping())[:-1])  # never ends
        assert isinstance(await asyncio.to_thread(ask, server.path, Ping()), Pong)
        async with asyncio.timeout(PATIENCE_S):
            assert await reader.read() == b""
        writer.close()
        assert server.clients == 0


async def test_a_client_that_takes_no_replies_is_dropped(tmp_path: Path) -> None:
    async with serving(tmp_path, idle_s=0.5) as server:
        with socket.socket(socket.AF_UNIX) as greedy:
            greedy.setblocking(False)
            greedy.connect(str(server.path))
            request = encode(Enable(axes=("a" * 900,)))
            async with asyncio.timeout(PATIENCE_S):
                with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                    while (
                        True
                    ):  # until what was sent and not taken fills every buffer, and then it is dropped
                        await asyncio.get_running_loop().sock_sendall(greedy, request)
        assert isinstance(await asyncio.to_thread(ask, server.path, Ping()), Pong)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"no JSON\n", "not a message: "),
        (b'{"kind":"ping","version":3}\n', "a message of version 3, but this side speaks version 2"),
        (b'{"kind":"explode","version":2}\n', "not a request of version 2"),
        (b'{"kind":"ping","version":2,"axis":"x"}\n', "not a request of version 2"),
        (b'{"kind":"reference","version":2}\n', "not a request of version 2"),
        (b"x" * 5000, "more than 4096 bytes"),
    ],
)
async def test_what_is_no_request_is_refused_with_a_reason(tmp_path: Path, data: bytes, reason: str) -> None:
    async with serving(tmp_path) as server:
        [reply] = await talk(server.path, data, 1)
    assert isinstance(reply, Refused)
    assert reason in reply.reason


@given(st.binary())
def test_any_bytes_are_a_message_or_refused(data: bytes) -> None:
    for decode in (decode_request, decode_reply):
        with contextlib.suppress(WrongMessageError):
            decode(data)


def test_every_request_survives_the_way() -> None:
    for request in (
        Ping(),
        messages.GetStatus(),
        Enable(),
        Disable(axes=("x",)),
        SetReference(axis="x"),
    ):
        assert decode_request(encode(request)) == request


def test_without_a_gateway_the_client_says_which_socket_it_tried(tmp_path: Path) -> None:
    with pytest.raises(NoGatewayError, match=f"no gateway runs: nothing listens at {tmp_path}/relay.sock"):
        ask(socket_path(tmp_path), Ping())


def test_a_gateway_that_does_not_answer_is_not_waited_for(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as mute:
        mute.bind(str(socket_path(tmp_path)))
        mute.listen()
        with pytest.raises(NoGatewayError, match=r"did not answer within 0\.05 s"):
            ask(socket_path(tmp_path), Ping(), timeout_s=0.05)


async def test_a_refusal_reaches_whoever_asks(tmp_path: Path) -> None:
    server = ControlServer(tmp_path, lambda _request, _peer: Refused(reason="of another release"))
    await server.open()
    with pytest.raises(NoGatewayError, match="refused the request: of another release"):
        await asyncio.to_thread(ask, server.path, Ping())
    await server.close()
