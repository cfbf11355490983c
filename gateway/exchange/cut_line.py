"""Cut-through on one line: requests and replies followed as they arrive, and sent on where they may be.

Made for lines whose configuration asks for it; every other line has none of this. Each serial port of a
controller has a :class:`RequestCutter`, the drives' wire has one :class:`ReplyCutter`. Both follow all frames
beside the decoder, from its first byte after a silence: what is not cut through teaches how the port hands
bytes over, and takes the usual way. What leaves does so as whole frames do, and the line is told
(:class:`LeadingLine`).
"""

from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from gateway.exchange.axis.acknowledge import SteadyTarget
from gateway.exchange.cut_replies import Replies, ReplyJudge, reply_shape_of
from gateway.exchange.cut_requests import WRITE, Heads, RequestJudge, beginning_of, leave_on, shape_of
from gateway.exchange.cut_through import CUT_AFTER, Cut, CutThrough, Pace, Turn
from gateway.exchange.dispatch import Units
from gateway.exchange.fast_path import ReadPath, WritePath
from gateway.exchange.leads import CRC_BYTES, REMEMBERED, MeasuredLead, Piece, guard_ns, margin_ns
from gateway.exchange.link_state import LinkState
from gateway.exchange.plan import LineTiming
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.queue import WaitingQueue
from gateway.exchange.rest import Rest
from gateway.exchange.silent_units import SilentUnits
from gateway.exchange.tap import Tap
from gateway.exchange.transaction import FastPath, Phase, Step, Transaction, Transactions
from gateway.exchange.turns import Turns
from gateway.modbus.rtu_arrival import Known, ReplyArrival, RequestArrival
from gateway.modbus.rtu_line import pause_ns
from gateway.times import NS_PER_MS

SPOILT_SILENCES: Final = 3
"""So many silences follow a spoilt frame: whoever cannot tell its length has to see where it ended."""
WASTED: Final = frozenset({Turn.UNFIT, Turn.REFUSED, Turn.CHANGED, Turn.STALLED, Turn.ANEW, Turn.MET})
"""Why a frame was spoilt that stored would have left whole."""


class Wire(NamedTuple):
    """A serial wire: how fast its characters come, and how long it is silent between frames."""

    char_ns: int
    silence_ns: int
    """3.5 characters, or what stands for them."""

    @property
    def pause_ns(self) -> int:
        """The longest pause between two characters of a frame: 1.5 of them, or what stands for them."""
        return pause_ns(self.silence_ns)


class Pauses:
    """How far apart the pieces of frames come, by the last ones that came whole."""

    __slots__ = ("_longest", "longest_ns")

    def __init__(self, char_ns: int) -> None:
        self._longest: deque[int] = deque((char_ns,), maxlen=REMEMBERED)
        self.longest_ns = char_ns

    def note(self, pieces: Sequence[Piece]) -> None:
        """Learn from a frame that came whole."""
        longest_ns = 0
        for before, piece in pairwise(pieces):
            longest_ns = max(longest_ns, piece.came_ns - before.came_ns)
        self._longest.append(longest_ns)
        self.longest_ns = max(self._longest)


