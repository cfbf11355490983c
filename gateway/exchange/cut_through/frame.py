"""One frame under cut-through forwarding: which bytes of it may be sent, and when.

Sans-IO; time is an argument. Only this file decides when a byte may be sent. The judges (``requests``,
``replies``) decide which bytes replace a position, and ``delay`` computes when the first byte may be sent.

One :class:`ForwardedFrame` is one request or one reply on its way through the gateway. It is in one state of
:class:`ForwardState` and changes state only as :data:`FORWARD_AFTER` says. These are all of the rules:

1. *Begin.* Bytes are handed in as they come. The first byte is sent when two conditions hold. The judge
   recognises a frame that may be forwarded (``opening``), and the forwarding delay is over (``delay``). From
   then on the transmitter does not run empty before the end of the frame.
2. *Head.* Bytes of the head are sent as they come. The complete head must be the expected one (``fits``).
3. *Data.* A position is sent only when it is complete and judged (``rendered``), exactly as it was rendered.
   Bytes behind it wait too.
   *First byte.* Some positions may send their first byte early (``ByteThreshold.is_early``), when all bytes
   but the last one have come. Two conditions hold then: it equals the first byte of the filler, and the
   position gets this first byte whatever its last byte is (``begins_with``). Otherwise the byte waits. If a
   change in between gives the complete position another first byte, the frame is aborted.
4. *CRC.* Both bytes of the CRC are sent together. The received CRC must be good, and the judge must agree to
   exactly the bytes that were sent (``commits``), whatever has happened since it judged them. W3: no other
   frame ever ends with a good CRC.
5. *Abort.* In every other case a frame that has begun to be sent is completed immediately, in one piece, with
   both bytes of its CRC inverted (but see 6). It is never truncated: a drive that counts bytes would take the
   next frame for the rest of it. Its length is the expected one. The judge supplies the filler. So a drive
   that ignores the CRC receives what it already holds; such a drive must not be used with cut-through at all.
6. *Seams.* Between two pieces the process may be killed, or an adapter unplugged. So no piece ends where the
   bytes so far are a valid frame, or would be one together with the next frame (``crc``). The last byte of
   such a piece waits for the byte behind it. A head that would have to wait is not forwarded
   (:func:`is_fit_head`). Filler and inverted CRC avoid such ends too, also when they are received alone.
7. *Stall.* A frame that has begun to be sent is aborted when no byte comes for longer than ``stall_ns``, or
   when the transmitter is about to run empty.

This file does not know what an aborted frame was meant to be. If all of it came and its CRC was good, it is
still a request. Its owner then handles it like a stored one, after the silence that follows an aborted frame.
The drive received nothing that it could take for a frame.

A pair of state and event without a row in the table is a bug. Tests raise it (``axis.impossible``). In
production it is reported, and the frame goes the safest way (:data:`SAFEST`): what was sent becomes no frame.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from gateway.compiled import mypyc_attr
from gateway.exchange.axis.impossible import IGNORED, sentence_of
from gateway.exchange.cut_through.delay import CRC_BYTES, Delays, FrameShape, Piece
from gateway.modbus.crc import INTACT, SEAM, ends_a_frame, inverted_crc, residue_after
from gateway.modbus.lengths import MIN_ADU
from gateway.modbus.rtu_arrival import Progress, RequestArrival


class ForwardState(Enum):
    """How far a frame has come through the gateway."""

    __hash__ = object.__hash__

    BEGUN = "begun"
    """Bytes of it have come in. None was sent."""
    HEAD = "head"
    """Bytes of its head were sent. It is not known yet whether the head is the expected one."""
    LEAVING = "leaving"
    """Its head is the expected one. Its bytes are sent as the rules allow."""
    STORED = "stored"
    """Nothing of it was or will be sent from here: it takes the usual path."""
    WHOLE = "whole"
    """It was sent with its own CRC."""
    ABORTED = "spoilt"
    """It was filled up and sent with an inverted CRC, so it is no valid frame."""
    BROKEN = "broken"
    """The link to its receiver was lost. It ends where the link ended."""


class ForwardEvent(Enum):
    """What happens to a frame on its way through the gateway."""

    __hash__ = object.__hash__

    OPENED = "opened"
    """Its forwarding delay is over."""
    FITTED = "fitted"
    """Its head is complete and is the expected one."""
    JUDGED = "judged"
    """A position in it is complete and may be sent as it was rendered."""
    COMMITTED = "committed"
    """All of it came, its CRC was good, and the judge agreed to the bytes that were sent."""
    KEPT = "kept"
    """It may not be forwarded, or it was complete before its delay was over."""
    UNFIT = "unfit"
    """Its head is not the expected one."""
    REFUSED = "refused"
    """A position in it may not be sent, or the slow path must decide."""
    CHANGED = "changed"
    """What was sent is no longer what would be sent now."""
    BAD = "bad"
    """Its CRC was bad."""
    STALLED = "stalled"
    """No more of it came in time."""
    OVERTAKEN = "overtaken"
    """A stop arrived."""
    ANEW = "anew"
    """Its sender began another frame."""
    MET = "met"
    """Bytes came in on the wire on which it is sent: on a two-wire bus they collided."""
    GONE = "gone"
    """The port on which it comes in was lost."""
    LOST = "lost"
    """The wire on which it is sent was lost."""


def _from_outside(
    after: ForwardState | None, lost: ForwardState | None
) -> dict[ForwardEvent, ForwardState | None]:
    """Return the rows of events that its owner, or time, causes. They can occur in each state."""
    return {
        ForwardEvent.STALLED: after,
        ForwardEvent.OVERTAKEN: after,
        ForwardEvent.ANEW: after,
        ForwardEvent.MET: after,
        ForwardEvent.GONE: after,
        ForwardEvent.LOST: lost,
    }


FORWARD_AFTER: Final[Mapping[ForwardState, Mapping[ForwardEvent, ForwardState | None]]] = {
    ForwardState.BEGUN: {
        ForwardEvent.OPENED: ForwardState.HEAD,
        ForwardEvent.KEPT: ForwardState.STORED,
        **_from_outside(ForwardState.STORED, lost=ForwardState.STORED),
    },
    ForwardState.HEAD: {
        ForwardEvent.FITTED: ForwardState.LEAVING,
        ForwardEvent.UNFIT: ForwardState.ABORTED,
        **_from_outside(ForwardState.ABORTED, lost=ForwardState.BROKEN),
    },
    ForwardState.LEAVING: {
        ForwardEvent.JUDGED: ForwardState.LEAVING,
        ForwardEvent.COMMITTED: ForwardState.WHOLE,
        ForwardEvent.REFUSED: ForwardState.ABORTED,
        ForwardEvent.CHANGED: ForwardState.ABORTED,
        ForwardEvent.BAD: ForwardState.ABORTED,
        **_from_outside(ForwardState.ABORTED, lost=ForwardState.BROKEN),
    },
    ForwardState.STORED: _from_outside(IGNORED, lost=IGNORED),
    ForwardState.WHOLE: _from_outside(IGNORED, lost=IGNORED),
    ForwardState.ABORTED: _from_outside(IGNORED, lost=IGNORED),
    ForwardState.BROKEN: _from_outside(IGNORED, lost=IGNORED),
}
"""The state that follows each event. :data:`IGNORED` changes nothing; a missing pair is impossible. Only one
row leads to WHOLE."""
SAFEST: Final[Mapping[ForwardState, ForwardState | None]] = {
    ForwardState.BEGUN: ForwardState.STORED,
    ForwardState.HEAD: ForwardState.ABORTED,
    ForwardState.LEAVING: ForwardState.ABORTED,
    ForwardState.STORED: IGNORED,
    ForwardState.WHOLE: IGNORED,
    ForwardState.ABORTED: IGNORED,
    ForwardState.BROKEN: IGNORED,
}
"""Where an impossible pair leads: what was sent becomes no frame, and the request takes the usual path."""
OVER: Final = frozenset({ForwardState.STORED, ForwardState.WHOLE, ForwardState.ABORTED, ForwardState.BROKEN})
"""States in which nothing more of a frame is sent from here."""


class ForwardingPace(NamedTuple):
    """How fast frames are sent, and what is too slow."""

    out_ns: int
    """Time of one character on the outgoing wire."""
    stall_ns: int
    """A frame of which no byte comes for so long has stalled: 1.5 characters plus the gaps between its
    pieces."""
    guard_ns: int
    """A frame is filled up this long before the transmitter runs empty; less than the margin of its delay."""


@dataclass(frozen=True, slots=True)
class Opening:
    """What a frame that may be forwarded is expected to be."""

    shape: FrameShape
    delay_ns: int
    """Since its first piece came in; see ``MeasuredDelay``."""
    filler: bytes
    """The last acknowledged frame like it, as it was sent, without its CRC."""


NOT_EXPECTED: Final = Opening(FrameShape(0, ()), 0, b"")
"""The opening of a frame that is not recognised yet."""


def opening_of(shape: FrameShape, delays: Delays, filler: bytes, *, is_early: bool) -> Opening | None:
    """Return how a frame of this shape begins to be sent; None: it is stored.

    ``is_early``: its first bytes are likely to stay the same. Otherwise its late shape is used, if it has
    one.
    """
    for each in (shape if is_early else None, shape.late or shape):
        delay_ns = None if each is None else delays.of(each)
        if each is not None and delay_ns is not None:
            return Opening(each, delay_ns, filler)
    return None


@mypyc_attr(allow_interpreted_subclasses=True)
class Judge:
    """What a frame on its way through asks the exchange. Only ``commits`` changes anything."""

    def opening(self, begun: bytes, now_ns: int) -> Opening | None:
        """Return what a frame with this beginning is expected to be; None: it may not be sent yet.

        It is called again for each piece that comes and at the end of the delay, until the first byte of the
        frame is sent or the frame is complete.
        """
        raise NotImplementedError

    def fits(self, opening: Opening, begun: bytes) -> bool:
        """Return whether a frame with a complete head is the expected one."""
        raise NotImplementedError

    def rendered(self, begun: bytes, first: int, end: int, now_ns: int) -> bytes | None:
        """Return what is sent instead of the bytes ``first`` to ``end``, all of which have come.

        The result has as many bytes. None: they may not be sent, or the slow path must decide.
        """
        raise NotImplementedError

    def begins_with(self, byte: int, begun: bytes, first: int, now_ns: int) -> bool:
        """Whether a position is rendered with this first byte, whatever its last byte is.

        All of its bytes but the last have come. It begins at byte ``first``; ``begun`` ends with its bytes.
        """
        raise NotImplementedError

    def commits(self, frame: bytes, sent: bytes, now_ns: int) -> bool:
        """Decide whether a good frame, sent as ``sent``, gets its CRC; if so, record it.

        What must survive a kill is recorded before this returns. Neither argument has a CRC.
        """
        raise NotImplementedError


def is_fit_head(head: bytes) -> bool:
    """Whether a frame may pause behind any byte of its head: true for all but seven of 65 536 addresses.

    >>> is_fit_head(bytes.fromhex("01 10 6F 00 00 02 04"))
    True
    >>> is_fit_head(bytes.fromhex("01 10 01 EC 00 02 04"))  # its fourth byte ends a frame
    False
    """
    residue = SEAM
    for index in range(len(head)):
        residue = residue_after(head[index : index + 1], residue)
        if residue == SEAM or (residue == INTACT and index + 1 >= MIN_ADU):
            return False
    return True


def closed(left: bytes, filler: bytes) -> bytes:
    """Return ``filler`` as it continues what was sent, with a CRC that makes the frame invalid.

    A byte of the filler or of the CRC is changed where the frame could end behind it. It is also changed
    where the returned bytes alone, after a silence on the wire, could be a frame.

    >>> closed(bytes.fromhex("01 10 6F 00"), bytes.fromhex("00 02 04 00 00 00 00")).hex(" ")
    '00 02 04 00 00 00 00 e5 a2'
    """
    residue, alone = residue_after(left), SEAM
    filled = bytearray()
    for wanted in filler:
        byte, residue, alone = _byte_inside(wanted, residue, alone)
        filled.append(byte)
    for wanted in inverted_crc(residue):
        byte, residue, alone = _byte_inside(wanted, residue, alone)
        filled.append(byte)
    return bytes(filled)


def _byte_inside(wanted: int, residue: int, alone: int) -> tuple[int, int, int]:
    """Return the byte nearest to the wanted one behind which no frame can end, and both residues after it.

    Each residue excludes at most two of the 256 bytes, so there always is one.
    """
    for change in range(0x100):
        byte = bytes((wanted ^ change,))
        after, after_alone = residue_after(byte, residue), residue_after(byte, alone)
        if not ends_a_frame(after) and not ends_a_frame(after_alone):
            return byte[0], after, after_alone
    raise AssertionError("unreachable: at most four of 256 bytes end a frame")


class ForwardedFrame:
    """One frame on its way through the gateway; see the module.

    Args:
        arrival: parses its bytes as they come.
        judge: decides what may be sent.
        pace: how fast it is sent, and what is too slow.
        on_event: called with each event.
        on_fault: called with a sentence for an impossible pair, which is a bug.
    """

    __slots__ = (
        "_judged",
        "_last_came_ns",
        "_left_ns",
        "_off_ns",
        "_on_event",
        "_on_fault",
        "_opening",
        "_out",
        "_pace",
        "_rendered",
        "_sure",
        "arrival",
        "began_ns",
        "empty_ns",
        "gap_ns",
        "judge",
        "left",
        "pieces",
        "state",
        "written_need_ns",
    )

    def __init__(
        self,
        arrival: RequestArrival,
        judge: Judge,
        pace: ForwardingPace,
        on_event: Callable[[ForwardEvent], None] = lambda _event: None,
        on_fault: Callable[[str], None] = lambda _sentence: None,
    ) -> None:
        self.arrival = arrival
        self.state = ForwardState.BEGUN
        self.left = b""
        """What was sent."""
        self.began_ns = 0
        """When its first byte was sent; 0: none was."""
        self.empty_ns = 0
        """When the transmitter has sent everything so far."""
        self.gap_ns = 0
        """The longest time for which the transmitter was empty inside the frame, by its speed and by the
        times of writing. Above 0 where it may have been empty (:meth:`written`)."""
        self.written_need_ns = 0
        """How long after its first piece the frame should have begun, so that the transmitter never ran
        empty; computed from the times at which the rest was written. 0: it was sent in one piece, or not from
        here."""
        self.pieces: list[Piece] = []
        """When its bytes came in."""
        self.judge = judge
        self._pace = pace
        self._on_event = on_event
        self._on_fault = on_fault
        self._opening = NOT_EXPECTED
        self._out = b""
        """What may be sent instead of what came, as far as it is known."""
        self._rendered = 0
        """Number of positions that were judged."""
        self._sure = b""
        """The first byte of the next position, if it is sent before that is complete."""
        self._judged = 0
        """Number of judged positions that were reported."""
        self._last_came_ns = 0
        self._left_ns = 0
        """When the input that released the newest sent bytes was read."""
        self._off_ns = 0
        """When, at the earliest, the last written byte has been transmitted."""

    @property
    def is_on_the_way(self) -> bool:
        """Whether bytes of it were sent and others must follow."""
        return self.state is ForwardState.HEAD or self.state is ForwardState.LEAVING

    @property
    def is_over(self) -> bool:
        """Whether nothing more is sent from here."""
        return self.state in OVER

    @property
    def expected(self) -> bytes:
        """The expected frame, without its CRC; only for a frame that is being sent."""
        return self._opening.filler

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`tick` must be called; None: not before another event."""
        if self.is_on_the_way:
            return min(self._last_came_ns + self._pace.stall_ns, self.empty_ns - self._pace.guard_ns)
        return (
            self._opens_ns if self.state is ForwardState.BEGUN and self._opening is not NOT_EXPECTED else None
        )

    @property
    def _opens_ns(self) -> int:
        return self.pieces[0].came_ns + self._opening.delay_ns

    def feed(self, data: bytes, now_ns: int) -> bytes:
        """Take received bytes, of this frame and behind it; return those to send now."""
        if self._is_stalled(now_ns):
            self.go_on(ForwardEvent.STALLED, now_ns)
        due = self.tick(now_ns)
        has_more = self._take(data, now_ns) < len(data)
        if self.is_over:
            return due
        if has_more and self.is_on_the_way:
            return due + self.go_on(ForwardEvent.ANEW, now_ns)
        return due + self._leave(now_ns)

    def tick(self, now_ns: int) -> bytes:
        """Do what is due; return the bytes to send now."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return b""
        if self.is_on_the_way:
            return self.go_on(ForwardEvent.STALLED, now_ns)
        return self._leave(now_ns)

    def go_on(self, event: ForwardEvent, now_ns: int) -> bytes:
        """Take a step of :data:`FORWARD_AFTER`; return the filling if the step aborts the frame."""
        row = FORWARD_AFTER[self.state]
        if event in row:
            after = row[event]
        else:
            self._on_fault(sentence_of("cut-through", self.state, event))
            after = SAFEST[self.state]
        if after is IGNORED:
            return b""
        self.state = after
        self._on_event(event)
        if after is not ForwardState.ABORTED:
            return b""
        body = self._opening.shape.length - CRC_BYTES
        return self._write(closed(self.left, self._opening.filler[len(self.left) : body]), now_ns)

    def written(self, size: int, from_ns: int, until_ns: int) -> None:
        """Record when the last ``size`` bytes were written, all of them together.

        Used only for statistics (:attr:`gap_ns`) and for learning (:attr:`written_need_ns`).

        They were written between ``from_ns`` and ``until_ns``: between reading and writing the process may
        have been suspended, with the transmitter empty. Deadlines are computed from the time of reading.
        """
        before = len(self.left) - size
        if before:
            self.gap_ns = max(self.gap_ns, until_ns - self._off_ns)
            # The real beginning does not matter: the first bytes take the same time on the wire.
            since_ns = until_ns - self.pieces[0].came_ns
            self.written_need_ns = max(self.written_need_ns, since_ns - before * self._pace.out_ns)
        self._off_ns = max(self._off_ns, self._left_ns, from_ns) + size * self._pace.out_ns

    # --- steps -----------------------------------------------------------------------------------------

    def _is_stalled(self, now_ns: int) -> bool:
        """Whether it stalled before a byte of it was sent; its delay counts from its first byte."""
        has_begun = self.state is ForwardState.BEGUN and bool(self.pieces)
        return has_begun and now_ns - self._last_came_ns > self._pace.stall_ns

    def _take(self, data: bytes, now_ns: int) -> int:
        taken = self.arrival.feed(data)
        if taken:
            self.pieces.append(Piece(now_ns, len(self.arrival.data)))
            self._last_came_ns = now_ns
        return taken

    def _leave(self, now_ns: int) -> bytes:
        """Advance as far as its bytes allow; return those to send."""
        if self.state is ForwardState.BEGUN and not self._opens(now_ns):
            return b""
        progress = self.arrival.progress
        if self.state is ForwardState.HEAD and progress is not Progress.BEGUN:
            filling = self.go_on(ForwardEvent.FITTED if self._is_expected() else ForwardEvent.UNFIT, now_ns)
            if self.is_over:
                return filling
        if self.state is ForwardState.LEAVING:
            why_not = self._judge_positions(now_ns)
            if why_not is not None:
                return self.go_on(why_not, now_ns)
            while self._judged < self._rendered:
                self._judged += 1
                filling = self.go_on(ForwardEvent.JUDGED, now_ns)
                if self.is_over:
                    return filling
            if progress is Progress.BAD:
                return self.go_on(ForwardEvent.BAD, now_ns)
            if progress is Progress.GOOD:
                return self._commit(now_ns)
        return self._write(self._piece(), now_ns)

    def _opens(self, now_ns: int) -> bool:
        """Return whether its first bytes may be sent now."""
        if self.arrival.is_over:
            self.go_on(ForwardEvent.KEPT, now_ns)
            return False
        if self._is_stalled(now_ns):
            self.go_on(ForwardEvent.STALLED, now_ns)  # it would be aborted as soon as it had begun
            return False
        # The judge is asked each time: the expected frame may have changed during the delay.
        self._opening = self.judge.opening(self.arrival.data, now_ns) or NOT_EXPECTED
        if self._opening is NOT_EXPECTED or now_ns < self._opens_ns or not self._piece():
            return False
        # A frame that is unexpected or refused already is stored, not aborted: nothing of it was sent.
        is_head_known = self.arrival.progress is not Progress.BEGUN
        if is_head_known and not (self._is_expected() and self._judge_positions(now_ns) is None):
            self.go_on(ForwardEvent.KEPT, now_ns)
            return False
        self.go_on(ForwardEvent.OPENED, now_ns)
        return self.state is ForwardState.HEAD

    def _is_expected(self) -> bool:
        arrival, opening = self.arrival, self._opening
        return arrival.length == opening.shape.length and self.judge.fits(opening, arrival.data)

    def _judge_positions(self, now_ns: int) -> ForwardEvent | None:
        """Have the received positions judged; return why one may not be sent, None: all may."""
        come = self.arrival.data
        judged = [threshold for threshold in self._opening.shape.thresholds if threshold.is_judged]
        for threshold in judged[self._rendered :]:
            if len(come) < threshold.needs:
                if threshold.is_early and len(come) == threshold.needs - 1:
                    byte = self._opening.filler[threshold.first : threshold.first + 1]
                    if self.judge.begins_with(byte[0], come, threshold.first, now_ns):
                        self._sure = byte
                break
            words = self.judge.rendered(come[: threshold.needs], threshold.first, threshold.needs, now_ns)
            if words is None:
                return ForwardEvent.REFUSED
            if not words.startswith(self._sure):
                return ForwardEvent.CHANGED
            self._out += come[len(self._out) : threshold.first] + words
            self._rendered += 1
            self._sure = b""
        return None

    def _piece(self) -> bytes:
        """Return what may be sent now of a frame that has not come completely."""
        come, shape = self.arrival.data, self._opening.shape
        may = shape.leaves(len(come))
        out = self._out + come[len(self._out) : may]
        for threshold in shape.thresholds:
            if threshold.is_early and len(come) == threshold.needs - 1:
                out = out[: threshold.first] + self._sure
                may = len(out)
        residues = [residue_after(self.left)]
        for index in range(len(self.left), may):
            residues.append(residue_after(out[index : index + 1], residues[-1]))
        while may > len(self.left) and ends_a_frame(residues[may - len(self.left)]):
            may -= 1
        return out[len(self.left) : may]

    def _commit(self, now_ns: int) -> bytes:
        body = self.arrival.length - CRC_BYTES
        came = self.arrival.data[:body]
        out = self._out + came[len(self._out) :]
        if not self.judge.commits(came, out, now_ns):
            return self.go_on(ForwardEvent.CHANGED, now_ns)
        filling = self.go_on(ForwardEvent.COMMITTED, now_ns)
        if self.state is not ForwardState.WHOLE:
            return filling
        whole = out + residue_after(out).to_bytes(CRC_BYTES, "little")
        return self._write(whole[len(self.left) :], now_ns)

    def _write(self, data: bytes, now_ns: int) -> bytes:
        if data:
            if not self.left:
                self.began_ns = now_ns
            self.empty_ns = max(self.empty_ns, now_ns) + len(data) * self._pace.out_ns
            self.left += data
            self._left_ns = now_ns
        return data
