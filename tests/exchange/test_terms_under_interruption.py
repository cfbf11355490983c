"""Whatever comes between two targets: a standing axis reads what was commanded, and nothing adds up."""

from random import Random

import pytest

from gateway.compensation.settings import ThermalSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.control import set_temperature, switch
from gateway.exchange.plan import CrossPlan
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, axis_plan, read, write
from tests.exchange.record_bench import RecordBench
from tests.exchange.test_cross_terms import Y_ACTUAL, Y_COMMAND

ALPHA = 1e-4
TABLE = make_table([0, 300, 1000], [0.02, -0.05, 0.08], [0.0, -0.06, 0.05], Units.MM)
PLANS = (
    axis_plan(
        table=TABLE,
        travel=(0.0, 1000.0),
        max_correction=10.0,
        thermal=ThermalSettings(ALPHA, fixed_at=100.0, rate_per_min=60.0),
        cross=(CrossPlan("y", (0.0, 1000.0), (0.0, 0.5), fresh_s=5.0),),
    ),
    axis_plan(name="y", command=(Y_COMMAND,), actual=(Y_ACTUAL,), table=None, travel=(0.0, 1000.0)),
)


class Machine:
    """A bench that is warmed, cooled, interrupted and killed; and what its controller believes of x."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.bench = RecordBench(*PLANS)
        self.nominal = 0

    def step(self) -> None:
        what = self.random.choice(
            ("move", "move", "warm", "other", "lost", "killed", "again", "pause", "off")
        )
        getattr(self, what)()

    def move(self) -> None:
        self.nominal = self.random.randrange(0, 1_000_001)
        self.bench.move(self.nominal)

    def warm(self) -> None:
        set_temperature(self.bench.line.axes, "x", self.random.uniform(-10.0, 50.0), self.bench.now_ns)

    def other(self) -> None:
        counts = self.random.randrange(0, 1_000_001)
        self.bench.ask(write(Y_COMMAND, counts))
        self.bench.memory.put(Y_ACTUAL, self.bench.memory.get(Y_COMMAND))

    def lost(self) -> None:
        """A target whose reply is lost, and which the drive obeyed."""
        self.nominal = self.random.randrange(0, 1_000_001)
        self.bench.send(write(COMMAND, self.nominal))
        self.bench.serve_reads()
        for _, pdu in self.bench.link.sent:
            self.bench.memory.answer(pdu)
        self.bench.link.sent.clear()
        self.bench.wait(2000.0)
        self.bench.wait(2000.0)
        self.bench.port.replies.clear()
        self.bench.memory.put(ACTUAL, self.bench.memory.get(COMMAND))
        self.bench.move(self.nominal)

    def killed(self) -> None:
        self.bench = self.bench.restarted()

    def again(self) -> None:
        told = self.bench.memory.get(COMMAND)
        self.bench.move(self.nominal)
        assert self.bench.memory.get(COMMAND) == told

    def pause(self) -> None:
        self.bench.wait(self.random.choice((1.0, 600.0, 20_000.0, 2_000_000.0)))

    def off(self) -> None:
        for is_on in (False, True):
            switch(self.bench.line.axes, "x", is_on=is_on)


@pytest.mark.parametrize("seed", range(8))
def test_a_standing_axis_reads_what_was_commanded_whatever_came_between(seed: int) -> None:
    machine = Machine(seed)
    machine.move()
    for _ in range(60):
        told = machine.bench.memory.get(COMMAND)
        before = machine.nominal
        machine.step()
        if machine.nominal == before:
            assert machine.bench.memory.get(COMMAND) == told  # nothing moves by itself
        assert ACTUAL.unpack(machine.bench.ask(read(ACTUAL))[2:]) == machine.nominal
    # At last the sensor says what the table was measured at, and y stands at 0: the table alone is left.
    bench = machine.bench
    for _ in range(3):
        set_temperature(bench.line.axes, "x", 20.0, bench.now_ns)
        bench.now_ns += 50_000 * MS
    set_temperature(bench.line.axes, "x", 20.0, bench.now_ns)
    bench.ask(write(Y_COMMAND, 0))
    bench.move(500_000)
    assert bench.reach(300_000) == 299_940
    assert bench.reach(1_000_000) == 1_000_080