class LeadingLine:
    """What a line does for a request that leaves while it arrives.

    Args:
        timing: of the line.
        link: the way to the drives.
        waiting: what waits for the line.
        transactions: of the line.
        turns: who goes next.
        silent_units: who does not answer.
        link_state: whether the drives can be reached.
        rest: the pauses of the line.
        go_on: has the line start what waits.
        tap: listens.
    """

    def __init__(
        self,
        timing: LineTiming,
        link: DriveLink,
        waiting: WaitingQueue,
        *,
        transactions: Transactions,
        turns: Turns,
        silent_units: SilentUnits,
        link_state: LinkState,
        rest: Rest,
        go_on: Callable[[int], None],
        tap: Tap | None,
    ) -> None:
        self._response_timeout_ns = int(timing.response_timeout_ms * NS_PER_MS)
        self._link = link
        self._waiting = waiting
        self._transactions = transactions
        self._turns = turns
        self._silent_units = silent_units
        self._link_state = link_state
        self._rest = rest
        self._go_on = go_on
        self._tap = tap

    def may_lead(self, port: ControllerPort, now_ns: int) -> bool:
        """Whether a request of a port may begin to leave now: what would go out at once, if all had come."""
        if self._transactions.current is not None or self._rest.until_ns is not None:
            return False
        if not self._link_state.is_up or self._link_state.is_stopping:
            return False
        if self._silent_units.silences or not self._waiting.only_others:
            return False
        return port.is_motion and port.gate is None and self._link.may_lead(now_ns)

    def lead(self, port: ControllerPort, expected: bytes, now_ns: int) -> Transaction | None:
        """A request begins to leave that is expected to be this one: unit id and PDU.

        Whatever comes meanwhile waits, as for one that has left (W6).
        """
        if self._turns.gaps.is_watching:
            self._turns.note_motion(now_ns)
        transaction = Transaction(port, 0, expected[0], expected[1:], now_ns)
        return transaction if self._transactions.begin(transaction) else None

    def piece(self, transaction: Transaction, piece: bytes, now_ns: int) -> None:
        """Bytes of it leave, with which it is not whole."""
        unit_id = transaction.unit_id
        self._transactions.send(transaction, Step.PIECE, unit_id, b"", now_ns, piece=piece)

    def commit(self, path: FastPath, pdu: bytes, target: SteadyTarget | None, now_ns: int) -> bytes | None:
        """All of it has come in this moment: let its rest leave, on its fast path; see ``RequestJudge``."""
        transaction = self._transactions.current
        assert transaction is not None
        port = transaction.port
        assert port is not None
        self._transactions.come_whole(transaction, port, pdu, now_ns)
        sent_pdu = leave_on(path, transaction, target, now_ns)
        if sent_pdu is not None:
            if self._tap is not None:  # as if it had been stored
                self._tap.request(port, transaction.transaction_id, transaction.unit_id, pdu, now_ns)
            transaction.take(path)
        return sent_pdu

    def leave(self, transaction: Transaction, pdu: bytes, piece: bytes, now_ns: int) -> None:
        """Its last bytes leave; ``pdu``: what has left with them."""
        path, port, unit_id = transaction.path, transaction.port, transaction.unit_id
        assert path is not None
        assert port is not None
        patience_ns = max(self._response_timeout_ns, port.patience_ns)
        self._transactions.send(
            transaction, Step.LAST_PIECE, unit_id, pdu, now_ns, patience_ns=patience_ns, piece=piece
        )
        if transaction.target is not None:
            path.left(transaction)

    def spoilt(self, until_ns: int, now_ns: int) -> None:
        """It was spoilt: nothing is sent before the silence behind it is over.

        If all of it comes it is a request as any other, behind the silence.
        """
        transaction, self._transactions.current = self._transactions.current, None
        assert transaction is not None
        self._transactions.never_left(transaction, now_ns)
        self._rest.spoil(until_ns)
        self._turns.gaps.ended(transaction, now_ns, until_ns)
        self._go_on(now_ns)


