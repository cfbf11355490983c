"""The fast path and the slow path have the same bytes and the same state as result.

Two lines get the same traffic: one remembers fast paths, the other one none, so that all its frames take the
slow path. The drive acknowledges, refuses, refuses but obeys, stays silent, or sends a wrong reply.
"""

from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.compensation.settings import Gain, Outside, OutsideKind, ThermalSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.axis.axis import Axis
from gateway.exchange.control import set_temperature, switch
from gateway.exchange.fast_path import ReadPath, WritePath
from gateway.exchange.plan import AxisPlan, CompensationMode, Reference
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Bench, Memory, axis_plan, read, stream_plan, write

CURVE = make_table([-50, 0, 40, 90], [0.0, 0.02, -0.01, 0.05], [-0.01, 0.0, -0.03, 0.02], Units.MM)
NARROW = PositionField(0x0700, RegisterType.INT16, scale=10.0)
SECOND = PositionField(0x0610, RegisterType.INT32, WordOrder.LOW_FIRST)
STATUS = 0x0522
"""Right behind the actual position: a block of three registers holds both."""
BITS = {"done": BitField(STATUS, 0), "homed": BitField(STATUS, 1), "moving": BitField(STATUS, 2)}
REPLIES = ("done", "done", "done", "done", "done", "done", "refused", "obeyed-and-refused", "silent", "odd")
OFTEN = ("status", "status", "read", "arrive", "arrive", "again", "block", "read back")
QUICK = ThermalSettings(1e-4, rate_per_min=60.0, timeout_s=2.0, hold_s=1.0)
WARM: dict[str, Any] = {"travel": (-100.0, 200.0), "thermal": QUICK}
PLANS: dict[str, AxisPlan] = {
    "stream": stream_plan(table=CURVE, bits=BITS),
    "targets": axis_plan(table=CURVE, bits=BITS),
    "stream in a register of another step": stream_plan(table=CURVE, command=(NARROW,)),
    "stream that refuses outside": stream_plan(table=CURVE, outside=Outside(OutsideKind.REFUSE)),
    "stream of gain 0 that refuses outside": stream_plan(
        table=CURVE, outside=Outside(OutsideKind.REFUSE), gain=Gain(0.0, 0.0)
    ),
    "stream in a narrow travel": stream_plan(table=CURVE, travel=(-20.0, 20.0), travel_margin=0.01),
    "targets after the homed bit": axis_plan(table=CURVE, bits=BITS, referenced=Reference.DRIVE_BIT),
    "stream after the homed bit": stream_plan(table=CURVE, bits=BITS, referenced=Reference.DRIVE_BIT),
    "dry-run": stream_plan(table=CURVE, bits=BITS, compensation=CompensationMode.SHADOW),
    "stream without a table": stream_plan(table=None, bits=BITS),
    "targets without a table": axis_plan(table=None, bits=BITS),
    "off": stream_plan(table=CURVE, bits=BITS, compensation=CompensationMode.OFF),
    "without reads": axis_plan(table=CURVE, bits=BITS, added_frames=False),
    "high words first": stream_plan(
        table=CURVE, command=(PositionField(0x0606, RegisterType.INT32, WordOrder.HIGH_FIRST),)
    ),
    "targets in two registers": axis_plan(table=CURVE, bits=BITS, command=(COMMAND, SECOND)),
    "stream in two registers": stream_plan(table=CURVE, command=(COMMAND, SECOND)),
    "stream of a warm screw": stream_plan(table=CURVE, bits=BITS, **WARM),
    "targets of a warm screw": axis_plan(table=CURVE, bits=BITS, **WARM),
    "stream of floats": stream_plan(table=CURVE, command=(PositionField(0x0606, RegisterType.FLOAT32),)),
}


def state_of(axis: Axis) -> dict[str, Any]:
    """Return everything that may influence the next frame, without the identity of curves."""
    compensation, actual = axis.compensation, axis.motion.actual
    state, readback = compensation.state, compensation.readback
    fields = [
        (f.nominal_words, f.corrected_words, f.completeness, f.epoch, f.may_be_corrected) for f in axis.fields
    ]
    return {
        "state": state._replace(spec=None, previous=None),  # type: ignore[arg-type]
        "blends": (state.previous is None, state.spec is compensation._requested),
        "accepted": compensation.accepted,
        "readback": (readback.anchor_counts, readback.fade, readback.correction_map.correction(12.345)),
        "fields": fields,
        "flags": (
            axis.motion.state, axis.motion.is_moving, axis.reference.state, axis.motion.reported,
            axis.reach.silent_since_ns, axis.reference.is_referenced, axis.is_unsure,
        ),
        "actual": None if actual is None else (actual.counts, actual.seen_ns),
        "unproven": None if axis.motion.unacknowledged is None else axis.motion.unacknowledged[1:4],
    }  # fmt: skip


