"""Odd frames on the line: of another length than their function code says, for a device that is no axis."""

from typing import Any, Final

import pytest

from gateway.exchange.plan import ControllerPlan, LineTiming, OtherUnits, Role
from gateway.exchange.rights import RegisterSpan, Rights
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, Port, axis_plan, read, write

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
def test_w1_for_others_and_over_tcp_an_odd_frame_is_cut_short(
    pdu: bytes, unit_id: int, *, wired: bool
) -> None:
    bench = line(port=port_of(wired=wired))
    bench.send(pdu, unit_id=unit_id)
    assert bench.link.sent == []
    assert bench.port.take() == bytes((pdu[0] | 0x80, 3))


def test_w9_it_counts_as_a_write_whatever_its_function_code_says() -> None:
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
def test_w9_rights_hold_for_it(rights: Rights, pdu: bytes, code: int) -> None:
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


def test_w9_a_read_with_the_same_head_is_judged_by_itself() -> None:
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


def test_w5_it_is_withdrawn_when_its_controller_sends_anything_new() -> None:
    bench = line()
    other = port_of("panel")
    bench.send(read(ACTUAL), other)  # busy
    bench.link.sent.clear()
    bench.send(START, unit_id=5)
    bench.send(SPEED, unit_id=5)
    bench.line.reply(1, bench.memory.answer(read(ACTUAL)), bench.now_ns)
    assert bench.link.sent == [(5, SPEED)]
    assert bench.line.counters.withdrawn == 1


def test_w5_it_is_sent_once_and_not_again_after_a_time_out() -> None:
    bench = line(response_timeout_ms=1000.0)
    bench.send(START, unit_id=5)
    assert bench.link.take() == START
    for _ in range(30):
        bench.wait(100)
    assert bench.link.sent == []


@pytest.mark.parametrize("pdu", [START, LONG])
def test_w6_after_a_time_out_of_another_unit_it_waits_for_silence_and_a_read_does_not(pdu: bytes) -> None:
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


def test_m3_a_stop_of_an_axis_goes_before_it() -> None:
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


def test_w11_to_a_dead_unit_the_newest_goes_every_retry_ms_and_nothing_twice() -> None:
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


def test_w11_one_alone_waits_for_the_trial_while_half_of_its_time_is_left() -> None:
    bench = dead_line()
    assert bench.link.sent == []
    bench.send(START, unit_id=5)  # 150 ms too soon, and its controller waits for 1000
    assert bench.link.sent == []
    assert bench.port.replies == []
    assert bench.leaves_after(150)[1] == START


def test_w11_one_that_would_wait_for_longer_is_answered_at_once() -> None:
    bench = dead_line(port=port_of(timeout_ms=200.0))
    bench.send(START, unit_id=5)  # 150 ms too soon, and its controller waits for 200
    assert bench.port.take() == bytes.fromhex("83 0B")
    bench.wait(149)
    bench.wait(100)
    assert bench.link.sent == []


def test_w11_a_read_of_the_device_is_answered_as_ever_and_its_pause_doubles() -> None:
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


def test_w11_one_that_waits_for_a_trial_is_withdrawn_when_its_controller_sends_anything_new() -> None:
    bench = dead_line()
    bench.send(START, unit_id=5)
    bench.send(read(ACTUAL))
    bench.serve()
    assert bench.seen[-1] == read(ACTUAL)
    bench.wait(300)
    assert bench.link.sent == []


def test_w11_an_answer_ends_it() -> None:
    bench = dead_line()
    bench.wait(150)
    bench.send(START, unit_id=5)
    bench.line.reply(5, START, bench.now_ns)
    assert bench.port.take() == START
    assert bench.kinds()[-1] == "drive-answers"
    assert bench.line.silent_units.silences == {}


def test_w6_its_trial_waits_for_the_silence_of_another_unit() -> None:
    """Unit 5 is dead: it is due 200 ms after the last time-out. Unit 1 owes a reply until 10 ms later."""
    bench, plc = line(port=port_of(timeout_ms=5000.0)), port_of("plc", wired=False, timeout_ms=100.0)
    for _ in range(3):
        bench.missed(READ, 100, 50, port=plc, unit_id=5)
    bench.send(START, unit_id=5)
    bench.wait(10)
    bench.missed(READ, 100, 40, port=plc)
    plc.replies.clear()
    assert bench.leaves_after(10) == (5, START)
