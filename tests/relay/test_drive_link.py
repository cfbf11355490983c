"""Whose reply it is (W6): on Modbus/TCP the transaction id tells, and the unit id where there are several."""

from dataclasses import replace
from typing import Any

import pytest

from gateway.exchange.events import Event
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan, LineTiming, OtherUnits
from gateway.exchange.ports import ControllerPort
from gateway.modbus.mbap import encode_mbap
from gateway.relay.drive_link import MbapDriveLink, OtherIds, ReplyUnitIds
from gateway.transport import memory
from tests.support.relay import TIMING, Bench, RawEnd, axis_plan, line_status

READ = bytes.fromhex("03 0010 0001")
REPLY = bytes.fromhex("03 02 2222")
NO_RESPONSE = bytes.fromhex("83 0B")
MS = 1_000_000
ONE_DRIVE = ReplyUnitIds()


class Controller(ControllerPort):
    """Keeps what it is answered."""

    def __init__(self) -> None:
        super().__init__(ControllerPlan("cnc", timeout_ms=100.0))
        self.replies: list[bytes] = []

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        self.replies.append(pdu)


class Drives:
    """A Modbus/TCP line whose drive is in the hands of the test."""

    def __init__(self, far: RawEnd, unit_ids: ReplyUnitIds = ONE_DRIVE) -> None:
        self.told: list[tuple[int, str]] = []
        self.wrong: list[tuple[int, int]] = []
        self.events: list[Event] = []
        self.link = MbapDriveLink(
            0,
            unit_ids,
            lambda asked, answered: self.wrong.append((asked, answered)),
            on_other_id=lambda unit_id, said: self.told.append((unit_id, str(said))),
        )
        timing = LineTiming(response_timeout_ms=100.0)
        self.line = LineExchange((), timing, self.link, self.events.append)
        self.link.attach(self.line)
        self.far = far
        self.controller = Controller()
        memory.connect(self.link, far)
        self.now_ns = 1000 * MS

    def asks(self) -> None:
        self.now_ns += 5000 * MS
        self.line.request(self.controller, 9, 1, READ, self.now_ns)

    def answers(self, transaction_id: int, unit_id: int) -> None:
        self.link.received(encode_mbap(transaction_id, unit_id, REPLY), self.now_ns + MS)

    def ask(self, *answers: tuple[int, int]) -> None:
        """Have one request answered with these transaction and unit ids, and its time-out pass."""
        self.asks()
        for transaction_id, unit_id in answers:
            self.answers(transaction_id, unit_id)
        self.line.tick(self.now_ns + 101 * MS)

    async def asked_ids(self) -> list[int]:
        """Return the transaction ids of the three requests that the drive got."""
        await self.far.until(lambda far: len(far.data) >= 3 * 12)
        data = self.far.data
        return [int.from_bytes(data[start : start + 2], "big") for start in range(0, len(data), 12)]


async def test_w6_id_0_is_never_asked_with_so_it_answers_nothing() -> None:
    drives = Drives(RawEnd())
    drives.link._last_id = 0xFFFE  # 65 534 requests later
    for asked in (0xFFFF, 1, 2):
        drives.ask((asked, 1))
    assert drives.controller.replies == [REPLY] * 3
    assert await drives.asked_ids() == [0xFFFF, 1, 2]


async def test_w6_unanswered_ids_are_passed_over_also_where_they_go_round() -> None:
    drives = Drives(RawEnd())
    drives.ask()  # id 1, never answered
    drives.link._last_id = 0xFFFE
    drives.ask((0xFFFF, 1))
    drives.ask((2, 1))
    assert await drives.asked_ids() == [1, 0xFFFF, 2]
    assert drives.controller.replies == [NO_RESPONSE, REPLY, REPLY]


async def test_w6_a_drive_that_answers_with_id_0_is_refused_and_named() -> None:
    drives = Drives(RawEnd())
    for _ in range(3):
        drives.ask((0, 1))
    assert drives.controller.replies == [NO_RESPONSE] * 3
    assert drives.told == [(1, "answers, with transaction id 0 (asked with 1)")]
    assert str(drives.link.other_ids[1]) == "answers, with transaction id 0 (asked with 3)"
    assert (drives.link.other_ids[1].total, drives.link.other_ids[1].among(3)) == (3, 3)
    assert drives.link.counters()["late_replies"] == 0  # no longer patience helps
    said = [(event.kind.name, event.detail) for event in drives.events if "unit id" in event.detail]
    assert said == [
        ("drive-silent", "unit id 1 answers, with transaction id 0 (asked with 1)"),
        ("drive-backed-off", "unit id 1 answers, with transaction id 0 (asked with 3)"),
    ]


async def test_a_fixed_id_is_named_after_the_request_that_had_it() -> None:
    drives = Drives(RawEnd())
    drives.ask((1, 1))  # the right one, by chance
    drives.ask((1, 1))  # may be the reply before, once more
    assert drives.told == []
    drives.ask((1, 1))
    assert drives.controller.replies == [REPLY, NO_RESPONSE, NO_RESPONSE]
    assert drives.told == [(1, "answers, with transaction id 1 (asked with 3)")]


