"""Who may look: by a token, by a session that a token was shown for; and how soon not any more."""

import json
from pathlib import Path

import pytest

from tests.supervisor.http.doors import OTHER, TOKEN, WRONG, Asking, asking, bearer, write_token
from tests.supervisor.http.http_bench import until
from tests.support.status_models import model_of

CLOSED = ["/status", "/metrics", "/events", "/tables/x", "/tables/x.svg", "/page/page.js", "/session", "/no"]


@pytest.mark.parametrize("target", CLOSED)
async def test_nobody_looks_without_a_token(tmp_path: Path, target: str) -> None:
    async with asking(tmp_path) as visitor:
        answer = await visitor.ask(target)
        assert answer.status == 401
        assert answer.headers["www-authenticate"] == 'Bearer realm="pitch-gateway"'
        assert answer.data.keys() == {"problem"}
        assert (await visitor.ask(target, bearer(WRONG))).status == 401


async def test_whoever_shows_the_token_looks(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        status = await visitor.ask("/status", bearer(TOKEN))
        assert (status.status, status.data["gateway"]["name"]) == (200, "mill-1")
        assert (
            b"pitch_gateway_relay_up 1"
            in (await visitor.ask("/metrics", f"authorization: BEARER {TOKEN}")).body
        )
        assert (await visitor.ask("/session", bearer(TOKEN))).data == {
            "by": "people",
            "how": "token",
            "ends_in_s": None,
            "may_acknowledge": False,
        }
        assert (await visitor.ask("/", bearer(TOKEN))).body.count(b"page/page.js") == 1


@pytest.mark.parametrize(
    "shown",
    [
        TOKEN[:-1],
        TOKEN + "x",
        TOKEN.upper(),
        f"{TOKEN} {TOKEN}",
        "",
        f"{TOKEN}\r\n{bearer(TOKEN)}",
        f"{TOKEN}\r\n{bearer(WRONG)}",
    ],
)
async def test_what_is_only_like_the_token_is_none(tmp_path: Path, shown: str) -> None:
    async with asking(tmp_path) as visitor:
        assert (await visitor.ask("/status", bearer(shown))).status == 401


async def test_a_token_in_the_address_counts_for_nothing(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        for target in (f"/status?token={TOKEN}", f"/status?access_token={TOKEN}", f"/status/{TOKEN}"):
            assert (await visitor.ask(target)).status == 401


async def test_strangers_see_the_page_that_asks_and_whether_all_is_well(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        index = await visitor.ask("/")
        assert (index.status, index.headers["cache-control"]) == (401, "no-store")
        assert b'<form id="form"' in index.body
        assert index.headers["content-security-policy"].startswith("default-src 'none'; script-src 'self'")
        for name in ("page.css", "login.css", "login.js", "theme.js", "icon.svg"):
            assert f"page/{name}".encode() in index.body or name == "icon.svg"
            assert (await visitor.ask(f"/page/{name}")).status == 200
        well = await visitor.ask("/healthz")
        assert (well.status, well.body) == (200, b"ok\n")
        visitor.served.broadcast.publish(model_of({"gateway": {"relay": "up", "snapshot_age_s": None}}))
        ill = await visitor.ask("/healthz")
        assert (ill.status, ill.data) == (503, {"problem": "not well; show a token to see why"})
        assert "problems" in (await visitor.ask("/healthz", bearer(TOKEN))).data


async def test_whoever_names_nobody_shows_a_token_all_the_same(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        for head, status in (
            ("GET /healthz HTTP/1.0", b"200"),
            ("GET /metrics HTTP/1.0", b"401"),
            (f"GET /metrics HTTP/1.0\r\n{bearer(WRONG)}", b"401"),
            (f"GET /metrics HTTP/1.0\r\n{bearer(TOKEN)}", b"200"),
            (f"GET /status HTTP/1.0\r\n{bearer(TOKEN)}", b"421"),
        ):
            line = await visitor.served.says(f"{head}\r\n\r\n")
            assert (await line.rest()).split(b" ", 2)[1] == status


async def test_the_unix_socket_asks_nobody(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        for target in ("/status", "/metrics", "/session"):
            assert (await visitor.served.ask(target, is_local=True)).status == 200
        assert (await visitor.served.ask("/login", is_local=True)).status == 404
        assert (await visitor.served.ask("/reload", "POST", is_local=True)).status == 200


async def test_nothing_is_changed_over_tcp_with_a_token_either(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        for target in ("/reload", "/status", "/tables/x"):
            assert (await visitor.ask(target, bearer(TOKEN), method="POST")).status in {404, 405}
        assert visitor.served.reloads == 0


async def test_a_session_is_opened_for_a_token_and_closed(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        answer = await visitor.log_in()
        assert (answer.status, answer.data) == (200, {"by": "people"})
        cookie, *marks = answer.headers["set-cookie"].split("; ")
        name, _, value = cookie.partition("=")
        assert name == f"pitch-gateway-mill-1-{visitor.served.port}"
        assert len(value) == 43  # 256 bits in base64
        assert marks == ["Path=/", "Max-Age=43200", "HttpOnly", "SameSite=Strict"]
        shown = f"Cookie: theme=dark; {cookie}"
        assert (await visitor.ask("/status", shown)).status == 200
        assert b"page/page.js" in (await visitor.ask("/", shown)).body
        session = (await visitor.ask("/session", shown)).data
        assert (session["by"], session["how"]) == ("people", "session")
        assert 43_000 < session["ends_in_s"] <= 43_200
        out = await visitor.ask("/logout", shown, method="POST")
        assert out.headers["set-cookie"].startswith(f"{name}=; Path=/; Max-Age=0; ")
        assert (await visitor.ask("/status", shown)).status == 401


async def test_a_login_that_is_broken_off_is_no_mistake_of_ours(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        line = await visitor.connect()
        head = "POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        await line.say(f"{head}Content-Length: 61\r\n\r\n{{")
        line.close()
        await until(lambda: visitor.served.connections() == 0)
        assert (await visitor.log_in()).status == 200
        assert visitor.events("http-failed") == []


async def test_two_logins_are_two_sessions(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        one, other = await visitor.cookie(), await visitor.cookie()
        assert one != other
        await visitor.ask("/logout", one, method="POST")
        assert (await visitor.ask("/status", other)).status == 200


@pytest.mark.parametrize(
    ("body", "kind", "status"),
    [
        (json.dumps({"token": WRONG}), "application/json", 401),
        (json.dumps({"token": TOKEN}), "text/plain", 415),
        (f"token={TOKEN}", "application/x-www-form-urlencoded", 415),
        (json.dumps({"token": [TOKEN]}), "application/json", 400),
        (json.dumps({"token": TOKEN, "more": 1}), "application/json", 400),
        (json.dumps(TOKEN), "application/json", 400),
        ("[" * 4000, "application/json", 400),
        ("{", "application/json", 400),
        ('{"token": "\\ud800"}', "application/json", 401),
        ("x" * 5000, "application/json", 413),
    ],
)
async def test_bodies_that_open_no_session(tmp_path: Path, body: str, kind: str, status: int) -> None:
    async with asking(tmp_path) as visitor:
        answer = await visitor.ask("/login", f"Content-Type: {kind}", method="POST", body=body)
        assert answer.status == status
        assert "set-cookie" not in answer.headers
        assert TOKEN not in answer.body.decode()


@pytest.mark.parametrize(
    ("sent", "status"),
    [
        ("Sec-Fetch-Site: same-origin", 200),
        ("Sec-Fetch-Site: cross-site", 403),
        ("Sec-Fetch-Site: same-site", 403),
        ("Sec-Fetch-Site: none", 403),
        ("Origin: http://localhost", 200),
        ("Origin: http://evil.example", 403),
        ("Origin: null", 403),
    ],
)
async def test_only_the_own_page_logs_in(tmp_path: Path, sent: str, status: int) -> None:
    async with asking(tmp_path) as visitor:
        answer = await visitor.log_in(TOKEN, sent)
        assert answer.status == status
        refused = [{"peer": "127.0.0.1", "detail": "a page of another site may not request this", "times": 1}]
        assert visitor.events("http-refused") == ([] if status == 200 else refused)


async def rotated(visitor: Asking) -> str:
    """Log in, and put another token into the file; returns the cookie of before."""
    cookie = await visitor.cookie()
    assert (await visitor.ask("/status", cookie)).status == 200
    write_token(visitor.folder, OTHER)
    return cookie


async def test_another_token_in_the_file_holds_at_once_and_ends_what_the_old_one_opened(
    tmp_path: Path,
) -> None:
    async with asking(tmp_path) as visitor:
        cookie = await rotated(visitor)
        assert (await visitor.ask("/status", cookie)).status == 401
        assert (await visitor.ask("/status", bearer(TOKEN))).status == 401
        assert (await visitor.ask("/status", bearer(OTHER))).status == 200
        write_token(visitor.folder, TOKEN)  # and back: the session stays over
        assert (await visitor.ask("/status", bearer(TOKEN))).status == 200
        assert (await visitor.ask("/status", cookie)).status == 401


@pytest.mark.parametrize("is_session", [True, False])
async def test_whoever_reads_the_events_is_out_when_his_token_is(tmp_path: Path, is_session: bool) -> None:
    async with asking(tmp_path) as visitor:
        shown = await visitor.cookie() if is_session else bearer(TOKEN)
        line = await visitor.says(
            f"GET /events HTTP/1.1\r\nHost: localhost\r\n{shown}\r\nConnection: close\r\n\r\n"
        )
        await line.until(b"event: status\n")
        write_token(visitor.folder, OTHER)
        assert (await line.rest()).endswith(b"0\r\n\r\n")  # a whole answer


async def test_whoever_reads_the_events_is_out_when_he_logs_out(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        shown = await visitor.cookie()
        line = await visitor.says(
            f"GET /events HTTP/1.1\r\nHost: localhost\r\n{shown}\r\nConnection: close\r\n\r\n"
        )
        await line.until(b"event: status\n")
        await visitor.ask("/logout", shown, method="POST")
        assert (await line.rest()).endswith(b"0\r\n\r\n")


@pytest.mark.parametrize("harm", ["gone", "short", "open"])
async def test_a_token_that_cannot_be_used_lets_nobody_in_and_is_a_problem(tmp_path: Path, harm: str) -> None:
    async with asking(tmp_path) as visitor:
        cookie = await visitor.cookie()
        path = tmp_path / "people.token"
        if harm == "gone":
            path.unlink()
        elif harm == "short":
            path.write_text("")
        else:
            path.chmod(0o644)
        for shown in (cookie, bearer(TOKEN), "Authorization: Bearer"):
            assert (await visitor.ask("/status", shown)).status == 401
        problem = str(visitor.served.service.status.problem)
        assert problem.startswith('token "people": http.tokens[1].file: ')
        assert [event["detail"] for event in visitor.events("token-unusable")] == [
            f"{problem}; it is refused"
        ]
        write_token(tmp_path, OTHER)
        assert (await visitor.ask("/status", bearer(OTHER))).status == 200
        assert visitor.served.service.status.problem is None


async def test_what_somebody_says_of_tokens_is_in_no_event(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
        await visitor.ask("/status", bearer(WRONG))
        await visitor.log_in(WRONG)
        cookie = await visitor.cookie()
        await visitor.event("token-refused")
        said = json.dumps(visitor.served.said) + str(visitor.served.service.status)
        assert all(secret not in said for secret in (TOKEN, WRONG, cookie.partition("=")[2]))
