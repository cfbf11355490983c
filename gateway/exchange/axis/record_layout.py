"""The record of one axis in bytes: two slots, written alternately, each with its generation and a checksum.

A process may be killed between any two stores, and a power cut may leave half a page. The slot that is being
written then fails its checksum, and the other slot, one generation older, is valid. Little-endian, no
padding. The checksum is the CRC-32 of everything before it. Each slot has its own page.

Behind the header: the boot id of the newest records, and the generation from which it applies.

Behind that, in the same page: a step of a run. It holds what changes while setpoints continue in their
direction, and the generation of the record with everything else. Steps are written alternately, like slots,
each with its own checksum. The last valid one of the newest valid slot counts.

Behind each slot: its tail, with the slopes of its lines and its generation. It is zero as long as there never
was a slope, as in version 1, which had no tail. It is written before its slot, so a slot is never valid with
the tail of another one.
"""

import struct
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple
from zlib import crc32

from gateway.compensation.correction_spec import CorrectionSpec
from gateway.counts import Counts

VERSION: Final = 3
READABLE: Final = (1, 2, VERSION)
"""Version 1 has no tails, version 2 no steps."""
PAGE: Final = 4096
MAGIC: Final = b"PGAXREC\n"
NAME_BYTES: Final = 32
"""Maximum length of an axis name."""
HEADER: Final = struct.Struct(f"<8sH{NAME_BYTES}s")
BOOT: Final = struct.Struct("<16sQ")
"""Boot id, and the first generation written in that boot; the CRC-32 of both follows."""
SLOTS_AT: Final = (PAGE, 2 * PAGE)
RECORD_SIZE: Final = 3 * PAGE

_STATE: Final = "b?5dq"
"""Direction, unsure; position, extreme, progress, change, change distance; monotonic time."""
_HEAD: Final = "Q16s??"
"""Generation, scale digest; says something, has a move."""
_BASE: Final = "?????B" + "4d" + _STATE + "d?4d"
"""Has a target, at it, done, may have left it, words known, its field; nominal, corrected, way; state;
anchor, fade."""
_MOVE: Final = struct.Struct("<?B2d" + _STATE)
"""Is a distance, its field; nominal, corrected; state. Without a move the bytes here have no meaning."""
_SPEC: Final = struct.Struct("<B16s3d")
_SPECS: Final = 4 * _SPEC.size
_BODY: Final = struct.Struct(f"<{_HEAD}{_BASE}{_SPECS}s")
_CRC: Final = struct.Struct("<I")
_MOVE_AT: Final = _BODY.size
_CRC_AT: Final = _MOVE_AT + _MOVE.size
SLOT_SIZE: Final = _CRC_AT + _CRC.size
_TILTS: Final = struct.Struct("<Q4d")
"""Generation; slopes of the lines, in the order of the specs."""
_TAIL_SIZE: Final = _TILTS.size + _CRC.size
_NO_TAIL: Final = bytes(_TAIL_SIZE)
_STEP: Final = struct.Struct("<QQ??6dq4dq")
"""Generation, number of the step; has made one, has a target on the wire; nominal and corrected counts of the
target before and of the last one, position of that, extreme of its travel, time; of the target on the wire:
nominal and corrected counts, position, extreme, time."""
_STEP_SIZE: Final[int] = _STEP.size
_pack_step: Final = _STEP.pack_into
_pack_crc: Final = _CRC.pack_into
_STEP_IN_PAGE: Final = 640
STEPS_AT: Final = tuple(at + _STEP_IN_PAGE for at in SLOTS_AT)
assert SLOT_SIZE + _TAIL_SIZE <= _STEP_IN_PAGE <= PAGE - _STEP.size - _CRC.size
_LEVEL: Final[tuple[float, ...]] = (0.0, 0.0, 0.0, 0.0)  # mypyc loses a Final of unboxed floats
_EMPTY: Final = (
    *(False, False, False, False, False, 0, 0.0, 0.0, 0.0, 0.0),
    *(0, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0),
    *(0.0, False, 0.0, 0.0, 0.0, 0.0),
)
_NO_STEP: Final[tuple[object, ...]] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
_NO_MOVE: Final[tuple[object, ...]] = (0.0, 0.0, 0.0, 0.0, 0)
_IS_THERE: Final = 1
_IS_REQUESTED: Final = 2
_NO_SPEC: Final = _SPEC.pack(0, b"", 0.0, 0.0, 0.0)


Specs = tuple[
    CorrectionSpec, CorrectionSpec | None, CorrectionSpec | None, CorrectionSpec | None, CorrectionSpec
]
"""The corrections of the state, in force and fading out; the same of a move; and the requested one."""


