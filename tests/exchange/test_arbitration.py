"""Motion first, monitors into the gaps (DESIGN 8). Times are worked out by hand."""

from dataclasses import replace

from gateway.exchange.plan import ControllerPlan, LineTiming, Role
from tests.exchange.line_bench import MS, Bench, Port, axis_plan, monitor

TIMING = LineTiming(quiet_ms=5.0, monitor_max_wait_ms=200.0)
MOTION = bytes.fromhex("03 1000 0001")
WATCH = bytes.fromhex("03 2000 0001")
WATCH_MORE = bytes.fromhex("03 3000 0064")
US = 1000


class Plant(Bench):
    """A line whose drive answers when it is told to: motion exchanges last 2 ms, in a cycle."""

    def __init__(self, timing: LineTiming = TIMING) -> None:
        super().__init__(axis_plan(), serial=False, timing=timing)
        self.hmi = monitor()

    def at(self, ms: float) -> None:
        """Let it be ``ms`` after the start, ticking when the line asks for it."""
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
        """The drive answers what is on the wire, now."""
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
    """A plant in which a monitor was seen once, and motion goes on since."""
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


def test_a_monitor_goes_directly_after_a_motion_exchange_where_it_fits() -> None:
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


def test_one_that_came_during_motion_goes_in_the_same_instant_that_motion_ends() -> None:
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
    """Motion every 4 ms; a monitor's exchange took 3 ms, more than any gap, and is asked for again at 405."""
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
    """Let motion go on every 4 ms from 408 on, until the monitor's request is on the wire."""
    start_ms = 408.0
    while plant.on_wire() != WATCH_MORE:
        plant.motion(start_ms)
        start_ms += 4
    return plant.ms


def test_one_that_does_not_fit_waits_for_its_patience_and_then_goes_at_the_next_chance() -> None:
    # 200 ms from 405; motion ends at 410, 414, ...: the first time from 605 on is 606
    assert when_sent(busy_with_a_long_one()) == 606


def test_half_of_its_controllers_patience_is_the_most_that_a_monitor_waits() -> None:
    plant = busy_with_a_long_one()
    plant.hmi.patience_ns = 100 * MS
    assert when_sent(plant) == 458  # 405 + 50 = 455; motion ends at 458


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


def test_what_is_too_long_for_the_rest_of_a_pause_waits() -> None:
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


def test_motion_goes_before_monitors_that_came_earlier() -> None:
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


def test_a_monitor_that_gives_up_waiting_is_withdrawn_and_nothing_is_left_due() -> None:
    plant = watching(4.0, 400.0)
    plant.at(398.5)
    plant.send(WATCH_MORE, plant.hmi)
    plant.line.controller_gone(plant.hmi, plant.now_ns)
    assert plant.line.counters.withdrawn == 1
    plant.at(2000)
    assert plant.on_wire() is None
    assert plant.line.deadline_ns is None


def test_a_monitors_turn_due_while_the_line_is_down_does_not_end_the_silence_that_is_owed() -> None:
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
