"""What each kind of lost link does: to requests, to the reference, to late replies (W5, W7, M3)."""

from typing import Any

import pytest

from gateway.catalogue import exchange_events
from gateway.compensation.settings import Reversal, ReversalKind
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.plan import AxisPlan, LineTiming, Reference
from gateway.modbus.registers import BitField, PositionField, RegisterType
from tests.exchange.connection_bench import ConnectionBench, controller
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, axis_plan, read, stream_plan, write
from tests.exchange.staged_bench import RUN_PDU as TRIGGER
from tests.exchange.staged_bench import STAGED, StagedBench
from tests.exchange.staged_bench import STOP_PDU as STOP

READ = bytes.fromhex("03 0700 0001")
ABSENT_WRITE, ABSENT_READ = b"\x90\x0a", b"\x83\x0a"
HOMED = BitField(0x1003, 6)
READ_HOMED = bytes.fromhex("03 1003 0001")


def homed_bench(**timing: Any) -> ConnectionBench:
    """Return an axis whose reference depends on the homed bit of its drive, which was read."""
    bench = ConnectionBench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}), **timing)
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.ask(READ_HOMED)
    return bench


# --- a server that closes idle connections ---------------------------------------------------------------


def test_w5_a_request_that_finds_an_idle_connection_closed_waits_for_the_next_one() -> None:
    bench = ConnectionBench(axis_plan())
    bench.peer_closes()
    bench.send(write(COMMAND, 50_000))
    assert (bench.link.sent, bench.port.replies, bench.connection.wanted) == ([], [], 1)
    bench.returns_and_serves(20)
    assert bench.port.take() == write(COMMAND, 50_000)[:5]
    assert bench.memory.get(COMMAND) == 50_010


def test_w5_ten_of_ten_writes_pass_although_the_server_closes_after_each_answer() -> None:
    bench = ConnectionBench(axis_plan(), settled=False)
    for number in range(10):
        counts = 10_000 + 1_000 * number
        bench.send(write(COMMAND, counts))
        if not bench.line.is_up:
            bench.returns(10)
        while bench.link.sent:
            bench.serve_one()
            bench.until(0.2)
            bench.peer_closes()
            bench.returns(10)
        assert bench.port.take() == write(COMMAND, counts)[:5]
        assert bench.memory.get(COMMAND) == counts + 10
    assert bench.line.counters.timeouts == 0


@pytest.mark.parametrize(("serial", "answers"), [(False, [ABSENT_WRITE]), (True, [])])
def test_w7_no_connection_for_half_of_the_time_out_is_absent(serial: bool, answers: list[bytes]) -> None:
    bench = ConnectionBench(axis_plan(), serial=serial)
    bench.peer_closes()
    bench.send(write(COMMAND, 50_000))
    bench.until(499)
    assert bench.port.replies == []
    bench.until(1)
    assert [pdu for _, _, pdu in bench.port.replies] == answers
    bench.returns_and_serves(1)
    assert write(COMMAND, 50_010) not in bench.seen


def test_m3_a_target_that_found_no_connection_is_lost_and_its_trigger_refused() -> None:
    bench = ConnectionBench(axis_plan(command=(COMMAND,), motion=STAGED))
    bench.peer_closes()
    bench.send(write(COMMAND, 50_000))
    bench.until(500)
    assert bench.port.take() == ABSENT_WRITE
    bench.returns_and_serves(10)
    assert bench.ask(TRIGGER) == bytes((TRIGGER[0] | 0x80, 0x0A))
    assert TRIGGER not in bench.seen


def test_a_connection_is_requested_every_100_ms_while_a_request_waits() -> None:
    bench = ConnectionBench(axis_plan())
    bench.peer_closes()
    wanted = bench.connection.wanted
    bench.until(1000)
    assert bench.connection.wanted == wanted  # nobody waits
    bench.send(READ)
    bench.until(450)
    assert bench.connection.wanted == wanted + 5  # at 0, 100, 200, 300 and 400 ms


