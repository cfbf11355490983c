"""Wrong tokens, sessions and refusals in numbers: all of it bounded, and all of it over some time."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from gateway.catalogue.entry import EventEntry, Severity
from gateway.catalogue.publishing_events import TOKEN_REFUSED
from gateway.config.http_model import TokenSection
from gateway.supervisor.http import login, refusals
from gateway.supervisor.http.login import Authenticator, Sessions, Tokens, Visitor
from gateway.supervisor.http.refusals import HttpRefusals, WrongTries
from tests.supervisor.http.doors import TOKEN, WRONG, asking, bearer, write_token


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
async def test_over_the_wire_it_is_the_same(tmp_path: Path, token: str) -> None:
    async with asking(tmp_path) as visitor:
        for number in range(10):
            assert (await visitor.log_in(f"{WRONG}{number}")).status == 401
        answer = await visitor.log_in(token)
        assert answer.status == 429
        assert 0 < int(answer.headers["retry-after"]) <= 60
        assert (await visitor.ask("/status", bearer(token))).status == 429
        assert (await visitor.ask("/status", bearer(TOKEN), source="127.0.0.2")).status == 200
