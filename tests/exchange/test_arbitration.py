"""Motion first, monitors into the gaps (DESIGN 8). Times are worked out by hand."""

from dataclasses import replace

import pytest

from gateway.exchange.plan import ControllerPlan, LineTiming, Role
from gateway.modbus.pdu import BROADCAST_UNIT_ID
from tests.exchange.line_bench import MS, Bench, Port, axis_plan, monitor

TIMING = LineTiming(quiet_ms=5.0, monitor_max_wait_ms=200.0)
MOTION = bytes.fromhex("03 1000 0001")
WATCH = bytes.fromhex("03 2000 0001")
WATCH_MORE = bytes.fromhex("03 3000 0064")
US = 1000


class Plant(Bench):
    """A line whose drive answers when a test lets it: motion exchanges last 2 ms, in a cycle."""

    def __init__(self, timing: LineTiming = TIMING) -> None:
        super().__init__(axis_plan(), serial=False, timing=timing)
        self.hmi = monitor()

    def at(self, ms: float) -> None:
        """Advance to ``ms`` after the start, and tick at each deadline of the line."""
        until_ns = 1_000 * MS + int(ms * MS)
        while (due_ns := self.line.deadline_ns) is not None and due_ns <= until_ns:
            self.now_ns = due_ns
            self.line.tick(due_ns)
        self.now_ns = until_ns

    @property
    def ms(self) -> float:
        return self.now_ns / MS - 1000

    def on_wire(self) -> bytes | None:
        """The request that is on the wire."""
        return self.link.sent[-1][1] if self.link.sent else None

    def answer(self) -> None:
        """Let the drive answer the request on the wire now."""
        unit_id, pdu = self.link.sent.pop()
        self.seen.append(pdu)
        self.line.reply(unit_id, self.memory.answer(pdu), self.now_ns)

    def motion(self, start_ms: float, last_ms: float = 2.0) -> None:
        """A motion exchange that finds the line free of motion."""
        self.at(start_ms)
        self.send(MOTION)
        if self.on_wire() == MOTION:
            self.at(start_ms + last_ms)
            self.answer()

    def cycle(self, period_ms: float, until_ms: float) -> None:
        """Motion exchanges of 2 ms, one each period."""
        start_ms = 0.0
        while start_ms < until_ms:
            self.motion(start_ms)
            start_ms += period_ms


def watching(period_ms: float, until_ms: float, timing: LineTiming = TIMING) -> Plant:
    """Return a plant with one earlier read of a monitor, and cyclic motion since then."""
    plant = Plant(timing)
    plant.send(WATCH, plant.hmi)
    plant.answer()
    plant.cycle(period_ms, until_ms)
    plant.hmi.replies.clear()
    return plant


def test_without_motion_a_monitor_never_waits() -> None:
    plant = Plant()
    for start_ms in (0, 1, 50):
        plant.at(start_ms)
        plant.send(WATCH, plant.hmi)
        assert plant.on_wire() == WATCH
        plant.answer()


def test_a_monitors_request_that_fits_a_gap_is_sent_in_it() -> None:
    plant = watching(10.0, 100.0)  # 2 ms of motion, 8 ms of gap; the last one ended at 92
    plant.at(94)
    plant.send(WATCH, plant.hmi)
    assert plant.on_wire() is None  # 2 ms after the end is no chance
    plant.at(96.9)
    assert plant.on_wire() is None
    plant.at(97)  # quiet for 5 ms; 3 ms are left of the shortest gap, and it lasted no time the last time
    assert plant.on_wire() == WATCH
    plant.at(98)
    plant.answer()
    plant.motion(100)
    plant.at(104)
    plant.send(WATCH, plant.hmi)
    plant.at(107)
    assert plant.on_wire() == WATCH  # 1 ms is less than the 3 that are left
    plant.at(108)
    plant.answer()
    assert len(plant.hmi.replies) == 2


def test_a_monitors_request_that_came_during_motion_is_sent_as_soon_as_motion_ends() -> None:
    plant = watching(10.0, 100.0)
    plant.at(100)
    plant.send(MOTION)
    plant.at(101)
    plant.send(WATCH, plant.hmi)
    plant.at(102)
    plant.answer()
    assert plant.on_wire() == WATCH
    assert plant.now_ns == plant.line._transactions.current.sent_ns  # type: ignore[union-attr]


