"""A target from before a loss of reach or reference counts only by proof (M4, M6, M9)."""

from itertools import product
from typing import Any

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.axis.motion import REPEAT_KINDS, MotionState
from gateway.exchange.commands import SetReference
from gateway.exchange.plan import LineTiming, Reference
from gateway.exchange.status import direction_state
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from tests.exchange.connection_bench import Connection
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, Memory, axis_plan, read, write
from tests.exchange.staged_bench import (
    COMMANDED,
    DONE_BIT,
    MODE,
    RUN_PDU,
    STATUS,
    TRIGGER,
    StagedBench,
    staged_plan,
)

WORN = make_table([0, 200], [0.41, 0.41], [-0.26, -0.26], Units.MM)
"""60 000 is told as 60 410 forward and as 59 740 backward."""
HOMED = BitField(0x0031, 5)
STATUS_PDU = bytes([3]) + STATUS.to_bytes(2, "big") + bytes((0, 1))
KEEPING_WALK = """
seen waits before  what
yes  yes   yes     same-words
yes  yes   no      same-words
yes  no    yes     same-words
yes  no    no      same-words
no   no    yes     same-words
no   no    no      same-words
no   yes   yes     unseen
no   yes   no      new
"""


@pytest.mark.parametrize(("seen", "waits", "before"), list(product((True, False), repeat=3)))
def test_m9_a_kept_target_is_what_the_rule_says(seen: bool, waits: bool, before: bool) -> None:
    _, *rows = (row.split() for row in KEEPING_WALK.strip("\n").splitlines())
    words = ["yes" if each else "no" for each in (seen, waits, before)]
    [found] = [row[3] for row in rows if row[:3] == words]
    assert REPEAT_KINDS[seen, waits, before].value == found
    assert len(REPEAT_KINDS) == len(rows)


# --- a drive that moves with each write ----------------------------------------------------------------


def mover(**plan: Any) -> Bench:
    """Return a mover that went backward to 60 mm and is there: 59 740."""
    memory = Memory()
    memory.words[HOMED.address] = 1 << HOMED.bit
    bits = {"referenced": Reference.DRIVE_BIT, "bits": {"homed": HOMED}}
    bench = Bench(axis_plan(table=WORN, **bits, **plan), timing=LineTiming(drain_ms=1), memory=memory)
    if plan.get("added_frames", True) is False:
        bench.ask(read_homed())
    bench.move(100_000)
    bench.ask(read(ACTUAL))
    bench.move(60_000)
    bench.ask(read(ACTUAL))
    return bench


def read_homed() -> bytes:
    return bytes([3]) + HOMED.address.to_bytes(2, "big") + bytes((0, 1))


def lose(bench: Bench, how: str) -> None:
    """Lose reach or reference of the drive."""
    if how == "reference":
        bench.memory.words[HOMED.address] = 0
        bench.ask(read_homed())
    elif how == "link":
        bench.cut(500)
    else:
        for _ in range(3):
            bench.unanswered(read(ACTUAL), 1001, 2)
        bench.wait(1000)


LOSSES = ["reference", "link", "silence"]


@pytest.mark.parametrize("how", LOSSES)
def test_m4_a_repeat_after_a_loss_keeps_its_words_if_the_axis_is_at_its_target(how: str) -> None:
    bench = mover()
    lose(bench, how)
    before = len(bench.seen)
    for _ in range(3):
        assert bench.command(60_000) == 59_740
    looks = 2 if how == "silence" else 1  # of which one is the trial of a dead drive (W11)
    assert bench.seen[before:].count(read(ACTUAL)) == looks


@pytest.mark.parametrize("beside", [20, -20])
def test_m4_a_standing_error_within_the_window_counts_as_at_the_target(beside: int) -> None:
    bench = mover()
    lose(bench, "reference")
    bench.memory.put(ACTUAL, 59_740 + beside)
    assert bench.command(60_000) == 59_740


@pytest.mark.parametrize("how", LOSSES)
def test_m9_a_repeat_passes_1_to_1_if_the_axis_is_elsewhere_without_a_reference(how: str) -> None:
    bench = mover()
    lose(bench, how)
    bench.memory.words[HOMED.address] = 0
    bench.wait(1100)
    bench.memory.put(ACTUAL, 20_000)  # its drive was switched off, and counts from another zero
    assert bench.command(60_000) == 60_000
    assert not bench.line.axes[0].reference.is_referenced


