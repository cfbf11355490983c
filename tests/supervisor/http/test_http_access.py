"""Who may look, who may acknowledge, and what wrong tries cost."""

import json
from collections.abc import AsyncIterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from gateway.catalogue.alarms import DRIVE_SILENT
from gateway.catalogue.entry import EventEntry, Severity
from gateway.catalogue.publishing_events import TOKEN_REFUSED
from gateway.config.http_model import TokenSection
from gateway.status.model import AcknowledgedBy
from gateway.supervisor.acknowledged import AlarmAcknowledgement
from gateway.supervisor.active_alarms import Alarm
from gateway.supervisor.http import login, refusals
from gateway.supervisor.http.login import Authenticator, Sessions, Tokens, Visitor
from gateway.supervisor.http.refusals import HttpRefusals, WrongTries
from gateway.supervisor.recent_history import RecentHistory
from tests.supervisor.http.doors import (
    OTHER,
    TOKEN,
    WRONG,
    Asking,
    asking,
    bearer,
    make_certificates,
    write_token,
)
from tests.supervisor.http.http_bench import Answer, until
from tests.support.status_models import model_of

CLOSED = ["/status", "/metrics", "/events", "/tables/x", "/tables/x.svg", "/page/page.js", "/session", "/no"]


@pytest.fixture
async def visitor(tmp_path: Path) -> AsyncIterator[Asking]:
    """Somebody who asks a service that asks for a token."""
    async with asking(tmp_path) as visitor:
        yield visitor


@pytest.mark.parametrize("target", CLOSED)
async def test_nobody_looks_without_a_token(visitor: Asking, target: str) -> None:
    answer = await visitor.ask(target)
    assert answer.status == 401
    assert answer.headers["www-authenticate"] == 'Bearer realm="pitch-gateway"'
    assert answer.data.keys() == {"problem"}
    assert (await visitor.ask(target, bearer(WRONG))).status == 401


