"""A gateway killed in a stream at any instant: the drive continues without a step, or an event reports it."""

import random
from itertools import pairwise

import pytest

from gateway.compensation.settings import Reversal, ReversalKind
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.axis.record_layout import BOOT, HEADER, RecordSlots
from gateway.exchange.plan import AxisPlan
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Link, Memory, axis_plan, stream_plan, write
from tests.exchange.record_bench import BOOT_ID, RecordBench, Records
from tests.soak import repeated

LIFTED = make_table([0, 30, 60, 100], [0.2, 0.3, 0.25, 0.3], [-0.2, -0.1, -0.16, -0.2], Units.MM)
INSTANTS = ("between", "sent", "taken")
CYCLE_MS = 4
STEP = 40
"""Counts from one setpoint to the next: 10 mm/s."""


class Follower(Memory):
    """A drive that follows its setpoints by so many counts in a millisecond; None: it is there
    immediately."""

    def __init__(self, counts_per_ms: float | None, at: int) -> None:
        super().__init__()
        self.counts_per_ms = counts_per_ms
        self.place = float(at)
        self.put(COMMAND, at)
        self.put(ACTUAL, at)

    def advance(self, ms: float) -> None:
        target = self.get(COMMAND)
        way = target - self.place
        most = abs(way) if self.counts_per_ms is None else self.counts_per_ms * ms
        self.place += max(-most, min(most, way))
        self.put(ACTUAL, round(self.place))

    def answer(self, pdu: bytes) -> bytes:
        self.advance(1.0)
        return super().answer(pdu)

    def copy(self) -> "Follower":
        """Return a copy of this drive: the same position and the same setpoint."""
        copied = Follower(self.counts_per_ms, 0)
        copied.words, copied.place = dict(self.words), self.place
        return copied


class Line:
    """A stream to such a drive through a gateway that keeps records."""

    def __init__(
        self, plan: AxisPlan, drive: Follower, records: Records | None = None, now_ns: int = 0
    ) -> None:
        self.plan, self.drive = plan, drive
        self.bench = RecordBench(plan, records=records, memory=drive, start_ns=now_ns or 1_000 * MS)

    def follow(self, counts: int) -> float:
        """Feed one setpoint; return the setpoint in the drive."""
        if not self.bench.link.sent:  # else it left before the kills of this cycle
            self.bench.send(write(COMMAND, counts))
        self.bench.serve()
        self.bench.port.take()
        self.drive.advance(CYCLE_MS - 1)
        self.bench.now_ns += (CYCLE_MS - 1) * MS
        return self.drive.get(COMMAND)

    def killed(self, counts: int, instant: str, away_ms: int) -> "Line":
        """Kill the gateway within the cycle of this setpoint; a new one starts so much later.

        The new gateway has a drive of its own: this one may be killed again, later in the cycle, and may also
        continue.
        """
        bench, drive = self.bench, self.drive.copy()
        if instant != "between":
            if not bench.link.sent:
                bench.send(write(COMMAND, counts))
            if instant == "taken":
                [(_, pdu)] = bench.link.sent
                drive.answer(pdu)
        records = bench.records.copy()
        drive.advance(away_ms)
        return Line(self.plan, drive, records, bench.now_ns + away_ms * MS)


def setpoints(seed: int, number: int = 240) -> list[int]:
    """A walk with reversals and dwells."""
    rng, at, sense = random.Random(seed), 50_000, 1
    found: list[int] = []
    while len(found) < number:
        if not rng.randrange(40) or not 20_000 < at + sense * STEP < 80_000:
            sense = -sense
        at += 0 if not rng.randrange(10) else sense * STEP
        found.append(at)
    return found


@pytest.mark.parametrize("counts_per_ms", [None, 30.0, 11.0], ids=["at once", "30 mm/s", "11 mm/s"])
def test_the_correction_continues_within_a_step_of_its_blend(counts_per_ms: float | None) -> None:
    """Killed between two setpoints, with one sent, and with one executed; the run that is not killed is the
    reference."""
    plan = stream_plan(
        table=LIFTED, reload_distance=2.0, reversal=Reversal(ReversalKind.DISTANCE, 4.0), max_slope=0.2
    )
    for seed in range(repeated(120)):
        rng = random.Random(seed)
        walk = setpoints(seed)
        at, away_ms = rng.randrange(120, 230), rng.randrange(0, 60)
        line = Line(plan, Follower(counts_per_ms, 50_000))
        told = [line.follow(counts) for counts in walk[:at]]
        killed = {instant: line.killed(walk[at], instant, away_ms) for instant in INSTANTS}
        told += [line.follow(counts) for counts in walk[at:]]
        largest = max(
            abs(b - a - (q - p)) for (a, b), (p, q) in zip(pairwise(told), pairwise(walk), strict=True)
        )
        for instant, again in killed.items():
            assert again.bench.kinds().count("restored") == 1, (instant, again.bench.told)
            for counts, wanted in zip(walk[at:], told[at:], strict=True):
                assert abs(again.follow(counts) - wanted) <= largest + 1, (instant, seed)


