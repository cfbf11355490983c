"""References of all four kinds, lost and regained (M9), and axes that carry one beam together (M11)."""

from dataclasses import replace

import pytest

from gateway.drives.motion import Action, MotionPlan, Operation, TriggerPlan
from gateway.exchange.commands import SetReference
from gateway.exchange.control import ControlError, switch
from gateway.exchange.plan import ControllerPlan, Reference, Role
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from tests.exchange import test_registers as starting
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, Port, axis_plan, read, write
from tests.exchange.staged_bench import (
    BITS,
    DONE_BIT,
    HOME_PDU,
    RUN_PDU,
    STATUS,
    STOP_PDU,
    ZERO_PDU,
    StagedBench,
    staged_plan,
    sticky,
)


def is_corrected(bench: StagedBench, counts: int = 20_000) -> bool:
    """Move to a position; return whether the drive got another one."""
    bench.go_to(counts)
    told = bench.drive.moves[-1][1]
    assert told in (counts, counts + 10, counts - 10)
    return told != counts


def home(bench: StagedBench) -> None:
    bench.trigger(HOME_PDU)
    bench.drive.set_bits(is_done=False, is_homed=False)
    bench.poll()
    bench.drive.put(ACTUAL, 0)
    bench.drive.set_bits(is_done=True)
    bench.wait(2000)
    bench.poll()


@pytest.mark.parametrize("reference", [Reference.HOMING, Reference.SET_POSITION])
def test_m9_positions_of_an_unreferenced_axis_pass_unchanged_in_both_directions(reference: Reference) -> None:
    bench = StagedBench(staged_plan(referenced=reference))
    assert not is_corrected(bench)
    assert bench.actual() == 20_000


def test_a16_without_a_homed_bit_the_done_bit_ends_a_homing() -> None:
    bits = {name: bit for name, bit in BITS.items() if name != "homed"}
    bench = StagedBench(staged_plan(referenced=Reference.HOMING, bits=bits))
    home(bench)
    assert is_corrected(bench)


@pytest.mark.parametrize(("after_ms", "counts"), [(150, False), (990, False), (1_010, True)])
def test_a16_a_done_bit_that_never_fell_ends_a_homing_after_done_drop_ms(after_ms: int, counts: bool) -> None:
    """The drive may begin late, and its done bit may be that of the move before."""
    bits = {name: bit for name, bit in BITS.items() if name != "homed"}
    bench = StagedBench(staged_plan(referenced=Reference.HOMING, bits=bits, done_drop_ms=1_000.0))
    bench.trigger(HOME_PDU)
    bench.drive.set_bits(is_done=True)
    bench.wait(after_ms)
    bench.poll()
    assert ("axis-referenced" in bench.kinds()) is counts


def test_a16_the_bit_of_the_homing_before_does_not_count() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.HOMING))
    bench.trigger(HOME_PDU)
    bench.drive.set_bits(is_done=True)  # still from before
    bench.poll()
    assert "axis-referenced" not in bench.kinds()


def test_a16_a_position_set_at_rest_makes_a_reference() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.SET_POSITION))
    bench.poll()
    bench.trigger(ZERO_PDU)
    assert "axis-referenced" in bench.kinds()
    assert is_corrected(bench)


def test_a16_a_position_set_while_the_axis_moves_makes_none() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.SET_POSITION))
    bench.drive.set_bits(is_done=False)
    bench.poll()
    bench.trigger(ZERO_PDU)
    assert "axis-referenced" not in bench.kinds()


def test_m9_a_position_set_at_rest_is_read_back_as_it_was_set() -> None:
    """The axis stopped while the branch before still faded out of its readings."""
    bench = StagedBench(staged_plan(referenced=Reference.SET_POSITION))
    bench.trigger(ZERO_PDU)
    bench.go_to(10_000)
    bench.run(-20_000)
    bench.drive.put(ACTUAL, -5_000)
    assert bench.actual() == -5_000  # half of 20 counts is left of the way forward
    bench.trigger(STOP_PDU)
    bench.poll()
    bench.trigger(ZERO_PDU)
    assert bench.drive.get(ACTUAL) == 0
    assert bench.actual() == 0
    assert bench.run(10_000) == ("absolute", 10_010)
    assert bench.actual() == 0
    bench.drive.put(ACTUAL, 5_005)
    assert bench.actual() == 5_000
    bench.settle()
    assert bench.actual() == 10_000


