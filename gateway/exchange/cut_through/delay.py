"""The forwarding delay: how late the first byte of a frame leaves that is forwarded while it still arrives.

A byte leaves when the bytes have come that it depends on; a transmitter that has begun must never run empty
inside the frame: adapters that switch the direction of an RS-485 bus by themselves let go of it then, and
drives take a pause for the end of a frame. So the first byte waits until no later one will have to.

A :class:`FrameShape` says what depends on what, in bytes. :func:`delay_ns` makes a time of it for two wires
that keep their baud rates exactly. What adapters, drivers and this process add, nobody works out:
:class:`MeasuredDelay` learns it from the frames that came.

Counted in characters of wires that are both equally fast a write of one position of two registers leaves four
characters after it began to arrive: the last byte of its position is the eleventh to come, and the first one
the eighth to leave. Where the first three bytes decide that one (``ByteThreshold.is_early``), it leaves three
after. Its acknowledgement leaves two later, for the check sum has to have come before its own leaves; so do a
read without positions, and its reply three. A gateway that stores adds all 13 + 8 characters of both.
"""

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateway.modbus.crc import ends_a_frame, residue_after
from gateway.modbus.lengths import ADU_OVERHEAD, MIN_ADU
from gateway.modbus.rtu_arrival import BLOCK_HEAD, REGISTERS_HEAD

CRC_BYTES: Final = 2
FUNCTION_BYTES: Final = 2
"""Bytes of a frame that say who is meant and what is done."""
PAGE_BYTES: Final = 3
"""Bytes of a request that also say in which 256 registers the first one is."""
ADDRESS_BYTES: Final = MIN_ADU
"""Bytes of a request that also say at which register."""
COUNT_BYTES: Final = 3
"""Bytes of the reply to a read that also say how long it is."""
READ_BYTES: Final = REGISTERS_HEAD + CRC_BYTES


class ByteThreshold(NamedTuple):
    """Byte ``first`` of a frame, and all behind it, leave only when ``needs`` bytes of it have come."""

    first: int
    needs: int
    is_judged: bool = False
    """A position ends there: what leaves in the place of the bytes between is somebody's judgement."""
    is_early: bool = False
    """Byte ``first``, of a position of four bytes whose highest one comes first, leaves already when all but
    the last one have come: where these decide it."""

    def needs_of(self, index: int) -> int:
        """Return how many bytes this gate wants to have come before byte ``index`` leaves."""
        if index < self.first:
            return 0
        return self.needs - 1 if self.is_early and index == self.first else self.needs


