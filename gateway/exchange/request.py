"""One request at its turn: what it means and writes, what was read for it, what it does.

:func:`understand` works that out once for each turn, for all that follows: what is needed first
(``prerequisites``) and what is sent (``translate``). Words that it writes alone are completed here from the
register image, and from what was read for it (M1).

A :class:`Rewriting` is made when a request is about to be sent and holds the state of that moment: the words
that were rendered, the readback maps then in force, and what the controller really asked for.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from gateway.compensation.correction_spec import CorrectionSpec
from gateway.compensation.readback import Readback
from gateway.drives.motion import Action, Addressing
from gateway.exchange.access import Access
from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.axis_request import AxisRequest, Part
from gateway.exchange.axis.motion import Actual
from gateway.exchange.axis.registers import ALL_WORDS, FieldImage, mask_of
from gateway.exchange.meaning import Frame, Meaning, meanings
from gateway.exchange.unit import NO_HITS, FieldHit, FieldPlace, FieldRole, Hits
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.registers import PositionField, WordOrder


class Standing(Enum):
    """What a drive's status bit says of an axis that is to go a distance."""

    UNTOLD = "untold"
    MOVES = "moves"
    SAYS_SO = "says-so"
    """It stands, but the bit may still be that of the time before its last move."""
    STANDS = "stands"


@dataclass(slots=True)
class Known:
    """What was read for one request before it could be rendered. None: asked for, and not to be had."""

    actual: dict[str, Actual | None] = field(default_factory=dict)
    """By axis."""
    looks: dict[str, int] = field(default_factory=dict)
    """How often that was told, or not to be had, by axis."""
    refused: set[str] = field(default_factory=set)
    """Axes of which that was refused."""
    commanded: dict[str, float | None] = field(default_factory=dict)
    """The drive's own commanded position in counts, by axis."""
    standing: dict[str, Standing] = field(default_factory=dict)
    """By axis."""
    command_words: dict[tuple[str, int], bytes | None] = field(default_factory=dict)
    """Nominal words, by axis and number of the command field."""
    rule_words: dict[str, dict[int, int | None]] = field(default_factory=dict)
    """Contents of mode and trigger registers, by axis and address."""
    references: set[str] = field(default_factory=set)
    """Axes whose reference was asked for."""
    runs: dict[str, Rendering] = field(default_factory=dict)
    """What a trigger runs, by axis: decided once for each request (M2)."""
    peer_runs: dict[str, Rendering] = field(default_factory=dict)
    """What the other axes of its group hold and have to run, by axis (M11)."""
    decided_by: dict[str, tuple[bool, CorrectionSpec, bool]] = field(default_factory=dict)
    """What those were decided by: whether each axis goes as one that is referenced, its correction, and
    whether it keeps words of another one."""


NOTHING_KNOWN: Final = Known()
"""For requests that need nothing read; it stays empty."""


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


class CommandWrite(NamedTuple):
    """A command field that a request writes."""

    hit: FieldHit
    words: bytes | None
    """All its nominal words once the request is applied; None: not known."""
    is_run: bool
    """The drive goes there with this request; False: it only holds it."""


class AxisWrite(NamedTuple):
    """What a request writes into the command fields of one axis."""

    axis: Axis
    meaning: Meaning | None
    """None: nothing but positions means anything to the unit, and they are gone to at once."""
    action: Action
    """How its positions are meant."""
    fields: list[CommandWrite]
    cut: list[FieldImage]
    """Fields of which a part is written where there are no parts: addresses are commands, or objects."""
    is_again: bool
    """It makes the drive go nowhere but where it was told already (M4)."""


class Request(NamedTuple):
    """A request at its turn: what it means for each axis of its unit, and what it writes."""

    frame: Frame
    meanings: list[Meaning]
    writes: list[AxisWrite]
    known: Known
    now_ns: int
    arrived_ns: int
    """When it came from its controller; no two requests of a line came at the same instant."""
    follows_ns: int = 0
    """When the request before it came on the same connection."""