def test_m9_a_frame_that_sets_the_position_and_reads_it_reads_what_was_set() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.SET_POSITION))
    bench.trigger(ZERO_PDU)
    bench.go_to(10_000)
    assert bench.actual() == 10_000
    reply = bench.ask(bytes.fromhex("17 0520 0002 050E 0001 02 0065"))
    assert bench.drive.get(ACTUAL) == 0
    assert ACTUAL.unpack(reply[2:]) == 0


@pytest.mark.parametrize("reference", [Reference.ABSOLUTE, Reference.HOMING])
def test_a16_a_position_set_ends_the_other_references(reference: Reference) -> None:
    bench = StagedBench(staged_plan(referenced=reference))
    home(bench)
    assert is_corrected(bench)
    bench.trigger(ZERO_PDU)
    assert "reference-lost" in bench.kinds()
    assert not is_corrected(bench)


def test_a16_a_person_may_declare_an_absolute_axis_referenced_again() -> None:
    bench = StagedBench()
    bench.trigger(ZERO_PDU)
    assert not is_corrected(bench)
    assert bench.line.command(SetReference(axis="x"), bench.now_ns) == {"x": ""}
    assert is_corrected(bench, 30_000)


def test_a_person_may_not_declare_a_reference_that_the_homed_bit_decides() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.DRIVE_BIT))
    with pytest.raises(ControlError, match="home the drive"):
        bench.line.command(SetReference(axis="x"), bench.now_ns)
    with pytest.raises(ControlError, match="there is no axis q here; there are x"):
        bench.line.command(SetReference(axis="q"), bench.now_ns)


def silence(bench: StagedBench, ms: float) -> None:
    """Let the drive answer nothing for a while, under polls of the controller."""
    for _ in range(int(ms / 1000) + 1):
        bench.missed(read(ACTUAL), 1000)
        bench.wait(1000)  # drained
    bench.wait(10_000)  # and tried again
    bench.port.replies.clear()


@pytest.mark.parametrize("reference", [Reference.HOMING, Reference.SET_POSITION])
def test_a15_a_drive_that_was_silent_for_long_has_lost_its_reference(reference: Reference) -> None:
    bench = StagedBench(staged_plan(referenced=reference))
    if reference is Reference.HOMING:
        home(bench)
    else:
        bench.trigger(ZERO_PDU)
    assert is_corrected(bench)
    silence(bench, 3000)
    bench.stage(30_000)
    assert bench.drive.get(COMMAND) == 30_000
    assert "reference-lost" in bench.kinds()


def test_a15_an_absolute_encoder_keeps_its_reference_over_a_silence() -> None:
    bench = StagedBench()
    assert is_corrected(bench)
    silence(bench, 3000)
    assert is_corrected(bench, 30_000)


def test_a16_an_alarm_ends_a_reference_by_homing() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.HOMING))
    home(bench)
    assert is_corrected(bench)
    bench.drive.set_bits(is_done=True, is_alarmed=True)
    bench.poll()
    assert "reference-lost" in bench.kinds()


def test_a16_homing_seen_and_its_end_make_a_reference_that_a_jump_of_a_standing_axis_ends() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.HOMING))
    home(bench)
    assert "axis-referenced" in bench.kinds()
    assert is_corrected(bench)
    assert bench.actual() == 20_000
    bench.drive.put(ACTUAL, 0)  # 20 mm in 2 ms
    bench.ask(read(ACTUAL))
    assert "reference-lost" in bench.kinds()


def test_a15_after_a_drive_was_switched_off_its_modes_are_read_again() -> None:
    bench = StagedBench()
    bench.go_to(20_000)
    bench.line.link_down(bench.now_ns)
    bench.link.sent.clear()
    bench.wait(2000)
    bench.line.link_up(bench.now_ns)
    bench.serve()
    assert bench.refused(RUN_PDU) == 4  # what it holds now, nobody knows


# --- groups -----------------------------------------------------------------------------------------------


def gantry(**changes: object) -> StagedBench:
    plans = [staged_plan(name=name, unit_id=unit, **changes) for name, unit in (("y1", 1), ("y2", 2))]
    return StagedBench(*plans, groups=[["y1", "y2"]])


def test_m11_a_target_refused_for_one_refuses_the_triggers_of_all() -> None:
    bench = gantry()
    for unit_id in (1, 2):
        bench.ask(write(COMMAND, 50_000), unit_id=unit_id)
    bench.send(write(COMMAND, 60_000), unit_id=2)
    bench.link.take()
    bench.line.reply(2, bytes.fromhex("90 04"), bench.now_ns)
    bench.port.take()
    assert bench.ask(RUN_PDU, unit_id=1) == bytes.fromhex("86 04")
    assert bench.ask(RUN_PDU, unit_id=2) == bytes.fromhex("86 04")
    assert bench.ask(STOP_PDU, unit_id=1) == STOP_PDU
    bench.ask(write(COMMAND, 50_000), unit_id=2)
    assert bench.ask(RUN_PDU, unit_id=1) == RUN_PDU


