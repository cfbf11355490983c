"""The rights of a controller: function codes, unit ids, addresses, rates (W9)."""

from dataclasses import replace
from typing import Any

import pytest

from gateway.config.build import shipped_stops
from gateway.drives.motion import Action, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import ControllerPlan, LineTiming, OtherUnits, Role
from gateway.exchange.rights import RegisterSpan, Rights
from gateway.modbus.registers import PositionField, RegisterType
from gateway.status.line import UnitIds
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Port, axis_plan, monitor, read, write
from tests.exchange.staged_bench import RUN_PDU, STOP_PDU, StagedBench, staged_plan

POSITION = RegisterSpan(0x0606, 0x0607)
PLACE = RegisterSpan(0x0520, 0x0521)


def panel(rights: Rights, role: Role = Role.MOTION, *, serial: bool = False, peer: str = "10.0.0.2") -> Port:
    port = Port(ControllerPlan("panel", role, serial=serial, rights=rights))
    port.peer, port.writer = peer, f"panel ({peer})"
    return port


def asked(bench: Bench, port: Port, pdu: str, unit_id: int = 1) -> str:
    """Send a request of a controller; return the reply, empty for silence."""
    bench.send(bytes.fromhex(pdu), port, unit_id)
    bench.serve()
    return port.take().hex() if port.replies else ""


SPANS = Rights(readable=(PLACE, POSITION), writable=(POSITION,))
OBJECTS = replace(
    SPANS, function_codes=frozenset({3, 0x2B}), writable=(POSITION, RegisterSpan(0x1000, 0x1000))
)
READ_PLACE = "03 0520 0002"
WRITE_POSITION = "10 0606 0002 04 0000 0000"
CASES = [
    # rights, request, reply of the gateway itself; empty: it reaches the drive
    (Rights(function_codes=frozenset({3, 16})), READ_PLACE, ""),
    (Rights(function_codes=frozenset({3, 16})), WRITE_POSITION, ""),
    (Rights(function_codes=frozenset({3, 16})), "06 0606 0001", "8601"),
    (Rights(function_codes=frozenset({3, 16})), "2b 0e 01 00", "ab01"),
    (Rights(function_codes=frozenset({3, 16})), "64 01", "e401"),
    (Rights(is_read_only=True), READ_PLACE, ""),
    (Rights(is_read_only=True), WRITE_POSITION, "9001"),
    (Rights(is_read_only=True), "17 0520 0002 0606 0001 02 0000", "9701"),
    (Rights(is_read_only=True), "16 0606 0000 0000", "9601"),
    (Rights(is_read_only=True), "05 0000 ff00", "8501"),
    (Rights(is_read_only=True), "0f 0000 0001 01 01", "8f01"),
    (Rights(is_read_only=True), "08 0001 0000", "8801"),
    (SPANS, READ_PLACE, ""),
    (SPANS, "04 0521 0001", ""),
    (SPANS, "03 051f 0002", "8302"),
    (SPANS, "03 0521 0002", "8302"),
    (SPANS, "03 0520 0000", ""),  # the drive's to refuse
    (SPANS, "03 0522 0000", "8302"),
    (SPANS, "03 ffff 0002", "8302"),
    (SPANS, "03 0520 0002 00", "8302"),  # longer than its function code allows: nobody knows what it reads
    (SPANS, "01 0520 0003", "8102"),
    (SPANS, WRITE_POSITION, ""),
    (SPANS, "10 0606 0003 06 0000 0000 0000", "9002"),
    (SPANS, "10 0606 0002 06 0000 0000 0000", "9002"),  # its counts contradict each other
    (SPANS, "10 0606 0001 04 0000 0000", "9002"),
    (SPANS, "06 0605 0000", "8602"),
    (SPANS, "06 0608 0000", "8602"),
    (SPANS, "16 0605 0000 0000", "9602"),
    (SPANS, "05 0608 ff00", "8502"),
    (SPANS, "0f 0606 0003 01 00", "8f02"),
    (SPANS, "17 0520 0002 0606 0002 04 0000 0000", ""),
    (SPANS, "17 0520 0003 0606 0002 04 0000 0000", "9702"),
    (SPANS, "17 0520 0002 0605 0002 04 0000 0000", "9702"),
    (SPANS, "07", ""),
    (SPANS, "2b 0e 01 00", ""),
    (SPANS, "2b 0d 01 0000 0606 00 00 00 00 02 0000", "ab01"),  # nobody can tell what it touches
    (OBJECTS, "2b 0d 01 0000 1000 00 00 00 00 04 0000 0000", ""),
    (OBJECTS, "2b 0d 01 0000 1001 00 00 00 00 04 0000 0000", "ab02"),
    (OBJECTS, "2b 0d 00 0000 0520 00 00 00 00 02", ""),
    (OBJECTS, "2b 0d 00 0000 0522 00 00 00 00 02", "ab02"),
    (OBJECTS, "2b 0d 01 0000 0606 01 00 00 00 02 0000", "ab02"),  # another sub-index may be anything
    (OBJECTS, "2b 0d 01 0000 0606", "ab02"),
    (OBJECTS, "2b 0e 01 00", ""),
    (SPANS, "08 0001 0000", "8801"),
    (SPANS, "64 0606", "e401"),
    (SPANS, "18 0520", "9801"),
    (replace(SPANS, function_codes=frozenset({0x64, 3})), "64 0606", ""),
    (Rights(writable=(POSITION,)), "18 0520", ""),
    (Rights(writable=(POSITION,)), "03 1234 0001", ""),
    (Rights(readable=(PLACE,)), "06 1234 0001", ""),
]


