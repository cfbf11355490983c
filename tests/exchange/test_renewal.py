"""A connection without answers is renewed; the requests that are sent on the new one (W5, W11)."""

from itertools import pairwise
from typing import Any

import pytest

from gateway.catalogue import exchange_events
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.commands import SetReference
from gateway.exchange.plan import Reference
from tests.exchange.connection_bench import ConnectionBench, controller
from tests.exchange.line_bench import ACTUAL, COMMAND, axis_plan, read, write
from tests.exchange.staged_bench import STAGED
from tests.exchange.staged_bench import STOP_PDU as STOP

READ = bytes.fromhex("03 0700 0001")
NAMED = read(ACTUAL)
"""What is read of an axis to see whether its drive is there."""
NO_ANSWER_WRITE, ABSENT_WRITE = b"\x90\x0b", b"\x90\x0a"


def mute(bench: ConnectionBench, pdu: bytes = READ, times: int = 3, unit_id: int = 1) -> None:
    """Send a request ``times`` times without an answer: 200 ms each."""
    plc = controller("cnc", timeout_ms=200.0)
    for _ in range(times):
        bench.send(pdu, plc, unit_id=unit_id)
        bench.link.sent.clear()
        bench.until(200)
    bench.port.replies.clear()


def test_w11_a_connection_is_renewed_after_three_time_outs_without_a_byte() -> None:
    bench = ConnectionBench(axis_plan())
    mute(bench, times=2)
    assert bench.connection.renewed == 0
    mute(bench, times=1)
    assert bench.connection.renewed == 1
    assert not bench.line.is_up
    assert len(bench.told(exchange_events.CONNECTION_RENEWED)) == 1
    assert bench.told() == []


@pytest.mark.parametrize(
    "sign", ["exception", "late", "another unit", "half a frame", "wrong unit"], ids=lambda each: each
)
def test_any_byte_is_a_sign_of_life(sign: str) -> None:
    bench = ConnectionBench(axis_plan(), retry_ms=0.0)
    mute(bench, times=2)
    if sign == "exception":
        bench.send(READ)
        bench.line.reply(1, b"\x83\x02", bench.now_ns)
    elif sign == "late":
        bench.line.stray(bench.now_ns, unit_id=1)
    elif sign == "another unit":
        bench.send(READ, unit_id=9)
        bench.line.reply(9, b"\x03\x02\x00\x00", bench.now_ns)
    elif sign == "half a frame":
        bench.line.unframed(bench.now_ns)
    else:
        bench.line.stray(bench.now_ns)
    bench.link.sent.clear()
    mute(bench, times=2)
    assert bench.connection.renewed == 0
    mute(bench, times=1)
    assert bench.connection.renewed == 1


def test_three_time_outs_that_took_less_than_three_response_timeouts_are_too_few() -> None:
    bench = ConnectionBench(axis_plan(), response_timeout_ms=200.0, retry_ms=0.0)
    # Each time-out takes 200 ms at least; pipelined the first three end after 600 ms.
    plc = controller(timeout_ms=5000.0)
    bench.send(READ, plc)
    bench.until(5000)
    assert bench.line.counters.timeouts == 1
    bench.link.sent.clear()
    mute(bench, times=2)
    assert bench.connection.renewed == 1


def test_each_other_unit_is_read_on_the_old_connection_first() -> None:
    bench = ConnectionBench(axis_plan(), axis_plan(name="y", unit_id=2))
    mute(bench)
    assert bench.connection.renewed == 0
    assert bench.link.sent == [(2, NAMED)]
    bench.until(200)
    assert bench.connection.renewed == 1


def test_a_unit_that_answers_on_the_old_connection_prevents_its_renewal() -> None:
    bench = ConnectionBench(axis_plan(), axis_plan(name="y", unit_id=2))
    mute(bench)
    bench.serve()
    assert bench.seen == [NAMED]
    bench.until(5000)
    assert bench.connection.renewed == 0


def test_a_unit_that_may_not_be_read_and_had_no_request_prevents_a_renewal() -> None:
    bench = ConnectionBench(axis_plan(), axis_plan(name="y", unit_id=2, added_frames=False))
    mute(bench, times=6)
    assert (bench.connection.renewed, bench.link.sent) == (0, [])


