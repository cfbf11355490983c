"""The registers of the gateway's own unit id, word for word, with time as an argument."""

from typing import Any

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import AxisPlan, CompensationMode, ControllerPlan, Reference
from gateway.exchange.rights import Rights
from gateway.exchange.status_words import COMPENSATION_STATES, DIRECTION_STATES
from gateway.relay.status_unit import BLOCKS, COMPENSATION_CODES, DIRECTION_CODES, StatusUnit
from tests.exchange.line_bench import COMMAND, MS, Bench, Port, axis_plan, write

OWN = 250
OTHER = bytes.fromhex("03 1000 0001")
HEAD = bytes.fromhex("03 0000 0001")
RISE = make_table([0.0, 100.0], [0.0, 0.1], [0.0, 0.1], Units.MM)
FALL = make_table([0.0, 100.0], [0.0, -0.1], [0.0, -0.1], Units.MM)


def words(now_ns: int, address: int, quantity: int, *benches: Bench) -> list[int]:
    """Read registers of a gateway that started at 0 ns."""
    unit = StatusUnit(OWN, lambda: [bench.line for bench in benches], 0)
    reply = unit.answer(b"\x03" + address.to_bytes(2, "big") + quantity.to_bytes(2, "big"), now_ns)
    assert reply[:2] == bytes((3, 2 * quantity)), reply.hex(" ")
    return [int.from_bytes(reply[at : at + 2], "big") for at in range(2, len(reply), 2)]


def answer(pdu: str, *benches: Bench) -> str:
    """Ask a gateway for anything."""
    unit = StatusUnit(OWN, lambda: [bench.line for bench in benches], 0)
    return unit.answer(bytes.fromhex(pdu), 0).hex()


def test_every_state_and_every_direction_has_a_code_of_its_own() -> None:
    assert set(COMPENSATION_CODES) == set(COMPENSATION_STATES)
    assert set(DIRECTION_CODES) == set(DIRECTION_STATES)
    for codes in (COMPENSATION_CODES, DIRECTION_CODES):
        assert len(set(codes.values())) == len(codes)


def test_no_register_lies_on_another_one() -> None:
    for block in BLOCKS:
        taken = [each.offset + word for each in block.registers for word in range(each.words)]
        assert taken == sorted(set(taken))
        assert max(taken) < block.size
    assert [block.first for block in BLOCKS] == [0, 100, 1000]


def test_the_gateway_in_ten_registers() -> None:
    one, other = Bench(axis_plan()), Bench(serial=False, tcp_drive=True)
    now_ns = 7_000_123 * MS
    # 7 000.123 s are 70 001 tenths, and 70 001 - 65 536 = 4 465. Two lines, both up, one axis, nobody silent.
    assert words(now_ns, 0, 10, one, other) == [1, 4465, 0, 2, 2, 1, 0, 0, 0, 0]
    other.line.link_down(now_ns)
    # Bit 1: a line is down; with it bit 0.
    assert words(now_ns, 2, 3, one, other) == [0b00011, 2, 1]
    assert words(now_ns, 100, 20, one, other)[::10] == [1, 0]


def test_a_drive_is_silent_after_two_seconds_and_since_the_first_request_that_it_left() -> None:
    bench = Bench(axis_plan(actual=()), serial=False, tcp_drive=True)
    bench.ask(OTHER)  # 1 ms
    start_ns = bench.now_ns
    bench.send(OTHER)
    bench.wait(1000.0)  # the response time-out
    assert words(start_ns + 1_999 * MS, 100, 8, bench) == [1, 0, 0, 0, 0, 1, 0, 1]
    # One exchange, one time-out: 32 bits each, the high word first.
    assert words(start_ns + 2_000 * MS, 100, 8, bench) == [1, 1, 1, 2, 0, 1, 0, 1]
    assert words(start_ns + 12_999 * MS, 103, 1, bench) == [12]
    assert words(start_ns + 2_000 * MS, 2, 5, bench) == [0b00101, 1, 1, 1, 1]
    # Flags of the axis: referenced, switched on, its drive silent; no target yet.
    assert words(start_ns + 2_000 * MS, 1004, 4, bench) == [0b0111, 2, 1, 1]
    bench.port.replies.clear()
    bench.ask(OTHER)
    assert words(bench.now_ns + 5_000 * MS, 2, 5, bench) == [0, 1, 1, 1, 0]


