"""Two axes that follow streams, and each other, through everything that may come between two setpoints."""

from random import Random

import pytest

from gateway.compensation.fingerprint import table_digest
from gateway.compensation.settings import Gain, ThermalSettings
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.exchange.commands import TableFor
from gateway.exchange.control import set_gain, set_tables, set_temperature, switch
from gateway.exchange.plan import CrossPlan
from gateway.modbus.registers import PositionField
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, read, stream_plan, write
from tests.exchange.record_bench import RecordBench
from tests.exchange.test_cross_terms import Y_ACTUAL, Y_COMMAND
from tests.soak import repeated

BOW = make_table([0, 300, 1000], [0.02, -0.05, 0.08], [0.0, -0.06, 0.05], Units.MM)
STEEP = make_table([0, 100, 900, 1000], [0.0, 0.5, -0.5, 0.08], [0.03, 0.55, -0.46, 0.08], Units.MM)
TABLES = {table_digest(table): table for table in (BOW, STEEP)}
WIDE = {"max_correction": 10.0, "travel": (0.0, 1000.0)}
PLANS = (
    stream_plan(
        table=BOW,
        thermal=ThermalSettings(1e-4, fixed_at=100.0, rate_per_min=60.0),
        cross=(CrossPlan("y", (0.0, 500.0, 1000.0), (0.0, 0.5, 0.2), fresh_s=5.0),),
        **WIDE,
    ),
    stream_plan(
        name="y",
        command=(Y_COMMAND,),
        actual=(Y_ACTUAL,),
        table=STEEP,
        cross=(CrossPlan("x", (0.0, 1000.0), (0.0, -0.3), fresh_s=5.0),),
        **WIDE,
    ),
)
PLACES = {COMMAND: ACTUAL, Y_COMMAND: Y_ACTUAL}
STEPS = repeated(400)
LARGEST_STEP = 2.2
"""Counts told for one commanded, at most: blends, slopes and lines together; and 2 counts of rounding."""


def find_table(digest: bytes) -> CorrectionTable | None:
    return TABLES.get(digest)


class Streams:
    """A bench whose two axes are at their setpoint after each cycle."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.bench = RecordBench(*PLANS, find_table=find_table)
        self.nominal = {COMMAND: 500_000, Y_COMMAND: 400_000}
        self.told: dict[PositionField, float] = {}

    def cycle(self, place: PositionField, distance: int) -> None:
        """Send the next setpoint; what the drive is told goes the same way, and reads as it was commanded."""
        counts = self.nominal[place] + distance
        if not 0 <= counts <= 1_000_000:
            return
        self.nominal[place] = counts
        assert self.bench.ask(write(place, counts)) == write(place, counts)[:5]
        told = self.bench.memory.get(place)
        self.bench.memory.put(PLACES[place], told)
        self.bench.now_ns += 4 * MS
        step = told - self.told.get(place, told)
        if place in self.told:
            ahead = step if distance >= 0 else -step
            assert -1 <= ahead <= LARGEST_STEP * abs(distance) + 2 * bool(distance), (distance, step)
            assert distance or not step
        self.told[place] = told
        assert PLACES[place].unpack(self.bench.ask(read(PLACES[place]))[2:]) == counts

    def stand(self) -> None:
        for place in PLACES:
            self.cycle(place, 0)

    def step(self) -> None:
        what = self.random.choice(
            ("move", "move", "move", "warm", "killed", "pause", "switch", "gain", "table")
        )
        getattr(self, what)()
        self.stand()

    def move(self) -> None:
        ways = {place: self.random.choice((-1, 0, 1)) * self.random.randrange(1, 60) for place in PLACES}
        for _ in range(self.random.randrange(1, 120)):
            for place, distance in ways.items():
                self.cycle(place, distance)

    def warm(self) -> None:
        set_temperature(self.bench.line.axes, "x", self.random.uniform(-10.0, 50.0), self.bench.now_ns)

    def killed(self) -> None:
        self.bench = self.bench.restarted(find_table=find_table)
        self.stand()  # where the drives are says what counts

    def cut(self) -> None:
        """The drives cannot be reached for a while."""
        self.bench.line.link_down(self.bench.now_ns)
        self.bench.now_ns += self.random.choice((1, 5_000, 300_000)) * MS
        self.bench.line.link_up(self.bench.now_ns)
        self.bench.serve()

    def look(self) -> None:
        """Do what the line does every few seconds, and what a status query does."""
        for axis in self.bench.line.axes:
            assert axis.correction.terms is not None
            axis.correction.terms.events(axis.plan.name, self.bench.now_ns)
            axis.correction.terms.status(axis.compensation, self.bench.now_ns)

    def lost(self) -> None:
        """An axis loses its reference, passes 1:1 for some setpoints of both, and is declared to have it."""
        place = self.random.choice(list(PLACES))
        axis = self.bench.line.axes[list(PLACES).index(place)]
        axis.lose_reference()
        self.told.pop(place, None)
        for _ in range(self.random.randrange(3)):
            self.cycle(self.random.choice(list(PLACES)), self.random.randrange(-5, 6))
        axis.declare_referenced()
        self.told.pop(place, None)

    def pause(self) -> None:
        self.bench.wait(self.random.choice((1.0, 600.0, 20_000.0, 2_000_000.0)))

    def switch(self) -> None:
        switch(self.bench.line.axes, self.random.choice("xy"), is_on=self.random.random() < 0.6)

    def gain(self) -> None:
        gain = Gain(self.random.choice((0.0, 0.5, 1.0)), self.random.choice((0.0, 0.5, 1.0)))
        set_gain(self.bench.line.axes, self.random.choice("xy"), gain)

    def table(self) -> None:
        table = self.random.choice((BOW, STEEP))
        set_tables(self.bench.line.axes, [TableFor(self.random.choice("xy"), "t", "csv", "")], [table])


@pytest.mark.parametrize("seed", range(12))
def test_no_setpoint_jumps_or_turns_round_and_a_standing_axis_reads_what_was_commanded(seed: int) -> None:
    streams = Streams(seed)
    for _ in range(STEPS):
        streams.step()
    streams.stand()
    corrected = {place: streams.told[place] - streams.nominal[place] for place in PLACES}
    assert any(corrected.values())