def test_a_renewal_is_neither_a_lost_link_nor_a_sign_of_life() -> None:
    bench = ConnectionBench(axis_plan())
    bench.move(50_000)
    bench.actual()
    place = bench.line.axes[0].motion.state
    mute(bench)
    silence = bench.line.silent_units.silences[1]
    since_ns, due_ns = silence.since_ns, silence.due_ns
    bench.returns(20)
    assert bench.line.axes[0].motion.state is place is not MotionState.SUPERSEDED
    assert (silence.timeouts, silence.since_ns, silence.due_ns) == (3, since_ns, due_ns)
    assert bench.line.silent_units.silences[1] is silence
    bench.send(READ)
    assert bench.port.take() == b"\x83\x0b"  # dead still, and not due
    assert bench.line.axes[0].reach.silent_since_ns is not None


def test_the_silence_of_a_drive_lasts_over_a_renewal_until_its_first_frame() -> None:
    """600 ms without an answer, 500 ms more: beyond ``lost_ms`` of 1000 ms."""
    bench = ConnectionBench(axis_plan(), retry_ms=300.0)
    bench.move(50_000)
    bench.actual()
    mute(bench)
    bench.returns(20, 500)
    bench.send(write(COMMAND, 20_000))
    bench.serve()
    assert bench.seen[-2] == NAMED
    assert bench.line.axes[0].reach.silent_since_ns is None


@pytest.mark.parametrize(("delay_ms", "rests_ms"), [(0.0, 200.0), (1000.0, 1000.0), (50.0, 50.0)])
def test_a_renewed_connection_rests_first(delay_ms: float, rests_ms: float) -> None:
    bench = ConnectionBench(axis_plan(), connect_delay_ms=delay_ms, retry_ms=0.0, settled=not delay_ms)
    bench.until(2000)
    mute(bench)
    bench.returns(20)
    bench.link.sent.clear()
    bench.send(READ, controller(timeout_ms=5000.0))
    bench.until(rests_ms - 0.1)
    assert bench.link.sent == []
    bench.until(0.1)
    assert bench.link.sent == [(1, READ)]


def test_a_stop_waits_for_connect_delay_ms_too() -> None:
    bench = ConnectionBench(axis_plan(motion=STAGED), connect_delay_ms=1000.0, settled=False)
    plc = controller(timeout_ms=5000.0)
    bench.send(STOP, plc)
    bench.until(999)
    assert bench.link.sent == []
    bench.until(1)
    assert bench.link.sent == [(1, STOP)]


def test_renewals_come_after_1_s_and_then_twice_as_late_up_to_60_s() -> None:
    bench = ConnectionBench(axis_plan(), retry_ms=0.0)
    at_s: list[float] = []
    plc = controller(timeout_ms=200.0)
    renewed = 0
    for _ in range(2000):
        if not bench.line.is_up:
            bench.returns(10)
        bench.send(READ, plc)
        bench.link.sent.clear()
        bench.until(200)
        if bench.connection.renewed != renewed:
            renewed = bench.connection.renewed
            at_s.append(bench.now_ns / 1e9)
    pauses = [round(after - before) for before, after in pairwise(at_s)]
    assert pauses[:8] == [1, 2, 4, 8, 16, 32, 60, 60]


# --- what may still be executed on the old connection -----------------------------------------------------


def held(**plan: Any) -> ConnectionBench:
    """Return a new connection after a write without an answer: added reads are sent on it first."""
    bench = ConnectionBench(axis_plan(motion=STAGED, **plan), retry_ms=0.0)
    mute(bench, write(COMMAND, 50_000))
    bench.returns(20, 201)
    assert bench.link.sent == [(1, NAMED)]
    return bench


def test_w5_after_a_write_without_an_answer_only_added_reads_are_sent_until_one_is_answered() -> None:
    bench = ConnectionBench(axis_plan(), retry_ms=0.0)
    bench.move(20_000)
    bench.actual()
    mute(bench, write(COMMAND, 50_000))
    assert bench.connection.renewed == 1
    bench.returns(20)
    plc = controller(timeout_ms=5000.0)
    bench.send(READ, plc)
    bench.until(200)
    assert bench.link.sent == [(1, NAMED)]
    bench.until(200)  # not answered: asked again
    assert bench.link.sent == [(1, NAMED), (1, NAMED)]
    bench.link.sent.pop()
    bench.serve_one()
    assert bench.link.sent == [(1, READ)]
    bench.serve()
    assert plc.take() == b"\x03\x02\x00\x00"


