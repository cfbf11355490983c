"""Cut-through: what of a frame may leave when, while it still arrives. Sans-IO; time is an argument.

One :class:`ForwardedFrame` is one frame on its way through the gateway, a request or a reply. It is in one
state of :class:`ForwardState`, and goes from one to the next only as :data:`FORWARD_AFTER` says. The rules,
all of them:

1. *Begin.* Bytes are handed in as they come. None leaves before the judge knows by them that the frame is one
   that may be cut through (``opening``), and not before the delay is over: from then on the transmitter is
   never empty before the frame has ended (``delay``).
2. *Head.* Bytes of the head leave as they come. When it is whole it has to be what was expected (``fits``).
3. *Data.* No byte of a position, and none behind it, leaves before the position is whole and judged
   (``rendered``); all of it leaves as it was rendered.
   *First byte.* Where a gate says so (``Gate.is_early``), the first byte of a position leaves as soon as all
   but the last one have come: if it is that of the filler, and the position is rendered with it whatever the
   last byte is (``begins_with``). Else it waits. Where the whole position is rendered with another one then,
   for something has happened since, the frame is spoilt.
4. *Check sum.* Both of its bytes leave together, after the incoming one was good and the judge has agreed to
   exactly the bytes that left (``commits``), whatever has happened since it judged them. W3: no other frame
   ever ends with a good check sum.
5. *Spoil.* Whatever else happens to a frame of which bytes have left, it is filled up to its length at once,
   in one piece, and closed with both bytes of its check sum inverted. It is never cut short: a drive that
   counts bytes would take the next frame for the rest of it. It is as long as what was expected. What it is
   filled with is what the judge gave for it: a drive that looks at no check sum, which has no place behind
   cut-through, is then told what it holds.
6. *Seams.* Nobody can keep a process from being killed, or an adapter from being pulled, between two pieces.
   So none ends where the bytes so far are a frame by themselves or would be one with the next (``crc``): its
   last byte waits for the one behind it. Heads that would have to wait so are not cut through
   (:func:`is_fit_head`). What a frame is filled with avoids it too, also for the piece taken alone.
7. *Stall.* A frame of which bytes have left and of which no more come is spoilt as soon as a character's
   pause is longer than ``stall_ns``, or the transmitter is about to be empty.

What a spoilt frame was meant to be is not known here. Where all of it came, and its check sum was good, it is
still a request: whoever owns this lets it take the way of one that was stored, after the silence that a
spoilt frame wants. The drive has had nothing of it that it could take for a frame.

A pair of state and event without a row in the table cannot be. Tests raise it (``axis.impossible``). At a
machine it is told, and goes the safest way (:data:`SAFEST`): what has left becomes no frame.
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
    """How far a frame has come on its way through."""

    __hash__ = object.__hash__

    BEGUN = "begun"
    """Bytes of it have come, and none has left."""
    HEAD = "head"
    """Bytes of its head have left. It is not known yet whether it is what was expected."""
    LEAVING = "leaving"
    """Its head is what was expected, and its bytes leave as they may."""
    STORED = "stored"
    """Nothing of it has left, and nothing will from here: it takes the usual way."""
    WHOLE = "whole"
    """It left with its own check sum."""
    ABORTED = "spoilt"
    """It was filled up and closed so that it is no frame."""
    BROKEN = "broken"
    """The wire on which it left was lost: it ends where that ended."""


class ForwardEvent(Enum):
    """What happens to a frame on its way through."""

    __hash__ = object.__hash__

    OPENED = "opened"
    """Its delay is over."""
    FITTED = "fitted"
    """Its head is whole, and is what was expected."""
    JUDGED = "judged"
    """A position in it is whole, and may leave as it was rendered."""
    COMMITTED = "committed"
    """All of it came, its check sum was good, and the judge agreed to what has left."""
    KEPT = "kept"
    """It is not one that is cut through, or it was whole before its delay was over."""
    UNFIT = "unfit"
    """Its head is another one than was expected."""
    REFUSED = "refused"
    """A position in it may not leave, or has to be looked at on the slow path."""
    CHANGED = "changed"
    """What has left is not what would be sent by now."""
    BAD = "bad"
    """Its check sum was bad."""
    STALLED = "stalled"
    """No more of it came in time."""
    OVERTAKEN = "overtaken"
    """A stop came."""
    ANEW = "anew"
    """Whoever sends it began another one."""
    MET = "met"
    """Bytes came on the wire on which it leaves: on a bus of two wires they have met."""
    GONE = "gone"
    """The port on which it comes was lost."""
    LOST = "lost"
    """The wire on which it leaves was lost."""


def _from_outside(
    after: ForwardState | None, lost: ForwardState | None
) -> dict[ForwardEvent, ForwardState | None]:
    """Return the rows of what its owner, or time, ends a frame with. It can come in each state."""
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
        ForwardEvent.UNFIT: ForwardState.ABORTED,  # its length turns out to be another one
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
"""Where each event leads. What is not there cannot be; :data:`IGNORED` changes nothing. Only one row leads to
WHOLE."""
SAFEST: Final[Mapping[ForwardState, ForwardState | None]] = {
    ForwardState.BEGUN: ForwardState.STORED,
    ForwardState.HEAD: ForwardState.ABORTED,
    ForwardState.LEAVING: ForwardState.ABORTED,
    ForwardState.STORED: IGNORED,
    ForwardState.WHOLE: IGNORED,
    ForwardState.ABORTED: IGNORED,
    ForwardState.BROKEN: IGNORED,
}
"""Where what cannot be leads: what has left becomes no frame, and the request takes the usual way."""
OVER: Final = frozenset({ForwardState.STORED, ForwardState.WHOLE, ForwardState.ABORTED, ForwardState.BROKEN})
"""States in which nothing more of a frame leaves from here."""


class ForwardingPace(NamedTuple):
    """How fast frames leave, and what is too slow."""

    out_ns: int
    """What a character takes on the wire on which they leave."""
    stall_ns: int
    """After so long without a byte no more of a frame comes: 1.5 characters, and what pieces are apart."""
    guard_ns: int
    """So long before the transmitter is empty a frame is filled up: less than the margin of its delay."""


@dataclass(frozen=True, slots=True)
class Opening:
    """A frame that may be cut through: what it is expected to be."""

    shape: FrameShape
    delay_ns: int
    """After its first piece came; see ``MeasuredDelay``."""
    filler: bytes
    """The last one that was acknowledged, as it left, without its check sum."""


NOT_EXPECTED: Final = Opening(FrameShape(0, ()), 0, b"")
"""What a frame is expected to be of which nobody knows yet."""


def opening_of(shape: FrameShape, delays: Delays, filler: bytes, *, is_early: bool) -> Opening | None:
    """Return how a frame of this shape begins to leave; None: it is stored.

    ``is_early``: its first bytes may be expected to stay what they are; else it is late, if it has to be.
    """
    for each in (shape if is_early else None, shape.late or shape):
        delay_ns = None if each is None else delays.of(each)
        if each is not None and delay_ns is not None:
            return Opening(each, delay_ns, filler)
    return None


@mypyc_attr(allow_interpreted_subclasses=True)
class Judge:
    """What a frame on its way through asks of the exchange. Nothing but ``commits`` changes anything."""

    def opening(self, begun: bytes, now_ns: int) -> Opening | None:
        """Return what a frame is expected to be that begins so; None: it may not leave, as far as is known.

        Asked anew with each piece that comes and when its delay is over, until its first byte leaves or it is
        whole.
        """
        raise NotImplementedError

    def fits(self, opening: Opening, begun: bytes) -> bool:
        """Return whether a frame whose head is whole is what was expected."""
        raise NotImplementedError

    def rendered(self, begun: bytes, first: int, end: int, now_ns: int) -> bytes | None:
        """Return what leaves in the place of the bytes ``first`` to ``end``, all of which have come.

        It has as many bytes. None: they may not leave, or nobody knows without looking closer.
        """
        raise NotImplementedError

    def begins_with(self, byte: int, begun: bytes, first: int, now_ns: int) -> bool:
        """Whether a position of which all but the last byte have come is rendered with this first byte.

        Whatever the last byte is. It begins at the byte ``first``, and ``begun`` ends with what came of it.
        """
        raise NotImplementedError

    def commits(self, frame: bytes, sent: bytes, now_ns: int) -> bool:
        """Decide whether a good frame that leaves as ``sent`` gets its check sum; and take note of it.

        What has to be known of it after a kill is written before this returns. Both without check sum.
        """
        raise NotImplementedError


def is_fit_head(head: bytes) -> bool:
    """Whether a frame may stand still behind any byte of its head: all but seven of 65 536 addresses.

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
    """Return ``filler`` as it follows on what has left, with a check sum that makes sure that it is no frame.

    A byte of it is another one where the frame could end behind it, or where what is returned, should it come
    alone because the wire was silent before it, could.

    >>> closed(bytes.fromhex("01 10 6F 00"), bytes.fromhex("00 02 04 00 00 00 00")).hex(" ")
    '00 02 04 00 00 00 00 e5 a2'
    """
    residue, alone = residue_after(left), SEAM
    filled = bytearray()
    for number, filler_byte in enumerate(filler):
        is_last = number == len(filler) - 1
        for change in range(0x100):
            byte = bytes((filler_byte ^ change,))
            after, after_alone = residue_after(byte, residue), residue_after(byte, alone)
            if ends_a_frame(after) or ends_a_frame(after_alone):
                continue
            if not is_last or not ends_a_frame(residue_after(inverted_crc(after), after_alone)):
                filled += byte
                residue, alone = after, after_alone
                break
    return bytes(filled) + inverted_crc(residue)