@pytest.mark.parametrize(("rights", "request_pdu", "refusal"), CASES)
def test_w9_only_requests_that_the_rights_allow_reach_the_drive(
    rights: Rights, request_pdu: str, refusal: str
) -> None:
    bench = Bench(axis_plan())
    port, seen = panel(rights), len(bench.seen)
    for _ in range(3):  # a verdict that is remembered is the same
        bench.wait(5_000)
        reply = asked(bench, port, request_pdu)
        assert reply == refusal if refusal else int(reply[:2], 16) & 0x7F == int(request_pdu[:2], 16)
    assert (len(bench.seen) == seen) is bool(refusal)
    assert bench.line.counters.refused_by.get("panel", 0) == (3 if refusal else 0)
    assert bench.line.counters.refused == (3 if refusal else 0)
    assert bench.kinds().count("request-refused") == (1 if refusal else 0)  # in a minute


@pytest.mark.parametrize(
    ("good", "longer", "refusal"),
    [(READ_PLACE, READ_PLACE + "00", "8302"), (WRITE_POSITION, WRITE_POSITION + "0000", "9002")],
)
def test_w9_rights_remembered_for_a_head_hold_for_its_length_only(
    good: str, longer: str, refusal: str
) -> None:
    bench = Bench(axis_plan())
    port = panel(SPANS)
    assert int(asked(bench, port, good)[:2], 16) == int(good[:2], 16)
    seen = len(bench.seen)
    assert asked(bench, port, longer) == refusal
    assert len(bench.seen) == seen
    assert int(asked(bench, port, good)[:2], 16) == int(good[:2], 16)


def test_w9_a_unit_id_that_is_not_allowed_is_absent() -> None:
    bench = Bench(axis_plan(), axis_plan(name="y", unit_id=2))
    rights = Rights(unit_ids=frozenset({2}))
    assert asked(bench, panel(rights), READ_PLACE, 1) == "830a"
    assert asked(bench, panel(rights), READ_PLACE, 2) == "030400000000"
    assert asked(bench, panel(rights, serial=True), READ_PLACE, 1) == ""  # as of a drive that is not there
    assert bench.line.counters.refused == 2
    [event] = [event for event in bench.events if event.kind.name == "request-refused"]
    assert dict(event.more) == {
        "controller": "panel",
        "peer": "10.0.0.2",
        "function_code": 3,
        "unit_id": 1,
        "key": "unit_ids",
    }
    assert event.detail == "panel (10.0.0.2) was refused: unit id 1 (unit_ids)"


@pytest.mark.parametrize(
    ("unit_ids", "is_sent"), [((1,), False), ((0, 1), False), ((0, 1, 2), True), ((1, 2), False), ((), True)]
)
def test_w9_a_broadcast_needs_the_right_to_every_unit_id(unit_ids: tuple[int, ...], *, is_sent: bool) -> None:
    bench = Bench(axis_plan(), axis_plan(name="y", unit_id=2))
    port = panel(Rights(unit_ids=frozenset(unit_ids)), serial=True)
    asked(bench, port, "06 1000 0001", unit_id=0)
    assert bench.seen == ([bytes.fromhex("06 1000 0001")] if is_sent else [])


