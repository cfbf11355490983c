"""The link to the drives of a line: when it ends, what its end and its return mean, and what is reported.

A drive that could not be reached may have been power-cycled, or moved by hand. How much of the earlier
knowledge still counts depends on how the link was lost, and for how long: see the table in
``docs/wire-rules.md``, "When a link is lost".

The gateway ends the link in two ways. A connection that is not needed, or too old, is closed when nothing is
under way. A connection on which nothing answers any more is closed and made again (``renewal``).

A connection that an idle server closes comes and goes all day. So for each reason the first end is reported,
then one a minute with their number. A lasting end is reported in any case.
"""

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Final

from gateway.catalogue import exchange_events
from gateway.exchange.added_frames import reads_at_start, trial_read
from gateway.exchange.axis.acknowledge import OnWire
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.motion import MotionState, Reported
from gateway.exchange.dispatch import UnitMaps
from gateway.exchange.events import Event
from gateway.exchange.plan import DONE_BIT, LineTiming
from gateway.exchange.ports import DriveLink
from gateway.exchange.queue import WaitingQueue
from gateway.exchange.renewal import Held, Renewal
from gateway.exchange.rest import CLOSES_SOON_NS, Rest
from gateway.exchange.silent_units import Reach, SilentUnits
from gateway.exchange.transaction import Phase, Transaction, Transactions
from gateway.limits import Reports, others_of_pairs, times
from gateway.times import NEVER_NS, NS_PER_MS, NS_PER_S

BLINK_NS: Final = 100 * NS_PER_MS
"""A connection closed in order that is back within this time has blinked: no drive restarts so fast."""
HEARD_NS: Final = NS_PER_S
"""If its drive answered within this time before a blink, the axis is unchanged. The homed bit has the same
limit: an older one is read again."""
STREAM_ENDED_NS: Final = NS_PER_S
"""A stream without a setpoint for this time has ended or paused."""
LASTS_NS: Final = NS_PER_S
"""A line that is down for this time is reported, however often the same reason was reported before."""
ON_DEMAND_NS: Final = NS_PER_S
"""A connection on demand is closed after this time without an answer."""
LOOKED_AGAIN_NS: Final = 100 * NS_PER_MS
"""Time between checks whether a connection that is due to be closed can be closed."""
IDLE: Final = "closed by its peer when idle"
ASKED: Final = "closed by its peer while a request was unanswered"
AT_REST: Final = frozenset(
    {MotionState.UNKNOWN, MotionState.STOPPED, MotionState.SUPERSEDED, MotionState.ARRIVED}
)
"""States in which nothing sent through the gateway is under way."""


class LinkLoss(Enum):
    """How the link went down."""

    __hash__ = object.__hash__

    BLINK = "blink"
    """Closed in order by the peer or by the gateway, with nothing outstanding, and open again within 100 ms.
    Only for an axis whose drive answered within the last second; for other axes it is a close."""
    IDLE_CLOSE = "idle-close"
    """Closed by its peer with nothing outstanding, for longer."""
    OWN_CLOSE = "own-close"
    """Closed by the gateway with nothing outstanding, for longer (``connect = "on-demand"``,
    ``max_connection_s``)."""
    RENEWAL = "renewal"
    """Closed by the gateway because nothing answered on it any more, to make a new one."""
    LOSS = "loss"
    """Any other way: closed while something was outstanding, reset, unplugged, malformed."""
    RESTART = "restart"
    """There was no link yet: the gateway itself was down."""


KEEP_SILENCES: Final = frozenset({LinkLoss.BLINK, LinkLoss.RENEWAL})
"""After these a drive that did not answer is tried when it was due; after others it is asked again (W11)."""


def is_at_rest(axis: Axis, up_ns: int, now_ns: int) -> bool:
    """Whether nothing of an axis is under way, streamed, unacknowledged or staged: its link may be closed.

    ``up_ns``: when the link came up. An axis that was sent off since may be moved by something other than a
    target, until its drive has reported standstill.
    """
    has_arrived = axis.motion.state in AT_REST
    if axis.motion.state is MotionState.UNKNOWN:
        has_arrived = axis.motion.sent_off_ns <= up_ns or axis.motion.reported is Reported.STOOD
    if axis.compensation.is_stream and now_ns - axis.motion.heard_ns < STREAM_ENDED_NS:
        return False
    if axis.motion.state is MotionState.IN_WINDOW:
        has_arrived = DONE_BIT not in axis.plan.bits  # without a done bit nothing else can show it
    is_stationary = has_arrived and not axis.motion.is_moving and not axis.reference.is_homing
    if not is_stationary or axis.acknowledgement.on_wire is not OnWire.NOTHING:
        return False
    staged = axis.rules.staged if axis.waits_for_trigger else None
    if staged is None:
        return True
    last, image = axis.motion.last_target, axis.fields[staged]
    return last is not None and (last.number, last.nominal_words) == (staged, image.nominal_words)