def test_a_request_that_may_write_is_sent_only_while_half_of_the_time_out_remains() -> None:
    """The link is up after 499 ms; the reads that are sent first take until 501 ms."""
    bench = homed_bench()
    bench.until(2000)  # nothing is known of it any more once the connection is lost
    bench.peer_closes()
    bench.send(write(COMMAND, 50_000))
    bench.returns(499, 2)
    bench.serve()
    assert bench.port.take() == ABSENT_WRITE
    assert [pdu for pdu in bench.seen if pdu[0] == 16] == []


def test_m3_a_stop_without_a_connection_withdraws_triggers_and_is_not_sent_after_its_time_out() -> None:
    bench = ConnectionBench(axis_plan(command=(COMMAND,), motion=STAGED))
    bench.ask(write(COMMAND, 50_000))
    bench.until(2000)
    bench.peer_closes()
    other = controller("other")
    bench.send(TRIGGER, other)
    bench.send(STOP)
    assert other.take() == bytes((TRIGGER[0] | 0x80, 6))
    bench.until(999)
    assert bench.port.replies == []
    bench.until(1.1)
    assert bench.port.take() == bytes((STOP[0] | 0x80, 0x0A))
    bench.returns_and_serves(1)
    assert STOP not in bench.seen


def test_m3_a_stop_that_finds_no_connection_is_sent_before_everything_else() -> None:
    bench = ConnectionBench(axis_plan(command=(COMMAND,), motion=STAGED))
    bench.until(2000)
    bench.peer_closes()
    bench.send(READ)
    bench.send(STOP)
    bench.returns(600)
    assert bench.link.sent[0] == (1, STOP)
    bench.serve()
    assert [pdu for _, _, pdu in bench.port.replies] == [ABSENT_READ, STOP]


def test_w5_a_request_given_to_a_connection_is_never_sent_again() -> None:
    bench = ConnectionBench(axis_plan())
    bench.move(20_000)
    seen = len(bench.seen)
    bench.actual()
    bench.until(30)
    bench.send(write(COMMAND, 50_000))
    bench.serve_reads()
    assert bench.link.take() == write(COMMAND, 50_010)
    bench.peer_closes()
    assert bench.port.take() == b"\x90\x0b"
    bench.returns_and_serves(10)
    bench.until(2000)
    assert [pdu for pdu in bench.seen[seen:] if pdu[0] == 16] == []
    assert bench.told() == ["closed by its peer while a request was unanswered"]


def test_w5_a_prerequisite_that_is_lost_with_the_connection_is_read_again() -> None:
    bench = homed_bench()
    bench.until(1500)
    bench.send(write(COMMAND, 50_000))
    assert bench.link.take() == READ_HOMED
    bench.peer_closes()
    assert bench.port.replies == []
    bench.memory.words[HOMED.address] = 0  # it was switched off and on
    bench.returns_and_serves(10)
    assert bench.port.take() == write(COMMAND, 50_000)[:5]
    assert bench.memory.get(COMMAND) == 50_000  # 1:1


# --- what is known after it ---------------------------------------------------------------------------------


def test_a_short_orderly_close_forgets_nothing_of_an_axis_that_was_heard_within_a_second() -> None:
    bench = ConnectionBench(axis_plan())
    bench.move(50_000)  # and 1000 ms later
    bench.actual()
    bench.peer_closes()
    bench.returns(90)
    assert bench.link.sent == []
    axis = bench.line.axes[0]
    assert axis.motion.state in (MotionState.IN_WINDOW, MotionState.ARRIVED)
    assert axis.reach.silent_since_ns is None


@pytest.mark.parametrize(("quiet_ms", "away_ms"), [(0, 101), (1002, 10)])
def test_a_close_for_longer_or_of_an_axis_not_heard_is_a_lost_link(quiet_ms: float, away_ms: float) -> None:
    bench = ConnectionBench(axis_plan())
    bench.move(50_000)
    bench.actual()
    bench.until(quiet_ms)
    bench.peer_closes()
    bench.returns(away_ms)
    assert bench.line.axes[0].motion.state is MotionState.SUPERSEDED


