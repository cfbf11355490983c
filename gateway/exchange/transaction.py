"""One request from its arrival to its end: why nothing is sent twice, and what each end changes.

Why nothing is sent twice:

1. All bytes of requests are sent in :meth:`Transactions.send`. Nothing else writes to the link of the drives.
2. :class:`Phase` says how far a :class:`Transaction` has come. Each step goes through
   :meth:`Transactions.go_on`, which looks it up in :data:`PHASE_AFTER`. A step without a row is a bug:
   nothing is sent, and the fault is reported. An end without a row is reported too; it still ends a
   transaction that has not ended, in the safest way. In tests ``sentence_of`` raises both
   (``axis.impossible``).
3. The own frame of a transaction is sent from WAITING, or in pieces from LEAVING. Both lead to SENT. SENT
   leads only to ENDED, and nothing leads out of ENDED.
4. WAITING comes again only after PREREQUISITE. The frame sent there was another one, added by the gateway.
5. In LEAVING, bytes are sent while the request still comes in (cut-through). They become a valid frame only
   when the CRC is sent. If the request is aborted before that, its CRC is inverted. No drive accepts it, and
   it counts as not sent.
6. A stop may be sent again, because an extra stop does no harm. Each time it is a new transaction
   (:meth:`Transactions.once_more`). :data:`STOP_AFTER` has a row ``GOES_AGAIN`` for each state from which a
   stop is sent again. It has none for a request that is no stop or does more than stop, nor for a stop that
   was sent immediately on a free line.

Two equal requests of a controller are two transactions: it has asked twice.

The rows of :data:`PHASE_AFTER` that lead to ENDED say how a transaction may end in each phase. A request that
was never sent cannot be acknowledged, and a sent one cannot be withdrawn. A transaction ends once, in
:meth:`Transactions.finish`. If it took the fast path and got its usual reply, it ends in
``LineExchange.reply`` instead, by the same steps.
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
from gateway.times import NEVER_NS, NS_PER_S

LOST: Final = ExceptionCode.SERVER_DEVICE_FAILURE
NO_RESPONSE: Final = ExceptionCode.GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND


class Phase(Enum):
    """How far a transaction has come."""

    __hash__ = object.__hash__

    WAITING = "waiting"
    """Its own frame was not sent, and nothing of it is on the wire."""
    PREREQUISITE = "prerequisite"
    """A frame of the gateway that it needs first is on the wire."""
    LEAVING = "leaving"
    """Bytes of its own frame are sent while it still comes in: no valid frame before its CRC is sent."""
    SENT = "sent"
    """Its own frame was sent."""
    ENDED = "ended"
    """Its outcome is known, and nothing is sent for it any more."""


class Step(Enum):
    """What takes a transaction to its next phase, besides its end, which is an ``Outcome``."""

    __hash__ = object.__hash__

    FRAME = "frame"
    """Its own frame is sent, complete."""
    ADDED_FRAME = "added-frame"
    """A frame of the gateway that it needs first is sent."""
    ANSWERED = "answered"
    """Its prerequisite was answered, or the link was lost during a read: it waits for its turn again."""
    BEGINS = "begins"
    """Its forwarding begins: its first bytes are written next."""
    PIECE = "piece"
    """Bytes of its own frame are sent while it still comes in. If it is aborted, bytes fill it up, so that it
    is no valid frame."""
    LAST_PIECE = "last-piece"
    """The last bytes of its own frame are sent, with its CRC: all of it has come in."""


PHASE_AFTER: Final[dict[Phase, dict[Step | Outcome, Phase]]] = {
    Phase.WAITING: {
        Step.FRAME: Phase.SENT,
        Step.ADDED_FRAME: Phase.PREREQUISITE,
        Step.BEGINS: Phase.LEAVING,
        Outcome.NEVER_SENT: Phase.ENDED,  # refused, withdrawn, or answered by the gateway
    },
    Phase.PREREQUISITE: {
        Step.ANSWERED: Phase.WAITING,
        Outcome.NEVER_SENT: Phase.ENDED,  # its prerequisite was refused, or not answered
    },
    Phase.LEAVING: {
        Step.PIECE: Phase.LEAVING,
        Step.LAST_PIECE: Phase.SENT,
        Outcome.NEVER_SENT: Phase.ENDED,  # aborted
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
"""The phase after each step and each outcome. A missing pair is impossible."""


class Stopping(Enum):
    """Whether a transaction stops an axis, and how often it is sent for that."""

    __hash__ = object.__hash__

    NO = "no"
    """It stops nothing. Or it is a stop that was sent immediately on a free line, which needs no special
    care."""
    FIRST = "first"
    """It goes before everything else, also on a resting line, and is never given up."""
    EARLY = "early"
    """It was sent although a late frame might come: only its exact echo counts as its answer."""
    AGAIN = "again"
    """It was sent early and not answered: it is sent once more when no late frame can come."""
    ONCE = "once"
    """It does more than stop, which must not be done twice: it goes first, when no late frame can come."""


class StopEvent(Enum):
    """What happens to a stop."""

    __hash__ = object.__hash__

    FOUND = "found"
    """It is found to stop an axis, and cannot be sent immediately. It does nothing else."""
    FOUND_WITH_MORE = "found-with-more"
    """The same, and it does more than stop."""
    LEAVES_EARLY = "leaves-early"
    """It is sent now, although a late frame may come instead of its reply."""
    REPLACES = "replaces"
    """It replaces the same stop that waited in AGAIN."""
    GOES_AGAIN = "goes-again"
    """It was sent, and is sent once more as another transaction. The row gives the state of that one."""


STOP_AFTER: Final[dict[Stopping, dict[StopEvent, Stopping | None]]] = {
    Stopping.NO: {StopEvent.FOUND: Stopping.FIRST, StopEvent.FOUND_WITH_MORE: Stopping.ONCE},
    Stopping.FIRST: {
        StopEvent.LEAVES_EARLY: Stopping.EARLY,
        StopEvent.REPLACES: Stopping.AGAIN,
        StopEvent.GOES_AGAIN: Stopping.AGAIN,  # it was sent while the connection to the drive was renewed
    },
    Stopping.EARLY: {StopEvent.GOES_AGAIN: Stopping.AGAIN},  # its own echo did not come
    Stopping.AGAIN: {
        StopEvent.REPLACES: Stopping.AGAIN,
        StopEvent.GOES_AGAIN: Stopping.AGAIN,  # as in FIRST
    },
    Stopping.ONCE: {StopEvent.REPLACES: IGNORED},
}
"""The state after each event. A missing pair is impossible; :data:`IGNORED` changes nothing."""

_WAITING: Final = Phase.WAITING  # member lookup is slow, and these are used for each request
_NO_STOP: Final = Stopping.NO
_PIECE: Final = Step.PIECE
_LAST_PIECE: Final = Step.LAST_PIECE


class Answer(Enum):
    """How the controller is answered if the drive did not answer (W7)."""

    REFUSAL = "refusal"
    """An exception of the gateway, also on serial lines; counted."""
    DENIAL = "denial"
    """The same, but for 0x0A a serial line stays silent: a forbidden unit is treated as absent."""
    BACK_OFF = "back-off"
    """An immediate exception, also on serial lines: the drive left three requests unanswered; counted
    separately."""
    TOO_LATE = "too-late"
    """The same, but it could only have been sent too late, behind the silence of its drive; counted
    separately."""
    ABSENCE = "absence"
    """An exception on TCP, silence on a serial line: the drive is not reachable."""
    NOTHING = "nothing"
    """No answer: the controller does not wait for it any more."""


class FastPath:
    """How a request is sent and its reply passed on when nothing in them needs judgement.

    This class is for frames without any mapped content: both directions pass unchanged. ``fast_path`` has the
    classes for positions.
    """

    __slots__ = ("_size", "axes")

    def __init__(self, size: int, axes: tuple[Axis, ...] = ()) -> None:
        self._size = size
        """Bytes of the PDU. If the length contradicts the head, it is unknown what a request writes."""
        self.axes = axes
        """Axes of its unit: the reply may change what is known of them."""

    def sent(self, transaction: "Transaction", now_ns: int) -> bytes | None:
        """Return what is sent for a request; None: it takes the slow path."""
        for axis in self.axes:
            if axis.reach.silent_since_ns is not None:
                return None
        pdu = transaction.pdu
        return pdu if len(pdu) == self._size else None

    def answered(self, transaction: "Transaction", reply: bytes, now_ns: int) -> bytes | None:
        """Return what the controller gets for a drive's reply; None: it takes the slow path."""
        return reply

    def left(self, transaction: "Transaction") -> None:
        """Record that a target was sent."""

    def settle(self, transaction: "Transaction", now_ns: int) -> None:
        """Record what the reply proved, after it was passed on."""

    def rendering(self, transaction: "Transaction") -> Rendering:
        """Return the target of a transaction, as the slow path would have rendered it."""
        raise NotImplementedError

    def request(self, transaction: "Transaction") -> Request:
        """Return the request as the slow path would have prepared it."""
        raise NotImplementedError


