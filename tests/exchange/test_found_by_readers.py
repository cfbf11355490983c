"""What readers of the code have found: words that count for a target that they are not, and old readings.

The table adds 10 counts to a position that is come to forward and takes 10 away backward.
"""

from dataclasses import replace

import pytest

from gateway.drives.motion import Action, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import AxisPlan, ControllerPlan, LineTiming, Reference, Role
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
    1: Operation(Action.START),
    5: Operation(Action.STOP),
    0: Operation(Action.IGNORE),
    FOLLOW: Operation(Action.FOLLOW_NEXT),
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
            deeds={
                1: Operation(Action.ABSOLUTE, 0),
                2: Operation(Action.ABSOLUTE, 1),
                0: Operation(Action.IGNORE),
            },
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
        TriggerPlan(CONTROL, mask=0x0050, rising=0x10, deeds={0x10: Operation(Action.START)}),
        TriggerPlan(CONTROL, mask=0x010F, deeds={0x0F: Operation(Action.IGNORE)}, otherwise=Action.STOP),
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
        TriggerPlan(zero, deeds={1: Operation(Action.SET_POSITION)}, otherwise=Action.IGNORE),
    )
    bench = Bench(axis_plan(motion=replace(BY_BITS, triggers=triggers)), serial=False, tcp_drive=True)
    bench.ask(bytes.fromhex("10 3100 0002 04 000F 0000"))
    assert bench.line.axes[0].reference.is_referenced
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


# --- a frame that stops one axis and acts on another one ----------------------------------------------------

NEXT_TRIGGER = TRIGGER + 1
NEXT_ACTUAL = PositionField(0x0720, RegisterType.INT32, WordOrder.LOW_FIRST)
NEXT_STATUS = 0x005D
NEXT_STOP_PDU = bytes.fromhex("06 050F 03E8")
STRANGE = bytes.fromhex("03 0900 0001")


def stop_beside(word: int) -> bytes:
    """FC16 that stops x and writes a word into the trigger of y, the register behind."""
    return bytes.fromhex("10 050E 0002 04 03E8") + word.to_bytes(2, "big")


def next_plan(**changes: object) -> AxisPlan:
    """Return the plan of y, whose trigger is the register behind that of x; 2 runs a distance."""
    deeds = {**DEEDS, 2: Operation(Action.RELATIVE)}
    plan: dict[str, object] = {
        "name": "y",
        "command": (OTHER,),
        "actual": (NEXT_ACTUAL,),
        "commanded": (),
        "motion": MotionPlan(is_staged=True, triggers=(TriggerPlan(NEXT_TRIGGER, deeds=deeds),)),
        "bits": {"done": BitField(NEXT_STATUS, 4)},
    }
    return replace(staged_plan(), **(plan | changes))  # type: ignore[arg-type]


def arrive_next(bench: StagedBench, counts: float | None = None) -> None:
    """Let y come to its target, or to ``counts``, and its controller see it."""
    bench.memory.put(NEXT_ACTUAL, bench.memory.get(OTHER) if counts is None else counts)
    bench.memory.words[NEXT_STATUS] = 16
    bench.wait(1200)
    bench.ask(bytes.fromhex("03 005D 0001"))
    bench.ask(read(NEXT_ACTUAL))


def run_next(bench: StagedBench, *targets: float) -> None:
    """Stage and run targets of y, one after the other."""
    for counts in targets:
        bench.ask(write(OTHER, counts))
        bench.ask(b"\x06" + NEXT_TRIGGER.to_bytes(2, "big") + b"\0\1")
        arrive_next(bench)


def side_by_side(**changes: object) -> StagedBench:
    """Two axes whose triggers lie side by side, on a serial line that is asked over TCP; y stands at 5010."""
    timing = LineTiming(response_timeout_ms=100.0, drain_ms=50.0, retry_ms=200.0)
    bench = StagedBench(staged_plan(), next_plan(**changes), serial=False, timing=timing)
    bench.port = Port(ControllerPlan("cnc", timeout_ms=5000.0))
    run_next(bench, 0, 5000)
    return bench


def owe_silence(bench: StagedBench) -> None:
    """Let a read of another controller time out: its answer may come yet."""
    bench.send(STRANGE, port=Port(ControllerPlan("plc", timeout_ms=100.0)))
    bench.link.sent.clear()
    bench.wait(101)
    bench.seen.clear()