def test_a_connection_that_breaks_is_a_lost_link() -> None:
    bench = ConnectionBench(axis_plan())
    bench.move(50_000)
    bench.actual()
    bench.breaks()
    bench.returns(5)
    assert bench.line.axes[0].motion.state is MotionState.SUPERSEDED


def test_after_a_close_the_homed_bit_is_read_before_a_target() -> None:
    bench = homed_bench()
    bench.move(50_000)
    bench.peer_closes()
    bench.memory.words[HOMED.address] = 0
    bench.send(write(COMMAND, 20_000))
    bench.returns_and_serves(400)
    assert bench.memory.get(COMMAND) == 20_000
    assert bench.seen[-2:] == [READ_HOMED, write(COMMAND, 20_000)]


def test_w11_a_dead_drive_stays_dead_over_a_short_close_and_is_tried_again_after_a_lost_link() -> None:
    bench = ConnectionBench(axis_plan(), retry_ms=1000.0)
    slow = controller(timeout_ms=200.0)
    for _ in range(3):
        bench.send(READ, slow, unit_id=9)
        bench.until(200)
        bench.link.sent.clear()
        bench.ask(READ)
        bench.until(30)
    slow.replies.clear()
    bench.peer_closes()
    bench.returns(10)
    bench.send(READ, slow, unit_id=9)
    assert slow.take() == b"\x83\x0b"
    bench.breaks()
    bench.returns(10)
    bench.send(READ, slow, unit_id=9)
    assert bench.link.sent[-1] == (9, READ)


def test_w5_nothing_is_sent_on_a_connection_that_its_server_closes_after_each_answer() -> None:
    """It closed 0.2 ms after its first answer: for 20 ms after the next answer nothing is sent, not even a
    stop."""
    bench = ConnectionBench(axis_plan(motion=STAGED), settled=False)
    bench.send(READ)
    bench.serve_one()
    bench.until(0.2)
    bench.peer_closes()
    bench.returns(10)
    bench.send(READ)
    bench.serve_one()
    bench.send(STOP)
    assert bench.link.sent == []
    bench.until(19.9)
    assert bench.link.sent == []
    bench.until(0.2)  # it stays open: it is a server as any other
    assert bench.link.sent == [(1, STOP)]
    bench.serve_one()
    bench.send(READ)
    assert bench.link.take() == READ


def test_w5_the_next_request_waits_until_a_server_has_shown_that_it_keeps_the_connection() -> None:
    bench = ConnectionBench(axis_plan(), settled=False)
    bench.send(write(COMMAND, 50_000))
    bench.serve_one()  # the look
    assert bench.link.sent == []
    bench.until(20)
    bench.serve_one()
    assert bench.memory.get(COMMAND) == 50_010
    bench.until(1000)
    bench.send(write(COMMAND, 60_000))
    bench.serve_one()
    assert bench.link.take() == write(COMMAND, 60_010)


def test_a_server_whose_connection_is_open_20_ms_after_its_answer_has_shown_that_it_keeps_it() -> None:
    bench = ConnectionBench(axis_plan(), settled=False)
    for _ in range(2):
        bench.send(READ)
        bench.serve_one()
        bench.until(20)
    bench.send(write(COMMAND, 50_000))
    bench.serve_one()  # the look
    assert bench.link.take() == write(COMMAND, 50_010)


# --- connections that the gateway closes --------------------------------------------------------------------