async def test_whoever_shows_the_token_looks(visitor: Asking) -> None:
    status = await visitor.ask("/status", bearer(TOKEN))
    assert (status.status, status.data["gateway"]["name"]) == (200, "mill-1")
    assert (
        b"pitch_gateway_relay_up 1" in (await visitor.ask("/metrics", f"authorization: BEARER {TOKEN}")).body
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
async def test_what_is_only_like_the_token_is_none(visitor: Asking, shown: str) -> None:
    assert (await visitor.ask("/status", bearer(shown))).status == 401


async def test_a_token_in_the_address_counts_for_nothing(visitor: Asking) -> None:
    for target in (f"/status?token={TOKEN}", f"/status?access_token={TOKEN}", f"/status/{TOKEN}"):
        assert (await visitor.ask(target)).status == 401


async def test_strangers_see_the_page_that_asks_and_whether_all_is_well(visitor: Asking) -> None:
    index = await visitor.ask("/")
    assert (index.status, index.headers["cache-control"]) == (401, "no-store")
    assert b'<form id="form"' in index.body
    assert b'type="password"' in index.body
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


async def test_whoever_names_nobody_shows_a_token_all_the_same(visitor: Asking) -> None:
    for head, status in (
        ("GET /healthz HTTP/1.0", b"200"),
        ("GET /metrics HTTP/1.0", b"401"),
        (f"GET /metrics HTTP/1.0\r\n{bearer(WRONG)}", b"401"),
        (f"GET /metrics HTTP/1.0\r\n{bearer(TOKEN)}", b"200"),
        (f"GET /status HTTP/1.0\r\n{bearer(TOKEN)}", b"421"),
    ):
        line = await visitor.served.says(f"{head}\r\n\r\n")
        assert (await line.rest()).split(b" ", 2)[1] == status


async def test_the_unix_socket_asks_nobody(visitor: Asking) -> None:
    for target in ("/status", "/metrics", "/session"):
        assert (await visitor.served.ask(target, is_local=True)).status == 200
    assert (await visitor.served.ask("/login", is_local=True)).status == 404
    assert (await visitor.served.ask("/reload", "POST", is_local=True)).status == 200


async def test_nothing_is_changed_over_tcp_with_a_token_either(visitor: Asking) -> None:
    for target in ("/reload", "/status", "/tables/x"):
        assert (await visitor.ask(target, bearer(TOKEN), method="POST")).status in {404, 405}
    assert visitor.served.reloads == 0


async def test_a_session_is_opened_for_a_token_and_closed(visitor: Asking) -> None:
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


async def test_a_login_that_is_broken_off_is_no_mistake_of_ours(visitor: Asking) -> None:
    line = await visitor.connect()
    head = "POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    await line.say(f"{head}Content-Length: 61\r\n\r\n{{")
    line.close()
    await until(lambda: visitor.served.connections() == 0)
    assert (await visitor.log_in()).status == 200
    assert visitor.events("http-failed") == []


async def test_two_logins_are_two_sessions(visitor: Asking) -> None:
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
async def test_bodies_that_open_no_session(visitor: Asking, body: str, kind: str, status: int) -> None:
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
async def test_only_the_own_page_logs_in(visitor: Asking, sent: str, status: int) -> None:
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
    visitor: Asking,
) -> None:
    cookie = await rotated(visitor)
    assert (await visitor.ask("/status", cookie)).status == 401
    assert (await visitor.ask("/status", bearer(TOKEN))).status == 401
    assert (await visitor.ask("/status", bearer(OTHER))).status == 200
    write_token(visitor.folder, TOKEN)  # and back: the session stays over
    assert (await visitor.ask("/status", bearer(TOKEN))).status == 200
    assert (await visitor.ask("/status", cookie)).status == 401


@pytest.mark.parametrize("is_session", [True, False])
async def test_whoever_reads_the_events_is_out_when_his_token_is(visitor: Asking, is_session: bool) -> None:
    shown = await visitor.cookie() if is_session else bearer(TOKEN)
    line = await visitor.says(
        f"GET /events HTTP/1.1\r\nHost: localhost\r\n{shown}\r\nConnection: close\r\n\r\n"
    )
    await line.until(b"event: status\n")
    write_token(visitor.folder, OTHER)
    assert (await line.rest()).endswith(b"0\r\n\r\n")  # a whole answer


async def test_whoever_reads_the_events_is_out_when_he_logs_out(visitor: Asking) -> None:
    shown = await visitor.cookie()
    line = await visitor.says(
        f"GET /events HTTP/1.1\r\nHost: localhost\r\n{shown}\r\nConnection: close\r\n\r\n"
    )
    await line.until(b"event: status\n")
    await visitor.ask("/logout", shown, method="POST")
    assert (await line.rest()).endswith(b"0\r\n\r\n")


@pytest.mark.parametrize("harm", ["gone", "short", "open"])
async def test_a_token_that_cannot_be_used_lets_nobody_in_and_is_a_problem(
    tmp_path: Path, visitor: Asking, harm: str
) -> None:
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
    assert [event["detail"] for event in visitor.events("token-unusable")] == [f"{problem}; it is refused"]
    write_token(tmp_path, OTHER)
    assert (await visitor.ask("/status", bearer(OTHER))).status == 200
    assert visitor.served.service.status.problem is None


async def test_what_somebody_says_of_tokens_is_in_no_event(visitor: Asking) -> None:
    await visitor.ask("/status", bearer(WRONG))
    await visitor.log_in(WRONG)
    cookie = await visitor.cookie()
    await visitor.event("token-refused")
    said = json.dumps(visitor.served.said) + str(visitor.served.service.status)
    assert all(secret not in said for secret in (TOKEN, WRONG, cookie.partition("=")[2]))


# Acknowledging an alarm: the one thing that can be changed over TCP, and who may.


NOON = datetime(2026, 5, 1, 12, tzinfo=UTC)
JSON = "Content-Type: application/json"
ALARM = {"kind": "drive-silent", "where": "axis x", "since": "2026-05-01T11:59:48+00:00"}
SEEN = {"by": "people", "at": "2026-05-01T12:00:00+00:00"}


class Alarms:
    """One drive that has been silent for 12 s at noon."""

    def __init__(self) -> None:
        self.recent = RecentHistory()
        self.silent = Alarm(DRIVE_SILENT, ("xyz", "1"), "axis x", "silent", ("x",), 12.0)
        self.recent.stamp([self.silent], NOON)

    def acknowledge(
        self, kind: str, where: str, since: str, by: str, _address: str
    ) -> AlarmAcknowledgement | None:
        return self.recent.acknowledge(kind, where, since, by, NOON)

    @property
    def seen(self) -> object:
        [told] = self.recent.stamp([self.silent], NOON)
        return told.acknowledged


async def acknowledge(visitor: Asking, *more: str, body: object = ALARM, client: str = "") -> Answer:
    return await visitor.ask("/acknowledge", *more, method="POST", body=json.dumps(body), client=client)


async def test_a_token_with_the_right_acknowledges_and_its_name_stands_there(tmp_path: Path) -> None:
    alarms = Alarms()
    async with asking(tmp_path, acknowledge=alarms.acknowledge) as visitor:
        assert (await visitor.ask("/session", bearer(TOKEN))).data["may_acknowledge"] is True
        answer = await acknowledge(visitor, bearer(TOKEN), JSON)
        assert (answer.status, answer.data) == (200, SEEN)
        assert alarms.seen == AcknowledgedBy(**SEEN)


async def test_so_does_a_session_of_it(tmp_path: Path) -> None:
    alarms = Alarms()
    async with asking(tmp_path, acknowledge=alarms.acknowledge) as visitor:
        cookie = await visitor.cookie()
        assert (await visitor.ask("/session", cookie)).data["may_acknowledge"] is True
        assert (await acknowledge(visitor, cookie, JSON, "Sec-Fetch-Site: same-origin")).data == SEEN
        assert alarms.seen == AcknowledgedBy(**SEEN)


async def test_a_token_that_may_look_only_does_not(visitor: Asking) -> None:
    answer = await acknowledge(visitor, bearer(TOKEN), JSON)
    assert answer.status == 403
    assert answer.data["problem"].startswith('"people" may only read; a token with acknowledge = true')
    assert (await visitor.ask("/session", bearer(TOKEN))).data["may_acknowledge"] is False


async def test_a_certificate_does_not_though_it_has_the_name_of_a_token(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    alarms = Alarms()
    async with asking(tmp_path, tmp_path, clients=True, acknowledge=alarms.acknowledge) as visitor:
        assert (await acknowledge(visitor, JSON, client="panel")).status == 403
        assert alarms.seen is None


@pytest.mark.parametrize(
    ("shown", "status"),
    [
        ((), 401),
        ((bearer(WRONG),), 401),
        ((bearer(TOKEN), "Sec-Fetch-Site: cross-site"), 403),
        ((bearer(TOKEN), "Sec-Fetch-Site: same-site"), 403),
        ((bearer(TOKEN), "Origin: http://evil.example"), 403),
        ((bearer(TOKEN), "Origin: null"), 403),
    ],
)
async def test_nobody_else_and_no_other_page_does(
    tmp_path: Path, shown: tuple[str, ...], status: int
) -> None:
    alarms = Alarms()
    async with asking(tmp_path, acknowledge=alarms.acknowledge) as visitor:
        assert (await acknowledge(visitor, *shown, JSON)).status == status
        assert alarms.seen is None


async def test_the_cookie_alone_does_nothing_for_a_page_from_elsewhere(tmp_path: Path) -> None:
    alarms = Alarms()
    async with asking(tmp_path, acknowledge=alarms.acknowledge) as visitor:
        cookie = await visitor.cookie()
        for more in (("Sec-Fetch-Site: cross-site",), ("Origin: http://evil.example",)):
            assert (await acknowledge(visitor, cookie, JSON, *more)).status == 403
        form = "Content-Type: application/x-www-form-urlencoded"
        assert (await acknowledge(visitor, cookie, form)).status == 415
        assert alarms.seen is None


async def test_a_name_that_leads_here_from_elsewhere_gets_no_answer(tmp_path: Path) -> None:
    alarms = Alarms()
    async with asking(tmp_path, acknowledge=alarms.acknowledge) as visitor:
        line = await visitor.connect()
        body = json.dumps(ALARM)
        head = f"POST /acknowledge HTTP/1.1\r\nHost: evil.example\r\n{bearer(TOKEN)}\r\n{JSON}\r\n"
        await line.say(f"{head}Content-Length: {len(body)}\r\n\r\n{body}")
        assert (await line.hear()).status == 421
        assert alarms.seen is None


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({**ALARM, "since": "2026-05-01T12:00:00+00:00"}, 404),
        ({**ALARM, "where": "axis y"}, 404),
        ({**ALARM, "by": "somebody"}, 400),
        ({"kind": "drive-silent"}, 400),
        ({**ALARM, "where": None}, 400),
        ([ALARM], 400),
    ],
)
async def test_what_is_no_alarm_of_now_is_not_acknowledged(tmp_path: Path, body: object, status: int) -> None:
    alarms = Alarms()
    async with asking(tmp_path, acknowledge=alarms.acknowledge) as visitor:
        assert (await acknowledge(visitor, bearer(TOKEN), JSON, body=body)).status == status
        assert alarms.seen is None


async def test_a_get_acknowledges_nothing(tmp_path: Path) -> None:
    alarms = Alarms()
    async with asking(tmp_path, acknowledge=alarms.acknowledge) as visitor:
        assert (await visitor.ask("/acknowledge", bearer(TOKEN))).status == 405
        assert alarms.seen is None


async def test_where_nobody_is_asked_nobody_has_a_name_and_nobody_acknowledges(tmp_path: Path) -> None:
    alarms = Alarms()
    async with asking(tmp_path, tokens=False, acknowledge=alarms.acknowledge) as visitor:
        assert (await acknowledge(visitor, JSON)).status == 405
        for is_local in (False, True):
            session = await visitor.served.ask("/session", is_local=is_local)
            assert session.data["may_acknowledge"] is False
        assert (await visitor.served.ask("/acknowledge", "POST", is_local=True)).status == 404
        assert alarms.seen is None


# Wrong tokens, sessions and refusals in numbers: all of it bounded, and all of it over some time.


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


class Gate:
    """Access with a clock of its own."""

    def __init__(self, folder: Path) -> None:
        write_token(folder, TOKEN)
        self.clock = Clock()
        self.said: list[tuple[str, Mapping[str, object]]] = []
        tokens = Tokens((TokenSection(name="people", file="people.token"),), folder, lambda why: None)
        self.refusals = HttpRefusals(self._say)
        self.sessions = Sessions()
        self.access = Authenticator(tokens, self.sessions, self.refusals, "pitch-gateway-1", self.clock)

    def _say(self, event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        self.said.append((event.name, fields))

    def status(self, *headers: tuple[str, str], peer: str = "192.0.2.1") -> int:
        """What comes of a request; 200 where it may pass."""
        scope: dict[str, Any] = {
            "type": "http",
            "method": "GET",
            "path": "/status",
            "headers": [(name.encode(), value.encode()) for name, value in headers],
            "client": (peer, 1),
            "state": {},
        }
        answer = self.access.refusal(scope)
        if answer is None:
            assert isinstance(scope["state"]["visitor"], Visitor)
            return 200
        return answer.status_code

    def show(self, token: str, peer: str = "192.0.2.1") -> int:
        return self.status(("authorization", f"Bearer {token}"), peer=peer)


def test_ten_wrong_ones_in_a_minute_shut_an_address_out_for_a_minute(tmp_path: Path) -> None:
    gate = Gate(tmp_path)
    for number in range(9):
        assert gate.show(f"{WRONG}{number}") == 401
    assert gate.show(TOKEN) == 200
    assert gate.show(WRONG) == 401  # the tenth
    assert gate.show(TOKEN) == 429
    assert gate.show(TOKEN, "192.0.2.2") == 200
    assert gate.status() == 401  # without a token nothing is tried
    gate.clock.now_s += 59.9
    assert gate.show(TOKEN) == 429
    gate.clock.now_s += 0.2
    assert gate.show(TOKEN) == 200


def test_nine_a_minute_shut_nobody_out(tmp_path: Path) -> None:
    gate = Gate(tmp_path)
    for number in range(100):
        gate.clock.now_s += 60.0 / 9.0
        assert gate.show(f"{WRONG}{number}") == 401
    assert gate.show(TOKEN) == 200


def test_a_program_with_an_old_token_keeps_nobody_of_its_address_out(tmp_path: Path) -> None:
    gate = Gate(tmp_path)
    for number in range(200):
        gate.clock.now_s += 0.5
        assert gate.show(WRONG) == 401
        if number % 25 == 0:  # and eight others beside it, over 100 s
            assert gate.show(f"{WRONG}{number}") == 401
    assert gate.show(TOKEN) == 200


def test_whoever_is_in_stays_in_while_his_address_is_shut(tmp_path: Path) -> None:
    gate = Gate(tmp_path)
    visitor = gate.access.try_token(TOKEN, "192.0.2.1")
    assert isinstance(visitor, Visitor)
    cookie = gate.access.log_in(visitor).partition(";")[0]
    for number in range(20):
        gate.show(f"{WRONG}{number}")
    assert gate.show(TOKEN) == 429
    assert gate.status(("cookie", cookie)) == 200


def test_an_old_cookie_is_no_wrong_token(tmp_path: Path) -> None:
    gate = Gate(tmp_path)
    for _ in range(100):
        assert gate.status(("cookie", f"pitch-gateway-1={'a' * 43}")) == 401
    assert gate.show(TOKEN) == 200
    assert [event for event, _ in gate.said] == ["http-refused"]


def test_a_session_ends_after_twelve_hours_used_or_not(tmp_path: Path) -> None:
    gate = Gate(tmp_path)
    visitor = gate.access.try_token(TOKEN, "192.0.2.1")
    assert isinstance(visitor, Visitor)
    cookie = gate.access.log_in(visitor).partition(";")[0]
    for _ in range(11):
        gate.clock.now_s += 3600.0
        assert gate.status(("cookie", cookie)) == 200
    gate.clock.now_s += 3600.0
    assert gate.status(("cookie", cookie)) == 401
    assert len(gate.sessions) == 0


def test_there_are_64_sessions_at_most_and_the_oldest_ends() -> None:
    kept = Sessions()
    values = [kept.open("people", b"d", 0.0) for _ in range(login.MOST + 1)]
    assert len(set(values)) == 65
    assert len(kept) == 64
    assert kept.find(values[0], 1.0) is None
    assert all(kept.find(value, 1.0) is not None for value in values[1:])


def test_what_is_kept_of_addresses_is_bounded() -> None:
    tries = WrongTries()
    told: list[str] = []

    def say(event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        told.append(event.name)

    log = HttpRefusals(say)
    for number in range(3000):
        address = f"10.0.{number // 256}.{number % 256}"
        tries.add(address, WRONG, 0.0)
        log.add(TOKEN_REFUSED, address, "a wrong token", 0.0)
    assert len(tries) == refusals.MOST_SITES == 1024
    # 1024 addresses by name, and one line for all others: a flood fills no log.
    assert len(told) == 1025


def test_all_addresses_of_one_network_of_ipv6_are_one() -> None:
    tries = WrongTries()
    for number in range(10):
        tries.add(f"2001:db8::{number:x}", f"{WRONG}{number}", 0.0)
    assert tries.shut_s("2001:db8::ffff:1", 1.0) == 59.0
    assert tries.shut_s("2001:db8:0:1::1", 1.0) == 0.0


def test_refusals_are_told_once_a_minute_with_how_many(tmp_path: Path) -> None:
    gate = Gate(tmp_path)
    for number in range(15):
        gate.show(f"{WRONG}{number}")
    told = {"peer": "192.0.2.1", "detail": "a wrong token", "times": 1}
    assert gate.said == [("token-refused", told)]
    gate.clock.now_s += 30.0
    gate.refusals.sweep(gate.clock.now_s)
    assert len(gate.said) == 1
    gate.clock.now_s += 31.0
    gate.refusals.sweep(gate.clock.now_s)
    late = {"peer": "192.0.2.1", "detail": "too many wrong tokens: not checked", "times": 14}
    assert gate.said[1:] == [("token-refused", late)]
    gate.clock.now_s += 61.0
    gate.refusals.sweep(gate.clock.now_s)
    assert len(gate.said) == 2  # nothing new, and forgotten
    assert not gate.refusals._reports.knows((TOKEN_REFUSED, "192.0.2.1"))


@pytest.mark.parametrize("token", [TOKEN, WRONG])
async def test_over_the_wire_it_is_the_same(visitor: Asking, token: str) -> None:
    for number in range(10):
        assert (await visitor.log_in(f"{WRONG}{number}")).status == 401
    answer = await visitor.log_in(token)
    assert answer.status == 429
    assert 0 < int(answer.headers["retry-after"]) <= 60
    assert (await visitor.ask("/status", bearer(token))).status == 429
    assert (await visitor.ask("/status", bearer(TOKEN), source="127.0.0.2")).status == 200
