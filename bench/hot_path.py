"""What the hot path costs, as ratios inside one run: rounds of all candidates interleaved, medians printed.

Run with ``make bench``. Ratios travel between machines; the absolute figures beside them do not.
"""

import asyncio
import statistics
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import sin
from operator import is_

from gateway.clock import boot_ns
from gateway.compensation.correction_map import CorrectionMap, Term
from gateway.compensation.curve import Curve
from gateway.compensation.settings import AxisSettings, Setpoints, ThermalSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.control import set_temperature
from gateway.exchange.fast_path import find_path
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import (
    AxisPlan,
    CompensationMode,
    ControllerPlan,
    CrossPlan,
    LineTiming,
    Reference,
)
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.transaction import Transaction
from gateway.exchange.unit import UnitMap
from gateway.modbus.registers import PositionField, RegisterType
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, encode_rtu
from gateway.recording import traffic
from gateway.recording.tap import TraceTap
from gateway.recording.trace_buffer import TraceBuffer
from gateway.relay.alarm import LineAlarm
from gateway.relay.controller_port import RtuControllerPort
from gateway.relay.drive_link import RtuDriveLink
from gateway.relay.pulse import Pulse
from gateway.transport.channel import Channel

ROUNDS = 15
CALLS = 2_000
COMMAND = PositionField(0x6201, RegisterType.INT32)
CYCLE_NS = 4_000_000
CALM_S = 0.05
"""So long the loop turns before each round: what comes right after a standstill may have waited meanwhile."""
TAPE_BYTES = 4 << 20
HEARD_EVERY = 250
"""Setpoints from one word of the sensor to the next: a second."""


@dataclass
class Candidate:
    """One thing to measure: ``call(i)`` is made ``CALLS`` times a round."""

    name: str
    call: Callable[[int], object]
    part_ns: Callable[[], int] | None = None
    """Where only a part of the call counts: the nanoseconds of that part since the last time it was asked."""
    around: Callable[[int], object] | None = None
    """What the call does beside what counts: measured in the same round, and taken off."""
    ns: list[float] = field(default_factory=list)

    def round(self) -> None:
        call = self.call
        if self.part_ns is not None:
            self.part_ns()
            for i in range(CALLS):
                call(i)
            self.ns.append(self.part_ns() / CALLS)
            return
        without_ns = 0 if self.around is None else _taken_ns(self.around)
        self.ns.append((_taken_ns(call) - without_ns) / CALLS)

    @property
    def median_ns(self) -> float:
        return statistics.median(self.ns)


def _taken_ns(call: Callable[[int], object]) -> int:
    start = time.perf_counter_ns()
    for i in range(CALLS):
        call(i)
    return time.perf_counter_ns() - start


class _Port(ControllerPort):
    """Frames as the relay does and throws the bytes away."""

    def __init__(self) -> None:
        super().__init__(ControllerPlan("cnc", serial=True))

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        encode_rtu(unit_id, pdu)


class _Wire(DriveLink):
    """The same of the link, with a controller's port beside it."""

    def __init__(self) -> None:
        super().__init__(is_serial=True)
        self.port = _Port()
        self.arrived_ns = 0
        self._request_ns = 0

    def arrive(self) -> None:
        """Bytes come now."""
        self.arrived_ns = time.perf_counter_ns()

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        encode_rtu(unit_id, pdu)
        self._request_ns += time.perf_counter_ns() - self.arrived_ns

    def take_request_ns(self) -> int:
        """Time from the last byte of the request in to its first byte out, since the last call."""
        taken, self._request_ns = self._request_ns, 0
        return taken

    def abandon(self) -> None:
        """Nothing is expected here."""


def correction_at(points: int, *, is_even: bool) -> Callable[[int], object]:
    step = 1000.0 / (points - 1)
    positions = [i * step for i in range(points)]
    if not is_even:
        positions = [x + 0.2 * step * (i % 2) for i, x in enumerate(positions)]
    curve = [0.02 * sin(x / 50) for x in positions]
    table = make_table(positions, curve, [c - 0.01 for c in curve], Units.MM)
    correction = CorrectionMap((Term(Curve(table), 1.0, 0.0),)).correction
    # Each on another segment than the one before, which is remembered.
    return lambda i: correction(i * 1.07 % 1000.0)


def plan_of_x() -> AxisPlan:
    table = make_table([0, 500, 1000], [0.0, 0.02, 0.0], [-0.02, 0.0, -0.02], Units.MM)
    return AxisPlan(
        "x", 1, AxisSettings(Units.MM, 1000.0, setpoints=Setpoints.STREAM), table, CompensationMode.ON,
        Reference.ABSOLUTE, (COMMAND,), added_frames=False,
    )  # fmt: skip