class CutLine:
    """Cut-through on one line.

    Args:
        line: what it does for a request that leaves while it arrives.
        link: the way to the drives, asked when what was sent was written.
        units: the register maps of the line.
        wire: of the drives.
        gap_ns: silence that the drives want before each request.
        stored_units: of devices that are no axes: only silence may say where a frame of theirs ends.
        on_change: called when a frame has gone on that was cut through: the deadline of the line may be
            another.
        tell_no_gain: told once for each port and direction that cut-through gains nothing there, and why.
        tap: listens. What is no whole frame yet it does not hear.
    """

    def __init__(
        self,
        line: LeadingLine,
        link: DriveLink,
        units: Units,
        wire: Wire,
        *,
        gap_ns: int,
        stored_units: frozenset[int],
        on_change: Callable[[], None],
        tell_no_gain: Callable[[str], None],
        tap: Tap | None,
    ) -> None:
        self.tap = tap
        self.line = line
        self.link = link
        self.units = units
        self.wire = wire
        self.stored_units = stored_units
        self.silence_ns = max(gap_ns, SPOILT_SILENCES * wire.silence_ns)
        """After a spoilt request."""
        self.requests = dict.fromkeys(Turn, 0)
        """How requests ended, and why: COMMITTED were cut through, KEPT stored."""
        self.replies = dict.fromkeys(Turn, 0)
        self.requests_stored = dict.fromkeys(Turn, 0)
        """Those of them of which nothing had left."""
        self.replies_stored = dict.fromkeys(Turn, 0)
        self.requests_gain_ns = self.replies_gain_ns = 0
        """How much sooner all that were cut through began to leave than they were whole."""
        self.tell_no_gain = tell_no_gain
        self._told: set[tuple[str, str]] = set()
        self.torn = 0
        """Frames inside of which the transmitter was empty."""
        self.on_change = on_change
        self.reply = ReplyCutter(self)
        self._cutters: dict[ControllerPort, RequestCutter] = {}

    def follow(self, port: ControllerPort, wire: Wire) -> "RequestCutter":
        """Follow the requests of a port that was opened, on its wire."""
        cutter = self._cutters[port] = RequestCutter(self, port, wire)
        return cutter

    def gone(self, port: ControllerPort, now_ns: int) -> None:
        """A port was lost."""
        cutter = self._cutters.pop(port, None)
        if cutter is not None:
            cutter.end(Turn.GONE, now_ns)

    def of(self, port: ControllerPort | None) -> "RequestCutter | None":
        """Return what follows the requests of a port; None: nothing does."""
        return None if port is None else self._cutters.get(port)

    def note_gain(self, controller: str, what: str, lead: MeasuredLead) -> None:
        """Tell once where frames that are measured would gain nothing."""
        if lead.no_gain is None or (controller, what) in self._told:
            return
        self._told.add((controller, what))
        begins_ms, whole_ms = (each / NS_PER_MS for each in lead.no_gain)
        self.tell_no_gain(
            f"{what} of {controller}: one of {lead.shape.length} bytes could begin to leave {begins_ms:.2f} "
            f"ms after its first bytes came, and is whole after {whole_ms:.2f} ms"
        )

    def end_leaving(self, transaction: Transaction, why: Turn, now_ns: int) -> None:
        """Let no more of a request leave that is leaving."""
        cutter = self.of(transaction.port)
        assert cutter is not None
        cutter.end(why, now_ns)

    def answered(self, path: FastPath, transaction: Transaction, reply: bytes, now_ns: int) -> bytes | None:
        """Return what ``path.answered`` says, which is asked once for each reply."""
        return self.reply.turned(transaction) or path.answered(transaction, reply, now_ns)

    def note(self, transaction: Transaction, reply: bytes, passed: bytes | None, now_ns: int) -> None:
        """Remember a request that was answered, and how long the gateway took with it and with its reply.

        ``passed``: what its controller was told, if that is known: it took the fast path.
        """
        cutter = self.of(transaction.port)
        pdu = transaction.pdu
        if cutter is None or transaction.added is not None:
            return
        asked, told = self.link.stamps, cutter.port.stamps
        cutter.own_ns = asked.sent_ns - asked.paced_ns - (transaction.started_ns or transaction.arrived_ns)
        self.reply.own_ns = told.sent_ns - told.paced_ns - now_ns
        if reply[0] != pdu[0] or transaction.unit_id in self.stored_units:
            return
        if pdu[0] == WRITE and reply != pdu[:5]:
            return
        if passed is not None and isinstance(transaction.path, ReadPath):
            cutter.replies.note(transaction, passed)
        sent = _sent_pdu(transaction)
        unit_id = bytes((transaction.unit_id,))
        path = self.units.path_of(transaction.unit_id, pdu)
        cutter.heads.note(path, unit_id + pdu, unit_id + sent)


