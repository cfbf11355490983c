"""One request to one unit, at its turn: its meaning, what it writes, what was read and is sent for it.

:func:`understand` computes meaning and written words once for each turn, for all later steps: the
prerequisites (``prerequisites``) and what is sent (``prepare``). Partial writes are completed here from the
register image and from what was read for the request (M1).

``prepare`` adds what is sent, and the readback maps in force at that moment, which convert its reply back.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from gateway.compensation.correction_spec import CorrectionSpec
from gateway.compensation.readback import Readback
from gateway.drives.motion import Addressing
from gateway.exchange.access import Access
from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import Actual
from gateway.exchange.axis.registers import ALL_WORDS, mask_of
from gateway.exchange.decode import AxisCommand, DecodedRequest, FieldWrite, Part, decode
from gateway.exchange.kept_words import is_repeat, may_keep_words
from gateway.exchange.refusal import RefusedRequestError
from gateway.exchange.unit import NO_HITS, FieldHit, FieldRole, Hits, MappedField
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.registers import PositionField, WordOrder


class Standstill(Enum):
    """What a drive's status bit says about an axis before a relative move."""

    UNKNOWN = "untold"
    MOVES = "moves"
    SAYS_SO = "says-so"
    """At standstill, but the bit may be older than its last move."""
    CONFIRMED = "stands"


@dataclass(slots=True)
class Prefetched:
    """What was read for one request before it could be rendered. None: requested without success."""

    actual: dict[str, Actual | None] = field(default_factory=dict)
    """By axis."""
    polls: dict[str, int] = field(default_factory=dict)
    """Number of reads of the position, successful or not, by axis."""
    refused: set[tuple[str, int]] = field(default_factory=set)
    """Reads that were refused once: axis, and address of the read."""
    commanded: dict[str, float | None] = field(default_factory=dict)
    """The drive's own commanded position in counts, by axis."""
    standstill: dict[str, Standstill] = field(default_factory=dict)
    """By axis."""
    command_words: dict[tuple[str, int], bytes | None] = field(default_factory=dict)
    """Nominal words, by axis and number of the command field."""
    rule_words: dict[str, dict[int, int | None]] = field(default_factory=dict)
    """Contents of mode and trigger registers, by axis and address."""
    references: set[str] = field(default_factory=set)
    """Axes whose reference was read."""
    runs: dict[str, Rendering] = field(default_factory=dict)
    """What a trigger runs, by axis: decided once for each request (M2)."""
    peer_runs: dict[str, Rendering] = field(default_factory=dict)
    """Targets that the other axes of its group hold and must run, by axis (M11)."""
    decided_by: dict[str, tuple[bool, CorrectionSpec, bool]] = field(default_factory=dict)
    """What those targets depend on: whether each axis is handled as referenced, its correction, and whether
    it keeps words of another one."""


NOTHING_PREFETCHED: Final = Prefetched()
"""For requests that need no reads; it stays empty."""


@dataclass(frozen=True, slots=True)
class Span:
    """Registers ``address`` to ``address + quantity - 1``."""

    address: int
    quantity: int

    def widened(self, fields: list[PositionField]) -> "Span":
        """Return the smallest span around this one that cuts none of ``fields``."""
        start = min([self.address, *(f.address for f in fields)])
        end = max([self.address + self.quantity, *(f.end for f in fields)])
        return Span(start, end - start)


NO_SPAN: Final = Span(0, 0)