@pytest.mark.parametrize("how", LOSSES[1:])
def test_m6_a_repeat_is_rendered_again_if_the_axis_is_elsewhere_with_its_reference(how: str) -> None:
    bench = mover()
    lose(bench, how)
    bench.memory.put(ACTUAL, 20_000)
    assert bench.command(60_000) == 60_410  # forward from 20 mm


@pytest.mark.parametrize("is_after", [True, False])
def test_m9_only_a_reading_of_the_controller_after_the_loss_is_proof(is_after: bool) -> None:
    bench = mover()
    if not is_after:
        bench.ask(read(ACTUAL))
    lose(bench, "reference")
    if is_after:
        bench.ask(read(ACTUAL))
    assert (read(ACTUAL) not in bench.frames(write(COMMAND, 60_000))) is is_after
    assert bench.memory.get(COMMAND) == 59_740


def test_m9_after_a_reading_elsewhere_a_kept_target_never_counts_again() -> None:
    bench = mover()
    lose(bench, "reference")
    bench.memory.put(ACTUAL, 20_000)
    bench.ask(read(ACTUAL))
    assert bench.line.axes[0].motion.state is not MotionState.SUPERSEDED
    bench.memory.put(ACTUAL, 59_740)
    assert bench.command(60_000) == 60_000


@pytest.mark.parametrize("how", LOSSES)
def test_m4_without_added_reads_a_mover_gets_the_same_words(how: str) -> None:
    """A cyclic writer that repeats its target over a pulled cable must not jerk the axis."""
    bench = mover(added_frames=False)
    assert bench.memory.get(COMMAND) == 59_740
    lose(bench, how)
    assert bench.command(60_000) == 59_740
    bench.memory.put(ACTUAL, 20_000)
    bench.ask(read(ACTUAL))  # until somebody sees it elsewhere
    bench.memory.words[HOMED.address] = 0
    bench.ask(read_homed())
    assert bench.command(60_000) == 60_000


def test_m4_a_drive_that_refuses_to_report_its_position_gets_the_same_words() -> None:
    bench = mover()
    lose(bench, "link")
    bench.send(write(COMMAND, 60_000))
    while bench.link.sent and bench.link.sent[0][1][0] == 3:
        unit_id, pdu = bench.link.sent.pop(0)
        is_place = pdu == read(ACTUAL)
        reply = bytes.fromhex("83 04") if is_place else bench.memory.answer(pdu)
        bench.line.reply(unit_id, reply, bench.now_ns)
    assert bench.link.sent == [(1, write(COMMAND, 59_740))]


# --- a drive that waits for a trigger ------------------------------------------------------------------


def staged(*, is_polled: bool = True, **plan: Any) -> StagedBench:
    """Return a staged drive that went forward to 60 mm and is there: 60 410."""
    bench = StagedBench(
        staged_plan(table=WORN, referenced=Reference.DRIVE_BIT, **plan), timing=LineTiming(drain_ms=1)
    )
    bench.ask(STATUS_PDU)
    bench.run(60_000)
    bench.drive.arrive()
    bench.wait(1500)
    if is_polled:
        bench.ask(STATUS_PDU)
        bench.ask(read(ACTUAL))
    return bench


def switch_off(bench: StagedBench, *, is_homed: bool = False, at: int = 20_000) -> None:
    """Let the drive be silent for 3 s under polls, then answer with another zero."""
    for _ in range(3):
        bench.unanswered(STATUS_PDU, 1001, 2)
    bench.wait(1000)
    bench.drive.put(ACTUAL, at)
    bench.drive.set_bits(is_done=True, is_homed=is_homed)
    bench.ask(STATUS_PDU)


def test_m9_a_drive_that_comes_back_with_another_zero_gets_no_correction() -> None:
    """Before, the target was staged 1:1 and written again as 60 410 at its trigger, without a read."""
    bench = staged()
    switch_off(bench)
    bench.stage(60_000)
    before = len(bench.seen)
    bench.trigger()
    sent = bench.seen[before:]
    assert sent.count(write(COMMAND, 60_410)) == 0
    assert sent.count(read(ACTUAL)) == 1
    assert bench.drive.moves[-1] == ("absolute", 60_000)


def test_m9_the_added_read_finds_a_restart_of_the_drive_too() -> None:
    bench = staged()
    bench.drive.put(ACTUAL, 20_000)
    bench.drive.set_bits(is_done=True, is_homed=False)
    bench.wait(1100)
    bench.ask(STATUS_PDU)
    assert bench.run(60_000) == ("absolute", 60_000)


