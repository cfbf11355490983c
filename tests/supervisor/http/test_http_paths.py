"""What each path answers, on both listeners."""

import json
from pathlib import Path

import pytest

from gateway.config.problems import Problem
from gateway.supervisor import page
from gateway.supervisor.outcome import ReloadOutcome
from tests.supervisor.http.http_bench import WELL, model, serving, snapshot
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


async def test_the_status_is_the_newest_model(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
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


async def test_a_head_request_gets_the_same_without_the_body(tmp_path: Path) -> None:
    async with serving(tmp_path, newest=model()) as served:
        whole = await served.ask("/status")
        head = await served.ask("/status", "HEAD")
        assert (head.status, head.headers["content-length"]) == (200, str(len(whole.body)))
        events = await served.ask("/events", "HEAD")
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
    tmp_path: Path, newest: dict[str, object] | None, reasons: list[str]
) -> None:
    async with serving(tmp_path) as served:
        if newest is not None:
            served.broadcast.publish(model_of(newest))
        ill = await served.ask("/healthz")
        assert (ill.status, ill.data) == (503, {"problems": reasons})
        # A broker that is away, an axis that is not referenced: no reason to restart anything.
        unreferenced = model(
            snapshot(axis={"compensation": "unreferenced"}),
            supervisor={**WELL, "mqtt": {"problem": "refused"}},
        )
        served.broadcast.publish(model_of(unreferenced))
        well = await served.ask("/healthz")
        assert (well.status, well.body.decode().splitlines()) == (
            200,
            [
                "warning",
                "warning: axis x: not referenced: positions pass uncorrected",
                "warning: mqtt: refused",
            ],
        )
        served.broadcast.publish(model_of(model()))
        assert (await served.ask("/healthz")).body == b"ok\n"


async def test_whoever_asks_for_something_else_is_told_what_there_is(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
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
async def test_over_tcp_nothing_but_reading_is_done(tmp_path: Path, method: str) -> None:
    async with serving(tmp_path) as served:
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


async def test_the_page_is_a_fixed_list_of_files(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
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