def test_w9_on_tcp_0_is_a_unit_id_like_others() -> None:
    bench = Bench(axis_plan(unit_id=0), tcp_drive=True)
    assert asked(bench, panel(Rights(unit_ids=frozenset({0}))), READ_PLACE, 0) == "030400000000"
    assert asked(bench, panel(Rights(unit_ids=frozenset({1}))), READ_PLACE, 0) == "830a"


def test_w9_requests_that_come_too_often_are_answered_busy_and_stops_never() -> None:
    bench = StagedBench(staged_plan())
    port = panel(Rights(requests_per_s=10.0))
    # After a pause as many as in one second, and the one whose turn it is.
    for _ in range(11):
        bench.send(bytes.fromhex(READ_PLACE), port)
        bench.link.sent.clear()
        bench.line.reply(1, bytes.fromhex("03 04 0000 0000"), bench.now_ns)
    assert [pdu.hex() for _, _, pdu in port.replies] == ["030400000000"] * 11
    port.replies.clear()
    assert asked(bench, port, READ_PLACE) == "8306"
    before = len(bench.drive.moves)
    assert asked(bench, port, STOP_PDU.hex()) == STOP_PDU.hex()
    assert bench.drive.moves[before:] == [("stop", 0)]
    bench.now_ns += 99 * MS - 1 * MS  # the stop took 1 ms; a tenth of a second makes room for one
    assert asked(bench, port, READ_PLACE) == "8306"
    bench.now_ns += 1 * MS
    assert asked(bench, port, READ_PLACE) == "030400000000"
    assert asked(bench, port, READ_PLACE) == "8306"


def test_w9_all_connections_of_a_controller_share_its_rate() -> None:
    bench = Bench(axis_plan())
    rights = Rights(requests_per_s=1.0)
    replies = [asked(bench, panel(rights, peer=f"10.0.0.{n}"), READ_PLACE) for n in range(3)]
    assert replies == ["030400000000", "030400000000", "8306"]


def test_w9_a_stop_to_a_register_that_is_not_writable_is_refused() -> None:
    bench = StagedBench(staged_plan())
    assert asked(bench, panel(Rights(writable=(POSITION,))), STOP_PDU.hex()) == "8602"
    assert bench.drive.moves == []


def test_m3_the_trigger_of_a_target_that_came_too_often_is_refused() -> None:
    bench = StagedBench(staged_plan())
    port = panel(Rights(requests_per_s=1.0))
    assert asked(bench, port, write(COMMAND, 5_000).hex()) == write(COMMAND, 5_000)[:5].hex()
    assert asked(bench, port, RUN_PDU.hex()) == RUN_PDU.hex()
    assert asked(bench, port, write(COMMAND, 9_000).hex()) == "9006"
    bench.wait(3_000)
    assert asked(bench, port, RUN_PDU.hex()) == "8606"  # it would run 5 000 again
    assert [kind for kind, _ in bench.drive.moves] == ["absolute"]


def test_w9_a_monitor_that_writes_is_reported_once_a_minute() -> None:
    bench = Bench(axis_plan())
    port = monitor()
    for _ in range(600):
        assert asked(bench, port, WRITE_POSITION) == "9001"
        bench.now_ns += 200 * MS
    details = [event.detail for event in bench.events if event.kind.name == "request-refused"]
    sentence = "hmi was refused: a request that may write, from a monitor (role)"
    assert details == [sentence, f"{sentence}, 300 times since the last note"]
    assert bench.seen == []


@pytest.mark.parametrize(
    ("rights", "role", "refused", "answer"),
    [
        (Rights(), Role.MONITOR, WRITE_POSITION, "9001"),
        (Rights(), Role.OPERATOR, WRITE_POSITION, "9001"),
        (Rights(is_read_only=True), Role.MOTION, WRITE_POSITION, "9001"),
        (SPANS, Role.MOTION, "03 0522 0002", "8302"),
        (Rights(unit_ids=frozenset({2})), Role.MOTION, None, "830a"),
        (Rights(requests_per_s=1.0), Role.MOTION, READ_PLACE, "8306"),
    ],
)
def test_w1_a_refusal_comes_after_earlier_answers(
    rights: Rights, role: Role, refused: str | None, answer: str
) -> None:
    bench = Bench(axis_plan(), axis_plan(name="y", unit_id=2))
    port, seen = panel(rights, role), len(bench.seen)
    bench.send(bytes.fromhex(READ_PLACE), port, 2, transaction_id=1)
    bench.send(bytes.fromhex(READ_PLACE), port, 2, transaction_id=2)
    last = 1 if refused is None else 2
    bench.send(bytes.fromhex(refused or READ_PLACE), port, last, transaction_id=3)
    assert port.replies == []
    assert bench.kinds()[-1] == "request-refused"  # which is told at once
    bench.serve()
    assert [(number, pdu.hex()) for number, _, pdu in port.replies] == [
        (1, "030400000000"),
        (2, "030400000000"),
        (3, answer),
    ]
    assert bench.seen[seen:] == [bytes.fromhex(READ_PLACE)] * 2
    assert bench.line.counters.refused_by == {"panel": 1}


