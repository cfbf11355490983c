"""Lines of the ledger put together, and run until they have seen enough requests."""

import random
from dataclasses import dataclass
from functools import partial
from typing import Final

from gateway.exchange.plan import ControllerPlan, LineTiming, Role
from gateway.exchange.rest import LONGEST_DRAIN
from tests.ledger.clock import MS, Clock
from tests.ledger.connections import BookedLine, TcpMaster
from tests.ledger.controllers import Master, Script, SerialMaster
from tests.ledger.cut import ForwardingMaster, ForwardingWire, check_counts, random_speeds
from tests.ledger.drives import Drive
from tests.ledger.events import KEPT, Book
from tests.ledger.habits import Habits, Step
from tests.ledger.held import HeldStream
from tests.ledger.layouts import MAX_SPEED_MM_S, Basis, Layout, Style, axis_plan, block, image
from tests.ledger.ledger import Ledger
from tests.ledger.screws import TRAVEL_MM, random_screw
from tests.ledger.stillness import Stillness
from tests.ledger.wires import DRAIN_MS, TIMEOUT_MS, RtuWire, TcpWire, Wire
from tests.ledger.witness import Witness

PATIENCE_MS: Final = TIMEOUT_MS
HELD: Final = "held"
"""The line of :mod:`tests.ledger.held`."""
CONNECTED_MS: Final = 6_000.0
"""Between two losses of the connection, in the mean."""
AWAKE_MS: Final = 3_000.0
"""Between two standstills, in the mean."""
LAST_REPLIES_NS: Final = 3_000_000_000
GAPS_MS: Final = (0.0, 1.75, 5.0)
"""The silence that a wire needs before each frame."""
ALARM_LATE_MS: Final = 2.0
"""The longest time by which the alarm of such a line comes late: requests are read before it."""


@dataclass(frozen=True)
class Setup:
    """One line: its drives, and which of its sides are serial."""

    name: str
    layouts: tuple[Layout, ...]
    has_serial_drives: bool
    has_serial_controller: bool
    has_operator: bool = False

    def is_cut(self, seed: int) -> bool:
        """Whether frames may leave while they arrive: on every other line between two serial wires."""
        return self.has_serial_drives and self.has_serial_controller and seed % 2 == len(self.layouts) % 2


SETUPS: Final = (
    Setup(
        "rtu to rtu",
        (
            Layout("direct-low", 1, Style.DIRECT, low_first=True),
            Layout("sticky-commanded", 2, Style.STICKY, Basis.COMMANDED, low_first=True),
            block("block-target", 3, Basis.TARGET),
        ),
        has_serial_drives=True,
        has_serial_controller=True,
    ),
    Setup(
        "rtu to rtu, plain",
        (
            Layout("plain-low", 1, Style.PLAIN, low_first=True),
            Layout("plain-high", 2, Style.PLAIN, counts_per_unit=-1000.0, zero_counts=3_000),
            Layout("plain-hushed", 3, Style.PLAIN, has_bits=False),
            Layout("direct-stopped", 4, Style.DIRECT),
        ),
        has_serial_drives=True,
        has_serial_controller=True,
        has_operator=True,
    ),
    Setup(
        "tcp to tcp",
        (
            image("image-commanded", 1, Basis.COMMANDED),
            Layout("triggered-target", 2, Style.TRIGGERED, Basis.TARGET),
            Layout("triggered-actual", 3, Style.TRIGGERED, Basis.ACTUAL, exception_writes_nothing=True),
            Layout("direct-high", 4, Style.DIRECT, counts_per_unit=-1250.0, zero_counts=-70_000),
        ),
        has_serial_drives=False,
        has_serial_controller=False,
        has_operator=True,
    ),
    Setup(
        "tcp to rtu",
        (
            Layout("triggered-plain", 1, Style.TRIGGERED, low_first=True, has_bits=False),
            Layout("sticky-actual", 2, Style.STICKY, Basis.ACTUAL, counts_per_unit=-1000.0),
            image("image-target", 3, Basis.TARGET),
            block("block-actual", 4, Basis.ACTUAL),
        ),
        has_serial_drives=True,
        has_serial_controller=False,
        has_operator=True,
    ),
    Setup(
        "tcp alone",
        (Layout("triggered-alone", 1, Style.TRIGGERED, Basis.TARGET),),
        has_serial_drives=False,
        has_serial_controller=False,
    ),
)