class Request:
    """A request to one unit at its turn, as it came and as it is sent."""

    __slots__ = (
        "arrived_ns",
        "commands",
        "follows_ns",
        "frame",
        "now_ns",
        "prefetched",
        "read_hits",
        "read_refusal",
        "read_span",
        "readbacks",
        "sent_pdu",
    )

    def __init__(
        self,
        frame: DecodedRequest,
        commands: list[AxisCommand],
        prefetched: Prefetched,
        now_ns: int,
        *,
        arrived_ns: int,
        follows_ns: int = 0,
    ) -> None:
        self.frame = frame
        self.commands = commands
        """What it does to each axis that it affects, in the order of the axes."""
        self.prefetched = prefetched
        self.now_ns = now_ns
        self.arrived_ns = arrived_ns
        """When it came from its controller; no two requests of a line have the same time."""
        self.follows_ns = follows_ns
        """When the request before it arrived on the same connection."""
        self.sent_pdu = frame.pdu
        self.read_hits = NO_HITS
        self.read_span = NO_SPAN
        self.read_refusal: RefusedRequestError | None = None
        """What the controller gets in place of what is read. A stop passes whatever its frame reads."""
        self.readbacks: dict[str, Readback] = {}
        """By axis, as they were when it was sent; an axis that passed 1:1 has none."""

    def of(self, axis: Axis) -> AxisCommand:
        """Return what it does to one axis."""
        for command in self.commands:
            if command.axis is axis:
                return command
        command = AxisCommand(axis)
        self.commands.append(command)
        if len(self.commands) > 1:
            self.commands.sort(key=lambda each: self.frame.unit.axes.index(each.axis))
        return command

    def ask(self, hits: Hits, span: Span) -> None:
        """Set what is read from the drive: the requested span, widened where it cuts a position."""
        self.read_hits, self.read_span = hits, span

    def send_instead(self, pdu: bytes) -> None:
        """Set what is sent instead of the request as it came."""
        self.sent_pdu = pdu

    @property
    def reads_too(self) -> bool:
        """Whether it reads: an exception to a write in the same frame (FC23) may be from the read."""
        return self.frame.access.read_quantity > 0

    @property
    def reads_unmapped(self) -> bool:
        """Whether it reads a position that is not mapped, and so passes unchanged (M10)."""
        return any(hit.mapped.role is FieldRole.GUARDED for hit in self.read_hits.fields)


def has_a_stop(requests: Sequence[Request]) -> bool:
    """Whether a request stops any axis of the units that it reaches: then all of it passes (M3)."""
    for request in requests:
        for command in request.commands:
            if command.is_stop:
                return True
    return False


def understand(
    frame: DecodedRequest, prefetched: Prefetched, now_ns: int, arrived_ns: int, follows_ns: int = 0
) -> Request:
    """Compute what a request means at its turn, with what was read for it.

    This is repeated at each turn. While the request waited, the drive may have acknowledged another mode, a
    stop or another part of a position.
    """
    commands = decode(frame, prefetched.rule_words)
    request = Request(frame, commands, prefetched, now_ns, arrived_ns=arrived_ns, follows_ns=follows_ns)
    for command in request.commands:
        if command.hits:
            _complete(request, command)
    return request


def _complete(request: Request, command: AxisCommand) -> None:
    """Compute all words of the command fields that a request writes of one axis."""
    axis, access = command.axis, request.frame.access
    running = command.running
    is_object = axis.plan.addressing is Addressing.OBJECTS
    # A cyclic image with several fields is a repeat as a whole; one field written again alone is a target.
    # The words of a distance say nothing about a position.
    is_distance = command.action.is_relative or axis.targets.last_run.is_relative
    is_again = not (axis.waits_for_trigger or is_distance)
    has_last = False
    for hit in command.hits:
        mapped = hit.mapped
        if not hit.is_whole and (is_object or mapped.field.block is not None):
            assert mapped.image is not None
            command.partly_written.append(mapped.image)
            continue
        words = nominal_words(request, hit) if access.is_consistent else None
        is_run = hit in running
        command.writes.append(FieldWrite(hit, words, is_run))
        if is_run and is_again:
            is_again = words is not None and is_repeat(axis, mapped.number, words)
            is_again = is_again and may_keep_words(axis, axis.compensation.state.spec)
            has_last = has_last or mapped.number == axis.motion.last_number
    command.is_again = is_again and has_last