def test_a_unit_id_without_an_axis_is_silent_only_after_three_requests() -> None:
    bench = Bench(axis_plan(actual=()), serial=False, tcp_drive=True)
    counted = []
    for _ in range(3):
        bench.send(OTHER, unit_id=17)
        bench.wait(1000.0)
        counted.append(words(bench.now_ns + 3_000 * MS, 101, 2, bench))
    assert counted == [[0, 0], [0, 0], [1, 17]]


def test_the_correction_of_a_target_in_nanometres() -> None:
    bench = Bench(axis_plan(table=RISE))
    assert words(bench.now_ns, 1000, 10, bench) == [1, 0, 0, 0, 0b0011, 0, 1, 1, 0, 0]
    bench.move(20_000)
    bench.move(50_000)
    # At 50 mm the table adds 0.05 mm = 50 000 nm = 0x0000_C350, whatever the direction. It has a target.
    assert words(bench.now_ns, 1000, 5, bench) == [1, 0, 0x0000, 0xC350, 0b1011]


def test_the_direction_of_an_axis_with_lost_motion() -> None:
    bench = Bench(axis_plan())
    bench.move(20_000)
    bench.move(50_000)
    # 0.01 mm forward, -0.01 mm = 2**32 - 10 000 backward.
    assert words(bench.now_ns, 1001, 3, bench) == [1, 0x0000, 10_000]
    bench.move(20_000)
    assert words(bench.now_ns, 1001, 3, bench) == [2, 0xFFFF, 0x10000 - 10_000]


def test_a_correction_below_zero_is_in_two_s_complement() -> None:
    bench = Bench(axis_plan(table=FALL))
    bench.move(100_000)
    # -0.1 mm = -100 000 nm = 2**32 - 100 000 = 0xFFFE_7960.
    assert words(bench.now_ns, 1002, 2, bench) == [0xFFFE, 0x7960]


@pytest.mark.parametrize(
    ("changes", "state", "flags", "alarm"),
    [
        ({"compensation": CompensationMode.SHADOW}, 3, 0b0011, 0b10000),
        ({"compensation": CompensationMode.OFF}, 4, 0b0001, 0b10000),
        ({"referenced": Reference.SET_POSITION}, 5, 0b0010, 0b10000),
        ({"table": None}, 6, 0b0011, 0b10000),
    ],
    ids=["shadow", "off", "unreferenced", "no-table"],
)
def test_the_state_of_an_axis_and_its_alarm(
    changes: dict[str, object], state: int, flags: int, alarm: int
) -> None:
    """What is only worth a warning on the page sets bit 4, and no alarm."""
    bench = Bench(axis_plan(**changes))
    assert words(bench.now_ns, 1000, 1, bench) == [state]
    assert words(bench.now_ns, 1004, 1, bench) == [flags]
    assert words(bench.now_ns, 2, 1, bench) == [alarm]


def test_axes_stand_line_by_line_with_unit_id_and_line() -> None:
    one = Bench(axis_plan(), axis_plan(name="y", unit_id=2))
    other = Bench(axis_plan(name="z", unit_id=1), serial=False, tcp_drive=True)
    read = words(0, 1000, 30, one, other)
    assert [read[at + 6 : at + 8] for at in (0, 10, 20)] == [[1, 1], [2, 1], [1, 2]]


