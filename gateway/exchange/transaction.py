"""One request from its arrival to its end: why nothing is sent twice, and what each end leaves behind.

A :class:`Transaction` is in one :class:`Phase`, and goes from one to the next only as :data:`PHASE_AFTER`
says. That is asserted at each step but the two usual ones, which stand in it (a test walks them all). Its
own frame leaves once: a frame may leave only from ``WAITING`` (:meth:`Transaction.leave`, asked by the line
in the one place where frames leave), and no phase leads back to ``WAITING`` from ``SENT``. A prerequisite,
which the gateway adds, may come before it, as often as it takes; each is another frame. What leaves while
it still arrives (``LEAVING``) is no frame before its check sum has left: until then it ends as if it had
never been sent, spoilt so that no drive takes it for one (``cut_through``).

A transaction ends once, in :meth:`Endings.finish`, with one :class:`~gateway.exchange.axis.events.Outcome`;
one that went the fast path and was answered as usual ends in ``LineExchange.reply``, in the same steps.
Which outcomes an end may have follows from the phase (:data:`OUTCOMES`): what never left cannot have been
acknowledged, and what left cannot be withdrawn.
"""

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Final

from gateway.compensation.readback import Readback
from gateway.compiled import mypyc_attr
from gateway.exchange.access import only_reads
from gateway.exchange.added_frames import AddedFrame
from gateway.exchange.axis.acknowledge import Outcome, Rendering, SteadyTarget
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.registers import Loss
from gateway.exchange.counters import LineCounters
from gateway.exchange.decode import Frame
from gateway.exchange.effects import finish
from gateway.exchange.events import Event, EventKind
from gateway.exchange.ports import ControllerPort
from gateway.exchange.reply import note_discrete, outcome_of, reply_without_positions, turned_back
from gateway.exchange.request import Known, Request
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
    """Bytes of its own frame have left while it still arrives: it is no frame before its check sum has."""
    SENT = "sent"
    """Its own frame has left."""
    ENDED = "ended"
    """Its outcome is known, and nothing leaves for it any more."""


PHASE_AFTER: Final = {
    Phase.WAITING: frozenset({Phase.PREREQUISITE, Phase.LEAVING, Phase.SENT, Phase.ENDED}),
    Phase.PREREQUISITE: frozenset({Phase.WAITING, Phase.ENDED}),
    Phase.LEAVING: frozenset({Phase.SENT, Phase.ENDED}),
    Phase.SENT: frozenset({Phase.ENDED}),
    Phase.ENDED: frozenset(),
}
"""Where each phase may lead."""

OUTCOMES: Final = {
    Phase.WAITING: frozenset({Outcome.NEVER_SENT}),
    Phase.PREREQUISITE: frozenset({Outcome.NEVER_SENT}),
    Phase.LEAVING: frozenset({Outcome.NEVER_SENT}),
    Phase.SENT: frozenset(set(Outcome) - {Outcome.NEVER_SENT}),
    Phase.ENDED: frozenset(),
}
"""How a transaction may end in each phase."""


class Stopping(Enum):
    """Whether a transaction stops an axis, and how often it leaves for that."""

    __hash__ = object.__hash__

    NO = "no"
    """It stops nothing, or it left at once, as it came."""
    FIRST = "first"
    """It goes before everything else, on a resting line too, and is never given up."""
    EARLY = "early"
    """It left although a late frame might come: only its exact echo is an answer."""
    AGAIN = "again"
    """Sent early before and not answered: it goes once more, when no late frame can come."""
    ONCE = "once"
    """It does more than stop, which must not be done twice: it goes first, when no late frame can come."""


STOP_AFTER: Final = {
    Stopping.NO: frozenset({Stopping.FIRST, Stopping.ONCE}),
    Stopping.FIRST: frozenset({Stopping.EARLY, Stopping.AGAIN}),
    Stopping.EARLY: frozenset(),
    Stopping.AGAIN: frozenset({Stopping.AGAIN}),
    Stopping.ONCE: frozenset(),
}
"""Where each may lead. What follows one that was sent early is another transaction."""