def test_a_connection_on_demand_is_closed_after_an_idle_second_without_an_event() -> None:
    bench = ConnectionBench(axis_plan(), connects_on_demand=True)
    bench.ask(READ)
    bench.until(999)
    assert (bench.connection.hung_up, bench.line.is_up) == ([], True)
    bench.until(1.1)
    assert (bench.connection.hung_up, bench.line.is_up, bench.line.serves) == ([False], False, True)
    bench.until(10_000)
    assert (bench.told(), bench.connection.wanted) == ([], 0)
    bench.send(READ)
    assert bench.connection.wanted == 1
    bench.returns_and_serves(20)
    assert bench.port.take() == b"\x03\x02\x00\x00"
    assert bench.told(exchange_events.LINE_UP) == []


@pytest.mark.parametrize("plan", [axis_plan(), axis_plan(motion=STAGED)], ids=["under way", "staged"])
def test_a_connection_on_demand_stays_open_while_its_axis_moves_or_a_target_is_staged(plan: AxisPlan) -> None:
    bench = ConnectionBench(plan, connects_on_demand=True)
    bench.ask(write(COMMAND, 50_000))
    bench.until(20_000)
    assert bench.connection.hung_up == []


def test_after_a_close_by_the_gateway_the_homed_bit_is_read_first() -> None:
    bench = homed_bench(connects_on_demand=True)
    bench.until(20_000)
    assert bench.connection.hung_up == [False]
    bench.send(write(COMMAND, 50_000))
    bench.returns(20)
    assert bench.link.sent == [(1, READ_HOMED)]


def test_a_connection_is_renewed_after_max_connection_s_while_no_axis_moves() -> None:
    bench = ConnectionBench(axis_plan(), max_connection_s=2.0)
    bench.until(1900)
    bench.ask(READ)
    bench.until(200)
    assert bench.connection.hung_up == [True]
    bench.returns(10)
    bench.ask(write(COMMAND, 50_000))
    bench.until(60_000)
    assert bench.connection.hung_up == [True]


# --- reported events ----------------------------------------------------------------------------------------


def test_line_down_is_reported_once_a_minute_for_each_reason() -> None:
    bench = ConnectionBench(axis_plan())
    for _ in range(60):
        bench.peer_closes()
        bench.returns(10, 400)
    assert bench.told() == ["closed by its peer when idle"]
    assert len(bench.told(exchange_events.LINE_UP)) == 1
    bench.breaks("closed after a malformed header: 00 01 00 00 00 01 01 83")
    bench.returns(10)
    bench.breaks("closed after a malformed header: 00 02 00 00 00 01 01 83")
    bench.returns(10)
    assert bench.told()[1:] == ["closed after a malformed header: 00 01 00 00 00 01 01 83"]
    bench.until(60_000)
    bench.peer_closes()
    assert bench.told()[2:] == ["closed by its peer when idle, 60 times since the last note"]


def test_line_down_that_lasts_a_second_is_always_reported() -> None:
    bench = ConnectionBench(axis_plan())
    bench.peer_closes()
    bench.returns(10)
    bench.peer_closes()
    bench.until(999)
    assert len(bench.told()) == 1
    bench.until(1)
    assert len(bench.told()) == 2
    bench.returns(10)
    assert len(bench.told(exchange_events.LINE_UP)) == 2


def test_a_link_lost_while_an_axis_moves_is_reported_immediately() -> None:
    bench = ConnectionBench(axis_plan())
    for _ in range(3):
        bench.ask(write(COMMAND, 50_000))
        bench.breaks()
        bench.returns_and_serves(10)
    assert bench.told() == ["Connection reset by peer"] * 3


def test_a_missing_serial_port_is_answered_as_absent_immediately() -> None:
    bench = ConnectionBench(axis_plan())
    bench.connection.connects = False
    bench.breaks("unplugged")
    bench.send(write(COMMAND, 50_000))
    assert bench.port.take() == ABSENT_WRITE
    assert bench.now_ns < 3000 * MS
    assert bench.connection.wanted == 0


# === a drive that was away may have lost its reference ===================================================


def corrected_bench(**plan: object) -> Bench:
    bench = Bench(
        axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}, **plan),
        timing=LineTiming(drain_ms=1),
        serial=False,
    )
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.ask(READ_HOMED)
    assert bench.reach(50_000) == 50_010
    return bench