def test_m9_without_added_reads_a_target_from_before_is_refused_until_a_reading() -> None:
    bench = staged(added_frames=False)
    switch_off(bench, at=60_075)  # half-way, for nobody could look before the first target either
    moves = list(bench.drive.moves)
    bench.stage(60_000)
    assert bench.ask(RUN_PDU) == bytes.fromhex("86 06")
    assert bench.drive.moves == moves
    bench.ask(read(ACTUAL))
    assert bench.run(60_000) == ("absolute", 60_075)


def test_m9_without_added_reads_a_different_target_passes_1_to_1() -> None:
    bench = staged(added_frames=False)
    switch_off(bench)
    bench.stage(60_000)
    assert bench.ask(RUN_PDU) == bytes.fromhex("86 06")
    assert bench.run(60_001) == ("absolute", 60_001)


def test_m6_m9_without_added_reads_unproven_words_are_forgotten_and_the_direction_is_flagged() -> None:
    bench = staged(added_frames=False, is_polled=False)
    switch_off(bench)
    assert bench.run(60_000) == ("absolute", 60_000)
    bench.drive.set_bits(is_done=True, is_homed=True)
    bench.drive.arrive()
    bench.wait(1500)
    bench.ask(STATUS_PDU)
    assert bench.line.axes[0].reference.is_referenced
    bench.run(40_000)
    assert bench.drive.moves[-1][1] < 40_000  # backward from 60 mm
    assert bench.line.axes[0].is_unsure


def test_m4_an_axis_at_its_target_gets_the_same_words_with_each_repeat() -> None:
    bench = staged()
    switch_off(bench, at=60_410)
    for _ in range(3):
        bench.run(60_000)
        bench.drive.set_bits(is_done=True, is_homed=False)
        bench.ask(STATUS_PDU)
    assert bench.drive.moves[-3:] == [("absolute", 60_410)] * 3


def test_m9_a_reading_of_an_axis_that_moves_proves_nothing() -> None:
    """Its reading is within the window of its target while it passes by."""
    bench = staged(added_frames=False)
    switch_off(bench, at=60_075)
    bench.drive.set_bits(is_done=False, is_homed=False)
    bench.ask(STATUS_PDU)
    bench.ask(read(ACTUAL))
    bench.stage(60_000)
    assert bench.ask(RUN_PDU) == bytes.fromhex("86 06")


def test_m4_an_axis_without_an_actual_position_runs_its_target_after_a_lost_link() -> None:
    bench = staged(actual=(), is_polled=False)
    bench.ask(STATUS_PDU)
    told = bench.drive.moves[-1]
    lose(bench, "link")
    bench.drive.set_bits(is_done=True)
    assert bench.run(60_000) == told


# --- its trigger alone ---------------------------------------------------------------------------------


class ConnectedBench(StagedBench):
    """The same drive behind a connection, which its server may close after an answer."""

    def serve(self) -> None:
        super().serve()
        while self.line.rest.is_closing:
            self.wait(21)
            super().serve()


def after_a_close(*, is_orderly: bool = True) -> StagedBench:
    """Return an axis at 60 410 whose connection was closed for 3 s; nothing was staged since."""
    bench = ConnectedBench(staged_plan(table=WORN, referenced=Reference.DRIVE_BIT), link=Connection())
    bench.ask(STATUS_PDU)
    bench.run(60_000)
    bench.drive.arrive()
    bench.wait(1500)
    bench.ask(STATUS_PDU)
    bench.ask(read(ACTUAL))
    bench.wait(1500)
    bench.line.link_down(bench.now_ns, "closed by its peer", is_orderly=is_orderly)
    bench.wait(3000)
    bench.line.link_up(bench.now_ns)
    bench.serve()
    return bench


def test_m2_after_a_close_a_trigger_runs_the_target_that_its_drive_has_kept() -> None:
    bench = after_a_close()
    before = len(bench.seen)
    bench.trigger()
    sent = bench.seen[before:]
    assert sent.count(read(COMMAND)) == 1  # read back before it runs
    assert sent.count(write(COMMAND, 60_410)) == 0
    assert bench.drive.moves[-1] == ("absolute", 60_410)


@pytest.mark.parametrize("kept", [60_409, 60_000, 0])
def test_m9_after_a_close_a_trigger_is_refused_if_its_drive_holds_anything_else(kept: int) -> None:
    bench = after_a_close()
    bench.drive.put(COMMAND, kept)
    assert bench.refused(RUN_PDU) == 4


def test_m9_a_trigger_alone_is_refused_after_any_other_loss_of_the_link() -> None:
    bench = after_a_close(is_orderly=False)
    assert bench.refused(RUN_PDU) == 4


