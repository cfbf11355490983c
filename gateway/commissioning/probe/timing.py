"""The response times of drives to reads, and the resulting time-outs of their line.

The proposal is the measured time with a margin. A drive that writes to its memory, or that is on a busy
network, is slower than a read one. So no proposal is below ``LEAST_MS``.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from math import ceil, log10
from typing import Final

from gateway.commissioning.probe.readings import ProbedRegister, frame_of, registers_of
from gateway.exchange.axis.axis import Axis
from gateway.plain import JsonObject
from gateway.state.plan import LinePlan
from gateway.times import NS_PER_MS
from gateway.transport.endpoints import TcpEndpoint
from gateway.transport.master import ModbusMaster, NoReplyError

READS: Final = 100
"""Of each unit id, for its times."""
GAP_READS: Final = 50
"""Of each unit id with each gap; all unit ids of a line in turn, as a controller polls them."""
GAPS_MS: Final = (0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
GIVEN_UP_AFTER: Final = 3
"""Lost answers in a row: the drive is absent."""
TIMEOUT_MARGIN: Final = 4.0
"""Times the longest answer, for slower commands not measured here, such as a write to the drive's memory."""
DRAIN_MARGIN: Final = 2.0
"""Times the longest answer: a late answer that has begun at the time-out ends within that."""
LEAST_MS: Final = 50.0
LEAST_DRAIN_MS: Final = 20.0


@dataclass(slots=True)
class UnitTimes:
    """Answers of one unit id, in ms, in order of arrival."""

    axis: str
    unit_id: int
    took_ms: list[float] = field(default_factory=list)
    lost: int = 0

    def within(self, share: float) -> float:
        """Return the time within which this share of the answers came."""
        return sorted(self.took_ms)[max(0, ceil(share * len(self.took_ms)) - 1)]


@dataclass(frozen=True, slots=True)
class Proposal:
    """Keys of a line, in ms."""

    response_timeout_ms: float
    drain_ms: float | None
    """None if a line needs none: Modbus/TCP identifies late replies by their numbers."""
    gap_ms: float


@dataclass(slots=True)
class LineTimes:
    """The measurements of one line."""

    line: LinePlan
    units: list[UnitTimes] = field(default_factory=list)
    lost_with_gap: dict[float, int] = field(default_factory=dict)
    """Number of lost answers, by the gap in ms; the first gap without any is the last."""
    left_out: list[str] = field(default_factory=list)

    @property
    def problem(self) -> str:
        """Why there is no proposal; empty if there is one."""
        silent = [str(unit.unit_id) for unit in self.units if not unit.took_ms]
        if silent:
            within = f"within response_timeout_ms = {self.line.timing.response_timeout_ms:g}"
            return (
                f"unit id {', '.join(silent)} did not answer {within}, so there is no proposal: check that "
                "it is on and wired, raise response_timeout_ms and measure again"
            )
        if not self.units:
            return "no register may be read, so there is no proposal"
        if self.gap_ms is None:
            return f"answers are lost even with {GAPS_MS[-1]:g} ms of silence before each: repair the wiring"
        return ""

    @property
    def gap_ms(self) -> float | None:
        """The shortest gap without lost answers; None: there is none."""
        return next((gap_ms for gap_ms, lost in self.lost_with_gap.items() if not lost), None)

    @property
    def now(self) -> Proposal:
        """The configured values."""
        timing = self.line.timing
        return Proposal(
            timing.response_timeout_ms, timing.drain_ms if has_drain(self.line) else None, timing.gap_ms
        )

    @property
    def proposed(self) -> Proposal | None:
        """The values for these times; None if :attr:`problem` has a reason."""
        if self.problem or self.gap_ms is None:
            return None
        longest_ms = max(max(unit.took_ms) for unit in self.units)
        # A gap in the configuration or in a register map may be required by a manual.
        gap_ms = max(self.gap_ms, self.line.timing.gap_ms)
        return propose(longest_ms, gap_ms, has_drain=has_drain(self.line))

    def cost_ms(self, of: Proposal) -> float:
        """Return how long a drive that becomes silent delays motion commands for the others (W6, W11).

        This happens three times; on a line without back-off, at each poll. The wait is as long as the longest
        time-out of the controllers.
        """
        patience_ms = (controller.plan.timeout_ms for controller in self.line.controllers)
        return max(of.response_timeout_ms, *patience_ms, 0.0) + (of.drain_ms or 0.0)

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return {
            "units": {
                str(unit.unit_id): {
                    "axis": unit.axis,
                    "reads": len(unit.took_ms) + unit.lost,
                    "lost": unit.lost,
                    "p50_ms": round(unit.within(0.5), 3) if unit.took_ms else None,
                    "p99_ms": round(unit.within(0.99), 3) if unit.took_ms else None,
                    "max_ms": round(max(unit.took_ms), 3) if unit.took_ms else None,
                }
                for unit in self.units
            },
            "lost_with_gap_ms": {f"{gap_ms:g}": lost for gap_ms, lost in self.lost_with_gap.items()},
            "now": self._with_cost(self.now),
            "proposed": None if self.proposed is None else self._with_cost(self.proposed),
            "problem": self.problem or None,
        }

    def _with_cost(self, of: Proposal) -> dict[str, float | None]:
        return {**asdict(of), "silent_drive_costs_ms": self.cost_ms(of)}

    def lines(self) -> Iterator[str]:
        """Yield the measurements, the proposal and its cost."""
        line = self.line
        yield f"line {line.name}: answers to reads, from the request to the last byte, in ms"
        yield from (f"  {_of_unit(unit)}" for unit in self.units)
        yield from (f"  {left_out}" for left_out in self.left_out)
        for gap_ms, lost in self.lost_with_gap.items():
            what = f"{lost} answers lost" if lost else "nothing lost"
            yield f"  {gap_ms:g} ms of silence before each request, all drives in turn: {what}"
        proposed = self.proposed
        if proposed is None:
            yield f"  error: {self.problem}"
            return
        yield f"  now:      {_keys(self.now)}"
        yield f"  proposed: {_keys(proposed)}"
        cost_ms, now_ms = self.cost_ms(proposed), self.cost_ms(self.now)
        times = "three times" if line.timing.backs_off else "each time"
        yield f"  a silent drive makes others wait {times}: {cost_ms:g} ms; now {now_ms:g} ms"
        yield from (f"  note: {note}" for note in _notes(self, proposed))


