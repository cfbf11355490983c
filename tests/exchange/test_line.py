"""Which requests are sent, what happens without an answer, and which frames are never sent."""

from typing import Any, Final

import pytest

from gateway.catalogue import exchange_events
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan, LineTiming, OtherUnits, Role
from gateway.exchange.queue import WAITING_BYTES
from gateway.exchange.rights import RegisterSpan, Rights
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Port, axis_plan, monitor, read, write
from tests.exchange.staged_bench import RUN_PDU, STOP_PDU, StagedBench

OTHER = bytes.fromhex("03 0700 0001")


def test_one_exchange_at_a_time_and_the_next_is_sent_with_the_reply() -> None:
    bench = Bench()
    bench.send(OTHER, transaction_id=1)
    bench.send(bytes.fromhex("03 0701 0001"), Port(ControllerPlan("second")), transaction_id=2)
    assert len(bench.link.sent) == 1
    bench.line.reply(1, bytes.fromhex("03 02 0000"), bench.now_ns)
    assert bench.link.sent[1] == (1, bytes.fromhex("03 0701 0001"))
    assert bench.port.replies == [(1, 1, bytes.fromhex("03 02 0000"))]


def test_motion_is_sent_before_monitors() -> None:
    bench = Bench(serial=False)
    hmi = monitor()
    bench.send(OTHER)
    bench.send(bytes.fromhex("03 0001 0001"), hmi)
    bench.send(bytes.fromhex("03 0002 0001"))
    bench.serve()
    assert [pdu[2] for pdu in bench.seen] == [0, 2, 1]


@pytest.mark.parametrize(("serial", "replies"), [(False, [(7, 1, bytes.fromhex("83 0B"))]), (True, [])])
def test_a_silent_drive_is_0x0b_on_tcp_and_silent_on_serial(
    serial: bool, replies: list[tuple[int, int, bytes]]
) -> None:
    bench = Bench(serial=serial)
    bench.send(OTHER)
    bench.wait(999)
    assert bench.port.replies == []
    bench.wait(1)
    assert bench.port.replies == replies
    assert bench.link.abandoned == 1
    assert bench.line.counters.timeouts == 1


def test_the_gateway_is_never_less_patient_than_the_controller() -> None:
    bench = Bench(timing=LineTiming(response_timeout_ms=100))
    patient = Port(ControllerPlan("plc", timeout_ms=3000))
    bench.send(OTHER, patient)
    bench.wait(2999)
    assert bench.link.abandoned == 0
    bench.wait(1)
    assert bench.link.abandoned == 1


def test_after_a_time_out_nothing_is_sent_to_a_serial_line_until_it_was_silent() -> None:
    bench = Bench(serial=False, timing=LineTiming(drain_ms=50))
    bench.send(OTHER)
    bench.wait(1000)
    bench.link.sent.clear()
    bench.send(bytes.fromhex("03 0701 0001"))
    assert bench.link.sent == []
    bench.wait(40)
    bench.line.stray(bench.now_ns)  # the late reply: silence counts from here
    assert bench.leaves_after(50) == (1, bytes.fromhex("03 0701 0001"))


def test_after_a_time_out_the_next_request_to_a_tcp_drive_is_sent_immediately() -> None:
    bench = Bench(serial=False, tcp_drive=True)
    bench.send(OTHER)
    bench.send(bytes.fromhex("03 0701 0001"), Port(ControllerPlan("second", timeout_ms=5000)))
    bench.wait(1000)
    assert bench.link.sent[1:] == [(1, bytes.fromhex("03 0701 0001"))]


def test_w5_a_serial_controller_that_repeats_withdraws_what_it_sent_before() -> None:
    bench = Bench()
    busy = Port(ControllerPlan("hmi"))
    bench.send(OTHER, busy)
    bench.send(bytes.fromhex("06 0700 0001"))
    bench.send(bytes.fromhex("06 0700 0001"))
    bench.serve()
    assert bench.seen == [OTHER, bytes.fromhex("06 0700 0001")]
    assert bench.kinds()[-1] == "withdrawn"