# --- parts of positions ------------------------------------------------------------------------------------


def key_of(hit: FieldHit) -> tuple[str, int]:
    """Return the key of a command field in ``Prefetched``."""
    return hit.mapped.axis.plan.name, hit.mapped.number


def written_part(hit: FieldHit, pdu: bytes, access: Access) -> tuple[int, bytes]:
    """Return the part of a command field that a request writes: its first word, and the words."""
    data = access.words(pdu)
    first = max(0, -hit.word)
    start = 2 * max(0, hit.word)
    return first, data[start : start + 2 * (hit.mapped.field.words - first)]


def nominal_words(request: Request, hit: FieldHit) -> bytes | None:
    """Return all words of a command field after a request; None: some are unknown."""
    image, pdu, access = hit.mapped.image, request.frame.pdu, request.frame.access
    assert image is not None
    if access.is_mask:
        return _masked(hit, pdu, access, request.arrived_ns)
    first, words = written_part(hit, pdu, access)
    if hit.is_whole:
        return words
    completed = image.completed(first, words, request.arrived_ns, request.follows_ns)
    read = request.prefetched.command_words.get(key_of(hit))
    if completed is None and read is not None and not image.is_incomplete:
        merged = bytearray(read)
        merged[2 * first : 2 * first + len(words)] = words
        if kept_words_are_certain(hit.mapped, read, first, len(words) // 2):
            completed = bytes(merged)
    return completed


def _masked(hit: FieldHit, pdu: bytes, access: Access, arrived_ns: int) -> bytes | None:
    image = hit.mapped.image
    base = None if image is None else image.base(arrived_ns)
    if base is None:
        return None  # a mask needs the exact word that it changes
    merged = bytearray(base)
    at = -2 * hit.word
    data = pdu[access.data_offset :]
    current = merged[at] << 8 | merged[at + 1]
    and_mask, or_mask = data[0] << 8 | data[1], data[2] << 8 | data[3]
    merged[at : at + 2] = ((current & and_mask) | (or_mask & ~and_mask & 0xFFFF)).to_bytes(2, "big")
    return bytes(merged)


def kept_words_are_certain(mapped: MappedField, words: bytes, first: int, count: int) -> bool:
    """Whether the words that a partial write keeps are the same for every position that they may mean.

    The drive's register holds a corrected position, and its correction may be unknown. The nominal position
    is within ``max_correction`` of it, perhaps across the border of a word.
    """
    settings = mapped.axis.plan.settings
    margin = settings.max_correction * abs(settings.counts_per_unit) / mapped.field.scale
    raw = mapped.field.unpack(words)
    if mapped.field.type.is_float:
        return False
    try:
        ends = [mapped.field.pack(round(raw + sign * margin)) for sign in (-1.0, 1.0)]
    except RegisterRangeError:
        return False
    kept = [i for i in range(mapped.field.words) if not first <= i < first + count]
    least = 0 if mapped.field.order is WordOrder.LOW_FIRST else mapped.field.words - 1
    return least not in kept and all(
        end[2 * i : 2 * i + 2] == words[2 * i : 2 * i + 2] for end in ends for i in kept
    )


def part_of(hit: FieldHit, pdu: bytes, access: Access) -> Part:
    """Return what a request writes of one command field or limit."""
    image = hit.mapped.image
    assert image is not None
    if not access.is_consistent:
        return Part(image, -1, b"")
    if access.is_mask:
        return Part(image, -hit.word, b"")
    return Part(image, -1, b"") if hit.is_whole else Part(image, *written_part(hit, pdu, access))


def mask_written(hit: FieldHit, pdu: bytes, access: Access) -> int:
    """Return a mask of the words of a command field or limit that a request writes."""
    if access.is_mask:
        return mask_of(-hit.word, 1)
    if hit.is_whole:
        return ALL_WORDS
    first, words = written_part(hit, pdu, access)
    return mask_of(first, len(words) // 2)
