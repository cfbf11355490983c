"""Requests that are wrong, hostile or endless: each gets its answer, and costs what its limit says."""

import asyncio
import logging
import resource
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.supervisor.http import listener
from gateway.supervisor.http.answers import Limits
from tests.supervisor.http.http_bench import EVENTS, PATIENCE_S, STATUS, large_model, model, serving
from tests.support.status_models import model_of

BAD_PATHS = [
    ("/tables/../../etc/passwd", 404),
    ("/tables/..%2f..%2fetc%2fpasswd", 404),
    ("/tables/%2e%2e", 404),
    ("/page/../__init__.py", 404),
    ("/page/%2e%2e%2fsupervisor.py", 404),
    ("/tables/%00", 404),
    ("/tables/x%00.svg", 404),
    ("/tables/%ff%fe", 404),
    ("/tables/%", 404),
    ("/tables/%zz", 404),
    ("//status", 404),
    ("/status%20", 404),
    ("/tables/", 404),
    ("http://elsewhere/status", 404),
    ("*", 404),
    ("/tables/x?points=-1", 400),
    ("/tables/x?points=9", 400),
    ("/tables/x?points=10001", 400),
    ("/tables/x?points=1e3", 400),
    ("/tables/x?points=" + "9" * 100, 400),
    ("/tables/x?points=%d9%a1%d9%a2", 400),
    ("/tables/" + "a" * 4100, 414),
    ("/status?" + "a" * 4100, 414),
    ("/" + "a" * 100_000, 431),
]


@pytest.mark.parametrize(("target", "status"), BAD_PATHS, ids=[target[:40] for target, _ in BAD_PATHS])
async def test_a_bad_path_is_answered_and_nothing_more(tmp_path: Path, target: str, status: int) -> None:
    async with serving(tmp_path, newest=model()) as served:
        answer = await served.ask(target)
        # A head that comes in one piece is whole, however long: then its target is what is too long.
        assert answer.status in ({status, 414} if status == 431 else {status})
        assert "problem" in answer.data
        assert len(answer.body) < 500
        assert (await served.ask("/healthz")).status == 200


NONSENSE = [
    b"\r\n\r\n\r\nnonsense\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",  # a TLS handshake
    b"GET / HTTP/1.1\r\n\r\n",  # without Host
    b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: -1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n",
    b"GET /\x00 HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET /\xc3\xa4 HTTP/1.1\r\nHost: localhost\r\n\r\n",
]


@pytest.mark.parametrize("data", NONSENSE)
async def test_what_is_no_request_is_told_so_and_closed(
    tmp_path: Path, data: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    async with serving(tmp_path) as served:
        line = await served.says(data)
        answer = await line.hear()
        assert answer.status == 400
        assert "problem" in answer.data
        assert await line.rest() == b""
    assert [record for record in caplog.records if record.levelno >= logging.WARNING] == []


async def test_whoever_talks_nonsense_and_stays_is_dropped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listener, "LEAVING_S", 0.05)
    async with serving(tmp_path, tcp=Limits(sweep_s=0.01)) as served:
        line = await served.says("nonsense\r\n\r\n")
        assert (await line.hear()).status == 400
        async with asyncio.timeout(PATIENCE_S):
            while not line.writer.transport.is_closing():
                line.writer.write(b"x")
                await asyncio.sleep(0.001)


