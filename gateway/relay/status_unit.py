"""The gateway's own unit id: its status as registers, for a PLC or a panel without MQTT.

Read-only. Requests end here and never reach a drive. ``BLOCKS`` is the table of registers; documents, replies
and tests are made from it. Values are calculated only when they are read.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from gateway.catalogue import alarms as kinds
from gateway.catalogue.entry import Severity
from gateway.exchange.axis.axis import Axis
from gateway.exchange.line import LineExchange
from gateway.exchange.ports import OwnUnit
from gateway.exchange.silent_units import Reach, Silence
from gateway.exchange.status import compensation_state, direction_state
from gateway.modbus.pdu import ExceptionCode, FunctionCode, exception_pdu
from gateway.times import NS_PER_MS, NS_PER_S

LAYOUT: Final = 1
"""Raised when the meaning of a register changes; new registers do not raise it."""
HEARTBEAT_NS: Final = 100 * NS_PER_MS
SILENT_NS: Final = int(kinds.SILENT_S * NS_PER_S)
WORD: Final = 0xFFFF
LONG: Final = 0xFFFFFFFF
MILLIONTHS: Final = 1e6
LARGEST_READ: Final = 125
"""Registers in one request (Modbus Application Protocol V1.1b3, 6.3)."""
READS: Final = (FunctionCode.READ_HOLDING_REGISTERS, FunctionCode.READ_INPUT_REGISTERS)

COMPENSATION_CODES: Final = {
    "active": 1,
    "blending": 2,
    "shadow": 3,
    "off": 4,
    "unreferenced": 5,
    "no-table": 6,
    "outside": 7,
    "blocked": 8,
}
DIRECTION_CODES: Final = {"unknown": 0, "forward": 1, "backward": 2, "unsure": 3}
_ERRORS: Final = frozenset(each.kind for each in kinds.OF_COMPENSATION if each.severity is Severity.ERROR)
_WARNINGS: Final = frozenset(each.kind for each in kinds.OF_COMPENSATION) - _ERRORS


class Whole:
    """The state of the gateway at one moment."""

    def __init__(self, lines: Sequence[LineExchange], started_ns: int, now_ns: int) -> None:
        self.uptime_ns = now_ns - started_ns
        self.lines: list[OfLine] = [OfLine(line, now_ns) for line in lines]
        self.axes: list[OfAxis] = [
            OfAxis(axis, number, of)
            for number, of in enumerate(self.lines, start=1)
            for axis in of.exchange.axes
        ]

    def alarm(self) -> int:
        """Return the bits of the register ``alarm``: errors and warnings."""
        bits = (
            any(not line.exchange.serves for line in self.lines),
            any(line.silent for line in self.lines),
            any(axis.state in _ERRORS for axis in self.axes),
        )
        word = sum(is_set << number for number, is_set in enumerate(bits, start=1))
        is_uncorrected = any(axis.state in _WARNINGS for axis in self.axes)
        return (word != 0) | word | is_uncorrected << (len(bits) + 1)


class OfLine:
    """A line, with the unit ids that have been silent long enough to count as silent."""

    def __init__(self, exchange: LineExchange, now_ns: int) -> None:
        self.exchange = exchange
        self.now_ns = now_ns
        of_axes = {axis.plan.unit_id for axis in exchange.axes}
        self.silent: dict[int, Silence] = {
            unit_id: silence
            for unit_id, silence in sorted(exchange.silent_units.silences.items())
            if silence.reach is not Reach.ANSWERS
            and now_ns - silence.since_ns >= SILENT_NS
            and (unit_id in of_axes or silence.timeouts >= kinds.FEWEST_ASKED)
        }

    def silent_s(self, unit_ids: Iterable[int]) -> int:
        """Return how long the longest silent of some unit ids has been silent; 0: none of them is."""
        since_ns = [self.silent[each].since_ns for each in unit_ids if each in self.silent]
        return min((self.now_ns - min(since_ns)) // NS_PER_S, WORD) if since_ns else 0


class OfAxis:
    """An axis, with the number of its line."""

    def __init__(self, axis: Axis, line: int, of_line: OfLine) -> None:
        self.axis = axis
        self.line = line
        self.unit_id = axis.plan.unit_id
        self.silent_s = of_line.silent_s((self.unit_id,))
        self.state = compensation_state(axis)

    def correction(self) -> int:
        """Return the correction at the last accepted target, in millionths of a unit; 0: there is none."""
        accepted = self.axis.compensation.accepted
        if accepted is None:
            return 0
        counts = accepted.corrected_counts - accepted.nominal_counts
        return round(counts / self.axis.plan.settings.counts_per_unit * MILLIONTHS)

    def flags(self) -> int:
        """Return the bits of the register ``flags``."""
        axis = self.axis
        bits = (
            axis.reference.is_referenced,
            axis.correction.is_enabled,
            self.silent_s != 0,
            axis.compensation.accepted is not None,
        )
        return sum(is_set << number for number, is_set in enumerate(bits))


_Of = TypeVar("_Of")


@dataclass(frozen=True, slots=True)
class Register(Generic[_Of]):
    """One value. ``words`` is 2 for a 32-bit number: two's complement, high word first."""

    offset: int
    name: str
    words: int
    description: str
    read: Callable[[_Of], int]


