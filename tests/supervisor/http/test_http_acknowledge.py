"""Acknowledging an alarm: the one thing that can be changed over TCP, and who may."""

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest

from gateway.catalogue.alarms import DRIVE_SILENT
from gateway.status.model import AcknowledgedBy
from gateway.supervisor.acknowledged import AlarmAcknowledgement
from gateway.supervisor.active_alarms import Alarm
from gateway.supervisor.recent_history import RecentHistory
from tests.supervisor.http.doors import TOKEN, WRONG, Asking, asking, bearer, make_certificates
from tests.supervisor.http.http_bench import Answer

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


async def test_a_token_that_may_look_only_does_not(tmp_path: Path) -> None:
    async with asking(tmp_path) as visitor:
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
