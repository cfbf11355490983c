"""One request from its arrival to its end: why nothing is sent twice, and what each end leaves behind.

Why nothing is sent twice:

1. All bytes of requests leave in :meth:`Transactions.send`. Nothing else writes to the link of the drives.
2. :class:`Phase` says how far a :class:`Transaction` has come. Each step goes through
   :meth:`Transactions.go_on`, which looks it up in :data:`PHASE_AFTER`. A step without a row is a bug:
   nothing is sent, and it is told; in tests ``sentence_of`` raises it (``axis.impossible``). An end without a
   row ends the transaction all the same, in the safest way.
3. Its own frame leaves from WAITING, in pieces from LEAVING. Both lead to SENT. From SENT the only way is to
   ENDED, and from ENDED there is none.
4. WAITING comes again only after PREREQUISITE. What left then was another frame: one that the gateway added.
5. What leaves in LEAVING is no frame before its check sum has left. A transaction that ends there has not
   been sent: no drive takes what left for a frame (``cut_through``).
6. A stop may leave twice, for to stop once too often does no harm. The second time it is another transaction.
   :data:`STOP_AFTER` has a row ``GOES_AGAIN`` for each state from which one is made, and none for what is no
   stop or does more than stop.

Two equal requests of a controller are two transactions: it has asked twice.

The rows of :data:`PHASE_AFTER` that lead to ENDED say how a transaction may end in each phase. What never
left cannot have been acknowledged, and what left cannot be withdrawn. A transaction ends once, in
:meth:`Transactions.finish`; one that went the fast path and was answered as usual ends in
``LineExchange.reply``, in the same steps.
"""

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Final

from gateway.catalogue import exchange_events
from gateway.compensation.readback import Readback
from gateway.compiled import mypyc_attr
from gateway.exchange.access import only_reads
from gateway.exchange.added_frames import AddedFrame
from gateway.exchange.axis.acknowledge import Outcome, Rendering, SteadyTarget
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.impossible import IGNORED, sentence_of
from gateway.exchange.axis.registers import Loss
from gateway.exchange.counters import LineCounters
from gateway.exchange.decode import DecodedRequest
from gateway.exchange.effects import finish
from gateway.exchange.events import Event
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.reply import nominal_reply, observe_discrete, outcome_of, reply_without_positions
from gateway.exchange.request import Prefetched, Request
from gateway.exchange.tap import Tap
from gateway.exchange.unit import UnitMap
from gateway.limits import Reports, others_of_pairs, times
from gateway.modbus.pdu import BROADCAST_UNIT_ID, ExceptionCode, exception_pdu, is_exception
from gateway.times import NS_PER_S

NEVER_NS: Final = 1 << 62
"""Deadline of what has to be waited for by somebody else."""
LOST: Final = ExceptionCode.SERVER_DEVICE_FAILURE
NO_RESPONSE: Final = ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND


class Phase(Enum):
    """How far a transaction has come."""

    __hash__ = object.__hash__

    WAITING = "waiting"
    """Its own frame has not left, and nothing of it is on the wire."""
    PREREQUISITE = "prerequisite"
    """A frame of the gateway's own that it needs first is on the wire."""
    LEAVING = "leaving"
    """Bytes of its own frame leave while it still arrives: it is no frame before its check sum has left."""
    SENT = "sent"
    """Its own frame has left."""
    ENDED = "ended"
    """Its outcome is known, and nothing leaves for it any more."""


class Step(Enum):
    """What takes a transaction from one phase to the next, beside its end, which is an ``Outcome``."""

    __hash__ = object.__hash__

    FRAME = "frame"
    """Its own frame leaves, whole."""
    ADDED_FRAME = "added-frame"
    """A frame of the gateway's own leaves, which it needs first."""
    ANSWERED = "answered"
    """What it needed first was answered, or the link was lost with a read: it waits for its turn again."""
    BEGINS = "begins"
    """It begins to leave while it still arrives: its first bytes are written next."""
    PIECE = "piece"
    """Bytes of its own frame leave while it still arrives, or fill it up so that it is no frame."""
    LAST_PIECE = "last-piece"
    """The last bytes of its own frame leave, with its check sum: all of it has come."""