@pytest.mark.parametrize(
    ("asked", "answered"),
    [
        ("04 0000 0001", "04020001"),  # input registers are the same registers
        ("03 0009 0001", "03020000"),  # a register without a name, inside
        ("03 0009 0002", "8302"),  # the first one outside of the gateway's
        ("03 000A 0001", "8302"),
        ("03 0064 000A", "0314" + "0001" + "0000" * 9),
        ("03 0064 000B", "8302"),  # there is one line
        ("03 006E 0001", "8302"),
        ("03 03E8 0001", "8302"),  # 1000, and no axis
        ("03 FFFF 0001", "8302"),
        ("03 0000 0000", "8303"),
        ("03 0000 007E", "8303"),  # 126 registers
        ("03 0000 00", "8303"),
        ("03 0000 0001 00", "8303"),
        ("03", "8303"),
        ("06 0000 0001", "8601"),
        ("10 0000 0001 02 0000", "9001"),
        ("01 0000 0001", "8101"),
        ("17 0000 0001 0000 0001 02 0000", "9701"),
        ("2B 0E 01 00", "AB01"),
    ],
)
def test_what_is_no_read_of_its_registers_gets_the_exception_of_a_slave(asked: str, answered: str) -> None:
    assert answer(asked, Bench()) == answered.lower()


def own_bench(*plans: AxisPlan, **options: Any) -> Bench:
    """A line of a gateway that answers for its own unit id."""
    lines: list[LineExchange] = []
    bench = Bench(*plans, own_unit=StatusUnit(OWN, lambda: lines, 0), **options)
    lines.append(bench.line)
    return bench


@pytest.mark.parametrize("tcp_drive", [False, True])
def test_nothing_that_is_asked_there_reaches_a_drive(tcp_drive: bool) -> None:
    bench = own_bench(axis_plan(), serial=not tcp_drive, tcp_drive=tcp_drive)
    asked = (HEAD, write(COMMAND, 1), bytes.fromhex("05 0000 FF00"), bytes.fromhex("65 01"), b"\x03")
    for pdu in asked:
        bench.send(pdu, unit_id=OWN)
    assert bench.link.sent == []
    answers = [(unit_id, pdu.hex()) for _, unit_id, pdu in bench.port.replies]
    assert answers == [(OWN, reply) for reply in ("03020001", "9001", "8501", "e501", "8303")]
    assert bench.line.unit_ids.heard == []


def test_it_is_answered_while_a_drive_is_asked_and_while_the_line_is_down() -> None:
    bench = own_bench(axis_plan(actual=()), serial=False, tcp_drive=True)
    bench.send(OTHER)
    bench.send(HEAD, unit_id=OWN, transaction_id=8)
    assert bench.port.replies == [(8, OWN, bytes.fromhex("03020001"))]
    bench.line.link_down(bench.now_ns)
    bench.port.replies.clear()
    bench.send(bytes.fromhex("03 0002 0001"), unit_id=OWN)
    assert bench.port.take() == bytes.fromhex("03020003")


def test_a_serial_controller_that_asks_there_has_given_up_on_what_it_asked_before() -> None:
    """W5: as with any new request of it."""
    bench = own_bench(axis_plan(actual=()))
    bench.send(OTHER)
    bench.send(write(COMMAND, 5))
    bench.send(HEAD, unit_id=OWN)
    assert [pdu for _, _, pdu in bench.port.replies] == [bytes.fromhex("03020001")]
    bench.port.replies.clear()
    bench.serve()
    assert bench.port.replies == []
    assert bench.seen == [OTHER]


def test_what_its_connection_has_given_up_is_not_answered() -> None:
    bench = own_bench(axis_plan(), serial=False)
    bench.line.request(bench.port, 1, OWN, HEAD, bench.now_ns, why_given_up="it has gone")
    assert bench.port.replies == []


def test_rights_count_there_as_everywhere() -> None:
    bench = own_bench(axis_plan(), serial=False, tcp_drive=True)
    only_one = Port(ControllerPlan("hmi", rights=Rights(unit_ids=frozenset({1}))))
    both = Port(ControllerPlan("hmi2", rights=Rights(unit_ids=frozenset({1, OWN}))))
    for port in (only_one, both):
        bench.send(HEAD, port, unit_id=OWN)
    assert only_one.take() == bytes.fromhex("830A")
    assert both.take() == bytes.fromhex("03020001")


def test_without_a_status_unit_its_id_is_one_like_others() -> None:
    bench = Bench(axis_plan())
    bench.send(HEAD, unit_id=OWN)
    assert bench.link.sent == [(OWN, HEAD)]