def busy_with_a_long_one() -> Plant:
    """Motion every 4 ms; a monitor's exchange took 3 ms, more than any gap, and is requested again at 405."""
    plant = watching(4.0, 400.0)  # gaps of 2 ms: shorter than quiet_ms, so the only chance is behind motion
    plant.at(400)
    plant.send(MOTION)
    plant.send(WATCH_MORE, plant.hmi)  # never seen: taken to last as long as motion, 2 ms, which fits
    plant.at(402)
    plant.answer()
    assert plant.on_wire() == WATCH_MORE
    plant.at(404)
    plant.send(MOTION)
    plant.at(405)
    plant.answer()
    plant.send(WATCH_MORE, plant.hmi)
    plant.at(407)
    plant.answer()
    assert plant.on_wire() is None
    return plant


def when_sent(plant: Plant) -> float:
    """Continue motion every 4 ms from 408 on, until the monitor's request is on the wire."""
    start_ms = 408.0
    while plant.on_wire() != WATCH_MORE:
        plant.motion(start_ms)
        start_ms += 4
    return plant.ms


# 200 ms from 405; motion ends at 410, 414, ...: the first time from 605 on is 606. 405 + 50 = 455: 458.
@pytest.mark.parametrize(("patience_ms", "sent_ms"), [(None, 606), (100, 458)])
def test_a_request_that_fits_no_gap_waits_for_half_of_its_patience_and_then_for_the_end_of_motion(
    patience_ms: int | None, sent_ms: float
) -> None:
    plant = busy_with_a_long_one()
    if patience_ms is not None:
        plant.hmi.patience_ns = patience_ms * MS
    assert when_sent(plant) == sent_ms


def test_a_pause_is_used_when_it_has_lasted_for_quiet_ms() -> None:
    plant = Plant()
    plant.send(WATCH, plant.hmi)
    plant.answer()
    for burst_ms in range(0, 600, 60):  # three exchanges back to back, then 54 ms of nothing
        for i in range(3):
            plant.motion(burst_ms + 2 * i)
    plant.hmi.replies.clear()
    plant.at(550)  # the last burst ended at 546
    plant.send(WATCH_MORE, plant.hmi)
    plant.at(550.9)
    assert plant.on_wire() is None
    plant.at(551)
    assert plant.on_wire() == WATCH_MORE


def test_a_request_too_long_for_the_rest_of_a_pause_waits() -> None:
    plant = watching(20.0, 400.0)  # gaps of 18 ms; the last one began at 382
    plant.at(382.1)
    plant.send(WATCH_MORE, plant.hmi)
    plant.at(387)
    assert plant.on_wire() == WATCH_MORE
    plant.at(401)
    plant.answer()  # 14 ms
    plant.motion(401)
    plant.at(404)
    plant.send(WATCH_MORE, plant.hmi)
    plant.at(419)
    assert plant.on_wire() is None  # after 5 ms of quiet 13 of the 18 are left: not enough
    plant.send(MOTION)
    plant.at(421)
    plant.answer()  # 18 ms are enough
    assert plant.on_wire() == WATCH_MORE


def test_a_second_without_motion_ends_every_wait() -> None:
    plant = watching(4.0, 400.0, replace(TIMING, monitor_max_wait_ms=5000.0))
    plant.hmi.patience_ns = 20_000 * MS
    plant.at(398)  # a pause begins
    plant.send(WATCH_MORE, plant.hmi)
    plant.at(403)
    assert plant.on_wire() == WATCH_MORE  # no pause was seen in the last second: none is known to be short
    plant.at(450)
    plant.answer()
    plant.motion(450)
    plant.send(WATCH_MORE, plant.hmi)  # 47 ms are longer than any gap
    plant.at(452 + 999)
    assert plant.on_wire() is None
    plant.at(452 + 1000)
    assert plant.on_wire() == WATCH_MORE


def test_motion_is_sent_before_monitors_that_came_earlier() -> None:
    plant = watching(10.0, 100.0)
    plant.at(100)
    plant.send(MOTION)
    for _ in range(3):
        plant.send(WATCH, plant.hmi)
    second = Port(ControllerPlan("panel"))
    plant.send(MOTION, second)
    plant.at(102)
    plant.answer()
    assert plant.on_wire() == MOTION
    plant.at(104)
    plant.answer()
    assert plant.on_wire() == WATCH


def test_two_monitors_take_turns_and_each_keeps_its_order() -> None:
    plant = Plant()
    other = Port(ControllerPlan("scada", role=Role.MONITOR))
    plant.send(MOTION)
    for pdu in (WATCH, WATCH_MORE):
        plant.send(pdu, plant.hmi)
        plant.send(pdu, other)
    for _ in range(5):
        plant.at(plant.ms + 6)
        plant.answer()
    assert plant.seen[-5:] == [MOTION, WATCH, WATCH, WATCH_MORE, WATCH_MORE]
    assert [len(port.replies) for port in (plant.hmi, other)] == [2, 2]