PHASE_AFTER: Final[dict[Phase, dict[Step | Outcome, Phase]]] = {
    Phase.WAITING: {
        Step.FRAME: Phase.SENT,
        Step.ADDED_FRAME: Phase.PREREQUISITE,
        Step.BEGINS: Phase.LEAVING,
        Outcome.NEVER_SENT: Phase.ENDED,  # refused, withdrawn, or answered for
    },
    Phase.PREREQUISITE: {
        Step.ANSWERED: Phase.WAITING,
        Outcome.NEVER_SENT: Phase.ENDED,  # what it needed was refused, or not answered
    },
    Phase.LEAVING: {
        Step.PIECE: Phase.LEAVING,
        Step.LAST_PIECE: Phase.SENT,
        Outcome.NEVER_SENT: Phase.ENDED,  # spoilt
    },
    Phase.SENT: {
        Outcome.ACKNOWLEDGED: Phase.ENDED,
        Outcome.EXCEPTION: Phase.ENDED,
        Outcome.OTHER_REPLY: Phase.ENDED,
        Outcome.NO_REPLY: Phase.ENDED,
        Outcome.BROADCAST: Phase.ENDED,
    },
    Phase.ENDED: {},
}
"""Where each step and each outcome leads. What is not there cannot be."""


class Stopping(Enum):
    """Whether a transaction stops an axis, and how often it leaves for that."""

    __hash__ = object.__hash__

    NO = "no"
    """It stops nothing. Or it is a stop that left at once, on a free line: nothing had to be done for it."""
    FIRST = "first"
    """It goes before everything else, on a resting line too, and is never given up."""
    EARLY = "early"
    """It left although a late frame might come: only its exact echo is an answer."""
    AGAIN = "again"
    """Sent early before and not answered: it goes once more, when no late frame can come."""
    ONCE = "once"
    """It does more than stop, which must not be done twice: it goes first, when no late frame can come."""


class StopEvent(Enum):
    """What happens to a stop."""

    __hash__ = object.__hash__

    FOUND = "found"
    """It is found to stop an axis, and cannot leave as it comes. It does nothing else."""
    FOUND_WITH_MORE = "found-with-more"
    """The same, and it does more than stop."""
    LEAVES_EARLY = "leaves-early"
    """It leaves now, although a late frame may come in the place of its reply."""
    REPLACES = "replaces"
    """It takes the place of the same stop that waited in AGAIN."""
    GOES_AGAIN = "goes-again"
    """It left, and goes once more, as another transaction. The row says how that one begins."""


STOP_AFTER: Final[dict[Stopping, dict[StopEvent, Stopping | None]]] = {
    Stopping.NO: {StopEvent.FOUND: Stopping.FIRST, StopEvent.FOUND_WITH_MORE: Stopping.ONCE},
    Stopping.FIRST: {
        StopEvent.LEAVES_EARLY: Stopping.EARLY,
        StopEvent.REPLACES: Stopping.AGAIN,
        StopEvent.GOES_AGAIN: Stopping.AGAIN,  # it left while writes were held back (``renewal``)
    },
    Stopping.EARLY: {StopEvent.GOES_AGAIN: Stopping.AGAIN},  # its own echo did not come
    Stopping.AGAIN: {
        StopEvent.REPLACES: Stopping.AGAIN,
        StopEvent.GOES_AGAIN: Stopping.AGAIN,  # as in FIRST
    },
    Stopping.ONCE: {StopEvent.REPLACES: IGNORED},
}
"""Where each event leads. What is not there cannot be; :data:`IGNORED` changes nothing."""

_WAITING: Final = Phase.WAITING  # a member is looked up slowly, and these are asked for with each request
_NO_STOP: Final = Stopping.NO
_PIECE: Final = Step.PIECE
_LAST_PIECE: Final = Step.LAST_PIECE


class Answer(Enum):
    """What its controller hears of a request that its drive did not answer (W7)."""

    REFUSAL = "refusal"
    """An exception of the gateway's own, on serial lines too; counted."""
    DENIAL = "denial"
    """The same, but what may not be reached is as good as absent: 0x0A is silence on a serial line."""
    BACK_OFF = "back-off"
    """An exception at once, on serial lines too: the drive left three requests unanswered; counted apart."""
    TOO_LATE = "too-late"
    """The same: it could only have left too late behind the silence of its drive; counted apart."""
    ABSENCE = "absence"
    """An exception on TCP, silence on a serial line: the drive cannot be had."""
    NOTHING = "nothing"
    """It does not wait for it any more."""