def go_silent(bench: Bench) -> None:
    bench.unanswered(bytes.fromhex("03 0700 0001"), 1000, 1)


def test_after_a_silence_the_homed_bit_is_read_before_a_target_is_corrected() -> None:
    bench = corrected_bench()
    go_silent(bench)
    bench.memory.words[HOMED.address] = 0  # it was switched off and on
    assert bench.frames(write(COMMAND, 5_000)) == [READ_HOMED, write(COMMAND, 5_000)]
    assert bench.kinds()[-2:] == ["drive-answers", "reference-lost"]


def test_after_a_silence_a_drive_that_is_still_homed_is_corrected_as_before() -> None:
    bench = corrected_bench()
    go_silent(bench)
    assert bench.actual() == 50_000
    assert READ_HOMED in bench.seen[-2:]


def test_a_homed_bit_that_could_not_be_read_is_read_again_with_the_next_request() -> None:
    bench = Bench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}))
    bench.line.link_down(bench.now_ns)
    bench.line.link_up(bench.now_ns)
    assert bench.link.take() == READ_HOMED
    bench.wait(1000)
    bench.wait(1000)
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    assert bench.command(50_000) == 50_010


def test_without_added_reads_a_silence_ends_the_reference() -> None:
    bench = corrected_bench(added_frames=False, home_approach=1)
    go_silent(bench)
    assert bench.kinds()[-1] == "reference-lost"
    assert bench.command(60_000) == 60_000


def test_silence_is_counted_for_each_unit_separately() -> None:
    bench = Bench(serial=False, tcp_drive=True)
    for _ in range(3):
        bench.send(bytes.fromhex("03 0700 0001"), unit_id=9)
        bench.wait(1000)
        bench.link.sent.clear()
        bench.port.replies.clear()
        bench.ask(bytes.fromhex("03 0700 0001"))
    assert bench.kinds() == ["line-up", "drive-silent", "drive-backed-off"]


def test_a_serial_link_that_comes_back_begins_with_a_silence_if_a_reply_was_pending() -> None:
    bench = Bench(timing=LineTiming(drain_ms=50))
    bench.send(bytes.fromhex("03 0700 0001"))
    bench.link.sent.clear()
    bench.line.link_down(bench.now_ns)
    bench.now_ns += 5 * MS
    bench.line.link_up(bench.now_ns)
    bench.send(bytes.fromhex("03 0701 0001"))
    assert bench.leaves_after(50)[1] == bytes.fromhex("03 0701 0001")


@pytest.mark.parametrize("unit_id", [0, 255])
@pytest.mark.parametrize("request_pdu", [write(COMMAND, 50_000), read(ACTUAL)])
def test_unit_ids_0_and_255_of_a_tcp_drive_do_not_bypass_its_axis(unit_id: int, request_pdu: bytes) -> None:
    bench = Bench(axis_plan(), serial=False, tcp_drive=True)
    bench.send(request_pdu, unit_id=unit_id)
    assert bench.link.sent == []
    assert bench.port.take() == bytes((request_pdu[0] | 0x80, 0x0A))
    bench.send(bytes.fromhex("03 0700 0001"), unit_id=unit_id)
    assert bench.link.sent == [(unit_id, bytes.fromhex("03 0700 0001"))]


def test_a_done_bit_in_the_reply_to_a_write_belongs_to_the_move_before() -> None:
    done = BitField(0x0031, 0)
    bench = Bench(axis_plan(bits={"done": done}))
    bench.move(80_000)
    bench.memory.words[done.address] = 1
    # FC23 writes 50 000 and reads the status word, in which the drive has not begun to move yet
    bench.ask(bytes.fromhex("17 0031 0001 0606 0002 04 C350 0000"))
    bench.memory.put(ACTUAL, 60_000)
    bench.wait(30)
    assert bench.command(70_000) == 70_010  # retargeted on the way down: forward from 60 mm, not from 50 mm