def test_m3_reading_a_kept_target_back_does_not_replace_a_lost_one() -> None:
    bench = staged()
    bench.unanswered(write(COMMAND, 70_000), 1001, 2)
    lose(bench, "link")
    moves = list(bench.drive.moves)
    assert bench.ask(RUN_PDU)[0] == 0x86
    assert bench.drive.moves == moves


def test_m2_after_a_close_a_kept_target_is_rendered_again_if_the_axis_is_elsewhere() -> None:
    bench = after_a_close()
    bench.drive.put(ACTUAL, 90_000)
    assert bench.trigger() == ("absolute", 59_740)  # backward from 90 mm


# --- a reference that a person declares: nothing was lost ------------------------------------------------

KINDS = [Reference.SET_POSITION, Reference.HOMING]


@pytest.mark.parametrize("referenced", KINDS)
@pytest.mark.parametrize("is_read", [True, False])
def test_m4_a_declared_reference_does_not_change_the_words_of_a_staged_target(
    referenced: Reference, is_read: bool
) -> None:
    bench = StagedBench(staged_plan(table=WORN, referenced=referenced))
    bench.run(60_000)
    bench.drive.pass_by(40_000)
    bench.poll()
    bench.line.command(SetReference(axis="x"), bench.now_ns)
    if is_read:
        bench.ask(read(ACTUAL))
    bench.run(60_000)
    assert bench.drive.moves == [("absolute", 60_000), ("absolute", 60_000)]
    bench.settle()
    assert bench.go_to(50_000) == ("absolute", 49_740)


@pytest.mark.parametrize("is_read", [True, False])
def test_m4_a_declared_reference_does_not_change_the_words_of_a_target_repeated_on_the_way(
    is_read: bool,
) -> None:
    bench = Bench(axis_plan(table=WORN, referenced=Reference.SET_POSITION))
    assert bench.reach(60_000) == 60_000
    bench.memory.put(ACTUAL, 40_000)
    bench.line.command(SetReference(axis="x"), bench.now_ns)
    if is_read:
        bench.ask(read(ACTUAL))
    assert bench.command(60_000) == 60_000


def test_m9_a_declared_reference_proves_nothing_of_a_target_from_before_a_loss() -> None:
    bench = Bench(axis_plan(table=WORN, referenced=Reference.SET_POSITION), timing=LineTiming(drain_ms=1))
    bench.line.command(SetReference(axis="x"), bench.now_ns)
    assert bench.reach(60_000) == 60_410
    lose(bench, "silence")
    bench.memory.put(ACTUAL, 80_000)
    bench.ask(read_homed())  # it answers again: its reference is lost
    assert not bench.line.axes[0].reference.is_referenced
    bench.line.command(SetReference(axis="x"), bench.now_ns)
    assert bench.command(60_000) == 59_740  # seen at 80 mm: a new target, backward


# --- sequences that several rules have a part in ---------------------------------------------------------


def mode(word: int) -> bytes:
    """FC06 that writes the mode register."""
    return b"\x06" + MODE.to_bytes(2, "big") + word.to_bytes(2, "big")


IGNORES = MotionPlan(modes=(ModePlan(MODE, actions={1: Action.ABSOLUTE}, otherwise=Action.IGNORE),))


def test_words_written_in_a_mode_without_targets_do_not_make_the_next_target_a_repeat() -> None:
    """M4: in mode 9 the drive keeps 3000 and is at 10; in mode 1 the same words are a target: 3010."""
    bench = Bench(axis_plan(motion=IGNORES))
    bench.ask(mode(1))
    bench.move(-5000, 0)
    bench.actual()
    bench.ask(mode(9))
    assert bench.sent_for(write(COMMAND, 3000)) == write(COMMAND, 3000)
    bench.ask(mode(1))
    assert bench.sent_for(write(COMMAND, 3000)) == write(COMMAND, 3010)


def trigger(word: int) -> bytes:
    """FC06 that writes the trigger register."""
    return b"\x06" + TRIGGER.to_bytes(2, "big") + word.to_bytes(2, "big")


FOLLOW = 0xFFFB


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


def test_w8_a_trigger_register_that_is_known_is_not_read_before_a_position() -> None:
    bench = following_bench()
    bench.ask(write(COMMAND, 500))
    assert bench.seen == [write(COMMAND, 500)]


@pytest.mark.parametrize("word", [1, 0xFFFC])
def test_no_target_is_written_again_while_the_drive_follows_its_register(word: int) -> None:
    """M2: +1000 was sent as +1020, from 1990 to 3010. Written again for the trigger, as 1000 in the same
    direction, it would move the drive immediately, and the trigger once more. The meaning of 0xFFFC is
    unknown."""
    bench = following_bench()
    assert isinstance(bench.memory, FollowingDrive)
    assert bench.memory.ends == [5010, 1990, 3010]
    assert bench.ask(trigger(word)) == bytes.fromhex("86 04")
    assert not [pdu for pdu in bench.seen if pdu[0] in (6, 16)]
    assert bench.memory.ends == [5010, 1990, 3010]


