"""What the page relies on in uvicorn beyond its documents: asked of the release that is installed.

``supervisor.http.listener`` inherits from uvicorn's connection, which is no public interface. Each test here
stands for one thing that it takes for granted, and needs no network.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from gateway.supervisor.http.answers import HEAD_BYTES
from gateway.supervisor.http.listener import HttpConnection, silent_config

WHAT_TO_DO = (
    f"uvicorn {uvicorn.__version__} has changed inside: adapt Connection and Door in "
    "gateway/supervisor/http/listener.py with this test, or bound uvicorn below that release in "
    "pyproject.toml and say there why (docs/libraries.md, uvicorn)"
)
OVERRIDDEN = {
    *("__init__", "connection_made", "data_received", "send_400_response"),
    *("on_response_complete", "pause_writing", "resume_writing"),
}
REQUEST = b"GET /status HTTP/1.1\r\nHost: x\r\n\r\n"
Receive = Callable[[], Awaitable[dict[str, Any]]]
Send = Callable[[dict[str, Any]], Awaitable[None]]


def holds(condition: object, what: str) -> None:
    """Assert, and say what to do where it does not hold."""
    assert condition, f"{what} - no longer. {WHAT_TO_DO}"


class Wire(asyncio.Transport):
    """A transport that keeps what is written to it."""

    def __init__(self) -> None:
        super().__init__({"peername": ("192.0.2.7", 40000), "sockname": ("192.0.2.1", 8480)})
        self.written = b""
        self.is_closed = False
        self.is_paused = False

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.written += bytes(data)

    def is_closing(self) -> bool:
        return self.is_closed

    def close(self) -> None:
        self.is_closed = True

    def pause_reading(self) -> None:
        self.is_paused = True

    def resume_reading(self) -> None:
        self.is_paused = False


class App:
    """An application that answers as soon as it may."""

    def __init__(self) -> None:
        self.may_answer = asyncio.Event()
        self.may_answer.set()
        self.scopes: list[dict[str, Any]] = []
        self.got: list[dict[str, Any]] = []
        self.sent = 0

    async def __call__(self, scope: dict[str, Any], receive: Receive, send: Send) -> None:
        self.scopes.append(scope)
        self.got.append(await receive())
        await self.may_answer.wait()
        headers = [(b"content-length", b"4")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        for part, more in ((b"ab", True), (b"cd", False)):
            await send({"type": "http.response.body", "body": part, "more_body": more})
            self.sent += 1


class Inside(H11Protocol):
    """Uvicorn's connection, which notes what of it is called that the page overrides."""

    def __init__(self, app: App, keep_alive_s: int = 60) -> None:
        super().__init__(config=silent_config(app, keep_alive_s), server_state=ServerState(), app_state={})
        self.calls: list[str] = []
        self.wire = Wire()

    def send_400_response(self, msg: str) -> None:
        self.calls.append("send_400_response")

    def on_response_complete(self) -> None:
        self.calls.append("on_response_complete")
        super().on_response_complete()


async def turns(count: int = 10) -> None:
    for _ in range(count):
        await asyncio.sleep(0)


def made(app: App, keep_alive_s: int = 60) -> Inside:
    inside = Inside(app, keep_alive_s)
    inside.connection_made(inside.wire)
    return inside


def test_this_asks_of_all_that_the_page_overrides() -> None:
    overridden = {name for name in vars(HttpConnection) if callable(getattr(H11Protocol, name, None))}
    assert overridden == OVERRIDDEN, "give what is overridden a test here"
    for name in OVERRIDDEN:
        holds(callable(getattr(H11Protocol, name, None)), f"a connection has {name}")
    holds(issubclass(H11Protocol, asyncio.Protocol), "a connection is a protocol of asyncio")


async def test_a_connection_is_known_from_its_making_to_its_loss() -> None:
    inside = made(App())
    holds(inside in inside.server_state.connections, "ServerState.connections has a connection that was made")
    holds(inside.connections is inside.server_state.connections, "a connection shares that set")
    holds(inside.transport is inside.wire, "it has its transport as .transport")
    holds(inside.client == ("192.0.2.7", 40000), "it has the address of its peer as .client")
    holds(isinstance(inside.conn, h11.Connection), "it has a connection of h11 as .conn")
    holds(inside.cycle is None, "its .cycle is None before the first request")
    inside.connection_lost(None)
    holds(not inside.server_state.connections, "a lost one is in ServerState.connections no more")