def test_withdrawn_requests_are_reported_once_a_second_for_each_controller() -> None:
    """Thirty reads of each of two panels wait for a slow drive, and both connections end."""
    bench = Bench(serial=False)
    busy, panel, other = (Port(ControllerPlan(name)) for name in ("cnc", "panel", "other"))
    bench.send(OTHER, busy)
    for port in (panel, other):
        for number in range(30):
            bench.send(OTHER, port, transaction_id=number)
        bench.line.controller_gone(port, bench.now_ns)
    bench.serve()
    told = [event.detail for event in bench.events if event.kind is exchange_events.WITHDRAWN]
    assert len(told) == 2
    assert told[0].startswith("a request of panel was not sent: ")
    assert bench.line.counters.withdrawn == 60
    bench.wait(1000)
    bench.send(OTHER, busy)
    bench.send(OTHER, panel)
    bench.line.controller_gone(panel, bench.now_ns)
    told = [event.detail for event in bench.events if event.kind is exchange_events.WITHDRAWN]
    assert told[2].endswith(", 30 times since the last note")


def test_a_late_reply_is_not_passed_on_for_the_next_request_of_a_serial_controller() -> None:
    bench = Bench()
    bench.send(OTHER)
    bench.send(bytes.fromhex("03 0701 0001"))
    bench.line.reply(1, bytes.fromhex("03 02 1111"), bench.now_ns)
    assert bench.port.replies == []
    bench.line.reply(1, bytes.fromhex("03 02 2222"), bench.now_ns)
    assert bench.port.take() == bytes.fromhex("03 02 2222")


@pytest.mark.parametrize(
    "pdu",
    [
        "01", "02 00", "03", "03 07 00 00", "04 0700", "05 0001 FF", "06 0700 00", "0F 0000 0008 01",
        "10 01 00", "10 0700 0001 02 00", "10 0700 0002 04 0001", "16 0700 0001 00", "17 0700 0001 0800",
        "17 0700 0001 0800 0001 02 00",
    ],
)  # fmt: skip
def test_a_request_that_lacks_bytes_never_reaches_the_drives(pdu: str) -> None:
    """If it made a drive's server close or hang, all other controllers would lose their answers."""
    request = bytes.fromhex(pdu)
    for bench in (Bench(), Bench(serial=False)):
        bench.send(request)
        assert bench.link.sent == []
        assert [reply for _, _, reply in bench.port.replies] == [bytes((request[0] | 0x80, 3))]
        bench.port.replies.clear()
        assert bench.ask(OTHER)[0] == 3


@pytest.mark.parametrize("pdu", ["03 0700 0001 00", "06 0700 0001 00", "10 0700 0001 02 0001 00", "41", "2B"])
def test_a_request_that_is_too_long_or_of_no_known_function_passes_as_it_came(pdu: str) -> None:
    bench = Bench()
    bench.send(bytes.fromhex(pdu))
    assert bench.link.sent == [(1, bytes.fromhex(pdu))]


def test_w5_a_closed_connection_withdraws_its_requests() -> None:
    bench = Bench(serial=False)
    gone = Port(ControllerPlan("plc"))
    bench.send(OTHER)
    bench.send(write(COMMAND, 5), gone)
    bench.line.controller_gone(gone, bench.now_ns)
    bench.serve()
    assert bench.seen == [OTHER]


def test_a_request_older_than_its_controllers_patience_is_not_sent() -> None:
    bench = Bench(serial=False)
    hasty = Port(ControllerPlan("plc", timeout_ms=50))
    bench.send(OTHER)
    bench.send(write(COMMAND, 5), hasty)
    bench.wait(60)
    bench.serve()
    assert bench.seen == [OTHER]
    assert hasty.replies == []


@pytest.mark.parametrize("pdu", ["06 0700 0001", "10 0700 0001 02 0001", "05 0001 FF00", "2B 0D 00", "41"])
def test_a_monitor_may_only_read(pdu: str) -> None:
    bench = Bench()
    hmi = monitor()
    request = bytes.fromhex(pdu)
    bench.send(request, hmi)
    assert bench.link.sent == []
    assert hmi.take() == bytes((request[0] | 0x80, 1))


