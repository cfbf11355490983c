"""Replies under cut-through: the acknowledgement of a target, and the reply to a read on a fast path.

:class:`Replies` remembers the last reply to each request of a port. An aborted reply is filled up with it, so
a controller that ignores the CRC receives what it received before. :class:`ReplyJudge` judges one reply on
its way; it asks the fast path on which its request was sent.

Only a normal, complete reply is forwarded. Nothing of an exception, or of a reply with another unit id,
function or length, is forwarded (``ReplyArrival``). An acknowledgement that names other registers than were
written is aborted if bytes of it were sent. Otherwise it is passed on completely.
"""

from typing import Final, NamedTuple

from gateway.exchange.cut_through.delay import (
    COUNT_BYTES,
    CRC_BYTES,
    FAR_COUNTS,
    FUNCTION_BYTES,
    Delays,
    FrameShape,
    acknowledgement_shape,
    reply_shape,
)
from gateway.exchange.cut_through.frame import Judge, Opening, opening_of
from gateway.exchange.fast_path import ReadPath, WritePath
from gateway.exchange.transaction import Transaction

REMEMBERED_REPLIES: Final = 256
STORED_FOR: Final = 256
"""Number of replies of a shape that are stored after an aborted one, because its controller had to ask
again."""
ACKNOWLEDGEMENT: Final = acknowledgement_shape()


class Passed(NamedTuple):
    """The last reply to a read."""

    frame: bytes
    """As its controller got it, without CRC."""
    reach: int
    """How far from it the positions of the next reply are expected (``FrameShape.reach``)."""


NOT_PASSED: Final = Passed(b"", FAR_COUNTS)


def reply_shape_of(transaction: Transaction) -> FrameShape | None:
    """Return the shape of the reply to what is on the wire; None: it is not forwarded."""
    path = transaction.path
    if isinstance(path, WritePath):
        return ACKNOWLEDGEMENT
    if not isinstance(path, ReadPath):
        return None
    head, ended = FUNCTION_BYTES, 0  # of the PDU of a reply: function and byte count
    positions, early = [], []
    for which, (start, end) in enumerate(path.byte_ranges):
        if start < ended:
            return None  # two positions share a register, so both decide its bytes
        first = (start - head) // 2
        positions.append((first, (end - start) // 2))
        if path.is_early(which):
            early.append(first)
        ended = end
    return reply_shape(path.quantity, positions, early)


class Replies:
    """The last replies to the requests of one port, and the forwarding delay of each shape."""

    __slots__ = ("_passed", "_stored", "delays")

    def __init__(self, delays: Delays) -> None:
        self.delays = delays
        """From the wire of the drives to the controller's."""
        self._passed: dict[tuple[int, bytes], Passed] = {}
        self._stored: dict[FrameShape, int] = {}
        """Number of further replies of a shape that are stored."""

    def add(self, transaction: Transaction, passed: bytes) -> None:
        """Remember the reply to a read: the PDU as its controller got it."""
        key, shape = (transaction.unit_id, transaction.pdu), reply_shape_of(transaction)
        if len(self._passed) >= REMEMBERED_REPLIES and key not in self._passed:
            self._passed.clear()
        frame = bytes((transaction.unit_id,)) + passed
        before = self._passed.get(key, NOT_PASSED)
        is_whole = shape is not None and len(frame) == len(before.frame) == shape.length - CRC_BYTES
        reach = shape.reach(before.frame, frame, before.reach) if shape and is_whole else FAR_COUNTS
        self._passed[key] = Passed(frame, reach)

    def came(self, shape: FrameShape) -> None:
        """A reply of a shape came in completely, whatever its result."""
        left = self._stored.pop(shape, 0) - 1
        if left > 0:
            self._stored[shape] = left

    def rest(self, shape: FrameShape) -> None:
        """A reply of a shape was aborted: the next ones are stored."""
        self._stored[shape] = STORED_FOR

    def opening(self, transaction: Transaction) -> Opening | None:
        """Return the expected reply to what is on the wire; None: it is stored."""
        shape = reply_shape_of(transaction)
        if shape is None or shape in self._stored:
            return None
        path = transaction.path
        if isinstance(path, WritePath):
            filler, reach = bytes((transaction.unit_id,)) + path.echo, 0
        else:
            filler, reach = self._passed.get((transaction.unit_id, transaction.pdu), NOT_PASSED)
        if len(filler) != shape.length - CRC_BYTES:
            return None
        return opening_of(shape, self.delays, filler, is_early=shape.stays(filler, reach))


class ReplyJudge(Judge):
    """Judges the reply to one request, on its way to the controller.

    Args:
        transaction: what is on the wire.
        replies: what was learned of the replies of its port.
    """

    __slots__ = ("_next_position", "_replies", "nominal_reply", "transaction")

    def __init__(self, transaction: Transaction, replies: Replies) -> None:
        self.transaction = transaction
        self._replies = replies
        self._next_position = 0
        """Number of positions that were converted back to nominal."""
        self.nominal_reply: bytes | None = None
        """The complete reply as its controller gets it, once all of it was processed."""

    def opening(self, begun: bytes, now_ns: int) -> Opening | None:
        """See ``Judge``."""
        path = self.transaction.path
        needed_bytes = FUNCTION_BYTES if isinstance(path, WritePath) else COUNT_BYTES
        if len(begun) < needed_bytes or not self._may_begin(now_ns):
            return None
        if isinstance(path, ReadPath) and not path.is_sure:
            return None
        return self._replies.opening(self.transaction)

    def _may_begin(self, now_ns: int) -> bool:
        """Whether its controller still waits for it, and its wire is free."""
        transaction = self.transaction
        port = transaction.port
        is_awaited = not transaction.is_orphan and now_ns <= transaction.given_up_ns
        return port is not None and is_awaited and port.may_forward(now_ns)

    def fits(self, opening: Opening, begun: bytes) -> bool:
        """See ``Judge``: ``ReplyArrival`` has compared unit id, function and byte count."""
        return True

    def rendered(self, begun: bytes, first: int, end: int, now_ns: int) -> bytes | None:
        """See ``Judge``."""
        path = self.transaction.path
        assert isinstance(path, ReadPath)
        words = path.nominal_words(self.transaction, self._next_position, begun[first:end])
        self._next_position += 1
        return words

    def begins_with(self, byte: int, begun: bytes, first: int, now_ns: int) -> bool:
        """See ``Judge``."""
        path = self.transaction.path
        assert isinstance(path, ReadPath)
        return path.begins_with(byte, self.transaction, self._next_position, begun[first:])

    def commits(self, frame: bytes, sent: bytes, now_ns: int) -> bool:
        """See ``Judge``. The complete reply is processed like a stored one.

        If the result differs from the bytes sent, only the controller's reply is lost.
        """
        path = self.transaction.path
        assert path is not None
        self.nominal_reply = path.answered(self.transaction, frame[1:], now_ns)
        return self.nominal_reply == sent[1:]
