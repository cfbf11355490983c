"""The times of an exchange: its parts, waiting, the drive; and the budget of its axes (DESIGN 8)."""

from gateway.exchange.latency import middle_ns
from gateway.exchange.latency_status import AT_FIRST, PARTS, LatencyStatus
from gateway.exchange.meter import Measured
from gateway.exchange.plan import ControllerPlan, Role
from gateway.status.line import ControllerStatus, LineStatus
from gateway.status.times import GatewayTimes
from tests.exchange.line_bench import MS, Bench, Link, Port, axis_plan, stream_plan

US = 1000
OTHER = bytes.fromhex("03 1000 0001")
ANSWER = bytes.fromhex("03 02 0000")


class TimedPort(Port):
    """A slow port: it takes ``turn_ns`` until a reply is ready, and ``write_ns`` to write it."""

    def __init__(self, plan: ControllerPlan) -> None:
        super().__init__(plan)
        self.turn_ns = self.write_ns = self.clock_ns = 0

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        super().send_reply(transaction_id, unit_id, pdu)
        self.stamps.ready_ns = self.clock_ns + self.turn_ns
        self.stamps.sent_ns = self.stamps.ready_ns + self.write_ns


class TimedLink(Link):
    """A slow link."""

    def __init__(self) -> None:
        super().__init__()
        self.work_ns = self.write_ns = self.clock_ns = 0

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        super().send_request(unit_id, pdu)
        self.stamps.ready_ns = self.clock_ns + self.work_ns
        self.stamps.sent_ns = self.stamps.ready_ns + self.write_ns


class MeterBench(Bench):
    """One exchange at a time, with every time given."""

    def __init__(self, *, budget_us: float = 1000.0, wire_ns_per_byte: int = 0) -> None:
        self.timed_link = TimedLink()
        self.timed_link.stamps.wire_ns_per_byte = wire_ns_per_byte
        self.ran: list[tuple[int, int]] = []
        super().__init__(stream_plan(budget_us=budget_us), link=self.timed_link, what_ran=self._what_ran)
        self.port = self.timed_port = TimedPort(ControllerPlan("cnc"))

    def _what_ran(self, since_ns: int, until_ns: int) -> str:
        self.ran.append((since_ns, until_ns))
        return "the journal, 400 µs"

    def exchange(self, work_us: int, write_us: int, drive_us: int, turn_us: int, answer_us: int) -> None:
        """One exchange whose parts take so long."""
        link, port = self.timed_link, self.timed_port
        link.clock_ns, link.work_ns, link.write_ns = self.now_ns, work_us * US, write_us * US
        self.send(OTHER)
        link.sent.clear()
        reply_ns = link.stamps.sent_ns + drive_us * US
        port.clock_ns, port.turn_ns, port.write_ns = reply_ns, turn_us * US, answer_us * US
        self.line.reply(1, ANSWER, reply_ns)
        self.now_ns = reply_ns + MS


def times_us(measured: Measured) -> dict[str, float]:
    """The only time of each kind, in µs."""
    found = {}
    assert measured.queue is None
    for name in ("gateway", "request", "reply", "drive"):
        counts = getattr(measured, name)
        assert sum(counts) == 1
        found[name] = middle_ns(list(counts).index(1)) / US
    return found


def is_about(found: float, wanted: float) -> bool:
    return abs(found - wanted) <= wanted / 60


def test_every_part_of_an_exchange_is_measured_separately() -> None:
    bench = MeterBench()
    bench.exchange(work_us=30, write_us=5, drive_us=900, turn_us=20, answer_us=7)
    found = times_us(bench.line.meter.measured["cnc", 1])
    assert is_about(found["request"], 35)
    assert is_about(found["reply"], 27)
    assert is_about(found["gateway"], 62)
    assert is_about(found["drive"], 900)
    assert bench.line.meter.measured["cnc", 1].high.ever_ns == 62 * US


def test_bytes_on_the_wire_are_not_the_gateways() -> None:
    bench = MeterBench(wire_ns_per_byte=95 * US)  # about 115200 Bd
    bench.exchange(work_us=10, write_us=5, drive_us=3000, turn_us=10, answer_us=5)
    found = times_us(bench.line.meter.measured["cnc", 1])
    assert is_about(found["gateway"], 30)
    # 5 bytes out and 4 back, with three more each for unit id and check sum: 15 bytes, 1425 µs
    assert bench.line.meter.wire_ns == 15 * 95 * US
    assert is_about(found["drive"], 3000 - 1425)