_WAITING: Final = Phase.WAITING  # a member is looked up slowly, and these are asked for with each request
_PREREQUISITE: Final = Phase.PREREQUISITE
_LEAVING: Final = Phase.LEAVING
_SENT: Final = Phase.SENT
_ENDED: Final = Phase.ENDED
_NO_STOP: Final = Stopping.NO
_ACKNOWLEDGED: Final = Outcome.ACKNOWLEDGED


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
    """So long its own frame had been leaving when all of it had come (``cut_line``)."""
    excused_ns = 0
    """How much of that no deadline counts: a look at where the axis stands."""
    follows_ns = 0
    """When the request before it came on the same connection."""
    is_orphan = False
    """Its controller has gone or gone on, or has heard a reply while that still arrived (``cut_line``): what
    comes is taken note of and then dropped."""
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
    frames: tuple[Frame, ...] | None = None
    """What its bytes say to each unit that it reaches, as soon as that was asked for."""
    known: Known | None = None
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

    def follow(self, port: ControllerPort) -> None:
        """Note the request before it on the same connection."""
        self.follows_ns, port.newest_ns = port.newest_ns, self.arrived_ns

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

    def note_frames(self, frames: tuple[Frame, ...]) -> None:
        """Note what its bytes say."""
        self.frames = frames

    def note_requests(self, requests: tuple[Request, ...]) -> None:
        """Note what is sent for it."""
        self._requests = requests

    def knowledge(self) -> Known:
        """Return what was read for it, to be added to."""
        if self.known is None:
            self.known = Known()
        return self.known

    def become_stop(self, *, only_stops: bool = True) -> None:
        """Note that it stops an axis: it goes before everything else, and is never given up.

        ``only_stops``: it does nothing else, and may leave twice.
        """
        self._stop_goes_on(Stopping.FIRST if only_stops else Stopping.ONCE)

    def become_odd(self) -> None:
        """Note that it is an odd frame: it counts as a write."""
        self.is_odd = True

    def deny(self) -> None:
        """Note that it has no room, and is refused in its turn."""
        self.is_denied = True

    def leave_early(self) -> None:
        """Note that it is a stop, and that a late frame may come in the place of its reply."""
        self._stop_goes_on(Stopping.EARLY)

    def become_again(self, before: "Transaction") -> None:
        """Take the place of the same stop, which may have been sent early and not answered."""
        if before.stopping is Stopping.AGAIN and self.stopping is not Stopping.ONCE:
            self._stop_goes_on(Stopping.AGAIN)

    def once_more(self) -> "Transaction":
        """Return the same stop, to go once more when no late frame can come in the place of its reply."""
        again = Transaction(self.port, self.transaction_id, self.unit_id, self.pdu, self.arrived_ns)
        again.become_stop()
        again._stop_goes_on(Stopping.AGAIN)
        if self.is_orphan:
            again.give_up()
        return again

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

    # --- phases ----------------------------------------------------------------------------------------

    def start(self, now_ns: int) -> None:
        """Note that it is its turn: after it waited for the line, or for a frame that goes first."""
        if self.added is not None or self.known is not None:
            self.added_ns += now_ns - (self.started_ns or self.arrived_ns)
        else:
            self.queue_ns = now_ns - self.arrived_ns
        self.started_ns = now_ns

    def need(self, frame: AddedFrame | None) -> None:
        """Note which frame of the gateway's own it needs first; None: none any more."""
        self.added = frame

    def begin_anew(self) -> None:
        """Something else goes first: what it needs is found out anew when its turn comes, and read again."""
        self.known = Known()

    def carry(self, path: FastPath, target: SteadyTarget) -> None:
        """Note the target that it carries on a fast path."""
        self.path, self.target = path, target

    def take(self, path: FastPath) -> None:
        """Note the fast path on which it leaves."""
        self.path = path

    def note_readbacks(self, readbacks: Sequence[Readback | None]) -> None:
        """Note how the positions that it reads on a fast path are turned back."""
        self.readbacks = readbacks

    def lead(self) -> None:
        """The first bytes of its own frame leave, while it still arrives. It has a deadline elsewhere."""
        self._go_on(_LEAVING)
        self.sent_ns = self.arrived_ns
        self.deadline_ns = NEVER_NS

    def arrive(self, pdu: bytes, arrived_ns: int) -> None:
        """All of it has come while it was leaving: this is what it says."""
        assert self.phase is _LEAVING
        self.pdu, self.arrived_ns, self.early_ns = pdu, arrived_ns, arrived_ns - self.sent_ns
        self.frames = None

    def leave(self, now_ns: int, unit_id: int, patience_ns: int) -> None:
        """A frame leaves for it now: its own, which does so once, or one that it needs first.

        One that leaves while it arrives does so with its check sum.
        """
        if self.added is None and self.phase is _WAITING:
            self.phase = _SENT  # as ``_go_on`` would, without looking the usual step up
        else:
            self._go_on(_SENT if self.added is None or self.port is None else _PREREQUISITE)
        self.sent_ns = now_ns
        self.wire_unit_id = unit_id
        self.deadline_ns = now_ns + patience_ns

    def learn(self) -> None:
        """What it needed first was answered: it waits for its turn again."""
        self._go_on(_WAITING)

    def _go_on(self, phase: Phase) -> None:
        assert phase in PHASE_AFTER[self.phase], f"from phase {self.phase.value} to {phase.value}"
        self.phase = phase

    def _stop_goes_on(self, stopping: Stopping) -> None:
        assert stopping in STOP_AFTER[self.stopping], f"a stop from {self.stopping.value} to {stopping.value}"
        self.stopping = stopping

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

    def end(self, outcome: Outcome) -> None:
        """It ends, once, in a way that is possible in its phase."""
        if self.phase is _SENT and outcome is _ACKNOWLEDGED:
            self.phase = _ENDED  # the usual step, as above
            return
        assert outcome in OUTCOMES[self.phase], f"{outcome.value} in phase {self.phase.value}"
        self._go_on(_ENDED)

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