def writes_of_x() -> tuple[list[bytes], bytes]:
    """Return frames that write a position, each another one, and the reply to all of them."""
    head = b"\x10\x62\x01\x00\x02"
    frames = [encode_rtu(1, head + b"\x04" + COMMAND.pack(counts)) for counts in range(0, 200_000, 100)]
    return frames, encode_rtu(1, head)


class _End(Channel):
    """The end of a wire that takes bytes and throws them away."""

    write = deque[bytes](maxlen=0).append  # type: ignore[assignment]  # costs less than a method of ours

    def has_gone(self, *, asks: bool) -> bool:
        return False


def relayed_write(*, is_taped: bool) -> Callable[[int], object]:
    """What the relay has between two serial ports: port, exchange, link, meter; ``is_taped``: and its tape.

    In a running loop.
    """
    link = RtuDriveLink(0, RtuReplyDecoder())
    tap = None
    if is_taped:
        tap = TraceTap("line", TraceBuffer("line", TAPE_BYTES, boot_ns(), time.time_ns()), _beginning)
    line = LineExchange([plan_of_x()], LineTiming(), link, lambda _: None, tap=tap)
    LineAlarm(line, lambda: 0)
    pulse = Pulse(line.report_standstill)
    link.attach(line)
    plan = ControllerPlan("cnc", serial=True)
    port = RtuControllerPort(plan, line, RtuRequestDecoder(), 0, beats=pulse)
    port.opened(_End(), boot_ns())
    link.opened(_End(), boot_ns())
    return read_by(port.received, link.received)


def read_by(
    requested: Callable[[bytes, int], object], replied: Callable[[bytes, int], object]
) -> Callable[[int], object]:
    """Return what a transport does: it hands over what it read, with the time of each read."""
    frames, echo = writes_of_x()

    def call(i: int) -> None:
        requested(frames[i], boot_ns())
        replied(echo, boot_ns())

    return call


def _beginning(now_ns: int) -> traffic.Beginning:
    return traffic.Beginning("line", now_ns, (), is_up=True)


def rewritten_write(wire: _Wire) -> Callable[[int], object]:
    line = LineExchange([plan_of_x()], LineTiming(), wire, lambda _: None)
    line.link_up(0)
    requests, replies = RtuRequestDecoder(), RtuReplyDecoder()
    frames, echo = writes_of_x()

    def call(i: int) -> None:
        wire.arrive()
        for unit_id, pdu in requests.feed(frames[i], i):
            line.request(wire.port, 0, unit_id, pdu, i)
            replies.expect(unit_id, pdu)
        for unit_id, pdu in replies.feed(echo, i):
            line.reply(unit_id, pdu, i)

    return call


class Stream:
    """Setpoints of x, one each cycle, with what terms may cost. Only the exchange of x counts."""

    def __init__(self, *, has_terms: bool, other_moves: bool = False) -> None:
        self._wire, self._other_moves, self._has_terms = _Wire(), other_moves, has_terms
        x, y = plan_of_x(), replace(plan_of_x(), name="y", unit_id=2)
        if has_terms:
            x = replace(
                x,
                settings=replace(x.settings, travel=(0.0, 1000.0)),
                thermal=ThermalSettings(11.5e-6),
                cross=(CrossPlan("y", (0.0, 1000.0), (0.0, 0.1)),),
            )
        self._line = LineExchange([x, y], LineTiming(), self._wire, lambda _: None)
        self._line.link_up(0)
        self._cycle = self._ns = 0
        for _ in range(CALLS):  # until the change-over at the start is over
            self.call(0)
        self.take_ns()

    def call(self, _: int) -> None:
        self._cycle += 1
        cycle, now_ns = self._cycle, self._cycle * CYCLE_NS
        if self._has_terms and cycle % HEARD_EVERY == 1:
            set_temperature(self._line.axes, "x", 30.0 + 5.0 * sin(cycle), now_ns)
        if self._other_moves or cycle == 1:
            self._exchange(2, 400_000 + cycle % 1000, now_ns)
        start = time.perf_counter_ns()
        self._exchange(1, 100 * (cycle % 2_000), now_ns)
        self._ns += time.perf_counter_ns() - start

    def _exchange(self, unit_id: int, counts: int, now_ns: int) -> None:
        pdu = b"\x10\x62\x01\x00\x02\x04" + COMMAND.pack(counts)
        self._line.request(self._wire.port, 0, unit_id, pdu, now_ns)
        self._line.reply(unit_id, pdu[:5], now_ns)

    def take_ns(self) -> int:
        taken, self._ns = self._ns, 0
        return taken