class FastPath:
    """How a request leaves and its reply comes back where nothing about them needs to be judged.

    This one is for frames that hold nothing the gateway cares for: both directions pass as they are. What
    positions need is in ``fast_path``.
    """

    __slots__ = ("_size", "axes")

    def __init__(self, size: int, axes: tuple[Axis, ...] = ()) -> None:
        self._size = size
        """Bytes of the PDU: of a request whose length contradicts its head nobody knows what it writes."""
        self.axes = axes
        """Axes of its unit, of which something may have been learned."""

    def sent(self, transaction: "Transaction", now_ns: int) -> bytes | None:
        """Return what is sent for a request; None: it goes the slow path."""
        for axis in self.axes:
            if axis.silent_since_ns is not None:
                return None
        pdu = transaction.pdu
        return pdu if len(pdu) == self._size else None

    def answered(self, transaction: "Transaction", reply: bytes, now_ns: int) -> bytes | None:
        """Return what the controller gets for a drive's reply; None: it goes the slow path."""
        return reply

    def left(self, transaction: "Transaction") -> None:
        """Take note that a target is on its way."""

    def settle(self, transaction: "Transaction", now_ns: int) -> None:
        """Take note of what the reply proved, once it was passed on."""

    def rendering(self, transaction: "Transaction") -> Rendering:
        """Return the target that a transaction carries, as the slow path would have rendered it."""
        raise NotImplementedError

    def request(self, transaction: "Transaction") -> Request:
        """Return the request as the slow path would have prepared it."""
        raise NotImplementedError