def test_w5_no_write_is_sent_for_lost_ms_after_the_first_answer() -> None:
    bench = ConnectionBench(axis_plan(lost_ms=700.0), retry_ms=0.0)
    bench.move(20_000)
    bench.actual()
    mute(bench, write(COMMAND, 50_000))
    bench.returns(20, 200)
    bench.serve_one()  # the named read
    answered_ns = bench.now_ns
    early, late = controller("cnc", timeout_ms=1000.0), controller("cnc", timeout_ms=5000.0)
    bench.send(write(COMMAND, 30_000), early)
    bench.until(500.1)
    assert early.take() == ABSENT_WRITE  # half of its time-out
    bench.send(write(COMMAND, 31_000), late)
    bench.until(199)
    assert [pdu for _, pdu in bench.link.sent if pdu[0] == 16] == []
    bench.until(5)
    bench.serve()
    assert late.take() == write(COMMAND, 0)[:5]
    assert bench.now_ns - answered_ns >= 700_000_000
    assert bench.memory.get(COMMAND) in (30_990, 31_010)


@pytest.mark.parametrize("timeout_ms", [1000.0, 100.0])  # 100: half as long as the named read takes
def test_w5_a_stop_is_sent_after_the_added_read_while_writes_are_held(timeout_ms: float) -> None:
    bench = held()
    bench.send(STOP, controller("cnc", timeout_ms=timeout_ms))
    bench.until(200)  # one exchange at a time
    assert bench.link.sent == [(1, NAMED), (1, STOP)]


def test_w5_a_stop_while_writes_are_held_is_sent_once_more_before_the_first_write() -> None:
    """The write that it stops may have been executed after it."""
    bench = held(lost_ms=700.0)
    bench.send(STOP)
    bench.serve_one()  # the named read, and then the stop
    bench.serve()
    assert bench.port.take() == STOP
    assert bench.seen[-1] == STOP
    late = controller("cnc", timeout_ms=5000.0)
    bench.send(write(COMMAND, 31_000), late)
    seen = len(bench.seen)
    bench.until(700)
    bench.serve()
    # Nobody knows on which branch it stands: between 10 counts more and 10 less.
    assert [pdu for pdu in bench.seen[seen:] if pdu[0] != 3] == [STOP, write(COMMAND, 31_000)]
    assert bench.port.replies == []


def test_w5_two_equal_stops_while_writes_are_held_are_sent_once_more_together() -> None:
    bench = held(lost_ms=700.0)
    for _ in range(2):
        bench.send(STOP)
    bench.serve_one()
    bench.serve()
    seen = len(bench.seen)
    bench.until(1_400)
    bench.serve()
    assert bench.seen[seen:].count(STOP) == 1


def test_w5_a_read_waits_behind_the_held_write_of_its_controller() -> None:
    """Whatever other controllers read meanwhile. The position is read for the write."""
    bench = held(lost_ms=700.0)
    bench.serve_one()
    plc = controller("cnc", timeout_ms=5000.0)
    bench.send(write(COMMAND, 31_000), plc)
    bench.send(READ, plc)
    bench.send(READ, controller("panel"))
    bench.serve()
    assert bench.seen == [NAMED, READ]
    bench.until(700)
    bench.serve()
    assert [pdu[0] for pdu in bench.seen[2:]][-2:] == [16, 3]
    assert bench.seen[-1] == READ


def test_w11_the_trials_of_a_dead_drive_continue_on_a_new_connection() -> None:
    """300 ms after the last time-out, then 600 ms after that of the trial. Others are answered."""
    bench = ConnectionBench(axis_plan(motion=STAGED), retry_ms=300.0)
    mute(bench, write(COMMAND, 50_000))
    bench.returns(20)
    asked_ms = []
    for ms in range(30, 1_500, 10):
        bench.until(10)
        if bench.link.sent:
            assert bench.link.take() == NAMED
            asked_ms.append(ms)
            assert bench.ask(READ) == b"\x83\x0b"
    assert asked_ms == [300, 1_100]


def test_w5_without_added_reads_a_connection_with_an_open_write_is_not_renewed() -> None:
    bench = ConnectionBench(axis_plan(added_frames=False), retry_ms=0.0)
    mute(bench, write(COMMAND, 50_000), times=5)
    assert bench.connection.renewed == 0


def test_without_added_reads_a_connection_without_an_open_write_is_renewed() -> None:
    bench = ConnectionBench(axis_plan(added_frames=False), retry_ms=0.0)
    mute(bench)
    assert bench.connection.renewed == 1