def serve_for(bench: StagedBench, ms: int) -> None:
    """Answer what comes, and let time pass."""
    for _ in range(ms // 10):
        while bench.link.sent:
            unit_id, pdu = bench.link.sent.pop(0)
            bench.seen.append(pdu)
            bench.now_ns += MS
            bench.line.reply(unit_id, bench.memory.answer(pdu), bench.now_ns)
        bench.wait(10)


def test_a_stop_that_runs_a_distance_of_another_axis_leaves_once_after_the_silence() -> None:
    """W5, W6: 1000 of y would run twice if the frame left early and once more."""
    bench = side_by_side()
    bench.ask(write(OTHER, 1000))
    owe_silence(bench)
    bench.send(stop_beside(2))
    assert bench.link.sent == []
    serve_for(bench, 400)
    assert bench.seen == [stop_beside(2)]
    assert [pdu.hex() for _, _, pdu in bench.port.replies] == ["10050e0002"]


def test_a_stop_that_writes_nothing_for_another_axis_leaves_early_and_once_more() -> None:
    """M3, W6: y's trigger gets 0, which does nothing, once or twice; while late frames may come an echo of
    the address alone is no answer."""
    bench = side_by_side()
    owe_silence(bench)
    bench.send(stop_beside(0))
    assert bench.link.sent == [(1, stop_beside(0))]
    serve_for(bench, 400)
    assert bench.seen == [stop_beside(0), stop_beside(0)]


def test_a_stop_that_comes_after_a_run_beside_a_stop_ends_it() -> None:
    """M3: y's own stop goes at once, and once more behind the frame that runs y and waits for the silence."""
    bench = side_by_side()
    bench.ask(write(OTHER, 9000))
    owe_silence(bench)
    bench.send(stop_beside(1), transaction_id=8)
    bench.send(NEXT_STOP_PDU, transaction_id=9)
    serve_for(bench, 600)
    assert bench.seen == [NEXT_STOP_PDU, stop_beside(1), NEXT_STOP_PDU]
    assert [(number, pdu.hex()) for number, _, pdu in bench.port.replies] == [
        (8, "10050e0002"),
        (9, "06050f03e8"),
    ]


def test_stops_on_a_busy_line_keep_their_order_whatever_else_they_do() -> None:
    """M3: a frame that stops x and runs y waits, and a stop of y comes: y is stopped last."""
    bench = side_by_side()
    bench.ask(write(OTHER, 9000))
    bench.seen.clear()
    bench.send(STRANGE, transaction_id=7)
    bench.send(stop_beside(1), transaction_id=8)
    bench.send(NEXT_STOP_PDU, transaction_id=9)
    bench.serve()
    assert bench.seen == [STRANGE, stop_beside(1), NEXT_STOP_PDU]
    assert [number for number, _, _ in bench.port.replies] == [7, 8, 9]


def test_an_operator_sets_no_mode_of_another_axis_beside_a_stop_and_takes_nothing_over() -> None:
    """W10: x's trigger and y's mode register lie side by side. The writer of y goes on: 6000 runs as 6010."""
    modes = (ModePlan(NEXT_TRIGGER, actions={1: Action.ABSOLUTE, 2: Action.RELATIVE}),)
    runs = (TriggerPlan(OTHER_TRIGGER, deeds={1: Operation(Action.START), 0: Operation(Action.IGNORE)}),)
    y = next_plan(motion=MotionPlan(is_staged=True, modes=modes, triggers=runs))
    bench = StagedBench(staged_plan(), y, serial=False)
    run_pdu = bytes.fromhex("06 0608 0001")
    bench.ask(bytes.fromhex("06 050F 0001"))
    for counts in (1000, 5000):
        bench.ask(write(OTHER, counts))
        bench.ask(run_pdu)
        arrive_next(bench)
    bench.wait(6000)
    bench.seen.clear()
    operator = Port(ControllerPlan("panel", role=Role.OPERATOR))
    bench.send(stop_beside(2), port=operator)
    bench.serve()
    assert bench.seen == []
    assert [pdu.hex() for _, _, pdu in operator.replies] == ["9001"]
    bench.ask(write(OTHER, 6000))
    bench.ask(run_pdu)
    assert bench.memory.get(OTHER) == 6010
    assert bench.seen[-1] == run_pdu


def test_an_operator_that_stops_one_axis_and_leaves_the_other_alone_takes_nothing_over() -> None:
    """M3, W10: x is stopped and y's trigger gets 0, while y is held and when it is not any more: its writer
    may run what it wrote."""
    bench = side_by_side()
    bench.ask(write(OTHER, 6000))
    operator = Port(ControllerPlan("panel", role=Role.OPERATOR))
    for wait_ms in (0, 6000):
        bench.wait(wait_ms)
        bench.seen.clear()
        bench.send(stop_beside(0), port=operator)
        bench.serve()
        assert bench.seen == [stop_beside(0)]
    bench.ask(bytes.fromhex("06 050F 0001"))
    assert bench.memory.get(OTHER) == 6010
    assert bench.seen[-1] == bytes.fromhex("06 050F 0001")


def test_a_target_that_runs_beside_a_stop_with_words_that_are_not_right_is_flagged() -> None:
    """M2, M3: 7000 of y was staged as 7010 on its way from 5000 to 10 000. From there it is 6990, but a stop
    waits for no other frame: y runs 7010 and its branch is flagged, until the next target: 2000 is 1990."""
    bench = side_by_side()
    bench.ask(write(OTHER, 10_000))
    bench.ask(bytes.fromhex("06 050F 0001"))
    bench.ask(write(OTHER, 7000))
    before = bench.memory.get(OTHER)
    arrive_next(bench, 10_010)
    bench.kinds()
    bench.seen.clear()
    assert bench.ask(stop_beside(1)) == stop_beside(1)[:5]
    assert bench.seen == [stop_beside(1)]
    assert bench.memory.get(OTHER) == before == 7010
    y = bench.line.axes[1]
    assert y.is_unsure
    assert bench.kinds()[-1] == "direction-unsure"
    arrive_next(bench)
    bench.ask(write(OTHER, 2000))
    bench.ask(bytes.fromhex("06 050F 0001"))
    assert bench.memory.get(OTHER) == 1990
    assert not y.is_unsure


def test_a_target_that_runs_beside_a_stop_with_the_right_words_is_not_flagged() -> None:
    """M2, M3: 9000 of y stands in the drive as 9010, for it goes forward: nothing has to be written."""
    bench = side_by_side()
    bench.ask(write(OTHER, 9000))
    bench.seen.clear()
    bench.ask(stop_beside(1))
    assert bench.seen == [stop_beside(1)]
    y = bench.line.axes[1]
    assert not y.is_unsure
    arrive_next(bench)
    assert bench.ask(read(NEXT_ACTUAL)) == b"\x03\x04" + OTHER.pack(9000)
    bench.ask(write(OTHER, 8000))
    bench.ask(bytes.fromhex("06 050F 0001"))
    assert bench.memory.get(OTHER) == 7990


def test_a_stop_passes_although_it_runs_another_axis_whose_target_was_refused() -> None:
    """M3: the drive refused 7000 of y. x is stopped; y runs what it has, is flagged, and stays blocked."""
    bench = side_by_side()
    bench.send(write(OTHER, 7000))
    unit_id, _ = bench.link.sent.pop(0)
    bench.line.reply(unit_id, bytes.fromhex("90 03"), bench.now_ns)
    bench.port.replies.clear()
    bench.seen.clear()
    assert bench.ask(stop_beside(1)) == stop_beside(1)[:5]
    assert bench.seen == [stop_beside(1)]
    assert bench.line.axes[1].is_unsure
    assert bench.ask(bytes.fromhex("06 050F 0001")) == bytes.fromhex("86 03")


def test_a_stop_passes_although_it_runs_another_axis_that_another_controller_holds() -> None:
    """M3, W10: the second controller's stop of x runs y's 9000, which is right as it stands. It takes nothing
    over: its own trigger of y is refused, and the first one goes on: 8000 is 7990."""
    bench = side_by_side()
    bench.ask(write(OTHER, 9000))
    bench.seen.clear()
    other = Port(ControllerPlan("plc"))
    for pdu, reply in ((stop_beside(1), stop_beside(1)[:5]), (bytes.fromhex("06 050F 0001"), b"\x86\x06")):
        bench.send(pdu, port=other)
        bench.serve()
        assert other.replies[-1][2] == reply
    assert bench.seen == [stop_beside(1)]
    arrive_next(bench)
    bench.ask(write(OTHER, 8000))
    bench.ask(bytes.fromhex("06 050F 0001"))
    assert bench.memory.get(OTHER) == 7990


def test_what_a_stop_of_another_controller_writes_for_an_axis_that_it_does_not_move_is_not_run() -> None:
    """M3, W10: x's trigger lies before y's position. The second controller stops x and writes 3000 for y,
    2990 backward; the trigger of y's writer is refused until it has written its own again."""
    field = PositionField(NEXT_TRIGGER, RegisterType.INT32, WordOrder.LOW_FIRST)
    runs = (TriggerPlan(OTHER_TRIGGER, deeds={1: Operation(Action.ABSOLUTE), 0: Operation(Action.IGNORE)}),)
    y = next_plan(command=(field,), motion=MotionPlan(is_staged=True, triggers=runs))
    bench = StagedBench(staged_plan(), y, serial=False)
    run_pdu = bytes.fromhex("06 0608 0001")
    for counts in (0, 5000):
        bench.ask(write(field, counts))
        bench.ask(run_pdu)
        arrive_next(bench, bench.memory.get(field))
    bench.ask(write(field, 6000))
    bench.seen.clear()
    other = Port(ControllerPlan("plc"))
    bench.send(bytes.fromhex("10 050E 0003 06 03E8") + field.pack(3000), port=other)
    bench.serve()
    assert bench.seen == [bytes.fromhex("10 050E 0003 06 03E8") + field.pack(2990)]
    assert [pdu.hex() for _, _, pdu in other.replies] == ["10050e0003"]
    assert bench.ask(run_pdu) == b"\x86\x06"
    bench.ask(write(field, 6000))
    assert bench.ask(run_pdu) == run_pdu
    assert bench.memory.get(field) == 6010


def test_a_stop_that_writes_an_impossible_target_of_another_axis_passes_as_it_came() -> None:
    """M3, M8: y goes to each position at once, and 2147483647 would not fit corrected. x is stopped, y goes
    there uncorrected and is flagged."""
    field = PositionField(NEXT_TRIGGER, RegisterType.INT32, WordOrder.LOW_FIRST)
    y = next_plan(command=(field,), motion=MotionPlan())
    bench = StagedBench(staged_plan(), y, serial=False)
    for counts in (0, 5000):
        bench.ask(write(field, counts))
        arrive_next(bench, bench.memory.get(field))
    bench.seen.clear()
    pdu = bytes.fromhex("10 050E 0003 06 03E8") + field.pack(2_147_483_647)
    assert bench.ask(pdu) == pdu[:5]
    assert bench.seen == [pdu]
    assert bench.line.axes[1].is_unsure


def test_a_stop_that_runs_another_axis_does_not_leave_its_target_to_be_written_afterwards() -> None:
    """M3: 9000 of y waits as the frame comes that stops x and runs y. The stop goes first and y runs what it
    has, 5010; so 9000 is refused, y is flagged, and its next trigger is refused."""
    bench = side_by_side()
    bench.seen.clear()
    bench.send(STRANGE, transaction_id=7)
    bench.send(write(OTHER, 9000), transaction_id=8)
    bench.send(stop_beside(1), transaction_id=9)
    bench.serve()
    assert bench.seen == [STRANGE, stop_beside(1)]
    replies = {number: pdu.hex() for number, _, pdu in bench.port.replies}
    assert (replies[8], replies[9]) == ("9006", "10050e0002")
    bench.port.replies.clear()
    assert bench.line.axes[1].is_unsure
    assert bench.ask(bytes.fromhex("06 050F 0001")) == b"\x86\x06"


def test_a_broadcast_that_stops_one_drive_and_runs_a_blocked_one_reaches_both() -> None:
    """M3: trigger 1000 stops x and runs y, whose target its drive has refused."""
    runs = (TriggerPlan(TRIGGER, deeds={STOP: Operation(Action.ABSOLUTE), 0: Operation(Action.IGNORE)}),)
    y = next_plan(unit_id=2, motion=MotionPlan(is_staged=True, triggers=runs))
    bench = StagedBench(staged_plan(), y)
    bench.send(write(OTHER, 7000), unit_id=2)
    unit_id, _ = bench.link.sent.pop(0)
    bench.line.reply(unit_id, bytes.fromhex("90 03"), bench.now_ns)
    bench.send(STOP_PDU, unit_id=0)
    assert bench.link.sent == [(0, STOP_PDU)]
    assert bench.line.axes[1].is_unsure


def test_a_target_beside_the_one_before_is_not_proven_by_the_arrival_at_that_one() -> None:
    """M7: 1000 runs as 1010; the trigger of 1001 (1011) is lost on the way there. The axis comes to 1010,
    which is within the hysteresis of both. It stands at 1000: to go there once more moves nothing."""
    bench = StagedBench(staged_plan(), serial=False, tcp_drive=True)
    bench.stage(1000)
    bench.trigger()
    bench.drive.pass_by(500)
    bench.ask(read(ACTUAL))
    bench.stage(1001)
    bench.send(RUN_PDU)
    assert bench.link.take() == RUN_PDU
    bench.wait(1001)
    bench.port.replies.clear()
    bench.settle()
    bench.settle()
    assert bench.ask(read(ACTUAL)) == b"\x03\x04" + ACTUAL.pack(1000)
    bench.stage(1000)
    bench.trigger()
    assert bench.drive.moves == [("absolute", 1010), ("absolute", 1010)]


def test_the_same_target_lost_twice_is_proven_by_its_arrival() -> None:
    """M7: 1000 (1010) is carried out twice, and not acknowledged once. Seen at 1010, the axis reads 1000."""
    bench = Bench(axis_plan(), serial=False, tcp_drive=True)
    bench.ask(read(ACTUAL))
    for _ in range(2):
        bench.send(write(COMMAND, 1000))
        bench.serve_reads()
        assert bench.link.take() == write(COMMAND, 1010)
        bench.wait(1001)
    bench.port.replies.clear()
    bench.memory.put(ACTUAL, 1010)
    assert bench.ask(read(ACTUAL)) == b"\x03\x04" + ACTUAL.pack(1000)