def test_waiting_for_the_line_is_no_gateway_time() -> None:
    bench = MeterBench()
    link, port = bench.timed_link, bench.timed_port
    link.clock_ns = port.clock_ns = bench.now_ns
    link.work_ns = port.turn_ns = US
    bench.send(OTHER)
    bench.send(OTHER)  # waits for the first
    end_ns = bench.now_ns + 4 * MS
    link.clock_ns = port.clock_ns = end_ns
    bench.line.reply(1, ANSWER, end_ns)
    port.clock_ns = end_ns + MS
    bench.line.reply(1, ANSWER, end_ns + MS)
    measured = bench.line.meter.measured["cnc", 1]
    assert measured.queue is not None
    [queue_ns] = [middle_ns(i) for i, count in enumerate(measured.queue) for _ in range(count)]
    assert is_about(queue_ns, 4 * MS)
    assert measured.high.ever_ns == 2 * US


def test_the_silence_before_a_frame_counts_as_waiting_for_the_line() -> None:
    bench = MeterBench(wire_ns_per_byte=95 * US)
    link, port = bench.timed_link, bench.timed_port
    link.work_ns = port.turn_ns = US
    link.clock_ns = link.stamps.next_ns = bench.now_ns + 1_750 * US
    port.clock_ns = link.clock_ns + 2 * MS  # 15 bytes take 1.425 ms
    bench.send(OTHER)
    assert link.sent == []
    bench.wait(1.75)
    bench.line.reply(1, ANSWER, port.clock_ns)
    measured = bench.line.meter.measured["cnc", 1]
    assert measured.queue is not None
    [queue_ns] = [middle_ns(i) for i, count in enumerate(measured.queue) for _ in range(count)]
    assert is_about(queue_ns, 1_750 * US)


def line_times(status: LatencyStatus) -> LineStatus:
    line = LineStatus()
    status.fill_line(line)
    return line


def controller_times(status: LatencyStatus, name: str) -> ControllerStatus:
    controller = ControllerStatus(name=name)
    status.fill_controller(controller)
    return controller


def test_no_percentile_lies_above_the_highest_time() -> None:
    bench = MeterBench(budget_us=5000.0)
    bench.exchange(1000, 0, 1, 0, 0)
    # 1 ms shares its bucket with all from 999 424 to 1 007 615 ns, whose middle is 1003.5 µs.
    took_us = LatencyStatus(bench.line.meter).axis("x").gateway_us
    assert [took_us.p50, took_us.p99, took_us.p999, took_us.max] == [1000.0] * 4


def test_a_monitor_is_measured_separately() -> None:
    bench = MeterBench()
    bench.exchange(1, 1, 1, 1, 1)
    hmi = TimedPort(ControllerPlan("hmi", role=Role.MONITOR))
    bench.now_ns += 2_000 * MS
    bench.timed_link.clock_ns = hmi.clock_ns = bench.now_ns
    bench.send(OTHER, hmi)
    bench.line.reply(1, ANSWER, bench.now_ns)
    assert sorted(bench.line.meter.measured) == [("cnc", 1), ("hmi", 1)]
    status = LatencyStatus(bench.line.meter)
    # Only what the link takes: 1 µs of work, 1 µs to write.
    two_us = GatewayTimes(p50=2.0, p99=2.0, p999=2.0, max=2.0, max_minute=2.0)
    assert controller_times(status, "hmi").gateway_us == two_us
    line_times(status)
    status.axis("x")
    for _ in range(10):  # two pairs are added up for each of ten figures
        status.refresh(bench.now_ns)
    of_line = line_times(status).gateway_us
    assert (of_line.p50, of_line.p99, of_line.max) == (2.0, 4.0, 4.0)
    assert status.axis("x").gateway_us == of_line


