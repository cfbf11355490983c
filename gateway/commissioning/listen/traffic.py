"""Traffic statistics by unit id, and registers that look like positions."""

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from gateway.commissioning.listen.overhearing import Overheard
from gateway.exchange.access import access_of
from gateway.modbus.pdu import EXCEPTION_BIT, FunctionCode, is_exception
from gateway.modbus.registers import WordOrder

REMEMBERED: Final = 4000
"""Register contents checked for positions, the newest of each unit id."""
NEAR_COUNTS: Final = 2
"""An axis that has arrived may differ from its target by this much."""
LEAST_TARGETS: Final = 2
BIT_FUNCTIONS: Final = frozenset(
    {
        FunctionCode.READ_COILS,
        FunctionCode.READ_DISCRETE_INPUTS,
        FunctionCode.WRITE_SINGLE_COIL,
        FunctionCode.WRITE_MULTIPLE_COILS,
    }
)
BIT_WRITES: Final = frozenset({FunctionCode.WRITE_SINGLE_COIL, FunctionCode.WRITE_MULTIPLE_COILS})


class RegisterUse(NamedTuple):
    """One kind of access to registers (or coils)."""

    function: int
    is_write: bool
    address: int
    quantity: int

    @property
    def last(self) -> int:
        """The last register."""
        return self.address + self.quantity - 1


class Content(NamedTuple):
    """Content of registers when they were written or read."""

    is_write: bool
    address: int
    words: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class PositionGuess:
    """A register pair that receives targets, and the pair that reaches them afterwards."""

    command: int
    actual: int
    words: WordOrder
    met: int
    """Number of ``targets`` that the other pair reached."""
    targets: int


@dataclass(slots=True)
class UnitStatistics:
    """Statistics of one unit id."""

    requests: int = 0
    answered: int = 0
    replies_alone: int = 0
    """Replies without a received request."""
    exceptions: Counter[int] = field(default_factory=Counter)
    uses: Counter[RegisterUse] = field(default_factory=Counter)
    unplaced: Counter[int] = field(default_factory=Counter)
    """Function codes of requests that name no registers."""
    contents: deque[Content] = field(default_factory=lambda: deque(maxlen=REMEMBERED))

    @property
    def unanswered(self) -> int:
        """Requests without a reply; the last one may still get it."""
        return self.requests - self.answered

    def positions(self) -> list[PositionGuess]:
        """Return probable positions, the most probable first."""
        return guesses(list(self.contents))


class TrafficStatistics:
    """Counts frames."""

    def __init__(self) -> None:
        self.units: dict[int, UnitStatistics] = {}

    @property
    def requests(self) -> int:
        """Total number of requests."""
        return sum(unit.requests for unit in self.units.values())

    def add(self, frames: Iterable[Overheard]) -> None:
        """Count frames, in their order."""
        for frame in frames:
            unit = self.units.setdefault(frame.unit_id, UnitStatistics())
            if frame.is_reply:
                _reply(unit, frame)
            else:
                _request(unit, frame.pdu)


def _request(unit: UnitStatistics, pdu: bytes) -> None:
    unit.requests += 1
    uses = list(uses_of(pdu))
    unit.uses.update(uses)
    if not uses:
        unit.unplaced[pdu[0]] += 1
    access = access_of(pdu)
    if access is not None and access.write_quantity and access.is_consistent and not access.is_mask:
        unit.contents.append(Content(True, access.write_address, _words(access.words(pdu))))


def _reply(unit: UnitStatistics, frame: Overheard) -> None:
    if not frame.request:
        unit.replies_alone += 1
        return
    unit.answered += 1
    if is_exception(frame.pdu) and frame.pdu[0] != frame.request[0]:
        unit.exceptions[frame.pdu[1] if len(frame.pdu) > 1 else 0] += 1
        return
    access = access_of(frame.request)
    if access is None or not access.read_quantity or access.is_mei:
        return
    words = _words(frame.pdu[2:])
    if len(words) == access.read_quantity:
        unit.contents.append(Content(False, access.read_address, words))


