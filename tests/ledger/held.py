"""A stream of setpoints over every switch: a held setpoint holds its drive, a step is a step (M6, M9).

The player feeds one axis with setpoints, holds them, turns round, and in between switches whatever can be
switched: the compensation, the table, the gain, the reference, the link, the gateway itself, with and without
its record. What it demands takes nothing from the exchange but the screw's own arithmetic:

- *Held.* The same setpoint again moves the drive by one count at most, whatever happened in between.
- *Moved.* A different setpoint moves the drive as far, but for the slopes of table, change-over and reversal.
- *Taken over.* After a way on which every change-over and reversal has ended the drive stands where the table
  says, to the count; where nothing is to be added, at the setpoint.
- *Begun.* A gateway that starts without a record takes for a correction what lies between 0 and the branches
  of its table at the drive's place and the setpoint. What is more is motion, and no more than that.
"""

import random
from collections.abc import Callable
from math import pi
from typing import Final

from gateway.compensation.fingerprint import table_digest
from gateway.compensation.settings import Gain, Reversal, ReversalKind
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.exchange.commands import TableFor
from gateway.exchange.control import set_gain, set_tables, switch
from gateway.exchange.plan import AxisPlan, Reference
from gateway.modbus.registers import BitField
from tests.exchange.line_bench import ACTUAL, COMMAND, read, stream_plan, write
from tests.exchange.record_bench import RecordBench, Records
from tests.ledger.clock import Clock
from tests.ledger.events import Book, Journal
from tests.ledger.screws import TRAVEL_MM, random_screw

HOMED: Final = BitField(0x0031, 5)
LOW_COUNTS, HIGH_COUNTS = 1_000, int(TRAVEL_MM * 1000) - 1_000
RELOAD_MM, REVERSAL_MM = 3.0, 1.5
SCREWS: Final = 4
STEPS: Final = (1, 3, 20, 100, 400)
"""Counts from one setpoint to the next."""
ROUNDING: Final = 1.0 + 1e-6
CYCLE_MS: Final = 4.0
GAINS: Final = (Gain(1.0, 1.0), Gain(0.5, 0.5), Gain(0.0, 1.0), Gain(1.0, 0.0))