@dataclass(frozen=True, slots=True)
class FrameShape:
    """A frame of so many bytes, with unit id and check sum, and what its bytes wait for.

    Gates stand in their order. Every byte waits at least for itself, and the check sum for all that came.
    """

    length: int
    thresholds: tuple[ByteThreshold, ...]
    late: "FrameShape | None" = None
    """What the frame is where none of its bytes leaves sooner than is always safe; None: what it is here."""

    def needs(self, index: int) -> int:
        """Return how many bytes have to have come before byte ``index``, counted from 0, may leave.

        >>> [write_shape(2, 0, 2).needs(index) for index in range(13)]
        [4, 4, 4, 4, 5, 6, 7, 11, 11, 11, 11, 13, 13]
        >>> [write_shape(2, 0, 2, is_early=True).needs(index) for index in range(13)]
        [3, 3, 3, 4, 5, 6, 7, 10, 11, 11, 11, 13, 13]
        """
        if index >= self.length - CRC_BYTES:
            return self.length
        return max([index + 1] + [threshold.needs_of(index) for threshold in self.thresholds])

    def leaves(self, come: int) -> int:
        """Return how many of its bytes may have left when ``come`` have come, without its check sum.

        >>> [write_shape(2, 0, 2).leaves(come) for come in range(14)]
        [0, 0, 0, 0, 4, 5, 6, 7, 7, 7, 7, 11, 11, 11]
        >>> [write_shape(2, 0, 2, is_early=True).leaves(come) for come in range(14)]
        [0, 0, 0, 3, 4, 5, 6, 7, 7, 7, 8, 11, 11, 11]
        """
        most = min(come, self.length - CRC_BYTES)
        for threshold in self.thresholds:
            if come < threshold.needs:
                most = min(most, threshold.first + (threshold.is_early and come == threshold.needs - 1))
        return most

    def reach(self, before: bytes, now: bytes, reach: int) -> int:
        """Return how far from ``now`` the positions of the next frame may be expected: :meth:`stays`.

        Twice as far as the last step, and a little farther; a longer one before is forgotten slowly.

        Args:
            before: the frame before, without check sum; empty: there was none.
            now: the newest one.
            reach: what was returned for ``before``.
        """
        if not before:
            return FAR_COUNTS
        longest = 0
        for threshold in self.thresholds:
            if threshold.is_early:
                step = abs(_position(threshold, now) - _position(threshold, before))
                longest = max(longest, min(step, COUNTS - step))
        remembered = 0 if reach == FAR_COUNTS else reach - reach // FORGOTTEN
        return max(2 * longest + NEAR_COUNTS, remembered)

    def stays(self, frame: bytes, reach: int) -> bool:
        """Whether the first byte of each position may be expected to stay what it was in ``frame``.

        Nothing but whether it pays hangs on that: where it does not stay, a frame is spoilt.
        """
        if ends_a_frame(residue_after(frame[: self.needs(0)])):
            return False  # no piece ends there
        for threshold in self.thresholds:
            if threshold.is_early:
                position = _position(threshold, frame)
                if (position - reach) >> 24 != (position + reach) >> 24:
                    return False
                if ends_a_frame(residue_after(frame[: threshold.first + 1])):
                    return False
        return True


COUNTS: Final = 1 << 32
"""So many numbers a position has whose first byte may leave before it is whole."""
FAR_COUNTS: Final = COUNTS
"""The next position may be anywhere."""
NEAR_COUNTS: Final = 4 << 8
"""So far the next position may be from one that did not move: four times what its last byte leaves open."""
FORGOTTEN: Final = 16
"""So large a part of an older reach is taken off with each frame."""


def _position(threshold: ByteThreshold, frame: bytes) -> int:
    return int.from_bytes(frame[threshold.first : threshold.needs], "big")


def write_shape(words: int, first_word: int, position_words: int, *, is_early: bool = False) -> FrameShape:
    """Return the shape of a write of ``words`` registers that hold a position from ``first_word`` on.

    It begins to leave when it is known where it writes, its data when the position is whole: until then it
    may have to be refused.

    ``is_early``: the position stands first and has four bytes, the highest first, and nothing else that moves
    or stops is written at an address with the same first byte. So it begins to leave with that byte.
    """
    data_ends = BLOCK_HEAD + 2 * (first_word + position_words)
    length = BLOCK_HEAD + 2 * words + CRC_BYTES
    late = FrameShape(
        length, (ByteThreshold(0, ADDRESS_BYTES), ByteThreshold(BLOCK_HEAD, data_ends, is_judged=True))
    )
    if not is_early:
        return late
    data = ByteThreshold(BLOCK_HEAD, data_ends, is_judged=True, is_early=True)
    return FrameShape(length, (ByteThreshold(0, PAGE_BYTES), data), late)


def read_shape() -> FrameShape:
    """Return the shape of a read. It changes nothing in a drive, and may begin to leave at its function."""
    return FrameShape(READ_BYTES, (ByteThreshold(0, FUNCTION_BYTES),))


def acknowledgement_shape() -> FrameShape:
    """Return the shape of the reply to a write of a block: unit id, function, address, count."""
    return FrameShape(READ_BYTES, (ByteThreshold(0, FUNCTION_BYTES),))


