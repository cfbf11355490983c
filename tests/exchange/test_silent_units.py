"""A unit id that does not answer: the delays for it, its group, and the others on its line (W6, W11)."""

from dataclasses import replace
from itertools import product
from typing import Any, Final

import pytest

from gateway.drives.motion import Action, MotionPlan, Operation, TriggerPlan
from gateway.exchange.axis.motion import MotionState
from gateway.exchange.plan import ControllerPlan, LineTiming, Reference, Role
from gateway.exchange.rights import Rights
from gateway.exchange.silent_units import REACH_AFTER, Reach, Sign
from gateway.modbus.registers import BitField, BitTable
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Link, Port, axis_plan, read, write
from tests.exchange.silent_bench import ANSWER, OTHER, SILENT, controller, line, polled_in_turn, two_axes
from tests.exchange.staged_bench import RUN_PDU, staged_plan
from tests.support.tables import walk

WALK: Final = """
            answers    unheard    missed-one missed-two dead
time-out    missed-one missed-one missed-two dead       dead
frame       answers    answers    answers    answers    answers
link-up     answers    unheard    unheard    unheard    unheard
"""
"""By hand: three time-outs in a row, and what ends them."""


def leave_unanswered(bench: Bench, times: int = 1, unit_id: int = 2) -> None:
    """Send so many requests to a unit id without an answer, each after the silence that it needs."""
    for _ in range(times):
        bench.send(OTHER, unit_id=unit_id)
        assert bench.link.sent.pop() == (unit_id, OTHER)
        bench.wait(100)
        bench.port.replies.clear()
        bench.wait(50)


@pytest.mark.parametrize(("state", "sign"), list(product(Reach, Sign)))
def test_each_sign_leads_from_each_state_to_the_one_that_the_rule_says(state: Reach, sign: Sign) -> None:
    assert REACH_AFTER[state, sign].value == walk(WALK)[state.value, sign.value]


# --- back-off ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("serial", [False, True])
@pytest.mark.parametrize("tcp_drive", [False, True])
def test_w11_after_three_time_outs_a_request_is_answered_immediately(
    *, serial: bool, tcp_drive: bool
) -> None:
    bench = line(serial=serial, tcp_drive=tcp_drive)
    leave_unanswered(bench, 3)
    assert bench.ask(OTHER, unit_id=2) == SILENT
    assert bench.ask(bytes.fromhex("06 0700 0001"), unit_id=2) == bytes.fromhex("86 0B")
    assert bench.link.sent == []
    assert bench.seen == []
    assert bench.line.counters.backed_off == 2
    assert bench.line.counters.refused == 0
    assert bench.kinds() == ["line-up", "drive-silent", "drive-backed-off"]


def test_w11_reads_at_the_start_end_unsent_once_their_drive_is_dead() -> None:
    """Four axes on one unit id. The first trial is due with the end of the silence after the third read."""
    plans = [
        axis_plan(
            name=f"y{number}",
            command=(replace(COMMAND, address=0x0700 + 4 * number),),
            actual=(replace(ACTUAL, address=0x0702 + 4 * number),),
            referenced=Reference.DRIVE_BIT,
            bits={"homed": BitField(0x0060 + number, 0)},
        )
        for number in range(4)
    ]
    bench = line(*plans, serial=True, retry_ms=50.0)
    bench.line.link_down(bench.now_ns)
    bench.line.link_up(bench.now_ns)
    asked = []
    for _ in range(20):
        asked += [pdu.hex(" ") for _, pdu in bench.link.sent]
        bench.link.sent.clear()
        bench.wait(50)
    assert asked == ["03 00 60 00 01", "03 00 61 00 01", "03 00 62 00 01"]


def test_w11_two_time_outs_are_not_enough() -> None:
    bench = line()
    leave_unanswered(bench, 2)
    assert bench.ask(OTHER, unit_id=2) == bytes.fromhex("03 02 0000")


def test_w11_with_retry_ms_0_requests_are_always_sent() -> None:
    bench = line(retry_ms=0.0)
    leave_unanswered(bench, 9)
    assert bench.kinds() == ["line-up", "drive-silent"]


def test_w11_trials_come_after_retry_ms_then_after_twice_that_up_to_10_s() -> None:
    bench = line(retry_ms=2000.0)
    leave_unanswered(bench, 3)
    pauses_ms = []
    waited_ms = 50.0  # since the third time-out
    for _ in range(4):
        while not bench.link.sent:
            bench.wait(10)
            waited_ms += 10
            bench.send(OTHER, unit_id=2)
        pauses_ms.append(waited_ms)
        bench.link.sent.clear()
        bench.wait(100)
        waited_ms = 0.0
    assert pauses_ms == [2000, 4000, 8000, 10_000]


def patient() -> Bench:
    """The same line, whose controllers wait for 1000 ms; unit id 2 has left three requests unanswered."""
    bench = line()
    bench.port = controller("plc", timeout_ms=1000.0)
    for _ in range(3):
        bench.send(OTHER, unit_id=2)
        assert bench.link.take() == OTHER
        bench.wait(999)
        assert bench.port.replies == []
        bench.wait(1)
        assert bench.port.take() == SILENT
        bench.wait(50)
    bench.wait(150)
    return bench


def test_w11_a_trial_read_delays_the_others_by_response_timeout_ms_at_most() -> None:
    bench, panel = patient(), controller("panel", timeout_ms=1000.0)
    bench.send(OTHER, unit_id=2)
    assert bench.link.take() == OTHER
    bench.send(write(COMMAND, 5000), panel, unit_id=1)
    assert bench.leaves_after(100)[1] == write(COMMAND, 5000)
    assert bench.port.take() == SILENT


def test_w11_a_late_answer_to_a_trial_answers_no_request_and_ends_the_back_off() -> None:
    bench, panel = patient(), controller("panel", timeout_ms=1000.0)
    bench.missed(OTHER, 100, unit_id=2)
    bench.port.take()
    bench.send(OTHER, panel, unit_id=1)
    assert bench.link.sent.pop() == (1, OTHER)
    bench.line.stray(bench.now_ns, unit_id=2)
    assert panel.replies == []
    assert bench.kinds()[-1] == "drive-answers"
    bench.line.reply(1, bytes.fromhex("03 02 0007"), bench.now_ns)
    assert panel.take() == bytes.fromhex("03 02 0007")
    bench.send(OTHER, unit_id=2)
    assert bench.link.sent == []  # the silence of a unit that was late
    bench.wait(50)
    assert bench.link.take() == OTHER
    bench.wait(999)  # and no trial any more
    assert bench.port.replies == []
    bench.line.reply(2, ANSWER, bench.now_ns)
    assert bench.port.take() == ANSWER


