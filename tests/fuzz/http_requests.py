"""What somebody says on a connection of the page, from the first byte to the last answer, over a real socket.

The first byte chooses the listener (over TCP with a token, or the local one) and how many pieces the rest
comes in. Where that says ``SESSION`` it shows a session that was begun before.
"""

import asyncio
import atexit
import contextlib
import re
import shutil
import socket
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Final

import h11

from gateway.catalogue.entry import EventEntry, Severity
from gateway.catalogue.publishing_events import HTTP_FAILED
from gateway.compensation.settings import AxisSettings
from gateway.compensation.units import Units
from gateway.config.http_model import TokenSection
from gateway.limits import Reports
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.http.answers import LOCAL, TCP
from gateway.supervisor.http.application import ASKING_PATHS, LOCAL_PATHS, Served
from gateway.supervisor.http.documents import Window
from gateway.supervisor.http.guard import READS, Guard, Rules
from gateway.supervisor.http.listener import HttpConnection, HttpServer
from gateway.supervisor.http.login import Authenticator, Sessions, Tokens
from gateway.supervisor.http.refusals import HttpRefusals
from gateway.supervisor.outcome import ReloadOutcome
from tests.exchange.line_bench import LOST_MOTION
from tests.supervisor.http.doors import TOKEN, WRONG, write_token
from tests.supervisor.http.http_bench import AXIS, keep_table, model, snapshot
from tests.support.status_models import model_of

SECRET: Final = b"mill-1"
"""The name of the gateway: it stands in everything that only those who may look are shown."""
COOKIE: Final = "pitch-gateway-8480"
STATUS: Final = re.compile(rb"HTTP/1\.1 (\d{3}) [^\r\n]*\r\n")
PATIENCE_S: Final = 10.0
"""What takes longer never comes, however busy the machine is."""
AN_HOUR_S: Final = 3600.0
HEARTBEAT_S: Final = 0.02


