"""The pauses of a whole line (W6): the turnaround after a broadcast, the silence after an unexpected frame.

The silence after a time-out belongs to the unit id that did not answer: ``exchange.silent_units``.
"""

from enum import Enum
from typing import Final

from gateway.exchange.plan import LineTiming
from gateway.times import NS_PER_MS

CLOSES_SOON_NS: Final = 20 * NS_PER_MS
"""A server that closes its connection within this time after an answer closes it after each answer."""
LONGEST_DRAIN: Final = 3
"""Maximum silence, in units of the required one: a line that never falls silent is still used, for its
stops."""


class Resting(Enum):
    """Why a line sends nothing, apart from a transaction on it."""

    __hash__ = object.__hash__

    NOT = "not"
    """It does not rest."""
    TURNAROUND = "turnaround"
    """The drives get time to execute a broadcast."""
    SILENCE = "silence"
    """A late reply may come: the line waits until it is silent."""
    SILENCE_PENDING = "owed"
    """The same, but there is no link yet: the silence begins with the link."""
    CLOSING = "closing"
    """The server may close the connection after its answer: a request sent then would be lost."""
    OPENED = "opened"
    """A connection was made, and the drives get time to serve it."""
    ABORTED = "spoilt"
    """An aborted frame was sent (``cut_through``): the drives must see its end."""


KEEPS_STOPS: Final = frozenset({Resting.TURNAROUND, Resting.CLOSING, Resting.OPENED})


class Rest:
    """Until when nothing is sent, and why."""

    def __init__(self, timing: LineTiming) -> None:
        self.drain_ms = timing.drain_ms or timing.response_timeout_ms
        self._drain_ns = int(self.drain_ms * NS_PER_MS)
        self._turnaround_ns = int(timing.turnaround_ms * NS_PER_MS)
        self._drained_at_last_ns = 0
        self._resting = Resting.NOT
        self.until_ns: int | None = None
        """The line rests until then; set exactly in TURNAROUND, SILENCE, CLOSING, OPENED and ABORTED."""
        self.opened_until_ns = 0
        """Nothing is sent before, not even a stop: the drives would not serve it."""
        self.aborted_until_ns = 0
        """Nothing is sent before, not even a stop: it would be taken for the rest of an aborted frame."""

    @property
    def is_draining(self) -> bool:
        """Whether the line waits until it is silent."""
        return self._resting is Resting.SILENCE

    @property
    def keeps_stops(self) -> bool:
        """Whether stops wait too, because no drive would receive them."""
        return self._resting in KEEPS_STOPS

    @property
    def is_closing(self) -> bool:
        """Whether the server may close the connection after its answer."""
        return self._resting is Resting.CLOSING

    @property
    def is_opening(self) -> bool:
        """Whether the drives get time to serve a new connection."""
        return self._resting is Resting.OPENED

    @property
    def needs_silence(self) -> bool:
        """Whether a reply may still come that is not for the next user of the line."""
        return self._resting is Resting.SILENCE or self._resting is Resting.SILENCE_PENDING

    def begin_turnaround(self, now_ns: int) -> None:
        """Give the drives time to execute a broadcast; a longer silence stays in force."""
        until_ns = now_ns + self._turnaround_ns
        if self.until_ns is None or until_ns > self.until_ns:
            self._resting = Resting.TURNAROUND
            self.until_ns = until_ns

    def hold_after_abort(self, until_ns: int) -> None:
        """Let the drives see the end of an aborted frame; the line did not rest when it began."""
        self._resting = Resting.ABORTED
        self.until_ns = self.aborted_until_ns = until_ns

    def await_close(self, now_ns: int) -> None:
        """Wait to see whether the server closes the connection after its answer."""
        if self.until_ns is None:
            self._resting = Resting.CLOSING
            self.until_ns = now_ns + CLOSES_SOON_NS

    def open(self, until_ns: int) -> None:
        """Give the drives time to serve a new connection; a longer silence stays in force."""
        self.opened_until_ns = until_ns
        if self.until_ns is None or until_ns > self.until_ns:
            self._resting = Resting.OPENED
            self.until_ns = until_ns

    def drain(self, now_ns: int) -> None:
        """Wait for silence, so that a late reply never answers the next request."""
        self._resting = Resting.SILENCE
        least_ns = max(self.aborted_until_ns, self.opened_until_ns)
        self.until_ns = max(now_ns + self._drain_ns, least_ns)
        self._drained_at_last_ns = max(now_ns + LONGEST_DRAIN * self._drain_ns, least_ns)

    def disturb(self, now_ns: int) -> None:
        """Bytes came during the silence: it begins again, but not without limit."""
        until_ns = max(now_ns + self._drain_ns, self.aborted_until_ns, self.opened_until_ns)
        self.until_ns = min(until_ns, self._drained_at_last_ns)

    def settle(self, now_ns: int) -> None:
        """End the rest if it is over; called after the input from the drives was read."""
        if self.until_ns is not None and now_ns >= self.until_ns:
            self._resting = Resting.NOT
            self.until_ns = None
            self.aborted_until_ns = self.opened_until_ns = 0

    def expect_late_reply(self) -> None:
        """A late reply may come: when the link comes up, the line rests first."""
        self._resting = Resting.SILENCE_PENDING

    def break_off(self, *, needs_silence: bool) -> None:
        """The link went down; a reply may still be on its way."""
        self._resting = Resting.SILENCE_PENDING if needs_silence else Resting.NOT
        self.until_ns = None
        self.aborted_until_ns = self.opened_until_ns = 0

    def resume(self, now_ns: int) -> None:
        """The link is up again."""
        if self._resting is Resting.SILENCE_PENDING:
            self.drain(now_ns)