class DeafDrive(FollowingDrive):
    """The same, which does not report where it is after a lost link."""

    is_deaf = False

    def answer(self, pdu: bytes) -> bytes:
        is_refused = self.is_deaf and pdu == read(ACTUAL)
        return bytes.fromhex("83 04") if is_refused else super().answer(pdu)


@pytest.mark.parametrize("follows", [True, False])
def test_m9_a_drive_that_follows_its_register_gets_the_same_words_if_no_reading_is_possible(
    follows: bool,
) -> None:
    """A cyclic writer would be refused for ever. Without following, its trigger is refused."""
    deeds = {**FOLLOWING_DEEDS, 1: Operation(Action.ABSOLUTE)}
    motion = MotionPlan(is_staged=True, triggers=(TriggerPlan(TRIGGER, deeds=deeds),))
    memory = DeafDrive()
    bench = Bench(axis_plan(motion=motion, bits={"done": BitField(STATUS, DONE_BIT)}), memory=memory)
    start = (trigger(FOLLOW), write(COMMAND, 2000)) if follows else (write(COMMAND, 2000), trigger(1))
    for pdu in start:
        bench.ask(pdu)
    bench.wait(1200)
    bench.ask(bytes.fromhex("03 005C 0001"))
    assert bench.actual() == 2000
    memory.is_deaf = True
    bench.cut(20)
    for _ in range(3):
        assert bench.ask(write(COMMAND, 2000)) == bytes.fromhex("10 0606 0002")
    assert bench.ask(trigger(FOLLOW if follows else 1)) == (trigger(FOLLOW) if follows else b"\x86\x06")
    assert memory.ends == [2010] * (4 if follows else 1)


@pytest.mark.parametrize("word", [0, 1])
def test_m9_a_drive_that_starts_on_a_word_of_its_position_gets_the_same_words(word: int) -> None:
    """Each whole position moves the axis (IAI): a cyclic writer would be refused for ever."""
    memory = DeafDrive()
    motion = MotionPlan(starts_on=frozenset({COMMAND.address + word}))
    bench = Bench(axis_plan(motion=motion, bits={"done": BitField(STATUS, DONE_BIT)}), memory=memory)
    memory.write(STATUS, (1 << DONE_BIT).to_bytes(2, "big"))
    bench.ask(write(COMMAND, 2000))
    memory.put(ACTUAL, 2010)
    bench.wait(1200)
    bench.ask(bytes.fromhex("03 005C 0001"))
    assert bench.actual() == 2000
    memory.is_deaf = True
    bench.cut(20)
    for _ in range(3):
        assert bench.ask(write(COMMAND, 2000)) == bytes.fromhex("10 0606 0002")
    assert memory.get(COMMAND) == 2010


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


OTHER = PositionField(0x0700, RegisterType.INT32, WordOrder.LOW_FIRST)


def test_a_lost_target_of_one_path_does_not_run_once_another_path_has_a_new_one() -> None:
    """M3: path 2 holds 1000 (1010), and 0x7FFFFFFF for it is refused. A target for path 1 unblocks the axis.
    Path 2 still holds a wrong target, also if stored moves may pass."""
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


def test_words_that_were_in_the_register_before_prove_no_target() -> None:
    """M7: 1000 through the other register was sent as 1010 long ago; its repeat is lost. The words read there
    are still those of the first. 800 from 500 (490) may be on either branch: flagged."""
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


def test_a_target_beside_the_one_before_is_not_proven_by_the_arrival_at_that_one() -> None:
    """M7: 1000 runs as 1010; the trigger of 1001 (1011) is lost on the way there. The axis arrives at 1010,
    which is within the hysteresis of both. It is at 1000: a repeat of that moves nothing."""
    bench = StagedBench(staged_plan(), serial=False, tcp_drive=True)
    bench.run(1000)
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
    bench.run(1000)
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


def test_m9_an_orderly_close_after_another_loss_does_not_restore_a_kept_target() -> None:
    bench = after_a_close(is_orderly=False)
    bench.line.link_down(bench.now_ns, "closed by its peer", is_orderly=True)
    bench.wait(3000)
    bench.line.link_up(bench.now_ns)
    bench.serve()
    assert bench.refused(RUN_PDU) == 4
