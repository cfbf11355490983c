"""A request waits for the silence that the wire needs: it can be withdrawn, and no late frame answers it."""

from typing import Any

import pytest

from gateway.catalogue import exchange_events
from gateway.exchange.plan import ControllerPlan, Late, LineTiming, Reference
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Link, Port, axis_plan, monitor, read, write
from tests.exchange.staged_bench import BITS, RUN_PDU, STOP_PDU, StagedBench, staged_plan
from tests.exchange.test_arbitration import MOTION, WATCH, Plant, watching

OTHER = bytes.fromhex("03 0700 0001")
WORD = bytes.fromhex("06 0700 0001")
SILENCE_MS = 1.75


def holds(bench: Bench, ms: float = SILENCE_MS) -> None:
    """The wire needs a silence from now."""
    bench.link.stamps.next_ns = bench.now_ns + int(ms * MS)


def test_a_request_is_sent_when_the_silence_is_over() -> None:
    bench = Bench()
    holds(bench)
    bench.send(OTHER)
    assert bench.link.sent == []
    due_ns = bench.link.stamps.next_ns
    assert bench.line.deadline_ns == due_ns
    bench.line.tick(due_ns - 1)
    assert bench.link.sent == []
    bench.line.tick(due_ns)
    assert bench.link.sent == [(1, OTHER)]


def test_bytes_during_the_silence_delay_the_request() -> None:
    bench = Bench()
    holds(bench)
    bench.send(OTHER)
    bench.now_ns += MS
    holds(bench)  # a byte was heard
    bench.wait(0.75)
    assert bench.link.sent == []
    assert bench.leaves_after(1) == (1, OTHER)


def test_w5_a_request_is_not_sent_once_its_controller_has_given_up() -> None:
    """The process stands still while the silence passes."""
    for unit_id in (1, 0):
        bench = Bench()
        holds(bench)
        bench.send(WORD, unit_id=unit_id)
        bench.wait(1001)  # timeout_ms = 1000
        assert bench.link.sent == []
        assert bench.kinds()[-1] == "withdrawn"
        assert bench.port.replies == []


def test_w5_a_request_is_not_sent_if_its_controller_sends_another_one_or_disconnects() -> None:
    bench = Bench()
    holds(bench)
    bench.send(WORD)
    bench.send(OTHER)
    bench.wait(SILENCE_MS)
    assert bench.link.sent == [(1, OTHER)]
    bench.link.sent.clear()
    bench.line.reply(1, bytes.fromhex("03 02 0000"), bench.now_ns)
    holds(bench)
    bench.send(WORD)
    bench.line.controller_gone(bench.port, bench.now_ns)
    bench.wait(10)
    assert bench.link.sent == []


def test_m3_a_target_given_up_during_the_silence_is_lost() -> None:
    bench = StagedBench()
    assert bench.ask(write(COMMAND, 10_000)) == write(COMMAND, 10_000)[:5]
    holds(bench)
    bench.send(write(COMMAND, 20_000))
    bench.wait(1001)
    assert bench.link.sent == []
    bench.port.replies.clear()
    assert bench.ask(RUN_PDU) == bytes.fromhex("86 04")


def test_w6_a_late_frame_during_the_silence_does_not_answer_the_waiting_request() -> None:
    """A drive answers later than ``drain_ms``: the next request still waits for the wire."""
    bench = Bench(timing=LineTiming(drain_ms=50))
    holds(bench)
    bench.send(OTHER)
    bench.line.stray(bench.now_ns, unit_id=1)
    assert bench.kinds()[-1] == "late-reply"
    assert bench.port.replies == []
    assert bench.leaves_after(50) == (1, OTHER)


def test_m3_a_stop_is_sent_before_a_waiting_request() -> None:
    bench = StagedBench()
    assert bench.ask(write(COMMAND, 10_000)) == write(COMMAND, 10_000)[:5]
    plc = Port(ControllerPlan("plc"))
    holds(bench)
    bench.send(RUN_PDU)
    bench.send(STOP_PDU, plc)
    assert bench.link.sent == []
    assert bench.port.take() == bytes.fromhex("86 06")
    assert bench.leaves_after(SILENCE_MS) == (1, STOP_PDU)


HALF = bytes.fromhex("06 0606 8009")
"""Writes half a position: the whole one is read first."""