@mypyc_attr(free_list_len=1)  # nearly always there is only one
class Transaction:
    """One request with its reply. ``port`` is None for a read that the gateway added on its own."""

    # Class defaults: one transaction is made for each request, and most set few of these.
    phase = _WAITING
    sent_ns = 0
    deadline_ns = 0
    started_ns = 0
    """When its turn came, after waiting or after a prerequisite; 0: when it arrived."""
    queue_ns = 0
    """How long it waited for the line."""
    added_ns = 0
    """How long frames of the gateway delayed it."""
    early_ns = 0
    """How long it had been forwarded when its last byte came (``cut_through``)."""
    excused_ns = 0
    """Waiting time that no deadline counts: a read of the axis's position."""
    follows_ns = 0
    """When the request before it arrived on the same connection."""
    is_orphan = False
    """Its controller does not wait for a reply any more: it has disconnected, sent another request, or
    received an answer. What comes is processed and then dropped."""
    is_denied = False
    """Its rights, its role or a full queue forbid it: it is refused after the answers to earlier requests."""
    is_by_alias = False
    """It stops axes under another unit id than theirs: what its reply says is not certain of any of them."""
    is_odd = False
    """Its length does not fit its function code, and it is for a device that may accept that. It counts as a
    write."""
    is_held_up = False
    """It waited for the link to the drives, which its controller cannot know (``leave_by_ns``)."""
    overtaken_by = ""
    """Why it must not be sent any more, although its controller waits for it."""
    stopping = _NO_STOP
    added: AddedFrame | None = None
    """A frame of the gateway that is sent before it, or alone; None: none, or none any more."""
    frames: tuple[DecodedRequest, ...] | None = None
    """Its content, parsed for each unit that it reaches; None: not parsed yet."""
    prefetched: Prefetched | None = None
    path: FastPath | None = None
    """The fast path on which it was sent; None: it took the slow path."""
    target: SteadyTarget | None = None
    """The target in it, on the fast path."""
    readbacks: Sequence[Readback | None] = ()
    """The readback of each position that it reads on the fast path, as it was when it was sent."""
    _requests: tuple[Request, ...] = ()
    _rendering: Rendering | None = None

    def __init__(
        self, port: ControllerPort | None, transaction_id: int, unit_id: int, pdu: bytes, arrived_ns: int
    ) -> None:
        self.port = port
        self.transaction_id = transaction_id
        self.unit_id = unit_id
        self.wire_unit_id = unit_id
        """Unit id of the frame that is on the wire for it."""
        self.pdu = pdu
        self.arrived_ns = arrived_ns

    @property
    def is_motion(self) -> bool:
        """Whether a motion controller sent it."""
        return self.port is not None and self.port.is_motion

    @property
    def only_reads(self) -> bool:
        """Whether it changes nothing in any drive. An odd frame may, whatever its function code says."""
        return not self.is_odd and only_reads(self.pdu)

    @property
    def is_broadcast(self) -> bool:
        """Whether it is for all drives; its controller does not wait for a reply."""
        return self.unit_id == BROADCAST_UNIT_ID

    @property
    def is_stop(self) -> bool:
        """Whether it stops an axis."""
        return self.stopping is not _NO_STOP

    @property
    def requests(self) -> tuple[Request, ...]:
        """The request as it is sent to each unit that it reaches; a broadcast reaches several."""
        if self.target is not None and self.path is not None and not self._requests:
            self._requests = (self.path.request(self),)
        return self._requests

    def set_requests(self, requests: tuple[Request, ...]) -> None:
        """Set what is sent for it."""
        self._requests = requests

    def knowledge(self) -> Prefetched:
        """Return what was read for it; the caller adds to it."""
        if self.prefetched is None:
            self.prefetched = Prefetched()
        return self.prefetched

    @property
    def waits_for_silence(self) -> bool:
        """Whether it is a stop that is sent only when no late frame can come."""
        return self.stopping is Stopping.AGAIN or self.stopping is Stopping.ONCE

    def rendering(self) -> Rendering:
        """Return its target on the fast path: always the same object."""
        if self._rendering is None:
            assert self.path is not None
            self._rendering = self.path.rendering(self)
        return self._rendering

    @property
    def leave_by_ns(self) -> int:
        """Latest time at which a held-up request may be sent: half of ``timeout_ms`` is left then.

        The limit applies to each wait that its controller cannot know: a line that is down, the silence of
        its own drive, a connection that is renewed. A later request may be answered after its controller gave
        up. The controller then takes a write for lost that the drive carries out.
        """
        return NEVER_NS if self.port is None else self.arrived_ns + self.port.patience_ns // 2

    @property
    def given_up_ns(self) -> int:
        """Latest time at which its controller still waits for it (W5)."""
        return NEVER_NS if self.port is None else self.arrived_ns + self.port.patience_ns

    @property
    def waits_until_ns(self) -> int:
        """Until when it waits for the link to the drives; a stop waits as long as its controller does."""
        return self.given_up_ns if self.is_stop else self.leave_by_ns

    # --- its turn --------------------------------------------------------------------------------------

    def start(self, now_ns: int) -> None:
        """Record that its turn has come: after it waited for the line, or for a prerequisite."""
        if self.added is not None or self.prefetched is not None:
            self.added_ns += now_ns - (self.started_ns or self.arrived_ns)
        else:
            self.queue_ns = now_ns - self.arrived_ns
        self.started_ns = now_ns

    def begin_anew(self) -> None:
        """Something else goes first: its prerequisites are determined and read again at its next turn."""
        self.prefetched = Prefetched()

    def excuse(self, span_ns: int) -> None:
        """Exclude this much of its waiting time from all deadlines."""
        self.excused_ns += span_ns

    def give_up(self) -> None:
        """Its controller does not wait for it any more: a reply is processed and then dropped."""
        self.is_orphan = True

    def is_same_stop(self, other: "Transaction") -> bool:
        """Whether this is a stop with the same content for the same drive."""
        return self.is_stop and self.unit_id == other.unit_id and self.pdu == other.pdu

    def why_given_up(self, now_ns: int) -> str:
        """Return why its controller does not wait for it any more; empty while it does (W5).

        A stop is sent all the same, because an extra stop does no harm.
        """
        if self.stopping is not _NO_STOP:
            return ""
        if self.is_orphan:
            return "its controller gave up on it"
        if now_ns > self.given_up_ns:
            return "it waited longer than its controller's timeout_ms"
        return ""


