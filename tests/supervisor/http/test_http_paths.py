"""What is there to ask for, and requests that are wrong, hostile or endless."""

import asyncio
import json
import logging
import resource
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from gateway.config.problems import Problem
from gateway.supervisor import page
from gateway.supervisor.http import listener
from gateway.supervisor.http.answers import Limits
from gateway.supervisor.outcome import ReloadOutcome
from gateway.supervisor.past import Noted
from tests.supervisor.http.http_bench import (
    EVENTS,
    PATIENCE_S,
    STATUS,
    WELL,
    Served,
    large_model,
    model,
    serving,
    snapshot,
)
from tests.support.status_models import model_of

CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
PATHS = [
    "/",
    "/status",
    "/healthz",
    "/metrics",
    "/events",
    "/tables/NAME",
    "/history/NAME",
    "/frames/NAME",
    "/page/NAME",
    "/session",
]


async def test_the_status_is_the_newest_model(served: Served) -> None:
    none = await served.ask("/status")
    assert (none.status, none.data) == (
        503,
        {"problem": "nothing is known yet: the supervisor has just started"},
    )
    served.broadcast.publish(model_of(model(snapshot(axis={"correction": float("nan")}))))
    assert (await served.ask("/status")).data["axes"]["x"]["correction"] is None  # JSON has no NaN
    served.broadcast.publish(model_of(newest := model(snapshot(axis={"correction": 0.25}))))
    for is_local in (False, True):
        some = await served.ask("/status", is_local=is_local)
        assert (some.status, some.data) == (200, json.loads(json.dumps(newest)))
        assert some.headers["cache-control"] == "no-store"
        assert some.headers["content-security-policy"] == CSP
        assert some.headers["x-content-type-options"] == "nosniff"
        assert some.headers["date"].endswith(" GMT")
        assert "server" not in some.headers


async def test_a_head_request_gets_the_same_without_the_body(showing: Served) -> None:
    whole = await showing.ask("/status")
    head = await showing.ask("/status", "HEAD")
    assert (head.status, head.headers["content-length"]) == (200, str(len(whole.body)))
    events = await showing.ask("/events", "HEAD")
    assert (events.status, events.headers["content-type"]) == (200, "text/event-stream; charset=utf-8")


@pytest.mark.parametrize(
    ("newest", "reasons"),
    [
        (None, ["nothing is known yet: the supervisor has just started"]),
        (model(age_s=None), ["nothing is known yet: the supervisor has just started"]),
        (model(is_relay_up=False), ["gateway: the relay is not running: no command reaches a drive"]),
        (model(age_s=2.5), ["gateway: the relay has reported nothing for 2 s: the machine may not obey"]),
        (
            model(snapshot(line={"state": "down"})),
            ["line xyz: the drives at 127.0.0.1:502 cannot be reached"],
        ),
    ],
    ids=["no model", "no snapshot", "relay down", "stale", "line down"],
)
async def test_health_fails_when_commands_do_not_reach_the_drives(
    served: Served, newest: dict[str, object] | None, reasons: list[str]
) -> None:
    if newest is not None:
        served.broadcast.publish(model_of(newest))
    ill = await served.ask("/healthz")
    assert (ill.status, ill.data) == (503, {"problems": reasons})
    # A broker that is away, an axis that is not referenced: no reason to restart anything.
    unreferenced = model(
        snapshot(axis={"compensation": "unreferenced"}), supervisor={**WELL, "mqtt": {"problem": "refused"}}
    )
    served.broadcast.publish(model_of(unreferenced))
    well = await served.ask("/healthz")
    assert (well.status, well.body.decode().splitlines()) == (
        200,
        ["warning", "warning: axis x: not referenced: positions pass uncorrected", "warning: mqtt: refused"],
    )
    served.broadcast.publish(model_of(model()))
    assert (await served.ask("/healthz")).body == b"ok\n"