class Twins:
    """The same traffic over a line with fast paths and over one without."""

    def __init__(self, plan: AxisPlan) -> None:
        self.short = Bench(plan)
        self.long = Bench(plan, remembered_paths=0)
        self.plan = plan
        self.place = plan.command[0]
        self.counts = 0
        self.told = 0
        """What was written into the first register last."""
        self.ways = {WritePath: 0, ReadPath: 0}

    @property
    def benches(self) -> tuple[Bench, Bench]:
        return self.short, self.long

    def step(self, what: str, amount: int, reply: str) -> None:
        """Do one thing to both and compare."""
        if what in ("move", "block", "move elsewhere"):
            self.counts += amount
        if what in ("move", "block"):
            self.told = self._raw()
        requests = {
            "move": write(self.place, self._raw()),
            "again": write(self.place, self.told),
            "move elsewhere": write(self.plan.command[-1], self._raw()),
            "block": self._block(),
            "part": b"\x06" + self.place.address.to_bytes(2, "big") + amount.to_bytes(2, "big", signed=True),
            "read": read(ACTUAL),
            "status": b"\x03" + ACTUAL.address.to_bytes(2, "big") + b"\0\x03",
            "read back": read(self.place),
            "elsewhere": bytes((3, 0x10, 0, 0, 2)),
        }
        if what in requests:
            self.ask(requests[what], reply)
        elif what == "arrive":
            self.arrive(amount)
        elif what == "warm":
            for bench in self.benches if self.plan.thermal is not None else ():
                set_temperature(bench.line.axes, "x", 20.0 + amount / 30.0, bench.now_ns)
        elif what == "switch":
            for bench in self.benches:
                if self.plan.table is not None:
                    switch(bench.line.axes, "x", is_on=bool(amount % 2))
        else:
            self.pull_the_cable()
        self.compare()

    def _raw(self) -> int:
        return int(self.counts / self.place.scale)

    def _block(self) -> bytes:
        """The target in the middle of other words."""
        data = b"\x11\x11" + self.place.pack(self._raw()) + b"\x22\x22"
        head = (self.place.address - 1).to_bytes(2, "big") + bytes((0, len(data) // 2, len(data)))
        return b"\x10" + head + data

    def pull_the_cable(self) -> None:
        for bench in self.benches:
            bench.line.link_down(bench.now_ns)
            bench.link.sent.clear()
            bench.now_ns += 5 * MS
            bench.line.link_up(bench.now_ns)
            bench.serve()

    def arrive(self, amount: int) -> None:
        """Let the axis arrive, or go a part of the way; its status shows it, or not."""
        for bench in self.benches:
            told, here = bench.memory.get(self.place) * self.place.scale, bench.memory.get(ACTUAL)
            is_there = amount > 0
            if abs(told) < 1e9:  # half a float may be anything
                bench.memory.put(ACTUAL, round(told if is_there else (told + here) / 2))
            bench.memory.words[STATUS] = (0b011 if is_there else 0b110) if amount % 7 else 0
            bench.wait(abs(amount))

    def ask(self, pdu: bytes, reply: str) -> None:
        for bench in self.benches:
            bench.send(pdu)
            if pdu[0] != 3:
                bench.serve_reads()
        self.compare()
        current = self.short.line._transactions.current
        if current is not None and type(current.path) in self.ways:
            self.ways[type(current.path)] += 1
        for bench in self.benches:
            self._serve(bench, reply)

    @staticmethod
    def _serve(bench: Bench, reply: str) -> None:
        while bench.link.sent:
            unit_id, pdu = bench.link.sent.pop(0)
            bench.seen.append(pdu)
            answer = bench.memory.answer(pdu) if reply != "refused" else b""
            bench.now_ns += MS
            if reply == "silent":
                bench.now_ns += 5_000 * MS
                bench.line.tick(bench.now_ns)
                bench.now_ns += 5_000 * MS
                bench.line.tick(bench.now_ns)
            elif reply == "done":
                bench.line.reply(unit_id, answer, bench.now_ns)
            elif reply == "odd":
                bench.line.reply(unit_id, answer[:2] + b"\xff\xff", bench.now_ns)
            else:
                bench.line.reply(unit_id, bytes((pdu[0] | 0x80, 4)), bench.now_ns)

    def compare(self) -> None:
        short, long = self.benches
        assert short.link.sent == long.link.sent
        assert short.seen == long.seen
        assert short.port.replies == long.port.replies
        assert short.events == long.events
        assert short.line.counters == long.line.counters
        assert short.line.deadline_ns == long.line.deadline_ns
        assert state_of(short.line.axes[0]) == state_of(long.line.axes[0])
        for bench in self.benches:
            bench.port.replies.clear()


STEPS = st.tuples(
    st.sampled_from(
        ["move"] * 6 + ["block", "again", "part", "read", "status", "status", "read back", "elsewhere"]
        + ["arrive"] * 3 + ["move elsewhere", "switch", "cable", "warm"]
    ),
    st.one_of(st.integers(1, 900), st.integers(-900, 900)),
    st.sampled_from(REPLIES),
)  # fmt: skip


@pytest.mark.parametrize("name", PLANS)
@settings(max_examples=60)
@given(steps=st.lists(STEPS, max_size=40))
def test_the_fast_and_the_slow_path_have_equal_results(name: str, steps: list[tuple[str, int, str]]) -> None:
    twins = Twins(PLANS[name])
    for what, amount, reply in steps:
        twins.step(what, amount, reply)


@pytest.mark.parametrize(
    ("name", "writes", "reads"),
    [
        ("stream", 200, 100),
        ("targets", 30, 100),
        ("targets in two registers", 30, 100),
        ("stream in two registers", 100, 100),
        ("stream after the homed bit", 100, 100),
        ("dry-run", 0, 100),
        ("stream of a warm screw", 200, 100),
        ("targets of a warm screw", 30, 100),
    ],
)
def test_a_long_run_takes_the_fast_path_often(name: str, writes: int, reads: int) -> None:
    random = Random(4)
    twins = Twins(PLANS[name])
    for _ in range(1500):
        sense = 1 if twins.counts < -30_000 else -1 if twins.counts > 30_000 else random.choice((1, 1, 1, -1))
        what = random.choice(
            ("move",) * 8
            + (
                "move elsewhere",
                "status",
                "status",
                "read",
                "arrive",
                "arrive",
                "again",
                "block",
                "read back",
            )
        )
        twins.step(
            what,
            sense * random.randrange(1, 700),
            "done" if random.random() < 0.95 else random.choice(REPLIES),
        )
    assert twins.ways[WritePath] >= writes
    assert twins.ways[ReadPath] >= reads
    if not writes:
        assert twins.ways[WritePath] == 0


def test_the_position_is_read_before_a_repeat_if_the_axis_may_have_moved() -> None:
    twins = Twins(PLANS["targets"])
    for counts in (1000, 1000, 1000):
        for step in ("move", counts), ("arrive", -1), ("status", 0), ("arrive", 1), ("status", 0):
            twins.step(*step, "done")
    for bench in twins.benches:
        bench.memory.words[STATUS] = 0b110  # it moves again, and nobody told it to
    twins.step("status", 0, "done")
    before = len(twins.short.seen)
    twins.step("again", 0, "done")
    assert [pdu[0] for pdu in twins.short.seen[before:]] == [3, 16]


@pytest.mark.parametrize("remembered_paths", [4096, 0])
def test_the_same_words_after_a_target_in_another_register_are_no_repeat(remembered_paths: int) -> None:
    bench = Bench(axis_plan(command=(COMMAND, SECOND), bits=BITS), remembered_paths=remembered_paths)
    told = []
    for place, counts in ((COMMAND, 1000), (COMMAND, 4000), (SECOND, 9000), (COMMAND, 4000)):
        bench.move(counts, place=place)
        told.append(bench.memory.get(place))
        bench.memory.put(ACTUAL, told[-1])
        bench.memory.words[STATUS] = 0b011
        bench.ask(b"\x03" + ACTUAL.address.to_bytes(2, "big") + b"\0\x03")
    assert told == [1010, 4010, 9010, 3990]  # it comes back from 9000: the backward branch


def test_the_position_is_read_before_a_target_that_another_register_replaced_is_repeated() -> None:
    bench = Bench(axis_plan(command=(COMMAND, SECOND), bits=BITS, max_speed=0.0))
    for place, counts in ((COMMAND, 1000), (COMMAND, 4000), (SECOND, 9000)):
        bench.move(counts, place=place)
    bench.seen.clear()
    bench.move(4000)
    assert [pdu[0] for pdu in bench.seen] == [3, 16]
    assert bench.memory.get(COMMAND) == 3990
    assert not bench.line.axes[0].is_unsure


def test_after_a_long_silence_one_request_takes_the_slow_path() -> None:
    twins = Twins(PLANS["stream"])
    for _ in range(30):
        twins.step("move", 500, "done")
    assert twins.ways[WritePath] > 0
    twins.step("elsewhere", 0, "silent")
    assert twins.short.line.axes[0].reach.silent_since_ns is not None
    written = twins.ways[WritePath]
    twins.step("move", 500, "done")
    assert twins.ways[WritePath] == written
    twins.step("move", 500, "done")
    assert twins.ways[WritePath] == written + 1


def test_a_request_whose_length_contradicts_its_head_takes_the_slow_path() -> None:
    bench = Bench(stream_plan(table=CURVE))
    bench.ask(write(COMMAND, 0))
    good = bytes.fromhex("10 1000 0002 04 0001 0002")
    assert bench.ask(good) == good[:5]
    bench.send(
        good + b"\0"
    )  # no word of it is mapped, so it passes as it is, but nobody remembers it as usual
    assert bench.line._transactions.current is not None
    assert bench.line._transactions.current.path is None


def test_no_more_paths_are_remembered_than_configured() -> None:
    bench = Bench(stream_plan(table=CURVE), remembered_paths=3)
    for address in range(0x1000, 0x1010):
        bench.ask(bytes((3,)) + address.to_bytes(2, "big") + b"\0\x01")
        assert sum(map(len, bench.line._units._paths)) <= 3


def test_the_drive_of_the_bench_acknowledges_and_keeps_a_write() -> None:
    memory = Memory()
    assert memory.answer(write(COMMAND, 77)) == write(COMMAND, 77)[:5]
    assert memory.get(COMMAND) == 77