async def test_an_answer_under_way_can_be_told_from_one_that_is_whole() -> None:
    app = App()
    app.may_answer.clear()
    inside = made(app)
    inside.app_state["certificate"] = "panel"
    inside.data_received(REQUEST)
    await turns()
    holds(not inside.cycle.response_complete, "cycle.response_complete is false while it is answered")
    holds(len(inside.server_state.tasks) == 1, "ServerState.tasks has the task that answers")
    holds(app.scopes[0]["state"] == {"certificate": "panel"}, "scope['state'] is what app_state was")
    app.may_answer.set()
    await turns()
    holds(inside.cycle.response_complete, "cycle.response_complete is true once it is whole")
    holds(inside.calls == ["on_response_complete"], "on_response_complete is called once for each answer")
    holds(not inside.server_state.tasks, "ServerState.tasks has no task that is done")
    head, _, body = inside.wire.written.partition(b"\r\n\r\n")
    holds(body == b"abcd" and not inside.wire.is_closed, "an answer is written, and its connection stays")
    names = {line.partition(b":")[0].lower() for line in head.splitlines()[1:]}
    holds(names == {b"content-length"}, "it adds no header fields: neither date nor server")


async def test_it_is_seen_whether_a_request_is_whole() -> None:
    inside = made(App())
    inside.data_received(REQUEST[:-2])
    holds(inside.conn.their_state is h11.IDLE, "conn.their_state is IDLE within the head of a request")
    inside.data_received(b"Content-Length: 2\r\n\r\nx")
    holds(inside.conn.their_state is h11.SEND_BODY, "conn.their_state is SEND_BODY within its body")
    inside.data_received(b"y")
    holds(inside.conn.their_state is h11.DONE, "conn.their_state is DONE behind it")
    await turns()
    holds(inside.conn.their_state is h11.IDLE, "conn.their_state is IDLE after its answer")


async def test_what_is_no_request_is_answered_by_one_method() -> None:
    inside = made(App())
    inside.data_received(b"nonsense\r\n\r\n")
    holds(inside.calls == ["send_400_response"], "send_400_response is called for what is no request")
    large = made(App())
    large.data_received(b"GET / HTTP/1.1\r\nx: " + b"y" * HEAD_BYTES)
    holds(large.calls == ["send_400_response"], "send_400_response is called for a head that is too large")
    waiting, _ = large.conn.trailing_data
    holds(len(waiting) > HEAD_BYTES, "conn.trailing_data has a head that is too large")
    for one in (inside, large):
        holds(not one.wire.written and not one.wire.is_closed, "nothing else answers it, or closes")


async def test_an_answer_waits_for_whoever_takes_nothing() -> None:
    app = App()
    inside = made(app)
    inside.pause_writing()
    inside.data_received(REQUEST)
    await turns()
    holds(app.sent == 0 and not inside.wire.written, "after pause_writing an application waits in send")
    inside.resume_writing()
    await turns()
    holds(app.sent == 2, "after resume_writing it goes on")


async def test_a_second_request_waits_for_the_first_answer() -> None:
    app = App()
    app.may_answer.clear()
    inside = made(app)
    inside.data_received(REQUEST + REQUEST)
    await turns()
    inside.data_received(REQUEST)
    holds(len(app.scopes) == 1 and inside.wire.is_paused, "nothing more is read while a second request waits")
    app.may_answer.set()
    await turns(30)
    holds(len(app.scopes) == 3 and not inside.wire.is_paused, "it is answered then, and reading goes on")


async def test_a_connection_on_which_nothing_is_asked_is_closed_after_its_time() -> None:
    inside = made(App(), keep_alive_s=0)
    inside.data_received(REQUEST)
    async with asyncio.timeout(30):
        while not inside.wire.is_closed:  # noqa: ASYNC110 - nothing tells of it
            await asyncio.sleep(0.001)
    holds(inside.calls == ["on_response_complete"], "timeout_keep_alive counts from the answer on")


async def test_who_waits_for_more_of_a_request_is_told_of_the_loss_of_its_connection() -> None:
    app = App()
    inside = made(app)
    inside.data_received(REQUEST[:-2] + b"Content-Length: 2\r\n\r\n")
    await turns()
    inside.connection_lost(ConnectionResetError())
    await turns()
    holds(app.got == [{"type": "http.disconnect"}], "receive returns http.disconnect after connection_lost")
    holds(not inside.server_state.tasks, "and its task comes to an end")


async def test_the_task_of_an_answer_ends_when_it_is_cancelled() -> None:
    app = App()
    app.may_answer.clear()
    inside = made(app)
    inside.data_received(REQUEST)
    await turns()
    [task] = inside.server_state.tasks
    inside.wire.close()
    task.cancel()
    await asyncio.wait([task], timeout=30)
    holds(task.done(), "a task of ServerState.tasks ends when it is cancelled")


async def test_its_own_words_come_by_two_loggers() -> None:
    inside = Inside(App())
    holds(inside.logger.name == "uvicorn.error", "a connection logs as uvicorn.error")
    holds(inside.access_logger.name == "uvicorn.access", "requests are logged as uvicorn.access")