def test_m11_no_axis_is_compensated_while_one_is_not_referenced() -> None:
    bench = gantry(referenced=Reference.HOMING)
    bench.ask(HOME_PDU, unit_id=1)
    bench.wait(500)
    bench.ask(bytes.fromhex("03 005C 0001"), unit_id=1)
    bench.ask(write(COMMAND, 50_000), unit_id=1)
    assert bench.drive.get(COMMAND) == 50_000
    bench.ask(HOME_PDU, unit_id=2)
    bench.wait(500)
    bench.ask(bytes.fromhex("03 005C 0001"), unit_id=2)
    assert bench.kinds().count("axis-referenced") == 2
    bench.drive.set_bits(is_done=True)
    bench.ask(write(COMMAND, 60_000), unit_id=1)
    bench.ask(RUN_PDU, unit_id=1)
    assert bench.drive.get(COMMAND) == 60_010


def test_m11_disabling_one_axis_disables_all() -> None:
    bench = gantry()
    assert set(switch(bench.line.axes, "y2", is_on=False)) == {"y1", "y2"}
    bench.ask(write(COMMAND, 50_000), unit_id=1)
    bench.ask(RUN_PDU, unit_id=1)
    assert bench.drive.get(COMMAND) == 50_000


# --- who may stop -----------------------------------------------------------------------------------------


def test_a20_an_operator_may_read_and_stop_and_nothing_else() -> None:
    bench = StagedBench()
    panel = Port(ControllerPlan("panel", role=Role.OPERATOR))
    for pdu, function in ((STOP_PDU, 0x06), (read(ACTUAL), 0x03), (write(COMMAND, 1), 0x90), (RUN_PDU, 0x86)):
        assert bench.ask(pdu, panel)[0] == function
    assert [kind for kind, _ in bench.drive.moves] == ["stop"]


def test_a20_a_monitor_may_not_even_stop() -> None:
    bench = StagedBench()
    hmi = Port(ControllerPlan("hmi", role=Role.MONITOR))
    bench.send(STOP_PDU, hmi)
    assert hmi.take() == bytes.fromhex("86 01")
    assert bench.drive.moves == []


def test_a16_the_end_of_a_homing_that_no_controller_polls_is_read_before_the_next_target() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.HOMING))
    bench.trigger(HOME_PDU)
    bench.drive.set_bits(is_done=False, is_homed=False)
    bench.stage(30_000)
    assert bench.drive.get(COMMAND) == 30_000  # still homing
    bench.drive.put(ACTUAL, 0)
    bench.drive.set_bits(is_done=True)
    bench.wait(500)
    assert bench.run(20_000) == ("absolute", 20_010)


HOMING_DONE_BIT = 12
MODE_WRITE = bytes.fromhex("06 0700 0001")


def homing_402() -> StagedBench:
    """A drive whose bit 12 says that homing has succeeded, while its mode is homing; its done bit is set."""
    bits = {**BITS, "homing_done": BitField(STATUS, HOMING_DONE_BIT)}
    del bits["homed"]
    bench = StagedBench(staged_plan(motion=sticky(), referenced=Reference.HOMING, bits=bits))
    bench.drive.words[STATUS] = 1 << DONE_BIT
    bench.ask(MODE_WRITE)
    bench.ask(HOME_PDU)
    return bench


def test_a_homing_that_never_began_or_failed_makes_no_reference() -> None:
    """Bit 10 set and bit 12 clear: not started, interrupted, or failed."""
    bench = homing_402()
    for _ in range(20):
        bench.wait(200)
        bench.poll()
    bench.ask(MODE_WRITE)
    bench.run(20_000)
    assert bench.drive.get(COMMAND) == 20_000
    assert not bench.line.axes[0].reference.is_referenced


@pytest.mark.parametrize("polls", [True, False], ids=["the controller polls", "the gateway reads"])
def test_a_homing_that_has_succeeded_makes_the_reference(*, polls: bool) -> None:
    """After the mode is another one the bit is clear again, so it is read before that."""
    bench = homing_402()
    bench.drive.put(ACTUAL, 0)
    bench.wait(200)
    bench.drive.words[STATUS] = 1 << DONE_BIT | 1 << HOMING_DONE_BIT
    if polls:
        bench.poll()
    bench.ask(MODE_WRITE)
    bench.drive.words[STATUS] = 1 << DONE_BIT
    assert bench.run(20_000) == ("absolute", 20_010)


