"""Two warm axes that act on each other, interrupted in every way: each target is compared with a model."""

from dataclasses import replace
from random import Random

import pytest

from gateway.compensation.fingerprint import table_digest
from gateway.compensation.settings import Gain, ThermalSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.axis.axis import Axis
from gateway.exchange.commands import SetReference, TableFor
from gateway.exchange.control import ControlError, set_gain, set_tables, set_temperature, switch
from gateway.exchange.plan import AxisPlan, CrossPlan, Reference
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import MS, axis_plan, read, write
from tests.exchange.record_bench import RecordBench
from tests.exchange.terms_model import Heat, Model, Nearby

BOW = make_table([0, 300, 1000], [0.02, -0.05, 0.08], [0.0, -0.06, 0.05], Units.MM)
STEEP = make_table([0, 100, 900, 1000], [0.0, 0.5, -0.5, 0.08], [0.03, 0.55, -0.46, 0.08], Units.MM)
FLAT = make_table([0, 1000], [0.0, 0.0], [0.0, 0.0], Units.MM)
TABLES = (BOW, STEEP, FLAT)
BY_DIGEST = {table_digest(table): table for table in TABLES}
KINDS = (
    (RegisterType.INT32, 1000.0, 0.0),
    (RegisterType.INT32, -800.0, 5000.0),
    (RegisterType.FLOAT32, 1000.0, 0.0),
    (RegisterType.INT16, 30.0, -15_000.0),
    (RegisterType.UINT16, 60.0, 100.0),
    (RegisterType.INT64, 20_000.0, 7.0),
)
"""Type, counts per mm and counts at 0: small registers nearly filled by 1 m, and a drive that counts down."""
LARGEST_MM = 12.0
"""More than tables, 40 K of the steepest alpha and the other axis add up to."""
OTHERS = ("warm", "rubbish", "pause", "back", "onoff", "gains", "reload", "stopped", "lost", "found", "cut")
DEEDS = ("move", "move", "move", "near", "near", "again", "silent", "refused", "killed", "changed", *OTHERS)