def test_a_done_bit_that_was_cleared_without_a_target_means_that_something_else_moved_the_axis() -> None:
    done = BitField(0x0031, 0)
    bench = Bench(axis_plan(bits={"done": done}))
    bench.move(50_000)
    for word in (1, 0, 1):  # reached; then jogged to 80 mm
        bench.memory.words[done.address] = word
        bench.ask(bytes.fromhex("03 0031 0001"))
    bench.memory.put(ACTUAL, 80_000)
    bench.wait(30)
    assert bench.command(60_000) == 59_990


def test_an_axis_with_a_done_bit_but_no_actual_position_keeps_its_branch_until_it_is_done() -> None:
    done = BitField(0x0031, 0)
    bench = Bench(axis_plan(actual=(), bits={"done": done}, home_approach=1))
    bench.ask(write(COMMAND, 50_000))
    assert bench.command(20_000) == 20_010
    bench.ask(bytes.fromhex("03 0031 0001"))
    bench.memory.words[done.address] = 1
    bench.ask(bytes.fromhex("03 0031 0001"))
    assert bench.command(10_000) == 9_990


def test_a_stream_continues_with_its_correction_after_a_short_close() -> None:
    bench = Bench(stream_plan(home_approach=1, reload_distance=0.001), timing=LineTiming(drain_ms=1))
    for counts in (0, 1000, 2000, 3000):
        bench.ask(write(COMMAND, counts))
    bench.memory.put(ACTUAL, 2710)  # it lags by 300 counts
    bench.line.link_down(bench.now_ns)
    bench.line.link_up(bench.now_ns)
    assert bench.sent_for(write(COMMAND, 3010)) == write(COMMAND, 3020)


def test_a_dwell_is_no_part_of_a_reversal_by_time() -> None:
    plan = stream_plan(home_approach=1, reload_distance=0.001, reversal=Reversal(ReversalKind.TIME_MS, 200.0))
    bench = Bench(plan)
    for counts in (0, 1000, 2000):
        bench.ask(write(COMMAND, counts))
    for _ in range(20):
        bench.wait(50)
        bench.ask(write(COMMAND, 2000))
    bench.wait(2)
    assert bench.command(1990) == 2000  # still wholly on the forward branch


def test_an_equal_setpoint_advances_no_blend() -> None:
    plan = stream_plan(home_approach=1, reload_distance=0.001, reversal=Reversal(ReversalKind.CYCLES, 10))
    bench = Bench(plan, tcp_drive=True)
    for counts in (0, 1000, 2000, 1990):
        bench.ask(write(COMMAND, counts))
    told = bench.memory.get(COMMAND)
    for _ in range(5):
        bench.line.link_down(bench.now_ns)
        bench.line.link_up(bench.now_ns)
        assert bench.command(1990) == told


def test_nothing_without_a_function_code_does_anything() -> None:
    bench = Bench(axis_plan())
    bench.send(b"")
    assert bench.link.sent == []
    bench.send(bytes.fromhex("03 0700 0001"))
    bench.line.reply(1, b"", bench.now_ns)
    assert bench.port.replies == []
    bench.line.reply(1, bytes.fromhex("03 02 0000"), bench.now_ns)
    assert bench.port.take() == bytes.fromhex("03 02 0000")


def test_an_axis_that_is_homed_later_is_corrected_from_then_on_although_no_controller_reads_the_bit() -> None:
    bench = Bench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}))
    assert bench.kinds() == ["line-up", "reference-lost"]
    assert bench.reach(10_000) == 10_000
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.wait(1000)
    assert bench.reach(50_000) == 50_010


def test_a_reference_that_was_lost_unseen_is_noticed_before_the_next_target() -> None:
    bench = corrected_bench()
    bench.memory.words[HOMED.address] = 0
    bench.wait(1001)
    assert bench.command(20_000) == 20_000


