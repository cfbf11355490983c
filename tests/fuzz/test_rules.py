"""The rules of the targets see what breaks them: each is given a part that does."""

from pathlib import Path
from typing import Any

import pytest

from gateway.config.problems import ConfigErrors, Problem
from gateway.exchange.line import LineExchange
from gateway.modbus.mbap import MbapDecoder
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder
from gateway.supervisor.http.login import Authenticator
from gateway.supervisor.mqtt.commands import Commander
from tests.exchange.line_bench import write
from tests.fuzz import configuration, exchange, http_requests, line, mbap, mqtt_messages, rtu
from tests.fuzz.script import said
from tests.supervisor.http.doors import TOKEN

READ = bytes.fromhex("01 03 32 00 00 02")


class Instead:
    """Does what another object does, but for what a subclass says."""

    kind: type[Any]

    def __init__(self, *args: Any, **options: Any) -> None:
        self._real = self.kind(*args, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)


def breaks(
    monkeypatch: pytest.MonkeyPatch, module: Any, part: type[Instead], data: bytes, target: Any
) -> str:
    target(data)
    monkeypatch.setattr(module, part.kind.__name__, part)
    with pytest.raises(AssertionError) as caught:
        target(data)
    return str(caught.value)


def test_a_request_that_comes_out_twice_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    class Twice(Instead):
        kind = RtuRequestDecoder

        def feed(self, data: bytes, now_ns: int) -> list[Any]:
            return list(self._real.feed(data, now_ns)) * 2

    text = breaks(monkeypatch, rtu, Twice, b"\x01" + said(READ), rtu.requests)
    assert text.startswith("a frame that never came")


def test_bytes_that_are_lost_without_a_count_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    class Loses(Instead):
        kind = RtuRequestDecoder

        def feed(self, data: bytes, now_ns: int) -> list[Any]:
            return list(self._real.feed(data[:-1], now_ns))

    text = breaks(monkeypatch, rtu, Loses, b"\x00" + said(b"\xff\x7e\x03"), rtu.requests)
    assert text.startswith("3 bytes came, 2 are accounted for")


def test_a_reply_of_another_unit_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    class Takes(Instead):
        kind = RtuReplyDecoder

        def feed(self, data: bytes, now_ns: int) -> list[Any]:
            return [(unit + 1, pdu) for unit, pdu in self._real.feed(data, now_ns)]

    data = b"\x00\x02\x01" + said(READ[1:]) + b"\x01" + said(bytes.fromhex("01 03 04 00 B1 1F 40"))
    text = breaks(monkeypatch, rtu, Takes, data, rtu.replies)
    assert text.startswith("the reply of unit 2 to a request of unit 1")


def test_a_frame_that_depends_on_its_pieces_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    class Forgets(Instead):
        kind = MbapDecoder

        def feed(self, data: bytes) -> list[Any]:
            return [] if len(data) < 7 else list(self._real.feed(data))

    data = b"\x00" + said(bytes.fromhex("00 07 00 00 00 06") + READ) + b"\x00" + said(READ)
    assert breaks(monkeypatch, mbap, Forgets, data, mbap.streams).startswith("6 bytes wait")


class Line(Instead):
    kind = LineExchange

    def __init__(self, plans: Any, timing: Any, link: Any, on_event: Any) -> None:
        super().__init__(plans, timing, link, on_event)
        self.link = link

    @property
    def deadline_ns(self) -> int | None:
        found: int | None = self._real.deadline_ns
        return found


MOVE = exchange.asked(0, write(line.machines()[0][0].command[0], 1000))
PAST = exchange.asked(2, READ[1:])
"""To the unit that has no axis: the third, after the two that do."""


def test_a_request_that_is_sent_twice_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    class Repeats(Line):
        def request(self, port: Any, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int) -> None:
            self._real.request(port, transaction_id, unit_id, pdu, now_ns)
            self.link.asked = None
            self.link.send_request(unit_id, pdu)

    assert breaks(monkeypatch, line, Repeats, b"\x00" + MOVE, exchange.traffic).startswith("sent twice")


def test_two_requests_on_the_wire_at_once_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    class Hurries(Line):
        def request(self, port: Any, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int) -> None:
            self._real.request(port, transaction_id, unit_id, pdu, now_ns)
            self.link.send_request(unit_id, pdu)

    text = breaks(monkeypatch, line, Hurries, b"\x00" + MOVE, exchange.traffic)
    assert text.startswith("a second frame while the first one waits")


def test_a_changed_frame_that_is_not_mapped_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    class Link(line.Drives):
        def send_request(self, unit_id: int, pdu: bytes) -> None:
            super().send_request(unit_id, pdu[:-1] + bytes((pdu[-1] ^ 1,)))

    exchange.traffic(b"\x00" + PAST)
    monkeypatch.setattr(line, "Drives", Link)
    with pytest.raises(AssertionError, match="changed, and it is not mapped"):
        exchange.traffic(b"\x00" + PAST)


def test_a_reply_that_is_given_twice_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    class Port(line.Controller):
        def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
            super().send_reply(transaction_id, unit_id, pdu)
            super().send_reply(transaction_id, unit_id, pdu)

    monkeypatch.setattr(line, "Controller", Port)
    with pytest.raises(AssertionError, match="and nobody asked"):
        exchange.traffic(b"\x00" + MOVE)


def test_a_line_that_never_goes_on_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    class Sleeps(Line):
        def tick(self, now_ns: int) -> None:
            pass

    data = b"\x00" + bytes((exchange.CNC, 0)) + said(READ[1:])  # nobody answers it
    text = breaks(monkeypatch, line, Sleeps, data, exchange.traffic)
    assert text.startswith("due again at once, for ever")


def test_a_problem_of_two_lines_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path) -> None:
        raise ConfigErrors([Problem(str(path), "axis", "one\ntwo", "")])

    monkeypatch.setattr(configuration, "load", refuse)
    with pytest.raises(AssertionError):
        configuration.files(b"")


def test_an_answer_on_a_topic_of_our_own_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    class Answers(Commander):
        def _may_answer(self, topic: str) -> bool:
            return True

    data = (
        bytes((mqtt_messages.ANSWERED,))
        + said(b"reload")
        + said(b"pitch-gateway/mill-1/command/reload")
        + b"{}"
    )
    mqtt_messages.messages(data)
    monkeypatch.setattr(mqtt_messages, "Commander", Answers)
    with pytest.raises(AssertionError, match="an answer that is a command or a status"):
        mqtt_messages.messages(data)


def test_a_page_that_lets_strangers_look_is_seen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class Open(Authenticator):
        def refusal(self, scope: Any) -> None:
            scope["state"]["visitor"] = self.try_token(TOKEN, "")

    data = b"\x00GET /status HTTP/1.1\r\nHost: localhost\r\n\r\n"
    http_requests.requests(data)
    monkeypatch.setattr(http_requests, "Authenticator", Open)
    page = http_requests.Site(tmp_path)
    monkeypatch.setattr(http_requests, "site", lambda: page)
    with pytest.raises(AssertionError, match="shown to a stranger"):
        http_requests.requests(data)
    page.loop.close()