class Machine:
    """A bench and the models of its two axes."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.models = {name: self._model(name, base) for name, base in (("x", 0x600), ("y", 0x700))}
        self.kinds = {
            name: self.random.choice((Reference.ABSOLUTE, Reference.SET_POSITION)) for name in self.models
        }
        self.bench = RecordBench(*map(self.plan, self.models.values()), find_table=BY_DIGEST.get)
        for model in self.models.values():
            self.bench.memory.put(model.actual, self.counts(model))
            self.bench.line.command(SetReference(axis=model.name), self.bench.now_ns)
        self.compared = 0

    # --- what is configured ----------------------------------------------------------------------------

    def _model(self, name: str, base: int) -> Model:
        kind, counts_per_unit, zero_counts = self.random.choice(KINDS)
        return Model(
            name,
            PositionField(base, kind, WordOrder.LOW_FIRST),
            PositionField(base + 0x20, kind, WordOrder.LOW_FIRST),
            counts_per_unit,
            zero_counts,
            self.random.choice(TABLES),
            self.random.choice((None, Heat(self._thermal()), Heat(self._thermal()))),
            self.random.choice((None, Nearby(self._cross(name)), Nearby(self._cross(name)))),
        )

    def _thermal(self) -> ThermalSettings:
        choice = self.random.choice
        return ThermalSettings(
            alpha=choice((11.5e-6, 3e-5, 1e-4)),
            reference=choice((20.0, 25.0)),
            fixed_at=choice((0.0, 100.0, -200.0)),
            timeout_s=choice((5.0, 60.0)),
            hold_s=choice((0.0, 600.0)),
            rate_per_min=choice((2.0, 60.0)),
        )

    def _cross(self, name: str) -> CrossPlan:
        values = tuple(self.random.uniform(-0.4, 0.4) for _ in range(3))
        other = "y" if name == "x" else "x"
        return CrossPlan(other, (0.0, 400.0, 1000.0), values, fresh_s=self.random.choice((5.0, 60.0)))

    def plan(self, model: Model) -> AxisPlan:
        return axis_plan(
            name=model.name,
            command=(model.command,),
            actual=(model.actual,),
            table=model.table,
            gain=model.gain,
            referenced=self.kinds[model.name],
            travel=(0.0, 1000.0),
            max_correction=20.0,
            travel_margin=20.0,
            max_speed=0.0,
            counts_per_unit=model.counts_per_unit,
            zero_counts=model.zero_counts,
            hysteresis=2 / abs(model.counts_per_unit),
            thermal=None if model.heat is None else model.heat.settings,
            cross=() if model.nearby is None else (model.nearby.plan,),
        )

    # --- what it looks at ------------------------------------------------------------------------------

    def pick(self) -> Model:
        return self.models[self.random.choice("xy")]

    def axis(self, model: Model) -> Axis:
        return next(axis for axis in self.bench.line.axes if axis.plan.name == model.name)

    def counts(self, model: Model) -> int:
        ends = (model.zero_counts + model.counts_per_unit * x for x in (LARGEST_MM, 1000.0 - LARGEST_MM))
        low, high = sorted(map(int, ends))
        return self.random.randint(low, high)

    def read(self, model: Model) -> float:
        at_ns = self.bench.now_ns
        found = model.actual.unpack(self.bench.ask(read(model.actual))[2:])
        model.read = (found, at_ns)
        return found

    def learn(self, model: Model) -> None:
        """Copy to the model which targets and temperatures count, if only the gateway can decide that."""
        axis = self.axis(model)
        accepted, terms = axis.compensation.accepted, axis.correction.terms
        model.is_referenced = axis.reference.is_referenced
        model.nominal = None if accepted is None else accepted.nominal_counts
        model.told = None if accepted is None else accepted.corrected_counts
        model.read = None
        if axis.motion.actual is not None:
            model.read = axis.motion.nominal_of(axis.motion.actual.counts), axis.motion.actual.seen_ns
        if model.heat is not None:
            assert terms is not None
            assert terms.thermal is not None
            known = terms.thermal
            goal = None if known.celsius is None else known.celsius - known.settings.reference
            heard_ns = known._taken_ns if known._is_known else None
            model.heat = Heat(known.settings, known.difference, goal, heard_ns, known._at_ns)
            model.heat.is_of_another_alpha = known._is_known and known._counts_at_once
        if model.nearby is not None:
            assert terms is not None
            lost = terms._cross, terms._held_cross, terms._lost_ns
            model.nearby = Nearby(model.nearby.plan, *lost)

    # --- targets ---------------------------------------------------------------------------------------

    def go(self, model: Model, counts: float) -> None:
        """Command a target, check the readings on its way, and let the axis arrive."""
        bench, memory = self.bench, self.bench.memory
        bench.wait(600.0)
        before = self.read(model)
        line = (0.0, 0.0)
        if counts != model.nominal:
            other = self.models["y" if model.name == "x" else "x"]
            line = model.line(other, bench.now_ns)
        start = memory.get(model.actual)
        assert bench.ask(write(model.command, counts)) == write(model.command, counts)[:5]
        told = memory.get(model.command)
        if counts == model.nominal:
            assert told == model.told  # M4
        else:
            allowed = model.may_be_told(counts, line)
            slack = model.slack() if model.is_on and model.is_referenced else 0.0
            assert min(abs(told - each) for each in allowed) <= slack, (told, allowed)
            self.compared += 1
        if model.is_referenced and model.nominal is not None and told != start:
            self._follow(model, (before, counts), (start, told))
        memory.put(model.actual, told)
        assert self.read(model) == counts
        model.nominal, model.told = counts, told

    def _follow(self, model: Model, nominal: tuple[float, float], drive: tuple[float, float]) -> None:
        """Check that readings do not jump at standstill, and do not reverse during a move."""
        grain = 0.2 if model.actual.type.is_float else 0.0
        readings = [self.read(model)]
        assert abs(readings[0] - nominal[0]) <= grain
        for share in sorted(self.random.random() for _ in range(4)):
            counts = drive[0] + share * (drive[1] - drive[0])
            self.bench.memory.put(model.actual, counts if grain else round(counts))
            readings.append(self.read(model))
        if abs(nominal[1] - nominal[0]) > 50:
            ahead = 1 if nominal[1] > nominal[0] else -1
            for one, next_one in zip(readings, [*readings[1:], nominal[1]], strict=True):
                assert ahead * (next_one - one) >= -grain, readings

    def move(self) -> None:
        model = self.pick()
        self.go(model, self.counts(model))

    def near(self) -> None:
        model = self.pick()
        if model.nominal is not None:
            ends = (model.zero_counts + model.counts_per_unit * x for x in (LARGEST_MM, 1000.0 - LARGEST_MM))
            low, high = sorted(map(int, ends))
            self.go(model, min(high, max(low, model.nominal + self.random.choice((-30, -2, -1, 1, 2, 30)))))

    def again(self) -> None:
        model = self.pick()
        if model.nominal is not None:
            self.go(model, model.nominal)

    # --- what comes between ----------------------------------------------------------------------------

    def hear(self, model: Model, celsius: float) -> None:
        if model.heat is not None:
            set_temperature(self.bench.line.axes, model.name, celsius, self.bench.now_ns)
            model.heat.hear(celsius, self.bench.now_ns)

    def warm(self) -> None:
        self.hear(self.pick(), self.random.uniform(-14.0, 59.0))

    def back(self) -> None:
        """A sensor that is heard again after hours, and says something else."""
        self.bench.wait(self.random.choice((7e5, 2e7)))
        model = self.pick()
        if model.heat is not None:
            self.hear(model, model.heat.settings.reference + self.random.choice((-40.0, 0.0, 40.0)))

    def rubbish(self) -> None:
        model = self.pick()
        if model.heat is not None:
            celsius = self.random.choice((float("nan"), float("inf"), 3000.0, -300.0))
            with pytest.raises(ControlError):
                set_temperature(self.bench.line.axes, model.name, celsius, self.bench.now_ns)

    def pause(self) -> None:
        self.bench.wait(self.random.choice((100.0, 1e4, 7e4, 7e5, 2e7)))

    def onoff(self) -> None:
        model = self.pick()
        model.is_on = not model.is_on
        switch(self.bench.line.axes, model.name, is_on=model.is_on)

    def gains(self) -> None:
        model = self.pick()
        model.gain = Gain(self.random.choice((0.0, 0.3, 1.0)), self.random.choice((0.0, 0.7, 1.0)))
        set_gain(self.bench.line.axes, model.name, model.gain)

    def reload(self) -> None:
        model = self.pick()
        model.table = self.random.choice(TABLES)
        set_tables(self.bench.line.axes, [TableFor(model.name, "t", "csv", "")], [model.table])

    def stopped(self) -> None:
        """Something else decides where it is."""
        model = self.pick()
        self.axis(model).motion.displace(keeps_branch=self.random.random() < 0.5)
        model.nominal = None

    def lost(self) -> None:
        model = self.pick()
        self.axis(model).lose_reference()
        self.learn(model)

    def found(self) -> None:
        for model in self.models.values():
            if not model.is_referenced:
                self.bench.line.command(SetReference(axis=model.name), self.bench.now_ns)
                self.read(model)
                self.learn(model)

    def cut(self) -> None:
        self.bench.line.link_down(self.bench.now_ns)
        self.bench.now_ns += self.random.choice((1, 5_000, 400_000)) * MS
        self.bench.line.link_up(self.bench.now_ns)
        self.bench.serve()
        for model in self.models.values():
            self.learn(model)

    def _send(self, model: Model) -> None:
        """Send a target without letting its drive answer."""
        self.bench.wait(700.0)
        counts = self.counts(model)
        other = self.models["y" if model.name == "x" else "x"]
        model.line(other, self.bench.now_ns)
        self.bench.send(write(model.command, counts))
        self.bench.serve_reads()

    def silent(self) -> None:
        """Send a target that the drive obeys without an answer."""
        model, bench = self.pick(), self.bench
        self._send(model)
        for _, pdu in bench.link.sent:
            bench.memory.answer(pdu)
        bench.link.sent.clear()
        bench.wait(2000.0)
        bench.wait(2000.0)
        bench.serve()
        bench.port.replies.clear()
        bench.memory.put(model.actual, bench.memory.get(model.command))
        for each in self.models.values():
            self.read(each)
            self.learn(each)

    def refused(self) -> None:
        model, bench = self.pick(), self.bench
        self._send(model)
        for unit_id, pdu in bench.link.sent:
            bench.line.reply(unit_id, bytes((pdu[0] | 0x80, 4)), bench.now_ns)
        bench.link.sent.clear()
        bench.port.replies.clear()
        self.read(model)
        self.learn(model)

    def killed(self) -> None:
        kept = {}
        for model in self.models.values():
            spec = self.axis(model).compensation.state.spec
            kept[model.name] = spec.tilt if model.is_on and model.nominal is not None else 0.0
            model.is_on = True  # as it is configured
        plans = map(self.plan, self.models.values())
        self.bench = self.bench.restarted(*plans, find_table=BY_DIGEST.get)
        for model in self.models.values():
            self.learn(model)
            tilt = kept[model.name]
            if model.heat is None or not tilt or model.nominal is None:
                continue
            kelvin = -tilt / model.heat.settings.alpha
            assert model.heat.kelvin == pytest.approx(kelvin, abs=1e-9)
            assert model.heat.is_of_another_alpha is (abs(kelvin) > 40.0 + 1e-6)

    def changed(self) -> None:
        """A restart with another configuration."""
        model = self.pick()
        what = self.random.choice(("thermal", "alpha", "cross", "no thermal", "no cross"))
        if what == "thermal":
            model.heat = Heat(self._thermal())
        elif what == "alpha" and model.heat is not None:
            model.heat = Heat(replace(model.heat.settings, alpha=self.random.choice((11.5e-6, 1e-4))))
        elif what == "cross":
            model.nearby = Nearby(self._cross(model.name))
        elif what == "no thermal":
            model.heat = None
        elif what == "no cross":
            model.nearby = None
        self.killed()

    def step(self) -> None:
        operation = self.random.choice(DEEDS)
        before = [(m.nominal, self.bench.memory.get(m.command)) for m in self.models.values()]
        getattr(self, operation)()
        for model, (nominal, told) in zip(self.models.values(), before, strict=True):
            if model.nominal is not None and model.nominal == nominal:
                assert self.bench.memory.get(model.command) == told, operation  # nothing moves by itself
            if model.nominal is not None and model.is_referenced:
                assert self.read(model) == model.nominal, operation


@pytest.mark.parametrize("seed", range(16))
def test_every_target_is_corrected_as_the_document_says_and_every_standing_axis_reads_it(seed: int) -> None:
    machine = Machine(seed)
    for model in machine.models.values():
        machine.go(model, machine.counts(model))
    for _ in range(150):
        machine.step()
    assert machine.compared > 15
