"""What each kind of lost link does, and how requests wait for the next connection (W5, W7, M3)."""

from pathlib import Path
from typing import Any

import pytest

from gateway.catalogue import exchange_events
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.link_loss import LINK_LOSS
from gateway.exchange.plan import AxisPlan, Reference
from gateway.modbus.registers import BitField
from tests.exchange.connection_bench import ConnectionBench, controller
from tests.exchange.line_bench import COMMAND, MS, axis_plan, write
from tests.exchange.staged_bench import RUN_PDU as TRIGGER
from tests.exchange.staged_bench import STAGED
from tests.exchange.staged_bench import STOP_PDU as STOP

READ = bytes.fromhex("03 0700 0001")
ABSENT_WRITE, ABSENT_READ = b"\x90\x0a", b"\x83\x0a"
HOMED = BitField(0x1003, 6)
READ_HOMED = bytes.fromhex("03 1003 0001")

BY_HAND = """
             words        base       reference    reached      silent       recorded
blink        kept         kept       kept         kept         none         goes_on
idle-close   until_read   forgotten  unconfirmed  asked_again  until_up     paused
own-close    until_read   forgotten  unconfirmed  asked_again  until_up     paused
renewal      kept         kept       kept         kept         goes_on      goes_on
loss         until_read   forgotten  unconfirmed  asked_again  until_up     paused
silence      until_read   forgotten  lost         kept         until_frame  goes_on
restart      as_recorded  forgotten  as_recorded  asked_again  ended        read
"""
"""The table as it is to be, written once more by hand."""


def test_the_table_of_lost_links_is_as_written_by_hand() -> None:
    rows = [[kind.value, *(cell.name.lower() for cell in row)] for kind, row in LINK_LOSS.items()]
    assert rows == [line.split() for line in BY_HAND.strip().splitlines()[1:]]


def homed_bench(**timing: Any) -> ConnectionBench:
    """An axis whose drive's homed bit references it, and was read."""
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


def test_w5_ten_of_ten_writes_pass_though_the_server_closes_after_each_answer() -> None:
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


def test_a_connection_is_wanted_once_in_100_ms_while_something_waits() -> None:
    bench = ConnectionBench(axis_plan())
    bench.peer_closes()
    wanted = bench.connection.wanted
    bench.until(1000)
    assert bench.connection.wanted == wanted  # nobody waits
    bench.send(READ)
    bench.until(450)
    assert bench.connection.wanted == wanted + 5  # at 0, 100, 200, 300 and 400 ms


def test_what_may_write_leaves_only_while_half_of_the_time_out_remains() -> None:
    """Up after 499 ms; the reads that go first take until 501 ms."""
    bench = homed_bench()
    bench.until(2000)  # nothing is known of it any more once the connection is lost
    bench.peer_closes()
    bench.send(write(COMMAND, 50_000))
    bench.returns(499, 2)
    bench.serve()
    assert bench.port.take() == ABSENT_WRITE
    assert [pdu for pdu in bench.seen if pdu[0] == 16] == []


def test_m3_a_stop_goes_first_withdraws_and_is_not_sent_after_its_time_out() -> None:
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


def test_m3_a_stop_that_finds_no_connection_leaves_before_everything_else() -> None:
    bench = ConnectionBench(axis_plan(command=(COMMAND,), motion=STAGED))
    bench.until(2000)
    bench.peer_closes()
    bench.send(READ)
    bench.send(STOP)
    bench.returns(600)
    assert bench.link.sent[0] == (1, STOP)
    bench.serve()
    assert [pdu for _, _, pdu in bench.port.replies] == [ABSENT_READ, STOP]


def test_w5_bytes_given_to_a_connection_are_sent_and_never_again() -> None:
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


def test_w5_a_prerequisite_that_is_lost_with_the_connection_is_asked_anew() -> None:
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


def test_a_blink_forgets_nothing_of_an_axis_that_was_heard_within_a_second() -> None:
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
def test_longer_or_of_an_axis_that_was_not_heard_it_is_a_lost_link(quiet_ms: float, away_ms: float) -> None:
    bench = ConnectionBench(axis_plan())
    bench.move(50_000)
    bench.actual()
    bench.until(quiet_ms)
    bench.peer_closes()
    bench.returns(away_ms)
    assert bench.line.axes[0].motion.state is MotionState.SUPERSEDED