async def test_whoever_asks_for_something_else_is_told_what_there_is(served: Served) -> None:
    other = await served.ask("/nothing")
    assert (other.status, other.data) == (404, {"problem": "there is no /nothing", "there_is": PATHS})
    slash = await served.ask("/status/")
    assert slash.status == 404
    local = await served.ask("/nothing", is_local=True)
    assert local.data["there_is"] == [*PATHS, "/reload", "/journal/erase"]
    post = await served.ask("/status", "POST", is_local=True)
    assert (post.status, post.data["there_is"]) == (405, [*PATHS, "/reload", "/journal/erase"])
    assert set(post.headers["allow"].split(", ")) == {"GET", "HEAD"}


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "CONNECT", "TRACE", "BREW"])
async def test_over_tcp_nothing_but_reading_is_done(served: Served, method: str) -> None:
    for target in ("/reload", "/status"):
        refused = await served.ask(target, method)
        assert (refused.status, refused.headers["allow"]) == (405, "GET, HEAD")
        assert refused.data["there_is"] == PATHS
    assert (await served.ask("/reload")).status == 404
    assert served.reloads == 0


async def test_reload_over_the_local_socket_says_what_came_of_it(tmp_path: Path) -> None:
    bad = Problem("tables/y.tab", "axis.y.table", "found -", "allowed: a number", 3, 1)
    outcome = ReloadOutcome(
        comes={"x": "next-target"},
        gone=("z",),
        changed=("axis.x.gain",),
        problems=("no",),
        rejected={"y": (bad,)},
    )
    async with serving(tmp_path, outcome=outcome) as served:
        done = await served.ask("/reload", "POST", is_local=True)
        assert (done.status, done.data) == (
            200,
            {
                "comes": {"x": "next-target"},
                "gone": ["z"],
                "changed": ["axis.x.gain"],
                "problems": ["no"],
                "rejected": {
                    "y": [
                        {
                            "file": "tables/y.tab",
                            "line": 3,
                            "column": 1,
                            "key": "axis.y.table",
                            "found": "found -",
                            "remedy": "allowed: a number",
                        }
                    ]
                },
                "all_problems": ["no", "tables/y.tab:3:1: axis.y.table: found -; allowed: a number"],
                "is_running": True,
            },
        )
        assert served.reloads == 1
        looked = await served.ask("/reload", is_local=True)
        assert (looked.status, looked.headers["allow"]) == (405, "POST")
        assert served.reloads == 1


