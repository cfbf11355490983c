"""What readers of the code have found: words that count for a target that they are not, and old readings.

The table adds 10 counts to a position that is come to forward and takes 10 away backward.
"""

from dataclasses import replace

import pytest

from gateway.drives.motion import Action, Deed, ModePlan, MotionPlan, TriggerPlan
from gateway.exchange.plan import ControllerPlan, Reference
from gateway.exchange.status import direction_state
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from tests.exchange import test_hazard_starting_words as starting
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Memory, Port, axis_plan, read, write
from tests.exchange.staged_bench import (
    COMMANDED,
    DEEDS,
    DONE_BIT,
    JOG_PDU,
    MODE,
    RUN_PDU,
    RUN_RELATIVE_PDU,
    STATUS,
    STOP,
    STOP_PDU,
    TRIGGER,
    StagedBench,
    staged_plan,
)

IGNORES = MotionPlan(modes=(ModePlan(MODE, actions={1: Action.ABSOLUTE}, otherwise=Action.IGNORE),))
OTHER = PositionField(0x0700, RegisterType.INT32, WordOrder.LOW_FIRST)
OTHER_TRIGGER = 0x0608


def mode(word: int) -> bytes:
    """FC06 that writes the mode register."""
    return b"\x06" + MODE.to_bytes(2, "big") + word.to_bytes(2, "big")


def test_a_position_that_was_written_where_it_means_nothing_is_no_repeat_afterwards() -> None:
    """M4: in mode 9 the drive keeps 3000 and stands at 10; in mode 1 the same words are a target: 3010."""
    bench = Bench(axis_plan(motion=IGNORES))
    bench.ask(mode(1))
    bench.move(-5000)
    bench.move(0)
    bench.actual()
    bench.ask(mode(9))
    bench.ask(write(COMMAND, 3000))
    assert bench.seen[-1] == write(COMMAND, 3000)
    bench.ask(mode(1))
    bench.ask(write(COMMAND, 3000))
    assert bench.seen[-1] == write(COMMAND, 3010)


