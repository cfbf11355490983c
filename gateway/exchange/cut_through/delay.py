"""The forwarding delay: how long the first byte of a frame waits while the frame still comes in.

A byte can be sent when the bytes on which it depends have come. But a transmitter must never run empty inside
a frame: RS-485 adapters that switch direction automatically would release the bus, and drives would take the
pause for the end of the frame. So the first byte waits long enough that no later byte has to wait.

A :class:`FrameShape` says which byte depends on which. :func:`delay_ns` converts that to a time for two wires
with exact baud rates. The delays of adapters, drivers and this process cannot be computed:
:class:`MeasuredDelay` learns them from received frames.

An example, in characters, for two wires of the same speed and a write of one position of two registers. The
first byte is sent four characters after it began to come in. The last byte of the position is the eleventh
to come in, and the first byte of the position is the eighth to be sent. If its first three bytes decide that
byte (``ByteThreshold.is_early``), the delay is three characters. The acknowledgement has a delay of two: its
CRC must come in before its own CRC is sent. A read without positions has the same delay, and its reply has
three. A gateway that stores both frames adds all of their 13 + 8 characters.
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
"""Bytes of a frame that hold the unit id and the function."""
PAGE_BYTES: Final = 3
"""Bytes of a request that also tell in which block of 256 registers the first one is."""
ADDRESS_BYTES: Final = MIN_ADU
"""Bytes of a request that also hold the address of the first register."""
COUNT_BYTES: Final = 3
"""Bytes of a reply to a read that also hold its byte count."""
READ_BYTES: Final = REGISTERS_HEAD + CRC_BYTES


class ByteThreshold(NamedTuple):
    """Byte ``first`` of a frame, and all behind it, are sent only when ``needs`` bytes of it have come."""

    first: int
    needs: int
    is_judged: bool = False
    """A position ends there: a judge decides what is sent instead of the bytes between."""
    is_early: bool = False
    """Byte ``first`` is sent one byte earlier, if the bytes before the last one decide it. Only for a
    position of four bytes, with the most significant byte first."""

    def needs_of(self, index: int) -> int:
        """Return how many bytes this threshold needs before byte ``index`` is sent."""
        if index < self.first:
            return 0
        return self.needs - 1 if self.is_early and index == self.first else self.needs


@dataclass(frozen=True, slots=True)
class FrameShape:
    """The length of a frame, with unit id and CRC, and what its bytes wait for.

    Thresholds are in ascending order. Each byte waits at least until it has come itself, the CRC for all
    bytes.
    """

    length: int
    thresholds: tuple[ByteThreshold, ...]
    late: "FrameShape | None" = None
    """The shape in which each byte waits until sending it is always safe; None: it is this one."""

    def needs(self, index: int) -> int:
        """Return how many bytes must have come before byte ``index``, counted from 0, may be sent.

        >>> [write_shape(2, 0, 2).needs(index) for index in range(13)]
        [4, 4, 4, 4, 5, 6, 7, 11, 11, 11, 11, 13, 13]
        >>> [write_shape(2, 0, 2, is_early=True).needs(index) for index in range(13)]
        [3, 3, 3, 4, 5, 6, 7, 10, 11, 11, 11, 13, 13]
        """
        if index >= self.length - CRC_BYTES:
            return self.length
        return max([index + 1] + [threshold.needs_of(index) for threshold in self.thresholds])

    def leaves(self, come: int) -> int:
        """Return how many of its bytes may have been sent when ``come`` have come, without its CRC.

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
        """Return how far from ``now`` the positions of the next frame are expected: for :meth:`stays`.

        Twice the last step and a little more; an older, longer step is forgotten slowly.

        Args:
            before: the frame before, without CRC; empty: there was none.
            now: the newest frame.
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
        """Whether the first byte of each position is likely to stay as it was in ``frame``.

        Only the gain depends on this: if the byte changes, the frame is aborted.
        """
        if ends_a_frame(residue_after(frame[: self.needs(0)])):
            return False  # no piece may end there
        for threshold in self.thresholds:
            if threshold.is_early:
                position = _position(threshold, frame)
                if (position - reach) >> 24 != (position + reach) >> 24:
                    return False
                if ends_a_frame(residue_after(frame[: threshold.first + 1])):
                    return False
        return True


COUNTS: Final = 1 << 32
"""Number of values of a position whose first byte may be sent before it is complete."""
FAR_COUNTS: Final = COUNTS
"""The next position may be anywhere."""
NEAR_COUNTS: Final = 4 << 8
"""Reach after a position that did not change: four times the range of its last byte."""
FORGOTTEN: Final = 16
"""With each frame an older reach shrinks by a sixteenth."""


def _position(threshold: ByteThreshold, frame: bytes) -> int:
    return int.from_bytes(frame[threshold.first : threshold.needs], "big")


def write_shape(words: int, first_word: int, position_words: int, *, is_early: bool = False) -> FrameShape:
    """Return the shape of a write of ``words`` registers that hold a position from ``first_word`` on.

    The head is sent as soon as the address is known. The data is sent when the position is complete: until
    then it may be refused.

    ``is_early``: the position comes first and has four bytes, the most significant first. No other address
    with the same first byte holds anything that moves or stops. So the frame is sent from that byte on.
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
    """Return the shape of a read. It changes nothing in a drive: it is sent from its function byte on."""
    return FrameShape(READ_BYTES, (ByteThreshold(0, FUNCTION_BYTES),))