def test_a_connection_that_breaks_is_no_blink() -> None:
    bench = ConnectionBench(axis_plan())
    bench.move(50_000)
    bench.actual()
    bench.breaks()
    bench.returns(5)
    assert bench.line.axes[0].motion.state is MotionState.SUPERSEDED


def test_a_drive_that_was_switched_off_during_a_close_is_asked_whether_it_is_homed() -> None:
    bench = homed_bench()
    bench.move(50_000)
    bench.peer_closes()
    bench.memory.words[HOMED.address] = 0
    bench.send(write(COMMAND, 20_000))
    bench.returns_and_serves(400)
    assert bench.memory.get(COMMAND) == 20_000
    assert bench.seen[-2:] == [READ_HOMED, write(COMMAND, 20_000)]


def test_w11_a_dead_drive_stays_dead_over_a_blink_and_is_asked_again_after_a_loss() -> None:
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


def test_w5_nothing_is_sent_into_a_connection_that_its_server_closes_behind_each_answer() -> None:
    """It closed 0.2 ms after its first answer: for 20 ms after the next nothing leaves, not even a stop."""
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


def test_w5_what_would_leave_with_an_answer_waits_until_a_server_has_shown_that_it_stays() -> None:
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


def test_a_server_that_is_asked_later_than_20_ms_after_its_answer_has_shown_that_it_stays() -> None:
    bench = ConnectionBench(axis_plan(), settled=False)
    for _ in range(2):
        bench.send(READ)
        bench.serve_one()
        bench.until(20)
    bench.send(write(COMMAND, 50_000))
    bench.serve_one()  # the look
    assert bench.link.take() == write(COMMAND, 50_010)


# --- connections that we close ------------------------------------------------------------------------------


def test_a_connection_on_demand_is_closed_after_a_second_without_an_answer_and_nobody_is_told() -> None:
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
def test_a_connection_on_demand_stays_while_its_axis_is_under_way_or_a_target_staged(plan: AxisPlan) -> None:
    bench = ConnectionBench(plan, connects_on_demand=True)
    bench.ask(write(COMMAND, 50_000))
    bench.until(20_000)
    assert bench.connection.hung_up == []


def test_after_a_close_of_our_own_the_homed_bit_is_read_first() -> None:
    bench = homed_bench(connects_on_demand=True)
    bench.until(20_000)
    assert bench.connection.hung_up == [False]
    bench.send(write(COMMAND, 50_000))
    bench.returns(20)
    assert bench.link.sent == [(1, READ_HOMED)]


def test_a_connection_is_made_anew_after_max_connection_s_once_nothing_is_under_way() -> None:
    bench = ConnectionBench(axis_plan(), max_connection_s=2.0)
    bench.until(1900)
    bench.ask(READ)
    bench.until(200)
    assert bench.connection.hung_up == [True]
    bench.returns(10)
    bench.ask(write(COMMAND, 50_000))
    bench.until(60_000)
    assert bench.connection.hung_up == [True]


# --- what is told -------------------------------------------------------------------------------------------


def test_line_down_is_told_once_a_minute_for_each_reason() -> None:
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


def test_line_down_that_lasts_is_told_however_often_it_was() -> None:
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


def test_a_loss_under_way_is_told_at_once() -> None:
    bench = ConnectionBench(axis_plan())
    for _ in range(3):
        bench.ask(write(COMMAND, 50_000))
        bench.breaks()
        bench.returns_and_serves(10)
    assert bench.told() == ["Connection reset by peer"] * 3


def test_serial_ports_answer_at_once_that_they_are_not_there() -> None:
    bench = ConnectionBench(axis_plan())
    bench.connection.connects = False
    bench.breaks("unplugged")
    bench.send(write(COMMAND, 50_000))
    assert bench.port.take() == ABSENT_WRITE
    assert bench.now_ns < 3000 * MS
    assert bench.connection.wanted == 0


def test_the_page_of_rules_has_the_table_of_lost_links() -> None:
    page = (Path(__file__).parents[2] / "docs" / "wire-rules.md").read_text(encoding="utf-8")
    for kind, row in LINK_LOSS.items():
        line = next(
            each for each in page.splitlines() if each.startswith("|") and f"(`{kind.value}`)" in each
        )
        assert [cell.strip() for cell in line.split("|")[2:-1]] == [cell.value for cell in row]
