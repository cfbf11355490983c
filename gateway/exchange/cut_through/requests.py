"""Requests under cut-through: which may be forwarded, and what is sent instead of their positions.

:class:`Heads` remembers the acknowledged requests of one controller port. A request with the same beginning
is expected to continue in the same way. :class:`RequestJudge` judges one request on its way
(``frame.ForwardedFrame``). It decides nothing itself: it asks the fast path.

Only two kinds are remembered: reads that have a fast path, and writes of one complete position (FC16) to
drives whose map has no modes, triggers or stops. So an expected beginning never matches a stop, a trigger,
FC06, a broadcast, or anything that needs the slow path.
"""

from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from gateway.exchange.axis.acknowledge import SteadyTarget
from gateway.exchange.cut_through.delay import (
    ADDRESS_BYTES,
    FAR_COUNTS,
    FUNCTION_BYTES,
    PAGE_BYTES,
    Delays,
    FrameShape,
    read_shape,
    write_shape,
)
from gateway.exchange.cut_through.frame import Judge, Opening, is_fit_head, opening_of
from gateway.exchange.dispatch import UnitMaps
from gateway.exchange.fast_path import WritePath
from gateway.exchange.ports import ControllerPort
from gateway.exchange.transaction import FastPath, Transaction
from gateway.modbus.pdu import FunctionCode
from gateway.modbus.rtu_arrival import BLOCK_HEAD, REGISTERS_HEAD

WRITE: Final = FunctionCode.WRITE_MULTIPLE_REGISTERS
REGISTER_READS: Final = frozenset({FunctionCode.READ_HOLDING_REGISTERS, FunctionCode.READ_INPUT_REGISTERS})
REMEMBERED_BEGINNINGS: Final = 256
"""A controller uses a few. If one uses more, all are forgotten when the limit is reached."""
READ: Final = read_shape()
WEIGHED: Final = 64
"""Number of the newest forwarded requests that are compared: time gained against time lost."""
WEIGHED_AT_LEAST: Final = 8
STORED_FOR: Final = 256
"""Number of requests that are stored after a loss, before forwarding is tried again."""


class Expected(NamedTuple):
    """The newest acknowledged request of those with the same beginning."""

    shape: FrameShape
    sent: bytes
    """As it was sent, without its CRC."""
    reach: int
    """How far from it the next one is expected (``FrameShape.reach``)."""


def shape_of(path: FastPath | None, frame: bytes) -> FrameShape | None:
    """Return the shape of a request, complete or only its head; None: it is not forwarded.

    ``path``: its fast path, if it has one.
    """
    if path is None:
        return None
    function = frame[1]
    if function in REGISTER_READS:
        return READ
    if function != WRITE or not isinstance(path, WritePath):
        return None
    start, end = path.byte_range
    data = BLOCK_HEAD - 1
    words, first, count = frame[BLOCK_HEAD - 1] // 2, (start - data) // 2, (end - start) // 2
    return write_shape(words, first, count, is_early=path.is_early)


def beginning_of(begun: bytes) -> bytes:
    """Return the bytes that identify a request: the function of a read, also the address of a write.

    Empty while fewer bytes have come.
    """
    if len(begun) < FUNCTION_BYTES:
        return b""
    needed_bytes = ADDRESS_BYTES if begun[1] == WRITE else FUNCTION_BYTES
    return begun[:needed_bytes] if len(begun) >= needed_bytes else b""