class World:
    """One line in virtual time."""

    def __init__(self, setup: Setup, seed: int, book: Book, fault_share: float) -> None:
        self.clock = Clock()
        self.setup, self.book = setup, book
        book.line = setup.name
        self._rng = random.Random(f"{seed} {setup.name}")
        screws = {layout.unit: random_screw(self._rng) for layout in setup.layouts}
        self.drives = {layout.unit: self._drive(layout) for layout in setup.layouts}
        witnesses = {
            layout.unit: Witness(self.clock, layout, screws[layout.unit], self.drives[layout.unit], book)
            for layout in setup.layouts
        }
        hush_ms = LONGEST_DRAIN * DRAIN_MS if setup.has_serial_drives else 0.0
        self.ledger = Ledger(self.clock, book, witnesses, hush_ms=hush_ms, answer_ms=TIMEOUT_MS)
        self.stillness = Stillness(self.clock, self._rng, book)
        self._speeds = random_speeds(self._rng) if setup.is_cut(seed) else None
        is_cut = self._speeds is not None
        kind = TcpWire if not setup.has_serial_drives else ForwardingWire if is_cut else RtuWire
        self.wire: Wire = kind(
            self.clock, self.ledger, self.drives, self._rng, fault_share, stillness=self.stillness
        )
        plans = [axis_plan(layout, screws[layout.unit]) for layout in setup.layouts]
        # Without back-off: what is answered for dead drives is borne by the worlds of tests/verify.
        timing = LineTiming(response_timeout_ms=TIMEOUT_MS, drain_ms=DRAIN_MS, retry_ms=0.0)
        cut_through = None if self._speeds is None else self._speeds.drives
        self.line = BookedLine(plans, timing, self.wire, lambda event: None, cut_through=cut_through)
        self.wire.line = self.line
        self._silences = random.Random(f"{seed} {setup.name} silences")
        self.wire.gap_ns = 0 if is_cut else int(self._silences.choice(GAPS_MS) * MS)
        if isinstance(self.wire, ForwardingWire) and self._speeds is not None:
            self.wire.become(self._speeds)
        self.masters = self._masters()
        self._ticked_ns: int | None = None
        self._is_ending = False

    def run(self, requests: int) -> None:
        """Play until so many requests were sent, and let the last ones be answered."""
        self._open()
        if not self.setup.has_serial_controller:
            self.clock.after(self._rng.expovariate(1 / AWAKE_MS), self._stand_still)
        for number, master in enumerate(self.masters):
            self.clock.after(1.0 + number, master.go_on)
        last = self.book.seen["requests"] + requests
        while self.book.seen["requests"] < last:
            self._step()
        for master in self.masters:
            master.is_ending = True
        self._is_ending = True
        end_ns = self.clock.now_ns + LAST_REPLIES_NS
        while self.clock.now_ns < end_ns and self._step():
            pass
        self._check_all_answered()
        master, forwarding = self.masters[0], self.line.forwarding
        if (
            forwarding is not None
            and isinstance(self.wire, ForwardingWire)
            and isinstance(master, ForwardingMaster)
        ):
            self.book.seen["requests of cut lines"] += self.book.seen["requests"] - last + requests
            check_counts(forwarding, self.wire, master, self.book)

    def _open(self) -> None:
        self.wire.open()
        self.clock.after(self._rng.expovariate(1 / CONNECTED_MS), self._drop)

    def _stand_still(self) -> None:
        """Now and then the process stands still: shorter than a controller waits, or longer."""
        if not self._is_ending:
            ms = self._rng.uniform(0.1, 4.0) * PATIENCE_MS
            self.stillness.stand_still(ms)
            self.clock.after(ms + self._rng.expovariate(1 / AWAKE_MS), self._stand_still)

    def _drop(self) -> None:
        if self.stillness.is_still:
            self.clock.after(10.0, self._drop)
        elif not self._is_ending:
            self.wire.drop()
            self.clock.after(self._rng.uniform(1, 400), self._open)

    def _step(self) -> bool:
        went_on = self.clock.step()
        deadline_ns = self.line.deadline_ns
        if deadline_ns is not None and deadline_ns != self._ticked_ns:
            self._ticked_ns = deadline_ns
            late_ms = self._silences.uniform(0.0, ALARM_LATE_MS) if self.wire.gap_ns else 0.0
            tick_ns = deadline_ns + int(late_ms * MS)
            self.clock.at(tick_ns, lambda: self.stillness.after_reading(self._tick))
        return went_on

    def _tick(self) -> None:
        self.line.tick(self.clock.now_ns)
        self.ledger.acted()

    def _check_all_answered(self) -> None:
        for controller in self.ledger.controllers:
            for request in controller.unanswered.values():
                if not controller.is_serial and request not in controller.pending:
                    journal = self.ledger.witness(request.unit).journal
                    self.book.violation("never-answered", request.pdu.hex(" "), journal)

    def _drive(self, layout: Layout) -> Drive:
        position = layout.counts(self._rng.uniform(5, TRAVEL_MM - 5))
        speed_mm_s, lag_ms = self._rng.uniform(30, MAX_SPEED_MM_S), self._rng.choice([0.0, 20.0, 300.0])
        return Drive(layout, position, speed_mm_s, lag_ms)

    def _masters(self) -> list[Master]:
        strays = len(self.drives) == 1
        habits = [
            Habits(self.clock, drive, self._rng, jog=partial(self.ledger.jogged, unit), strays=strays)
            for unit, drive in self.drives.items()
        ]

        def work() -> list[Step]:
            return self._rng.choice(habits).act()

        def watch() -> list[Step]:
            habit = self._rng.choice(habits)
            return habit.stop() if self._rng.random() < 0.02 else habit.look()

        def operate() -> list[Step]:
            habit = self._rng.choice(habits)
            return habit.stop() if self._rng.random() < 0.3 else habit.look()

        is_serial = self.setup.has_serial_controller
        masters = [self._master("cnc", Role.MOTION, work, is_serial=is_serial)]
        masters.append(self._master("hmi", Role.MONITOR, watch))
        if self.setup.has_operator:
            masters.append(self._master("panel", Role.OPERATOR, operate))
        return masters

    def _master(self, name: str, role: Role, script: Script, *, is_serial: bool = False) -> Master:
        plan = ControllerPlan(name, role=role, timeout_ms=PATIENCE_MS, serial=is_serial)
        parts = (self.clock, self.line, self.ledger, plan, script)
        is_rest = role is not Role.MOTION
        if is_serial and self._speeds is not None:
            master = ForwardingMaster(*parts, rng=self._rng, is_rest=is_rest)
            master.become(self._speeds)
            return master
        if is_serial:
            return SerialMaster(*parts, rng=self._rng, is_rest=is_rest)
        return TcpMaster(*parts, rng=self._rng, is_rest=is_rest, stillness=self.stillness)


def play(
    seed: int,
    requests: int,
    *,
    fault_share: float = 0.05,
    stops_at_first: bool = True,
    only: str = "",
    kept: int = KEPT,
) -> Book:
    """Play one seed on every line, or on those whose name begins so, and return its book."""
    book = Book(seed, stops_at_first=stops_at_first, kept=kept)
    setups = [setup for setup in SETUPS if setup.name.startswith(only)]
    is_held = HELD.startswith(only)
    each = requests // (len(setups) + is_held)
    for setup in setups:
        World(setup, seed, book, fault_share).run(each)
    if is_held:
        HeldStream(seed, book).run(each)
    return book
