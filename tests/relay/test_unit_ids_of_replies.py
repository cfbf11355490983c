"""Whose reply it is (W6): on Modbus/TCP the transaction id tells, and the unit id where there are several."""

import pytest

from gateway.exchange.line import LineExchange
from gateway.exchange.plan import AxisPlan, ControllerPlan, LineTiming, OtherUnits
from gateway.exchange.ports import ControllerPort
from gateway.modbus.mbap import encode_mbap
from gateway.relay.drive_link import MbapDriveLink, ReplyUnitIds
from gateway.state.plan import GatewayPlan, LinePlan
from gateway.transport import memory
from tests.support.relay import QUICK, Bench, RawEnd, axis_plan, until_up

READ = bytes.fromhex("03 0010 0001")
REPLY = bytes.fromhex("03 02 2222")
MS = 1_000_000


class Controller(ControllerPort):
    """Keeps what it is answered."""

    def __init__(self) -> None:
        super().__init__(ControllerPlan("cnc"))
        self.replies: list[bytes] = []

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        self.replies.append(pdu)


class Drives:
    """A Modbus/TCP line whose drive is in the hands of the test."""

    def __init__(self, far: RawEnd, unit_ids: ReplyUnitIds) -> None:
        self.wrong: list[tuple[int, int]] = []
        self.link = MbapDriveLink(0, unit_ids, lambda asked, answered: self.wrong.append((asked, answered)))
        self.line = LineExchange((), LineTiming(), self.link, lambda _: None)
        self.link.attach(self.line)
        self.far = far
        self.controller = Controller()
        memory.connect(self.link, far)

    def asks(self, now_ns: int) -> None:
        self.line.request(self.controller, 9, 1, READ, now_ns)

    def answers(self, transaction_id: int, unit_id: int, pdu: bytes = REPLY) -> None:
        self.link.received(encode_mbap(transaction_id, unit_id, pdu), 2 * MS)


async def test_w6_one_drive_may_answer_with_any_unit_id_and_is_told_of_once() -> None:
    drives = Drives(RawEnd(), ReplyUnitIds())
    for number in (1, 2):
        drives.asks(number)
        drives.answers(number, 0)
    assert drives.controller.replies == [REPLY, REPLY]
    assert drives.wrong == [(1, 0)]
    assert drives.link.counters()["wrong_units"] == 2


async def test_w6_what_a_drive_is_known_to_answer_with_is_not_counted() -> None:
    drives = Drives(RawEnd(), ReplyUnitIds(answers_as=0))
    drives.asks(1)
    drives.answers(1, 0)
    assert drives.controller.replies == [REPLY]
    assert drives.wrong == []
    assert drives.link.counters()["wrong_units"] == 0


async def test_w6_of_several_drives_another_one_answers_nothing() -> None:
    drives = Drives(RawEnd(), ReplyUnitIds(are_many=True))
    drives.asks(1)
    drives.answers(1, 2)
    assert drives.controller.replies == []
    assert drives.wrong == [(1, 2)]
    drives.answers(1, 1)  # the one that was asked
    assert drives.controller.replies == [REPLY]
    assert drives.line.counters.late == 1


@pytest.mark.parametrize("length", [255, 260])
async def test_a_reply_that_is_too_long_ends_its_exchange_and_not_the_line(length: int) -> None:
    drives = Drives(RawEnd(), ReplyUnitIds())
    drives.asks(1)
    header = bytes.fromhex("0001 0000") + length.to_bytes(2, "big") + b"\1"
    drives.link.received(header + bytes((3, (length - 3) & 0xFF)) + bytes(length - 3), 2 * MS)
    assert drives.controller.replies == [bytes((0x83, 0x0B))]
    assert drives.line.counters.oversized == 1
    assert drives.line.is_up
    drives.asks(3 * MS)
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

    _, where = await bench.drive("tcp", script)
    link, _ = bench.controller_link("tcp", timeout_ms=20.0)
    axes: tuple[AxisPlan, ...] = (axis_plan(),)
    plan = LinePlan("line", where, (link,), axes, QUICK, **changes)  # type: ignore[arg-type]
    relay = await bench.start(GatewayPlan("bench", (plan,)))
    await until_up(relay)
    near = await bench.connect(relay.address("line", "cnc"))
    near.write(encode_mbap(4, 1, READ))
    await near.until(lambda end: len(end.data) >= 9)
    assert near.data[7:] == (expected[0] if expected else bytes((0x83, 0x0B)))
    [note] = [note for note in bench.notes if note.event == "wrong-unit"]
    assert note.fields["detail"] == "asked for unit id 1, the drive answered as unit id 0"