class HeldStream:
    """One axis, its controller and everybody who switches something."""

    def __init__(self, seed: int, book: Book) -> None:
        self.book, self.rng = book, random.Random(f"{seed} held")
        self.clock = Clock()
        self.journal = Journal(self.clock, "stream", book.kept)
        book.line = "held"
        self.screws = [random_screw(self.rng) for _ in range(SCREWS)]
        self.tables = [make_table(s.positions, s.forward, s.backward, Units.MM) for s in self.screws]
        by_digest = {table_digest(table): table for table in self.tables}
        self.find_table: Callable[[bytes], CorrectionTable | None] = by_digest.get
        self.has_bit = self.rng.random() < 0.5
        self.number, self.gain = 0, GAINS[0]
        """Of the table."""
        self.bench = RecordBench(self._plan(), find_table=self.find_table)
        self.is_on = self.is_homed = True
        self.setpoint = self.rng.randrange(LOW_COUNTS, HIGH_COUNTS)
        self.told = self.setpoint
        self.sense = 1
        self.way = 0
        """Counts gone in one direction since the last switch."""
        self._home(is_set=True)
        self.bench.memory.put(ACTUAL, self.setpoint)

    def _plan(self) -> AxisPlan:
        return stream_plan(
            table=self.tables[self.number],
            gain=self.gain,
            travel=(0.0, TRAVEL_MM),
            reload_distance=RELOAD_MM,
            reversal=Reversal(ReversalKind.DISTANCE, REVERSAL_MM),
            max_slope=0.9,
            referenced=Reference.DRIVE_BIT if self.has_bit else Reference.ABSOLUTE,
            bits={"homed": HOMED} if self.has_bit else {},
        )

    def run(self, requests: int) -> None:
        """Play until so many requests were sent."""
        last = self.book.seen["requests"] + requests
        self._feed(self.setpoint)
        while self.book.seen["requests"] < last:
            chance = self.rng.random()
            if chance < 0.35:
                self._hold()
            elif chance < 0.85:
                self._go()
            elif chance < 0.9:
                self._look()
            else:
                self._switch()

    # --- the controller --------------------------------------------------------------------------------

    def _feed(self, setpoint: int) -> int:
        """Send a setpoint; return what the drive was told, and let it go there."""
        self._ask(write(COMMAND, setpoint))
        told = int(self.bench.memory.get(COMMAND))
        self.bench.memory.put(ACTUAL, told)
        self.bench.wait(CYCLE_MS)
        self.journal.note("setpoint", b"", f"{setpoint}: {told}, {told - setpoint:+d}")
        return told

    def _ask(self, pdu: bytes) -> bytes:
        self.book.seen["requests"] += 1
        self.clock.now_ns = self.bench.now_ns
        return self.bench.ask(pdu)

    def _hold(self) -> None:
        told = self._feed(self.setpoint)
        self.book.seen["held setpoints"] += 1
        if abs(told - self.told) > ROUNDING:
            self._violation("held-setpoint-moves", f"{self.setpoint} held: {self.told} became {told}")
        self.told = told

    def _go(self) -> None:
        """One to several setpoints on, mostly the same way."""
        if self.rng.random() < 0.05:
            self.sense, self.way = -self.sense, 0
        step = self.rng.choice(STEPS)
        for _ in range(self.rng.randint(1, 12)):
            setpoint = self.setpoint + self.sense * step
            if not LOW_COUNTS <= setpoint <= HIGH_COUNTS:
                self.sense, self.way = -self.sense, 0
                return
            self._step(setpoint)

    def _step(self, setpoint: int) -> None:
        told, step = self._feed(setpoint), setpoint - self.setpoint
        self.book.seen["moved setpoints"] += 1
        off = abs((told - self.told) - step)
        if off > ROUNDING + self._steepest() * abs(step):
            self._violation("a-step-is-no-step", f"{self.told} became {told} for a step of {step}")
        self.setpoint, self.told = setpoint, told
        self.way += abs(step)
        # One change-over is brought to its end before the next one begins, and each takes whole steps.
        if self.way > 1000 * (2 * RELOAD_MM + REVERSAL_MM) + 4 * STEPS[-1]:
            self._check_place()

    def _check_place(self) -> None:
        self.book.seen["setpoints after a whole way"] += 1
        wanted = float(self.setpoint)
        if self.is_on and self.is_homed:
            wanted += 1000 * self._correction_mm(self.setpoint, is_forward=self.sense > 0)
        if abs(self.told - wanted) > ROUNDING:
            self._violation("not-on-its-branch", f"{self.setpoint}: {self.told}, exact would be {wanted:.3f}")

    def _look(self) -> None:
        """Read the position back: it is the setpoint."""
        told = int(ACTUAL.unpack(self._ask(read(ACTUAL))[2:]))
        self.book.seen["setpoints read back"] += 1
        if abs(told - self.setpoint) > ROUNDING:
            self._violation("reads-elsewhere", f"{told} for {self.setpoint}")

    # --- what is switched --------------------------------------------------------------------------------

    def _switch(self) -> None:
        deeds = {
            "compensation": self._turn,
            "table": self._give_table,
            "gain": self._give_gain,
            "link": self._cut,
            "silence": self._fall_silent,
            "pause": lambda: self.bench.wait(self.rng.uniform(1, 8_000)),
            "kill": self._kill,
            "start without a record": self._start_bare,
        }
        if self.has_bit:
            deeds["reference"] = lambda: self._home(is_set=not self.is_homed)
        name = self.rng.choice(list(deeds))
        self.book.seen[f"switch: {name}"] += 1
        self.journal.note(name)
        deeds[name]()
        self.way = 0
        for _ in range(self.rng.randint(0, 2)):
            self._hold()

    def _turn(self) -> None:
        self.is_on = not self.is_on
        switch(self.bench.line.axes, "x", is_on=self.is_on)

    def _give_table(self) -> None:
        self.number = self.rng.randrange(SCREWS)
        table = self.tables[self.number]
        digest = table_digest(table).hex()
        set_tables(self.bench.line.axes, [TableFor("x", f"{self.number}.tab", "test", digest)], [table])

    def _give_gain(self) -> None:
        self.gain = self.rng.choice(GAINS)
        set_gain(self.bench.line.axes, "x", self.gain)

    def _home(self, *, is_set: bool) -> None:
        """The drive loses its reference or has it again, and its controller reads so."""
        self.is_homed = is_set
        self.bench.memory.words[HOMED.address] = is_set << HOMED.bit
        if self.has_bit:
            self._ask(b"\x03" + HOMED.address.to_bytes(2, "big") + b"\x00\x01")

    def _cut(self) -> None:
        self.bench.line.link_down(self.bench.now_ns)
        self.bench.wait(self.rng.uniform(1, 3_000))
        self.bench.line.link_up(self.bench.now_ns)
        self.bench.serve()

    def _fall_silent(self) -> None:
        """Replies are lost for a while; the drive is where it was."""
        for _ in range(self.rng.randint(1, 3)):
            self.book.seen["requests"] += 1
            self.bench.send(read(ACTUAL))
            self.bench.link.sent.clear()
            for _ in range(self.rng.randint(4, 7)):  # over the time-out, and the silence after it
                self.bench.wait(600)
            self.bench.port.replies.clear()

    def _kill(self) -> None:
        """SIGKILL, and another gateway on the records of this one."""
        self._start_anew()
        self._hold()

    def _start_anew(self) -> None:
        self.bench = self.bench.restarted(self._plan(), find_table=self.find_table)
        self.is_on = True

    def _start_bare(self) -> None:
        """Another gateway that knows nothing of this one."""
        self.bench.records = Records()
        self._start_anew()
        offset = self.told - self.setpoint
        branches = [
            1000 * self._correction_mm(place, is_forward=way)
            for place in (self.setpoint, self.told)
            for way in (True, False)
        ]
        low, high = min(0.0, *branches) - 1, max(0.0, *branches) + 1
        wanted = self.setpoint + min(high, max(low, offset))
        told = self._feed(self.setpoint)
        if abs(told - wanted) > ROUNDING and abs(told - self.told) > ROUNDING:
            self._violation("begins-elsewhere", f"{self.setpoint}: {self.told} became {told}, not {wanted}")
        self.told = told

    # --- arithmetic --------------------------------------------------------------------------------------

    def _correction_mm(self, counts: int, *, is_forward: bool) -> float:
        gain = self.gain.forward if is_forward else self.gain.backward
        return gain * self.screws[self.number].correction_mm(counts / 1000, is_forward=is_forward)

    def _steepest(self) -> float:
        """Return by how much a step may be off, as a share of it: slope, change-over, reversal."""
        return 0.005 + pi / 2 * 0.7 / RELOAD_MM + pi / 2 * 0.07 / REVERSAL_MM

    def _violation(self, kind: str, detail: str) -> None:
        self.book.violation(kind, detail, self.journal)