@pytest.mark.parametrize("pdu", ["03 0700 0001", "04 0700 0001", "01 0000 0001", "2B 0E 01 00", "07", "11"])
def test_a_monitor_may_read(pdu: str) -> None:
    bench = Bench()
    bench.send(bytes.fromhex(pdu), monitor())
    assert bench.link.take() == bytes.fromhex(pdu)


def test_a_hundred_requests_at_once_are_answered_in_order() -> None:
    """As modbus-serial sends them."""
    bench = Bench(serial=False)
    for number in range(100):
        bench.send(OTHER, transaction_id=number)
    bench.serve()
    assert bench.port.replies == [(n, 1, bytes.fromhex("03 02 0000")) for n in range(100)]


FEW: Final = -(-WAITING_BYTES // (64 + 5))
"""Reads of registers that have room: 950."""


def test_requests_without_room_are_answered_busy_after_the_answers_before_them() -> None:
    bench = Bench(serial=False)
    for number in range(FEW + 3):
        bench.send(OTHER, transaction_id=number)  # the first is on the wire
    assert bench.port.replies == []
    for _ in range(FEW + 1):
        bench.line.reply(*bench.link.sent.pop()[:1], bytes.fromhex("03 02 0000"), bench.now_ns)
    assert [number for number, _, _ in bench.port.replies] == list(range(FEW + 3))
    assert [pdu.hex() for _, _, pdu in bench.port.replies[-3:]] == ["03020000", "8306", "8306"]


def test_each_host_has_its_own_room_for_requests() -> None:
    bench = Bench(serial=False)
    ports = [Port(ControllerPlan("plc")) for _ in range(3)]
    for port, host in zip(ports, ("10.0.0.1", "10.0.0.1", "10.0.0.2"), strict=True):
        port.peer = host
    for number in range(FEW + 1):
        bench.send(OTHER, ports[0], transaction_id=number)
    bench.send(OTHER, ports[1])  # it waits for nothing before
    assert ports[1].take() == bytes.fromhex("83 06")
    bench.send(OTHER, ports[2])
    assert ports[2].replies == []


def test_m3_a_stop_is_sent_first_even_if_nothing_has_room() -> None:
    bench = StagedBench(serial=False)
    for number in range(FEW + 2):
        bench.send(OTHER, transaction_id=number)
    bench.send(STOP_PDU, transaction_id=9999)
    bench.link.sent.clear()
    bench.line.reply(1, bytes.fromhex("03 02 0000"), bench.now_ns)
    assert bench.link.sent == [(1, STOP_PDU)]


def test_a_flood_is_answered_busy_immediately() -> None:
    bench = Bench(serial=False)
    for number in range(2 * FEW + 10):
        bench.send(OTHER, transaction_id=number)
    assert bench.port.replies[0] == (2 * FEW + 1, 1, bytes.fromhex("83 06"))


def test_a_line_that_is_down_answers_0x0a_on_tcp_and_nothing_on_a_serial_line() -> None:
    bench = Bench(serial=False)
    bench.send(OTHER, transaction_id=1)
    bench.send(OTHER, transaction_id=2)
    bench.line.link_down(bench.now_ns)
    # the first was on the wire and may have been executed; the second was never sent
    assert bench.port.replies == [(1, 1, bytes.fromhex("83 0B")), (2, 1, bytes.fromhex("83 0A"))]
    bench.send(OTHER, transaction_id=3)
    assert bench.port.replies[-1] == (3, 1, bytes.fromhex("83 0A"))
    quiet = Port(ControllerPlan("cnc", serial=True))
    bench.send(OTHER, quiet)
    assert quiet.replies == []


def test_a_broadcast_is_not_answered_and_the_line_rests_for_the_turnaround() -> None:
    bench = Bench(timing=LineTiming(turnaround_ms=100))
    bench.send(bytes.fromhex("06 0700 0001"), unit_id=0)
    assert bench.link.sent == [(0, bytes.fromhex("06 0700 0001"))]
    bench.link.sent.clear()
    bench.send(OTHER)
    assert bench.link.sent == []
    bench.wait(100)
    assert bench.link.take() == OTHER
    assert bench.port.replies == []


def test_a_broadcast_position_is_never_sent() -> None:
    bench = Bench(axis_plan())
    bench.send(write(COMMAND, 5), unit_id=0)
    assert bench.link.sent == []
    assert bench.kinds()[-1] == "refused-value"


def test_stopping_finishes_the_exchange_on_the_wire_and_sends_nothing_new() -> None:
    bench = Bench(serial=False)
    bench.send(OTHER, transaction_id=1)
    bench.send(OTHER, transaction_id=2)
    bench.line.stop(bench.now_ns)
    idle_before = bench.line.is_idle
    bench.serve()
    assert (idle_before, bench.line.is_idle) == (False, True)
    assert [reply[0] for reply in bench.port.replies] == [1]
    bench.send(OTHER)
    assert bench.link.sent == []


def test_a_position_that_leaves_the_travel_is_refused_and_answered_on_serial_lines_too() -> None:
    bench = Bench(axis_plan(travel=(0.0, 100.0)))
    bench.move(50_000)
    frames = len(bench.seen)
    for request in (write(COMMAND, 200_000), write(COMMAND, -51_000)):
        assert bench.ask(request) == bytes.fromhex("90 04")
    assert all(pdu[0] == 3 for pdu in bench.seen[frames:])
    assert bench.kinds()[-1] == "refused-value"
    assert bench.actual() == 50_000


def test_a_corrected_value_that_does_not_fit_its_register_is_refused_never_wrapped() -> None:
    bench = Bench(axis_plan())
    assert bench.ask(write(COMMAND, 2**31 - 5)) == bytes.fromhex("90 04")
    assert "2147483647" in bench.events[-1].detail


def test_a_wrong_echo_passes_untouched_and_is_no_acknowledgement() -> None:
    bench = Bench(axis_plan())
    bench.move(50_000)
    bench.send(write(COMMAND, 60_000))
    bench.serve_reads()
    # Makerbase reports failure so
    assert bench.answers(bytes.fromhex("10 0606 0000")) == write(COMMAND, 60_010)
    assert bench.port.take() == bytes.fromhex("10 0606 0000")
    assert bench.line.axes[0].compensation.accepted is None


@pytest.mark.parametrize("code", [0x01, 0x27, 0x29, 33, 35])
def test_exception_codes_pass_as_they_are(code: int) -> None:
    bench = Bench(axis_plan())
    bench.send(write(COMMAND, 60_000))
    bench.serve_reads()
    bench.answers(bytes((0x90, code)))
    assert bench.port.take() == bytes((0x90, code))


def test_after_an_exception_the_branch_of_the_same_target_is_decided_again() -> None:
    bench = Bench(axis_plan())
    bench.move(50_000)
    bench.send(write(COMMAND, 20_000))
    bench.serve_reads()
    bench.answers(bytes.fromhex("90 04"))
    bench.port.take()
    bench.wait(30)
    bench.ask(write(COMMAND, 20_000))
    assert bench.seen[-2] == read(ACTUAL)
    assert bench.seen[-1] == write(COMMAND, 19_990)


def test_an_exception_that_writes_nothing_leaves_the_state_as_it_was() -> None:
    bench = Bench(axis_plan(exception_writes_nothing=True))
    bench.move(50_000)
    bench.send(write(COMMAND, 20_000))
    bench.serve_reads()
    bench.answers(bytes.fromhex("90 04"))
    accepted = bench.line.axes[0].compensation.accepted
    assert accepted is not None
    assert accepted.nominal_counts == 50_000


def test_a_silent_drive_during_the_added_read_means_that_nothing_was_written() -> None:
    bench = Bench(axis_plan(), serial=False)
    bench.send(write(COMMAND, 20_000))
    assert bench.link.take() == read(ACTUAL)
    bench.wait(1000)
    assert bench.link.sent == []
    assert bench.port.take() == bytes.fromhex("90 0B")


def test_replies_of_other_units_do_not_answer() -> None:
    bench = Bench(serial=False)
    bench.send(OTHER, unit_id=1)
    bench.line.reply(2, bytes.fromhex("03 02 0000"), bench.now_ns)
    assert bench.port.replies == []
    assert not bench.line.is_idle


def test_silence_is_reported_once_per_change() -> None:
    bench = Bench(serial=False, tcp_drive=True)
    for _ in range(3):
        bench.send(OTHER)
        bench.wait(1000)
    bench.wait(1000)
    bench.link.sent.clear()
    bench.port.replies.clear()
    bench.ask(OTHER)
    assert bench.kinds() == ["line-up", "drive-silent", "drive-backed-off", "drive-answers"]


def test_deadlines_lie_ahead_and_end_with_the_exchange() -> None:
    bench = Bench(serial=False)
    bench.send(OTHER)
    assert bench.line.deadline_ns == bench.now_ns + 1000 * MS
    bench.serve()
    assert bench.line.deadline_ns is None


# === odd frames: of another length than their function code says, for a device that is no axis ===========

START: Final = bytes.fromhex("03 01 01")
"""Function 3 with two bytes: it starts a spindle on some inverters."""
SPEED: Final = bytes.fromhex("05 02 13 88")
LONG: Final = bytes.fromhex("03 01 01 00 00 00 09 07")
READ: Final = bytes.fromhex("03 0700 0001")
ODD: Final = OtherUnits(frozenset({5}), frozenset({5}))
ALL_ODD: Final = (START, SPEED, LONG)


def port_of(
    name: str = "cnc",
    *,
    role: Role = Role.MOTION,
    wired: bool = True,
    timeout_ms: float = 1000.0,
    rights: Rights | None = None,
) -> Port:
    plan = ControllerPlan(name, role, timeout_ms, serial=wired, rights=rights or Rights())
    port = Port(plan)
    port.ends_by_silence = wired
    return port


def line(*, port: Port | None = None, **timing: float) -> Bench:
    """Time-outs of 100 ms, silences of 50 ms; the first trial after 200 ms."""
    times: dict[str, Any] = {"response_timeout_ms": 100.0, "drain_ms": 50.0, "retry_ms": 200.0, **timing}
    bench = Bench(axis_plan(), timing=LineTiming(**times), other_units=ODD)
    bench.port = port or port_of()
    return bench


@pytest.mark.parametrize("pdu", ALL_ODD, ids=lambda pdu: pdu.hex())
def test_w1_an_odd_request_and_its_reply_pass_as_they_are(pdu: bytes) -> None:
    bench = line()
    bench.send(pdu, unit_id=5)
    assert bench.link.sent == [(5, pdu)]
    bench.line.reply(5, pdu + b"\x01", bench.now_ns)
    assert bench.port.take() == pdu + b"\x01"
    bench.send(pdu, unit_id=5)
    bench.line.reply(5, bytes((pdu[0] | 0x80,)), bench.now_ns)
    assert bench.port.take() == bytes((pdu[0] | 0x80,))
    assert bench.line.counters.exceptions == 1


@pytest.mark.parametrize("pdu", [START, SPEED])
@pytest.mark.parametrize(("unit_id", "wired"), [(1, True), (6, True), (5, False)])
def test_w1_an_odd_frame_to_other_units_or_over_tcp_is_refused(
    pdu: bytes, unit_id: int, *, wired: bool
) -> None:
    bench = line(port=port_of(wired=wired))
    bench.send(pdu, unit_id=unit_id)
    assert bench.link.sent == []
    assert bench.port.take() == bytes((pdu[0] | 0x80, 3))


def test_w9_an_odd_frame_counts_as_a_write_whatever_its_function_code() -> None:
    for role in (Role.MONITOR, Role.OPERATOR):
        for wired in (True, False):
            bench = line(port=port_of("hmi", role=role, wired=wired))
            bench.send(LONG, unit_id=5)
            assert bench.link.sent == []
            assert bench.port.take() == bytes((LONG[0] | 0x80, 1))
            bench.send(READ, unit_id=5)
            assert bench.link.take() == READ


@pytest.mark.parametrize(
    ("rights", "pdu", "code"),
    [
        (Rights(is_read_only=True), START, 1),
        (Rights(function_codes=frozenset({3, 6})), SPEED, 1),
        (Rights(function_codes=frozenset({3, 5})), SPEED, 0),
        (Rights(function_codes=frozenset({3})), START, 0),
        (Rights(unit_ids=frozenset({1})), START, 0x0A),
        # Function 3 is named for reads there: what an odd one touches nobody can tell.
        (Rights(function_codes=frozenset({3}), readable=(RegisterSpan(0, 0xFFFF),)), START, 2),
        (Rights(function_codes=frozenset({3}), writable=(RegisterSpan(0, 0xFFFF),)), START, 2),
        (Rights(writable=(RegisterSpan(0, 0xFFFF),)), bytes.fromhex("07 01"), 1),
        (Rights(writable=(RegisterSpan(0, 0xFFFF),)), bytes.fromhex("18 01"), 1),
        (
            Rights(function_codes=frozenset({7}), writable=(RegisterSpan(0, 0xFFFF),)),
            bytes.fromhex("07 01"),
            0,
        ),
    ],
)
def test_w9_the_rights_apply_to_an_odd_frame(rights: Rights, pdu: bytes, code: int) -> None:
    bench = line(port=port_of(rights=rights))
    for _ in range(2):  # the second time by what was remembered
        bench.send(READ if 3 in rights.function_codes else pdu, unit_id=6)
        bench.link.sent.clear()
        bench.line.reply(6, b"\x83\x02", bench.now_ns)
        bench.port.replies.clear()
        bench.send(pdu, unit_id=5)
        if code:
            assert bench.link.sent == []
            answer = [] if code == 0x0A else [(7, 5, bytes((pdu[0] | 0x80, code)))]  # W7: silence
            assert bench.port.replies == answer
        else:
            assert bench.link.take() == pdu
            bench.line.reply(5, pdu, bench.now_ns)


def test_w9_a_read_with_the_head_of_an_odd_frame_is_judged_separately() -> None:
    rights = Rights(is_read_only=True)
    bench = line(port=port_of(rights=rights))
    odd, ordinary = bytes.fromhex("03 0700 0001 00"), READ
    for _ in range(2):
        bench.send(ordinary, unit_id=5)
        assert bench.link.take() == ordinary
        bench.line.reply(5, b"\x03\x02\x00\x01", bench.now_ns)
        bench.port.replies.clear()
        bench.send(odd, unit_id=5)
        assert bench.link.sent == []
        assert bench.port.take() == b"\x83\x01"


def test_w5_an_odd_frame_is_withdrawn_when_its_controller_sends_a_new_request() -> None:
    bench = line()
    other = port_of("panel")
    bench.send(read(ACTUAL), other)  # busy
    bench.link.sent.clear()
    bench.send(START, unit_id=5)
    bench.send(SPEED, unit_id=5)
    bench.line.reply(1, bench.memory.answer(read(ACTUAL)), bench.now_ns)
    assert bench.link.sent == [(5, SPEED)]
    assert bench.line.counters.withdrawn == 1


def test_w5_an_odd_frame_is_not_sent_again_after_a_time_out() -> None:
    bench = line(response_timeout_ms=1000.0)
    bench.send(START, unit_id=5)
    assert bench.link.take() == START
    for _ in range(30):
        bench.wait(100)
    assert bench.link.sent == []


@pytest.mark.parametrize("pdu", [START, LONG])
def test_w6_after_a_time_out_of_another_unit_an_odd_frame_waits_for_silence_and_a_read_does_not(
    pdu: bytes,
) -> None:
    bench = line()
    bench.missed(READ, 1000, unit_id=9)
    bench.send(pdu, unit_id=5)
    assert bench.link.sent == []
    bench.wait(47)
    assert bench.link.sent == []
    bench.wait(3)
    assert bench.link.sent == [(5, pdu)]

    bench = line()
    bench.missed(READ, 1000, unit_id=9)
    bench.send(READ, unit_id=5)
    assert bench.link.sent == [(5, READ)]


def test_m3_an_odd_frame_keeps_its_place_before_a_later_write() -> None:
    bench = line()
    panel, third = port_of("panel"), port_of("third")
    bench.send(read(ACTUAL), panel)
    bench.link.sent.clear()
    bench.send(START, unit_id=5)
    bench.send(write(COMMAND, 50_000), third)
    bench.line.reply(1, bench.memory.answer(read(ACTUAL)), bench.now_ns)
    assert bench.link.sent == [(5, START)]  # in the order in which they came: it is no stop itself


def dead_line(**options: Any) -> Bench:
    """A line whose unit 5 left three requests unanswered, the last 50 ms ago."""
    bench = line(**options)
    for _ in range(3):
        bench.send(SPEED, unit_id=5)
        assert bench.link.take() == SPEED
        bench.wait(bench.port.patience_ns / 1e6)
        bench.port.replies.clear()
        bench.wait(50)
    assert bench.kinds()[-1] == "drive-backed-off"
    return bench


def test_w11_the_newest_odd_frame_to_a_dead_unit_is_sent_every_retry_ms_and_none_twice() -> None:
    bench = dead_line(port=port_of(timeout_ms=100.0))
    sent: list[tuple[int, bytes]] = []
    for number in range(150):  # every 20 ms another one
        bench.send(bytes((5, 2, 0, number)), unit_id=5)
        sent += [(number, pdu) for _, pdu in bench.link.sent]
        bench.link.sent.clear()
        bench.wait(20)
        sent += [(number, pdu) for _, pdu in bench.link.sent]
        bench.link.sent.clear()
    # The first 200 ms after the third time-out, of which 50 are gone; then 100 until a time-out and 200 more.
    assert sent == [(number, bytes((5, 2, 0, number))) for number in range(7, 150, 15)]


def test_w11_an_odd_frame_alone_waits_for_the_trial_while_half_of_its_time_is_left() -> None:
    bench = dead_line()
    assert bench.link.sent == []
    bench.send(START, unit_id=5)  # 150 ms too soon, and its controller waits for 1000
    assert bench.link.sent == []
    assert bench.port.replies == []
    assert bench.leaves_after(150)[1] == START


def test_w11_an_odd_frame_that_would_wait_too_long_is_answered_immediately() -> None:
    bench = dead_line(port=port_of(timeout_ms=200.0))
    bench.send(START, unit_id=5)  # 150 ms too soon, and its controller waits for 200
    assert bench.port.take() == bytes.fromhex("83 0B")
    bench.wait(149)
    bench.wait(100)
    assert bench.link.sent == []


def test_w11_a_read_of_a_dead_device_is_answered_as_usual_and_its_pause_doubles() -> None:
    bench = dead_line()
    bench.send(READ, unit_id=5)
    assert bench.port.take() == bytes.fromhex("83 0B")
    bench.wait(150)
    bench.send(READ, unit_id=5)
    assert bench.link.take() == READ
    bench.wait(100)  # response_timeout_ms: a read that is the trial
    bench.port.replies.clear()
    bench.wait(250)
    bench.send(READ, unit_id=5)  # 400 ms this time
    assert bench.port.take() == bytes.fromhex("83 0B")
    bench.send(START, unit_id=5)
    assert bench.link.take() == START  # 200 ms each time


def test_w11_an_odd_frame_that_waits_for_a_trial_is_withdrawn_by_the_next_request() -> None:
    bench = dead_line()
    bench.send(START, unit_id=5)
    bench.send(read(ACTUAL))
    bench.serve()
    assert bench.seen[-1] == read(ACTUAL)
    bench.wait(300)
    assert bench.link.sent == []


def test_w11_an_answer_to_an_odd_frame_ends_the_back_off() -> None:
    bench = dead_line()
    bench.wait(150)
    bench.send(START, unit_id=5)
    bench.line.reply(5, START, bench.now_ns)
    assert bench.port.take() == START
    assert bench.kinds()[-1] == "drive-answers"
    assert bench.line.silent_units.silences == {}


def test_w6_an_odd_frame_that_is_a_trial_waits_for_the_silence_of_another_unit() -> None:
    """Unit 5 is dead: it is due 200 ms after the last time-out. Unit 1 owes a reply until 10 ms later."""
    bench, plc = line(port=port_of(timeout_ms=5000.0)), port_of("plc", wired=False, timeout_ms=100.0)
    for _ in range(3):
        bench.missed(READ, 100, 50, port=plc, unit_id=5)
    bench.send(START, unit_id=5)
    bench.wait(10)
    bench.missed(READ, 100, 40, port=plc)
    plc.replies.clear()
    assert bench.leaves_after(10) == (5, START)


# === W6 over the end of a gateway: its line falls silent first ===========================================

FIRST, SECOND = bytes.fromhex("03 0700 0001"), bytes.fromhex("03 0701 0001")
PATIENT = ControllerPlan("plc", timeout_ms=5000.0)
TIMING = LineTiming(drain_ms=50.0)


def awaits_late_reply(line: LineExchange) -> None:
    line.rest.expect_late_reply()


def is_owed(bench: Bench) -> bool:
    return bench.line.rest.needs_silence


def test_nothing_is_sent_before_the_silence_and_waiting_requests_keep_their_order() -> None:
    bench = Bench(axis_plan(), timing=TIMING, before_up=awaits_late_reply)
    port = Port(PATIENT)
    bench.send(FIRST, port)
    bench.wait(49)
    bench.send(SECOND, port)
    assert (bench.link.sent, port.replies) == ([], [])
    assert is_owed(bench)
    bench.wait(1)
    assert bench.link.sent == [(1, FIRST)]
    assert not is_owed(bench)
    bench.serve()
    assert bench.seen == [FIRST, SECOND]


def test_a_late_reply_restarts_the_silence_and_a_line_that_is_never_silent_is_used_nevertheless() -> None:
    bench = Bench(axis_plan(), timing=TIMING, before_up=awaits_late_reply)
    bench.send(FIRST, Port(PATIENT))
    for _ in range(4):  # at 30, 60, 90 and 120 ms; three times the silence are 150 ms
        bench.wait(30)
        bench.line.stray(bench.now_ns)
        assert bench.link.sent == []
    assert bench.leaves_after(30) == (1, FIRST)


def test_m3_a_stop_is_sent_before_and_after_the_silence_and_withdraws_queued_moves() -> None:
    bench = StagedBench(serial=False, timing=TIMING, before_up=awaits_late_reply)
    bench.send(FIRST, Port(PATIENT))
    bench.send(RUN_PDU)
    panel = Port(ControllerPlan("panel", timeout_ms=20.0))
    bench.send(STOP_PDU, panel)
    assert bench.link.sent == [(1, STOP_PDU)]
    bench.line.reply(1, bytes.fromhex("86 04"), bench.now_ns)  # it may answer whoever was here before
    assert panel.replies == []
    bench.wait(50)
    assert bench.link.sent == [(1, STOP_PDU)] * 2
    bench.line.reply(1, STOP_PDU, bench.now_ns)
    assert panel.take() == STOP_PDU
    assert bench.port.take() == bytes.fromhex("86 06")  # the move that the stop has overtaken


def test_a_lost_cable_restarts_the_silence() -> None:
    bench = Bench(axis_plan(), timing=TIMING, before_up=awaits_late_reply)
    bench.wait(49)
    bench.line.link_down(bench.now_ns)
    assert is_owed(bench)
    bench.wait(1000)
    bench.line.link_up(bench.now_ns)
    bench.send(FIRST, Port(PATIENT))
    assert bench.leaves_after(50) == (1, FIRST)


def test_a_gateway_that_stops_owes_a_silence_only_for_a_request_on_the_wire_or_a_late_reply() -> None:
    bench = Bench(axis_plan(), timing=TIMING)
    bench.line.link_down(bench.now_ns)
    assert not is_owed(bench)
    bench.line.link_up(bench.now_ns)
    bench.send(FIRST)
    bench.line.stop(bench.now_ns)
    bench.wait(1000)  # time-out
    assert bench.line.is_idle
    bench.line.link_down(bench.now_ns)
    assert is_owed(bench)
