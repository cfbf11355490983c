"""The record of one axis in bytes: two slots, written in turn, each with its generation and a check sum.

A process may be killed between any two stores, and a power cut may leave half a page: the slot that is being
written then fails its check sum, and the other one, a generation older, holds. Little-endian, no padding; the
check sum is the CRC-32 of everything before it. Each slot has a page of its own.
"""

import struct
from typing import Any, Final, NamedTuple
from zlib import crc32

from gateway.compensation.correction_spec import CorrectionSpec

VERSION: Final = 1
PAGE: Final = 4096
MAGIC: Final = b"PGAXREC\n"
NAME_BYTES: Final = 32
"""As long as the name of an axis may be."""
HEADER: Final = struct.Struct(f"<8sH{NAME_BYTES}s")
SLOTS_AT: Final = (PAGE, 2 * PAGE)
RECORD_SIZE: Final = 3 * PAGE

_STATE: Final = "b?5dq"
"""Direction, unsure; position, extreme, progress, change, change distance; monotonic time."""
_BASE: Final = "?????B" + "4d" + _STATE + "d?4d"
"""Has a target, at it, done, may have left it, words known, its field; nominal, corrected, way; state;
anchor, fade."""
_MOVE: Final = "??B2d" + _STATE
_SPEC: Final = struct.Struct("<B16s3d")
_SPECS: Final = 4 * _SPEC.size
_BODY: Final = struct.Struct(f"<Q16s?{_BASE}{_MOVE}{_SPECS}s")
_CRC: Final = struct.Struct("<I")
SLOT_SIZE: Final = _BODY.size + _CRC.size
_BASE_FIELDS: Final = 6 + 4 + 8 + 6
_MOVE_FIELDS: Final = 5 + 8
_NO_MOVE: Final = (False, False, 0, 0.0, 0.0, 0, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
_EMPTY: Final = (
    *(False, False, False, False, False, 0, 0.0, 0.0, 0.0, 0.0),
    *(0, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0),
    *(0.0, False, 0.0, 0.0, 0.0, 0.0),
)
_IS_THERE: Final = 1
_IS_WANTED: Final = 2
_NO_SPEC: Final = _SPEC.pack(0, b"", 0.0, 0.0, 0.0)


Specs = tuple[CorrectionSpec, CorrectionSpec | None, CorrectionSpec | None, CorrectionSpec | None]


class RememberedSpec(NamedTuple):
    """A correction that was in force: a table by its digest, with its gains, or an offset in units."""

    digest: bytes
    """Empty: no table."""
    forward_gain: float
    backward_gain: float
    offset: float
    was_wanted: bool
    """Nothing else was asked for then."""


class RememberedState(NamedTuple):
    """``compensation.axis.State`` in numbers."""

    direction: int
    is_unsure: bool
    position: float
    extreme: float
    progress: float
    change: float
    change_distance: float
    at_ns: int
    spec: RememberedSpec
    previous: RememberedSpec | None


class RememberedMove(NamedTuple):
    """A target that was on its way to the drive when the record was written: it may have arrived or not."""

    is_distance: bool
    number: int
    """Of its command field."""
    nominal_counts: float
    corrected_counts: float
    state: RememberedState


class Remembered(NamedTuple):
    """What one run of the gateway left to the next about one axis."""

    generation: int
    scale_digest: bytes
    has_target: bool
    """Whether the last accepted target still says where the axis goes; not after a stop."""
    was_at_target: bool
    was_done_seen: bool
    may_have_left: bool
    knows_words: bool
    """The words of its command field are those of the target."""
    number: int
    nominal_counts: float
    corrected_counts: float
    way: tuple[float, float]
    """Corrected counts between which the axis moves, lower one first."""
    state: RememberedState
    anchor_counts: float
    fade: tuple[float, float, float, float] | None
    """Difference in counts, start, end, way the other way; of ``compensation.readback.Fade``."""
    unproven: RememberedMove | None


class RecordSlots:
    """Writes the newest record over the older slot of a buffer, and finds the newest good one.

    The buffer has :data:`RECORD_SIZE` bytes; ``scale_digest`` belongs to the axis as it is configured now.
    """

    __slots__ = ("_buffer", "_digest", "_generation", "_specs", "_specs_bytes", "_views")

    def __init__(self, buffer: memoryview, scale_digest: bytes) -> None:
        self._buffer = buffer
        self._digest = scale_digest
        self._views = tuple(buffer[at : at + _BODY.size] for at in SLOTS_AT)
        found = [body[0] for body in self._bodies() if body is not None]
        self._generation: int = max(found, default=0)
        self._specs: tuple[CorrectionSpec | None, ...] = ()
        self._specs_bytes = b""

    @property
    def generation(self) -> int:
        """How often the record was written so far."""
        return self._generation

    @property
    def is_damaged(self) -> bool:
        """Whether something was written once and no slot is good."""
        return not any(self._bodies()) and any(any(self._buffer[at : at + SLOT_SIZE]) for at in SLOTS_AT)

    def release(self) -> None:
        """Let go of the buffer; nothing may be written any more."""
        for view in self._views:
            view.release()
        self._buffer.release()

    def write(
        self,
        base: tuple[object, ...],
        move: tuple[object, ...] | None,
        specs: Specs,
        wanted: CorrectionSpec,
    ) -> None:
        """Write a record.

        Args:
            base: its numbers, as the layout has them.
            move: those of a target that is on its way to the drive.
            specs: the corrections that both states refer to: in force and giving way, of each.
            wanted: which of them is asked for.
        """
        kept = (*specs, wanted)
        if not _are_same(kept, self._specs):
            self._specs = kept
            self._specs_bytes = b"".join(_spec_bytes(spec, wanted) for spec in specs)
        self._store(True, base, move or _NO_MOVE, self._specs_bytes)

    def clear(self) -> None:
        """Write a record that says nothing."""
        self._store(False, _EMPTY, _NO_MOVE, b"")

    def read(self) -> Remembered | None:
        """Return the newest good record; None where there is none, or where it says nothing."""
        good = [body for body in self._bodies() if body is not None]
        if not good:
            return None
        newest = max(good, key=lambda body: int(body[0]))
        return _remembered(newest) if newest[2] else None

    def _store(
        self, is_known: bool, base: tuple[object, ...], move: tuple[object, ...], specs: bytes
    ) -> None:
        generation = self._generation = self._generation + 1
        number = generation & 1
        at = SLOTS_AT[number]
        _BODY.pack_into(self._buffer, at, generation, self._digest, is_known, *base, *move, specs)
        _CRC.pack_into(self._buffer, at + _BODY.size, crc32(self._views[number]))

    def _bodies(self) -> list[tuple[Any, ...] | None]:
        return [_body(self._buffer, number) for number in (0, 1)]


def header(name: str) -> bytes:
    """Return what a record begins with."""
    return HEADER.pack(MAGIC, VERSION, name.encode())


def why_not_readable(data: bytes | memoryview, name: str) -> str:
    """Return what is wrong with the beginning of a record, "" where nothing is."""
    if len(data) != RECORD_SIZE:
        return f"it has {len(data)} bytes and not {RECORD_SIZE}"
    magic, version, owner = HEADER.unpack_from(data)
    if magic != MAGIC:
        return "it is no record of an axis"
    if version != VERSION:
        return f"it has version {version}, and this release reads version {VERSION}"
    if owner != header(name)[-NAME_BYTES:]:
        return f"it belongs to axis {owner.rstrip(bytes(1)).decode(errors='replace')}"
    return ""


def _are_same(specs: tuple[object, ...], others: tuple[object, ...]) -> bool:
    return len(specs) == len(others) and all(a is b for a, b in zip(specs, others, strict=True))


def _spec_bytes(spec: CorrectionSpec | None, wanted: CorrectionSpec) -> bytes:
    if spec is None:
        return _NO_SPEC
    flags = _IS_THERE | (_IS_WANTED if spec is wanted else 0)
    return _SPEC.pack(flags, spec.table_digest, spec.gain.forward, spec.gain.backward, spec.offset)


def _body(buffer: memoryview, number: int) -> tuple[Any, ...] | None:
    """Return the fields of a slot whose generation belongs there and whose check sum holds."""
    at = SLOTS_AT[number]
    data = bytes(buffer[at : at + SLOT_SIZE])
    body = data[: _BODY.size]
    if _CRC.unpack_from(data, _BODY.size)[0] != crc32(body):
        return None
    fields = _BODY.unpack(body)
    return fields if fields[0] & 1 == number else None


def _remembered(fields: tuple[Any, ...]) -> Remembered:
    generation, digest, _ = fields[:3]
    base = fields[3 : 3 + _BASE_FIELDS]
    move = fields[3 + _BASE_FIELDS : 3 + _BASE_FIELDS + _MOVE_FIELDS]
    specs = [_spec(fields[-1][at : at + _SPEC.size]) for at in range(0, _SPECS, _SPEC.size)]
    assert specs[0] is not None
    unproven = None
    if move[0]:
        assert specs[2] is not None
        unproven = RememberedMove(
            move[1], move[2], _counts(move[3]), _counts(move[4]), _state(move[5:], specs[2], specs[3])
        )
    return Remembered(
        generation,
        digest,
        base[0],
        base[1],
        base[2],
        base[3],
        base[4],
        base[5],
        _counts(base[6]),
        _counts(base[7]),
        (base[8], base[9]),
        _state(base[10:18], specs[0], specs[1]),
        base[18],
        base[20:24] if base[19] else None,
        unproven,
    )


def _state(
    numbers: tuple[Any, ...], spec: RememberedSpec, previous: RememberedSpec | None
) -> RememberedState:
    direction, is_unsure, position, extreme, progress, change, change_distance, at_ns = numbers
    return RememberedState(
        direction, is_unsure, position, extreme, progress, change, change_distance, at_ns, spec, previous
    )


def _spec(data: bytes) -> RememberedSpec | None:
    flags, digest, forward, backward, offset = _SPEC.unpack(data)
    if not flags & _IS_THERE:
        return None
    return RememberedSpec(digest if any(digest) else b"", forward, backward, offset, bool(flags & _IS_WANTED))


def _counts(counts: float) -> float:
    """Whole counts as the integers that they were."""
    return int(counts) if counts.is_integer() else counts