class RememberedSpec(NamedTuple):
    """A correction that was in force: a table by its digest, with its gains, and a line."""

    digest: bytes
    """Empty: no table."""
    forward_gain: float
    backward_gain: float
    offset: float
    tilt: float
    """Of the line: its value at machine position 0, in units, and its slope."""
    was_requested: bool
    """The requested correction differed from it in the line only."""


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

    @property
    def is_corrected(self) -> bool:
        """Whether it corrects, or still fades out a correction."""
        return any(spec.digest or spec.offset for spec in (self.spec, self.previous) if spec is not None)


class RememberedMove(NamedTuple):
    """A target that was on the wire when the record was written: the drive may have received it or not."""

    is_distance: bool
    number: int
    """Number of its command field."""
    nominal_counts: Counts
    corrected_counts: Counts
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
    nominal_counts: Counts
    corrected_counts: Counts
    way: tuple[float, float]
    """Corrected counts between which the axis moves, the lower one first."""
    state: RememberedState
    anchor_counts: float
    fade: tuple[float, float, float, float] | None
    """Difference in counts, start, end, way in the other direction; see ``compensation.readback.Fade``."""
    unacknowledged: RememberedMove | None
    is_of_this_boot: bool
    """The machine was not restarted since: its clock continues."""
    came_from: tuple[Counts, Counts] | None = None
    """Nominal and corrected counts of the setpoint before the last one, if a run continued from there. Then
    anchor and fade above are those of an older setpoint, and are computed again from these counts."""

    @property
    def was_corrected(self) -> bool:
        """Whether a correction was in force, or on the wire."""
        move = self.unacknowledged
        return any(state.is_corrected for state in (self.state, move and move.state) if state is not None)