class Endings:
    """How the transactions of a line end.

    Args:
        counters: of the line.
        on_event: hears what is worth a word.
        lose: notes what a request that never left would have written (``ownership``).
        unit_of: the register map of a unit id.
        tap: listens.
    """

    def __init__(
        self,
        counters: LineCounters,
        on_event: Callable[[Event], None],
        lose: Callable[[Transaction, int, Loss], None],
        unit_of: Callable[[int], UnitMap | None],
        tap: Tap | None = None,
    ) -> None:
        self._tap = tap
        self._counters = counters
        self._on_event = on_event
        self._lose = lose
        self._unit_of = unit_of
        self._withdrawals: Reports[tuple[str, str]] = Reports(NS_PER_S, others=others_of_pairs)

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
        transaction.end(outcome)
        if outcome is Outcome.NEVER_SENT:
            if loss is not None and transaction.port is not None and not transaction.only_reads:
                self._lose(transaction, code, loss)
            if withdrawn:
                self._note_withdrawn(transaction, withdrawn, now_ns)
        elif reply:
            self._pass_back(transaction, outcome, code, reply, now_ns)
        else:
            for request in transaction.requests:
                finish(request, outcome, code, now_ns)
        if answer is not Answer.NOTHING:
            self._answer(transaction, code, answer)

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
        self._counters.note_reply(reply)
        requests = transaction.requests
        if not requests:
            self.reply(transaction, reply)
            unit = self._unit_of(transaction.unit_id)
            note_discrete(unit, transaction.pdu, reply, transaction.sent_ns)
            return
        is_acknowledged = outcome is Outcome.ACKNOWLEDGED
        for request in requests:
            is_read = request.reads_too
            if is_acknowledged and is_read:
                finish(request, outcome, code, now_ns)
                self.reply(transaction, turned_back(request, reply))
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
            self._counters.note_refusal(None if port is None else port.plan.name)
        is_absent = answer is Answer.ABSENCE or (
            answer is Answer.DENIAL and code == ExceptionCode.GATEWAY_PATH_UNAVAILABLE
        )
        if not (is_absent and (port is None or port.is_serial)):
            self.reply(transaction, exception_pdu(transaction.pdu[0], code))

    def _note_withdrawn(self, transaction: Transaction, why: str, now_ns: int) -> None:
        """Count it; tell of one for each controller and reason in a second, and how many there were."""
        self._counters.withdrawn += 1
        if transaction.port is None:
            return
        name = transaction.port.plan.name
        if count := self._withdrawals.due((name, why), now_ns):
            detail = f"a request of {name} was not sent: {why}{times(count)}"
            self._on_event(Event(EventKind.WITHDRAWN, None, detail))


def outcome_of_reply(transaction: Transaction, reply: bytes) -> tuple[Outcome, int]:
    """Return how a transaction ends that its drive replied to, and the exception code that stands for it."""
    for request in transaction.requests:
        return outcome_of(request, reply)
    return (Outcome.EXCEPTION, reply[-1]) if is_exception(reply) else (Outcome.ACKNOWLEDGED, 0)
