"""The pauses of a line (W6): the turnaround after a broadcast, the silence that must follow a time-out."""

from typing import Final

from gateway.exchange.plan import LineTiming
from gateway.times import NS_PER_MS

LONGEST_DRAIN: Final = 3
"""So many times the silence asked for: a line that never falls silent is used all the same, for its stops."""


class Rest:
    """Until when nothing is sent, and why."""

    def __init__(self, timing: LineTiming) -> None:
        self.drain_ms = timing.drain_ms or timing.response_timeout_ms
        self._drain_ns = int(self.drain_ms * NS_PER_MS)
        self._turnaround_ns = int(timing.turnaround_ms * NS_PER_MS)
        self._drained_at_last_ns = 0
        self.until_ns: int | None = None
        """None: the line does not rest."""
        self.is_draining = False
        self._owes_silence = False
        """A serial link, or its gateway, went down with something outstanding: its reply may still come."""

    def turn_around(self, now_ns: int) -> None:
        """Give the drives time to obey a broadcast."""
        self.until_ns = now_ns + self._turnaround_ns

    def drain(self, now_ns: int) -> None:
        """Wait for silence, so that a late reply never answers the next request."""
        self.until_ns = now_ns + self._drain_ns
        self._drained_at_last_ns = now_ns + LONGEST_DRAIN * self._drain_ns
        self.is_draining = True

    def disturb(self, now_ns: int) -> None:
        """Bytes came in the middle of the silence: it begins anew, but not for ever."""
        self.until_ns = min(now_ns + self._drain_ns, self._drained_at_last_ns)

    def end(self) -> None:
        """The line has rested."""
        self.until_ns = None
        self.is_draining = self._owes_silence = False

    def owe(self) -> None:
        """A reply may come that nobody here has asked for: the line rests first when its link comes up."""
        self._owes_silence = True

    @property
    def owes_silence(self) -> bool:
        """Whether a reply may still come that is not for whoever uses the line next."""
        return self._owes_silence or self.is_draining

    def break_off(self, *, owes_silence: bool) -> None:
        """The link went down; a reply may be on its way still."""
        self._owes_silence = owes_silence
        self.until_ns = None
        self.is_draining = False

    def resume(self, now_ns: int) -> None:
        """The link is up again."""
        if self._owes_silence:
            self.drain(now_ns)