@pytest.mark.parametrize("pdu", ["06 0700 0001", "17 0700 0001 0700 0001 02 0001", "65 00"])
def test_w11_a_trial_that_may_write_waits_as_long_as_its_controller(pdu: str) -> None:
    bench = patient()
    bench.send(bytes.fromhex(pdu), unit_id=2)
    assert bench.link.take() == bytes.fromhex(pdu)
    bench.wait(999)
    assert bench.port.replies == []
    bench.line.reply(2, bytes.fromhex(pdu), bench.now_ns)
    assert bench.port.take() == bytes.fromhex(pdu)


def test_w11_while_a_trial_is_on_the_wire_the_others_are_answered() -> None:
    bench, panel = line(), controller("panel")
    leave_unanswered(bench, 3)
    bench.wait(150)
    bench.send(OTHER, unit_id=2)
    bench.send(OTHER, panel, unit_id=2)
    assert bench.link.take() == OTHER
    assert panel.take() == SILENT
    bench.line.reply(2, ANSWER, bench.now_ns)
    assert bench.port.take() == ANSWER
    assert bench.kinds()[-1] == "drive-answers"
    bench.send(OTHER, panel, unit_id=2)
    assert bench.link.take() == OTHER


def test_w11_a_trial_waits_for_the_silence_after_the_last_time_out_and_after_a_late_frame() -> None:
    bench = line(retry_ms=1.0)
    leave_unanswered(bench, 2)
    bench.unanswered(OTHER, 100, unit_id=2)
    bench.wait(30)
    assert bench.ask(OTHER, unit_id=2) == SILENT
    bench.line.stray(bench.now_ns)  # of nobody knows whom: 50 ms from here
    bench.wait(49)
    assert bench.ask(OTHER, unit_id=2) == SILENT
    bench.wait(1)
    assert bench.ask(OTHER, unit_id=2) == bytes.fromhex("03 02 0000")


def test_w11_a_late_frame_ends_the_back_off_and_the_next_request_waits_for_the_silence() -> None:
    bench = line()
    leave_unanswered(bench, 2)
    bench.missed(OTHER, 100, unit_id=2)
    bench.line.stray(bench.now_ns, unit_id=2)
    bench.send(OTHER, unit_id=2)
    assert bench.leaves_after(50)[1] == OTHER


def test_w11_a_link_that_comes_up_ends_the_back_off_and_the_unit_stays_silent_until_it_answers() -> None:
    bench = line()
    leave_unanswered(bench, 3)
    bench.line.link_down(bench.now_ns)
    bench.line.link_up(bench.now_ns)
    bench.send(OTHER, unit_id=2)
    assert bench.link.take() == OTHER
    status = bench.line.unit_ids_status(bench.now_ns).drives["2"]
    assert (status.timeouts_in_a_row, status.tried_again_s) == (3, None)


def test_w11_the_answer_for_a_dead_drive_comes_after_earlier_answers() -> None:
    bench = line()
    leave_unanswered(bench, 3)
    bench.send(OTHER, unit_id=1, transaction_id=1)
    bench.send(OTHER, unit_id=2, transaction_id=2)
    assert bench.port.replies == []
    bench.line.reply(1, ANSWER, bench.now_ns)
    assert bench.port.replies == [(1, 1, ANSWER), (2, 2, SILENT)]


def test_m11_the_group_of_a_dead_drive_is_answered_too_and_a_read_of_that_drive_is_the_trial() -> None:
    timing = LineTiming(response_timeout_ms=100, drain_ms=50, retry_ms=200)
    bench = Bench(*two_axes(), timing=timing, serial=False, groups=[["x", "y"]])
    bench.port = controller("plc")
    leave_unanswered(bench, 3)
    assert bench.ask(write(COMMAND, 5000)) == bytes.fromhex("90 0B")
    assert bench.ask(read(ACTUAL)) == SILENT
    assert bench.link.sent == []
    assert bench.seen == []
    bench.wait(150)
    bench.send(read(ACTUAL), unit_id=1)
    assert bench.link.sent == [(2, read(ACTUAL))]
    bench.serve()
    assert bench.port.take() == bytes.fromhex("03 04 0000 0000")
    assert bench.seen == [read(ACTUAL)] * 2


def homing_line(retry_ms: float = 200.0, **changes: Any) -> Bench:
    """Return an axis with a declared reference, corrected at 60 mm on the forward branch."""
    plan = axis_plan(unit_id=2, referenced=Reference.HOMING, lost_ms=1000.0, **changes)
    bench = line(plan, retry_ms=retry_ms)
    bench.line.axes[0].declare_referenced()
    for counts in (30_000, 60_000):
        bench.ask(write(COMMAND, counts), unit_id=2)
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
        bench.wait(1000)
    assert bench.line.axes[0].reference.is_referenced
    bench.seen.clear()
    return bench


def test_w11_before_a_write_that_moves_an_added_read_is_the_trial_and_lost_ms_is_checked() -> None:
    """The drive was off for 8 s, of which the gateway saw three time-outs of 0.1 s: its zero is another."""
    bench = homing_line()
    leave_unanswered(bench, 3)
    bench.wait(8000)
    bench.send(write(COMMAND, 70_000), unit_id=2)
    assert bench.link.sent == [(2, read(ACTUAL))]
    bench.serve()
    assert bench.port.take() == write(COMMAND, 70_000)[:5]
    assert bench.seen[-1] == write(COMMAND, 70_000)  # 1:1, not 70 010
    assert "reference-lost" in bench.kinds()


def test_w11_requests_answered_for_the_drive_count_as_unanswered() -> None:
    bench = homing_line(retry_ms=2000.0)
    leave_unanswered(bench, 3)  # 0.45 s
    for _ in range(7):
        bench.wait(100)
        assert bench.ask(OTHER, unit_id=2) == SILENT
    bench.line.stray(bench.now_ns, unit_id=2)  # it starts and says something
    bench.wait(150)
    bench.ask(write(COMMAND, 70_000), unit_id=2)
    assert bench.seen[-1] == write(COMMAND, 70_000)