def test_an_overrun_is_reported_once_when_it_begins_and_once_when_it_has_ended() -> None:
    bench = MeterBench(budget_us=100)
    bench.exchange(60, 20, 500, 19, 1)  # exactly 100: kept
    assert bench.line.meter.overruns == 0
    began_ns = bench.now_ns
    bench.exchange(10, 5, 500, 83, 3)
    bench.exchange(90, 20, 500, 1, 1)
    assert bench.line.meter.overruns == 2
    assert bench.kinds() == ["line-up", "budget-overrun"]
    event = bench.events[-1]
    assert event.axis == "x"
    assert event.detail == (
        "101 µs of gateway time, budget_us = 100; slowest: turning the reply back and writing it, 86 µs; "
        "meanwhile the journal, 400 µs"
    )
    assert bench.ran == [(began_ns, began_ns + 601 * US)]
    bench.wait(10_000)
    for _ in range(99):
        bench.exchange(1, 1, 1, 1, 1)
    assert bench.kinds() == ["line-up", "budget-overrun"]
    bench.exchange(1, 1, 1, 1, 1)
    assert bench.kinds() == ["line-up", "budget-overrun", "budget-kept"]
    bench.exchange(200, 1, 1, 1, 1)
    assert bench.kinds()[-1] == "budget-overrun"
    assert bench.line.meter.overruns == 3


def test_overruns_within_ten_seconds_of_each_other_are_reported_as_one() -> None:
    bench = MeterBench(budget_us=100)
    for _ in range(3):
        bench.exchange(200, 1, 1, 1, 1)
        for _ in range(1000):  # each takes 1 ms and 3 µs of the bench
            bench.exchange(1, 1, 1, 1, 1)
    for _ in range(8960):  # 9960 in a row last 9.99 s
        bench.exchange(1, 1, 1, 1, 1)
    assert bench.kinds() == ["line-up", "budget-overrun"]
    for _ in range(20):
        bench.exchange(1, 1, 1, 1, 1)
    assert bench.kinds() == ["line-up", "budget-overrun", "budget-kept"]
    assert "; 3 over it so far" in bench.events[-1].detail


def test_the_time_of_added_frames_is_measured_separately() -> None:
    link = TimedLink()
    bench = Bench(axis_plan(budget_us=100), link=link)
    port = TimedPort(ControllerPlan("cnc"))
    link.clock_ns = bench.now_ns
    link.work_ns = 10 * US
    target = bytes.fromhex("10 0606 0002 04 0064 0000")
    bench.send(target, port)
    assert link.sent.pop()[1][0] == 3  # where the axis is, is read first
    read_ns = bench.now_ns + 20 * MS
    link.clock_ns = read_ns
    bench.line.reply(1, bytes.fromhex("03 04 0000 0000"), read_ns)
    assert link.sent.pop()[1][0] == 16
    port.clock_ns = read_ns + MS
    bench.line.reply(1, target[:5], read_ns + MS)
    assert bench.line.meter.added_ns == 20 * MS
    assert bench.line.meter.measured["cnc", 1].high.ever_ns == 10 * US
    assert bench.line.meter.overruns == 0


def test_percentiles_of_many_controllers_are_computed_a_few_at_a_time() -> None:
    bench = MeterBench()
    for number in range(10):
        bench.port = bench.timed_port = TimedPort(ControllerPlan(f"cnc-{number}"))
        bench.exchange(work_us=100 + number, write_us=0, drive_us=900, turn_us=0, answer_us=0)
    status = LatencyStatus(bench.line.meter)
    names = [f"cnc-{number}" for number in range(10)]

    def known() -> int:
        shown = [controller_times(status, name) for name in names]
        return sum(getattr(each, part).p50 is not None for each in shown for part in PARTS)

    # Of one controller nothing has to be added up: twelve at once each time.
    assert known() == AT_FIRST
    for _ in range(4):
        status.refresh(bench.now_ns)
        known()
    assert known() == 50
    line = line_times(status).gateway_us
    assert (line.p50, line.max) == (None, 109.0)  # ten pairs have to be added up first
    bench.port = bench.timed_port = TimedPort(ControllerPlan("cnc-0"))
    for _ in range(9):
        bench.exchange(work_us=500, write_us=0, drive_us=900, turn_us=0, answer_us=0)
    for _ in range(40):  # 50 walks for the controllers, 45 additions for the five figures of the line
        status.refresh(bench.now_ns)
    line = line_times(status).gateway_us
    assert line.p50 is not None
    assert is_about(line.p50, 109)  # 19 exchanges, the tenth of them: 100 to 109 µs, then nine of 500
    found = controller_times(status, "cnc-0").gateway_us
    assert found.p50 is not None
    assert is_about(found.p50, 500)
