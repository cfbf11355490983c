"""Relative moves (M5): through the absolute nominal position, from a base that still holds."""

import random
from dataclasses import dataclass

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action, ModePlan, MotionPlan
from gateway.exchange.status import direction_state
from tests.exchange.line_bench import ACTUAL, COMMAND, MOVE_MS, Arrival, Bench, axis_plan, read, write
from tests.exchange.staged_bench import (
    COMMANDED,
    HOME_PDU,
    JOG_PDU,
    MODE,
    RUN_RELATIVE_PDU,
    STOP_PDU,
    StagedBench,
    relative_by,
    staged_plan,
)
from tests.soak import repeated
from tests.verify.screw import WORN

MOVES = {Arrival.STORED: repeated(33_400)}
"""On each base where requests come stored; 5 000 in each other way."""
SLOPE = make_table([0, 100], [0.0, 0.5], [0.0, 0.5], Units.MM)
"""5 counts more per mm of 1000 counts, the same in both directions."""
KNOTS = [0.0, 25.0, 50.0, 75.0, 100.0]
FORWARD = [0.010, 0.060, -0.020, 0.015, 0.080]
BACKWARD = [-0.015, 0.030, -0.055, -0.010, 0.020]
BASES = {
    "target": Action.RELATIVE,
    "commanded": Action.RELATIVE_TO_COMMANDED,
    "actual": Action.RELATIVE_TO_ACTUAL,
}


def by(bench: StagedBench, distance: int) -> None:
    """Move by a distance as the controller does, and let the axis arrive."""
    bench.run(distance, RUN_RELATIVE_PDU)
    bench.settle()


@pytest.mark.parametrize("base", BASES.values(), ids=BASES)
def test_m5_a_relative_move_ends_where_the_absolute_one_would(base: Action) -> None:
    bench = StagedBench(staged_plan(table=SLOPE, motion=relative_by(base)))
    bench.go_to(20_000)  # 20 100
    by(bench, 10_000)  # 30 000 is 30 150: told 10 050
    assert bench.drive.moves[1:] == [("relative", 30_150)]
    assert bench.memory.get(COMMAND) == 10_050
    assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == 10_000
    assert bench.actual() == 30_000