@pytest.mark.parametrize("data", [b"GET / HTTP/9.9\r\n\r\n", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"])
async def test_another_version_of_http_is_not_spoken(tmp_path: Path, data: bytes) -> None:
    async with serving(tmp_path) as served:
        line = await served.says(data)
        assert (await line.hear()).status == 505
        assert await line.rest() == b""


async def test_a_head_without_end_is_cut_off(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
        line = await served.says("GET / HTTP/1.1\r\nHost: localhost\r\n")
        for number in range(40):
            await line.say(f"X-{number}: {'a' * 500}\r\n")
            await asyncio.sleep(0)
        answer = await line.hear()
        assert (answer.status, answer.data) == (
            431,
            {"problem": "the head of a request may have at most 16384 bytes"},
        )


async def test_a_head_that_is_too_long_in_one_piece_is_refused_too(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
        answer = await served.ask("/status", "GET", f"X: {'a' * 17_000}")
        assert (answer.status, answer.data) == (
            431,
            {"problem": "the head of a request may have at most 16384 bytes"},
        )


async def test_bodies_are_small_and_have_a_length(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
        large = await served.ask("/reload", "POST", "Content-Length: 4097", is_local=True)
        assert (large.status, large.data) == (413, {"problem": "a body may have at most 4096 bytes"})
        endless = await served.ask("/reload", "POST", "Transfer-Encoding: chunked", is_local=True)
        assert endless.status == 411
        assert served.reloads == 0
        line = await served.says(
            "POST /reload HTTP/1.1\r\nHost: a\r\nContent-Length: 4096\r\n\r\n" + "a" * 4096, is_local=True
        )
        assert (await line.hear()).status == 200


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost", 200),
        ("LOCALHOST:8480", 200),
        ("127.0.0.1:1", 200),
        ("[::1]:8480", 200),
        ("evil.example", 421),
        ("evil.example:8480", 421),
        ("localhost:8480@evil.example", 421),
        ("[::1]evil.example", 421),
        ("127.0.0.1.evil.example", 421),
        ("192.168.0.7", 421),
        ("", 421),
        ("[", 421),
    ],
)
async def test_a_name_that_somebody_bent_to_this_machine_is_refused(
    tmp_path: Path, host: str, status: int
) -> None:
    async with serving(tmp_path, newest=model()) as served:
        assert (await served.ask("/status", host=host)).status == status
        # Whoever is on this machine calls its socket what he likes.
        assert (await served.ask("/status", host=host, is_local=True)).status == 200


@pytest.mark.parametrize(
    ("head", "status"),
    [
        ("GET /healthz HTTP/1.0", 200),
        ("GET /metrics HTTP/1.0", 200),
        ("HEAD /healthz HTTP/1.0", 200),
        ("GET /healthz?verbose HTTP/1.0", 200),
        ("GET /healthz HTTP/1.0\r\nHost: localhost", 200),
        ("GET /healthz HTTP/1.0\r\nHost: evil.example", 421),
        ("GET /metrics HTTP/1.0\r\nHost: evil.example", 421),
        ("GET /healthz HTTP/1.0\r\nHost:", 421),
        ("GET /healthz HTTP/1.1", 400),
        ("POST /healthz HTTP/1.0", 405),
        ("GET /status HTTP/1.0", 421),
        ("GET /events HTTP/1.0", 421),
        ("GET / HTTP/1.0", 421),
        ("GET /healthz/ HTTP/1.0", 421),
        ("GET //healthz HTTP/1.0", 421),
        ("GET http://evil.example/healthz HTTP/1.0", 421),
    ],
)
async def test_programs_that_name_nobody_may_ask_whether_all_is_well(
    tmp_path: Path, head: str, status: int
) -> None:
    async with serving(tmp_path, newest=model()) as served:
        line = await served.says(f"{head}\r\n\r\n")
        assert (await line.rest()).split(b" ", 2)[1] == str(status).encode()


async def test_a_request_that_never_becomes_whole_is_dropped(tmp_path: Path) -> None:
    limits = Limits(whole_request_s=0.2, sweep_s=0.01)
    async with serving(tmp_path, tcp=limits, newest=model()) as served:
        silent, slow, body, second = [await served.connect() for _ in range(4)]
        await slow.say("GET /status HTTP/1.1\r\n")
        await body.say("GET /status HTTP/1.1\r\nHost: localhost\r\nContent-Length: 10\r\n\r\nabc")
        await second.say("GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert (await second.hear()).status == 200
        await second.say("GET")
        assert await silent.rest() == b""
        assert await slow.rest() == b""
        assert (await body.hear()).status == 200  # it was not needed
        assert await body.rest() == b""
        assert await second.rest() == b""


async def test_a_reader_of_events_is_not_asked_for_another_request(tmp_path: Path) -> None:
    limits = Limits(whole_request_s=0.05, heartbeat_s=0.02, sweep_s=0.01)
    async with serving(tmp_path, tcp=limits) as served:
        reader = await served.says(EVENTS)
        await reader.until(*[b": nothing new\n\n"] * 10)


async def test_an_idle_connection_is_closed_after_a_while(tmp_path: Path) -> None:
    async with serving(tmp_path, tcp=Limits(keep_alive_s=1), newest=model()) as served:
        line = await served.connect()
        for _ in range(2):
            await line.say("GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert (await line.hear()).status == 200
        assert await line.rest() == b""


@pytest.fixture
def many_files() -> Iterator[None]:
    """Both ends of a thousand connections are this process's: more than a person's session may open."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 8192)), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.usefixtures("many_files")
async def test_a_thousand_idle_connections_keep_nobody_out(tmp_path: Path) -> None:
    async with serving(tmp_path, newest=model()) as served:
        reader = await served.says(EVENTS)
        await reader.until(b"event: status\n")
        idle = [await served.connect() for _ in range(1000)]
        assert (await served.ask("/healthz")).status == 200
        assert (await served.ask("/healthz", is_local=True)).status == 200
        # The first ones had to go; the last ones, and whoever reads, are still there.
        assert await idle[0].rest() == b""
        assert await idle[700].rest() == b""
        await idle[999].say("GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert (await idle[999].hear()).status == 200
        await reader.until(b"\n\n")
        served.broadcast.publish(model_of(model(age_s=0.7)))
        assert b'"snapshot_age_s":0.7' in await reader.until(b"event: status\n", b"\n\n")


async def test_who_takes_nothing_of_his_answers_keeps_nobody_out(tmp_path: Path) -> None:
    async with serving(tmp_path, tcp=Limits(connections=3)) as served:
        served.broadcast.publish(large_model())
        for _ in range(3):
            line = await served.connect()
            line.writer.transport.pause_reading()  # type: ignore[attr-defined]
            # The second one is being answered for as long as the first has not been taken.
            await line.say(STATUS * 2)
        async with asyncio.timeout(PATIENCE_S):  # less than the 30 s after which they are dropped anyway
            while (await served.ask("/metrics")).status == 503:
                pass
        assert served.connections() <= 3


async def test_where_nobody_is_idle_the_next_one_is_refused(tmp_path: Path) -> None:
    async with serving(tmp_path, tcp=Limits(connections=3, event_readers=3)) as served:
        readers = [await served.connect() for _ in range(3)]
        for reader in readers:
            await reader.say(EVENTS)
            await reader.until(b"retry: 2000\n\n")
        refused = await (await served.connect()).hear()
        assert (refused.status, refused.data) == (
            503,
            {"problem": "too many connections; try again later"},
        )
        readers[1].close()
        async with asyncio.timeout(PATIENCE_S):
            while (await served.ask("/metrics")).status == 503:
                pass