def test_w11_a_short_back_off_keeps_the_reference() -> None:
    bench = homing_line()
    leave_unanswered(bench, 3)  # 0.45 s
    bench.wait(200)
    bench.ask(write(COMMAND, 70_000), unit_id=2)
    assert bench.seen[-1] == write(COMMAND, 70_010)
    assert bench.seen[0] == read(ACTUAL)


def test_w11_without_added_reads_the_write_itself_is_the_trial() -> None:
    bench = homing_line(added_frames=False)
    leave_unanswered(bench, 3)
    bench.wait(8000)
    bench.send(write(COMMAND, 70_000), unit_id=2)
    assert bench.link.sent == [(2, write(COMMAND, 70_000))]


def test_w11_the_homed_bit_is_read_before_a_write_passes_again() -> None:
    homed = BitField(0x0100, 0, BitTable.REGISTER)
    plan = axis_plan(unit_id=2, referenced=Reference.DRIVE_BIT, bits={"homed": homed}, lost_ms=1000.0)
    bench = line(plan)
    bench.memory.words[homed.address] = 1
    bench.ask(write(COMMAND, 60_000), unit_id=2)
    assert bench.memory.get(COMMAND) == 60_010
    leave_unanswered(bench, 3)
    bench.wait(200)
    bench.memory.words[homed.address] = 0
    bench.seen.clear()
    bench.ask(write(COMMAND, 70_000), unit_id=2)
    assert bench.seen == [read(ACTUAL), bytes.fromhex("03 0100 0001"), write(COMMAND, 70_000)]


# --- silence only where it is needed -----------------------------------------------------------------------


def test_w6_a_read_of_another_unit_is_sent_without_the_silence_and_a_write_waits_for_it() -> None:
    bench, panel = line(), controller("panel")
    bench.missed(OTHER, 100, unit_id=2)
    bench.send(OTHER, unit_id=1)
    assert bench.link.sent.pop() == (1, OTHER)
    bench.line.reply(1, ANSWER, bench.now_ns)
    bench.send(bytes.fromhex("06 0700 0001"), unit_id=1)
    bench.send(OTHER, unit_id=1)  # of the same controller: behind its write
    bench.send(OTHER, panel, unit_id=2)  # another function or size would be no proof either
    assert bench.link.sent == []
    assert bench.leaves_after(50)[1] == bytes.fromhex("06 0700 0001")


@pytest.mark.parametrize("pdu", ["04 0700 0001", "03 0700 0002", "01 0700 0001"])
def test_w6_nothing_is_sent_to_the_silent_unit_itself_before_the_silence(pdu: str) -> None:
    bench = line()
    bench.missed(OTHER, 100, unit_id=2)
    bench.send(bytes.fromhex(pdu), unit_id=2)
    assert bench.leaves_after(50)[1] == bytes.fromhex(pdu)


@pytest.mark.parametrize("is_owed_by_unit", [True, False])
def test_w6_a_silence_over_a_standstill_of_the_process_ends_when_all_bytes_are_read(
    *, is_owed_by_unit: bool
) -> None:
    """The process stands still after the time-out, for longer than the silence. Meanwhile the drive answers
    late, and the controller sends a new request. Either may be read first: the request waits until the
    drives' port was read."""
    bench = line()
    if is_owed_by_unit:
        bench.missed(OTHER, 100, unit_id=2)
    else:
        bench.line.stray(bench.now_ns, unit_id=2)  # a frame that nobody asked for: the whole line rests
    bench.now_ns += 60 * MS
    bench.send(OTHER, unit_id=2)
    assert bench.link.sent == []
    bench.line.stray(bench.now_ns, unit_id=2)
    bench.wait(0)
    assert bench.leaves_after(50)[1] == OTHER


@pytest.mark.parametrize(("unit_id", "pdu"), [(1, "06 0700 0001"), (0, "06 0700 0001"), (1, "65 00")])
def test_w6_writes_and_broadcasts_do_not_wait_for_a_dead_unit(unit_id: int, pdu: str) -> None:
    bench = line()
    leave_unanswered(bench, 2)
    bench.missed(OTHER, 100, unit_id=2)
    bench.send(bytes.fromhex(pdu), unit_id=unit_id)
    assert bench.link.sent == [(unit_id, bytes.fromhex(pdu))]


def test_w6_all_units_wait_for_the_silence_for_ten_minutes_after_a_late_frame() -> None:
    bench = line()
    bench.missed(OTHER, 100, unit_id=2)
    bench.line.stray(bench.now_ns, unit_id=2)

    def waits_ms() -> float:
        """How long a read of unit 1 waits after a time-out of unit 2."""
        bench.wait(1000)
        bench.missed(OTHER, 100, unit_id=2)
        bench.send(OTHER, unit_id=1)
        waited_ms = 0.0
        while not bench.link.sent:
            bench.wait(10)
            waited_ms += 10
        assert bench.link.sent.pop() == (1, OTHER)
        bench.line.reply(1, ANSWER, bench.now_ns)
        bench.wait(1000)
        bench.send(OTHER, unit_id=2)
        bench.serve()  # it answers again
        return waited_ms

    assert waits_ms() == 50
    bench.wait(597_000)
    assert waits_ms() == 0


def test_w6_a_dead_unit_that_was_ever_late_keeps_writes_waiting_for_good() -> None:
    bench = line()
    bench.line.stray(bench.now_ns, unit_id=2)
    bench.wait(700_000)
    leave_unanswered(bench, 2)
    bench.missed(OTHER, 100, unit_id=2)
    bench.send(bytes.fromhex("06 0700 0001"), unit_id=1)
    assert bench.leaves_after(50)[1] == bytes.fromhex("06 0700 0001")


def test_w6_a_late_frame_of_the_silent_unit_in_the_middle_of_another_exchange_is_remembered() -> None:
    bench = line()
    bench.missed(OTHER, 100, unit_id=2)
    bench.missed(OTHER, 40, unit_id=1)
    bench.line.stray(bench.now_ns, unit_id=2)
    bench.line.reply(1, ANSWER, bench.now_ns)
    assert bench.port.replies[-1][2] == ANSWER
    bench.send(OTHER, unit_id=1)
    assert bench.leaves_after(50)[1] == OTHER