def lagging() -> Line:
    """Return a line whose drive is two millimetres behind its setpoints when the gateway is killed."""
    line = Line(stream_plan(table=LIFTED, home_approach=1), Follower(5.0, 20_000))
    for counts in range(20_000, 24_000, STEP):
        line.follow(counts)
    assert line.drive.get(COMMAND) - line.drive.place > 1_500
    return line


def test_a_record_counts_for_a_drive_that_lags_and_comes_nearer() -> None:
    again = lagging().killed(24_000, "taken", 20)
    assert again.bench.told[0].startswith("goes on from its record")
    assert 2 <= len(again.bench.seen) <= 10


def test_a_record_does_not_count_for_a_drive_that_was_moved_meanwhile_and_is_at_rest() -> None:
    line = lagging()
    line.drive.counts_per_ms = 0.0
    again = line.killed(24_000, "taken", 20)
    assert again.bench.told[0].startswith("the drive is at ")
    assert again.bench.told[0].endswith("it starts without its record")
    assert len(again.bench.seen) <= 110  # 100 ms of looking, a reply takes one


@pytest.mark.parametrize("spoil", ["later", "other boot", "no boot"])
def test_an_old_record_counts_only_if_the_drive_is_at_its_position(spoil: str) -> None:
    line = lagging()
    if spoil == "other boot":
        (buffer,) = line.bench.records.buffers.values()
        buffer[HEADER.size] ^= 1
    if spoil == "no boot":
        (buffer,) = line.bench.records.buffers.values()
        buffer[HEADER.size : HEADER.size + BOOT.size + 4] = bytes(BOOT.size + 4)
    line.drive.counts_per_ms = 0.01
    again = line.killed(24_000, "taken", 5_001 if spoil == "later" else 20)
    assert again.bench.told[0].startswith("the drive is at ")
    assert len(again.bench.seen) == 1


def test_a_record_contains_its_boot_id() -> None:
    line = lagging()
    (buffer,) = line.bench.records.buffers.values()
    for at in range(HEADER.size, HEADER.size + BOOT.size + 4):
        for flip in (1, 0x80):
            buffer[at] ^= flip
            record = RecordSlots(memoryview(buffer), bytes(16), BOOT_ID).read()
            assert record is not None
            assert not record.is_of_this_boot
            buffer[at] ^= flip
    record = RecordSlots(memoryview(buffer), bytes(16), BOOT_ID).read()
    assert record is not None
    assert record.is_of_this_boot


class Watching(Link):
    """Reads the record at the moment in which a frame is sent."""

    def __init__(self, records: Records) -> None:
        super().__init__()
        self._records = records
        self.checked = 0

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        if pdu[0] == 16:
            record = self._records.read()
            if record is not None:  # of the first setpoint there is nothing to go on from yet
                assert record.unacknowledged is not None
                assert write(COMMAND, record.unacknowledged.corrected_counts) == pdu
                self.checked += 1
        super().send_request(unit_id, pdu)


def test_the_record_has_the_setpoint_before_its_frame_is_sent() -> None:
    records = Records()
    link = Watching(records)
    bench = RecordBench(stream_plan(table=LIFTED), records=records, memory=Follower(None, 20_000), link=link)
    for counts in range(20_000, 24_000, STEP):
        bench.ask(write(COMMAND, counts))
    assert link.checked == 99


# --- groups ------------------------------------------------------------------------------------------------


def gantry() -> RecordBench:
    y_command = COMMAND.__class__(0x0706, COMMAND.type, COMMAND.order)
    y_actual = ACTUAL.__class__(0x0720, ACTUAL.type, ACTUAL.order)
    y = axis_plan(name="y", command=(y_command,), actual=(y_actual,))
    bench = RecordBench(axis_plan(), y, groups=[("x", "y")])
    for place, actual in ((COMMAND, ACTUAL), (y_command, y_actual)):
        bench.ask(write(place, 50_000))
        bench.memory.put(actual, bench.memory.get(place))
        bench.wait(100)
    bench.ask(bytes((3,)) + ACTUAL.address.to_bytes(2, "big") + b"\0\2")
    bench.ask(bytes((3,)) + y_actual.address.to_bytes(2, "big") + b"\0\2")
    return bench


def restarted(bench: RecordBench) -> RecordBench:
    memory = Memory()
    memory.words = dict(bench.memory.words)
    return RecordBench(
        *bench.plans, records=bench.records.copy(), memory=memory, groups=[("x", "y")], start_ns=bench.now_ns
    )


def test_m11_a_group_is_restored_as_a_whole() -> None:
    again = restarted(gantry())
    assert again.kinds().count("restored") == 2


@pytest.mark.parametrize(("place", "count"), [(0x0520, 2), (0x0720, 2), (None, 1)])
def test_m11_no_axis_of_a_group_is_restored_if_one_was_moved_or_has_no_record(
    place: int | None, count: int
) -> None:
    bench = gantry()
    if place is None:
        bench.records.buffers["y"][:] = bytes(len(bench.records.buffers["y"]))
    else:
        bench.memory.words[place] += 500
    again = restarted(bench)
    assert again.kinds().count("record-not-used") == count
    assert "restored" not in again.kinds()