def has_a_stop(requests: Sequence[Request]) -> bool:
    """Whether a request stops any axis of the units that it reaches: then all of it passes (M3)."""
    return any(meaning.is_stop for request in requests for meaning in request.meanings)


def understand(frame: Frame, known: Known, now_ns: int, arrived_ns: int, follows_ns: int = 0) -> Request:
    """Work out what a request means now that it is its turn, with what was read for it.

    This is done anew each time that it is its turn: while it waited, or waited for a frame that it needs
    first, the drive may have acknowledged another mode, a stop or another part of a position.
    """
    access = frame.access
    found = meanings(frame, known.rule_words) if frame.unit.has_rules else []
    writes = []
    for axis, _, commands, _, _ in frame.by_axis:
        if not commands:
            continue
        meaning: Meaning | None = None
        for each in found:
            if each.axis is axis:
                meaning = each
        action, running = Action.ABSOLUTE, commands
        if meaning is not None:
            action, running = meaning.action, meaning.running
        is_object = axis.plan.addressing is Addressing.OBJECTS
        fields: list[CommandWrite] = []
        cut: list[FieldImage] = []
        # A cyclic image with several fields is a repeat as a whole; one field rewritten alone is a target.
        # The words of a distance say nothing of a place.
        is_distance = action.is_relative or axis.last_run.is_relative
        is_again = not (axis.plan.motion.waits_for_trigger or is_distance)
        has_last = False
        for hit in commands:
            place = hit.place
            if not hit.is_whole and (is_object or place.field.block is not None):
                assert place.image is not None
                cut.append(place.image)
                continue
            words = None
            if access.is_consistent:
                words = nominal_words(hit, frame, known, arrived_ns, follows_ns)
            is_run = hit in running
            fields.append(CommandWrite(hit, words, is_run))
            if is_run and is_again:
                is_again = words is not None and axis.is_repeat(place.number, words)
                is_again = is_again and axis.may_keep_words(axis.compensation.state.spec)
                has_last = has_last or place.number == axis.motion.last_number
        writes.append(AxisWrite(axis, meaning, action, fields, cut, is_again and has_last))
    return Request(frame, found, writes, known, now_ns, arrived_ns, follows_ns)


# --- parts of positions ------------------------------------------------------------------------------------


def key_of(hit: FieldHit) -> tuple[str, int]:
    """Return by which name ``Known`` has a command field."""
    return hit.place.axis.plan.name, hit.place.number


def written_part(hit: FieldHit, pdu: bytes, access: Access) -> tuple[int, bytes]:
    """Return the part of a command field that a request writes: its first word, and the words."""
    data = access.words(pdu)
    first = max(0, -hit.word)
    start = 2 * max(0, hit.word)
    return first, data[start : start + 2 * (hit.place.field.words - first)]