# --- stops -------------------------------------------------------------------------------------------------

STOP: Final = bytes.fromhex("06 0900 0001")
STOP_16: Final = bytes.fromhex("10 0900 0001 02 0001")
MOTION: Final = MotionPlan(
    is_staged=False,
    triggers=(TriggerPlan(0x0900, deeds={1: Operation(Action.STOP)}, otherwise=Action.IGNORE),),
)


def stoppable() -> Bench:
    return line(*two_axes(motion=MOTION))


def time_out(bench: Bench) -> None:
    """Unit 2 does not answer, and the line waits for its late reply."""
    bench.unanswered(OTHER, 100, unit_id=2)


def test_w6_a_refusal_waits_for_no_silence_and_for_no_other_controller() -> None:
    """The refusal comes after the answer before it, although another request then takes the line."""
    bench = line(*two_axes())
    plc = Port(ControllerPlan("hmi", timeout_ms=100.0, rights=Rights(is_read_only=True)))
    bench.missed(OTHER, port=plc, unit_id=2)
    bench.send(write(COMMAND, 5_000), plc)
    bench.send(OTHER)
    bench.wait(100)
    assert [pdu for _, _, pdu in plc.replies] == [SILENT, bytes.fromhex("90 01")]
    assert bench.link.sent == [(1, OTHER)]


@pytest.mark.parametrize(("unit_id", "stop"), [(1, STOP), (2, STOP), (1, STOP_16)])
def test_m3_a_stop_is_sent_immediately_during_the_silence_and_only_once_if_it_is_answered(
    unit_id: int, stop: bytes
) -> None:
    bench = stoppable()
    time_out(bench)
    bench.send(stop, unit_id=unit_id)
    assert bench.link.sent.pop() == (unit_id, stop)
    bench.line.reply(unit_id, stop[:5], bench.now_ns)
    assert bench.port.take() == stop[:5]
    bench.wait(1000)
    assert bench.link.sent == []


def test_m3_a_stop_replaces_an_equal_one_whose_controller_is_gone() -> None:
    """The first stop was sent early, and must be sent once more after the silence: both are then sent as
    one."""
    bench, panel = stoppable(), controller("panel")
    time_out(bench)
    bench.missed(STOP, 100, port=panel, unit_id=2)
    bench.line.controller_gone(panel, bench.now_ns)
    bench.send(STOP, unit_id=2)
    assert bench.leaves_after(50) == (2, STOP)
    bench.line.reply(2, STOP, bench.now_ns)
    assert bench.port.take() == STOP
    bench.wait(1000)
    assert bench.link.sent == []


@pytest.mark.parametrize(("ms", "answered"), [(199, [8]), (200, [])])
def test_m3_of_equal_stops_that_wait_for_a_dead_drive_only_the_newest_stays(
    ms: int, answered: list[int]
) -> None:
    """200 ms after its time-out a stop leaves again; then nothing waits for longer."""
    bench, panel = stoppable(), controller("panel")
    leave_unanswered(bench, 3)
    bench.missed(STOP, 100, port=panel, unit_id=2)
    panel.replies.clear()
    bench.wait(150)
    bench.send(STOP, panel, unit_id=2, transaction_id=8)
    bench.now_ns += (ms - 150) * MS
    bench.send(STOP, panel, unit_id=2, transaction_id=9)
    assert [number for number, _, _ in panel.replies] == answered


@pytest.mark.parametrize("reply", ["86 04", "03 02 0005", "06 0900 0000", "10 0900 0001"])
def test_m3_a_stop_without_an_exact_echo_is_sent_once_more_after_the_silence(reply: str) -> None:
    bench = stoppable()
    time_out(bench)
    bench.missed(STOP, 20, unit_id=2)
    bench.line.reply(2, bytes.fromhex(reply), bench.now_ns)
    assert bench.port.replies == []
    assert bench.leaves_after(50) == (2, STOP)
    bench.line.reply(2, bytes.fromhex("86 04"), bench.now_ns)  # now it is its own
    assert bench.port.take() == bytes.fromhex("86 04")
    bench.wait(1000)
    assert bench.link.sent == []


def test_w6_the_late_echo_of_an_early_stop_answers_no_other_request() -> None:
    """A late frame ends the wait for the stop after 20 ms; its own echo may still come, for 150 ms in all."""
    bench = stoppable()
    time_out(bench)
    bench.missed(STOP, 20, unit_id=2)
    bench.line.reply(2, bytes.fromhex("03 02 0005"), bench.now_ns)
    bench.wait(50)
    assert bench.link.sent.pop() == (2, STOP)
    bench.line.reply(2, STOP, bench.now_ns)
    assert bench.port.take() == STOP
    other = bytes.fromhex("06 0901 0000")
    bench.send(other, unit_id=2)
    assert bench.link.sent == []  # one of two echoes has come: the other may answer this
    bench.line.stray(bench.now_ns, unit_id=2)
    bench.port.replies.clear()
    bench.wait(149)
    bench.send(OTHER, unit_id=2)
    assert bench.link.sent == []
    bench.wait(1)
    assert bench.link.sent.pop() == (2, OTHER)


def test_m3_the_acknowledgement_of_several_registers_does_not_prove_a_stop_during_the_silence() -> None:
    bench = stoppable()
    time_out(bench)
    bench.send(STOP_16, unit_id=2)
    bench.link.sent.clear()
    bench.line.reply(2, STOP_16[:5], bench.now_ns)
    assert bench.port.replies == []
    bench.wait(50)
    assert bench.link.sent.pop() == (2, STOP_16)


def test_m3_a_stop_without_an_answer_is_sent_twice_and_then_answered_0x0b() -> None:
    bench = stoppable()
    bench.ask(write(COMMAND, 5_000), unit_id=2)
    time_out(bench)
    assert bench.unanswered(STOP, 100, unit_id=2) == []
    assert bench.line.axes[1].motion.state is MotionState.STOPPED  # it may have been obeyed
    bench.wait(50)
    assert bench.link.sent.pop() == (2, STOP)
    bench.wait(100)
    assert bench.port.take() == bytes.fromhex("86 0B")
    bench.wait(1000)
    assert bench.link.sent == []


