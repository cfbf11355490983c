"""The pause before the next attempt after a failure: it doubles each time, up to a longest one."""

from collections.abc import Callable

from gateway import system


def _drawn() -> float:
    return int.from_bytes(system.random_bytes(2), "big") / 0xFFFF


class Backoff:
    """The pauses between attempts, in seconds.

    Args:
        first_s: the pause after the first failure; it doubles with each further one.
        longest_s: the longest pause.
        at_once_s: a short pause before all of these.
        spread: the smallest and the largest share of a pause that is waited. It keeps several gateways from
            retrying at the same time.
        share: returns a number from 0 to 1 that selects the share.
    """

    __slots__ = ("_at_once_s", "_first_s", "_longest_s", "_share", "_spread", "failures")

    def __init__(
        self,
        first_s: float,
        longest_s: float,
        *,
        at_once_s: float | None = None,
        spread: tuple[float, float] = (1.0, 1.0),
        share: Callable[[], float] = _drawn,
    ) -> None:
        self._first_s, self._longest_s, self._at_once_s = first_s, longest_s, at_once_s
        self._spread, self._share = spread, share
        self.failures = 0
        """Attempts since the last useful one."""

    @property
    def pause_s(self) -> float:
        """The next pause, before the spread is applied."""
        doublings = self.failures - (self._at_once_s is not None)
        if self._at_once_s is not None and doublings < 0:
            return self._at_once_s
        return min(self._first_s * 2.0 ** min(doublings, 32), self._longest_s)

    def next_s(self) -> float:
        """Count a failed attempt, and return the pause before the next one."""
        pause_s = self.pause_s
        is_spread = self.failures > 0 or self._at_once_s is None
        self.failures += 1
        least, most = self._spread
        if not is_spread or least == most:
            return pause_s
        return pause_s * (least + (most - least) * self._share())

    def reset(self) -> None:
        """Begin with the first pause again, after a useful attempt."""
        self.failures = 0