def rewritten_request() -> Callable[[int], object]:
    """Only what turns a frame into the corrected frame: taken apart, corrected, put together, both CRCs."""
    wire = _Wire()
    line = LineExchange([plan_of_x()], LineTiming(), wire, lambda _: None)
    line.link_up(0)
    requests = RtuRequestDecoder()
    head = b"\x10\x62\x01\x00\x02\x04"
    for counts in range(0, 100_000, 100):  # until the change-over at the start is over
        line.request(wire.port, 0, 1, head + COMMAND.pack(counts), counts)
        line.reply(1, head[:5], counts)
    path = find_path(UnitMap(line.axes), 1, head + COMMAND.pack(0))
    assert path is not None
    frames = [encode_rtu(1, head + COMMAND.pack(counts)) for counts in range(100_000, 300_000, 100)]

    def call(i: int) -> None:
        for unit_id, pdu in requests.feed(frames[i], i):
            corrected = path.sent(Transaction(wire.port, 0, unit_id, pdu, i), i)
            assert corrected is not None
            encode_rtu(unit_id, corrected)

    return call


def measured_exchange() -> Callable[[int], object]:
    """What measuring adds to an exchange: two looks at the clock, and the counting."""
    port, link = _Port(), _Wire()
    now_ns = time.monotonic_ns()
    link.stamps.ready_ns, link.stamps.sent_ns = now_ns + 4_000, now_ns + 9_000
    port.stamps.sent_ns = now_ns + 908_000
    line = LineExchange([plan_of_x()], LineTiming(), link, lambda _: None)
    transaction = Transaction(port, 0, 1, b"\x10\x62\x01\x00\x02\x04\x00\x00\x00\x00", now_ns)
    echo = b"\x10\x62\x01\x00\x02"
    add, clock = line.meter.add, time.monotonic_ns

    def call(i: int) -> None:
        clock()
        clock()
        add(transaction, port, echo, now_ns + 900_000 + i)

    return call


def passed_read() -> Callable[[int], object]:
    wire = _Wire()
    line = LineExchange([], LineTiming(), wire, lambda _: None)
    line.link_up(0)
    requests, replies = RtuRequestDecoder(), RtuReplyDecoder()
    frame = encode_rtu(1, b"\x03\x10\x03\x00\x01")
    answer = encode_rtu(1, b"\x03\x02\x00\x07")

    def call(i: int) -> None:
        for unit_id, pdu in requests.feed(frame, i):
            line.request(wire.port, 0, unit_id, pdu, i)
            replies.expect(unit_id, pdu)
        for unit_id, pdu in replies.feed(answer, i):
            line.reply(unit_id, pdu, i)

    return call


async def measured() -> list[Candidate]:
    """Measure all candidates, in turn; in a loop, on which what the relay has beats."""
    other = _Wire()
    plain, warm = Stream(has_terms=False), Stream(has_terms=True)
    follower = Stream(has_terms=True, other_moves=True)
    transport = read_by(is_, is_)  # which takes two arguments, and nothing else
    candidates = [
        Candidate("correction, 1 000 points, even grid", correction_at(1_000, is_even=True)),
        Candidate("correction, 100 000 points, even grid", correction_at(100_000, is_even=True)),
        Candidate("correction, 1 000 points, free grid", correction_at(1_000, is_even=False)),
        Candidate("correction, 100 000 points, free grid", correction_at(100_000, is_even=False)),
        Candidate("a whole exchange that holds no position, RTU bytes to bytes and back", passed_read()),
        Candidate(
            "a whole corrected FC16 exchange, RTU bytes to bytes and back",
            relayed_write(is_taped=False),
            around=transport,
        ),
        Candidate(
            "  the same with what `capture` keeps of it", relayed_write(is_taped=True), around=transport
        ),
        Candidate("  what hands over the bytes and looks at the clock, which both do without", transport),
        Candidate("rewriting one FC16 request: bytes in to bytes out", rewritten_request()),
        Candidate("  the same with what the line keeps of it", rewritten_write(other), other.take_request_ns),
        Candidate("one setpoint of a stream, there and back", plain.call, plain.take_ns),
        Candidate("the same with thermal and one cross term, whose axis stands", warm.call, warm.take_ns),
        Candidate("the same with both, whose axis gets setpoints too", follower.call, follower.take_ns),
        Candidate("measuring one exchange: clock, histograms, high marks", measured_exchange()),
    ]
    for _ in range(ROUNDS):
        for candidate in candidates:
            await asyncio.sleep(CALM_S)
            candidate.round()
    return candidates


def main() -> None:
    candidates = asyncio.run(measured())
    base = candidates[0].median_ns
    out = sys.stdout.write
    out(f"{'':70} {'ratio':>7} {'µs':>8}\n")
    for candidate in candidates:
        out(f"{candidate.name:70} {candidate.median_ns / base:7.2f} {candidate.median_ns / 1000:8.2f}\n")


if __name__ == "__main__":
    main()
