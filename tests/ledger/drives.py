"""The drives: registers with a motor behind them that takes its time. They know nothing of any correction."""

from typing import NamedTuple

from tests.ledger.clock import MS
from tests.ledger.frames import Parsed, bytes_of, parse
from tests.ledger.layouts import (
    CONTROL_ENABLE,
    CONTROL_START,
    DONE_BIT,
    IMAGE_RELATIVE,
    JOG,
    MODE_ABSOLUTE,
    MODE_RELATIVE,
    MOVING_BIT,
    RUN,
    RUN_RELATIVE,
    STOP,
    Basis,
    Layout,
    Style,
)
from tests.ledger.screws import TRAVEL_MM

JOG_COUNTS = 1_777


class Motor:
    """One axis: goes to where it is told at one speed, and stops where it is. Positions in counts."""

    def __init__(self, position: int, counts_per_s: float) -> None:
        self.begun_at = self.end = position
        self._since_ns = self.arrives_ns = 0
        self._counts_per_ns = counts_per_s / 1e9
        self.last_sense = 0
        """Sign of the last travel, in counts."""

    def at(self, now_ns: int) -> int:
        if now_ns >= self.arrives_ns:
            return self.end
        way = int((now_ns - self._since_ns) * self._counts_per_ns)
        return self.begun_at + (way if self.end > self.begun_at else -way)

    def is_moving(self, now_ns: int) -> bool:
        return now_ns < self.arrives_ns

    def go(self, end: int, now_ns: int) -> None:
        """Go somewhere from here; to be told to stay is no motion."""
        if end == self.end and not self.is_moving(now_ns):
            return
        self.begun_at, self._since_ns = self.at(now_ns), now_ns
        self.end = end
        way = end - self.begun_at
        self.arrives_ns = now_ns + int(abs(way) / self._counts_per_ns) if way else now_ns
        if way:
            self.last_sense = 1 if way > 0 else -1


class Operation(NamedTuple):
    kind: str
    """absolute, relative, stop, jog."""
    was_at: int
    was_moving: bool
    base: int
    """From where a distance counted."""
    end: int
    end_before: int
    """Where the motion before led."""