class RecordSlots:
    """Writes the newest record over the older slot of a buffer, and finds the newest valid one.

    The buffer has :data:`RECORD_SIZE` bytes. ``scale_digest`` belongs to the axis as configured now,
    ``boot_id`` to the machine. ``may_store`` is called before each store: a mapped file may have been
    truncated.
    """

    __slots__ = (
        "_boot_id",
        "_buffer",
        "_digest",
        "_generation",
        "_has_tail",
        "_is_boot_known",
        "_may_store",
        "_specs",
        "_specs_bytes",
        "_step",
        "_step_views",
        "_tilts",
        "_views",
    )

    def __init__(
        self,
        buffer: memoryview,
        scale_digest: bytes,
        boot_id: bytes = bytes(16),
        may_store: Callable[[], bool] | None = None,
    ) -> None:
        self._buffer = buffer
        self._may_store = may_store
        self._boot_id = boot_id
        self._is_boot_known = False
        self._digest = scale_digest
        self._views = tuple(buffer[at : at + _CRC_AT] for at in SLOTS_AT)
        self._step_views = tuple(buffer[at : at + _STEP.size] for at in STEPS_AT)
        found = [_generation(body) for body in self._bodies() if body is not None]
        self._generation: int = max(found, default=0)
        self._step = 0
        self._specs: Specs | None = None
        self._specs_bytes = b""
        self._tilts: tuple[float, ...] = _LEVEL
        self._has_tail = [any(_tail(buffer, number)) for number in (0, 1)]

    @property
    def generation(self) -> int:
        """Number of times that the record was written."""
        return self._generation

    @property
    def is_damaged(self) -> bool:
        """Whether something was written before and no slot is valid."""
        return not any(self._bodies()) and any(any(self._buffer[at : at + SLOT_SIZE]) for at in SLOTS_AT)

    @property
    def was_emptied(self) -> bool:
        """Whether the newest record says nothing, and the one before it says something."""
        good = sorted((body for body in self._bodies() if body is not None), key=_generation)
        return [_says_something(body) for body in good] == [True, False]

    def release(self) -> None:
        """Release the buffer; nothing may be written afterwards."""
        for view in (*self._views, *self._step_views):
            view.release()
        self._buffer.release()

    def write(self, base: tuple[object, ...], move: tuple[object, ...] | None, specs: Specs) -> None:
        """Write a record: its numbers in the order of the layout, and those of a target on the wire."""
        if specs != self._specs:
            self._specs = specs
            self._specs_bytes, self._tilts = _specs_bytes(specs)
        self._store(True, base, move, self._specs_bytes)

    def write_step(self, step: tuple[object, ...], move: tuple[object, ...] | None) -> None:
        """Write a step of a run that continues from the newest record.

        Args:
            step: the target before and the last one, in nominal and corrected counts each, position and
                extreme, time; empty: none was accepted since.
            move: the target on the wire in nominal and corrected counts, its position and extreme, time.
        """
        if self._may_store is not None and not self._may_store():
            return
        number = self._step = self._step + 1
        at, buffer = STEPS_AT[number & 1], self._buffer
        # One by one: starred unpacking would create a list and a tuple each time.
        from_nominal, from_corrected, to_nominal, to_corrected, position, extreme, at_ns = step or _NO_STEP
        nominal, corrected, going_position, going_extreme, going_at_ns = move or _NO_MOVE
        _pack_step(
            buffer, at, self._generation, number, bool(step), move is not None,
            from_nominal, from_corrected, to_nominal, to_corrected, position, extreme, at_ns,
            nominal, corrected, going_position, going_extreme, going_at_ns,
        )  # fmt: skip
        _pack_crc(buffer, at + _STEP_SIZE, crc32(self._step_views[number & 1]))

    def clear(self) -> None:
        """Write a record that says nothing."""
        self._store(False, _EMPTY, None, b"")

    def read(self) -> Remembered | None:
        """Return the newest valid record; None: there is none, or it says nothing."""
        good = [body for body in self._bodies() if body is not None]
        newest = max(good, key=_generation, default=None)
        if newest is None:
            return None
        tail = _tail(self._buffer, _generation(newest) & 1)
        found = _remembered(
            newest, _TILTS.unpack_from(tail)[1:], is_of_this_boot=self._is_of_this_boot(newest)
        )
        step = self._newest_step(_generation(newest))
        return found if found is None or step is None else _after_step(found, step)

    def _newest_step(self, generation: int) -> tuple[Any, ...] | None:
        """Return the last valid step of a generation; None: there is none."""
        found = [self._step_of(generation, at) for at in STEPS_AT]
        return max((step for step in found if step is not None), key=lambda step: step[1], default=None)

    def _step_of(self, generation: int, at: int) -> tuple[Any, ...] | None:
        data = bytes(self._buffer[at : at + _STEP.size])
        is_good = _CRC.unpack_from(self._buffer, at + _STEP.size)[0] == crc32(data)
        step = _STEP.unpack(data)
        return step if is_good and step[0] == generation else None

    def begin_anew(self) -> None:
        """The buffer was cleared from outside: what is written only once must be written again."""
        self._is_boot_known = False

    def _is_of_this_boot(self, body: bytes) -> bool:
        stamp = bytes(self._buffer[HEADER.size : HEADER.size + BOOT.size])
        boot_id, first = BOOT.unpack(stamp)
        is_whole = _CRC.unpack_from(self._buffer, HEADER.size + BOOT.size)[0] == crc32(stamp)
        return bool(is_whole and any(boot_id) and boot_id == self._boot_id and _generation(body) >= first)

    def _store_boot(self) -> None:
        self._is_boot_known = True
        stamp = BOOT.pack(self._boot_id, self._generation + 1)
        self._buffer[HEADER.size : HEADER.size + BOOT.size + _CRC.size] = stamp + _CRC.pack(crc32(stamp))

    def _store(
        self, is_known: bool, base: tuple[object, ...], move: tuple[object, ...] | None, specs: bytes
    ) -> None:
        if self._may_store is not None and not self._may_store():
            return
        if not self._is_boot_known:
            self._store_boot()
        generation = self._generation = self._generation + 1
        number = generation & 1
        at = SLOTS_AT[number]
        buffer = self._buffer
        if self._has_tail[number] or self._tilts != _LEVEL:
            self._store_tail(number, generation)
        _BODY.pack_into(buffer, at, generation, self._digest, is_known, move is not None, *base, specs)
        if move is not None:
            _MOVE.pack_into(buffer, at + _MOVE_AT, *move)
        _CRC.pack_into(buffer, at + _CRC_AT, crc32(self._views[number]))

    def _store_tail(self, number: int, generation: int) -> None:
        at = SLOTS_AT[number] + SLOT_SIZE
        self._has_tail[number] = True  # permanently: zeros again would fit any generation
        slopes = _TILTS.pack(generation, *self._tilts)
        self._buffer[at : at + _TAIL_SIZE] = slopes + _CRC.pack(crc32(slopes))

    def _bodies(self) -> list[bytes | None]:
        return [_body(self._buffer, number) for number in (0, 1)]


def header(name: str) -> bytes:
    """Return the header of a record."""
    return HEADER.pack(MAGIC, VERSION, name.encode())


def why_not_readable(data: bytes | memoryview, name: str, size: int | None = None) -> str:
    """Return what is wrong with the beginning of a record; "": nothing.

    ``size``: of the whole file in bytes, if ``data`` is only a part of it.
    """
    if size is None:
        size = len(data)
    if size != RECORD_SIZE:
        return f"it has {size} bytes and not {RECORD_SIZE}"
    magic, version, owner = HEADER.unpack_from(data)
    if magic != MAGIC:
        return "it is no record of an axis"
    if version not in READABLE:
        return f"it has version {version}, and this release reads versions {READABLE[0]} to {VERSION}"
    if owner != header(name)[-NAME_BYTES:]:
        return f"it belongs to axis {owner.rstrip(bytes(1)).decode(errors='replace')}"
    return ""