def beside_a_staged_drive(
    *, connects: bool = False, stays: bool = False, timing: LineTiming | None = None, **changes: Any
) -> tuple[Bench, Port, bytes]:
    """A line with two drives, in which the position behind :data:`HALF` has just been read.

    ``stays``: the connection was seen to stay after an answer. ``changes``: of the second axis.
    """
    link = Link()
    link.connects = connects
    bench = Bench(axis_plan(), staged_plan(name="y", unit_id=2, **changes), link=link, timing=timing)
    if stays:
        for unit_id in (1, 2):
            bench.ask(OTHER, unit_id=unit_id)
            bench.wait(30)
    bench.memory.put(COMMAND, 0x00018005)
    bench.send(HALF)
    [(_, asked)] = bench.link.sent
    assert asked == read(COMMAND)
    bench.link.sent.clear()
    holds(bench)
    bench.line.reply(1, bench.memory.answer(asked), bench.now_ns)
    assert bench.link.sent == []
    return bench, Port(ControllerPlan("plc")), asked


def test_the_frame_after_its_prerequisite_waits_too_and_reads_nothing_twice() -> None:
    bench, plc, _ = beside_a_staged_drive()
    bench.send(OTHER, plc, unit_id=2)
    bench.wait(SILENCE_MS)
    assert bench.link.sent == [(1, read(ACTUAL))]
    bench.link.sent.clear()
    holds(bench)
    bench.line.reply(1, bench.memory.answer(read(ACTUAL)), bench.now_ns)
    assert bench.link.sent == []
    bench.wait(SILENCE_MS)
    # 0x00018009 forward, with the correction of 10 counts that holds behind the table
    assert bench.answers(bytes.fromhex("10 0606 0002")) == bytes.fromhex("10 0606 0002 04 8013 0001")
    assert bench.port.take() == HALF
    assert bench.link.sent == [(2, OTHER)]


def test_a_prerequisite_is_read_again_if_a_stop_is_sent_first() -> None:
    bench, plc, asked = beside_a_staged_drive()
    bench.send(STOP_PDU, plc, unit_id=2)
    bench.wait(SILENCE_MS)
    assert bench.link.sent == [(2, STOP_PDU)]
    bench.link.sent.clear()
    holds(bench)
    bench.line.reply(2, STOP_PDU, bench.now_ns)
    bench.wait(SILENCE_MS)
    assert bench.link.sent == [(1, asked)]


def test_a_prerequisite_is_read_again_after_a_late_frame() -> None:
    bench, _, asked = beside_a_staged_drive(timing=LineTiming(drain_ms=50.0))
    bench.line.stray(bench.now_ns, unit_id=1)
    bench.wait(SILENCE_MS)
    assert bench.leaves_after(50 - SILENCE_MS) == (1, asked)


def test_a_prerequisite_is_read_again_after_a_lost_link() -> None:
    bench, _, asked = beside_a_staged_drive(connects=True)
    bench.line.link_down(bench.now_ns)
    bench.line.link_up(bench.now_ns)
    bench.wait(SILENCE_MS)
    assert (1, asked) in bench.link.sent


def test_a_prerequisite_is_read_again_after_a_connection_that_blinked() -> None:
    bench, _, asked = beside_a_staged_drive(connects=True, stays=True)
    bench.line.link_down(bench.now_ns, is_orderly=True)
    bench.wait(SILENCE_MS)
    bench.line.link_up(bench.now_ns)
    assert bench.link.sent == [(1, asked)]


def test_after_a_lost_link_its_first_reads_are_sent_before_what_was_next() -> None:
    bench, _, _ = beside_a_staged_drive(connects=True, stays=True, referenced=Reference.DRIVE_BIT)
    bench.line.link_down(bench.now_ns)
    bench.wait(SILENCE_MS)
    bench.line.link_up(bench.now_ns)
    assert bench.link.sent == [(2, bytes.fromhex("03 005C 0001"))]


def test_w5_a_monitor_that_gave_up_behind_its_prerequisite_is_withdrawn_before_motion_is_sent() -> None:
    """Its read needs the homed bit, which the drive did not tell at the start. Then the process stands still
    for longer than its timeout_ms."""
    bench = Bench(axis_plan(referenced=Reference.DRIVE_BIT, bits={"homed": BITS["homed"]}))
    bench.port.patience_ns = 5_000 * MS
    bench.line.link_down(bench.now_ns)
    bench.line.link_up(bench.now_ns)
    homed = bench.link.take()
    for _ in range(2):
        bench.wait(1_001)  # its time-out, then the silence behind it
    bench.send(read(ACTUAL), monitor())
    assert bench.link.take() == homed
    holds(bench)
    bench.line.reply(1, bench.memory.answer(homed), bench.now_ns)
    bench.send(OTHER)
    assert bench.link.sent == []
    bench.wait(1_001)
    assert bench.link.sent == [(1, OTHER)]
    assert bench.kinds()[-1] == "withdrawn"