def test_a_monitor_that_gives_up_waiting_is_withdrawn_and_leaves_no_deadline() -> None:
    plant = watching(4.0, 400.0)
    plant.at(398.5)
    plant.send(WATCH_MORE, plant.hmi)
    plant.line.controller_gone(plant.hmi, plant.now_ns)
    assert plant.line.counters.withdrawn == 1
    plant.at(2000)
    assert plant.on_wire() is None
    assert plant.line.deadline_ns is None


def test_a_monitors_turn_that_falls_due_while_the_line_is_down_does_not_shorten_the_silence() -> None:
    bench = Bench(axis_plan(), timing=LineTiming(drain_ms=50.0, quiet_ms=5.0))
    poll = bytes.fromhex("03 1000 0002")
    bench.send(poll, port=monitor())
    bench.serve()
    for _ in range(4):
        bench.wait(3)
        bench.ask(bytes.fromhex("03 2000 0001"))
    bench.wait(1)
    bench.send(poll, port=monitor())
    assert not bench.link.sent  # it waits for its turn
    bench.send(bytes.fromhex("03 2000 0001"))
    assert bench.link.take()
    bench.line.link_down(bench.now_ns)  # its reply may still come
    bench.wait(20)
    bench.line.link_up(bench.now_ns)
    assert bench.line.deadline_ns == bench.now_ns + 50 * MS
    bench.send(bytes.fromhex("03 3000 0001"))
    assert not bench.link.sent


# === many monitors, or one that asks a silent drive ======================================================

CROWDED_TIMING = LineTiming(
    response_timeout_ms=300.0, drain_ms=100.0, monitor_max_wait_ms=200.0, retry_ms=0.0
)
SILENT_UNIT = 9
START_NS = 1_000 * MS
PATIENT_MS = 10_000.0


class CrowdedPlant(Bench):
    """Motion once each period, monitors that repeat their request after each answer, and a slow drive.

    If the motion controller still waits for its reply when a period begins, it skips that period. A monitor
    without an answer repeats its request after 310 ms.
    """

    def __init__(
        self,
        cycle_ms: tuple[int, int],
        monitors: list[Port],
        *,
        unit_ids: tuple[int, ...],
        quiet_ms: float = 5.0,
        rtu: bool = False,
    ) -> None:
        timing = replace(CROWDED_TIMING, quiet_ms=quiet_ms)
        super().__init__(axis_plan(), serial=False, timing=timing, tcp_drive=not rtu)
        self.period_ns, self.lasts_ns = (ms * MS for ms in cycle_ms)
        self.monitors, self.unit_ids = monitors, unit_ids
        self.waits_ms: list[float] = []
        """How long each motion request waited for the wire."""
        self.started: list[tuple[float, int]] = []
        """When which monitor's exchange began."""
        self.ticks = 0
        self._asks_ns = [0] * len(monitors)
        self._motion_sent_ns = 0
        self._slot_ns = START_NS
        self._answer_ns: int | None = None

    def run(self, until_ms: float, asks_from_ms: float = 0.0) -> "CrowdedPlant":
        """Run until ``until_ms``; the monitors begin at ``asks_from_ms``."""
        begin_ns = START_NS + int(asks_from_ms * MS)
        self._asks_ns = [max(ns, begin_ns) for ns in self._asks_ns]
        until_ns = START_NS + int(until_ms * MS)
        while (due_ns := self._due_ns()) <= until_ns:
            self.now_ns = due_ns
            self._act()
            self._look()
        return self

    def _due_ns(self) -> int:
        dues = (self._answer_ns, self.line.deadline_ns, self._slot_ns, *self._asks_ns)
        return min(ns for ns in dues if ns is not None)

    def _act(self) -> None:
        """Do one thing: the drive's reply first, then motion, then the tick of the line, then monitors."""
        now_ns, line_ns = self.now_ns, self.line.deadline_ns
        if self._answer_ns == now_ns:
            self._answer_ns = None
            unit_id, pdu = self.link.sent.pop()
            if pdu == MOTION:
                self._motion_sent_ns = 0
            self.line.reply(unit_id, self.memory.answer(pdu), now_ns)
        elif self._slot_ns == now_ns:
            self._slot_ns += self.period_ns
            if not self._motion_sent_ns:
                self._motion_sent_ns = now_ns
                self.send(MOTION)
        elif line_ns is not None and line_ns <= now_ns:
            self.ticks += 1
            self.line.tick(now_ns)
        else:
            i = self._asks_ns.index(now_ns)
            self._asks_ns[i] = now_ns + 310 * MS
            self.send(bytes((3, 0x20, i, 0, 1)), self.monitors[i], self.unit_ids[i])

    def _look(self) -> None:
        """Record which request is on the wire, and which monitors were answered."""
        if self.link.sent and self._answer_ns is None:
            unit_id, pdu = self.link.sent[-1]
            if pdu == MOTION:
                self.waits_ms.append((self.now_ns - self._motion_sent_ns) / MS)
            else:
                self.started.append(((self.now_ns - START_NS) / MS, pdu[2]))
            if unit_id in (SILENT_UNIT, BROADCAST_UNIT_ID):
                self.link.sent.clear()
            else:
                self._answer_ns = self.now_ns + self.lasts_ns
        for i, port in enumerate(self.monitors):
            if port.replies:
                port.replies.clear()
                self._asks_ns[i] = self.now_ns