def reply_shape(
    words: int, positions: Sequence[tuple[int, int]] = (), early: Collection[int] = ()
) -> FrameShape:
    """Return the shape of the reply to a read of ``words`` registers.

    ``positions``: the first register of each and how many it has, in their order. ``early``: the first
    registers of those that have four bytes, the highest first.
    """
    length = ADU_OVERHEAD + FUNCTION_BYTES + 2 * words
    thresholds, late = [ByteThreshold(0, COUNT_BYTES)], [ByteThreshold(0, COUNT_BYTES)]
    for word, count in positions:
        first, data_ends = COUNT_BYTES + 2 * word, COUNT_BYTES + 2 * (word + count)
        late.append(ByteThreshold(first, data_ends, is_judged=True))
        thresholds.append(late[-1]._replace(is_early=word in early))
    shape = FrameShape(length, tuple(late))
    return FrameShape(length, tuple(thresholds), shape) if early else shape


def delay_ns(shape: FrameShape, in_ns: int, out_ns: int) -> int:
    """Return how long after the first bit of a frame came its own first bit may leave, at the earliest.

    Args:
        shape: what depends on what.
        in_ns: what one character takes on the wire on which it comes.
        out_ns: and on the one on which it leaves.
    """
    return max(shape.needs(index) * in_ns - index * out_ns for index in range(shape.length))


def stored_ns(shape: FrameShape, in_ns: int) -> int:
    """Return the same for a gateway that waits for the whole frame."""
    return shape.length * in_ns


class Piece(NamedTuple):
    """Bytes of a frame that came at once: when, and how many there are of it since then."""

    came_ns: int
    so_far: int


def needed_ns(shape: FrameShape, pieces: Sequence[Piece], out_ns: int) -> int:
    """Return how long after its first piece a frame that has come would have had to begin to leave.

    The pieces are those of a whole frame, in their order. Between two pieces only the first byte that needs
    the later one counts: those behind it have more time.
    """
    begun_ns = pieces[0].came_ns
    most_ns, before = 0, 0
    for piece in pieces:
        # The check sum needs all of them; what leaves then is the first byte that did not before.
        first = shape.leaves(before)
        if shape.needs(first) <= piece.so_far:
            most_ns = max(most_ns, piece.came_ns - begun_ns - first * out_ns)
        before = piece.so_far
    return most_ns


GUARDED: Final = 4
"""The guard is so large a part of a character,"""
LEAST_GUARD_NS: Final = 125_000
"""and never less: where characters are long, more time costs as small a part of a round trip."""
LATER_NS: Final = 75_000
"""So much later than the latest that was seen, and half of what they differed by, bytes may come. Less than
the guard: a frame whose bytes come later still is spoilt, one whose guard rings later has a gap in it."""
LEARNED_AFTER: Final = 32
"""Frames of a shape that are stored before the first one may leave early: nobody knows the port before."""
REMEMBERED: Final = 256
"""Frames whose needs count: a port that was disturbed once is trusted again after so many."""