class LinkState:
    """The link to the drives of one line. See the module.

    Args:
        axes: of the line.
        units: their register maps.
        timing: of the line.
        link: the link to the drives.
        waiting: the queue of the line.
        transactions: of the line.
        silent_units: the units that do not answer.
        rest: the pauses of the line.
        renewal: what a new connection holds back.
        on_event: called with each event.
        report: reports what is new about some axes.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        units: UnitMaps,
        timing: LineTiming,
        link: DriveLink,
        waiting: WaitingQueue,
        *,
        transactions: Transactions,
        silent_units: SilentUnits,
        rest: Rest,
        renewal: Renewal,
        on_event: Callable[[Event], None],
        report: Callable[[tuple[Axis, ...]], None],
    ) -> None:
        self._axes = tuple(axes)
        self._units = units
        self._link = link
        self._waiting = waiting
        self._transactions = transactions
        self._silent_units = silent_units
        self._rest = rest
        self._renewal = renewal
        self._on_event = on_event
        self._report = report
        self._connects = link.connects
        self._response_timeout_ns = int(timing.response_timeout_ms * NS_PER_MS)
        self._delay_ns = int(timing.connect_delay_ms * NS_PER_MS)
        self.is_on_demand = timing.connects_on_demand and link.connects
        """Whether there is a connection only while one is needed."""
        self._longest_ns = int(timing.max_connection_s * NS_PER_S) * link.connects
        self.closes_ns = 0
        """When to check whether the connection can be closed; 0: it stays."""
        self.is_stopping = False
        """Whether the gateway stops: nothing new is sent, and a link that goes down is no event."""
        self.is_up = False
        """Whether there is a link to the drives."""
        self.loss = LinkLoss.RESTART
        """How it ended last; an end that lasts longer than a blink counts as this loss."""
        self.lost: tuple[Axis, ...] = self._axes
        """Axes about which nothing is known since the link ended: they are read when it is back."""
        self.up_ns = self.down_ns = 0
        self.blinks_until_ns = 0
        """Until then the link may come back as if it had not ended; 0: it has ended."""
        self.closes_soon = link.connects
        """Whether the server may close its connection after an answer: true until it was seen to keep one."""
        self.has_closed_soon = False
        """Whether it did so the last time."""
        self._reports: Reports[tuple[str, str]] = Reports(others=others_of_pairs)
        self._is_reported = True
        """Whether its end was reported: then its return is reported too."""
        self._detail = ""
        self._report_ns = 0
        """When to report that it is still down; 0: this was reported."""

    @property
    def is_blinking(self) -> bool:
        """Whether it may still come back as if it had not ended."""
        return self.blinks_until_ns > 0

    @property
    def holds_up(self) -> bool:
        """Whether requests wait for the link, or for what the new connection holds back."""
        return not self.is_up or self._renewal.holds or self._rest.is_opening

    @property
    def asks_again(self) -> bool:
        """Whether the link is down, and dead drives are polled again when it is back."""
        return not self.is_up and self.loss not in KEEP_SILENCES

    @property
    def deadline_ns(self) -> int:
        """When a report or a check is due; :data:`NEVER_NS`: nothing is due."""
        if not self.is_up:
            return min(self.blinks_until_ns or NEVER_NS, self._report_ns or NEVER_NS)
        due_ns = self.closes_ns or NEVER_NS
        if self._renewal.held is Held.WRITES:
            due_ns = min(due_ns, self._renewal.held_until_ns)
        return due_ns

    # --- it comes up and goes down ---------------------------------------------------------------------

    def come_up(self, now_ns: int) -> None:
        """The drives can be reached."""
        self._end_blink(now_ns)
        loss = LinkLoss.BLINK if self.is_blinking else self.loss
        self.is_up = True
        self.up_ns = now_ns
        self.blinks_until_ns = self._report_ns = 0
        if self._is_reported:
            self._is_reported = False
            self._on_event(Event(exchange_events.LINE_UP))
        self._rest.resume(now_ns)
        delay_ns = self._delay_ns
        if loss is LinkLoss.RENEWAL and not delay_ns:
            delay_ns = self._response_timeout_ns
        if delay_ns:
            self._rest.open(now_ns + delay_ns)
        self._renewal.begin()
        if loss not in KEEP_SILENCES:
            self._silent_units.link_up()
        for axis in self.lost:
            axis.end_silence(is_answer=True, until_ns=now_ns)
        if loss is LinkLoss.RENEWAL:  # a drive that is silent was so before, and may have been switched off
            for axis in self._axes:
                axis.end_silence(is_answer=False, until_ns=now_ns)
        for read in reads_at_start(self.lost):
            self._waiting.add_own(read, now_ns)
        if self.is_on_demand:
            self.closes_ns = now_ns + ON_DEMAND_NS
        elif self._longest_ns:
            self.closes_ns = now_ns + self._longest_ns
        self._report(self._axes)

    def resume(self, up_ns: int, *, closes_soon: bool, has_closed_soon: bool) -> None:
        """Continue with a link whose state is known, in a replay."""
        self.closes_soon, self.has_closed_soon = closes_soon, has_closed_soon
        if up_ns:
            self.up_ns = up_ns
            if self._longest_ns and not self.is_on_demand:
                self.closes_ns = up_ns + self._longest_ns

    def end(self, current: Transaction | None, reason: str, now_ns: int, *, is_orderly: bool) -> None:
        """The drives cannot be reached any more.

        Args:
            current: what was on the wire.
            reason: why, if known.
            now_ns: when.
            is_orderly: the other end closed it, and nothing broke.
        """
        awaits_nothing = current is None and self._renewal.awaits_nothing
        is_idle = is_orderly and awaits_nothing and self._connects
        detail = reason
        if is_orderly:
            detail = IDLE if awaits_nothing else ASKED
        self._go_down(LinkLoss.IDLE_CLOSE if is_idle else LinkLoss.LOSS, detail, current, now_ns)

    def stop(self) -> None:
        """The gateway stops."""
        self.is_stopping = True

    def _go_down(self, loss: LinkLoss, detail: str, current: Transaction | None, now_ns: int) -> None:
        """Set the link down, and tell the axes that may have lost something."""
        self.is_up = False
        self.closes_ns = 0
        is_under_way = any(axis.motion.state is MotionState.MOVING for axis in self._axes)
        is_busy = current is not None or self._rest.is_draining or self._silent_units.awaits_late_reply
        self._rest.break_off(needs_silence=self._link.is_serial and is_busy)
        self.loss = loss
        self.down_ns = now_ns
        is_closed = loss is LinkLoss.IDLE_CLOSE or loss is LinkLoss.OWN_CLOSE
        is_by_us = loss is LinkLoss.OWN_CLOSE or loss is LinkLoss.RENEWAL
        self.blinks_until_ns = now_ns + BLINK_NS if is_closed else 0
        answered_ns = self._silent_units.last_answered_ns
        if self._connects and not is_by_us and answered_ns >= self.up_ns:
            self.closes_soon = self.has_closed_soon = now_ns - answered_ns <= CLOSES_SOON_NS
        self.lost = self._axes
        if loss is LinkLoss.RENEWAL:
            self.lost = ()
        elif is_closed:
            self.lost = tuple([axis for axis in self._axes if not self._was_heard(axis, now_ns)])
        if self.is_stopping or (self.is_on_demand and is_closed):
            self._is_reported, self._report_ns = False, 0  # closing it ourselves is no event
        elif is_by_us:
            self._report_later(detail, now_ns)
        else:
            self._report_down(detail, now_ns, is_under_way=bool(self.lost) and is_under_way)
        for axis in self.lost:
            axis.lose_link(now_ns, was_closed=is_closed)

    def _was_heard(self, axis: Axis, now_ns: int) -> bool:
        """Whether the drive of an axis answered so shortly before that a blink changes nothing."""
        at_ns = self._silent_units.answered_ns[axis.plan.unit_id]
        return at_ns > 0 and now_ns - at_ns <= HEARD_NS

    def _end_blink(self, now_ns: int) -> None:
        """A connection that did not come back soon is lost: earlier knowledge counts no more."""
        if not self.blinks_until_ns or now_ns < self.blinks_until_ns:
            return
        self.blinks_until_ns = 0
        kept = tuple([axis for axis in self._axes if axis not in self.lost])
        self.lost = self._axes
        for axis in kept:
            axis.lose_link(self.down_ns, was_closed=True)
        if kept:
            for transaction in self._waiting:
                if transaction.prefetched is not None:
                    transaction.begin_anew()
            self._report(kept)

    # --- the gateway ends it ---------------------------------------------------------------------------

    def watch(self, now_ns: int) -> None:
        """Do what is due."""
        if not self.is_up:
            self._end_blink(now_ns)
            if self._report_ns and now_ns >= self._report_ns:
                self._report_ns = 0
                self._is_reported = True
                if self._detail:
                    self._on_event(Event(exchange_events.LINE_DOWN, None, self._detail))
        elif self.closes_ns and now_ns >= self.closes_ns:
            self._close_at_rest(now_ns)

    def _close_at_rest(self, now_ns: int) -> None:
        """Close the connection, if it is due, once nothing is under way."""
        idle_ns = max(self.up_ns, self._silent_units.last_answered_ns) + ON_DEMAND_NS
        is_idle = self._transactions.current is None and not self._waiting.total
        is_idle = is_idle and not self._silent_units.silences
        is_idle = is_idle and self._rest.until_ns is None and not self._renewal.holds
        if self.is_on_demand and now_ns < idle_ns:
            self.closes_ns = idle_ns
        elif not is_idle or not all(is_at_rest(axis, self.up_ns, now_ns) for axis in self._axes):
            self.closes_ns = now_ns + LOOKED_AGAIN_NS
        else:
            self._go_down(LinkLoss.OWN_CLOSE, "closed by the gateway, and not made anew", None, now_ns)
            self._report(self._axes)
            self._link.hang_up(returns=not self.is_on_demand)

    def renews(self, now_ns: int) -> bool:
        """Renew the connection once it is certain that nothing answers on it; return whether that is so."""
        if not self._renewal.is_mute(now_ns):
            return False
        unit_ids = dict.fromkeys(axis.plan.unit_id for axis in self._axes)
        reads = {unit_id: trial_read(self._units.axes_of(unit_id)) for unit_id in unit_ids}
        is_known = True
        for unit_id in self._renewal.not_asked(unit_ids):
            silence = self._silent_units.silences.get(unit_id)
            if silence is not None and silence.reach is Reach.DEAD:
                continue
            is_known, read = False, reads[unit_id]
            if read is not None and self._renewal.ask(unit_id):
                self._waiting.add_own(read, now_ns)
        is_readable = any(read is not None for read in reads.values())
        if not is_known or not (is_readable or not self._renewal.may_have_written):
            return False
        self._renewal.renew(now_ns)
        why = "nothing has come from any drive for three time-outs: the gateway connects again"
        self._on_event(Event(exchange_events.CONNECTION_RENEWED, None, why))
        self._go_down(LinkLoss.RENEWAL, "broken off by the gateway, and not made anew", None, now_ns)
        self._link.renew()
        return True

    # --- its server closes it --------------------------------------------------------------------------

    def see_whether_it_closes(self, transaction: Transaction, now_ns: int) -> None:
        """After an answer, wait if the server may close its connection: it would not read the next request.

        As long as the server was not seen to do so, this holds up only a request that would be sent in this
        very call. Before a later request the gateway has read whether the connection has ended.
        """
        answered_ns = self._silent_units.answered_ns[transaction.wire_unit_id]
        if not self.has_closed_soon and self.up_ns <= answered_ns < now_ns - CLOSES_SOON_NS:
            self.closes_soon = False
        elif self.has_closed_soon or self._waiting.total or transaction.phase is Phase.PREREQUISITE:
            self._rest.await_close(now_ns)

    def stayed(self) -> None:
        """It was not closed after an answer."""
        self.closes_soon = self.has_closed_soon = False

    # --- reports ---------------------------------------------------------------------------------------

    def _report_down(self, detail: str, now_ns: int, *, is_under_way: bool) -> None:
        """Report the end of the link, if it is due. A loss while something was under way always is.

        Text behind a colon does not make another reason. A serial port that was unplugged is reported each
        time.
        """
        if not self._connects:
            self._is_reported = True
            self._on_event(Event(exchange_events.LINE_DOWN, None, detail))
            return
        count = self._reports.due(("line-down", detail.partition(":")[0]), now_ns)
        self._detail = detail
        if count or is_under_way:
            self._is_reported = True
            self._on_event(Event(exchange_events.LINE_DOWN, None, detail + times(count)))
        else:
            self._report_later(detail, now_ns)

    def _report_later(self, detail: str, now_ns: int) -> None:
        """Report it only if it lasts."""
        self._is_reported, self._detail, self._report_ns = False, detail, now_ns + LASTS_NS