class Heads:
    """The beginnings of one port's requests, and the forwarding delay of each of their shapes.

    A write is identified by its complete address. The first byte of the address is enough under two
    conditions: all writes of the port with this byte went to one address, and the register map has no other
    target there (``WritePath.is_early``).
    """

    __slots__ = ("_expected", "_gains", "_pages", "_stored", "delays")

    def __init__(self, delays: Delays) -> None:
        self.delays = delays
        """From the controller's wire to that of the drives."""
        self._expected: dict[bytes, Expected | None] = {}
        """None: requests with this beginning continue in different ways."""
        self._pages: dict[bytes, bytes] = {}
        """By the first three bytes of received writes: their common beginning; empty: they differ."""
        self._gains: dict[bytes, deque[int]] = {}
        """For the last requests with a beginning: how much earlier each was sent than if stored; below 0:
        later."""
        self._stored: dict[bytes, int] = {}
        """Number of further requests with a beginning that are stored, because forwarding did not pay."""

    def add(self, path: FastPath | None, frame: bytes, sent: bytes) -> None:
        """Remember an acknowledged request, as it came and as it was sent, both without CRC.

        Two with the same beginning that continue differently are both stored from then on. Reads may differ:
        they change nothing, and all have one length.
        """
        shape = shape_of(path, frame)
        beginning = beginning_of(frame)
        is_new = beginning not in self._expected
        if is_new and len(self._expected) >= REMEMBERED_BEGINNINGS:
            self._expected.clear()
            self._pages.clear()
            self._gains.clear()
            self._stored.clear()
        before = None if is_new else self._expected[beginning]
        if shape is None and frame[1] in REGISTER_READS:
            return  # a read on the slow path, the first or one of several; ``pay`` weighs how often
        head = sent[: REGISTERS_HEAD if shape is READ else BLOCK_HEAD]
        is_alike = is_new or shape is READ or (before is not None and before.sent[:BLOCK_HEAD] == head)
        is_expected = shape is not None and is_alike and is_fit_head(head)
        self.saw(frame)
        if shape is None or not is_expected:
            self._expected[beginning] = None
            return
        reach = FAR_COUNTS if before is None else shape.reach(before.sent, sent, before.reach)
        self._expected[beginning] = Expected(shape, sent, reach)

    def saw(self, frame: bytes) -> None:
        """Record any complete request: writes to different addresses may begin with the same three bytes."""
        beginning = beginning_of(frame)
        if len(beginning) != ADDRESS_BYTES:
            return
        page = beginning[:PAGE_BYTES]
        if len(self._pages) >= REMEMBERED_BEGINNINGS and page not in self._pages:
            self._pages.clear()
        self._pages[page] = beginning if self._pages.get(page, beginning) == beginning else b""

    def came(self, frame: bytes) -> None:
        """A request came in completely, whatever its result."""
        beginning = beginning_of(frame)
        left = self._stored.pop(beginning, 0) - 1
        if left > 0:
            self._stored[beginning] = left

    def pay(self, frame: bytes, gain_ns: int) -> None:
        """Record how much earlier a forwarded request was sent than if stored; below 0: later.

        If the sum is a loss, the next ones are stored.
        """
        beginning = beginning_of(frame)
        gains = self._gains.get(beginning)
        if gains is None:
            gains = self._gains[beginning] = deque(maxlen=WEIGHED)
        gains.append(gain_ns)
        if len(gains) >= WEIGHED_AT_LEAST and sum(gains) < 0:
            self._stored[beginning] = STORED_FOR
            gains.clear()

    def opening(self, begun: bytes) -> Opening | None:
        """Return the request expected after this beginning; None: it is stored, or needs more bytes."""
        alone = self._pages.get(begun[:PAGE_BYTES], b"")
        beginning = beginning_of(begun) or alone
        expected = self._expected.get(beginning)
        if expected is None or beginning in self._stored:
            return None
        is_early = alone == beginning and expected.shape.stays(expected.sent, expected.reach)
        opening = opening_of(expected.shape, self.delays, expected.sent, is_early=is_early)
        return None if opening is None or len(begun) < opening.shape.needs(0) else opening