def acknowledgement_shape() -> FrameShape:
    """Return the shape of the reply to a block write: unit id, function, address, count."""
    return FrameShape(READ_BYTES, (ByteThreshold(0, FUNCTION_BYTES),))


def reply_shape(
    words: int, positions: Sequence[tuple[int, int]] = (), early: Collection[int] = ()
) -> FrameShape:
    """Return the shape of the reply to a read of ``words`` registers.

    ``positions``: the first register of each position and its number of registers, in ascending order.
    ``early``: the first registers of those with four bytes, the most significant first.
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
    """Return the shortest delay from the first bit received to the first bit sent.

    Args:
        shape: which byte depends on which.
        in_ns: time of one character on the incoming wire.
        out_ns: time of one character on the outgoing wire.
    """
    return max(shape.needs(index) * in_ns - index * out_ns for index in range(shape.length))


def stored_ns(shape: FrameShape, in_ns: int) -> int:
    """Return the same delay for a gateway that waits for the complete frame."""
    return shape.length * in_ns


class Piece(NamedTuple):
    """Bytes of a frame that came together: when, and the number of bytes so far."""

    came_ns: int
    so_far: int


def needed_ns(shape: FrameShape, pieces: Sequence[Piece], out_ns: int) -> int:
    """Return how long after its first piece a received frame should have begun to be sent.

    ``pieces``: all pieces of a complete frame, in order. Between two pieces only the first byte that needs
    the later one counts: the bytes behind it have more time.
    """
    begun_ns = pieces[0].came_ns
    most_ns, before = 0, 0
    for piece in pieces:
        # The CRC needs all of them; only the first byte that could not be sent before counts.
        first = shape.leaves(before)
        if shape.needs(first) <= piece.so_far:
            most_ns = max(most_ns, piece.came_ns - begun_ns - first * out_ns)
        before = piece.so_far
    return most_ns


GUARDED: Final = 4
"""The guard is a character divided by this: with long characters, more time costs only a small part of a
round trip."""
LEAST_GUARD_NS: Final = 125_000
"""Minimum of the guard."""
LATER_NS: Final = 75_000
"""Bytes may come this much later than the latest so far plus half of the spread. It is less than the guard,
because a guard timer that is late does more harm: a frame whose bytes come still later is only aborted, but a
late guard timer leaves a gap in the frame."""
LEARNED_AFTER: Final = 32
"""Frames of a shape that are stored before the first one is forwarded: the port is not measured before."""
REMEMBERED: Final = 256
"""Number of frames whose needs count: after so many, a disturbed port is trusted again."""


def guard_ns(out_ns: int) -> int:
    """Return how long before the transmitter runs empty a stalled frame is filled up.

    The timer, one turn of the event loop and one write must fit into it. Received frames do not show this
    time, so it cannot be learned. ``out_ns``: time of one character on the outgoing wire.
    """
    return max(LEAST_GUARD_NS, out_ns // GUARDED)


def margin_ns(out_ns: int) -> int:
    """Return how much longer the first byte of a frame waits than the frames before it needed.

    >>> margin_ns(1_145_833), margin_ns(286_458)  # 9 600 and 38 400 baud, 8E1
    (361458, 200000)
    """
    return guard_ns(out_ns) + LATER_NS


class MeasuredDelay:
    """How long after its first piece a frame of one shape may be sent, learned from the last frames.

    It models no adapter: latency timers, packets, the system's scheduler and different baud rates all show in
    when the bytes came. The delay is the longest need, plus half of the spread, plus the longest time that
    the gateway itself took between reading and writing, plus ``margin_ns``.
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
        """A frame may be sent after so long. None: it is stored, because too few frames were seen, or because
        the gain over the earliest complete frame would be less than a character."""
        self.no_gain: tuple[int, int] | None = None
        """Where enough frames were seen and forwarding gains nothing: the delay after which a frame could be
        sent, and the time after which the earliest one was complete. Both count from the first piece."""

    def add(self, pieces: Sequence[Piece], own_ns: int = 0, written_need_ns: int = 0) -> None:
        """Learn from a completely received frame, forwarded or stored.

        ``own_ns``: time that the gateway took between reading its last bytes and writing them.
        ``written_need_ns``: how long after its first piece a forwarded frame should have begun, by the times
        of writing (``ForwardedFrame.written_need_ns``).
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
    """The measured forwarding delay of each frame shape between two wires.

    Args:
        in_ns: time of one character on the incoming wire.
        out_ns: time of one character on the outgoing wire.
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
        """Learn from the arrival of a frame, whatever its result; return the new measurement."""
        delay = self.measured.get(shape)
        if delay is None:
            delay = self.measured[shape] = MeasuredDelay(shape, self._in_ns, self._out_ns, self._margin_ns)
        delay.add(pieces, own_ns, written_need_ns)
        return delay

    def of(self, shape: FrameShape) -> int | None:
        """Return the delay after which a frame of a shape may be sent; None: it is stored."""
        delay = self.measured.get(shape)
        return None if delay is None else delay.delay_ns