@dataclass(frozen=True, slots=True)
class RegisterBlock(Generic[_Of]):
    """Registers for each element of ``of``, ``size`` each, from ``first`` on; unnamed registers are 0."""

    first: int
    size: int
    what: str
    registers: tuple[Register[_Of], ...]
    of: Callable[[Whole], Sequence[_Of]]

    def words(self, whole: Whole) -> list[int]:
        """Return the current values of all its registers."""
        words: list[int] = []
        for each in self.of(whole):
            part = [0] * self.size
            for register in self.registers:
                value = register.read(each)
                if register.words == 1:
                    part[register.offset] = min(value, WORD)
                else:
                    part[register.offset : register.offset + 2] = divmod(value & LONG, WORD + 1)
            words += part
        return words


def _codes(codes: dict[str, int]) -> str:
    return ", ".join(f"{code} `{name}`" for name, code in codes.items())


GATEWAY: Final[RegisterBlock[Whole]] = RegisterBlock(
    0,
    10,
    "the gateway",
    (
        Register(0, "layout", 1, f"{LAYOUT}; another number: another table than this one", lambda _: LAYOUT),
        Register(
            1,
            "heartbeat",
            1,
            "tenths of a second since the start, modulo 65536: unchanged for a second means dead",
            lambda whole: whole.uptime_ns // HEARTBEAT_NS & WORD,
        ),
        Register(
            2,
            "alarm",
            1,
            "bit 0: alarm, one of the bits 1 to 3 is set; bit 1: a line is down; bit 2: a drive is silent; "
            "bit 3: an axis is blocked. Bit 4, no alarm: an axis is not corrected, or not all the way (its "
            "`state` says why)",
            Whole.alarm,
        ),
        Register(3, "lines", 1, "number of lines", lambda whole: len(whole.lines)),
        Register(
            4,
            "lines up",
            1,
            "number of lines whose drives can be reached",
            lambda whole: sum(line.exchange.serves for line in whole.lines),
        ),
        Register(5, "axes", 1, "number of axes", lambda whole: len(whole.axes)),
        Register(
            6,
            "silent drives",
            1,
            "number of unit ids, on all lines, that have not answered for 2 s or longer",
            lambda whole: sum(len(line.silent) for line in whole.lines),
        ),
    ),
    lambda whole: (whole,),
)
LINES: Final[RegisterBlock[OfLine]] = RegisterBlock(
    100,
    10,
    "each line, in the order of the configuration",
    (
        Register(0, "up", 1, "1: its drives can be reached; 0: they cannot", lambda of: of.exchange.is_up),
        Register(1, "silent drives", 1, "number of its silent unit ids", lambda of: len(of.silent)),
        Register(
            2,
            "silent unit id",
            1,
            "the lowest of them; 0: none is silent",
            lambda of: next(iter(of.silent), 0),
        ),
        Register(
            3,
            "silent for",
            1,
            "seconds since the first request that the longest silent of them left unanswered; 65535: or "
            "longer",
            lambda of: of.silent_s(of.silent),
        ),
        Register(
            4,
            "exchanges",
            2,
            "exchanges with its drives since the start, modulo 2³²",
            lambda of: of.exchange.counters.exchanges,
        ),
        Register(
            6,
            "time-outs",
            2,
            "exchanges that a drive did not answer in time, modulo 2³²",
            lambda of: of.exchange.counters.timeouts,
        ),
    ),
    lambda whole: whole.lines,
)
AXES: Final[RegisterBlock[OfAxis]] = RegisterBlock(
    1000,
    10,
    "each axis, line by line, in the order of the configuration",
    (
        Register(
            0,
            "state",
            1,
            f"of the compensation: {_codes(COMPENSATION_CODES)}",
            lambda of: COMPENSATION_CODES[of.state],
        ),
        Register(
            1,
            "direction",
            1,
            _codes(DIRECTION_CODES),
            lambda of: DIRECTION_CODES[direction_state(of.axis)],
        ),
        Register(
            2,
            "correction",
            2,
            "what is added at the last accepted target, signed, in millionths of the unit of the axis "
            "(with mm: nanometres); 0 where there is none",
            OfAxis.correction,
        ),
        Register(
            4,
            "flags",
            1,
            "bit 0: referenced; bit 1: compensation is switched on; bit 2: its drive is silent; bit 3: it "
            "has an accepted target",
            OfAxis.flags,
        ),
        Register(5, "silent for", 1, "seconds, as of a line; 0: its drive answers", lambda of: of.silent_s),
        Register(6, "unit id", 1, "of its drive", lambda of: of.unit_id),
        Register(7, "line", 1, "number of its line, from 1", lambda of: of.line),
    ),
    lambda whole: whole.axes,
)
BLOCKS: Final = (GATEWAY, LINES, AXES)