def test_w5_writes_stay_held_when_the_new_connection_is_lost_too() -> None:
    bench = ConnectionBench(axis_plan(), retry_ms=0.0)
    bench.move(20_000)
    bench.actual()
    mute(bench, write(COMMAND, 50_000))
    bench.returns(20, 200)
    bench.breaks()
    bench.returns(20)
    plc = controller(timeout_ms=5000.0)
    bench.link.sent.clear()
    bench.send(write(COMMAND, 30_000), plc)
    bench.until(400)
    assert {pdu for _, pdu in bench.link.sent} == {NAMED}


def test_serial_ports_are_never_renewed() -> None:
    bench = ConnectionBench(axis_plan())
    bench.connection.connects = False
    mute(bench, times=6)
    assert bench.connection.renewed == 0


def test_rtu_over_tcp_is_renewed_and_begins_with_a_silence() -> None:
    bench = ConnectionBench(axis_plan(), rtu=True, serial=False, retry_ms=0.0)
    plc = controller(timeout_ms=200.0)
    for _ in range(3):
        bench.send(READ, plc)
        bench.until(300)
    assert bench.connection.renewed == 1
    bench.returns(10)
    bench.link.sent.clear()
    bench.send(READ, controller(timeout_ms=5000.0))
    bench.until(199)
    assert bench.link.sent == []
    bench.until(2)
    assert bench.link.sent == [(1, READ)]


# --- what a renewal must not end ---------------------------------------------------------------------------


@pytest.mark.parametrize("asked", [(1, 2, 1), (2, 1, 1), (1, 1, 1, 2)])
def test_w11_the_silence_of_a_power_cut_during_a_renewal_lasts_until_the_first_frame(
    asked: tuple[int, ...],
) -> None:
    """Silent for 30 s, of which the old connection saw 0.8 s: a position that was set is lost."""
    plans = [
        axis_plan(name=name, unit_id=unit_id, referenced=Reference.SET_POSITION, lost_ms=1000.0)
        for name, unit_id in (("x", 1), ("y", 2))
    ]
    bench = ConnectionBench(*plans)
    for axis in bench.line.axes:
        bench.line.command(SetReference(axis=axis.plan.name), bench.now_ns)
    for unit_id in asked:
        mute(bench, times=1, unit_id=unit_id)
    bench.link.sent.clear()
    bench.until(200)
    assert bench.connection.renewed == 1
    bench.returns(30_000, 201)
    bench.link.sent.clear()
    plc = controller()
    for unit_id in (1, 2):
        for _ in range(2):
            bench.send(READ, plc, unit_id=unit_id)
            bench.serve()
            bench.until(400)
        bench.send(write(COMMAND, 60_000), plc, unit_id=unit_id)
        bench.serve()
        bench.until(30)
        bench.serve()
        assert bench.memory.get(COMMAND) == 60_000  # 1:1, not 60 010 on a zero of before
    assert not any(axis.reference.is_referenced for axis in bench.line.axes)


@pytest.mark.parametrize("rtu", [False, True])
def test_w5_a_stop_that_is_answered_does_not_keep_writes_held(*, rtu: bool) -> None:
    bench = ConnectionBench(axis_plan(motion=STAGED, lost_ms=700.0), rtu=rtu, retry_ms=0.0)
    bench.ask(write(COMMAND, 10_000))
    plc = controller("cnc", timeout_ms=200.0)
    while not bench.connection.renewed:
        bench.send(write(COMMAND, 50_000), plc)
        bench.link.sent.clear()
        bench.until(300)
    bench.returns(20)
    bench.send(STOP, controller("panel", timeout_ms=5000.0))
    for _ in range(40):
        bench.serve()
        bench.until(50)
    writer = controller("cnc")
    bench.send(write(COMMAND, 20_000), writer)
    bench.serve()
    bench.until(30)
    bench.serve()
    assert writer.take() == write(COMMAND, 20_000)[:5]


@pytest.mark.parametrize("sign", ["another unit", "late"])
def test_w5_writes_are_held_while_one_is_open_whatever_other_frames_came(sign: str) -> None:
    """Write A (50 000) is unanswered; then another frame comes, and then none any more. Write B does not
    overtake A."""
    bench = ConnectionBench(axis_plan(motion=STAGED), axis_plan(name="y", unit_id=2), retry_ms=0.0)
    mute(bench, write(COMMAND, 50_000), times=1)
    if sign == "another unit":
        bench.send(READ, unit_id=2)
        bench.serve()
        bench.port.replies.clear()
    else:
        bench.line.stray(bench.now_ns, unit_id=1)
    mute(bench, times=2, unit_id=2)
    mute(bench, times=1)
    bench.link.sent.clear()
    bench.until(200)
    assert bench.connection.renewed == 1
    bench.returns(20, 201)
    bench.link.sent.clear()
    bench.seen.clear()
    bench.send(write(COMMAND, 10_000), controller())
    assert (1, write(COMMAND, 10_010)) not in bench.link.sent
    assert not [pdu for _, pdu in bench.link.sent if pdu[0] == 16]