def test_a_homing_that_ends_at_once_makes_the_reference() -> None:
    """Methods 35 and 37: here is home. The bit is never seen clear."""
    bench = homing_402()
    bench.drive.put(ACTUAL, 0)
    bench.drive.words[STATUS] = 1 << DONE_BIT | 1 << HOMING_DONE_BIT
    bench.wait(200)
    bench.poll()
    assert bench.line.axes[0].reference.is_referenced


def test_after_another_mode_the_bit_ends_no_homing_that_failed() -> None:
    """In that mode it acknowledges a set-point."""
    bench = homing_402()
    bench.wait(1_500)
    bench.poll()
    bench.ask(MODE_WRITE)
    bench.drive.words[STATUS] = 1 << DONE_BIT | 1 << HOMING_DONE_BIT
    bench.poll()
    assert not bench.line.axes[0].reference.is_referenced


def test_a_bit_that_is_still_that_of_the_motion_before_ends_no_homing() -> None:
    """While the mode is positioning, the same bit acknowledges a set-point."""
    bench = homing_402()
    bench.drive.words[STATUS] = 1 << DONE_BIT | 1 << HOMING_DONE_BIT
    bench.wait(90)
    bench.poll()
    assert not bench.line.axes[0].reference.is_referenced
    bench.wait(20)
    bench.poll()
    assert bench.line.axes[0].reference.is_referenced


# --- sequences that several rules have a part in ---------------------------------------------------------


def test_m9_a_corrected_staged_target_is_written_again_1_to_1_after_the_reference_is_lost() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.DRIVE_BIT))
    bench.go_to(20_000)
    bench.stage(50_000)
    bench.drive.set_bits(is_done=True, is_homed=False)
    bench.poll()
    assert bench.trigger() == ("absolute", 50_000)


def test_m9_a_staged_target_is_written_again_1_to_1_after_a_homing_began() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.DRIVE_BIT))
    bench.go_to(20_000)
    bench.run(50_000, HOME_PDU)
    bench.drive.set_bits(is_done=True, is_homed=False)
    assert bench.trigger() == ("absolute", 50_000)


ONE_FRAME = bytes.fromhex("10 050C 0003 06 C350 0000 0001")


WIDE = PositionField(0x050C, RegisterType.INT32, WordOrder.LOW_FIRST)


def lose(bench: StagedBench, unit_id: int, pdu: bytes) -> None:
    bench.send(pdu, unit_id=unit_id)
    while bench.link.sent[0][1][0] == 3:
        bench.serve_reads()
    bench.link.take()
    bench.line.reply(unit_id, bytes((pdu[0] | 0x80, 4)), bench.now_ns)
    bench.port.take()


def test_m11_a_frame_of_target_and_trigger_is_refused_while_the_other_axis_has_lost_its_target() -> None:
    bench = gantry(command=(WIDE,))
    lose(bench, 1, ONE_FRAME)
    assert bench.ask(ONE_FRAME, unit_id=2) == bytes.fromhex("90 04")
    assert bench.drive.moves == []
    for unit_id in (1, 2):  # given again, both run: the one refused for the other's sake holds up nobody
        assert bench.ask(ONE_FRAME, unit_id=unit_id) == ONE_FRAME[:5]


def test_m11_a_mover_is_refused_too_while_the_other_axis_has_lost_its_target() -> None:
    plans = [axis_plan(name=name, unit_id=unit) for name, unit in (("y1", 1), ("y2", 2))]
    bench = StagedBench(*plans, groups=[["y1", "y2"]])
    lose(bench, 1, write(COMMAND, 50_000))
    assert bench.ask(write(COMMAND, 50_000), unit_id=2) == bytes.fromhex("90 04")
    assert bench.ask(write(COMMAND, 50_000), unit_id=1)[0] == 0x10
    assert bench.ask(write(COMMAND, 50_000), unit_id=2)[0] == 0x10


def test_a16_a_position_set_on_a_drive_without_triggers_is_noticed() -> None:
    bench = Bench(axis_plan(settable=frozenset({0})))
    bench.move(50_000)
    bench.ask(write(ACTUAL, 0))
    assert "reference-lost" in bench.kinds()


def test_a16_a_homing_that_was_stopped_or_refused_makes_no_reference() -> None:
    bits = {name: bit for name, bit in BITS.items() if name != "homed"}
    for pdus in ((HOME_PDU, STOP_PDU), (None,)):
        bench = StagedBench(staged_plan(referenced=Reference.HOMING, bits=bits))
        for pdu in pdus:
            if pdu is None:
                lose(bench, 1, HOME_PDU)
            else:
                bench.trigger(pdu)
        bench.drive.set_bits(is_done=True)
        bench.wait(500)
        bench.poll()
        assert "axis-referenced" not in bench.kinds()