class Drive:
    """The registers of one unit id."""

    def __init__(self, layout: Layout, position: int, speed_mm_s: float, lag_ms: float = 0.0) -> None:
        """``lag_ms``: for so long after a move began the status bits still say what they said before."""
        self.layout = layout
        self._lag_ns = int(lag_ms * MS)
        self._says_so_ns = 0
        self.hushed_ns = 0
        """Until then nobody looks at its status: it is being moved from its own panel."""
        self.motor = Motor(position, speed_mm_s * abs(layout.counts_per_unit))
        self.words: dict[int, int] = {}
        self._last_target = position
        self._control = 0
        self._put(layout.command, layout.split(position))

    @property
    def target(self) -> int:
        return self.layout.join(self._get(self.layout.command))

    @property
    def mode(self) -> int:
        return self.words.get(self.layout.mode, 0)

    def execute(self, pdu: bytes, now_ns: int) -> tuple[bytes, list[Operation]]:
        """Do a request: return the reply, and what the motor was made to do."""
        request = parse(pdu)
        if request.function == 0x41:
            return b"\x41" + pdu[:0:-1], []
        if request.read is None and request.write is None:
            return bytes((request.function | 0x80, 1)), []
        operations = self._write(request, now_ns) if request.write else []
        if request.read:
            data = bytes_of([self._read(request.read[0] + i, now_ns) for i in range(request.read[1])])
            return bytes((request.function, len(data))) + data, operations
        return (pdu[:5] if request.function == 16 else pdu), operations

    def _get(self, address: int) -> tuple[int, int]:
        return self.words.get(address, 0), self.words.get(address + 1, 0)

    def _put(self, address: int, words: tuple[int, ...]) -> None:
        for i, word in enumerate(words):
            self.words[address + i] = word

    def _read(self, address: int, now_ns: int) -> int:
        layout, motor = self.layout, self.motor
        if layout.actual <= address < layout.actual + 2:
            return layout.split(motor.at(now_ns))[address - layout.actual]
        if layout.commanded is not None and layout.commanded <= address < layout.commanded + 2:
            return layout.split(motor.at(now_ns))[address - layout.commanded]
        if address == layout.status:
            is_seen_moving = motor.is_moving(now_ns) and now_ns >= self._says_so_ns
            return 1 << MOVING_BIT if is_seen_moving else 1 << DONE_BIT
        return self.words.get(address, (address * 7919) & 0xFFFF)

    def _write(self, request: Parsed, now_ns: int) -> list[Operation]:
        assert request.write is not None
        address, words = request.write
        if request.mask is not None:
            and_mask, or_mask = request.mask
            words = (self.words.get(address, 0) & and_mask | or_mask & ~and_mask & 0xFFFF,)
        self._put(address, words)
        return self._act(range(address, address + len(words)), now_ns)

    def _act(self, written: range, now_ns: int) -> list[Operation]:
        layout = self.layout
        if layout.style is Style.IMAGE:
            return self._act_on_image(now_ns) if layout.trigger in written else []
        operations: list[Operation] = []
        holds_target = layout.command in written or layout.command + 1 in written
        if holds_target and not layout.is_staged:
            is_relative = layout.style is Style.BLOCK and layout.mode in written and bool(self.mode & 1)
            operations.append(self._run(now_ns, is_relative=is_relative))
        if layout.trigger in written and layout.style is not Style.PLAIN:
            operations += self._act_on_trigger(self.words[layout.trigger], now_ns)
        return operations

    def _act_on_image(self, now_ns: int) -> list[Operation]:
        before, self._control = self._control, self.words[self.layout.trigger]
        if not self._control & CONTROL_ENABLE:
            return [self._stop(now_ns)]
        if self._control & CONTROL_START and not before & CONTROL_START:
            return [self._run(now_ns, is_relative=bool(self.mode & IMAGE_RELATIVE))]
        return []

    def _act_on_trigger(self, value: int, now_ns: int) -> list[Operation]:
        if value == STOP:
            return [self._stop(now_ns)]
        if value == JOG:
            return [self.jog(now_ns)]
        if self.layout.style is Style.TRIGGERED and value in (RUN, RUN_RELATIVE):
            if value == RUN_RELATIVE and self.layout.basis is None:
                return []
            return [self._run(now_ns, is_relative=value == RUN_RELATIVE)]
        if self.layout.style is Style.STICKY and value == RUN and self.mode in (MODE_ABSOLUTE, MODE_RELATIVE):
            return [self._run(now_ns, is_relative=self.mode == MODE_RELATIVE)]
        return []

    def jog(self, now_ns: int) -> Operation:
        """Go a little further, as by a command or by its panel."""
        was_at, was_moving = self.motor.at(now_ns), self.motor.is_moving(now_ns)
        end_before = self.motor.end
        middle = self.layout.counts(TRAVEL_MM / 2)
        end = was_at + (JOG_COUNTS if was_at < middle else -JOG_COUNTS)
        self._go(end, now_ns)
        return Operation("jog", was_at, was_moving, was_at, end, end_before)

    def _go(self, end: int, now_ns: int) -> None:
        if not self.motor.is_moving(now_ns):
            self._says_so_ns = now_ns + self._lag_ns
        self.motor.go(end, now_ns)
        self._last_target = end

    def _stop(self, now_ns: int) -> Operation:
        was_at, was_moving = self.motor.at(now_ns), self.motor.is_moving(now_ns)
        end_before = self.motor.end
        self._go(was_at, now_ns)
        return Operation("stop", was_at, was_moving, was_at, was_at, end_before)

    def _run(self, now_ns: int, *, is_relative: bool) -> Operation:
        was_at, was_moving = self.motor.at(now_ns), self.motor.is_moving(now_ns)
        base, end_before = 0, self.motor.end
        if is_relative:
            base = self._last_target if self.layout.basis is Basis.TARGET else was_at
        end = base + self.target
        self._go(end, now_ns)
        return Operation("relative" if is_relative else "absolute", was_at, was_moving, base, end, end_before)


def settle_ms(drive: Drive, now_ns: int) -> float:
    return max(0.0, (drive.motor.arrives_ns - now_ns) / MS)