def test_m3_a_panel_that_repeats_its_stop_to_a_dead_drive_does_not_block_the_others() -> None:
    """Each 100 ms a stop to unit 2, which is dead; unit 1 answers in 1 ms and is read each 20 ms."""
    bench, panel = stoppable(), controller("panel")
    leave_unanswered(bench, 3)
    stops, answered, asked = 0, 0, 0
    for ms in range(0, 3000, 1):
        if ms % 100 == 0:
            bench.send(STOP, panel, unit_id=2)
        if ms % 20 == 0:
            bench.send(OTHER, unit_id=1)
            asked += 1
        for unit_id, pdu in tuple(bench.link.sent):
            bench.link.sent.remove((unit_id, pdu))
            stops += pdu == STOP
            if unit_id == 1:
                bench.line.reply(1, ANSWER, bench.now_ns)
        answered += len(bench.port.replies)
        bench.port.replies.clear()
        bench.wait(1)
    # A stop takes the line for 100 ms, the same comes 200 ms later at the earliest.
    assert 9 <= stops <= 10
    assert answered >= asked - 5


def test_m3_between_two_stops_to_a_dead_drive_each_other_controller_gets_an_exchange() -> None:
    bench = line(*two_axes(motion=MOTION), retry_ms=1.0)
    panel, others = controller("panel", timeout_ms=900), [controller(n, timeout_ms=2000) for n in "abc"]
    bench.send(STOP, panel, unit_id=2)
    bench.link.sent.clear()
    for port in others:
        bench.send(OTHER, port, unit_id=1)
    bench.send(STOP, panel, unit_id=2)
    bench.wait(900)
    order = []
    for _ in range(4):
        [(unit_id, pdu)] = bench.link.sent
        bench.link.sent.clear()
        order.append((unit_id, pdu))
        bench.wait(1)
        if unit_id == 1:
            bench.line.reply(1, ANSWER, bench.now_ns)
    assert order == [(1, OTHER)] * 3 + [(2, STOP)]


# --- results -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("serial", [False, True])
@pytest.mark.parametrize("ms", [1000.0, 300.0])
def test_w11_beside_a_dead_drive_the_other_drive_answers_within_20_ms_each_time(
    *, ms: float, serial: bool
) -> None:
    bench = Bench(timing=LineTiming(response_timeout_ms=ms, drain_ms=ms), serial=serial)
    bench.port = controller("plc", serial=serial, timeout_ms=ms)
    asked = polled_in_turn(bench, 12)  # two trials at least
    of_unit_1 = [took_ms for is_third, unit_id, took_ms in asked if is_third and unit_id == 1]
    assert len(of_unit_1) > 1000
    assert None not in of_unit_1
    assert max(took_ms for took_ms in of_unit_1 if took_ms is not None) <= 20


def test_w11_without_back_off_each_third_poll_of_the_dead_drive_costs_its_time_out() -> None:
    bench = Bench(timing=LineTiming(retry_ms=0.0), serial=False)
    bench.port = controller("plc", timeout_ms=1000.0)
    asked = polled_in_turn(bench, 12)
    # Once before, four until the second time-out at 3 s, then three in each 2 s: two at once, one behind it.
    assert len([unit_id for _, unit_id, _ in asked if unit_id == 1]) == 1 + 4 + 4 * 3 + 2


# === requests that could be sent only too late are answered immediately (W6)
#
# Where no other times are given: time-outs of 100 ms everywhere, silences of 80 ms. A request that comes less
# than 30 ms after a time-out would leave with less than half of its controller's time left.
#

WRITE: Final = bytes.fromhex("06 0700 0001")
WRITE_SILENT: Final = bytes.fromhex("86 0B")


def silent(*plans: Any, unit_id: int = 2, **options: Any) -> Bench:
    """A line in the instant in which a unit id has left a request unanswered."""
    bench = line(*plans, **{"drain_ms": 80.0, **options})
    bench.send(OTHER, unit_id=unit_id)
    assert bench.link.sent.pop() == (unit_id, OTHER)
    bench.wait(100)
    bench.port.replies.clear()
    return bench


def spend(bench: Bench) -> None:
    """Use up the answers to late requests of one silence."""
    for _ in range(2):
        bench.send(OTHER, unit_id=2)
        assert bench.port.take() == SILENT


# --- the purpose -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("serial", [False, True])
def test_w6_a_drive_polled_in_turn_with_a_silent_one_loses_no_request(*, serial: bool) -> None:
    """All time-outs and the silence 1000 ms; unit 1 takes 3 ms. Before, it waited 3, 1000, 1000 ms: as long
    as its controller does, and whatever else took a millisecond lost it."""
    bench = Bench(timing=LineTiming(), serial=serial, link=Link())
    bench.port = controller("plc", serial=serial, timeout_ms=1000.0)
    asked = polled_in_turn(bench, 5.5, takes_ms=3)
    first_ms = [took_ms for _, unit_id, took_ms in asked if unit_id == 1][1:9]
    # Unit 1 answers 3, 6 and 9 ms after the time-out, with unit 2 answered for twice in between. The third
    # poll of that comes at 9 ms and leaves at 1000. Unit 1 is polled at 1009 ms, and the line is free at
    # 2000 ms: 991 + 3 ms. Then the same behind the answer that came 3 ms after the second time-out.
    assert first_ms == [3, 3, 3, 994, 3, 3, 994, 3]
    assert None not in [took_ms for _, unit_id, took_ms in asked if unit_id == 1]
    of_unit_2 = [took_ms for _, unit_id, took_ms in asked if unit_id == 2][:8]
    assert of_unit_2 == [None if serial else 1000, 0, 0, None, 0, 0, None, 0]
    assert (bench.line.counters.timeouts, bench.line.counters.too_late) == (3, 4)


@pytest.mark.parametrize("serial", [False, True])
@pytest.mark.parametrize("drain_ms", [400.0, 600.0, 3000.0])
def test_w6_a_drive_polled_in_turn_loses_no_request_with_shorter_or_longer_silences(
    *, serial: bool, drain_ms: float
) -> None:
    bench = Bench(timing=LineTiming(drain_ms=drain_ms), serial=serial)
    bench.port = controller("plc", serial=serial, timeout_ms=1000.0)
    asked = polled_in_turn(bench, 14, takes_ms=3)
    assert None not in [took_ms for _, unit_id, took_ms in asked if unit_id == 1]
    assert bench.line.counters.too_late == (0 if drain_ms == 400 else 4)
    assert "drive-backed-off" in bench.kinds()