def test_m9_an_axis_that_passes_1_to_1_is_never_blocked() -> None:
    bench = StagedBench(staged_plan(table=None), serial=False)
    bench.unanswered(write(COMMAND, 50_000), 1000, 1000)
    bench.trigger()
    assert bench.ask(bytes.fromhex("06 0606 1234")) == bytes.fromhex("06 0606 1234")


def test_m9_a_target_lost_while_positions_passed_1_to_1_blocks_the_axis_once_it_is_corrected() -> None:
    bench = StagedBench(staged_plan(referenced=Reference.DRIVE_BIT), serial=False)
    bench.drive.set_bits(is_homed=False, is_done=True)
    bench.poll()
    bench.unanswered(write(COMMAND, 50_000), 1000, 1000)
    [told] = [each.detail for each in bench.events if each.kind.name == "axis-blocked"]
    assert told.endswith("; while its positions pass 1:1, its triggers pass")
    bench.trigger()
    bench.drive.set_bits(is_homed=True, is_done=True)
    bench.poll()
    assert bench.ask(RUN_PDU) == bytes.fromhex("86 0b")
    bench.drive.set_bits(is_homed=False, is_done=True)
    bench.poll()
    bench.trigger()


def test_m11_a_target_refused_at_its_trigger_blocks_the_other_axis_too() -> None:
    bench = gantry(travel=(0.0, 100.0))
    for unit_id, counts in ((1, 350_000), (2, 60_000)):
        bench.ask(write(COMMAND, counts), unit_id=unit_id)
    assert bench.ask(RUN_PDU, unit_id=1) == bytes.fromhex("86 04")
    assert bench.ask(RUN_PDU, unit_id=2) == bytes.fromhex("86 04")
    assert bench.drive.moves == []


def test_a_target_whose_word_was_replaced_is_rendered_again_after_a_lost_reference() -> None:
    """M4, M9: 65530 was sent as 65540 = 0x0001_0004. After its high word is written alone, the drive holds
    0x0000_0004 for 0x0000_FFFA. The homed bit falls and rises, and the whole target comes again: 65540,
    because the axis is there."""
    plan = axis_plan(
        command=(starting.TARGET,),
        actual=(starting.HIGH_FIRST_ACTUAL,),
        motion=starting.ON_LOW_WORD,
        bits={"homed": BitField(0x9005, 4)},
        referenced=Reference.DRIVE_BIT,
    )
    bench = Bench(plan, serial=False)
    status = bytes.fromhex("03 9005 0001")
    for word, requests in (
        (16, [write(starting.TARGET, 1000), write(starting.TARGET, 65_530)]),
        (16, [status, bytes.fromhex("06 9900 0000")]),
        (0, [status]),
        (16, [status]),
    ):
        bench.memory.words[0x9005] = word
        for request in requests:
            bench.ask(request)
            if request[0] == 16:
                bench.memory.put(starting.HIGH_FIRST_ACTUAL, bench.memory.get(starting.TARGET))
                bench.wait(1000)
                bench.ask(read(starting.HIGH_FIRST_ACTUAL))
    assert bench.sent_for(write(starting.TARGET, 65_530)) == write(starting.TARGET, 65_540)


CONTROL_WORD = 0x3100


BY_BITS = MotionPlan(
    is_staged=True,
    triggers=(
        TriggerPlan(CONTROL_WORD, mask=0x0050, rising=0x10, deeds={0x10: Operation(Action.START)}),
        TriggerPlan(CONTROL_WORD, mask=0x010F, deeds={0x0F: Operation(Action.IGNORE)}, otherwise=Action.STOP),
    ),
)


def test_a_stop_that_moves_the_zero_too_ends_the_reference() -> None:
    """M9: one frame switches the drive off and sets its position to 0."""
    zero = 0x3101
    triggers = (
        *BY_BITS.triggers,
        TriggerPlan(zero, deeds={1: Operation(Action.SET_POSITION)}, otherwise=Action.IGNORE),
    )
    bench = Bench(axis_plan(motion=replace(BY_BITS, triggers=triggers)), serial=False, tcp_drive=True)
    bench.ask(bytes.fromhex("10 3100 0002 04 000F 0000"))
    assert bench.line.axes[0].reference.is_referenced
    frame = bytes.fromhex("10 3100 0002 04 000E 0001")
    assert bench.ask(frame) == frame[:5]
    assert bench.seen[-1] == frame
    assert bench.kinds()[-1] == "reference-lost"