def monitors(count: int, timeout_ms: float) -> list[Port]:
    return [Port(ControllerPlan(f"hmi{i}", role=Role.MONITOR, timeout_ms=timeout_ms)) for i in range(count)]


def crowded(count: int, timeout_ms: float) -> CrowdedPlant:
    """Motion takes 10 of each 13 ms; so does every exchange of a monitor, which fits into no gap of 3 ms.

    Gaps are measured from the start on, and known when the first requests of the monitors come at 26, with
    motion. The line is never quiet.
    """
    plant = CrowdedPlant((13, 10), monitors(count, timeout_ms), unit_ids=(1,) * count, quiet_ms=10.0)
    plant.line._scheduler.gaps.is_watching = True
    return plant


@pytest.mark.parametrize("count", [1, 21])
def test_however_many_monitors_are_overdue_motion_waits_as_rarely_as_for_one(count: int) -> None:
    # Overdue at 226. Motion ends at 13 k + 10: 231 is the first of these. What begins there holds the line
    # until 241; no other before 441 (9 x 10 ms is less than 200), and motion ends at 452 = 231 + 17 x 13.
    plant = crowded(count, PATIENT_MS).run(2000, asks_from_ms=26)
    forced = [231 + 221 * n for n in range(9)]  # the last one at 1999
    assert plant.started == [(ms, n % count) for n, ms in enumerate(forced)]  # the oldest goes first
    # Motion asks 3 ms after each of the first eight began, and waits for 7; its reply comes at 251, 4 ms late
    # for the next period, which it leaves out. So it has 146 of the 154 periods until 1989.
    assert sorted(plant.waits_ms) == [0.0] * 138 + [7.0] * 8
    assert plant.ticks == 0  # the longest gap, behind a period that was left out, is 260 - 251 = 9 ms


def test_monitors_that_wait_in_vain_are_withdrawn_when_they_give_up() -> None:
    plant = crowded(21, 300.0)  # overdue after 150 ms, at 176: motion ends at 179; and given up at 326
    plant.run(326, asks_from_ms=26)
    assert plant.started == [(179, 0)]
    assert plant.line.counters.withdrawn == 0
    plant.run(335)  # motion ends at 335
    assert plant.line.counters.withdrawn == 20


def silent(*, rtu: bool = False) -> CrowdedPlant:
    """Motion takes 2 of each 20 ms; from 40 on, one monitor reads a drive that never answers."""
    plant = CrowdedPlant((20, 2), monitors(1, 300.0), unit_ids=(SILENT_UNIT, 1), rtu=rtu)
    plant.line._scheduler.gaps.is_watching = True
    return plant


def test_a_monitor_that_reads_a_silent_drive_takes_a_tenth_of_the_line_at_most() -> None:
    # 42: never seen, so taken to last 2 ms, which fits; times out at 342. Asked again then, overdue 150 later
    # at 492, when it is quiet: until 792. The next one not before 792 + 9 x 300 = 3492, quiet again; that is
    # the request of 3272. Given up after 300 ms: those of 792, 1102, ... 2962, and those of 652 and 3582,
    # which came 310 ms after one that was on the wire.
    plant = silent().run(3999, asks_from_ms=40)
    assert plant.started == [(42, 0), (492, 0), (3492, 0)]
    assert plant.line.counters.withdrawn == 8 + 2
    # Of 200 periods each of the three costs 14: motion asks once, and waits until the time-out.
    assert len(plant.waits_ms) == 200 - 3 * 14
    assert sorted(plant.waits_ms)[-4:] == [0.0, 342 - 60, 792 - 500, 3792 - 3500]


def test_the_silence_after_a_time_out_counts_too() -> None:
    # 42 to 342, and silence until 442; 492 to 792, silence until 892; 892 + 9 x 400 = 4492.
    plant = silent(rtu=True).run(4600, asks_from_ms=40)
    assert plant.started == [(42, 0), (492, 0), (4492, 0)]