def keys_of(proposed: Proposal) -> tuple[str, ...]:
    """Return a proposal as lines of ``[line.NAME]``; a gap of 0 is omitted.

    >>> keys_of(Proposal(50.0, None, 0.0)), keys_of(Proposal(150.0, 70.0, 5.0))
    (('response_timeout_ms = 50',), ('response_timeout_ms = 150', 'drain_ms = 70', 'gap_ms = 5'))
    """
    found = {key: value for key, value in asdict(proposed).items() if value}
    return tuple(f"{key} = {value:g}" for key, value in found.items())


def propose(longest_ms: float, gap_ms: float, *, has_drain: bool) -> Proposal:
    """Return the proposal for a line with this slowest answer.

    >>> propose(4.2, 0.0, has_drain=True)
    Proposal(response_timeout_ms=50.0, drain_ms=20.0, gap_ms=0.0)
    >>> propose(31.0, 5.0, has_drain=True)
    Proposal(response_timeout_ms=150.0, drain_ms=70.0, gap_ms=5.0)
    """
    timeout_ms = _round_up(max(LEAST_MS, TIMEOUT_MARGIN * longest_ms))
    drain_ms = _round_up(max(LEAST_DRAIN_MS, DRAIN_MARGIN * longest_ms)) if has_drain else None
    return Proposal(timeout_ms, drain_ms, gap_ms)


def _round_up(value_ms: float) -> float:
    """Return the next number with at most two digits that are not zero, such as 150.

    >>> [_round_up(ms) for ms in (50.0, 62.0, 124.0, 401.0)]
    [50.0, 70.0, 150.0, 450.0]
    """
    step = 10.0 ** int(log10(value_ms))
    step = step / 2 if value_ms >= 100 else step
    return float(ceil(value_ms / step - 1e-9) * step)


def has_drain(line: LinePlan) -> bool:
    """Whether a line needs silence after a time-out."""
    return not isinstance(line.drives, TcpEndpoint) or line.drives.rtu


def open_line(line: LinePlan, gap_ms: float) -> ModbusMaster:
    """Return a master for a line, with the line's settings except for the gap."""
    return ModbusMaster(line.drives, line.timing.response_timeout_ms, gap_ms, line.timing.drain_ms)