def _specs_bytes(specs: Specs) -> tuple[bytes, tuple[float, ...]]:
    """Return the corrections of state and move in bytes, and the slopes of their lines."""
    packed, tilts, requested = b"", [], specs[4]
    for spec in specs[:4]:
        if spec is None:
            packed += _NO_SPEC
            tilts.append(0.0)
            continue
        flags = _IS_THERE | (_IS_REQUESTED if spec is requested or spec.is_kin_of(requested) else 0)
        packed += _SPEC.pack(flags, spec.table_digest, spec.gain.forward, spec.gain.backward, spec.offset)
        tilts.append(spec.tilt)
    return packed, tuple(tilts)


def _body(buffer: memoryview, number: int) -> bytes | None:
    """Return a slot with a valid checksum and a generation that belongs there."""
    at = SLOTS_AT[number]
    data = bytes(buffer[at : at + _CRC_AT])
    if _CRC.unpack_from(buffer, at + _CRC_AT)[0] != crc32(data):
        return None
    is_whole = _generation(data) & 1 == number and _is_tail_of(_tail(buffer, number), _generation(data))
    return data if is_whole else None


def _tail(buffer: memoryview, number: int) -> bytes:
    at = SLOTS_AT[number] + SLOT_SIZE
    return bytes(buffer[at : at + _TAIL_SIZE])


def _is_tail_of(tail: bytes, generation: int) -> bool:
    """Whether a tail belongs to the slot of a generation: it is empty, or valid with the same generation."""
    if tail == _NO_TAIL:
        return True
    is_good: bool = _CRC.unpack_from(tail, _TILTS.size)[0] == crc32(tail[: _TILTS.size])
    return is_good and _generation(tail) == generation


def _generation(body: bytes) -> int:
    return int.from_bytes(body[:8], "little")


def _says_something(body: bytes) -> bool:
    is_known: bool = _BODY.unpack_from(body)[2]
    return is_known


def _remembered(body: bytes, tilts: Sequence[float], *, is_of_this_boot: bool) -> Remembered | None:
    generation, digest, is_known, has_move, *base, spec_bytes = _BODY.unpack_from(body)
    if not is_known:
        return None
    spec, previous, move_spec, move_previous = map(_spec, _SPEC.iter_unpack(spec_bytes), tilts)
    assert spec is not None
    unacknowledged = None
    if has_move:
        assert move_spec is not None
        is_distance, number, nominal, corrected, *state = _MOVE.unpack_from(body, _MOVE_AT)
        unacknowledged = RememberedMove(
            is_distance, number, _counts(nominal), _counts(corrected), _state(state, move_spec, move_previous)
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
        _state(base[10:18], spec, previous),
        base[18],
        (base[20], base[21], base[22], base[23]) if base[19] else None,
        unacknowledged,
        is_of_this_boot,
    )


def _after_step(found: Remembered, step: tuple[Any, ...]) -> Remembered:
    """Return a record with the changes of its last step."""
    _, _, is_made, has_move, *numbers = step
    *targets, position, extreme, at_ns = numbers[:7]
    if is_made:
        from_nominal, from_corrected, nominal, corrected = map(_counts, targets)
        low, high = sorted((from_corrected, corrected))
        found = found._replace(
            nominal_counts=nominal,
            corrected_counts=corrected,
            way=(low, high),
            state=found.state._replace(position=position, extreme=extreme, at_ns=at_ns),
            came_from=(from_nominal, from_corrected),
        )
    move = None
    if has_move:
        nominal, corrected, position, extreme, at_ns = numbers[7:]
        state = found.state._replace(position=position, extreme=extreme, at_ns=at_ns)
        move = RememberedMove(False, found.number, _counts(nominal), _counts(corrected), state)
    return found._replace(unacknowledged=move)


def _state(numbers: Sequence[Any], spec: RememberedSpec, previous: RememberedSpec | None) -> RememberedState:
    direction, is_unsure, position, extreme, progress, change, change_distance, at_ns = numbers
    return RememberedState(
        direction, is_unsure, position, extreme, progress, change, change_distance, at_ns, spec, previous
    )


def _spec(fields: tuple[Any, ...], tilt: float) -> RememberedSpec | None:
    flags, digest, forward, backward, offset = fields
    if not flags & _IS_THERE:
        return None
    was_requested = bool(flags & _IS_REQUESTED)
    return RememberedSpec(digest if any(digest) else b"", forward, backward, offset, tilt, was_requested)


def _counts(counts: float) -> Counts:
    """Return whole counts as integers again."""
    return int(counts) if counts.is_integer() else counts