@pytest.mark.parametrize("serial", [False, True])
def test_w6_a_stop_that_is_sent_once_more_does_not_delay_a_read_of_its_controller(*, serial: bool) -> None:
    """The stop was sent early and not answered. Its controller reads unit 1, which owes no reply."""
    bench = silent(axis_plan(name="y", unit_id=2, motion=MOTION), serial=serial)
    bench.send(STOP, unit_id=2)
    assert bench.link.sent.pop() == (2, STOP)
    bench.wait(100)
    bench.send(OTHER, unit_id=1, transaction_id=8)
    assert bench.link.sent == [(1, OTHER)]
    bench.line.reply(1, ANSWER, bench.now_ns)
    assert bench.port.take() == ANSWER
    bench.link.sent.clear()
    bench.wait(80)
    assert bench.link.sent == [(2, STOP)]  # once more, behind the silence


# --- what is answered --------------------------------------------------------------------------------------


@pytest.mark.parametrize("serial", [False, True])
@pytest.mark.parametrize(("pdu", "answer"), [(OTHER, SILENT), (WRITE, WRITE_SILENT)])
def test_w6_a_request_that_would_be_sent_too_late_is_answered_on_serial_lines_too_and_counted(
    pdu: bytes, answer: bytes, *, serial: bool
) -> None:
    bench = silent(serial=serial)
    bench.send(pdu, unit_id=2)
    assert bench.port.take() == answer
    bench.wait(200)
    assert bench.link.sent == []
    counters = bench.line.counters
    assert (counters.too_late, counters.backed_off, counters.refused, counters.withdrawn) == (1, 0, 0, 0)


@pytest.mark.parametrize("pdu", [OTHER, WRITE])
def test_w6_a_request_that_can_be_sent_in_time_waits(pdu: bytes) -> None:
    bench = silent()
    bench.wait(30)
    bench.send(pdu, unit_id=2)
    assert bench.leaves_after(50)[1] == pdu
    assert bench.line.counters.too_late == 0


def test_w6_the_request_of_a_patient_controller_waits() -> None:
    bench, patient = silent(), controller("panel", timeout_ms=160.0)
    bench.send(OTHER, patient, unit_id=2)
    bench.wait(80)
    assert bench.link.take() == OTHER


def test_w6_a_request_that_came_before_the_time_out_is_answered_with_it() -> None:
    bench, panel = line(drain_ms=80.0), controller("panel")
    bench.send(OTHER, unit_id=2)
    bench.wait(60)
    bench.send(WRITE, panel, unit_id=2)
    bench.wait(40)
    assert (bench.port.take(), panel.take()) == (SILENT, WRITE_SILENT)


def test_w6_a_request_that_a_late_frame_delays_too_much_is_answered_then() -> None:
    bench = silent()
    bench.wait(40)
    bench.send(OTHER, unit_id=2)  # it could leave after 40 ms
    bench.wait(20)
    assert bench.port.replies == []
    bench.line.stray(bench.now_ns, unit_id=2)  # and now only 80 ms later
    assert bench.port.take() == SILENT


def test_w6_the_answer_to_a_late_request_comes_after_those_to_earlier_requests() -> None:
    bench = silent()
    bench.send(OTHER, unit_id=1, transaction_id=1)
    bench.send(OTHER, unit_id=2, transaction_id=2)
    bench.send(OTHER, unit_id=1, transaction_id=3)
    assert bench.port.replies == []
    bench.line.reply(1, ANSWER, bench.now_ns)
    assert bench.port.replies == [(1, 1, ANSWER), (2, 2, SILENT)]
    assert bench.link.sent == [(1, OTHER)] * 2


def test_w6_the_answer_to_a_late_request_comes_also_while_the_line_is_used_or_rests() -> None:
    bench, panel = silent(), controller("panel")
    bench.send(OTHER, panel, unit_id=1)
    bench.send(OTHER, unit_id=2)
    assert bench.port.take() == SILENT
    bench.line.reply(1, ANSWER, bench.now_ns)
    bench.line.stray(bench.now_ns, unit_id=1)
    assert bench.line.rest.is_draining
    bench.send(OTHER, unit_id=2)
    assert bench.port.take() == SILENT


def test_w6_a_monitor_waits_for_no_gap_for_the_answer_to_a_late_request() -> None:
    bench, hmi = silent(), Port(ControllerPlan("hmi", role=Role.MONITOR, timeout_ms=100.0))
    bench.send(OTHER, hmi, unit_id=2)
    assert hmi.take() == SILENT


# --- what is not answered ----------------------------------------------------------------------------------


def test_m11_a_request_to_another_drive_of_the_group_is_sent() -> None:
    plans = axis_plan(name="x", unit_id=1), axis_plan(name="y", unit_id=2)
    timing = LineTiming(response_timeout_ms=100, drain_ms=80, retry_ms=200)
    bench = Bench(*plans, timing=timing, serial=False, groups=[["x", "y"]])
    bench.port = controller("plc")
    bench.unanswered(OTHER, 100, unit_id=2)
    bench.send(read(ACTUAL), unit_id=1)
    assert bench.link.sent == [(1, read(ACTUAL))]
    bench.serve()
    bench.port.take()
    bench.send(WRITE, unit_id=1)
    bench.wait(80)
    assert bench.link.take() == WRITE


@pytest.mark.parametrize(
    ("options", "unit_id", "pdu", "after_ms"),
    [({}, 1, WRITE, 80), ({"serial": True}, 0, WRITE, 80), ({"tcp_drive": True}, 2, OTHER, 0)],
    ids=["another unit", "a broadcast", "a tcp drive, which owes no silence"],
)
def test_w6_a_request_that_waits_for_no_late_frame_of_its_own_drive_is_sent(
    options: dict[str, Any], unit_id: int, pdu: bytes, after_ms: int
) -> None:
    bench = silent(**options)
    bench.send(pdu, unit_id=unit_id)
    bench.wait(after_ms)
    assert bench.link.sent == [(unit_id, pdu)]