async def measure_line(line: LinePlan) -> LineTimes:
    """Measure one line whose drives are on.

    Raises:
        TransportError: it cannot be reached.
    """
    found = LineTimes(line)
    asked = _asked(line, found)
    async with open_line(line, line.timing.gap_ms) as master:
        for axis, register in asked:
            unit = UnitTimes(axis.plan.name, axis.plan.unit_id)
            found.units.append(unit)
            await _read_often(master, axis, register, unit)
    if asked and all(unit.took_ms for unit in found.units):
        for gap_ms in GAPS_MS:
            async with open_line(line, gap_ms) as master:
                lost = await _lost(master, asked)
            found.lost_with_gap[gap_ms] = lost
            if not lost:
                break
    return found


def _asked(line: LinePlan, found: LineTimes) -> list[tuple[Axis, ProbedRegister]]:
    """Return the read for each unit id: the actual position if there is one."""
    asked: dict[int, tuple[Axis, ProbedRegister]] = {}
    for plan in line.axes:
        registers = registers_of(plan)
        if not registers:
            found.left_out.append(f"axis {plan.name}: its register map allows no reads")
            continue
        register = next((each for each in registers if each.name == "actual"), registers[0])
        asked.setdefault(plan.unit_id, (Axis(plan), register))
    return list(asked.values())


async def _read_often(master: ModbusMaster, axis: Axis, register: ProbedRegister, unit: UnitTimes) -> None:
    lost_in_a_row = 0
    for _ in range(READS):
        took_ms = await _read_once(master, axis, register)
        if took_ms is None:
            unit.lost += 1
            lost_in_a_row += 1
            if lost_in_a_row >= GIVEN_UP_AFTER:
                return
            continue
        lost_in_a_row = 0
        unit.took_ms.append(took_ms)


async def _lost(master: ModbusMaster, asked: Sequence[tuple[Axis, ProbedRegister]]) -> int:
    lost = 0
    for _ in range(GAP_READS):
        for axis, register in asked:
            lost += await _read_once(master, axis, register) is None
            if lost >= GIVEN_UP_AFTER:
                return lost
    return lost


async def _read_once(master: ModbusMaster, axis: Axis, register: ProbedRegister) -> float | None:
    """Return the time of an answer in ms, including a refusal; None: no answer."""
    try:
        await master.exchange(axis.plan.unit_id, frame_of(axis, register).pdu)
    except NoReplyError:
        return None
    return master.took_ns / NS_PER_MS


def _of_unit(unit: UnitTimes) -> str:
    who = f"axis {unit.axis}, unit id {unit.unit_id}"
    if not unit.took_ms:
        return f"{who}: no answer"
    lost = f"{unit.lost} lost" if unit.lost else "none lost"
    return (
        f"{who}: {len(unit.took_ms)} answers, half within {unit.within(0.5):.2f}, 99 % within "
        f"{unit.within(0.99):.2f}, longest {max(unit.took_ms):.2f}, {lost}"
    )


def _keys(of: Proposal) -> str:
    drain = "" if of.drain_ms is None else f", drain_ms = {of.drain_ms:g}"
    return f"response_timeout_ms = {of.response_timeout_ms:g}{drain}, gap_ms = {of.gap_ms:g}"


def _notes(found: LineTimes, proposed: Proposal) -> Iterator[str]:
    yield (
        "only reads were measured: a drive that stores written values may need longer; raise "
        "response_timeout_ms if writes are not answered in time"
    )
    if found.gap_ms is not None and found.gap_ms < proposed.gap_ms:
        yield (
            f"nothing was lost with {found.gap_ms:g} ms of silence, but gap_ms = {proposed.gap_ms:g} is "
            "configured or in the register map of a drive: shorten it only if no manual requires it"
        )
    patient = [
        f"{controller.plan.name} ({controller.plan.timeout_ms:g})"
        for controller in found.line.controllers
        if controller.plan.timeout_ms > proposed.response_timeout_ms
    ]
    if patient:
        shortest_ms = proposed.response_timeout_ms + (proposed.drain_ms or 0.0)
        yield (
            "the gateway waits for a drive as long as its slowest controller: timeout_ms of "
            f"{', '.join(patient)}; with {proposed.response_timeout_ms:g} there, a silent drive costs "
            f"{shortest_ms:g} ms"
        )