async def test_late_replies_and_those_that_come_twice_are_none_of_this() -> None:
    drives = Drives(RawEnd())
    drives.ask((1, 1), (1, 1))
    drives.ask((1, 1))  # what came twice comes once more, and no answer
    drives.ask((2, 1))  # late: of the request that was given up
    drives.ask()
    assert drives.controller.replies == [REPLY, NO_RESPONSE, NO_RESPONSE, NO_RESPONSE]
    assert (drives.told, drives.link.other_ids) == ([], {})


async def test_what_was_answered_after_all_counts_for_nothing() -> None:
    drives = Drives(RawEnd())
    drives.ask((0, 1), (1, 1))
    drives.ask()  # a time-out of its own
    assert drives.controller.replies == [REPLY, NO_RESPONSE]
    assert (drives.told, drives.link.other_ids) == ([], {})


async def test_of_several_drives_another_one_is_not_meant() -> None:
    drives = Drives(RawEnd(), ReplyUnitIds(are_many=True))
    drives.ask((0, 2))
    assert drives.told == []
    drives.ask((0, 1))
    assert drives.told == [(1, "answers, with transaction id 0 (asked with 2)")]


async def test_w6_one_drive_may_answer_with_any_unit_id_and_is_told_of_once() -> None:
    drives = Drives(RawEnd())
    for number in (1, 2):
        drives.asks()
        drives.answers(number, 0)
    assert drives.controller.replies == [REPLY, REPLY]
    assert drives.wrong == [(1, 0)]
    assert drives.link.counters()["wrong_units"] == 2


async def test_w6_what_a_drive_is_known_to_answer_with_is_not_counted() -> None:
    drives = Drives(RawEnd(), ReplyUnitIds(answers_as=0))
    drives.asks()
    drives.answers(1, 0)
    assert drives.controller.replies == [REPLY]
    assert drives.wrong == []
    assert drives.link.counters()["wrong_units"] == 0


async def test_w6_of_several_drives_another_one_answers_nothing() -> None:
    drives = Drives(RawEnd(), ReplyUnitIds(are_many=True))
    drives.asks()
    drives.answers(1, 2)
    assert drives.controller.replies == []
    assert drives.wrong == [(1, 2)]
    drives.answers(1, 1)  # the one that was asked
    assert drives.controller.replies == [REPLY]
    assert drives.line.counters.late == 1


@pytest.mark.parametrize("length", [255, 260])
async def test_a_reply_that_is_too_long_ends_its_exchange_and_not_the_line(length: int) -> None:
    drives = Drives(RawEnd())
    drives.asks()
    header = bytes.fromhex("0001 0000") + length.to_bytes(2, "big") + b"\1"
    drives.link.received(header + bytes((3, (length - 3) & 0xFF)) + bytes(length - 3), drives.now_ns + MS)
    assert drives.controller.replies == [NO_RESPONSE]
    assert drives.line.counters.oversized == 1
    assert drives.line.is_up
    drives.asks()
    drives.answers(2, 1)
    assert drives.controller.replies[1:] == [REPLY]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [({}, [b"\3\2\x22\x22"]), ({"other_units": OtherUnits(frozenset({7}))}, [])],
    ids=["alone", "beside another device"],
)
async def test_the_configuration_has_their_number(
    bench: Bench, changes: dict[str, OtherUnits], expected: list[bytes]
) -> None:
    def script(data: bytes) -> bytes:
        return encode_mbap(int.from_bytes(data[:2], "big"), 0, REPLY)

    options: Any = {"axes": (axis_plan(),), **changes}
    near, _, _ = await bench.raw_pair("tcp", "tcp", script, 500.0, **options)
    near.write(encode_mbap(4, 1, READ))
    await near.until(lambda end: len(end.data) >= 9)
    assert near.data[7:] == (expected[0] if expected else NO_RESPONSE)
    [note] = [note for note in bench.notes if note.event == "wrong-unit"]
    assert note.fields["detail"] == "asked for unit id 1, the drive answered as unit id 0"


async def test_status_and_event_say_it(bench: Bench) -> None:
    def script(data: bytes) -> bytes:
        return b"\0\0" + encode_mbap(0, data[6], REPLY)[2:]

    near, _, relay = await bench.raw_pair(
        "tcp", "tcp", script, timeout_ms=20.0, timing=replace(TIMING, response_timeout_ms=20.0)
    )
    near.write(encode_mbap(4, 1, READ))
    await near.receives(encode_mbap(4, 1, NO_RESPONSE))
    unit_ids: Any = line_status(relay)["unit_ids"]
    drive = unit_ids["drives"]["1"]
    assert drive["answered_s"] is None
    assert drive["other_ids_in_a_row"] == drive["timeouts_in_a_row"] >= 1
    assert drive["answers_with"].startswith("answers, with transaction id 0 (asked with ")
    [note] = [note for note in bench.notes if note.event == "other-transaction-id"]
    said = str(OtherIds(asked_id=1))
    assert note.fields["detail"] == f"unit id 1 {said}: its replies answer nothing"