class ForwardedFrame:
    """One frame on its way through; see the head of this file.

    Args:
        arrival: follows its bytes.
        judge: decides what may leave.
        pace: how fast it leaves, and what is too slow.
        on_event: hears of each step, and why.
        on_fault: hears a sentence of what cannot be, which is a bug.
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
        """What has left."""
        self.began_ns = 0
        """When its first byte left; 0: none has."""
        self.empty_ns = 0
        """When the transmitter has sent all that has left."""
        self.gap_ns = 0
        """The longest time for which it was empty inside of the frame, by its speed and by when the pieces
        were written: longer than 0 where it may have been (:meth:`written`)."""
        self.written_need_ns = 0
        """How long after its first piece it would have had to begin to leave, by when what followed was
        written, so that the transmitter is never empty. 0: it left in one, or not from here."""
        self.pieces: list[Piece] = []
        """How it came."""
        self.judge = judge
        self._pace = pace
        self._on_event = on_event
        self._on_fault = on_fault
        self._opening = NOT_EXPECTED
        self._out = b""
        """What may leave in the place of what came, as far as that is known."""
        self._rendered = 0
        """Positions that were judged."""
        self._sure = b""
        """The first byte of the next one, if it leaves before that is whole."""
        self._judged = 0
        """Those of them that were told of."""
        self._last_came_ns = 0
        self._left_ns = 0
        """When the bytes that left last had been read that let them leave."""
        self._off_ns = 0
        """When all that was written is off the wire, at the earliest."""

    @property
    def is_on_the_way(self) -> bool:
        """Whether bytes of it have left, and others have to follow."""
        return self.state is ForwardState.HEAD or self.state is ForwardState.LEAVING

    @property
    def is_over(self) -> bool:
        """Whether nothing more leaves from here."""
        return self.state in OVER

    @property
    def expected(self) -> bytes:
        """What it was expected to be, without its check sum; of one that is on its way."""
        return self._opening.filler

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`tick` wants to be called; None: not before something else happens."""
        if self.is_on_the_way:
            return min(self._last_came_ns + self._pace.stall_ns, self.empty_ns - self._pace.guard_ns)
        return (
            self._opens_ns if self.state is ForwardState.BEGUN and self._opening is not NOT_EXPECTED else None
        )

    @property
    def _opens_ns(self) -> int:
        return self.pieces[0].came_ns + self._opening.delay_ns

    def feed(self, data: bytes, now_ns: int) -> bytes:
        """Take bytes that came, of this frame and behind it; return those that leave now."""
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
        """Do what has fallen due; return the bytes that leave now."""
        deadline_ns = self.deadline_ns
        if deadline_ns is None or now_ns < deadline_ns:
            return b""
        if self.is_on_the_way:
            return self.go_on(ForwardEvent.STALLED, now_ns)
        return self._leave(now_ns)

    def go_on(self, event: ForwardEvent, now_ns: int) -> bytes:
        """Take a step of :data:`FORWARD_AFTER`; return what fills it up, where that spoils it."""
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
        """Take note of when the last ``size`` bytes were written, all at once.

        For what is counted (:attr:`gap_ns`) and learned (:attr:`written_need_ns`) alone.

        Not before ``from_ns``, and not after ``until_ns``: between reading and writing the process may have
        stood still, with the transmitter empty. What has to be in time is reckoned from the reading.
        """
        before = len(self.left) - size
        if before:
            self.gap_ns = max(self.gap_ns, until_ns - self._off_ns)
            # When it really began does not matter: what comes first takes so long on the wire.
            since_ns = until_ns - self.pieces[0].came_ns
            self.written_need_ns = max(self.written_need_ns, since_ns - before * self._pace.out_ns)
        self._off_ns = max(self._off_ns, self._left_ns, from_ns) + size * self._pace.out_ns

    # --- steps -----------------------------------------------------------------------------------------

    def _is_stalled(self, now_ns: int) -> bool:
        """Whether nothing of it has left and its bytes come too late: its delay counts from the first one."""
        has_begun = self.state is ForwardState.BEGUN and bool(self.pieces)
        return has_begun and now_ns - self._last_came_ns > self._pace.stall_ns

    def _take(self, data: bytes, now_ns: int) -> int:
        taken = self.arrival.feed(data)
        if taken:
            self.pieces.append(Piece(now_ns, len(self.arrival.data)))
            self._last_came_ns = now_ns
        return taken

    def _leave(self, now_ns: int) -> bytes:
        """Go as far as its bytes allow; return those that leave."""
        if self.state is ForwardState.BEGUN and not self._opens(now_ns):
            return b""
        progress = self.arrival.progress
        if self.state is ForwardState.HEAD and progress is not Progress.BEGUN:
            filling = self.go_on(ForwardEvent.FITTED if self._is_expected() else ForwardEvent.UNFIT, now_ns)
            if self.is_over:
                return filling
        if self.state is ForwardState.LEAVING:
            if progress is Progress.ODD:
                return self.go_on(ForwardEvent.UNFIT, now_ns)
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
        """See whether its bytes say by now that it may be cut through; return whether it begins to leave."""
        if self.arrival.is_over:
            self.go_on(ForwardEvent.KEPT, now_ns)
            return False
        if self._is_stalled(now_ns):
            self.go_on(ForwardEvent.STALLED, now_ns)  # it would have to be spoilt as soon as it had begun
            return False
        # Each time anew: what it was expected to be before its delay was over may be another thing now.
        self._opening = self.judge.opening(self.arrival.data, now_ns) or NOT_EXPECTED
        if self._opening is NOT_EXPECTED or now_ns < self._opens_ns or not self._piece():
            return False
        # What is known by now to be another one, or to be refused, need not be spoilt: nothing has left.
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
        """Have the positions judged that have come; return why one may not leave, None: all of them may."""
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
        """Return what may leave now of a frame of which not all has come."""
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