def test_a_monitor_still_gets_the_gap_after_a_motion_exchange() -> None:
    """Motion of 2 ms each 20 ms: a read of a monitor fits into the gap, and begins when the wire is free."""
    plant: Plant = watching(20, 400)
    plant.at(400)
    plant.send(MOTION)
    plant.send(WATCH, plant.hmi)
    plant.at(402)
    plant.link.stamps.next_ns = plant.now_ns + 1_750_000
    plant.answer()
    assert plant.on_wire() is None
    plant.at(403.8)  # a timer comes a little late
    assert plant.on_wire() == WATCH


def test_w6_a_reply_after_timeout_ms_is_not_passed_on_to_an_rtu_controller() -> None:
    """The controller would take it for the reply to its newest request. The content of the reply still
    counts."""
    timing = LineTiming(response_timeout_ms=2000)
    for serial in (True, False):
        bench = Bench(axis_plan(), serial=serial, timing=timing)
        bench.send(read(ACTUAL))
        bench.link.sent.clear()
        bench.wait(1000.5)
        bench.line.reply(1, bytes.fromhex("03 04 0000 2710"), bench.now_ns)
        assert len(bench.port.replies) == (0 if serial else 1)
        late = [each.detail for each in bench.events if each.kind is exchange_events.LATE_REPLY]
        assert late == (["a reply came after timeout_ms of cnc and was not passed on"] if serial else [])
        assert bench.line.axes[0].reach.silent_since_ns is None


def test_w6_a_reply_within_timeout_ms_is_passed_on() -> None:
    bench = Bench(timing=LineTiming(response_timeout_ms=2000))
    bench.send(OTHER)
    bench.link.sent.clear()
    bench.wait(1000)
    bench.line.reply(1, bytes.fromhex("03 02 0000"), bench.now_ns)
    assert bench.port.take() == bytes.fromhex("03 02 0000")


def test_added_reads_wait_for_the_silence_too() -> None:
    bench = Bench()
    bench.line.link_down(bench.now_ns)
    holds(bench, 5)
    bench.line.link_up(bench.now_ns)
    assert bench.link.sent == []
    hmi = monitor()
    bench.send(OTHER, hmi)
    assert bench.link.sent == []
    bench.wait(5)
    assert len(bench.link.sent) == 1


# --- the silence is over, and its alarm comes behind what is read first ------------------------------------


def passes(bench: Bench, ms: float) -> None:
    """Let the silence end before its alarm is called: the loop reads first."""
    bench.now_ns += int(ms * MS)


def test_w1_a_request_read_before_the_alarm_does_not_overtake_one_of_its_controller() -> None:
    bench = Bench(serial=False)
    holds(bench)
    bench.send(WORD, transaction_id=1)
    passes(bench, 2)
    bench.send(OTHER, transaction_id=2)
    bench.wait(0)  # now the alarm comes
    assert bench.link.sent == [(1, WORD)]


def test_m3_a_trigger_read_before_the_alarm_does_not_run_the_target_before() -> None:
    bench = StagedBench(serial=False)
    bench.go_to(10_000)
    holds(bench)
    bench.send(write(COMMAND, 20_000), transaction_id=1)
    passes(bench, 2)
    bench.send(RUN_PDU, transaction_id=2)
    bench.wait(0)
    assert [pdu[0] for _, pdu in bench.link.sent] == [0x10], "the trigger overtook its target"


def test_m3_a_stop_read_before_the_alarm_overtakes_the_waiting_trigger() -> None:
    bench = StagedBench(serial=False)
    bench.stage(10_000)
    plc = Port(ControllerPlan("plc"))
    holds(bench)
    bench.send(RUN_PDU)
    passes(bench, 2)
    bench.send(STOP_PDU, plc)
    bench.serve()
    bench.wait(10)
    bench.serve()
    assert [kind for kind, _ in bench.drive.moves] == ["stop"], bench.drive.moves