@pytest.mark.parametrize("pdu", [OTHER, WRITE])
def test_w11_a_trial_of_a_dead_drive_is_sent(pdu: bytes) -> None:
    bench = silent(retry_ms=1.0)
    for _ in range(2):
        bench.wait(80)
        bench.missed(OTHER, 100, unit_id=2)
        bench.port.take()
    bench.send(OTHER, unit_id=2)
    assert bench.port.take() == SILENT
    assert (bench.line.counters.backed_off, bench.line.counters.too_late) == (1, 0)
    bench.wait(80)
    bench.send(pdu, unit_id=2)
    assert bench.link.take() == pdu


def test_m3_a_stop_is_sent_immediately_and_waiting_requests_are_judged_again() -> None:
    bench = silent(axis_plan(name="y", unit_id=2, motion=MOTION))
    panel = controller("panel")
    bench.wait(40)
    bench.send(OTHER, panel, unit_id=2)
    bench.send(STOP, unit_id=2)
    assert bench.link.take() == STOP
    bench.wait(100)  # nobody answers it, the silence begins anew: the read could leave 180 ms after it came
    assert panel.take() == SILENT
    assert (bench.link.sent, bench.port.replies) == ([], [])
    bench.wait(80)
    assert bench.link.take() == STOP


def test_m3_a_stop_is_never_answered_as_too_late() -> None:
    bench = silent(axis_plan(name="y", unit_id=2, motion=MOTION), serial=True)
    for _ in range(2):  # early, and once more behind the silence
        bench.send(STOP, unit_id=2)
    assert bench.link.take() == STOP
    assert bench.line.counters.too_late == 0


# --- two in a row ------------------------------------------------------------------------------------------


def test_w6_after_two_answers_to_late_requests_the_next_read_is_sent_late_and_a_write_is_not() -> None:
    bench, panel = silent(), controller("panel")
    spend(bench)
    bench.wait(1)
    bench.send(OTHER, unit_id=2)
    bench.send(WRITE, panel, unit_id=2)
    assert panel.take() == WRITE_SILENT
    assert bench.leaves_after(79) == (2, OTHER)
    assert bench.line.counters.too_late == 3
    bench.wait(100)
    assert bench.line.unit_ids_status(bench.now_ns).drives["2"].timeouts_in_a_row == 2
    bench.port.replies.clear()
    spend(bench)  # in the next silence


def test_w6_answers_to_late_requests_are_counted_by_unit_id_for_all_controllers_together() -> None:
    bench, panel = silent(), controller("panel")
    for port in (bench.port, panel):
        bench.send(OTHER, port, unit_id=2)
        assert port.take() == SILENT
    bench.send(OTHER, unit_id=2)
    bench.wait(80)
    assert bench.link.sent == [(2, OTHER)]


def test_w6_of_two_silent_units_each_has_its_own_count() -> None:
    bench = silent()
    spend(bench)
    bench.send(OTHER, unit_id=3)
    assert bench.link.sent.pop() == (3, OTHER)
    bench.wait(100)  # which ends the silence of unit 2
    bench.port.replies.clear()
    for _ in range(2):
        bench.send(OTHER, unit_id=3)
        assert bench.port.take() == SILENT


def test_w6_writes_alone_are_sent_too_as_soon_as_half_of_their_time_is_left() -> None:
    """A controller that repeats its write as soon as it is answered, for ever."""
    bench = silent()
    answered, waited_ms = 0, 0
    while not bench.link.sent:
        bench.send(WRITE, unit_id=2)
        answered += len(bench.port.replies)
        if not bench.port.replies:
            break
        bench.port.replies.clear()
        bench.wait(1)
        waited_ms += 1
    assert (answered, waited_ms) == (30, 30)  # 80 ms of silence, of which 50 ms may be waited for
    bench.wait(50)
    assert bench.link.sent == [(2, WRITE)]


def test_w6_one_read_is_sent_after_each_silence_if_a_controller_repeats_it_immediately() -> None:
    bench = line(drain_ms=80.0, retry_ms=0.0)
    sent, asked_ms = 0, -100
    for ms in range(995):
        if ms - asked_ms >= 100 or bench.port.replies:
            bench.port.replies.clear()
            bench.send(OTHER, unit_id=2)
            asked_ms = ms
        sent += len(bench.link.sent)
        bench.link.sent.clear()
        bench.wait(1)
    # 100 ms of time-out and 80 ms of silence: it is asked at 0, 180, 360, 540, 720 and 900 ms.
    assert sent == 6
    assert bench.line.counters.too_late == 2 * 5


@pytest.mark.parametrize("drain_ms", [80.0, 250.0])
def test_w6_pipelined_requests_are_answered_in_their_order_and_never_sent_late(drain_ms: float) -> None:
    """Five reads of unit 2 and one of unit 1, all in flight on one connection at 90 ms."""
    bench = line(drain_ms=drain_ms)
    bench.missed(OTHER, 90, unit_id=2)
    for number in range(1, 6):
        bench.send(OTHER, unit_id=2, transaction_id=number)
    bench.send(OTHER, unit_id=1, transaction_id=6)
    bench.wait(10)
    assert [number for number, _, _ in bench.port.replies] == [7, 1, 2]
    assert bench.link.sent == []  # the third one waits, and what is behind it
    bench.wait(80)
    if drain_ms == 80:
        assert bench.link.sent == [(2, OTHER)]  # 90 ms after it had come
        return
    assert bench.link.sent == []
    bench.wait(11)  # all are given up
    bench.send(OTHER, unit_id=1, transaction_id=8)
    assert bench.link.sent == [(1, OTHER)]
    assert bench.line.counters.withdrawn == 4


@pytest.mark.parametrize(("drain_ms", "until_ms"), [(80.0, 60), (45.0, 100)])
def test_w7_the_gateway_waits_for_a_late_read_no_longer_than_response_timeout_ms(
    drain_ms: float, until_ms: int
) -> None:
    """The drive may take 60 ms, the controller waits for 100. It gives up on the late read 20 ms after that
    was sent."""
    bench = silent(drain_ms=drain_ms, response_timeout_ms=60.0)
    if drain_ms == 80:
        spend(bench)
    bench.send(OTHER, unit_id=2)
    bench.wait(drain_ms)
    assert bench.link.take() == OTHER
    bench.wait(until_ms - 1)
    assert not bench.line.is_idle
    bench.wait(1)
    assert bench.line.is_idle