class RequestJudge(Judge):
    """Judges one request of one port on its way to the drives.

    Args:
        port: of its controller.
        units: the register maps of the line.
        heads: what was learned of the port's requests.
        may_forward: whether the line is free, does not rest and expects no late reply, and the port may send
            anything.
        leaves: records that the request is sent on its fast path, with its target, and returns what is sent;
            None: it may not be sent.
    """

    __slots__ = ("_heads", "_judged_ns", "_leaves", "_may_forward", "_port", "_target", "_units", "path")

    def __init__(
        self,
        port: ControllerPort,
        units: UnitMaps,
        heads: Heads,
        may_forward: Callable[[ControllerPort, int], bool],
        leaves: Callable[[FastPath, bytes, SteadyTarget | None, int], bytes | None],
    ) -> None:
        self._port = port
        self._units = units
        self._heads = heads
        self._may_forward = may_forward
        self._leaves = leaves
        self._target: SteadyTarget | None = None
        self._judged_ns = 0
        self.path: FastPath | None = None

    def opening(self, begun: bytes, now_ns: int) -> Opening | None:
        """See ``Judge``. A target that cannot pass, whatever its words are, is stored instead of aborted."""
        opening = self._heads.opening(begun) if self._may_forward(self._port, now_ns) else None
        if opening is None or begun[1] != WRITE:
            return opening
        path = self._units.path_of(begun[0], opening.filler[1:])
        is_ready = isinstance(path, WritePath) and path.is_ready(self._port, now_ns)
        return opening if is_ready else None

    def fits(self, opening: Opening, begun: bytes) -> bool:
        """See ``Judge``. A write goes to the expected registers, a read to any registers with a fast path."""
        is_write = begun[1] == WRITE
        head = begun[: BLOCK_HEAD if is_write else REGISTERS_HEAD]
        if is_write and head != opening.filler[:BLOCK_HEAD]:
            return False
        whole = head + bytes(opening.shape.length - 2 - len(head))
        self.path = self._units.path_of(head[0], whole[1:])
        shape = shape_of(self.path, head)
        return shape is not None and opening.shape in (shape, shape.late)

    def rendered(self, begun: bytes, first: int, end: int, now_ns: int) -> bytes | None:
        """See ``Judge``."""
        path = self.path
        assert isinstance(path, WritePath)
        start, stop = (
            1 + path.byte_range[0],
            1 + path.byte_range[1],
        )  # of the frame, which has a unit id before its PDU
        target = path.judged(self._port, begun[start:stop], now_ns)
        if target is None:
            return None
        self._target, self._judged_ns = target, now_ns
        return begun[first:start] + target.corrected_words + begun[stop:end]

    def begins_with(self, byte: int, begun: bytes, first: int, now_ns: int) -> bool:
        """See ``Judge``."""
        path = self.path
        assert isinstance(path, WritePath)
        return path.begins_with(byte, self._port, begun[first:], now_ns)

    def commits(self, frame: bytes, sent: bytes, now_ns: int) -> bool:
        """See ``Judge``. A target is judged again, with everything that has changed since."""
        path, target = self.path, self._target
        assert path is not None
        if isinstance(path, WritePath):
            start, stop = path.byte_range
            target = path.judged(self._port, frame[1 + start : 1 + stop], self._judged_ns)
            if target is None or frame[: 1 + start] + target.corrected_words + frame[1 + stop :] != sent:
                return False
        return self._leaves(path, frame[1:], target, now_ns) == sent[1:]


def leave_on(
    path: FastPath, transaction: Transaction, target: SteadyTarget | None, now_ns: int
) -> bytes | None:
    """Return what is sent for a transaction on its fast path, as for a stored one; None: it may not be sent.

    What must survive a kill is recorded before.
    """
    if not isinstance(path, WritePath):
        return path.sent(transaction, now_ns)
    assert target is not None, "a write is committed with the target that was judged"
    path.write_ahead(transaction, target)
    start, stop = path.byte_range
    pdu = transaction.pdu
    return pdu[:start] + target.corrected_words + pdu[stop:]