def test_m3_no_request_read_before_the_alarm_is_sent_before_a_waiting_stop() -> None:
    bench = StagedBench(serial=False)
    bench.stage(10_000)
    plc = Port(ControllerPlan("plc"))
    holds(bench)
    bench.send(STOP_PDU, plc)
    passes(bench, 2)
    bench.send(OTHER)
    assert bench.link.sent == [(1, STOP_PDU)]


def behind_a_silent_unit(serial: bool) -> Bench:
    """Unit 1 answers; unit 2 has not answered."""
    timing = LineTiming(response_timeout_ms=20, drain_ms=5, retry_ms=1000)
    bench = Bench(axis_plan(), staged_plan(name="y", unit_id=2), serial=serial, timing=timing)
    bench.port.patience_ns = 300 * MS
    plc = Port(ControllerPlan("plc", timeout_ms=20))
    bench.memory.put(COMMAND, 0x00018005)
    bench.send(OTHER, plc, unit_id=2)
    bench.link.sent.clear()
    bench.wait(20)
    bench.wait(20)
    bench.events.clear()
    return bench


def test_a_request_with_a_prerequisite_is_sent_although_another_unit_is_silent() -> None:
    for serial in (True, False):
        bench = behind_a_silent_unit(serial)
        reads = 0
        bench.send(HALF)
        for _ in range(100):
            if not bench.link.sent:
                bench.wait(1)
                continue
            unit_id, pdu = bench.link.sent.pop()
            if pdu[0] != 3:
                break
            reads += 1
            bench.now_ns += MS
            holds(bench)
            bench.line.reply(unit_id, bench.memory.answer(pdu), bench.now_ns)
        else:
            raise AssertionError(f"read {reads} times, never written; {bench.kinds()}")
        assert reads <= 2


def test_w5_a_broadcast_that_waits_is_not_withdrawn_by_the_next_request() -> None:
    """An RTU controller waits for no reply to a broadcast: both frames may be read at once."""
    bench = Bench(timing=LineTiming(turnaround_ms=10))
    holds(bench, 5)
    bench.send(WORD, unit_id=0)
    bench.send(OTHER)
    bench.wait(5)
    assert bench.link.sent == [(0, WORD)], bench.kinds()


def test_a_stop_that_waits_is_sent_although_the_gateway_stops() -> None:
    bench = StagedBench()
    holds(bench, 5)
    bench.send(STOP_PDU)
    bench.line.stop(bench.now_ns)
    bench.wait(5)
    assert bench.link.sent == [(1, STOP_PDU)]


def test_a_deadline_counts_the_silence_too() -> None:
    """``deadline_ms`` counts until the first byte to the drive: 3 ms; the silence of the drive takes 4."""
    bench = Bench(axis_plan(deadline_ms=3.0, late=Late.REJECT), serial=False)
    bench.ask(write(COMMAND, 10_000))
    holds(bench, 5)
    bench.now_ns += MS
    bench.send(write(COMMAND, 10_100))
    bench.wait(4)
    assert bench.link.sent == []
    assert bench.port.take() == bytes.fromhex("90 06")


def test_w5_on_a_wire_that_is_never_silent_requests_are_withdrawn_in_time() -> None:
    """Noise: a byte each millisecond."""
    bench = Bench(serial=False, timing=LineTiming(response_timeout_ms=100))
    bench.port.patience_ns = 100 * MS
    holds(bench)
    bench.send(OTHER)
    for _ in range(103):
        holds(bench)
        bench.line.stray(bench.now_ns)
        bench.wait(1)
    assert bench.kinds()[-1] == "withdrawn"
    assert bench.line.is_still


def reads_until_written(bench: Bench, gap_ms: float, ms: int) -> int:
    """Send a request that needs a prerequisite; return the number of added frames before it."""
    bench.send(HALF)
    for count in range(ms):
        while not bench.link.sent and bench.line.deadline_ns is not None:
            bench.now_ns = max(bench.now_ns, bench.line.deadline_ns)
            bench.line.tick(bench.now_ns)
        unit_id, pdu = bench.link.sent.pop()
        if pdu[0] != 3:
            return count
        bench.now_ns += MS
        holds(bench, gap_ms)
        bench.line.reply(unit_id, bench.memory.answer(pdu), bench.now_ns)
    raise AssertionError(f"read {ms} times, never written; {bench.kinds()}")


