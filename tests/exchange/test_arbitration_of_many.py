"""Many monitors, or one that asks a silent drive, beside motion (DESIGN 8). Times are worked out by hand."""

from dataclasses import replace

import pytest

from gateway.exchange.plan import ControllerPlan, LineTiming, Role
from gateway.modbus.pdu import BROADCAST_UNIT_ID
from tests.exchange.line_bench import MS, Bench, Port, axis_plan

TIMING = LineTiming(response_timeout_ms=300.0, drain_ms=100.0, monitor_max_wait_ms=200.0, retry_ms=0.0)
MOTION = bytes.fromhex("03 1000 0001")
SILENT_UNIT = 9
START_NS = 1_000 * MS
PATIENT_MS = 10_000.0


class Plant(Bench):
    """Motion once each period, monitors that ask again when they are answered, a drive that takes its time.

    Where the motion controller still waits for its reply when a period begins, it leaves that period out. A
    monitor that is not answered asks again after 310 ms.
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
        timing = replace(TIMING, quiet_ms=quiet_ms)
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

    def run(self, until_ms: float, asks_from_ms: float = 0.0) -> "Plant":
        """Let everybody do what falls due, until an instant; the monitors begin at another."""
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
        """Do one thing: the drive before motion, motion before the line's own, monitors last."""
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
        """See what went onto the wire, and which monitors were answered."""
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


def crowded(count: int, timeout_ms: float) -> Plant:
    """Motion takes 10 of each 13 ms; so does every exchange of a monitor, which fits into no gap of 3 ms.

    Gaps are watched from the start on, and known when the monitors ask at 26, with motion. It is never quiet.
    """
    plant = Plant((13, 10), monitors(count, timeout_ms), unit_ids=(1,) * count, quiet_ms=10.0)
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


def test_those_that_wait_in_vain_are_withdrawn_when_their_controllers_give_up() -> None:
    plant = crowded(21, 300.0)  # overdue after 150 ms, at 176: motion ends at 179; and given up at 326
    plant.run(326, asks_from_ms=26)
    assert plant.started == [(179, 0)]
    assert plant.line.counters.withdrawn == 0
    plant.run(335)  # motion ends at 335
    assert plant.line.counters.withdrawn == 20


def silent(*, rtu: bool = False) -> Plant:
    """Motion takes 2 of each 20 ms; one monitor asks a drive that never answers, from 40 on."""
    plant = Plant((20, 2), monitors(1, 300.0), unit_ids=(SILENT_UNIT, 1), rtu=rtu)
    plant.line._scheduler.gaps.is_watching = True
    return plant


def test_a_monitor_that_asks_a_silent_drive_takes_a_tenth_of_the_line_at_most() -> None:
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
    plant = Plant((20, 2), monitors(1, 300.0), unit_ids=(BROADCAST_UNIT_ID,), rtu=True)
    plant.line._scheduler.gaps.is_watching = True
    assert plant.run(3000, asks_from_ms=40).started == [(42, 0), (502, 0), (1502, 0), (2502, 0)]


def test_the_line_asks_to_be_woken_for_what_falls_due_and_for_nothing_else() -> None:
    plant = silent().run(800, asks_from_ms=40)
    ticks = plant.ticks
    # The requests of 652, 792 and 1102 are given up just after 952, 1092 and 1402, in gaps: a tick for each.
    for ms, withdrawn in ((952, 0), (953, 1), (1092, 1), (1093, 2), (1402, 2), (1403, 3)):
        plant.run(ms)
        assert plant.line.counters.withdrawn == withdrawn
        assert plant.ticks - ticks == withdrawn


def test_what_fits_a_gap_is_not_held_up_by_one_that_was_forced() -> None:
    plant = silent().run(2000, asks_from_ms=40)  # another one is forced at 3492 at the earliest
    plant.monitors += monitors(1, 300.0)
    plant._asks_ns.append(START_NS + 2001 * MS)
    plant.run(2039)
    # Motion ends at 2002 and 2022; it is quiet 5 ms later, for 13 of the gap's 18 ms. Each takes 2 ms.
    assert [ms - 2000 for ms, i in plant.started if i == 1] == [
        *(2, 7, 9, 11, 13, 15, 17),
        *(22, 27, 29, 31, 33, 35, 37),
    ]
