"""Silent and dead unit ids of a line: what they delay, and which requests the gateway answers (W6, W11).

A unit id is silent from the first request that it left unanswered until its next frame. After three in a row
it is *dead*: it gets only a trial from time to time, and the gateway itself answers its requests.
:class:`Reach` says how far a unit id is from answering. It changes only as :data:`REACH_AFTER` says, and only
in its :class:`Silence`.

On a serial line a late reply would answer the next request. So the silent unit gets no request until
``drain_ms`` have passed without a frame from it. :meth:`SilentUnits.free_ns` says which other units may get
one in that time. The time is over only when :meth:`SilentUnits.settle` says so: bytes that came while the
process was suspended have been read by then.

A drive that answers costs one store, and one check whether anything on its line is silent.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from librt.vecs import vec
from mypy_extensions import i64

from gateway.catalogue import exchange_events
from gateway.exchange.added_frames import trial_read
from gateway.exchange.axis.acknowledge import Outcome
from gateway.exchange.axis.axis import Axis
from gateway.exchange.dispatch import UnitMaps, is_acting_on
from gateway.exchange.events import Event
from gateway.exchange.plan import LineTiming
from gateway.exchange.queue import WaitingQueue
from gateway.exchange.rest import LONGEST_DRAIN
from gateway.exchange.transaction import NO_RESPONSE, Answer, Transaction, Transactions
from gateway.modbus.pdu import BROADCAST_UNIT_ID
from gateway.status.line import UnitStatus
from gateway.times import NS_PER_MS, NS_PER_S

UNIT_IDS: Final = 0x100
LONGEST_RETRY_NS: Final = 10 * NS_PER_S
"""Longest time between two trials: a drive that was switched on again waits no longer."""
LATE_FOR_NS: Final = 600 * NS_PER_S
"""How long a unit that was late counts as such: the complete line waits after each of its time-outs."""
UNASKED_AT_MOST: Final = 2
"""Number of requests in one silence that the gateway answers without sending them; the next read waits and is
sent late."""
MOST_STOPS: Final = 16
"""Different stops of one silent unit that are distinguished; all others count as new."""


class Reach(Enum):
    """How far a unit id is from answering."""

    __hash__ = object.__hash__

    ANSWERS = "answers"
    """It left nothing unanswered since its last frame, or was not polled yet."""
    UNHEARD = "unheard"
    """It was silent when the link was lost or came up, and was not polled since."""
    MISSED_ONE = "missed-one"
    """It left one request unanswered since its last frame."""
    MISSED_TWO = "missed-two"
    """Two in a row."""
    DEAD = "dead"
    """Three in a row, or more."""


class Sign(Enum):
    """What is observed of a unit id."""

    __hash__ = object.__hash__

    TIME_OUT = "time-out"
    """A request was not answered, or a converter answered that (0x0A, 0x0B)."""
    FRAME = "frame"
    """A complete frame of it came: an answer, an exception, or a late frame."""
    LINK_UP = "link-up"
    """The link to the drives came up."""


REACH_AFTER: Final[dict[tuple[Reach, Sign], Reach]] = {
    (Reach.ANSWERS, Sign.TIME_OUT): Reach.MISSED_ONE,
    (Reach.UNHEARD, Sign.TIME_OUT): Reach.MISSED_ONE,
    (Reach.MISSED_ONE, Sign.TIME_OUT): Reach.MISSED_TWO,
    (Reach.MISSED_TWO, Sign.TIME_OUT): Reach.DEAD,
    (Reach.DEAD, Sign.TIME_OUT): Reach.DEAD,
    (Reach.ANSWERS, Sign.FRAME): Reach.ANSWERS,
    (Reach.UNHEARD, Sign.FRAME): Reach.ANSWERS,
    (Reach.MISSED_ONE, Sign.FRAME): Reach.ANSWERS,
    (Reach.MISSED_TWO, Sign.FRAME): Reach.ANSWERS,
    (Reach.DEAD, Sign.FRAME): Reach.ANSWERS,
    (Reach.ANSWERS, Sign.LINK_UP): Reach.ANSWERS,
    (Reach.UNHEARD, Sign.LINK_UP): Reach.UNHEARD,
    (Reach.MISSED_ONE, Sign.LINK_UP): Reach.UNHEARD,
    (Reach.MISSED_TWO, Sign.LINK_UP): Reach.UNHEARD,
    (Reach.DEAD, Sign.LINK_UP): Reach.UNHEARD,
}
"""The reach after each sign."""


@dataclass(slots=True)
class Silence:
    """What a unit id has left unanswered since its last frame, and how long that counts."""

    unit_id: int
    reach: Reach = Reach.ANSWERS
    since_ns: int = 0
    """When the first unanswered request was sent."""
    timeouts: int = 0
    """Number of time-outs in a row."""
    missed_ns: int = 0
    """Time of the last of them."""
    absences: int = 0
    """Number of requests since its last frame that its converter answered in its place."""
    quiet_ns: int = 0
    """Until when a late frame of it may come; 0: none may."""
    quiet_at_last_ns: int = 0
    """No late frame extends the wait beyond this time."""
    late_reply_until_ns: int = 0
    """Until when an early stop may still be answered; before that only stops are sent."""
    unasked: int = 0
    """Number of requests that the gateway answered in its place in this silence, because they could only have
    been sent too late; counted up to ``UNASKED_AT_MOST``."""
    due_ns: int = 0
    """While it is dead: time of the next trial."""
    retry_ns: int = 0
    """Pause before the next trial, counted from the last one."""
    first_retry_ns: int = 0
    """The pause before the first trial, however long it has been dead."""
    odd_due_ns: int = 0
    """While it is dead: earliest time for an odd frame."""
    stops: dict[bytes, int] = field(default_factory=dict)
    """Stops that it did not answer, each with the time from which the same may be sent again."""
    unserved_ports: set[int] = field(default_factory=set)
    """Controllers that get a transaction before the next of these stops; see ``Scheduler``."""

    def miss(self, sent_ns: int, now_ns: int, drain_ns: int, first_retry_ns: int) -> None:
        """A request that was sent at ``sent_ns`` was not answered."""
        if self.reach is Reach.ANSWERS:
            self.since_ns = sent_ns
        self.timeouts += 1
        self.missed_ns = now_ns
        was_dead = self.reach is Reach.DEAD
        self.reach = REACH_AFTER[self.reach, Sign.TIME_OUT]
        if drain_ns:
            self.quiet_ns = now_ns + drain_ns
            self.quiet_at_last_ns = now_ns + LONGEST_DRAIN * drain_ns
        self.retry_ns = min(2 * self.retry_ns, LONGEST_RETRY_NS) if was_dead else first_retry_ns
        self.first_retry_ns = first_retry_ns
        self.due_ns = max(now_ns + self.retry_ns, self.quiet_ns)
        self.odd_due_ns = max(now_ns + first_retry_ns, self.quiet_ns)

    def mark_alive(self) -> Reach:
        """A complete frame of it came; return its reach before."""
        before, self.reach = self.reach, REACH_AFTER[self.reach, Sign.FRAME]
        self.timeouts = self.absences = 0
        self.stops.clear()
        self.unserved_ports.clear()
        return before

    def be_late(self, now_ns: int, drain_ns: int) -> None:
        """A late frame of it came: the required silence begins again."""
        self.quiet_ns = min(now_ns + drain_ns, self.quiet_at_last_ns)
        self.due_ns = max(self.due_ns, self.quiet_ns)
        self.odd_due_ns = max(self.odd_due_ns, self.quiet_ns)

    @property
    def ends_ns(self) -> int:
        """Until when it gets nothing but stops; 0: no frame of it is pending."""
        return max(self.late_reply_until_ns, self.quiet_ns)

    def link_up(self) -> None:
        """The link came up: it is polled again, and no late frame is pending."""
        self.reach = REACH_AFTER[self.reach, Sign.LINK_UP]
        self.quiet_ns = self.late_reply_until_ns = 0
        self.stops.clear()
        self.unserved_ports.clear()

    def settle(self, now_ns: int) -> None:
        """It has been quiet until now."""
        if self.quiet_ns <= now_ns:
            self.quiet_ns = 0
        if self.late_reply_until_ns <= now_ns:
            self.late_reply_until_ns = 0
        if not self.ends_ns:
            self.unasked = 0

    def try_again(self, now_ns: int) -> None:
        """A trial is sent now: until it answers, nothing else is sent to it."""
        self.due_ns = now_ns + self.retry_ns
        self.odd_due_ns = now_ns + self.first_retry_ns

    def due_for(self, *, is_odd: bool) -> int:
        """Return the time of its next trial with a request.

        The effect of an odd frame is unknown: it may stop a spindle. So it never waits longer than for the
        first trial.
        """
        return self.odd_due_ns if is_odd else self.due_ns

    def miss_stop(self, pdu: bytes, until_ns: int, unserved_ports: set[int]) -> None:
        """It did not answer a stop, which may be sent again from ``until_ns`` on, after those that wait."""
        if len(self.stops) >= MOST_STOPS:
            self.stops.clear()
        self.stops[pdu] = until_ns
        self.unserved_ports = unserved_ports


class SilentUnits:
    """The silent unit ids of one line.

    Args:
        timing: of the line.
        units: the register maps of the line.
        waiting: the queue of the line.
        transactions: of the line; a request that is answered here ends there.
        on_event: called with each event.
        report: reports what is new about some axes.
        is_serial: replies carry no number (W6).
    """

    def __init__(
        self,
        timing: LineTiming,
        units: UnitMaps,
        waiting: WaitingQueue,
        transactions: Transactions,
        *,
        on_event: Callable[[Event], None],
        report: Callable[[tuple[Axis, ...]], None],
        is_serial: bool,
    ) -> None:
        self._units = units
        self._waiting = waiting
        self._transactions = transactions
        self._on_event = on_event
        self._report = report
        self._drain_ns = int((timing.drain_ms or timing.response_timeout_ms) * NS_PER_MS) * is_serial
        self._retry_ns = int(timing.retry_ms * NS_PER_MS)
        self._response_timeout_ns = int(timing.response_timeout_ms * NS_PER_MS)
        self.backs_off = timing.backs_off
        """Whether dead units get no requests except trials."""
        self.answered_ns = vec[i64]([0] * UNIT_IDS)
        """When each unit id answered last; 0: never. For the status."""
        self.askers: set[tuple[str, int]] = set()
        """Controllers, each with a unit id that did not answer it or is unknown. For the status."""
        self.silences: dict[int, Silence] = {}
        """Unit ids that are silent, or of which a late frame may come; while there are any, the slow path is
        used."""
        self._late_ns: dict[int, int] = {}
        """Unit ids that were ever late, with the last time."""

    # --- observations ----------------------------------------------------------------------------------

    def miss(self, unit_id: int, sent_ns: int, now_ns: int) -> tuple[Silence, bool]:
        """Record an unanswered request; return its unit id's silence, and whether the unit is dead now.

        ``may_answer_late``: not after a converter has answered in the place of the unit.
        """
        silence = self._silence_of(unit_id)
        was_dead = silence.reach is Reach.DEAD
        silence.miss(sent_ns, now_ns, self._drain_ns, self._retry_ns)
        return silence, silence.reach is Reach.DEAD and not was_dead

    def miss_behind_converter(self, unit_id: int, sent_ns: int, now_ns: int) -> tuple[bool, bool]:
        """Record that a converter answered in the place of a unit; return whether it is silent, or dead, now.

        No late reply follows. A converter may answer immediately, so one such answer counts in each
        ``response_timeout_ms``: the unit is dead no sooner than after time-outs.
        """
        silence = self._silence_of(unit_id)
        silence.absences += 1
        is_new = silence.reach is Reach.ANSWERS
        if not is_new and now_ns - silence.missed_ns < self._response_timeout_ns:
            return False, False
        was_dead = silence.reach is Reach.DEAD
        silence.miss(sent_ns, now_ns, 0, self._retry_ns)
        return is_new, silence.reach is Reach.DEAD and not was_dead

    def _silence_of(self, unit_id: int) -> Silence:
        silence = self.silences.get(unit_id)
        if silence is None:
            silence = self.silences[unit_id] = Silence(unit_id)
        return silence

    def mark_alive(self, unit_id: int, now_ns: int) -> None:
        """Record a complete frame of a unit id, while something on the line is silent."""
        silence = self.silences.get(unit_id)
        if silence is None:
            return
        before = silence.mark_alive()
        self._forget(silence)
        if before is Reach.ANSWERS:
            return
        self._on_event(Event(exchange_events.DRIVE_ANSWERS, None, f"unit id {unit_id}"))
        if before is Reach.DEAD:  # it was not polled, so it is unknown since when it is back
            axes = self._units.axes_of(unit_id)
            for axis in axes:
                axis.end_silence(is_answer=True, until_ns=now_ns)
            self._report(axes)

    def disturb(self, unit_id: int, now_ns: int) -> bool:
        """Record bytes that answer nothing; return whether a silence that something waits for begins again.

        ``unit_id``: of the complete frame in them; below 0: there is none, and they may be of any unit with a
        pending answer. The frame was late, or was recognised too late; this is remembered for its unit.
        """
        if unit_id >= 0:
            self._late_ns[unit_id] = now_ns
        is_awaited = False
        for silence in self.silences.values():
            if silence.ends_ns and unit_id in (silence.unit_id, -1):
                is_awaited = True
                self._late_ns[silence.unit_id] = now_ns
                silence.be_late(now_ns, self._drain_ns)
        return is_awaited

    def expect_late_reply(self, unit_id: int, until_ns: int) -> None:
        """A stop was given up before its drive had time to answer: the answer may come until then (W6)."""
        if not self._drain_ns:
            return
        silence = self._silence_of(unit_id)
        silence.late_reply_until_ns = max(silence.late_reply_until_ns, until_ns + self._drain_ns)

    def link_up(self) -> None:
        """The link is up: silent units are polled again, and ``Rest`` waits for late replies."""
        for silence in self.silences.values():
            silence.link_up()
        self.settle(0)

    def settle(self, now_ns: int) -> None:
        """End the waits that are over; called after the input was read."""
        for silence in tuple(self.silences.values()):
            silence.settle(now_ns)
            self._forget(silence)

    def _forget(self, silence: Silence) -> None:
        if silence.reach is Reach.ANSWERS and not silence.ends_ns:
            del self.silences[silence.unit_id]

    # --- effect on other requests ----------------------------------------------------------------------

    def dead(self, unit_id: int) -> Silence | None:
        """Return the silence because of which a unit id gets no requests; None: it gets requests.

        It is its own silence, or that of a unit of its group: the one with the latest trial.
        """
        found: Silence | None = None
        if self.backs_off and self.silences:
            for each in self._units.partners(unit_id):
                silence = self.silences.get(each)
                if silence is not None and silence.reach is Reach.DEAD:
                    found = silence if found is None or silence.due_ns > found.due_ns else found
        return found

    def free_ns(self, unit_id: int, now_ns: int, *, is_read: bool, is_stop: bool = False) -> int:
        """Return until when a request to a unit id waits for late frames, later than now; 0: no wait.

        A late frame of another unit does not answer this one, but may collide with its answer on the wire.
        Only a read takes this risk, and only with a unit that was never late in the last ten minutes. A dead
        unit that was never late is no risk. ``is_stop``: a stop does not wait for the late answer of an early
        stop; that one is sent once more behind it.
        """
        until_ns = 0
        for silence in self.silences.values():
            quiet_ns = silence.quiet_ns if is_stop else silence.ends_ns
            if quiet_ns <= until_ns:
                continue
            if silence.unit_id != unit_id:
                late_ns = self._late_ns.get(silence.unit_id)
                if late_ns is None and (is_read or silence.reach is Reach.DEAD):
                    continue
                if is_read and late_ns is not None and now_ns - late_ns >= LATE_FOR_NS:
                    continue
            until_ns = quiet_ns
        return max(until_ns, now_ns + 1) if until_ns else 0

    @property
    def quiet_ns(self) -> int | None:
        """When the first pending silence ends; None: no late frame is pending."""
        ends = [
            ns for each in self.silences.values() for ns in (each.quiet_ns, each.late_reply_until_ns) if ns
        ]
        return min(ends, default=None)

    @property
    def awaits_late_reply(self) -> bool:
        """Whether a late frame may come from any unit."""
        return self.quiet_ns is not None

    @property
    def last_answered_ns(self) -> int:
        """When any unit id answered last; 0: never."""
        return max(self.answered_ns)

    def awaits_late_reply_of(self, unit_id: int) -> bool:
        """Whether a late frame may come from a unit id."""
        silence = self.silences.get(unit_id)
        return silence is not None and silence.ends_ns > 0

    # --- too late to send ------------------------------------------------------------------------------

    def is_too_late(self, transaction: Transaction, now_ns: int) -> bool:
        """Whether a request is answered here because it could only be sent too late (W6).

        This concerns requests that wait for the late frames of their own unit id, not of another one, and not
        for the rest of the line. Never a stop, a read of the gateway, or a possible trial of a dead unit.

        The end of the silence counts. For a write the present time counts too: a process that was suspended
        comes late to that end. The next read after :data:`UNASKED_AT_MOST` such answers is never too late. It
        polls the unit, so no controller fails for long without a poll.
        """
        silence = self.silences.get(transaction.unit_id)
        if silence is None or not silence.ends_ns or transaction.port is None or transaction.is_stop:
            return False
        leave_by_ns = transaction.leave_by_ns
        if transaction.only_reads:
            is_too_late = silence.ends_ns > leave_by_ns and silence.unasked < UNASKED_AT_MOST
        else:
            is_too_late = max(silence.ends_ns, now_ns) > leave_by_ns
        return is_too_late and self.dead(transaction.unit_id) is None

    def answer_unasked(self, transaction: Transaction, now_ns: int) -> None:
        """Answer in the place of a drive that got no request: this says nothing about the drive."""
        silence = self.silences[transaction.unit_id]
        silence.unasked = min(silence.unasked + 1, UNASKED_AT_MOST)
        answer = Answer.TOO_LATE
        self._transactions.finish(transaction, Outcome.NEVER_SENT, now_ns, code=NO_RESPONSE, answer=answer)

    def patience_ns(self, transaction: Transaction, unit_id: int, now_ns: int, least_ns: int) -> int:
        """Return how long the reply to a request is awaited while something is silent (W7).

        A read that tries a dead drive (W11) must not delay the others longer than a drive may take. A request
        that was sent late behind a silence has the rest of its controller's time-out. ``least_ns``: the time
        that a drive may take.
        """
        port = transaction.port
        if port is None or transaction.added is not None or port.patience_ns <= least_ns:
            return least_ns
        silence = self.silences.get(unit_id)
        if silence is None or not transaction.only_reads:
            return port.patience_ns
        is_missed = silence.reach is Reach.MISSED_ONE or silence.reach is Reach.MISSED_TWO
        if is_missed and now_ns > transaction.leave_by_ns:
            return max(least_ns, transaction.given_up_ns - now_ns)
        is_dead = silence.reach is Reach.DEAD and self.backs_off
        return least_ns if is_dead else port.patience_ns

    # --- dead units ------------------------------------------------------------------------------------

    def is_answered_for(self, transaction: Transaction, now_ns: int) -> bool:
        """Whether the gateway answers a request because its drive, or one of its group, is dead."""
        dead = self.dead(transaction.unit_id)
        if dead is None:
            return False
        due_ns = dead.due_for(is_odd=transaction.is_odd)
        if now_ns >= due_ns:
            return False
        # An odd request from a serial port waits: nothing of its controller waits behind it.
        port = transaction.port
        waits = transaction.is_odd and port is not None and port.ends_by_silence
        return not waits or due_ns > transaction.leave_by_ns

    def answer_for(self, transaction: Transaction, now_ns: int) -> None:
        """Answer in the place of a dead drive: this counts as unanswered (W11)."""
        answer = Answer.BACK_OFF
        self._transactions.finish(transaction, Outcome.NEVER_SENT, now_ns, code=NO_RESPONSE, answer=answer)
        if transaction.unit_id == BROADCAST_UNIT_ID:
            return
        axes = self._units.axes_of(transaction.unit_id)
        for axis in axes:
            axis.fall_silent(now_ns, now_ns)
        self._report(axes)

    def answer_waiting(self, now_ns: int) -> None:
        """Answer what waits for a unit that is dead now, or could only be sent too late.

        The order of each controller is kept.
        """
        behind: set[int] = set()
        for transaction in tuple(self._waiting):
            port = transaction.port
            if transaction.is_stop or port is None or id(port) in behind:
                continue
            is_denied = transaction.is_denied or bool(transaction.why_given_up(now_ns))
            if is_denied:
                behind.add(id(port))
            elif self.is_answered_for(transaction, now_ns):
                self._waiting.take(transaction)
                self.answer_for(transaction, now_ns)
            elif self.is_too_late(transaction, now_ns):
                self._waiting.take(transaction)
                self.answer_unasked(transaction, now_ns)
            else:
                behind.add(id(port))

    def tries(self, transaction: Transaction, dead: Silence, now_ns: int) -> bool:
        """Use a request as the trial of a dead unit; return False if it was answered instead.

        A request that might move something needs a read first, if one is allowed: the state of the drive is
        unknown. If nothing may be read, the request itself is the trial.
        """
        if now_ns < dead.due_for(is_odd=transaction.is_odd):
            self.answer_for(transaction, now_ns)
            return False
        axes = self._units.axes_of(dead.unit_id)
        is_own = transaction.unit_id == dead.unit_id
        read = None
        if not is_own or is_acting_on(self._units, transaction, axes):
            read = trial_read(axes, dead.absences)
        if read is None and not is_own:
            self.answer_for(transaction, now_ns)
            return False
        dead.try_again(now_ns)
        transaction.added = read
        if read is None:
            for axis in axes:
                axis.end_silence(is_answer=False, until_ns=now_ns)
        return True

    # --- stops -----------------------------------------------------------------------------------------

    def miss_stop(self, unit_id: int, pdu: bytes, unserved_ports: set[int], now_ns: int) -> None:
        """Record an unanswered stop, after :meth:`miss`, and the controllers that wait meanwhile."""
        self.silences[unit_id].miss_stop(pdu, now_ns + self._retry_ns, unserved_ports)

    def thin_out(self, stop: Transaction, now_ns: int) -> None:
        """Of a stop that its drive does not answer, keep only each controller's newest; answer the others."""
        if not self.backs_off:
            return
        newest: dict[int, Transaction] = {}
        older = []
        for each in self._waiting:
            if each.is_same_stop(stop):
                before = newest.get(id(each.port))
                newest[id(each.port)] = each
                if before is not None:
                    older.append(before)
                    self._transactions.replace(before, each)
        for each in older:
            self._waiting.take(each)
            self.answer_for(each, now_ns)

    def note_served(self, port: int) -> None:
        """Record that a controller gets a transaction."""
        for silence in self.silences.values():
            silence.unserved_ports.discard(port)

    # --- status ----------------------------------------------------------------------------------------

    def status(self, unit_id: int, now_ns: int) -> UnitStatus:
        """Return what is known of one unit id: ages in s, null if there is nothing to measure."""
        answered_ns, silence = self.answered_ns[unit_id], self.silences.get(unit_id)
        if silence is not None and silence.reach is Reach.ANSWERS:
            silence = None
        is_dead = silence is not None and silence.reach is Reach.DEAD and self.backs_off
        return UnitStatus(
            answered_s=round((now_ns - answered_ns) / NS_PER_S, 3) if answered_ns else None,
            silent_s=None if silence is None else round((now_ns - silence.since_ns) / NS_PER_S, 3),
            timeouts_in_a_row=0 if silence is None else silence.timeouts,
            tried_again_s=(
                round(max(silence.due_ns - now_ns, 0) / NS_PER_S, 3)
                if silence is not None and is_dead
                else None
            ),
        )