def test_a_homed_bit_seen_a_moment_ago_is_not_read_again() -> None:
    bench = corrected_bench()
    bench.ask(READ_HOMED)
    bench.actual()
    frames = len(bench.seen)
    bench.ask(write(COMMAND, 20_000))
    assert READ_HOMED not in bench.seen[frames:]


def test_a_broadcast_on_a_controllers_serial_line_gets_no_answer() -> None:
    bench = Bench(axis_plan(), tcp_drive=True)
    bench.send(bytes.fromhex("06 0700 0001"), unit_id=0)
    assert bench.link.take() == bytes.fromhex("06 0700 0001")
    bench.line.reply(0, bytes.fromhex("06 0700 0001"), bench.now_ns)
    bench.send(write(COMMAND, 5), unit_id=0)
    assert bench.link.sent == []
    assert bench.port.replies == []


def test_an_unrequested_frame_makes_the_line_wait_for_silence() -> None:
    bench = Bench(timing=LineTiming(drain_ms=50))
    bench.ask(bytes.fromhex("03 0700 0001"))
    bench.line.stray(bench.now_ns, unit_id=1)  # the drive answered twice
    bench.send(bytes.fromhex("03 0701 0001"))
    assert bench.leaves_after(50)[1] == bytes.fromhex("03 0701 0001")
    assert bench.kinds()[-1] == "late-reply"


def test_noise_on_an_idle_line_delays_nothing() -> None:
    bench = Bench(timing=LineTiming(drain_ms=50))
    bench.line.stray(bench.now_ns)
    bench.send(bytes.fromhex("03 0701 0001"))
    assert bench.link.take() == bytes.fromhex("03 0701 0001")


def test_a_stream_that_is_homed_on_the_way_blends_from_1_to_1_and_never_by_its_lag() -> None:
    plan = stream_plan(
        referenced=Reference.DRIVE_BIT, bits={"homed": HOMED}, home_approach=1, reload_distance=1.0
    )
    bench = Bench(plan)
    for counts in (0, 1000, 2000, 3000):
        assert bench.command(counts) == counts
        bench.memory.put(ACTUAL, counts - 300)  # from now on the axis lags by 300 counts
    bench.memory.words[HOMED.address] = 1 << HOMED.bit
    bench.ask(READ_HOMED)
    told = []
    for counts in (3010, 3510, 4010, 4510):
        bench.ask(write(COMMAND, counts))
        told.append(bench.memory.get(COMMAND) - counts)
    # sin² from 0 to +10 counts over 1 mm from the first setpoint on; 5 half way
    assert told == [0, 5, 10, 10]


def test_a_frame_that_remaps_and_commands_at_once_ends_the_compensation_too() -> None:

    beside = PositionField(0x0608, RegisterType.UINT16)
    bench = Bench(axis_plan(remapping=(beside,)))
    bench.ask(bytes.fromhex("10 0606 0003 06 C350 0000 0001"))
    assert bench.command(60_000) == 60_000


@pytest.mark.parametrize("cut_ms", [300, 3_000])
def test_m6_an_axis_seen_at_its_target_after_a_loss_turns_back_with_the_smallest_step(cut_ms: float) -> None:
    """Forward it stands at 50 010. One count back is backward: 49 999 - 10, not 49 999 + 10."""
    bench = Bench(axis_plan())
    assert bench.reach(40_000) == 40_010
    assert bench.reach(50_000) == 50_010
    bench.cut(cut_ms)
    bench.actual()
    assert bench.command(49_999) == 49_989
    assert "direction-unsure" not in bench.kinds()


def test_m6_a_staged_target_after_a_loss_turns_back_with_the_smallest_step() -> None:
    bench = StagedBench()
    bench.go_to(40_000, 50_000)
    bench.cut(3_000)
    assert bench.run(49_999) == ("absolute", 49_989)
    assert "direction-unsure" not in bench.kinds()