@pytest.mark.parametrize("drain_ms", [50.0, 300.0])
def test_a_stop_too_waits_for_the_rest_of_a_new_connection(drain_ms: float) -> None:
    """RTU over TCP: the connection rests for 200 ms, and what the old one owes for ``drain_ms``."""
    bench = ConnectionBench(axis_plan(motion=STAGED), rtu=True, retry_ms=0.0, drain_ms=drain_ms)
    mute(bench)
    while not bench.connection.renewed:
        mute(bench, times=1)
        bench.until(300)
    bench.returns(20)
    bench.send(STOP, controller("panel", timeout_ms=5000.0))
    bench.until(199)
    assert bench.link.sent == []
    bench.until(2)
    assert (1, STOP) in bench.link.sent


# --- a converter whose drives are off, and a device that is not -------------------------------------------


VFD_READ, VFD_RUN = bytes.fromhex("03 2103 0001"), bytes.fromhex("06 2000 0012")


def drives_off(open_write_to: int = 1) -> ConnectionBench:
    """Return a bench whose two drives have lost their power after a write, on the renewed connection."""
    bench = ConnectionBench(axis_plan(), axis_plan(name="y", unit_id=2), retry_ms=0.0)
    mute(bench, bytes.fromhex("06 0700 0001"), unit_id=open_write_to)
    bench.link.sent.clear()
    bench.until(400)  # no drive answers the reads of the gateway either
    assert bench.connection.renewed == 1
    bench.returns(20, 200)
    bench.link.sent.clear()
    return bench


def served_by_unit_9(bench: ConnectionBench, ms: int = 800) -> list[bytes]:
    """Let time pass in which only the device answers; return what was sent to it."""
    seen = []
    for _ in range(ms // 20):
        if not bench.line.is_up:  # renewed once more
            bench.returns(0)
        while bench.link.sent:
            unit_id, pdu = bench.link.sent.pop(0)
            if unit_id == 9:
                seen.append(pdu)
                bench.line.reply(unit_id, pdu if pdu[0] == 6 else b"\x03\x02\x00\x00", bench.now_ns)
        bench.until(20)
    return seen


@pytest.mark.parametrize("pdu", [VFD_READ, VFD_RUN], ids=["read", "write"])
def test_w11_drives_without_power_do_not_hold_up_another_device_of_their_converter(pdu: bytes) -> None:
    bench = drives_off()
    for _ in range(5):
        bench.send(pdu, unit_id=9)
        assert served_by_unit_9(bench) == [pdu]


def test_w5_a_device_whose_write_may_still_be_executed_gets_no_write_for_lost_ms() -> None:
    """Its controller may only write, so nothing is asked of it first."""
    bench = drives_off(open_write_to=9)  # 220 ms after the old connection was closed
    bench.send(VFD_RUN, controller(timeout_ms=9000.0), unit_id=9)
    bench.send(VFD_READ, controller("hmi"), unit_id=9)
    assert served_by_unit_9(bench, 700) == [VFD_READ]
    assert served_by_unit_9(bench, 300) == [VFD_RUN]  # lost_ms = 1000


@pytest.mark.parametrize("unit_id", [0, 255])
def test_w5_a_write_to_another_name_of_the_axes_holds_each_of_them_up(unit_id: int) -> None:
    bench = drives_off(open_write_to=unit_id)
    for axis_unit_id in (1, 2):
        bench.send(READ, controller(f"plc {axis_unit_id}"), unit_id=axis_unit_id)
        assert (axis_unit_id, READ) not in bench.link.sent


def test_w5_a_drive_whose_write_may_still_be_executed_gets_neither_reads_nor_writes() -> None:
    bench = drives_off()
    for pdu in (READ, write(COMMAND, 50_000)):
        bench.send(pdu, controller(f"plc {pdu[0]}"), unit_id=1)
        assert (1, pdu) not in bench.link.sent