class Site:
    """The page as the supervisor serves it, with one axis, behind both of its listeners."""

    def __init__(self, folder: Path) -> None:
        write_token(folder, TOKEN)
        self.loop = asyncio.new_event_loop()
        self.reloads = 0
        self.said: list[tuple[str, dict[str, object]]] = []
        self.now_s = AN_HOUR_S
        broadcast = Broadcast()
        digest = keep_table(folder, LOST_MOTION)
        table: dict[str, object] = AXIS["table"]  # type: ignore[assignment]
        broadcast.publish(
            model_of(model(snapshot(axis={"table": {**table, "compiled": digest, "points": 2}})))
        )
        settings = AxisSettings(Units.MM, 1000.0)
        window = Window(
            broadcast, folder, lambda axis: settings if axis == "x" else None, self.reload, self.say
        )
        self.served = served = Served(window)
        self.tokens = Tokens((TokenSection(name="people", file="people.token"),), folder, self._unusable)
        self.sessions = Sessions()
        access = Authenticator(self.tokens, self.sessions, HttpRefusals(self.say), COOKIE, lambda: self.now_s)
        # Somebody who reads events, says something behind that and goes is noticed with the next word to him.
        self.tcp, self.local = (
            HttpServer(replace(limits, heartbeat_s=HEARTBEAT_S)) for limits in (TCP, LOCAL)
        )
        over_tcp = Rules(READS | {"POST"}, "127.0.0.1", ASKING_PATHS)
        self.tcp.serve(Guard(served.application(self.tcp, ASKING_PATHS, access), over_tcp, access))
        self.local.serve(
            Guard(served.application(self.local, LOCAL_PATHS), Rules(READS | {"POST"}, there_is=LOCAL_PATHS))
        )

    async def reload(self, _who: Mapping[str, object]) -> ReloadOutcome:
        """Count who asks for it."""
        self.reloads += 1
        return ReloadOutcome()

    def say(self, event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        """Keep what the log would have."""
        self.said.append((event.name, fields))

    def _unusable(self, why: str) -> None:
        raise AssertionError(why)

    def session(self) -> bytes:
        """Begin a session as a log-in does."""
        return self.sessions.open("people", self.tokens.digest_of("people"), self.now_s).encode()


@cache
def site() -> Site:
    """Return the page of this process; its folder is gone when it ends."""
    folder = Path(mkdtemp(prefix="pitch-gateway-fuzz-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Site(folder)


def requests(data: bytes) -> None:
    """Whatever is said gets whole answers and an end; without a token or a session it shows nothing.

    No answer is an error of ours (500), each carries its protecting headers, none tells the token to whoever
    did not say it, and nothing over TCP reloads.
    """
    page = site()
    page.loop.run_until_complete(_say(page, data))


async def _say(page: Site, data: bytes) -> None:
    kind = data[0] if data else 0
    http_server = page.local if kind & 1 else page.tcp
    shows = TOKEN.encode() in data or b"SESSION" in data
    said = data[1:].replace(b"SESSION", page.session())
    page.said.clear()
    page.served._mistakes = Reports()
    page.now_s += AN_HOUR_S
    reloads = page.reloads
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    _, connection = await asyncio.get_running_loop().connect_accepted_socket(http_server.connection, theirs)
    heard = b""
    pieces = 1 + (kind >> 4)
    size = -(-len(said) // pieces) or 1
    try:
        for start in range(0, len(said), size):
            with contextlib.suppress(ConnectionError, BlockingIOError):
                ours.send(said[start : start + size])
            await asyncio.sleep(0)
        heard = await _listen(ours, connection)
    finally:
        ours.close()
    end_s = time.monotonic() + PATIENCE_S
    while (http_server._state.tasks or http_server._state.connections) and time.monotonic() < end_s:  # noqa: ASYNC110 - nobody tells
        await asyncio.sleep(0.001)
    assert not http_server._state.tasks, "a request that never ends"
    assert not http_server._state.connections, "a connection that never ends"
    _judge(page, heard, is_local=bool(kind & 1), shows=shows)
    if TOKEN.encode() not in data:
        assert TOKEN.encode() not in heard, "the token is told"
        assert not any(TOKEN in str(fields) for _, fields in page.said), "the token is in the log"
    assert page.reloads == reloads or kind & 1, "a reload over TCP"


async def _listen(ours: socket.socket, connection: HttpConnection) -> bytes:
    """Return what is answered, until nothing more can come."""
    heard, quiet = b"", 0
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        await asyncio.sleep(0 if connection.is_idle else 0.0002)
        try:
            part = ours.recv(1 << 20)
        except BlockingIOError:
            part = None
        except ConnectionError:
            part = b""
        if part == b"":
            return heard
        heard += part or b""
        quiet = 0 if part else quiet + 1
        waits = connection.is_idle or connection.conn.their_state is h11.SEND_BODY
        if quiet > 4 and (waits or b"text/event-stream" in heard):
            return heard
    raise AssertionError(f"no end of an answer after {heard[-200:]!r}")


def _judge(page: Site, heard: bytes, *, is_local: bool, shows: bool) -> None:
    statuses = [int(status) for status in STATUS.findall(heard) if status != b"100"]
    assert 500 not in statuses, page.said
    assert not [event for event, _ in page.said if event == HTTP_FAILED.name], page.said
    assert not heard or heard.startswith(b"HTTP/1.1 "), heard[:80]
    assert heard.lower().count(b"x-content-type-options: nosniff") >= len(statuses)
    assert is_local or shows or SECRET not in heard, "shown to a stranger"


def seeds() -> Iterator[bytes]:
    """Yield each path with a token, a session, a wrong token and none, log-ins, and what is malformed."""
    paths = (
        *ASKING_PATHS,
        "/tables/x",
        "/tables/x.svg",
        "/page/page.js",
        "/events?status",
        "/status?x=%2e%2e",
        "/reload",
    )
    for path in paths:
        name = path.replace("NAME", "x").encode()
        for shown in (
            b"",
            b"Authorization: Bearer " + TOKEN.encode() + b"\r\n",
            b"Cookie: a=b; " + COOKIE.encode() + b"=SESSION\r\n",
            b"Authorization: Bearer " + WRONG.encode() + b"\r\n",
        ):
            yield b"\x00GET " + name + b" HTTP/1.1\r\nHost: localhost:8480\r\n" + shown + b"\r\n"
        yield b"\x31HEAD " + name + b" HTTP/1.0\r\nHost: localhost\r\n\r\n"
    for body in (
        b'{"token": "%s"}' % TOKEN.encode(),
        b'{"token": 1}',
        b'{"token": "%s", "a": []}' % WRONG.encode(),
    ):
        head = b"POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        head += b"Content-Length: %d\r\n\r\n"
        yield b"\x20" + head % len(body) + body
        yield b"\x20" + head % (len(body) + 9) + body
        yield b"\x20" + head % len(body) + body + b"GET /session HTTP/1.1\r\nHost: localhost\r\n\r\n"
    for kind in (b"\x00", b"\x01"):
        yield kind + b"POST /reload HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n"
        yield (
            kind
            + b"POST /logout HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\nCookie: "
            + COOKIE.encode()
            + (b"=SESSION\r\nSec-Fetch-Site: same-origin\r\n\r\n")
        )
        yield (
            kind
            + b"GET / HTTP/1.1\r\nHost: a.example\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n0\r\n\r\n"
        )
        yield kind + b"GET /events?status HTTP/1.1\r\nHost: localhost\r\n\r\n3\r\nabc\r\n0\r\n\r\n"
        yield kind + b"GET /status HTTP/1.1\r\nHost: localhost\r\n\r\n" * 3
        yield kind + b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"


def words() -> Iterator[bytes]:
    """Yield what stands in requests."""
    names = (
        "Host",
        "Origin",
        "Cookie",
        "Authorization",
        "Bearer",
        "Content-Length",
        "Content-Type",
        "Expect",
    )
    values = (
        "Transfer-Encoding",
        "Sec-Fetch-Site",
        "If-None-Match",
        "Last-Event-ID",
        "application/json",
        "100-continue",
    )
    for word in (
        *names,
        *values,
        *ASKING_PATHS,
        "POST",
        "HEAD",
        "OPTIONS",
        "HTTP/1.1",
        "SESSION",
        TOKEN,
        "Accept",
    ):
        yield word.encode()