def exact(nominal_counts: float, *, is_forward: bool) -> float:
    """Corrected counts by the table, worked out by hand: 1000 counts per mm, knots 25 mm apart."""
    position = nominal_counts / 1000
    number = min(int(position // 25), 3)
    values = FORWARD if is_forward else BACKWARD
    share = (position - KNOTS[number]) / 25
    return nominal_counts + 1000 * (values[number] + share * (values[number + 1] - values[number]))


@dataclass
class Walk:
    """An axis that is moved about at random, and where the controller believes it to be."""

    bench: StagedBench
    rng: random.Random
    nominal: int = 50_000

    def step(self) -> None:
        """Move by a distance, and look where it ended."""
        low, high = 1_000 - self.nominal, 99_000 - self.nominal
        distance = self.rng.randint(max(-3_000, low), min(3_000, high)) or 1
        bench = self.bench
        bench.run(distance, RUN_RELATIVE_PDU)
        bench.drive.arrive()
        bench.poll()
        self.nominal += distance
        told = bench.drive.get(ACTUAL)
        assert abs(told - exact(self.nominal, is_forward=distance > 0)) <= 0.5 + 1e-6, (
            self.nominal,
            distance,
        )
        assert self.bench.actual() == self.nominal

    def be_moved(self, counts: int) -> None:
        """Stand somewhere that no target of the controller led to."""
        self.bench.drive.put(COMMANDED, counts)
        self.bench.drive.put(ACTUAL, counts)
        self.bench.drive.set_bits(is_done=True)
        self.bench.wait(1000)
        self.bench.poll()
        self.nominal = round(self.bench.actual())

    def interrupt(self) -> None:
        """Stop on the way, jog, home, or switch the drive off and on."""
        bench, somewhere = self.bench, self.rng.randint(5_000, 95_000)
        kind = self.rng.choice(("stop", "jog", "home", "off"))
        if kind == "stop":
            bench.run(1_000, RUN_RELATIVE_PDU)
            bench.drive.pass_by(somewhere)
            bench.trigger(STOP_PDU)
        elif kind == "off":
            bench.cut(3000)
        else:
            bench.trigger({"jog": JOG_PDU, "home": HOME_PDU}[kind])
        self.be_moved(somewhere)


@pytest.mark.parametrize("base", BASES.values(), ids=BASES)
def test_m5_nothing_adds_up_over_thousands_of_relative_moves(base: Action, arrival: Arrival) -> None:
    """With stops, jogs, homing and power cycles in between."""
    table = make_table(KNOTS, FORWARD, BACKWARD, Units.MM)
    bench = StagedBench(staged_plan(table=table, motion=relative_by(base)))
    bench.go_to(50_000)
    walk = Walk(bench, random.Random(base.value))
    for _ in range(MOVES.get(arrival) or repeated(5_000)):
        if walk.rng.random() < 0.02:
            walk.interrupt()
        walk.step()
        bench.seen.clear()
        bench.drive.moves.clear()
        bench.events.clear()


def test_m5_the_same_distance_again_is_another_move() -> None:
    bench = StagedBench(staged_plan(table=SLOPE))
    bench.go_to(20_000)
    by(bench, 10_000)
    bench.trigger(RUN_RELATIVE_PDU)
    assert bench.drive.moves[-2:] == [("relative", 30_150), ("relative", 40_200)]


def test_a8_after_a_stop_the_base_is_the_position_of_the_axis() -> None:
    bench = StagedBench(staged_plan(table=SLOPE))
    bench.run(100_000)
    bench.drive.pass_by(30_150)
    bench.trigger(STOP_PDU)
    bench.settle()
    assert bench.actual() == 30_000
    by(bench, 10_000)
    assert bench.drive.moves[-1] == ("relative", 40_200)


@pytest.mark.parametrize("pdu", [JOG_PDU, HOME_PDU])
def test_a8_after_a_jog_or_homing_the_base_is_read(pdu: bytes) -> None:
    bench = StagedBench(staged_plan(table=SLOPE))
    bench.go_to(50_000)
    bench.trigger(pdu)
    bench.memory.put(COMMANDED, 60_300)
    bench.settle(is_polled=False)
    by(bench, 10_000)
    assert bench.drive.moves[-1] == ("relative", 70_350)


def test_m5_a_relative_move_of_a_moving_axis_is_refused_as_busy() -> None:
    bench = StagedBench(staged_plan(table=SLOPE))
    bench.go_to(20_000)
    bench.trigger(JOG_PDU)
    bench.stage(10_000)
    bench.seen.clear()
    assert bench.refused(RUN_RELATIVE_PDU) == 6
    assert "base-unknown" in bench.kinds()


def test_m5_relative_unknown_pass_sends_it_unchanged() -> None:
    bench = StagedBench(
        staged_plan(
            table=SLOPE, motion=relative_by(Action.RELATIVE_TO_COMMANDED, passes_unknown_relative=True)
        )
    )
    bench.go_to(20_000)
    bench.trigger(JOG_PDU)
    bench.run(10_000, RUN_RELATIVE_PDU)
    assert bench.memory.get(COMMAND) == 10_000


def test_m5_a_lost_acknowledgement_makes_the_base_unknown_and_a_reading_finds_it() -> None:
    bench = StagedBench(staged_plan(table=SLOPE), serial=False, tcp_drive=True)
    bench.go_to(20_000)
    bench.stage(10_000)
    bench.send(RUN_RELATIVE_PDU)
    bench.memory.answer(bench.link.take())
    bench.wait(1000)
    bench.port.take()
    bench.settle()
    by(bench, 10_000)
    assert bench.drive.moves[-2:] == [("relative", 30_150), ("relative", 40_200)]


def test_m5_a_base_of_the_last_target_needs_no_reading_of_a_moving_axis() -> None:
    bench = StagedBench(staged_plan(table=SLOPE, motion=relative_by(Action.RELATIVE)))
    bench.run(20_000)
    bench.drive.pass_by(5_000)
    bench.run(10_000, RUN_RELATIVE_PDU)
    assert bench.memory.get(COMMAND) == 10_050


def test_m5_a_standing_error_does_not_shift_the_base_of_a_commanded_move() -> None:
    bench = StagedBench(staged_plan(table=SLOPE))
    bench.go_to(20_000)
    bench.drive.arrive(standing_error=2)
    by(bench, 10_000)
    assert bench.drive.moves[-1] == ("relative", 30_150)


def test_m8_a_relative_move_out_of_the_travel_is_refused() -> None:
    bench = StagedBench(staged_plan(table=SLOPE, travel=(0.0, 100.0)))
    bench.go_to(90_000)
    bench.stage(20_000)
    assert bench.refused(RUN_RELATIVE_PDU) == 4


def test_m5_a_distance_of_0_moves_nothing() -> None:
    bench = StagedBench()
    bench.go_to(50_000)
    by(bench, 0)
    assert bench.drive.moves[-1] == ("relative", 50_010)


def test_m5_a_distance_passes_unchanged_without_compensation() -> None:
    bench = StagedBench(staged_plan(table=None))
    bench.go_to(20_000)
    by(bench, 10_000)
    assert bench.memory.get(COMMAND) == 10_000
    assert bench.drive.moves[-1] == ("relative", 30_000)


# --- relative moves in the frame itself -------------------------------------------------------------------

IN_FRAME = MotionPlan(
    modes=(ModePlan(0x0605, mask=1, actions={0: Action.ABSOLUTE, 1: Action.RELATIVE}, is_in_frame=True),)
)


def block(mode: int, counts: int) -> bytes:
    words = mode.to_bytes(2, "big") + COMMAND.pack(counts)
    return bytes.fromhex("10 0605 0003 06") + words


def test_m5_in_frame_a_relative_block_keeps_its_shape() -> None:
    bench = Bench(axis_plan(table=SLOPE, motion=IN_FRAME))
    assert bench.sent_for(block(0, 20_000)) == block(0, 20_100)
    assert bench.ask(block(1, 10_000)) == block(1, 10_000)[:5]
    assert bench.seen[-1] == block(1, 10_050)
    assert bench.sent_for(block(1, 10_000)) == block(1, 10_050)
    assert bench.line.axes[0].compensation.accepted is not None
    assert bench.line.axes[0].compensation.accepted.nominal_counts == 40_000


def test_m2_in_frame_a_target_without_its_mode_is_unknown_and_passes_untouched() -> None:
    bench = Bench(axis_plan(table=SLOPE, motion=IN_FRAME))
    assert bench.sent_for(write(COMMAND, 20_000)) == write(COMMAND, 20_000)
    assert bench.line.counters.unknown_modes == 1


def test_a_distance_from_a_position_of_unknown_branch_is_flagged() -> None:
    """M5, M6: jogged to 3000 on the drive, which is 2990 or 3010: -1000 is right for one."""
    bench = StagedBench(staged_plan(), serial=False)
    bench.go_to(5000)
    bench.ask(JOG_PDU)
    bench.memory.put(ACTUAL, 3000)
    bench.memory.put(COMMANDED, 3000)
    bench.drive.set_bits(is_done=True)
    bench.wait(1200)
    bench.poll()
    bench.run(-1000, RUN_RELATIVE_PDU)
    assert direction_state(bench.line.axes[0]) == "unsure"


def test_the_same_words_as_an_absolute_target_are_no_repeat_of_a_distance() -> None:
    """M4, M5: the mode of a drive that goes at once falls back after each move.

    At 5000 forward 0.03 + 0.3 * 5/20 = 0.105 mm, so 5105; the distance of 3000 ends at 8000, which is 8150
    there, 3045 on; 3000 as a place comes backward, -0.17 + 0.22 * 3/20 = -0.137 mm, so 2863.
    """
    modes = (ModePlan(MODE, actions={1: Action.ABSOLUTE, 2: Action.RELATIVE_TO_COMMANDED}, resets_to=1),)
    bench = Bench(axis_plan(table=WORN.table(), motion=MotionPlan(modes=modes), commanded=(COMMANDED,)))
    bench.memory.write(MODE, b"\0\x01")
    assert bench.move(5000) == write(COMMAND, 5105)
    bench.memory.put(COMMANDED, 5105)
    bench.ask(b"\x06" + MODE.to_bytes(2, "big") + b"\0\x02")
    assert bench.ask(write(COMMAND, 3000)) == write(COMMAND, 3000)[:5]
    assert bench.seen[-1] == write(COMMAND, 3045)
    bench.memory.write(MODE, b"\0\x01")
    for place in (ACTUAL, COMMANDED):
        bench.memory.put(place, 8150)
    bench.wait(MOVE_MS)
    assert bench.sent_for(write(COMMAND, 3000)) == write(COMMAND, 2863)