class StatusUnit(OwnUnit):
    """Answers reads of ``BLOCKS`` (FC03 and FC04), and refuses everything else as a slave does."""

    def __init__(self, unit_id: int, lines: Callable[[], Sequence[LineExchange]], started_ns: int) -> None:
        super().__init__(unit_id)
        self._lines = lines
        self._started_ns = started_ns

    def answer(self, pdu: bytes, now_ns: int) -> bytes:
        """See ``OwnUnit``. Exception 1: no register read; 3: wrong format; 2: outside of a block."""
        function = pdu[0]
        if function not in READS:
            return exception_pdu(function, ExceptionCode.ILLEGAL_FUNCTION)
        quantity = int.from_bytes(pdu[3:5], "big")
        if len(pdu) != 5 or not 1 <= quantity <= LARGEST_READ:
            return exception_pdu(function, ExceptionCode.ILLEGAL_DATA_VALUE)
        words = self._read(int.from_bytes(pdu[1:3], "big"), quantity, now_ns)
        if words is None:
            return exception_pdu(function, ExceptionCode.ILLEGAL_DATA_ADDRESS)
        return bytes((function, 2 * quantity)) + b"".join(word.to_bytes(2, "big") for word in words)

    def _read(self, address: int, quantity: int, now_ns: int) -> list[int] | None:
        whole = Whole(self._lines(), self._started_ns, now_ns)
        for block in BLOCKS:
            start = address - block.first
            if 0 <= start < block.size * len(block.of(whole)):
                words = block.words(whole)
                return words[start : start + quantity] if start + quantity <= len(words) else None
        return None