def test_the_pause_after_a_broadcast_counts_too() -> None:
    # 42: never seen; 100 ms of pause. Asked again at 350 and overdue at 500, when motion asks: 502 to 602.
    # 602 + 9 x 100 = 1502, when motion ends again: the request of 1280. Until 1602; 2502: that of 2210.
    plant = CrowdedPlant((20, 2), monitors(1, 300.0), unit_ids=(BROADCAST_UNIT_ID,), rtu=True)
    plant.line._scheduler.gaps.is_watching = True
    assert plant.run(3000, asks_from_ms=40).started == [(42, 0), (502, 0), (1502, 0), (2502, 0)]


def test_the_line_asks_to_be_woken_for_its_deadlines_only() -> None:
    plant = silent().run(800, asks_from_ms=40)
    ticks = plant.ticks
    # The requests of 652, 792 and 1102 are given up just after 952, 1092 and 1402, in gaps: a tick for each.
    for ms, withdrawn in ((952, 0), (953, 1), (1092, 1), (1093, 2), (1402, 2), (1403, 3)):
        plant.run(ms)
        assert plant.line.counters.withdrawn == withdrawn
        assert plant.ticks - ticks == withdrawn


def test_a_request_that_fits_a_gap_does_not_wait_for_one_that_was_forced() -> None:
    plant = silent().run(2000, asks_from_ms=40)  # another one is forced at 3492 at the earliest
    plant.monitors += monitors(1, 300.0)
    plant._asks_ns.append(START_NS + 2001 * MS)
    plant.run(2039)
    # Motion ends at 2002 and 2022; it is quiet 5 ms later, for 13 of the gap's 18 ms. Each takes 2 ms.
    assert [ms - 2000 for ms, i in plant.started if i == 1] == [
        *(2, 7, 9, 11, 13, 15, 17),
        *(22, 27, 29, 31, 33, 35, 37),
    ]


# === a wire that needs a silence, while the machine is busy ==============================================

GAP_NS = 1_750_000
ANSWER_NS = 2 * MS
CYCLE_NS = 10 * MS
PACED_FROM_NS = 1_100 * MS


class PacedPlant(Plant):
    """Motion each 10 ms, and a monitor that repeats its read after each answer; the drive answers in 2 ms.

    The wire is free 1.75 ms after each reply. The alarm comes ``late_ns`` after its time.
    """

    def run(self, late_ns: int, cycles: int) -> tuple[int, int]:
        """Return how many reads of the monitor were answered, and the longest delay of motion in ns."""
        next_motion_ns, ends_ns = PACED_FROM_NS, PACED_FROM_NS + cycles * CYCLE_NS
        answer_ns: int | None = None
        served, longest_ns, asked = 0, 0, 0
        self.send(WATCH, self.hmi)
        self.answer()
        self.hmi.replies.clear()
        is_asking, number = False, 0
        while self.now_ns < ends_ns:
            if not is_asking:
                number += 1
                self.send(WATCH, self.hmi, transaction_id=number)
                is_asking = True
            if answer_ns is None and self.link.sent:
                answer_ns = self.now_ns + ANSWER_NS
                if self.link.sent[-1][1] == MOTION:
                    longest_ns = max(longest_ns, self.now_ns - asked)
            due_ns = self.line.deadline_ns
            tick_ns = None if due_ns is None else max(due_ns + late_ns, self.now_ns)
            events = [next_motion_ns, *[ns for ns in (answer_ns, tick_ns) if ns is not None]]
            self.now_ns = min(events)
            if answer_ns == self.now_ns:
                answer_ns = None
                self.link.stamps.next_ns = self.now_ns + GAP_NS
                self.answer()
            elif next_motion_ns == self.now_ns:
                asked = next_motion_ns
                next_motion_ns += CYCLE_NS
                self.send(MOTION)
            else:
                self.line.tick(self.now_ns)
            if self.hmi.replies:
                served += 1
                self.hmi.replies.clear()
                is_asking = False
            is_asking = is_asking and "withdrawn" not in self.kinds()
            self.events.clear()
        return served, longest_ns


@pytest.mark.parametrize("late_us", [0, 500, 1100])
def test_a_monitor_is_served_between_motion_each_10_ms(late_us: int) -> None:
    """A read of a monitor takes 2 ms, and a silence of 1.75 ms before it: in each cycle one fits."""
    served, longest_ns = PacedPlant().run(late_us * 1000, 300)
    assert longest_ns <= 4 * MS
    assert served >= 290