def test_a_target_of_which_a_word_was_replaced_is_not_given_again_over_a_lost_reference() -> None:
    """M4, M9: 65530 was told as 65540 = 0x0001_0004. Its high word, written alone, leaves the drive with
    0x0000_0004 for 0x0000_FFFA; the homed bit falls and rises, and the whole target comes again: 65540, for
    the axis stands there."""
    plan = axis_plan(
        command=(starting.TARGET,),
        actual=(starting.ACTUAL,),
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
                bench.memory.put(starting.ACTUAL, bench.memory.get(starting.TARGET))
                bench.wait(1000)
                bench.ask(read(starting.ACTUAL))
    bench.ask(write(starting.TARGET, 65_530))
    assert bench.seen[-1] == write(starting.TARGET, 65_540)


def two_on_a_unit() -> StagedBench:
    """Two staged axes with one unit id; x stands at 80 000, where it was jogged, and 50 000 is staged."""
    y = replace(
        staged_plan(),
        name="y",
        command=(OTHER,),
        actual=(PositionField(0x0720, RegisterType.INT32, WordOrder.LOW_FIRST),),
        commanded=(),
        motion=MotionPlan(is_staged=True, triggers=(TriggerPlan(OTHER_TRIGGER, deeds=DEEDS),)),
        bits={},
    )
    bench = StagedBench(staged_plan(), y, serial=False)
    for counts in (-5000, 20_000):
        bench.stage(counts)
        bench.trigger()
        bench.wait(100)
        bench.drive.arrive()
        bench.wait(1200)
        bench.actual()
    bench.stage(50_000)
    bench.ask(JOG_PDU)
    for place in (ACTUAL, COMMANDED):
        bench.drive.put(place, 80_000)
    bench.drive.set_bits(is_done=True)
    bench.wait(2000)
    bench.actual()
    return bench


def test_a_stop_whose_frame_has_a_newer_target_of_another_axis_withdraws_the_trigger_of_the_older_one() -> (
    None
):
    """M2, M3: the trigger of 50 000 has its target on the wire, 49 990 for it comes backward, when a frame
    with 70 000 and a stop of y comes. The trigger is refused, and the next one runs 70 000: 69 990."""
    bench = two_on_a_unit()
    bench.seen.clear()
    bench.send(RUN_PDU, transaction_id=1)
    newer = bytes.fromhex("10 0606 0003 06") + COMMAND.pack(70_000) + STOP.to_bytes(2, "big")
    is_first = True
    while bench.link.sent:
        unit_id, pdu = bench.link.sent.pop(0)
        bench.seen.append(pdu)
        if is_first:
            bench.send(newer, transaction_id=2)
            is_first = False
        bench.now_ns += MS
        bench.line.reply(unit_id, bench.memory.answer(pdu), bench.now_ns)
    assert [pdu[:6].hex() for pdu in bench.seen if pdu[0] == 16] == ["100606000204", "100606000306"]
    assert bench.seen.count(RUN_PDU) == 0
    assert [(number, pdu.hex()) for number, _, pdu in bench.port.replies] == [(1, "8606"), (2, "1006060003")]
    bench.port.replies.clear()
    bench.trigger()
    assert bench.drive.moves[-1] == ("absolute", 69_990)


def test_what_was_read_for_a_target_before_a_stop_went_first_is_read_again() -> None:
    """M6: x goes to 100 000 and is read at 50 000 for 60 000. A stop of y takes its turn and 240 ms; by then
    x is at 98 000, so 60 000 is backward: 59 990."""
    y = replace(staged_plan(), name="y", unit_id=2)
    bench = Bench(axis_plan(max_speed=200.0), y, serial=False)
    bench.move(-5000)
    bench.move(0)
    bench.wait(100)
    bench.actual()
    bench.ask(write(COMMAND, 100_000))
    bench.wait(250)
    bench.memory.put(ACTUAL, 50_000)
    bench.send(write(COMMAND, 60_000))
    bench.line.request(Port(ControllerPlan("pendant")), 9, 2, STOP_PDU, bench.now_ns)
    unit_id, pdu = bench.link.sent.pop(0)
    assert pdu == read(ACTUAL)
    bench.line.reply(unit_id, bench.memory.answer(pdu), bench.now_ns)
    unit_id, pdu = bench.link.sent.pop(0)
    assert (unit_id, pdu) == (2, STOP_PDU)
    bench.now_ns += 240 * MS
    bench.memory.put(ACTUAL, 98_000)
    bench.line.reply(unit_id, pdu, bench.now_ns)
    bench.serve()
    assert bench.seen[-1] == write(COMMAND, 59_990)


FOLLOW = 0xFFFB
FOLLOWING_DEEDS = {
    1: Deed(Action.START),
    5: Deed(Action.STOP),
    0: Deed(Action.IGNORE),
    FOLLOW: Deed(Action.FOLLOW_NEXT),
}
FOLLOWING = MotionPlan(
    is_staged=True,
    modes=(ModePlan(MODE, actions={1: Action.ABSOLUTE, 2: Action.RELATIVE_TO_COMMANDED}),),
    triggers=(TriggerPlan(TRIGGER, deeds=FOLLOWING_DEEDS),),
)


class FollowingDrive(Memory):
    """Runs what its command register holds by the trigger 1, or as it is written while that says FOLLOW."""

    def __init__(self) -> None:
        super().__init__()
        self.ends: list[float] = []
        self.words[STATUS] = 1 << DONE_BIT

    def write(self, address: int, data: bytes) -> None:
        super().write(address, data)
        is_position = address <= COMMAND.address < address + len(data) // 2
        if (is_position and self.words.get(TRIGGER) == FOLLOW) or (
            address == TRIGGER and self.words[TRIGGER] == 1
        ):
            start = self.get(COMMANDED) if self.words.get(MODE) == 2 else 0
            self.ends.append(start + self.get(COMMAND))
            for place in (COMMANDED, ACTUAL):
                self.put(place, self.ends[-1])


def trigger(word: int) -> bytes:
    """FC06 that writes the trigger register."""
    return b"\x06" + TRIGGER.to_bytes(2, "big") + word.to_bytes(2, "big")


def following_bench() -> Bench:
    """An axis at 3000 (3010 on the drive), after a distance of 1000 that its drive followed from 2000."""
    bits = {"done": BitField(STATUS, DONE_BIT)}
    plan = axis_plan(motion=FOLLOWING, bits=bits, commanded=(COMMANDED,))
    bench = Bench(plan, memory=FollowingDrive(), serial=False)
    bench.ask(mode(1))
    for pdu in (write(COMMAND, 5000), trigger(1), write(COMMAND, 2000), trigger(1)):
        bench.ask(pdu)
        bench.wait(1200)
        bench.ask(bytes.fromhex("03 005C 0001"))
        bench.actual()
    for pdu in (mode(2), trigger(FOLLOW), write(COMMAND, 1000)):
        bench.ask(pdu)
    bench.wait(1200)
    bench.ask(bytes.fromhex("03 005C 0001"))
    assert bench.actual() == 3000
    bench.seen.clear()
    return bench


@pytest.mark.parametrize("word", [1, 0xFFFC])
def test_no_target_is_written_anew_while_the_drive_goes_to_what_is_written(word: int) -> None:
    """M2: +1000 went out as +1020, from 1990 to 3010. Written anew for the trigger, as 1000 in the same
    direction, it would move the drive at once, and the trigger once more. 0xFFFC means what nobody knows."""
    bench = following_bench()
    assert isinstance(bench.memory, FollowingDrive)
    assert bench.memory.ends == [5010, 1990, 3010]
    assert bench.ask(trigger(word)) == bytes.fromhex("86 04")
    assert not [pdu for pdu in bench.seen if pdu[0] in (6, 16)]
    assert bench.memory.ends == [5010, 1990, 3010]


TWO_PATHS = MotionPlan(
    is_staged=True,
    triggers=(
        TriggerPlan(
            TRIGGER,
            deeds={1: Deed(Action.ABSOLUTE, 0), 2: Deed(Action.ABSOLUTE, 1), 0: Deed(Action.IGNORE)},
        ),
    ),
    passes_stored_moves=True,
)


def test_a_lost_target_of_one_path_does_not_run_once_another_path_has_a_new_one() -> None:
    """M3: path 2 holds 1000 (1010), 0x7FFFFFFF for it is refused. A target for path 1 ends the block of the
    axis; path 2 still holds what nobody means, also where stored moves may pass."""
    plan = staged_plan(command=(COMMAND, OTHER), motion=TWO_PATHS, bits={"done": BitField(STATUS, DONE_BIT)})
    bench = Bench(plan, serial=False)
    bench.memory.words[STATUS] = 1 << DONE_BIT
    for place, path in ((COMMAND, 1), (OTHER, 2), (COMMAND, 1)):
        bench.ask(write(place, 1000 if path == 2 else 0))
        bench.ask(trigger(path))
        bench.memory.put(ACTUAL, bench.memory.get(place))
        bench.wait(1200)
        bench.ask(bytes.fromhex("03 005C 0001"))
        bench.actual()
    assert bench.memory.get(OTHER) == 1010
    assert bench.ask(bytes.fromhex("10 0700 0002 04 FFFF 7FFF")) == bytes.fromhex("90 04")
    assert bench.ask(write(COMMAND, 600)) == bytes.fromhex("10 0606 0002")
    bench.seen.clear()
    assert bench.ask(trigger(2)) == bytes.fromhex("86 04")
    assert bench.seen == []


CONTROL = 0x3100
BY_BITS = MotionPlan(
    is_staged=True,
    triggers=(
        TriggerPlan(CONTROL, mask=0x0050, rising=0x10, deeds={0x10: Deed(Action.START)}),
        TriggerPlan(CONTROL, mask=0x010F, deeds={0x0F: Deed(Action.IGNORE)}, otherwise=Action.STOP),
    ),
)


def test_a_mask_that_clears_the_enable_bit_stops_whatever_the_other_bits_are() -> None:
    """M3: the control word is not known after a write that timed out, and the axis is blocked. AND 0xFFFE
    leaves bit 0 clear: no such word means anything but a stop."""
    bench = Bench(axis_plan(motion=BY_BITS), serial=False, tcp_drive=True)
    control = b"\x06" + CONTROL.to_bytes(2, "big")
    bench.ask(control + b"\x00\x0f")
    for lost in (write(COMMAND, 5000), control + b"\x00\x0f"):
        bench.send(lost)
        bench.link.sent.clear()
        bench.wait(1001)
        bench.port.replies.clear()
    bench.seen.clear()
    stop = bytes.fromhex("16 3100 FFFE 0000")
    assert bench.ask(stop) == stop
    assert bench.seen == [stop]


def test_a_stop_that_moves_the_zero_too_ends_the_reference() -> None:
    """M9: one frame switches the drive off and tells it that it stands at 0."""
    zero = 0x3101
    triggers = (
        *BY_BITS.triggers,
        TriggerPlan(zero, deeds={1: Deed(Action.SET_POSITION)}, otherwise=Action.IGNORE),
    )
    bench = Bench(axis_plan(motion=replace(BY_BITS, triggers=triggers)), serial=False, tcp_drive=True)
    bench.ask(bytes.fromhex("10 3100 0002 04 000F 0000"))
    assert bench.line.axes[0].is_referenced
    frame = bytes.fromhex("10 3100 0002 04 000E 0001")
    assert bench.ask(frame) == frame[:5]
    assert bench.seen[-1] == frame
    assert bench.kinds()[-1] == "reference-lost"


def test_words_that_stood_in_the_register_before_prove_no_target() -> None:
    """M7: 1000 by the other register went out as 1010 long ago; given again it is lost. What is read there is
    what the first one left. 800 from 500 (490) may come from either side: flagged."""
    plan = axis_plan(command=(COMMAND, OTHER), actual=(), bits={"done": BitField(STATUS, DONE_BIT)})
    bench = Bench(plan, serial=False, tcp_drive=True)
    bench.memory.words[STATUS] = 1 << DONE_BIT
    for place, counts in ((COMMAND, 0), (OTHER, 1000), (COMMAND, 500)):
        bench.ask(write(place, counts))
        bench.wait(1200)
        bench.ask(bytes.fromhex("03 005C 0001"))
    bench.send(write(OTHER, 1000))
    assert bench.link.take() == write(OTHER, 1010)
    bench.wait(1001)
    bench.port.replies.clear()
    assert bench.ask(read(OTHER)) == b"\x03\x04" + OTHER.pack(1000)
    bench.wait(1200)
    bench.ask(bytes.fromhex("03 005C 0001"))
    bench.ask(write(COMMAND, 800))
    assert direction_state(bench.line.axes[0]) == "unsure"


def test_a_distance_from_a_place_whose_branch_nobody_knows_is_flagged() -> None:
    """M5, M6: jogged to 3000 on the drive, which is 2990 or 3010: -1000 is right for one."""
    bench = StagedBench(staged_plan(), serial=False)
    bench.go_to(5000)
    bench.ask(JOG_PDU)
    bench.memory.put(ACTUAL, 3000)
    bench.memory.put(COMMANDED, 3000)
    bench.drive.set_bits(is_done=True)
    bench.wait(1200)
    bench.poll()
    bench.stage(-1000)
    bench.trigger(RUN_RELATIVE_PDU)
    assert direction_state(bench.line.axes[0]) == "unsure"