@mypyc_attr(free_list_len=1)  # there is one at a time, nearly always
class Transaction:
    """One request with its reply. ``port`` is None for a read that the gateway added by itself."""

    # Defaults of the class: most leave most of them alone, and one is made for each request.
    phase = _WAITING
    sent_ns = 0
    deadline_ns = 0
    started_ns = 0
    """When its turn came, after it had waited or after a frame that it needed; 0: as it arrived."""
    queue_ns = 0
    """How long it waited for the line."""
    added_ns = 0
    """How long frames of the gateway's own held it up."""
    early_ns = 0
    """So long its own frame had been leaving when all of it had come (``cut_through``)."""
    excused_ns = 0
    """How much of that no deadline counts: a look at where the axis stands."""
    follows_ns = 0
    """When the request before it came on the same connection."""
    is_orphan = False
    """Its controller has gone or gone on, or has heard a reply while that still arrived (``cut_through``):
    what comes is taken note of and then dropped."""
    is_denied = False
    """There was no room for it: it is refused when the answers before it have been given."""
    is_odd = False
    """It has another length than its function code says, and is for a device that may take it."""
    is_held_up = False
    """It waited for the link to the drives: of that its controller knows nothing (``leave_by_ns``)."""
    overtaken_by = ""
    """Why it must not be sent any more, although its controller waits for it."""
    stopping = _NO_STOP
    added: AddedFrame | None = None
    """A frame of the gateway's own that goes first, or alone."""
    frames: tuple[DecodedRequest, ...] | None = None
    """What its bytes say to each unit that it reaches, as soon as that was asked for."""
    prefetched: Prefetched | None = None
    path: FastPath | None = None
    """The fast path on which it was sent; None: it went the slow one."""
    target: SteadyTarget | None = None
    """What it carries on the fast path."""
    readbacks: Sequence[Readback | None] = ()
    """Of each position that it reads, on the fast path: as they were when it was sent."""
    _requests: tuple[Request, ...] = ()
    _rendering: Rendering | None = None

    def __init__(
        self, port: ControllerPort | None, transaction_id: int, unit_id: int, pdu: bytes, arrived_ns: int
    ) -> None:
        self.port = port
        self.transaction_id = transaction_id
        self.unit_id = unit_id
        self.wire_unit_id = unit_id
        """Of the frame that is on the wire for it."""
        self.pdu = pdu
        self.arrived_ns = arrived_ns

    @property
    def is_motion(self) -> bool:
        """Whether a motion controller asked for it."""
        return self.port is not None and self.port.is_motion

    @property
    def only_reads(self) -> bool:
        """Whether it changes nothing in any drive. An odd frame may, whatever its function code says."""
        return not self.is_odd and only_reads(self.pdu)

    @property
    def is_stop(self) -> bool:
        """Whether it stops an axis."""
        return self.stopping is not _NO_STOP

    @property
    def requests(self) -> tuple[Request, ...]:
        """The request as each unit has it that it reaches, as it is sent; a broadcast reaches several."""
        if self.target is not None and self.path is not None and not self._requests:
            self._requests = (self.path.request(self),)
        return self._requests

    def set_frames(self, frames: tuple[DecodedRequest, ...]) -> None:
        """Note what its bytes say."""
        self.frames = frames

    def set_requests(self, requests: tuple[Request, ...]) -> None:
        """Note what is sent for it."""
        self._requests = requests

    def knowledge(self) -> Prefetched:
        """Return what was read for it, to be added to."""
        if self.prefetched is None:
            self.prefetched = Prefetched()
        return self.prefetched

    def become_odd(self) -> None:
        """Note that it is an odd frame: it counts as a write."""
        self.is_odd = True

    def deny(self) -> None:
        """Note that it has no room, and is refused in its turn."""
        self.is_denied = True

    @property
    def waits_for_silence(self) -> bool:
        """Whether it is a stop that leaves only when no late frame can come."""
        return self.stopping is Stopping.AGAIN or self.stopping is Stopping.ONCE

    def rendering(self) -> Rendering:
        """Return the target that it carries on the fast path: always the same object."""
        if self._rendering is None:
            assert self.path is not None
            self._rendering = self.path.rendering(self)
        return self._rendering

    @property
    def leave_by_ns(self) -> int:
        """Latest instant at which a request that was held up may leave: half of ``timeout_ms`` is left then.

        One limit for each wait that its controller cannot know of: a line that is down, the silence of its
        own drive, a connection that is made anew. What leaves later may be answered after its controller gave
        up, which then takes a write for lost that the drive carries out.
        """
        return NEVER_NS if self.port is None else self.arrived_ns + self.port.patience_ns // 2

    @property
    def given_up_ns(self) -> int:
        """Latest instant at which its controller still waits for it (W5)."""
        return NEVER_NS if self.port is None else self.arrived_ns + self.port.patience_ns

    @property
    def waits_until_ns(self) -> int:
        """Until when it waits for the link to the drives; a stop as long as its controller waits for it."""
        return self.given_up_ns if self.is_stop else self.leave_by_ns

    # --- its turn --------------------------------------------------------------------------------------

    def start(self, now_ns: int) -> None:
        """Note that it is its turn: after it waited for the line, or for a frame that goes first."""
        if self.added is not None or self.prefetched is not None:
            self.added_ns += now_ns - (self.started_ns or self.arrived_ns)
        else:
            self.queue_ns = now_ns - self.arrived_ns
        self.started_ns = now_ns

    def need(self, frame: AddedFrame | None) -> None:
        """Note which frame of the gateway's own it needs first; None: none any more."""
        self.added = frame

    def begin_anew(self) -> None:
        """Something else goes first: what it needs is found out anew when its turn comes, and read again."""
        self.prefetched = Prefetched()

    def carry(self, path: FastPath, target: SteadyTarget) -> None:
        """Note the target that it carries on a fast path."""
        self.path, self.target = path, target

    def take(self, path: FastPath) -> None:
        """Note the fast path on which it leaves."""
        self.path = path

    def set_readbacks(self, readbacks: Sequence[Readback | None]) -> None:
        """Note how the positions that it reads on a fast path are turned back."""
        self.readbacks = readbacks

    def hold_up(self) -> None:
        """It waits for the link to the drives."""
        self.is_held_up = True

    def excuse(self, span_ns: int) -> None:
        """No deadline counts so much of its waiting."""
        self.excused_ns += span_ns

    def overtake(self, why: str) -> None:
        """It must not be sent any more, although its controller waits for it."""
        self.overtaken_by = why

    def give_up(self) -> None:
        """Its controller does not wait for it any more: a reply is taken note of and then dropped."""
        self.is_orphan = True

    def is_same_stop(self, other: "Transaction") -> bool:
        """Whether this is a stop that says the same to the same drive."""
        return self.is_stop and self.unit_id == other.unit_id and self.pdu == other.pdu

    def why_given_up(self, now_ns: int) -> str:
        """Return why its controller does not wait for it any more; empty while it does (W5).

        A stop goes out all the same: to stop once too often does no harm.
        """
        if self.is_stop:
            return ""
        if self.is_orphan:
            return "its controller gave up on it"
        if now_ns > self.given_up_ns:
            return "it waited longer than its controller's timeout_ms"
        return ""


