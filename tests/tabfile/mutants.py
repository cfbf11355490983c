"""Damaged copies of a table file, and a judge: none of them may be read as another table in silence."""

import random
import re
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import inf
from typing import Final

from gateway.compensation.units import Units
from gateway.tabfile import FileContext, Lint, LoadedTable, TabFileError, parse_table

Curve = Sequence[tuple[float, float]]
"""Positions, ascending, and what is added there."""


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a text says, found without the reader: plain sums over its numbers."""

    units: Units
    forward: Curve
    backward: Curve


@dataclass(frozen=True, slots=True)
class Sample:
    """A sound file of a dialect, what its reader is told, and a second, careless way to understand it.

    ``meaning`` may raise whatever it likes for a text that is no good. ``header`` holds the lines whose
    numbers hold for all points; with ``sums`` a number holds for all points beyond its own.
    """

    dialect: str
    name: str
    data: bytes
    context: FileContext
    meaning: Callable[[str], Meaning]
    header: frozenset[int] = frozenset()
    line_of_place: dict[int, int] = field(default_factory=dict)
    """Where a position stands on another line than its value: the line of the value, by that of the place."""
    sums: bool = False
    free_lines: bool = False
    """A line end among its numbers is a blank like any other: a digit that becomes one is a digit lost."""
    counts_per_unit: float = 10_000.0
    """Of the drive that is moved by it."""
    label: str = ""
    """Its name among several samples of a dialect."""
    moves: tuple[tuple[int, int], ...] = ()
    """Targets in counts, and what the drive is told, worked out by hand. Before the first the axis is sent to
    the upper end of its travel, so that the first comes from above."""

    @property
    def title(self) -> str:
        """Name that no other sample has."""
        return self.label or self.dialect

    @property
    def table_options(self) -> dict[str, object]:
        """``context`` as the configuration of an axis says it."""
        told = self.context.given()
        return {name: fact.value if isinstance(fact, Enum) else fact for name, fact in told.items()}


@dataclass(frozen=True, slots=True)
class Mutant:
    """A damaged copy, and what was done to it."""

    data: bytes
    what: str


NUMBER: Final = re.compile(rb"[+-]?[0-9]+(?:\.[0-9]*)?|[+-]?\.[0-9]+")
_LINE: Final = re.compile(rb"[^\r\n]*(?:\r\n|\r|\n|$)")
_LINE_END: Final = re.compile("\r\n|\r|\n")
BYTES: Final = bytes(range(0x20, 0x7F)) + b"\t\n\r\x00\x1a\xa0\xb5\xff"
PLACE: Final = re.compile(r"-?[0-9]+(?:\.[0-9]+)?(?:e-?[0-9]+)?")


def mutants(data: bytes, seed: str, count: int) -> Iterator[Mutant]:
    """Yield damaged copies; the same seed gives the same ones."""
    chance = random.Random(seed)
    made = 0
    while made < count:
        mutant = chance.choice(_WAYS)(data, chance)
        if mutant.data != data:
            made += 1
            yield mutant


def _one_byte_changed(data: bytes, chance: random.Random) -> Mutant:
    at, new = chance.randrange(len(data)), chance.choice(BYTES)
    return Mutant(data[:at] + bytes([new]) + data[at + 1 :], f"byte {at} changed to {new:#x}")


def _one_byte_deleted(data: bytes, chance: random.Random) -> Mutant:
    at = chance.randrange(len(data))
    return Mutant(data[:at] + data[at + 1 :], f"byte {at} deleted")


def _one_byte_inserted(data: bytes, chance: random.Random) -> Mutant:
    at, new = chance.randrange(len(data) + 1), chance.choice(BYTES)
    return Mutant(data[:at] + bytes([new]) + data[at:], f"byte {new:#x} inserted at {at}")


def _lines(data: bytes) -> list[bytes]:
    return [line for line in _LINE.findall(data) if line]


def _line_deleted(data: bytes, chance: random.Random) -> Mutant:
    lines = _lines(data)
    at = chance.randrange(len(lines))
    return Mutant(b"".join(lines[:at] + lines[at + 1 :]), f"line {at + 1} deleted")


def _line_doubled(data: bytes, chance: random.Random) -> Mutant:
    lines = _lines(data)
    at = chance.randrange(len(lines))
    return Mutant(b"".join([*lines[:at], lines[at], *lines[at:]]), f"line {at + 1} doubled")


def _lines_swapped(data: bytes, chance: random.Random) -> Mutant:
    lines = _lines(data)
    one, other = chance.randrange(len(lines)), chance.randrange(len(lines))
    lines[one], lines[other] = lines[other], lines[one]
    return Mutant(b"".join(lines), f"lines {one + 1} and {other + 1} swapped")


def _line_truncated(data: bytes, chance: random.Random) -> Mutant:
    lines = _lines(data)
    at = chance.randrange(len(lines))
    body = lines[at].rstrip(b"\r\n")
    end = lines[at][len(body) :]
    lines[at] = body[: chance.randrange(len(body) + 1)] + end
    return Mutant(b"".join(lines), f"line {at + 1} truncated")


def _number_changed(data: bytes, chance: random.Random) -> Mutant:
    found = chance.choice(list(NUMBER.finditer(data)))
    old = found.group()
    new = chance.choice((_digit, _sign, _point))(old, chance)
    return Mutant(data[: found.start()] + new + data[found.end() :], f"{old!r} became {new!r}")


def _digit(number: bytes, chance: random.Random) -> bytes:
    at = chance.choice([index for index, byte in enumerate(number) if chr(byte).isdigit()])
    return number[:at] + str(chance.randrange(10)).encode() + number[at + 1 :]


def _sign(number: bytes, _: random.Random) -> bytes:
    bare = number.lstrip(b"+-")
    return bare if number.startswith(b"-") else b"-" + bare


def _point(number: bytes, chance: random.Random) -> bytes:
    bare = number.replace(b".", b"")
    at = chance.randrange(len(bare) + 1)
    return chance.choice((bare, bare[:at] + b"." + bare[at:]))


def _last_line_cut(data: bytes, chance: random.Random) -> Mutant:
    last = data.rstrip(b"\r\n").rfind(b"\n") + 1
    at = chance.randrange(last, len(data))
    return Mutant(data[:at], f"last line cut at byte {at}")


def _cut(data: bytes, chance: random.Random) -> Mutant:
    at = chance.randrange(len(data))
    return Mutant(data[:at], f"cut at byte {at}")


_WAYS: Final = (
    _one_byte_changed,
    _one_byte_deleted,
    _one_byte_inserted,
    _line_deleted,
    _line_doubled,
    _lines_swapped,
    _line_truncated,
    _number_changed,
    _last_line_cut,
    _cut,
)


class Judge:
    """Says of each mutant of one sample how it ended: ``error``, ``equal``, ``said`` or ``remark``.

    ``equal``: the same table, and the sample's own ``meaning`` finds no other in the text: a reader to which
    a number does not count is not believed.
    ``said``: as many points, and the table differs only around the lines that were changed, where it is what
    their numbers say by the sample's own ``meaning``. Lines of the header may say something about all points.
    ``remark``: lines or points came or went, and a remark that was not there before names the place; where no
    line came or went, ``meaning`` must find the same table.
    """

    def __init__(self, sample: Sample) -> None:
        self.sample = sample
        self.lines = text_lines(sample.data)
        self.sound = parse_table(sample.data, sample.name, sample.context)
        self.remarks = {_kind(lint) for lint in self.sound.lints}

    def judge(self, mutant: Mutant) -> str:
        """Return how the mutant ended, ``silent: ...`` if it was read as another table in silence."""
        try:
            found = parse_table(mutant.data, self.sample.name, self.sample.context)
        except TabFileError as error:
            return "error" if str(error).strip() and error.file else "silent: an error without words"
        if found.errors:
            return "error"  # a lint with which the gateway does not load the table
        if _same(meaning_of(found), meaning_of(self.sound)):
            return (
                "silent: equal to a text that says otherwise" if self._says_other(mutant, found) else "equal"
            )
        lines = text_lines(mutant.data)
        changed = _changed(self.lines, lines)
        if len(lines) == len(self.lines) and self._says_other(mutant, found, is_other_if_unread=True):
            return f"silent: lines {changed[0]} to {changed[-1]} are not read as they stand"
        end = self._said(mutant.data, found, lines, changed)
        sizes = len(found.source.rows), len(self.sound.source.rows)
        came_or_went = len(lines) != len(self.lines) or sizes[0] != sizes[1]
        if came_or_went and any(self._names_the_place(lint, changed, found) for lint in self._new(found)):
            return "remark"
        return end

    def _says_other(self, mutant: Mutant, found: LoadedTable, *, is_other_if_unread: bool = False) -> bool:
        """Whether the second reader finds another table in the text; where it finds none, as told."""
        try:
            return not _same(meaning_of(found), self.sample.meaning(_text(mutant.data)))
        except (ValueError, IndexError, KeyError, ZeroDivisionError, StopIteration):
            return is_other_if_unread

    def _new(self, found: LoadedTable) -> list[Lint]:
        return [lint for lint in found.lints if _kind(lint) not in self.remarks]

    def _names_the_place(self, lint: Lint, changed: Sequence[int], found: LoadedTable) -> bool:
        if lint.line is not None and changed[0] - 1 <= lint.line <= changed[-1] + 1:
            return True
        near = [
            row.position
            for loaded in (self.sound, found)
            for row in loaded.source.rows
            if {row.forward_line, row.backward_line} & set(range(changed[0] - 1, changed[-1] + 2))
        ]
        named = [float(number) for number in PLACE.findall(lint.message)]
        return any(abs(place - number) <= 1e-5 * max(1, abs(place)) for place in near for number in named)

    def _said(self, data: bytes, found: LoadedTable, lines: Sequence[str], changed: Sequence[int]) -> str:
        if len(lines) != len(self.lines) and not self.sample.free_lines:
            return (
                f"silent: lines {changed[0]} to {changed[-1]} came or went, {_difference(found, self.sound)}"
            )
        if _listed(found) != _listed(self.sound):  # the same place in both directions is one row
            return f"silent: {len(found.source.rows)} points instead of {len(self.sound.source.rows)}"
        try:
            expected = self.sample.meaning(_text(data))
            is_as_said = _same(meaning_of(found), expected)
        except (ValueError, IndexError, KeyError, ZeroDivisionError, StopIteration) as error:
            return f"silent: read where a careless reader fails: {error!r}"
        if not is_as_said:
            return f"silent: not what the numbers say, {_difference(found, self.sound)}"
        if set(changed) & self.sample.header:
            return "said"
        low, high = self._reach(changed, found)
        for place in _differing(meaning_of(found), meaning_of(self.sound)):
            if not low < place < high:
                return f"silent: differs at {place}, far from the lines {changed}"
        return "said"

    def _reach(self, changed: Sequence[int], found: LoadedTable) -> tuple[float, float]:
        """Return the stretch that the numbers of some lines have a say in: up to the points beside theirs."""
        low, high = inf, -inf
        lines = {self.sample.line_of_place.get(line, line) for line in changed}
        for loaded in (self.sound, found):
            for ours, other in (("forward_line", "backward_line"), ("backward_line", "forward_line")):
                # A point that is listed for the other direction only bends this one nowhere.
                rows = [row for row in loaded.source.rows if getattr(row, ours) or not getattr(row, other)]
                places = [-inf, *(row.position for row in rows), inf]
                for index, row in enumerate(rows, start=1):
                    if getattr(row, ours) in lines:
                        low, high = min(low, places[index - 1]), max(high, places[index + 1])
        if self.sample.sums:
            return (-inf, high) if high <= 0 else (low, inf) if low >= 0 else (-inf, inf)
        return low, high


def _listed(loaded: LoadedTable) -> int:
    """Return how many points a file lists, of both directions together."""
    return sum(bool(row.forward_line) + bool(row.backward_line) for row in loaded.source.rows)


def _kind(lint: Lint) -> tuple[str, int | str]:
    """Return what makes a remark another one: its line, or else its words."""
    return lint.code, lint.line or lint.message


def meaning_of(loaded: LoadedTable) -> Meaning:
    """Return the curves of a table that was read."""
    rows = loaded.source.rows
    return Meaning(
        loaded.table.units,
        [(row.position, row.forward) for row in rows],
        [(row.position, row.backward) for row in rows],
    )


def text_lines(data: bytes) -> list[str]:
    """Return the lines of a file."""
    return _LINE_END.split(_text(data).rstrip("\r\n"))


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _changed(old: Sequence[str], new: Sequence[str]) -> list[int]:
    """Return the numbers of the lines that differ; where lines came or went, all between the equal ends."""
    if len(old) == len(new):
        differ = [n for n, (one, other) in enumerate(zip(old, new, strict=True), start=1) if one != other]
        return differ or [len(old)]
    shorter = min(len(old), len(new))
    head = next((n for n in range(shorter) if old[n] != new[n]), shorter)
    tail = next((n for n in range(shorter - head) if old[-1 - n] != new[-1 - n]), shorter - head)
    return list(range(head + 1, max(len(old), len(new)) - tail + 1))


def _differing(one: Meaning, other: Meaning) -> list[float]:
    """Return the knots of either at which the curves are not the same."""
    places: list[float] = []
    for ours, theirs in ((one.forward, other.forward), (one.backward, other.backward)):
        size = max((abs(c) for _, c in (*ours, *theirs)), default=0.0)
        knots = {x for x, _ in (*ours, *theirs)}
        places += [x for x in knots if abs(at(ours, x) - at(theirs, x)) > 1e-12 + 1e-9 * size]
    return places


def _same(one: Meaning, other: Meaning) -> bool:
    ends = [(curve[0][0], curve[-1][0]) for curve in (one.forward, other.forward)]
    near = all(abs(a - b) <= 1e-9 * max(1, abs(a)) for a, b in zip(*ends, strict=True))
    return one.units is other.units and near and not _differing(one, other)


def _difference(one: LoadedTable, other: LoadedTable) -> str:
    return f"differs at {_differing(meaning_of(one), meaning_of(other))[:4]}"


def at(curve: Curve, place: float) -> float:
    """Return what is added at a place; outside its points a curve holds its end values."""
    places = [x for x, _ in curve]
    above = bisect_right(places, place)
    if above == 0:
        return curve[0][1]
    if above == len(curve):
        return curve[-1][1]
    (x0, c0), (x1, c1) = curve[above - 1], curve[above]
    return c0 + (c1 - c0) * (place - x0) / (x1 - x0)