def uses_of(pdu: bytes) -> Iterator[RegisterUse]:
    """Yield a request's accesses to registers, coils or inputs.

    >>> [*uses_of(bytes.fromhex("10 0058 0002 04 0000 2710"))]
    [RegisterUse(function=16, is_write=True, address=88, quantity=2)]
    """
    function = pdu[0]
    if function in BIT_FUNCTIONS and len(pdu) >= 5:
        quantity = (
            1 if function == FunctionCode.WRITE_SINGLE_COIL else max(1, int.from_bytes(pdu[3:5], "big"))
        )
        yield RegisterUse(function, function in BIT_WRITES, int.from_bytes(pdu[1:3], "big"), quantity)
        return
    access = access_of(pdu)
    if access is None:
        return
    if access.write_quantity:
        yield RegisterUse(
            function, is_write=True, address=access.write_address, quantity=access.write_quantity
        )
    if access.read_quantity:
        yield RegisterUse(
            function, is_write=False, address=access.read_address, quantity=access.read_quantity
        )


def _words(data: bytes) -> tuple[int, ...]:
    return tuple(int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data) - 1, 2))


# --- Detection of position registers -----------------------------------------------------------------------


def guesses(contents: list[Content]) -> list[PositionGuess]:
    """Return pairs of 32-bit registers in which one follows the other's targets; the most probable first.

    A target must differ from the one before it, and from 0, ±1, ±2, which are common in any register. If both
    word orders are consistent, the one with the smaller targets is right: in the other one they are 65 536
    times as large.
    """
    found: dict[tuple[int, int], tuple[float, PositionGuess]] = {}
    for words in WordOrder:
        for size, guess in _guesses_in(contents, words):
            pair = guess.command, guess.actual
            if pair not in found or size < found[pair][0]:
                found[pair] = size, guess
    rated = sorted(found.values(), key=lambda one: (-one[1].met, one[0], one[1].command))
    return [guess for _, guess in rated]


def _guesses_in(contents: list[Content], words: WordOrder) -> Iterator[tuple[float, PositionGuess]]:
    """Yield guesses with the mean size of their targets."""
    written, seen = _numbers(contents, words)
    for command, targets in written.items():
        if len(targets) < LEAST_TARGETS:
            continue
        size = sum(abs(counts) for _, counts in targets) / len(targets)
        for actual, readings in seen.items():
            met = _met(targets, readings)
            if actual != command and met >= LEAST_TARGETS and 2 * met >= len(targets):
                yield size, PositionGuess(command, actual, words, met, len(targets))


_Numbers = dict[int, list[tuple[int, int]]]
"""By address: time and number."""


def _numbers(contents: list[Content], words: WordOrder) -> tuple[_Numbers, _Numbers]:
    written: _Numbers = {}
    seen: _Numbers = {}
    image: dict[int, int] = {}
    for moment, content in enumerate(contents):
        registers = dict(enumerate(content.words, start=content.address))
        if content.is_write:
            image |= registers
        for address in range(content.address - content.is_write, content.address + len(content.words)):
            held = image if content.is_write else registers
            if address not in held or address + 1 not in held:
                continue
            counts = _joined(held[address], held[address + 1], words)
            if not content.is_write:
                seen.setdefault(address, []).append((moment, counts))
                continue
            of_address = written.setdefault(address, [])
            if abs(counts) > NEAR_COUNTS and (not of_address or of_address[-1][1] != counts):
                of_address.append((moment, counts))
    return written, seen


def _joined(first: int, second: int, words: WordOrder) -> int:
    high, low = (first, second) if words is WordOrder.HIGH_FIRST else (second, first)
    number = high << 16 | low
    return number - (1 << 32) if number >> 31 else number


def _met(targets: list[tuple[int, int]], readings: list[tuple[int, int]]) -> int:
    """Return how many targets were read between their own write and the next one, and not before."""
    ends = [moment for moment, _ in targets[1:]] + [1 << 62]
    met = 0
    for (moment, counts), end in zip(targets, ends, strict=True):
        near = [abs(number - counts) <= NEAR_COUNTS for at, number in readings if moment < at < end]
        met += any(near)
    return met


FUNCTION_NAMES: Final = {code.value: code.name.lower().replace("_", " ") for code in FunctionCode}


def function_name(function: int) -> str:
    """Return a function code with its name, where it has one.

    >>> function_name(16), function_name(65)
    ('FC16 write multiple registers', 'FC65')
    """
    name = FUNCTION_NAMES.get(function & ~EXCEPTION_BIT)
    return f"FC{function:02d}" + (f" {name}" if name else "")