class RequestCutter:
    """The requests of one port as they arrive."""

    __slots__ = (
        "_came",
        "_cut",
        "_cuts",
        "_last_ns",
        "_now_ns",
        "_pauses",
        "_transaction",
        "_wire",
        "heads",
        "own_ns",
        "port",
        "replies",
    )

    def __init__(self, cuts: CutLine, port: ControllerPort, wire: Wire) -> None:
        self.port = port
        self.heads = Heads(wire.char_ns, cuts.wire.char_ns, margin_ns(cuts.wire.char_ns))
        self.replies = Replies(cuts.wire.char_ns, wire.char_ns, margin_ns(wire.char_ns))
        self._cuts = cuts
        self._wire = wire
        self._pauses = Pauses(wire.char_ns)
        self._cut: CutThrough | None = None
        self._transaction: Transaction | None = None
        """The request that is leaving."""
        self._came: CutThrough | None = None
        """One that came whole, and from which the port has not learned yet."""
        self.own_ns = 0
        """So long the gateway took between reading and writing the last request that was answered."""
        self._last_ns = 0
        """When its last byte came."""
        self._now_ns = 0

    @property
    def wire(self) -> Wire:
        """On which they come."""
        return self._wire

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`tick` wants to be called."""
        return None if self._cut is None else self._cut.deadline_ns

    def feed(self, data: bytes, now_ns: int, *, is_fresh: bool) -> bool:
        """Take bytes, before the decoder does; return whether they ended a request that has left with them.

        The decoder gives that one too; it is not to be sent again. ``is_fresh``: no bytes wait in there.
        """
        silent_ns, self._last_ns, self._now_ns = now_ns - self._last_ns, now_ns, now_ns
        if is_fresh and silent_ns >= self._wire.silence_ns:
            if self._cut is not None and self._cut.is_on_the_way:
                # Nobody looked for so long that the decoder gave the rest of it up before the guard rang.
                self.end(Turn.STALLED, now_ns)
            self._begin()
        cut = self._cut
        if cut is None:
            return False
        was, was_known = cut.state, cut.arrival.known
        out = cut.feed(data, now_ns)
        if was_known is not Known.GOOD and cut.arrival.known is Known.GOOD:
            self._came = cut
        return self._go_on(cut, was, out)

    def tick(self, now_ns: int) -> None:
        """Do what has fallen due."""
        cut = self._cut
        if cut is not None:
            self._now_ns = now_ns
            self._go_on(cut, cut.state, cut.tick(now_ns))

    def end(self, why: Turn, now_ns: int) -> None:
        """Let no more leave of the request that arrives; it takes the usual way, if all of it comes."""
        cut = self._cut
        if cut is not None:
            self._now_ns = now_ns
            self._go_on(cut, cut.state, cut.end(why, now_ns))

    @property
    def _stall_ns(self) -> int:
        return self._wire.pause_ns + self._pauses.longest_ns

    def _begin(self) -> None:
        self._learn()
        cuts = self._cuts
        judge = RequestJudge(self.port, cuts.units, self.heads, self._may_lead, cuts.line.commit)
        pace = Pace(cuts.wire.char_ns, self._stall_ns, guard_ns(cuts.wire.char_ns))
        self._cut = CutThrough(RequestArrival(), judge, pace, self._turned)

    def _may_lead(self) -> bool:
        return self._cuts.line.may_lead(self.port, self._now_ns)

    def _turned(self, turn: Turn) -> None:
        cut, cuts = self._cut, self._cuts
        assert cut is not None
        if turn is Turn.OPENED:
            self._transaction = cuts.line.lead(self.port, cut.expected, self._now_ns)
        elif not CUT_AFTER[cut.state]:
            cuts.requests[turn] += 1
            cuts.requests_stored[turn] += cut.state is Cut.STORED
            if cut.state is Cut.WHOLE:
                cuts.requests_gain_ns += self._now_ns - cut.began_ns
                self.heads.pay(cut.expected, self._now_ns - cut.began_ns)
            elif cut.state is Cut.SPOILT and turn in WASTED:
                self.heads.pay(cut.expected, -(cuts.silence_ns + len(cut.expected) * cuts.wire.char_ns))

    def _go_on(self, cut: CutThrough, was: Cut, out: bytes) -> bool:
        """Write what leaves; return whether all of it has left with its own check sum."""
        if not out and cut.state is was:
            return False
        cuts, transaction, is_whole = self._cuts, self._transaction, cut.state is Cut.WHOLE
        if transaction is not None and is_whole:
            cuts.line.leave(transaction, cut.left[1:-CRC_BYTES], out, self._now_ns)
            cuts.reply.expect(transaction)
        elif transaction is not None and out:
            cuts.line.piece(transaction, out, self._now_ns)
        stamps = cuts.link.stamps
        if out:
            cut.written(len(out), stamps.ready_ns, stamps.sent_ns)
        if not CUT_AFTER[cut.state]:
            self._transaction = None
            cuts.torn += cut.gap_ns > 0
        if cut.state is Cut.SPOILT:
            # Counted from the writing: between reading and writing the process may have stood still.
            written_ns = stamps.sent_ns + len(out) * cuts.wire.char_ns
            cuts.line.spoilt(max(cut.empty_ns, written_ns) + cuts.silence_ns, self._now_ns)
        cuts.on_change()
        return is_whole

    def _learn(self) -> None:
        """Learn from the request before, when the next one begins: nothing that leaves waits for it."""
        cut, self._came = self._came, None
        if cut is None:
            return
        self._pauses.note(cut.pieces)
        frame = cut.arrival.data
        shape = shape_of(self._cuts.units.path_of(frame[0], frame[1:-CRC_BYTES]), frame)
        if shape is not None:
            lead = self.heads.measure(shape, cut.pieces, self.own_ns, cut.written_need_ns)
            self._cuts.note_gain(self.port.name, "requests", lead)
            self.heads.came(beginning_of(frame))


class ReplyCutter:
    """The replies of the drives of one line as they arrive."""

    __slots__ = ("_came", "_cut", "_cuts", "_judge", "_now_ns", "_pauses", "_transaction", "own_ns")

    def __init__(self, cuts: CutLine) -> None:
        self._cuts = cuts
        self._pauses = Pauses(cuts.wire.char_ns)
        self._transaction: Transaction | None = None
        """Whose reply is followed."""
        self._cut: CutThrough | None = None
        """None: of its reply nothing leaves early."""
        self._came: tuple[CutThrough, Transaction] | None = None
        """One that came whole, and from which the port has not learned yet."""
        self.own_ns = 0
        """So long the gateway took between reading and writing the last reply."""
        self._judge: ReplyJudge | None = None
        self._now_ns = 0

    @property
    def deadline_ns(self) -> int | None:
        """When :meth:`tick` wants to be called."""
        return None if self._cut is None else self._cut.deadline_ns

    def expect(self, transaction: Transaction) -> None:
        """The reply to a request comes next; what came of another one is over."""
        self._transaction, self._cut, self._judge = transaction, None, None

    def feed(self, data: bytes, now_ns: int, *, is_fresh: bool) -> None:
        """Take bytes of the drives, before the decoder does. ``is_fresh``: a reply begins with them."""
        self._now_ns = now_ns
        if is_fresh and self._cut is None:
            self._begin()
        cut, transaction = self._cut, self._transaction
        if cut is None or transaction is None:
            return
        was, was_known = cut.state, cut.arrival.known
        out = cut.feed(data, now_ns)
        if was_known is not Known.GOOD and cut.arrival.known is Known.GOOD:
            self._came = cut, transaction
        self._go_on(cut, was, out)

    def tick(self, now_ns: int) -> None:
        """Do what has fallen due."""
        cut = self._cut
        if cut is not None:
            self._now_ns = now_ns
            self._go_on(cut, cut.state, cut.tick(now_ns))

    def end(self, why: Turn, now_ns: int) -> None:
        """Nobody waits for the reply any more, or it will not come."""
        cut = self._cut
        if cut is not None:
            self._now_ns = now_ns
            self._go_on(cut, cut.state, cut.end(why, now_ns))

    def turned(self, transaction: Transaction) -> bytes | None:
        """Return what the reply to a request was found to say when all of it had come; None: not asked."""
        judge = self._judge
        return judge.turned if judge is not None and self._transaction is transaction else None

    def _begin(self) -> None:
        self._learn()
        transaction = self._transaction
        if transaction is None or transaction.phase is not Phase.SENT or transaction.is_orphan:
            return
        cutter = self._cuts.of(transaction.port)
        if cutter is None or reply_shape_of(transaction) is None:
            return
        self._judge = ReplyJudge(transaction, cutter.replies, self._may_lead)
        char_ns, stall_ns = cutter.wire.char_ns, self._cuts.wire.pause_ns + self._pauses.longest_ns
        pace = Pace(char_ns, stall_ns, guard_ns(char_ns))
        arrival = ReplyArrival(transaction.wire_unit_id, transaction.pdu)
        self._cut = CutThrough(arrival, self._judge, pace, self._turned)

    def _may_lead(self) -> bool:
        transaction = self._transaction
        assert transaction is not None
        port = transaction.port
        return port is not None and not transaction.is_orphan and port.may_lead(self._now_ns)

    def _turned(self, turn: Turn) -> None:
        cut, transaction = self._cut, self._transaction
        assert cut is not None
        if not CUT_AFTER[cut.state]:
            cuts = self._cuts
            cuts.replies[turn] += 1
            cuts.replies_stored[turn] += cut.state is Cut.STORED
            if cut.state is Cut.WHOLE:
                cuts.replies_gain_ns += self._now_ns - cut.began_ns
        if cut.state is Cut.SPOILT and turn in WASTED and transaction is not None:
            self._disappoint(transaction)

    def _go_on(self, cut: CutThrough, was: Cut, out: bytes) -> None:
        transaction = self._transaction
        if transaction is None or (not out and cut.state is was):
            return
        port = transaction.port
        assert port is not None
        if cut.state is Cut.WHOLE:
            reply, tap = cut.left[1:-CRC_BYTES], self._cuts.tap
            if tap is not None:
                tap.answered_early(port, transaction.transaction_id, transaction.unit_id, reply)
            port.leave(transaction.transaction_id, transaction.unit_id, reply, out)
        elif out:
            port.lead(out)
        if out:
            cut.written(len(out), port.stamps.ready_ns, port.stamps.sent_ns)
        if not CUT_AFTER[cut.state]:
            self._cuts.torn += cut.gap_ns > 0
        if cut.state is Cut.WHOLE or cut.state is Cut.SPOILT:
            transaction.give_up()  # its controller has heard what it hears
        self._cuts.on_change()

    def _disappoint(self, transaction: Transaction) -> None:
        """A spoilt reply costs its controller a repeat: such replies are stored for a while."""
        cutter, shape = self._cuts.of(transaction.port), reply_shape_of(transaction)
        if cutter is not None and shape is not None:
            cutter.replies.rest(shape)

    def _learn(self) -> None:
        """Learn from the reply before, when the next one begins; see ``RequestCutter``."""
        if self._came is None:
            return
        (cut, transaction), self._came = self._came, None
        self._pauses.note(cut.pieces)
        cutter, shape = self._cuts.of(transaction.port), reply_shape_of(transaction)
        if cutter is not None and shape is not None:
            lead = cutter.replies.measure(shape, cut.pieces, self.own_ns, cut.written_need_ns)
            self._cuts.note_gain(cutter.port.name, "replies", lead)


def _sent_pdu(transaction: Transaction) -> bytes:
    """Return a request as it left."""
    path, target, pdu = transaction.path, transaction.target, transaction.pdu
    if target is not None and isinstance(path, WritePath):
        start, end = path.place
        return pdu[:start] + target.corrected_words + pdu[end:]
    requests = transaction.requests
    return requests[0].sent_pdu if len(requests) == 1 else pdu