def guard_ns(out_ns: int) -> int:
    """Return how long before the transmitter is empty a frame that stalls is filled up.

    It is what the timer that rings then, a turn of the loop and a write may take together: nobody sees that
    in what came, so nothing teaches it. ``out_ns``: what a character takes on the wire on which it leaves.
    """
    return max(LEAST_GUARD_NS, out_ns // GUARDED)


def margin_ns(out_ns: int) -> int:
    """Return how much longer the first byte of a frame waits than the frames before it needed.

    >>> margin_ns(1_145_833), margin_ns(286_458)  # 9 600 and 38 400 baud, 8E1
    (361458, 200000)
    """
    return guard_ns(out_ns) + LATER_NS


class MeasuredDelay:
    """How long after its first piece a frame of one shape may begin to leave, by what the last ones needed.

    No model of an adapter: latency timers, packets, the scheduler of the system and different baud rates all
    show in when the bytes came. To the longest of their needs comes half of what they have differed by, the
    longest that the gateway itself took between reading and writing, and ``margin_ns``.
    """

    __slots__ = (
        "_char_ns",
        "_margin_ns",
        "_needs_ns",
        "_own_ns",
        "_wholes_ns",
        "delay_ns",
        "no_gain",
        "out_ns",
        "shape",
    )

    def __init__(self, shape: FrameShape, in_ns: int, out_ns: int, margin_ns: int) -> None:
        self.shape = shape
        self._margin_ns = margin_ns
        self.out_ns = out_ns
        self._char_ns = max(in_ns, out_ns)
        self._needs_ns: deque[int] = deque(maxlen=REMEMBERED)
        self._own_ns: deque[int] = deque(maxlen=REMEMBERED)
        self._wholes_ns: deque[int] = deque(maxlen=REMEMBERED)
        self.delay_ns: int | None = None
        """After so long a frame may begin to leave. None: it is stored, because too few have been seen, or
        because it would not leave a character before the soonest of them was whole."""
        self.no_gain: tuple[int, int] | None = None
        """Where enough were seen, and it is not worth it: after how long a frame could begin to leave, and
        after how long the soonest was whole, both since its first piece."""

    def add(self, pieces: Sequence[Piece], own_ns: int = 0, written_need_ns: int = 0) -> None:
        """Learn from a frame that has come whole, whether it was cut through or stored.

        ``own_ns``: so long the gateway took between reading its last bytes and writing them.
        ``written_need_ns``: by its writing one that was cut through would have had to begin so long after its
        first piece (``ForwardedFrame.written_need_ns``).
        """
        needs_ns, wholes_ns = self._needs_ns, self._wholes_ns
        need_ns = needed_ns(self.shape, pieces, self.out_ns)
        needs_ns.append(need_ns)
        self._own_ns.append(max(0, own_ns, written_need_ns - need_ns))
        wholes_ns.append(pieces[-1].came_ns - pieces[0].came_ns)
        longest_ns = max(needs_ns)
        spread_ns = longest_ns - min(needs_ns)
        delay_ns = longest_ns + spread_ns // 2 + max(self._own_ns) + self._margin_ns
        is_known, whole_ns = len(needs_ns) >= LEARNED_AFTER, min(wholes_ns)
        is_gain = is_known and delay_ns + self._char_ns <= whole_ns
        self.delay_ns = delay_ns if is_gain else None
        self.no_gain = (delay_ns, whole_ns) if is_known and not is_gain else None


class Delays:
    """How late each shape of frames has to begin to leave between two wires, as far as it was measured.

    Args:
        in_ns: what a character takes on the wire on which they come.
        out_ns: and on the one on which they leave.
        margin_ns: see ``MeasuredDelay``.
    """

    __slots__ = ("_in_ns", "_margin_ns", "_out_ns", "measured")

    def __init__(self, in_ns: int, out_ns: int, margin_ns: int) -> None:
        self._in_ns = in_ns
        self._out_ns = out_ns
        self._margin_ns = margin_ns
        self.measured: dict[FrameShape, MeasuredDelay] = {}

    def measure(
        self, shape: FrameShape, pieces: Sequence[Piece], own_ns: int = 0, written_need_ns: int = 0
    ) -> MeasuredDelay:
        """Learn from how a frame came, whatever became of it; return what is known now."""
        delay = self.measured.get(shape)
        if delay is None:
            delay = self.measured[shape] = MeasuredDelay(shape, self._in_ns, self._out_ns, self._margin_ns)
        delay.add(pieces, own_ns, written_need_ns)
        return delay

    def of(self, shape: FrameShape) -> int | None:
        """Return after how long a frame of a shape may begin to leave; None: it is stored."""
        delay = self.measured.get(shape)
        return None if delay is None else delay.delay_ns