class Transactions:
    """The transactions of one line: nothing else takes one from phase to phase, sends it, or ends it.

    Args:
        counters: of the line.
        on_event: hears what is worth a word.
        lose: notes what a request that never left would have written (``ownership``).
        unit_of: the register map of a unit id.
        link: the way to the drives.
        tap: listens.
    """

    def __init__(
        self,
        counters: LineCounters,
        on_event: Callable[[Event], None],
        lose: Callable[[Transaction, int, Loss], None],
        unit_of: Callable[[int], UnitMap | None],
        link: DriveLink,
        *,
        tap: Tap | None = None,
    ) -> None:
        self._tap = tap
        self._link = link
        self._counters = counters
        self._on_event = on_event
        self._lose = lose
        self._unit_of = unit_of
        self._withdrawals: Reports[tuple[str, str]] = Reports(NS_PER_S, others=others_of_pairs)
        self._arrived_ns = 0
        """When the newest request came."""
        self.current: Transaction | None = None
        """The one on the wire: it is leaving, or its reply has not come."""

    def free_wire(self) -> Transaction | None:
        """Nothing is on the wire any more; return what was."""
        current, self.current = self.current, None
        return current

    def come(
        self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int
    ) -> Transaction:
        """Return the transaction of a request that comes now."""
        # Losses are told apart by it (M3): no two requests come at one instant.
        arrived_ns = self._arrived_ns = now_ns if now_ns > self._arrived_ns else self._arrived_ns + 1
        transaction = Transaction(port, transaction_id, unit_id, pdu, arrived_ns)
        transaction.follows_ns, port.newest_ns = port.newest_ns, arrived_ns
        return transaction

    def come_whole(self, transaction: Transaction, port: ControllerPort, pdu: bytes, now_ns: int) -> None:
        """All of a request has come while it was leaving: this is what it says."""
        arrived_ns = self._arrived_ns = now_ns if now_ns > self._arrived_ns else self._arrived_ns + 1
        transaction.pdu, transaction.arrived_ns = pdu, arrived_ns
        transaction.early_ns = arrived_ns - transaction.sent_ns
        transaction.frames = None
        transaction.follows_ns, port.newest_ns = port.newest_ns, arrived_ns

    # --- steps -----------------------------------------------------------------------------------------

    def go_on(self, transaction: Transaction, event: Step | Outcome) -> bool:
        """Take a step of :data:`PHASE_AFTER`; return whether there is one. If not, nothing has changed."""
        after = PHASE_AFTER[transaction.phase].get(event)
        if after is None:
            self.report_fault(sentence_of("transaction", transaction.phase, event))
            return False
        transaction.phase = after
        return True

    def begin(self, transaction: Transaction) -> bool:
        """Let a request have the line from now on that leaves while it arrives; return whether it may.

        It has its deadline elsewhere.
        """
        if not self.go_on(transaction, Step.BEGINS):
            return False
        transaction.sent_ns, transaction.deadline_ns = transaction.arrived_ns, NEVER_NS
        self.current = transaction
        return True

    def send(
        self,
        transaction: Transaction,
        step: Step,
        unit_id: int,
        pdu: bytes,
        now_ns: int,
        *,
        patience_ns: int = 0,
        piece: bytes = b"",
    ) -> bool:
        """Let a frame leave, or a piece of one: all bytes of requests leave here. Return whether it left.

        Args:
            transaction: for which it leaves; it is the one on the wire then.
            step: its own frame, one that it needs first, or a piece of its own.
            unit_id: of the frame.
            pdu: of the frame; of one of which the last piece leaves, all of it.
            now_ns: when.
            patience_ns: so long its reply is waited for.
            piece: the bytes that leave, where it is a piece.
        """
        if not self.go_on(transaction, step):
            return False
        if step is _PIECE:
            self._link.forward(piece)
            return True
        transaction.sent_ns = now_ns
        transaction.wire_unit_id = unit_id
        transaction.deadline_ns = now_ns + patience_ns
        if self._tap is not None:
            self._tap.sent(unit_id, pdu)
        if step is _LAST_PIECE:
            self._link.forward_last(unit_id, pdu, piece)
            return True
        if unit_id != BROADCAST_UNIT_ID or not self._link.is_serial:  # nobody answers a broadcast
            self.current = transaction
        self._link.send_request(unit_id, pdu)
        return True

    def stop_goes_on(self, stop: Transaction, event: StopEvent) -> None:
        """Take a step of :data:`STOP_AFTER` with a transaction itself."""
        after = self._after_stop(stop, event)
        if after is not None:
            stop.stopping = after

    def replace(self, before: Transaction, stop: Transaction) -> None:
        """Let a stop take the place of the same one, which may have been sent early and not answered."""
        if before.stopping is Stopping.AGAIN:
            self.stop_goes_on(stop, StopEvent.REPLACES)

    def once_more(self, stop: Transaction) -> Transaction | None:
        """Return the same stop, to go once more when no late frame can come in the place of its reply.

        None: that cannot be (:data:`STOP_AFTER`).
        """
        after = self._after_stop(stop, StopEvent.GOES_AGAIN)
        if after is None:
            return None
        again = Transaction(stop.port, stop.transaction_id, stop.unit_id, stop.pdu, stop.arrived_ns)
        again.stopping = after
        again.is_orphan = stop.is_orphan
        return again

    def _after_stop(self, stop: Transaction, event: StopEvent) -> Stopping | None:
        row = STOP_AFTER[stop.stopping]
        if event not in row:
            self.report_fault(sentence_of("stop", stop.stopping, event))
            return None
        return row[event]

    def report_fault(self, sentence: str) -> None:
        """Tell of something that cannot be: a bug of this program."""
        self._counters.internal_faults += 1
        self._on_event(Event(exchange_events.INTERNAL_FAULT, None, sentence))

    # --- ends ------------------------------------------------------------------------------------------

    def finish(
        self,
        transaction: Transaction,
        outcome: Outcome,
        now_ns: int,
        *,
        code: int = 0,
        reply: bytes = b"",
        answer: Answer = Answer.NOTHING,
        withdrawn: str = "",
        loss: Loss | None = Loss.DENIED,
    ) -> None:
        """End a transaction: answer its controller, and take note of what the end says of its axes.

        Args:
            transaction: what ends.
            outcome: how.
            now_ns: when.
            code: exception code that its controller gets, or would get, where its drive did not answer.
            reply: of its drive.
            answer: what its controller hears where there is no reply.
            withdrawn: why it was not sent any more; "" where it was not withdrawn.
            loss: how what it would have written is lost, where it never left (M3); None for those who have
                no right to write, and where that was noted already.
        """
        if not self.go_on(transaction, outcome):
            if transaction.phase is Phase.ENDED:
                return
            # The safest: of what may have reached its drive nobody knows what it did.
            outcome = Outcome.NO_REPLY if transaction.phase is Phase.SENT else Outcome.NEVER_SENT
            self.go_on(transaction, outcome)
        if outcome is Outcome.NEVER_SENT:
            if loss is not None and transaction.port is not None and not transaction.only_reads:
                self._lose(transaction, code, loss)
            if withdrawn:
                self._count_withdrawn(transaction, withdrawn, now_ns)
        elif reply:
            self._pass_back(transaction, outcome, code, reply, now_ns)
        else:
            for request in transaction.requests:
                finish(request, outcome, code, now_ns)
        if answer is not Answer.NOTHING:
            self._answer(transaction, code, answer)

    def refuse(
        self, transaction: Transaction, code: int, now_ns: int, *, loss: Loss | None = Loss.DENIED
    ) -> None:
        """Refuse a request that might have moved something: it never reached the drive (M3)."""
        self.finish(transaction, Outcome.NEVER_SENT, now_ns, code=code, answer=Answer.REFUSAL, loss=loss)

    def refuse_absent(self, transaction: Transaction, now_ns: int) -> None:
        """Say that there is no link to the drives (W7)."""
        code = ExceptionCode.GATEWAY_PATH_UNAVAILABLE
        self.finish(transaction, Outcome.NEVER_SENT, now_ns, code=code, answer=Answer.ABSENCE)

    def never_left(self, transaction: Transaction, now_ns: int) -> None:
        """End what never left whole: nothing is lost that its controller has not still to send."""
        self.finish(transaction, Outcome.NEVER_SENT, now_ns, loss=None)

    def withdraw(self, transaction: Transaction, why: str, now_ns: int) -> None:
        """End a request that its controller does not wait for any more (W5)."""
        self.finish(transaction, Outcome.NEVER_SENT, now_ns, code=LOST, withdrawn=why, loss=Loss.WITHDRAWN)

    def overtaken(self, transaction: Transaction, why: str, now_ns: int) -> None:
        """Withdraw what a stop has overtaken; its controller still waits, and is told (M3)."""
        code = ExceptionCode.SERVER_DEVICE_BUSY
        self.finish(transaction, Outcome.NEVER_SENT, now_ns, code=code, answer=Answer.REFUSAL, withdrawn=why)

    def reply(self, transaction: Transaction, pdu: bytes) -> None:
        """Give the controller its reply, if it still waits for one."""
        port = transaction.port
        if port is None or transaction.is_orphan:
            return
        if not (port.is_serial and transaction.unit_id == BROADCAST_UNIT_ID):  # nobody answers a broadcast
            if self._tap is not None:
                self._tap.answered(port, transaction.transaction_id, transaction.unit_id, pdu)
            port.send_reply(transaction.transaction_id, transaction.unit_id, pdu)

    def _pass_back(
        self, transaction: Transaction, outcome: Outcome, code: int, reply: bytes, now_ns: int
    ) -> None:
        """Give the controller a drive's reply, and take note of what it says.

        The controller waits for its reply, so it is sent as soon as it is known: before the state of the axis
        is worked out, unless the same frame also reads positions, which that state turns back.
        """
        self._counters.count_reply(reply)
        requests = transaction.requests
        if not requests:
            self.reply(transaction, reply)
            unit = self._unit_of(transaction.unit_id)
            observe_discrete(unit, transaction.pdu, reply, transaction.sent_ns)
            return
        is_acknowledged = outcome is Outcome.ACKNOWLEDGED
        for request in requests:
            is_read = request.reads_too
            if is_acknowledged and is_read:
                finish(request, outcome, code, now_ns)
                self.reply(transaction, nominal_reply(request, reply))
            else:
                passed = reply_without_positions(request, reply, is_acknowledged=is_acknowledged)
                self.reply(transaction, passed)
                finish(request, outcome, code, now_ns)
            if is_read:
                self._counters.unmapped_reads += request.reads_unmapped

    def _answer(self, transaction: Transaction, code: int, answer: Answer) -> None:
        port = transaction.port
        if answer is Answer.BACK_OFF:
            self._counters.backed_off += 1
        elif answer is Answer.TOO_LATE:
            self._counters.too_late += 1
        elif answer is not Answer.ABSENCE:
            self._counters.count_refusal(None if port is None else port.plan.name)
        is_absent = answer is Answer.ABSENCE or (
            answer is Answer.DENIAL and code == ExceptionCode.GATEWAY_PATH_UNAVAILABLE
        )
        if not (is_absent and (port is None or port.is_serial)):
            self.reply(transaction, exception_pdu(transaction.pdu[0], code))

    def _count_withdrawn(self, transaction: Transaction, why: str, now_ns: int) -> None:
        """Count it; tell of one for each controller and reason in a second, and how many there were."""
        self._counters.withdrawn += 1
        if transaction.port is None:
            return
        name = transaction.port.plan.name
        if count := self._withdrawals.due((name, why), now_ns):
            detail = f"a request of {name} was not sent: {why}{times(count)}"
            self._on_event(Event(exchange_events.WITHDRAWN, None, detail))


def outcome_of_reply(transaction: Transaction, reply: bytes) -> tuple[Outcome, int]:
    """Return how a transaction ends that its drive replied to, and the exception code that stands for it."""
    for request in transaction.requests:
        return outcome_of(request, reply)
    return (Outcome.EXCEPTION, reply[-1]) if is_exception(reply) else (Outcome.ACKNOWLEDGED, 0)
