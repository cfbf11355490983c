"""100 000 random relative moves, with stops, jogs, homing and power cycles in between (M5): `make soak`."""

import random
from dataclasses import dataclass

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action, MotionPlan, Operation, TriggerPlan
from tests.exchange.line_bench import ACTUAL, read
from tests.exchange.staged_bench import (
    COMMANDED,
    DEEDS,
    HOME_PDU,
    JOG_PDU,
    RUN_RELATIVE_PDU,
    STOP_PDU,
    TRIGGER,
    StagedBench,
    staged_plan,
)
from tests.soak import repeated

MOVES = repeated(33_400)
"""On each of the three bases."""
KNOTS = [0.0, 25.0, 50.0, 75.0, 100.0]
FORWARD = [0.010, 0.060, -0.020, 0.015, 0.080]
BACKWARD = [-0.015, 0.030, -0.055, -0.010, 0.020]
BASES = (Action.RELATIVE, Action.RELATIVE_TO_COMMANDED, Action.RELATIVE_TO_ACTUAL)


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
        assert abs(told - exact(self.nominal, is_forward=distance > 0)) <= 0.51, (self.nominal, distance)
        assert self.actual() == self.nominal

    def actual(self) -> float:
        """Read the position as the controller does."""
        return ACTUAL.unpack(self.bench.ask(read(ACTUAL))[2:])

    def be_moved(self, counts: int) -> None:
        """Stand somewhere that no target of the controller led to."""
        self.bench.drive.put(COMMANDED, counts)
        self.bench.drive.put(ACTUAL, counts)
        self.bench.drive.set_bits(is_done=True)
        self.bench.wait(1000)
        self.bench.poll()
        self.nominal = round(self.actual())

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


@pytest.mark.parametrize("base", BASES, ids=lambda base: base.value)
def test_m5_nothing_adds_up_over_thousands_of_relative_moves(base: Action) -> None:
    table = make_table(KNOTS, FORWARD, BACKWARD, Units.MM)
    triggers = (TriggerPlan(TRIGGER, deeds={**DEEDS, 2: Operation(base)}),)
    motion = MotionPlan(is_staged=True, triggers=triggers)
    bench = StagedBench(staged_plan(table=table, motion=motion))
    bench.go_to(50_000)
    walk = Walk(bench, random.Random(base.value))
    for _ in range(MOVES):
        if walk.rng.random() < 0.02:
            walk.interrupt()
        walk.step()
        bench.seen.clear()
        bench.drive.moves.clear()
        bench.events.clear()