def test_w1_the_refusal_of_a_monitor_waits_for_no_gap() -> None:
    bench = Bench(axis_plan(), timing=LineTiming(monitor_max_wait_ms=500.0))
    hmi = monitor()
    asked(bench, bench.port, READ_PLACE)  # motion was there a moment ago
    bench.send(bytes.fromhex(READ_PLACE), hmi, transaction_id=1)
    bench.send(bytes.fromhex(WRITE_POSITION), hmi, transaction_id=2)
    bench.serve()
    bench.wait(0)
    assert [(number, pdu.hex()) for number, _, pdu in hmi.replies] == [(1, "030400000000"), (2, "9001")]


@pytest.mark.parametrize("end", ["stop", "close", "down"])
def test_m3_a_monitors_write_that_waits_for_its_refusal_blocks_no_axis(end: str) -> None:
    bench = StagedBench(staged_plan(), serial=False)
    hmi = monitor()
    bench.send(bytes.fromhex(READ_PLACE), hmi, transaction_id=1)
    bench.send(write(COMMAND, 9_000), hmi, transaction_id=2)
    assert hmi.replies == []
    if end == "stop":
        bench.send(STOP_PDU)
        bench.serve()
        assert [(number, pdu.hex()[:4]) for number, _, pdu in hmi.replies] == [(1, "0304"), (2, "9001")]
    elif end == "close":
        bench.line.controller_gone(hmi, bench.now_ns)
    else:
        bench.line.link_down(bench.now_ns)
    assert "axis-blocked" not in bench.kinds()


def test_w9_a_serial_controller_without_the_right_is_refused_immediately() -> None:
    """It has given up on its earlier request: no reply to that comes first."""
    bench = Bench(axis_plan())
    port = panel(SPANS, serial=True)
    bench.send(bytes.fromhex(READ_PLACE), port)
    bench.send(bytes.fromhex("03 0522 0002"), port)
    assert port.take() == bytes.fromhex("8302")


def test_w9_a_scan_of_every_unit_id_and_function_code_reaches_nothing_and_keeps_little() -> None:
    bench = Bench(axis_plan())
    port = panel(Rights(unit_ids=frozenset({1}), function_codes=frozenset({3}), readable=(PLACE,)))
    refused = 0
    for unit_id in range(256):
        for function in range(1, 128):
            bench.send(bytes((function, 5, 0x21, 0, 2)), port, unit_id)
            refused += 1
    assert bench.seen == []
    assert bench.link.sent == []
    assert {pdu[1] for _, _, pdu in port.replies} == {0x01, 0x02, 0x0A}
    assert len(port.replies) == bench.line.counters.refused == refused == 256 * 127
    assert bench.kinds() == ["line-up", *["request-refused"] * 3]  # function_codes, unit_ids, readable
    port.replies.clear()
    assert asked(bench, port, READ_PLACE) == "030400000000"


# === unit ids that have no axis: none carries a target past the correction ===============================

STOPS = OtherUnits(stops=shipped_stops())
LIMIT = PositionField(0x0700, RegisterType.INT32)
OTHER = bytes.fromhex("06 2000 0001")


def bench_of(*plans: Any, other_units: OtherUnits = STOPS, **options: Any) -> Bench:
    return Bench(*(plans or (axis_plan(),)), serial=False, tcp_drive=True, other_units=other_units, **options)


def sent_to(bench: Bench, unit_id: int, pdu: bytes) -> list[tuple[int, bytes]]:
    """Send a request to a unit id; return the requests that reached the drives. A refusal shows in its
    answer."""
    bench.line.request(bench.port, 1, unit_id, pdu, bench.now_ns)
    sent, bench.link.sent = bench.link.sent, []
    if sent:
        bench.line.reply(unit_id, bench.memory.answer(sent[0][1]), bench.now_ns)
    return sent


