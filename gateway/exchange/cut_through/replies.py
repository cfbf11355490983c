"""Replies that are cut through: the acknowledgement of a target, and what a read on a fast path brings.

:class:`Replies` remembers what each request of a port was last answered: a reply that has to be filled up is
filled with that, so that a controller that looks at no check sum is told what it was told before.
:class:`ReplyJudge` answers for one reply on its way; it asks the fast path on which its request left.

Only a full native success is cut through. An exception, another unit id, function or length never begins to
leave (``ReplyArrival``); an acknowledgement of other registers than were written is spoilt where bytes of it
have left, and passed on whole where none has.
"""

from collections.abc import Callable, Sequence
from typing import Final

from gateway.exchange.cut_through.delay import (
    COUNT_KNOWN,
    FUNCTION_KNOWN,
    MeasuredDelay,
    Piece,
    Shape,
    acknowledgement_shape,
    reply_shape,
)
from gateway.exchange.cut_through.frame import Judge, Opening
from gateway.exchange.fast_path import ReadPath, WritePath
from gateway.exchange.transaction import Transaction

REMEMBERED_REPLIES: Final = 256
STORED_FOR: Final = 256
"""So many replies of a shape are stored after one of them was spoilt: its controller had to ask again."""
ACKNOWLEDGEMENT: Final = acknowledgement_shape()


def reply_shape_of(transaction: Transaction) -> Shape | None:
    """Return the shape of the reply to what is on the wire; None: it is not cut through."""
    path = transaction.path
    if isinstance(path, WritePath):
        return ACKNOWLEDGEMENT
    if not isinstance(path, ReadPath):
        return None
    head, ended = FUNCTION_KNOWN, 0  # of the PDU of a reply: function and byte count
    positions = []
    for start, end in path.places:
        if start < ended:
            return None  # two positions share a register: what it leaves as is decided by both
        positions.append(((start - head) // 2, (end - start) // 2))
        ended = end
    return reply_shape(path.quantity, positions)


class Replies:
    """What the requests of one port were last answered, and how late each shape has to begin to leave.

    Args:
        in_ns: what a character takes on the wire of the drives.
        out_ns: and on the controller's.
        margin_ns: see ``MeasuredDelay``.
    """

    __slots__ = ("_delays", "_in_ns", "_margin_ns", "_out_ns", "_passed", "_stored")

    def __init__(self, in_ns: int, out_ns: int, margin_ns: int) -> None:
        self._in_ns = in_ns
        self._out_ns = out_ns
        self._margin_ns = margin_ns
        self._passed: dict[tuple[int, bytes], bytes] = {}
        self._delays: dict[Shape, MeasuredDelay] = {}
        self._stored: dict[Shape, int] = {}
        """How many more of a shape are stored."""

    def note(self, transaction: Transaction, passed: bytes) -> None:
        """Remember what a read was answered: the PDU as its controller got it."""
        key = transaction.unit_id, transaction.pdu
        if len(self._passed) >= REMEMBERED_REPLIES and key not in self._passed:
            self._passed.clear()
        self._passed[key] = passed

    def measure(
        self, shape: Shape, pieces: Sequence[Piece], own_ns: int = 0, written_need_ns: int = 0
    ) -> MeasuredDelay:
        """Learn from how a reply came, whatever became of it; return what is known now."""
        delay = self._delays.get(shape)
        if delay is None:
            delay = self._delays[shape] = MeasuredDelay(shape, self._in_ns, self._out_ns, self._margin_ns)
        delay.note(pieces, own_ns, written_need_ns)
        left = self._stored.pop(shape, 0) - 1
        if left > 0:
            self._stored[shape] = left
        return delay

    def rest(self, shape: Shape) -> None:
        """One of a shape was spoilt: the next ones are stored."""
        self._stored[shape] = STORED_FOR

    def opening(self, transaction: Transaction) -> Opening | None:
        """Return what the reply to what is on the wire is expected to be; None: it is stored."""
        shape = reply_shape_of(transaction)
        delay = None if shape is None else self._delays.get(shape)
        if shape is None or delay is None or delay.delay_ns is None or shape in self._stored:
            return None
        path = transaction.path
        if isinstance(path, WritePath):
            expected = path.echo
        else:
            expected = self._passed.get((transaction.unit_id, transaction.pdu), b"")
        filler = bytes((transaction.unit_id,)) + expected
        return Opening(shape, delay.delay_ns, filler) if len(filler) == shape.length - 2 else None


class ReplyJudge(Judge):
    """Answers for the reply to one request, on its way to the controller.

    Args:
        transaction: what is on the wire.
        replies: what is known of the replies of its port.
        may_forward: whether the controller waits for it still, and its wire is free.
    """

    __slots__ = ("_may_forward", "_replies", "_transaction", "_turned", "turned")

    def __init__(self, transaction: Transaction, replies: Replies, may_forward: Callable[[], bool]) -> None:
        self._transaction = transaction
        self._replies = replies
        self._may_forward = may_forward
        self._turned = 0
        """Positions that were turned back."""
        self.turned: bytes | None = None
        """What the whole reply says to its controller, as soon as all of it was taken note of."""

    def opening(self, begun: bytes, now_ns: int) -> Opening | None:
        """See ``Judge``."""
        path = self._transaction.path
        known_by = FUNCTION_KNOWN if isinstance(path, WritePath) else COUNT_KNOWN
        if len(begun) < known_by or not self._may_forward():
            return None
        if isinstance(path, ReadPath) and not path.is_sure:
            return None
        return self._replies.opening(self._transaction)

    def fits(self, opening: Opening, begun: bytes) -> bool:
        """See ``Judge``: ``ReplyArrival`` has compared unit id, function and byte count."""
        return True

    def rendered(self, begun: bytes, first: int, end: int, now_ns: int) -> bytes | None:
        """See ``Judge``."""
        path = self._transaction.path
        assert isinstance(path, ReadPath)
        words = path.turned(self._transaction, self._turned, begun[first:end])
        self._turned += 1
        return words

    def commits(self, frame: bytes, sent: bytes, now_ns: int) -> bool:
        """See ``Judge``. The whole reply is taken note of, as one that was stored.

        Where something has come to another result meanwhile only its controller has not heard of it.
        """
        path = self._transaction.path
        assert path is not None
        self.turned = path.answered(self._transaction, frame[1:], now_ns)
        return self.turned == sent[1:]
