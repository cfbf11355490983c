"""When monitors get the line: in the gaps between motion transactions, after a limited wait.

A monitor's transaction may start at two kinds of moments, and only if it fits the expected gap:

- directly after the end of a motion transaction, into the shortest gap of the last second;
- after ``quiet_ms`` without motion, into the rest of the shortest gap of the last second that was at least as
  long as ``quiet_ms``. Bursts have short gaps between their frames and long ones behind them; a pause is one
  of the long ones.

A transaction is expected to take as long as the last one like it. The first of its kind is expected to take
as long as a motion transaction. A transaction that has waited for ``monitor_max_wait_ms``, or for half of its
controller's ``timeout_ms``, starts at the next such moment even if it does not fit: it is forced.

The number of monitors does not matter. After the end of a forced transaction the next one is forced only when
two times have passed: ``monitor_max_wait_ms``, and nine times as long as the last one held the line. That
includes the rest after a time-out. So monitors take at most a tenth of the line's time from motion. They need
not wait at all if no motion transaction was seen for a second.
"""

from collections.abc import Sequence
from enum import Enum
from typing import Final

from gateway.exchange.plan import LineTiming
from gateway.exchange.ports import Stamps
from gateway.exchange.transaction import Transaction
from gateway.times import NS_PER_MS, NS_PER_S

WINDOW_NS: Final = NS_PER_S // 2
"""A gap counts in its window and in the next one: for one second, give or take half a second."""
REMEMBERED: Final = 256
"""Number of requests whose duration is remembered."""
SHRINKS: Final = 8
"""An expected duration that was not reached again shrinks by an eighth each time."""
PAID_BACK: Final = 9
"""Motion then gets the line for this multiple of a forced transaction's time."""
HEAD_BYTES: Final = 5
"""Bytes of a PDU that identify a request."""


class _Shortest:
    """The shortest gap of the last second, give or take half a second."""

    def __init__(self) -> None:
        self._now_ns: int | None = None
        self._before_ns: int | None = None
        self._window_ends_ns = 0

    def add(self, gap_ns: int, now_ns: int) -> None:
        self._advance_window(now_ns)
        if self._now_ns is None or gap_ns < self._now_ns:
            self._now_ns = gap_ns

    def get(self, now_ns: int) -> int | None:
        """Return it; None: there was none."""
        self._advance_window(now_ns)
        if self._now_ns is None or self._before_ns is None:
            return self._before_ns if self._now_ns is None else self._now_ns
        return min(self._now_ns, self._before_ns)

    def _advance_window(self, now_ns: int) -> None:
        if now_ns < self._window_ends_ns:
            return
        is_next = now_ns < self._window_ends_ns + WINDOW_NS
        self._before_ns = self._now_ns if is_next else None
        self._now_ns = None
        self._window_ends_ns = now_ns + WINDOW_NS


class _Behind(Enum):
    """What came last before the line became free."""

    __hash__ = object.__hash__

    ANYTHING = "anything"
    """A motion transaction without a silence behind it, or another transaction."""
    SILENCE = "silence"
    """The silence behind a motion transaction; nothing waits for its end."""
    AWAITED_SILENCE = "awaited-silence"
    """The same, and a transaction has waited only for the end of that silence: it may start as directly after
    motion."""