def nominal_words(
    hit: FieldHit, frame: Frame, known: Known, arrived_ns: int, follows_ns: int
) -> bytes | None:
    """Return all words of a command field once a request is applied, or None when some are not known."""
    image, pdu, access = hit.place.image, frame.pdu, frame.access
    assert image is not None
    if access.is_mask:
        return _masked(hit, pdu, access, arrived_ns)
    first, words = written_part(hit, pdu, access)
    if hit.is_whole:
        return words
    completed = image.completed(first, words, arrived_ns, follows_ns)
    read = known.command_words.get(key_of(hit))
    if completed is None and read is not None and not image.is_torn:
        merged = bytearray(read)
        merged[2 * first : 2 * first + len(words)] = words
        if kept_words_are_certain(hit.place, read, first, len(words) // 2):
            completed = bytes(merged)
    return completed


def _masked(hit: FieldHit, pdu: bytes, access: Access, arrived_ns: int) -> bytes | None:
    image = hit.place.image
    base = None if image is None else image.base(arrived_ns)
    if base is None:
        return None  # a mask needs the exact word that it is laid over
    merged = bytearray(base)
    at = -2 * hit.word
    data = pdu[access.data_offset :]
    current = merged[at] << 8 | merged[at + 1]
    and_mask, or_mask = data[0] << 8 | data[1], data[2] << 8 | data[3]
    merged[at : at + 2] = ((current & and_mask) | (or_mask & ~and_mask & 0xFFFF)).to_bytes(2, "big")
    return bytes(merged)


def kept_words_are_certain(place: FieldPlace, words: bytes, first: int, count: int) -> bool:
    """Whether the words that a partial write keeps are the same for every position that they may stand for.

    The drive's register holds a corrected position, and which correction it was given may not be known any
    more: the nominal one lies within ``max_correction`` of it, perhaps across a word's border.
    """
    settings = place.axis.plan.settings
    margin = settings.max_correction * abs(settings.counts_per_unit) / place.field.scale
    raw = place.field.unpack(words)
    if place.field.type.is_float:
        return False
    try:
        ends = [place.field.pack(round(raw + sign * margin)) for sign in (-1.0, 1.0)]
    except RegisterRangeError:
        return False
    kept = [i for i in range(place.field.words) if not first <= i < first + count]
    least = 0 if place.field.order is WordOrder.LOW_FIRST else place.field.words - 1
    return least not in kept and all(
        end[2 * i : 2 * i + 2] == words[2 * i : 2 * i + 2] for end in ends for i in kept
    )


def part_of(hit: FieldHit, pdu: bytes, access: Access) -> Part:
    """Return what a request writes of one command field or limit."""
    image = hit.place.image
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


# --- what is sent for it ------------------------------------------------------------------------------------


class Rewriting:
    """One request as it came and as it went, with all that is needed to turn its reply back."""

    __slots__ = (
        "access",
        "by_axis",
        "read_hits",
        "read_span",
        "readbacks",
        "request",
        "sent_pdu",
        "written",
    )

    def __init__(self, request: Request, sent_pdu: bytes) -> None:
        self.request = request
        self.access = request.frame.access
        self.sent_pdu = sent_pdu
        self.by_axis: dict[str, AxisRequest] = {}
        """What it does to each axis that it does something to, by name."""
        self.written: tuple[tuple[Axis, AxisRequest], ...] = ()
        """The same with the axes, in their order, as soon as it is complete."""
        self.read_hits = NO_HITS
        self.read_span = NO_SPAN
        self.readbacks: dict[str, Readback] = {}
        """By axis, as they were at the moment of the request; of one that passed 1:1 there is none."""

    def of(self, axis: Axis) -> AxisRequest:
        """Return what it does to one axis, to be filled in."""
        name = axis.plan.name
        found = self.by_axis.get(name)
        if found is None:
            request = self.request
            command = next((each for each in request.meanings if each.axis is axis), None)
            found = self.by_axis[name] = AxisRequest(
                request.arrived_ns,
                command,
                follows_ns=request.follows_ns,
                reads_too=self.access.read_quantity > 0,
            )
        return found

    def complete(self) -> None:
        """Note that all is known that it does."""
        axes, by_axis = self.request.frame.unit.axes, self.by_axis
        self.written = tuple([(each, by_axis[each.plan.name]) for each in axes if each.plan.name in by_axis])

    def ask(self, hits: Hits, span: Span) -> None:
        """Note what is read of the drive: what was asked for, or more, where that cuts a position."""
        self.read_hits, self.read_span = hits, span

    def send_instead(self, pdu: bytes) -> None:
        """Note what is sent in place of the request as it came."""
        self.sent_pdu = pdu

    @property
    def reads_unmapped(self) -> bool:
        """Whether the request reads a position that is not mapped, and so passes as it is (M10)."""
        return any(hit.place.role is FieldRole.GUARDED for hit in self.read_hits.fields)