async def test_only_this_user_may_use_the_local_socket(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
        assert served.local.stat().st_mode & 0o777 == 0o600
    assert not served.local.exists()


async def test_the_page_is_a_fixed_list_of_files(served: Served) -> None:
    index = await served.ask("/")
    assert index.status == 200
    assert index.body == (Path(page.__file__).parent / "index.html").read_bytes()
    assert index.headers["content-type"] == "text/html; charset=utf-8"
    for name in page.FILES:
        one = await served.ask(f"/page/{name}")
        assert one.body == (Path(page.__file__).parent / name).read_bytes()
    same = await served.ask("/", "GET", f"If-None-Match: W/{index.headers['etag']}")
    assert (same.status, same.body) == (304, b"")
    assert (await served.ask("/", "GET", 'If-None-Match: "other"')).status == 200
    source = await served.ask("/page/__init__.py")
    assert (source.status, source.data["there_is"]) == (404, [f"/page/{name}" for name in page.FILES])


# Requests that are wrong, hostile or endless: each gets its answer, and costs what its limit says.


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
async def test_a_bad_path_is_answered_and_nothing_more(showing: Served, target: str, status: int) -> None:
    answer = await showing.ask(target)
    # A head that comes in one piece is whole, however long: then its target is what is too long.
    assert answer.status in ({status, 414} if status == 431 else {status})
    assert "problem" in answer.data
    assert len(answer.body) < 500
    assert (await showing.ask("/healthz")).status == 200


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
async def test_another_version_of_http_is_not_spoken(served: Served, data: bytes) -> None:
    line = await served.says(data)
    assert (await line.hear()).status == 505
    assert await line.rest() == b""


async def test_a_head_without_end_is_cut_off(served: Served) -> None:
    line = await served.says("GET / HTTP/1.1\r\nHost: localhost\r\n")
    for number in range(40):
        await line.say(f"X-{number}: {'a' * 500}\r\n")
        await asyncio.sleep(0)
    answer = await line.hear()
    assert (answer.status, answer.data) == (
        431,
        {"problem": "the head of a request may have at most 16384 bytes"},
    )


async def test_a_head_that_is_too_long_in_one_piece_is_refused_too(served: Served) -> None:
    answer = await served.ask("/status", "GET", f"X: {'a' * 17_000}")
    assert (answer.status, answer.data) == (
        431,
        {"problem": "the head of a request may have at most 16384 bytes"},
    )


async def test_bodies_are_small_and_have_a_length(served: Served) -> None:
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
    showing: Served, host: str, status: int
) -> None:
    assert (await showing.ask("/status", host=host)).status == status
    # Whoever is on this machine calls its socket what he likes.
    assert (await showing.ask("/status", host=host, is_local=True)).status == 200


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
    showing: Served, head: str, status: int
) -> None:
    line = await showing.says(f"{head}\r\n\r\n")
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
async def test_a_thousand_idle_connections_keep_nobody_out(showing: Served) -> None:
    reader = await showing.says(EVENTS)
    await reader.until(b"event: status\n")
    idle = [await showing.connect() for _ in range(1000)]
    assert (await showing.ask("/healthz")).status == 200
    assert (await showing.ask("/healthz", is_local=True)).status == 200
    # The first ones had to go; the last ones, and whoever reads, are still there.
    assert await idle[0].rest() == b""
    assert await idle[700].rest() == b""
    await idle[999].say("GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert (await idle[999].hear()).status == 200
    await reader.until(b"\n\n")
    showing.broadcast.publish(model_of(model(age_s=0.7)))
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
        assert (refused.status, refused.data) == (503, {"problem": "too many connections; try again later"})
        readers[1].close()
        async with asyncio.timeout(PATIENCE_S):
            while (await served.ask("/metrics")).status == 503:
                pass


# ``/history/AXIS``, as JSON and as CSV, for a chosen span.


MAY_S = 1_777_636_800.0
"""2026-05-01T12:00:00Z."""


async def of_x(axis: str, span_s: float) -> Sequence[Noted] | None:
    if axis != "x":
        return None
    now_s = time.time()
    return [Noted(now_s - span_s, -120.5, 0.0221, "active"), Noted(now_s, None, None, "unreferenced")]


@pytest.mark.parametrize(("query", "age_s"), [("", 600.0), ("?minutes=1", 60.0), ("?minutes=1440", 86_400.0)])
async def test_the_past_of_an_axis(tmp_path: Path, query: str, age_s: float) -> None:
    async with serving(tmp_path, history=of_x, newest=model()) as served:
        told = (await served.ask(f"/history/x{query}")).data
        assert told["axis"] == "x"
        assert told["ages_s"][0] == pytest.approx(age_s, abs=30.0)
        assert (told["nominal"], told["correction"]) == ([-120.5, None], [0.0221, None])


async def test_as_csv(tmp_path: Path) -> None:
    async def at_noon(_axis: str, _span_s: float) -> Sequence[Noted]:
        return [Noted(MAY_S, -120.5, 0.0221, "active"), Noted(MAY_S + 10, None, None, "unreferenced")]

    async with serving(tmp_path, history=at_noon, newest=model()) as served:
        answer = await served.ask("/history/x.csv?minutes=60")
        assert answer.status == 200
        assert answer.headers["content-type"].startswith("text/csv; charset=utf-8")
        named = answer.headers["content-disposition"]
        assert named.startswith('attachment; filename="x-20')
        assert named.endswith('Z.csv"')
        assert answer.body.decode() == (
            "time,nominal_mm,correction_mm,compensation\r\n"
            "2026-05-01T12:00:00Z,-120.500000,0.0221000,active\r\n"
            "2026-05-01T12:00:10Z,,,unreferenced\r\n"
        )


@pytest.mark.parametrize("minutes", ["0", "1441", "-1", "ten", "", "1.5", "9" * 5000])
async def test_a_span_that_is_none(tmp_path: Path, minutes: str) -> None:
    async with serving(tmp_path, history=of_x, newest=model()) as served:
        answer = await served.ask(f"/history/x?minutes={minutes}")
        assert answer.status in {400, 414}
        assert len(answer.body) < 1000


async def test_an_axis_that_there_is_not(tmp_path: Path) -> None:
    async with serving(tmp_path, history=of_x, newest=model()) as served:
        for name, there in (("y", "/history/x"), ("y.csv", "/history/x.csv"), ("..%2Fx", "/history/x")):
            answer = await served.ask(f"/history/{name}")
            assert answer.status == 404
            if "%" not in name:
                assert answer.data["there_is"] == [there]