class Gaps:
    """The gaps between the motion transactions of one line, and what fits into them."""

    def __init__(self, timing: LineTiming, stamps: Stamps) -> None:
        self._stamps = stamps
        self._quiet_ns = int(timing.quiet_ms * NS_PER_MS)
        self._max_wait_ns = int(timing.monitor_max_wait_ms * NS_PER_MS)
        self.is_watching = False
        """Whether any other controllers than motion controllers use the line; gaps are recorded only from
        then on."""
        self._ended_ns: int | None = None
        """When the line became free after the last motion transaction; None: none was seen yet."""
        self._behind = _Behind.ANYTHING
        self._any = _Shortest()
        self._long = _Shortest()
        """Of the gaps of ``quiet_ms`` and more."""
        self._durations_ns: dict[bytes, int] = {}
        self._motion_ns = 0
        self._forced: Transaction | None = None
        """The last transaction that was started although it did not fit."""
        self._forced_since_ns = 0
        self._next_forced_ns = 0
        """Earliest time at which the next transaction may be forced."""

    def motion_came(self, now_ns: int) -> None:
        """Record a motion request that found no other motion transaction under way."""
        if self._ended_ns is None:
            return
        gap_ns = max(now_ns - self._ended_ns, 0)
        self._any.add(gap_ns, now_ns)
        if gap_ns >= self._quiet_ns:
            self._long.add(gap_ns, now_ns)

    def ended(self, transaction: Transaction, now_ns: int, rests_until_ns: int | None = None) -> None:
        """Record the end of a transaction, answered or not, and until when the line rests after it."""
        if not self.is_watching:
            return
        next_ns = self._stamps.next_ns if rests_until_ns is None else now_ns
        if transaction.is_motion:
            self._behind = _Behind.SILENCE if next_ns > now_ns else _Behind.ANYTHING
            self._ended_ns = max(next_ns, now_ns)
            self._motion_ns = max(now_ns - transaction.sent_ns, self._motion_ns - self._motion_ns // SHRINKS)
            return
        self._behind = _Behind.ANYTHING
        free_ns = now_ns if rests_until_ns is None else rests_until_ns
        if len(self._durations_ns) >= REMEMBERED:
            self._durations_ns.clear()
        before_ns = self._durations_ns.get(_key(transaction), 0)
        self._durations_ns[_key(transaction)] = max(
            free_ns - transaction.sent_ns, before_ns - before_ns // SHRINKS
        )
        # A transaction with a prerequisite ends twice; it held the line for both.
        if transaction is self._forced:
            occupied_ns = free_ns - self._forced_since_ns
            self._next_forced_ns = free_ns + max(self._max_wait_ns, PAID_BACK * occupied_ns)

    def wait_for_silence(self) -> None:
        """Record that something waits for a silence on the wire, perhaps after a motion transaction."""
        if self._behind is _Behind.SILENCE:
            self._behind = _Behind.AWAITED_SILENCE

    def choose(self, first: Sequence[Transaction], now_ns: int) -> tuple[Transaction | None, int | None]:
        """Return the first transaction that may start; else None, and when to ask again.

        The line is free, and no motion request waits. A transaction that its controller gave up, or that is
        to be refused, is returned too. It is not sent, so it must not hold back those behind it.
        """
        idle_ns = self._idle_ns(now_ns)
        has_waited = self._behind is _Behind.AWAITED_SILENCE
        is_behind_motion = idle_ns <= 0 or has_waited
        if has_waited:
            self._behind = _Behind.SILENCE
        is_chance = is_behind_motion or idle_ns >= self._quiet_ns
        for transaction in first:
            if idle_ns >= NS_PER_S or transaction.is_denied or transaction.why_given_up(now_ns):
                return transaction, None
            if not is_chance:
                continue
            if self._fits(transaction, idle_ns, now_ns, is_behind_motion=is_behind_motion):
                return transaction, None
            if now_ns >= self._forced_from_ns(transaction):
                self._forced, self._forced_since_ns = transaction, now_ns
                return transaction, None
        return None, min((self.next_chance_ns(transaction, now_ns) for transaction in first), default=None)

    def next_chance_ns(self, transaction: Transaction, now_ns: int) -> int:
        """When to ask again, if no motion transaction comes before."""
        ended_ns = now_ns - self._idle_ns(now_ns)
        next_ns = ended_ns + self._quiet_ns
        if not self._fits(transaction, self._quiet_ns, next_ns, is_behind_motion=False) or next_ns <= now_ns:
            next_ns = max(next_ns, self._forced_from_ns(transaction))
        if transaction.port is not None:  # it is withdrawn then
            given_up_ns = transaction.arrived_ns + transaction.port.patience_ns + 1
            next_ns = min(next_ns, given_up_ns)
        return max(now_ns + 1, min(next_ns, ended_ns + NS_PER_S))

    def _idle_ns(self, now_ns: int) -> int:
        """Return how long the line has been free of motion; 0: the last transaction has just ended."""
        if self._ended_ns is None:
            return NS_PER_S
        return now_ns - self._ended_ns

    def _forced_from_ns(self, transaction: Transaction) -> int:
        """When it starts at the next possible moment although it does not fit."""
        max_wait_ns = self._max_wait_ns
        if transaction.port is not None:
            max_wait_ns = min(max_wait_ns, transaction.port.patience_ns // 2)
        return max(transaction.arrived_ns + max_wait_ns, self._next_forced_ns)

    def _fits(self, transaction: Transaction, idle_ns: int, now_ns: int, *, is_behind_motion: bool) -> bool:
        gap_ns = (self._any if is_behind_motion else self._long).get(now_ns)
        return (
            gap_ns is None or self._durations_ns.get(_key(transaction), self._motion_ns) <= gap_ns - idle_ns
        )


def _key(transaction: Transaction) -> bytes:
    return bytes((transaction.unit_id,)) + transaction.pdu[:HEAD_BYTES]