def test_w7_the_gateway_waits_for_a_late_read_as_long_as_its_controller() -> None:
    bench = silent(drain_ms=60.0, response_timeout_ms=10.0)
    spend(bench)
    bench.wait(1)
    bench.send(OTHER, unit_id=2)
    bench.wait(59)
    assert bench.link.take() == OTHER
    bench.wait(40)
    assert bench.port.replies == []
    bench.wait(1)
    assert bench.port.take() == SILENT


# --- no effect on the drive's state ------------------------------------------------------------------------


def test_w6_the_answer_to_a_late_request_does_not_change_the_status_of_the_drive() -> None:
    bench = silent()
    before = bench.line.unit_ids_status(bench.now_ns).drives["2"]
    spend(bench)
    assert bench.line.unit_ids_status(bench.now_ns).drives["2"] == before
    assert before.timeouts_in_a_row == bench.line.counters.timeouts == 1


def test_w6_the_answer_to_a_late_request_does_not_prolong_the_silence_of_an_axis() -> None:
    """lost_ms is 1000. A drive with one unanswered request of 0.1 s, and answers of the gateway until 2.9 s,
    was silent for 0.1 s."""
    plan = axis_plan(unit_id=2, referenced=Reference.HOMING, lost_ms=1000.0)
    bench = line(plan, drain_ms=3000.0)
    bench.line.axes[0].declare_referenced()
    for counts in (30_000, 60_000):
        bench.send(write(COMMAND, counts), unit_id=2)
        bench.serve()
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
        bench.wait(1000)
    bench.missed(OTHER, 100, unit_id=2)
    for wait_ms in (1500, 1300):
        bench.wait(wait_ms)
        bench.port.replies.clear()
        bench.send(OTHER, unit_id=2)
        assert bench.port.take() == SILENT
    bench.wait(200)
    bench.send(write(COMMAND, 70_000), unit_id=2)
    bench.serve()
    assert bench.seen[-1] == write(COMMAND, 70_010)
    assert bench.line.axes[0].reference.is_referenced


@pytest.mark.parametrize("serial", [False, True])
def test_m3_a_target_answered_as_too_late_is_lost_and_its_trigger_is_refused(*, serial: bool) -> None:
    bench = silent(staged_plan(unit_id=2), serial=serial)
    bench.send(write(COMMAND, 70_000), unit_id=2)
    assert bench.port.take() == bytes.fromhex("90 0B")
    bench.wait(80)
    bench.send(RUN_PDU, unit_id=2)
    assert bench.link.sent == []
    assert bench.port.take() == WRITE_SILENT
    assert "axis-blocked" in bench.kinds()
    assert bench.ask(write(COMMAND, 70_000), unit_id=2) == write(COMMAND, 70_000)[:5]
    assert bench.ask(RUN_PDU, unit_id=2) == RUN_PDU


def test_m3_a_trigger_answered_as_too_late_does_not_run_later() -> None:
    bench = silent(staged_plan(unit_id=2))
    bench.send(RUN_PDU, unit_id=2)
    assert bench.port.take() == WRITE_SILENT
    bench.wait(1000)
    assert bench.link.sent == []


# --- how a request could still be late ---------------------------------------------------------------------


@pytest.mark.parametrize(("pdu", "is_sent"), [(OTHER, True), (WRITE, False)])
def test_w6_no_write_is_sent_too_late_after_a_standstill_of_the_process(pdu: bytes, *, is_sent: bool) -> None:
    """It could be sent at 80 ms, 40 ms after it came; the process continues 60 ms after it came."""
    bench = silent()
    bench.wait(40)
    bench.send(pdu, unit_id=2)
    bench.wait(60)
    assert bool(bench.link.sent) is is_sent
    assert bool(bench.port.replies) is not is_sent


def test_w6_no_write_is_sent_too_late_after_an_exchange_with_another_unit() -> None:
    bench, panel = silent(), controller("panel")
    bench.wait(40)
    bench.send(WRITE, unit_id=2)
    bench.wait(30)
    bench.send(OTHER, panel, unit_id=1)
    bench.link.sent.clear()
    bench.wait(50)
    bench.line.reply(1, ANSWER, bench.now_ns)
    assert bench.port.take() == WRITE_SILENT
    bench.wait(100)
    assert bench.link.sent == []


def test_w5_a_given_up_write_that_waited_for_the_silence_of_another_unit_delays_nothing() -> None:
    """A write of unit 1 waits for 1000 ms of silence of unit 2; its controller waits for 100 ms."""
    bench = silent(drain_ms=1000.0)
    bench.send(WRITE, unit_id=1, transaction_id=1)
    bench.wait(90)
    bench.send(OTHER, unit_id=1, transaction_id=2)
    assert bench.link.sent == []
    assert bench.line.deadline_ns == bench.now_ns + 10 * MS + 1
    bench.wait(11)
    assert bench.link.sent == [(1, OTHER)]
    assert bench.line.counters.withdrawn == 1


@pytest.mark.parametrize("takes_ms", [1200, 1900])
def test_w6_a_drive_that_answers_after_its_time_out_is_never_one_reading_behind(takes_ms: int) -> None:
    """It answers each read of register N with N, in its order, and the link frames what fits. Time-outs of
    1000 ms; its controller asks again at once."""
    bench = Bench(timing=LineTiming(), serial=False)
    bench.port = controller("plc", timeout_ms=1000.0)
    coming: list[tuple[int, int]] = []
    heard: list[tuple[int, bytes]] = []
    number, asked_ms = 0, -10_000
    for ms in range(30_000):
        while bench.link.sent:
            _, pdu = bench.link.sent.pop(0)
            coming.append((ms + takes_ms, pdu[2]))
        if coming and coming[0][0] <= ms:
            _, value = coming.pop(0)
            if bench.line.is_idle:
                bench.line.stray(bench.now_ns, unit_id=2)
            else:
                bench.line.reply(2, bytes((3, 2, 0, value)), bench.now_ns)
        if bench.port.replies or ms - asked_ms >= 1000:
            heard += [(asked, pdu) for asked, _, pdu in bench.port.replies]
            bench.port.replies.clear()
            number, asked_ms = (number + 1) % 250, ms
            bench.send(bytes((3, 0, number, 0, 1)), unit_id=2, transaction_id=number)
        bench.wait(1)
    wrong = [(asked, pdu) for asked, pdu in heard if pdu[0] == 3 and pdu[3] != asked]
    assert wrong == []
    assert len(heard) > 10