class Transactions:
    """The transactions of one line: only this class changes their phase, sends them and ends them.

    Args:
        counters: of the line.
        on_event: called with each event.
        lose: records what a request that was never sent would have written (``ownership``).
        unit_of: the register map of a unit id.
        link: the link to the drives.
        tap: sees the traffic.
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
        self._late: Reports[str] = Reports(NS_PER_S)
        self._arrived_ns = 0
        """When the newest request arrived."""
        self.current: Transaction | None = None
        """The transaction on the wire: it is being forwarded, or its reply has not come."""

    def free_wire(self) -> Transaction | None:
        """Clear the wire; return what was on it."""
        current, self.current = self.current, None
        return current

    def come(
        self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int
    ) -> Transaction:
        """Return the transaction of a request that arrives now."""
        # The arrival time identifies losses (M3), so no two requests have the same.
        arrived_ns = self._arrived_ns = now_ns if now_ns > self._arrived_ns else self._arrived_ns + 1
        transaction = Transaction(port, transaction_id, unit_id, pdu, arrived_ns)
        transaction.follows_ns, port.newest_ns = port.newest_ns, arrived_ns
        return transaction

    def come_whole(self, transaction: Transaction, port: ControllerPort, pdu: bytes, now_ns: int) -> None:
        """A forwarded request has come completely: this is its content."""
        arrived_ns = self._arrived_ns = now_ns if now_ns > self._arrived_ns else self._arrived_ns + 1
        transaction.pdu, transaction.arrived_ns = pdu, arrived_ns
        transaction.early_ns = arrived_ns - transaction.sent_ns
        transaction.frames = None
        transaction.follows_ns, port.newest_ns = port.newest_ns, arrived_ns

    # --- steps -----------------------------------------------------------------------------------------

    def go_on(self, transaction: Transaction, event: Step | Outcome) -> bool:
        """Take a step of :data:`PHASE_AFTER`; return whether it exists. If not, nothing has changed."""
        after = PHASE_AFTER[transaction.phase].get(event)
        if after is None:
            self.report_fault(sentence_of("transaction", transaction.phase, event))
            return False
        transaction.phase = after
        return True

    def begin(self, transaction: Transaction) -> bool:
        """Give the line to a request whose forwarding begins; return whether it may.

        ``cut_through`` watches its deadline.
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
        """Send a frame or a piece of one: all bytes of requests are sent here. Return whether it was sent.

        Args:
            transaction: for which it is sent; it is then the one on the wire.
            step: its own frame, a prerequisite, or a piece of its own frame.
            unit_id: of the frame.
            pdu: of the frame; with the last piece, the complete PDU.
            now_ns: when.
            patience_ns: how long its reply is awaited.
            piece: the bytes to send, if it is a piece.
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
        if unit_id != BROADCAST_UNIT_ID or not self._link.is_serial:  # a broadcast has no reply
            self.current = transaction
        self._link.send_request(unit_id, pdu)
        return True

    def stop_goes_on(self, stop: Transaction, event: StopEvent) -> None:
        """Take a step of :data:`STOP_AFTER` with the transaction itself."""
        after = self._after_stop(stop, event)
        if after is not None:
            stop.stopping = after

    def replace(self, before: Transaction, stop: Transaction) -> None:
        """Replace an equal waiting stop, which may have been sent early and not answered."""
        if before.stopping is Stopping.AGAIN:
            self.stop_goes_on(stop, StopEvent.REPLACES)

    def once_more(self, stop: Transaction) -> Transaction | None:
        """Return the same stop, to be sent once more when no late frame can come instead of its reply.

        None: it must not be sent again (:data:`STOP_AFTER`).
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
        """Report an impossible event: a bug of this program."""
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
        """End a transaction: answer its controller, and apply the end to its axes.

        Args:
            transaction: what ends.
            outcome: how.
            now_ns: when.
            code: exception code that its controller gets, or would get, if its drive did not answer.
            reply: of its drive.
            answer: how its controller is answered if there is no reply.
            withdrawn: why it was withdrawn; "": it was not.
            loss: how its content is lost if it was never sent (M3). None: nothing counts as lost.
        """
        if not self.go_on(transaction, outcome):
            if transaction.phase is Phase.ENDED:
                return
            # The safest: a request that was sent may have been executed or not.
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
            self._finish_requests(transaction, outcome, code, now_ns)
        if answer is not Answer.NOTHING:
            self._answer(transaction, code, answer, now_ns)

    def refuse(
        self, transaction: Transaction, code: int, now_ns: int, *, loss: Loss | None = Loss.DENIED
    ) -> None:
        """Refuse a request that might have moved something: it never reached the drive (M3)."""
        self.finish(transaction, Outcome.NEVER_SENT, now_ns, code=code, answer=Answer.REFUSAL, loss=loss)

    def refuse_absent(self, transaction: Transaction, now_ns: int) -> None:
        """Answer that there is no link to the drives (W7)."""
        code = ExceptionCode.GATEWAY_PATH_UNAVAILABLE
        self.finish(transaction, Outcome.NEVER_SENT, now_ns, code=code, answer=Answer.ABSENCE)

    def never_left(self, transaction: Transaction, now_ns: int) -> None:
        """End a request whose forwarding was aborted.

        Nothing is lost: if the rest of it comes, it is handled as a request that was not forwarded.
        """
        self.finish(transaction, Outcome.NEVER_SENT, now_ns, loss=None)

    def withdraw(self, transaction: Transaction, why: str, now_ns: int) -> None:
        """End a request that its controller does not wait for any more (W5)."""
        self.finish(transaction, Outcome.NEVER_SENT, now_ns, code=LOST, withdrawn=why, loss=Loss.WITHDRAWN)

    def overtaken(self, transaction: Transaction, why: str, now_ns: int) -> None:
        """Withdraw what a stop has overtaken; its controller still waits, and gets an exception (M3)."""
        code = ExceptionCode.SERVER_DEVICE_BUSY
        self.finish(transaction, Outcome.NEVER_SENT, now_ns, code=code, answer=Answer.REFUSAL, withdrawn=why)

    def reply(self, transaction: Transaction, pdu: bytes, now_ns: int) -> None:
        """Send the controller its reply, if it still waits for one."""
        port = transaction.port
        if port is None or transaction.is_orphan:
            return
        if port.is_serial and now_ns > transaction.given_up_ns:
            self._report_late(port.name, now_ns)
            return
        if not (port.is_serial and transaction.unit_id == BROADCAST_UNIT_ID):  # a broadcast has no reply
            if self._tap is not None:
                self._tap.answered(port, transaction.transaction_id, transaction.unit_id, pdu)
            port.send_reply(transaction.transaction_id, transaction.unit_id, pdu)

    def _pass_back(
        self, transaction: Transaction, outcome: Outcome, code: int, reply: bytes, now_ns: int
    ) -> None:
        """Send the controller a drive's reply, and apply what it proves.

        The controller waits, so the reply is sent as early as possible: before the new state of the axis is
        computed. If the same frame also reads positions, that state comes first, because it converts them
        back.
        """
        self._counters.count_reply(reply)
        requests = transaction.requests
        if not requests:
            self.reply(transaction, reply, now_ns)
            unit = self._unit_of(transaction.unit_id)
            observe_discrete(unit, transaction.pdu, reply, transaction.sent_ns)
            return
        if transaction.is_by_alias:
            self.reply(transaction, reply, now_ns)
            self._finish_requests(transaction, outcome, code, now_ns)
            return
        is_acknowledged = outcome is Outcome.ACKNOWLEDGED
        for request in requests:
            is_read = request.reads_too
            if is_acknowledged and is_read:
                finish(request, outcome, code, now_ns)
                self.reply(transaction, nominal_reply(request, reply), now_ns)
            else:
                passed = reply_without_positions(request, reply, is_acknowledged=is_acknowledged)
                self.reply(transaction, passed, now_ns)
                finish(request, outcome, code, now_ns)
            if is_read:
                self._counters.unmapped_reads += request.reads_unmapped

    def _finish_requests(self, transaction: Transaction, outcome: Outcome, code: int, now_ns: int) -> None:
        """Apply the end of a transaction to the axes of each unit that it may have reached."""
        if transaction.is_by_alias:
            outcome = Outcome.BROADCAST  # each drive may have executed it or not, whichever has answered
        for request in transaction.requests:
            finish(request, outcome, code, now_ns)

    def _answer(self, transaction: Transaction, code: int, answer: Answer, now_ns: int) -> None:
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
            self.reply(transaction, exception_pdu(transaction.pdu[0], code), now_ns)

    def _report_late(self, name: str, now_ns: int) -> None:
        """Report a reply that an RTU controller would take for the reply to its next request (W6)."""
        if count := self._late.due(name, now_ns):
            late = f"a reply came after timeout_ms of {name} and was not passed on{times(count)}"
            self._on_event(Event(exchange_events.LATE_REPLY, None, late))

    def _count_withdrawn(self, transaction: Transaction, why: str, now_ns: int) -> None:
        """Count it; report one for each controller and reason in a second, with their number."""
        self._counters.withdrawn += 1
        if transaction.port is None:
            return
        name = transaction.port.plan.name
        if count := self._withdrawals.due((name, why), now_ns):
            detail = f"a request of {name} was not sent: {why}{times(count)}"
            self._on_event(Event(exchange_events.WITHDRAWN, None, detail))


def outcome_of_reply(transaction: Transaction, reply: bytes) -> tuple[Outcome, int]:
    """Return the outcome of a transaction with this reply, and its exception code."""
    for request in transaction.requests:
        return outcome_of(request, reply)
    return (Outcome.EXCEPTION, reply[-1]) if is_exception(reply) else (Outcome.ACKNOWLEDGED, 0)