@pytest.mark.parametrize("unit_id", [2, 17, 254])
def test_a_target_to_another_unit_id_of_the_drive_is_refused(unit_id: int) -> None:
    bench = bench_of()
    assert sent_to(bench, unit_id, write(COMMAND, 70_000)) == []
    assert bench.port.take() == bytes((0x90, 0x0A))
    assert sent_to(bench, unit_id, bytes.fromhex("06 0607 0001")) == []  # a part of it
    assert bench.port.take() == bytes((0x86, 0x0A))
    assert bench.kinds().count("unknown-unit") == 1
    assert bench.line.unit_ids.requests == {str(unit_id): 2}


def test_a_limit_of_the_axis_is_refused_too() -> None:
    bench = bench_of(axis_plan(limits=(LIMIT,)))
    assert sent_to(bench, 17, write(LIMIT, 70_000)) == []
    assert bench.port.take() == bytes((0x90, 0x0A))


def test_a_request_that_touches_nothing_of_the_axis_passes_and_is_counted() -> None:
    bench = bench_of()
    for pdu in (OTHER, read(ACTUAL), OTHER):
        assert sent_to(bench, 17, pdu) == [(17, pdu)]
    assert bench.line.unit_ids == UnitIds(heard=[17], strangers=[17], requests={"17": 3})
    [event] = [event for event in bench.events if event.kind.name == "unknown-unit"]
    assert event.detail == "a controller addresses unit id 17, which has no axis; the axes are x (unit id 1)"


def test_requests_to_a_named_device_pass_and_are_not_counted() -> None:
    bench = bench_of(other_units=OtherUnits(frozenset({17})))
    assert sent_to(bench, 17, write(COMMAND, 70_000)) == [(17, write(COMMAND, 70_000))]
    assert bench.line.unit_ids == UnitIds(heard=[17], strangers=[], requests={})
    assert sent_to(bench, 18, write(COMMAND, 70_000)) == []


def test_behind_a_converter_of_several_axes_every_unit_id_passes() -> None:
    bench = bench_of(axis_plan(), axis_plan(name="y", unit_id=2))
    assert sent_to(bench, 17, write(COMMAND, 70_000)) == [(17, write(COMMAND, 70_000))]
    assert bench.line.unit_ids.requests == {"17": 1}


def test_every_unit_id_passes_on_a_serial_line() -> None:
    bench = Bench(axis_plan(), serial=False)
    assert sent_to(bench, 17, write(COMMAND, 70_000)) == [(17, write(COMMAND, 70_000))]
    assert bench.line.unit_ids == UnitIds(heard=[17], strangers=[17], requests={})


def test_a_trigger_is_refused_and_the_stop_of_any_known_drive_passes() -> None:
    bench = StagedBench(serial=False, tcp_drive=True, other_units=STOPS)
    bench.link.sent.clear()
    assert sent_to(bench, 17, RUN_PDU) == []
    assert bench.port.take() == bytes((0x86, 0x0A))
    assert sent_to(bench, 17, STOP_PDU) == [(17, STOP_PDU)]  # of this drive itself: 0x3E8 to 0x050E
    bench.port.replies.clear()
    assert sent_to(bench, 17, bytes.fromhex("06 6002 0040")) == [(17, bytes.fromhex("06 6002 0040"))]


def test_a_stop_of_another_drive_that_is_a_start_of_this_one_is_refused() -> None:
    # Register 0x27 of an ESS-RS: 0x100 stops. Here it is the trigger of a drive that starts with it.
    trigger = TriggerPlan(0x27, deeds={0x100: Operation(Action.ABSOLUTE)})
    plan = replace(staged_plan(), motion=MotionPlan(is_staged=True, triggers=(trigger,)))
    bench = bench_of(plan)
    bench.link.sent.clear()
    assert sent_to(bench, 17, bytes.fromhex("06 0027 0100")) == []
    assert bench.port.take() == bytes((0x86, 0x0A))


def test_an_axis_that_is_not_corrected_is_written_under_any_unit_id() -> None:
    bench = bench_of(axis_plan(table=None))
    assert sent_to(bench, 17, write(COMMAND, 70_000)) == [(17, write(COMMAND, 70_000))]