@pytest.mark.parametrize("gap_ms", [0, SILENCE_MS])
def test_a_stop_that_waits_to_be_repeated_does_not_make_others_read_again_and_again(gap_ms: float) -> None:
    """Unit 2 left a stop unanswered; the same stop waits for ``retry_ms``."""
    timing = LineTiming(response_timeout_ms=20, drain_ms=5, retry_ms=1000)
    plans = (axis_plan(), staged_plan(name="y", unit_id=2))
    bench = Bench(*plans, serial=False, tcp_drive=True, timing=timing)
    bench.port.patience_ns = 300 * MS
    bench.memory.put(COMMAND, 0x00018005)
    plc = Port(ControllerPlan("plc", timeout_ms=20))
    for _ in range(2):
        bench.send(STOP_PDU, plc, unit_id=2)
        bench.link.sent.clear()
        bench.wait(20)
    assert reads_until_written(bench, gap_ms, 40) <= 2


def test_m3_a_stop_that_is_due_when_a_prerequisite_is_answered_is_sent_first() -> None:
    """Unit 2 left it unanswered; the same stop waits for ``retry_ms``, which end with that answer."""
    timing = LineTiming(response_timeout_ms=20, retry_ms=1000)
    plans = (axis_plan(), staged_plan(name="y", unit_id=2))
    bench = Bench(*plans, serial=False, tcp_drive=True, timing=timing)
    bench.memory.put(COMMAND, 0x00018005)
    plc = Port(ControllerPlan("plc", timeout_ms=20))
    bench.send(STOP_PDU, plc, unit_id=2)
    bench.link.sent.clear()
    bench.wait(20)
    bench.send(STOP_PDU, plc, unit_id=2)
    bench.wait(999)
    bench.send(HALF)
    assert bench.link.take() == read(COMMAND)
    bench.now_ns += MS
    bench.line.reply(1, bench.memory.answer(read(COMMAND)), bench.now_ns)
    assert bench.link.sent == [(2, STOP_PDU)]


# --- a wire that is never silent ----------------------------------------------------------------------------


def chatters(bench: Bench, ms: int) -> None:
    """Noise comes each millisecond: an RS-485 pair without bias resistors, while nobody drives it."""
    for _ in range(ms):
        bench.now_ns += MS
        holds(bench)
        bench.line.stray(bench.now_ns)
        bench.line.tick(bench.now_ns)


def noisy_bench(baudrate: int = 0) -> StagedBench:
    """Return a bench whose axis goes to 50 000 and whose wire chatters; no baud rate: there is no wire."""
    bench = StagedBench()
    bench.go_to(20_000)
    bench.run(50_000)
    bench.link.stamps.wire_ns_per_byte = 11 * 1_000_000_000 // baudrate if baudrate else 0
    chatters(bench, 10)
    return bench


@pytest.mark.parametrize(
    ("baudrate", "waits_ms"),
    [
        (0, 1_100),
        (115_200, 148),
        (9_600, 686),
    ],  # 100 ms, and drain_ms or 512 characters of 95.5 and 1145.8 µs
)
def test_m3_a_stop_is_sent_through_noise_that_no_frames_explain(baudrate: int, waits_ms: int) -> None:
    bench = noisy_bench(baudrate)
    bench.send(STOP_PDU)
    chatters(bench, waits_ms)
    assert bench.link.sent == []
    chatters(bench, 2)
    assert bench.link.sent == [(1, STOP_PDU)]


def test_m3_a_stop_waits_for_the_gap_that_a_drive_needs_however_long() -> None:
    bench = StagedBench(timing=LineTiming(gap_ms=300.0))
    holds(bench, 300)
    bench.send(STOP_PDU)
    for _ in range(299):
        bench.wait(1)
    assert bench.link.sent == []
    bench.wait(1)
    assert bench.link.sent == [(1, STOP_PDU)]


def test_w5_a_request_that_noise_has_held_up_is_withdrawn_and_says_so() -> None:
    bench = noisy_bench(115_200)
    bench.send(WORD)
    chatters(bench, 1_010)  # timeout_ms = 1000
    assert bench.link.sent == []
    assert bench.events[-1].kind is exchange_events.WITHDRAWN
    assert "the drives' wire was never silent: noise?" in bench.events[-1].detail


def test_the_next_stop_after_noise_waits_for_its_silence_again() -> None:
    bench = noisy_bench()
    bench.send(WORD)
    chatters(bench, 1_010)
    bench.wait(500)  # silent at last
    holds(bench)
    bench.send(STOP_PDU)
    assert bench.link.sent == []
    bench.wait(SILENCE_MS)
    assert bench.link.sent == [(1, STOP_PDU)]
