"""Refused connections: each is counted, and one a minute is reported."""

from collections.abc import Callable
from typing import Final

from gateway.catalogue.entry import EventEntry
from gateway.catalogue.line_events import CONNECTION_REFUSED
from gateway.clock import monotonic_ns
from gateway.limits import MOST_KEYS, Reports, times
from gateway.transport.connections import Closing
from gateway.transport.tcp import Refusal

HOSTS: Final = MOST_KEYS
OTHERS: Final = "further hosts"


Why = Refusal | Closing


def _others(key: tuple[EventEntry, str, str]) -> tuple[EventEntry, str, str]:
    event, _, why = key
    return event, OTHERS, why


class Refusals:
    """Reports the first refusal of a host for a reason, then one a minute with the number since.

    ``event``: the event of such a report; connections that are closed later are reported in the same way.
    """

    def __init__(
        self,
        log: Callable[[EventEntry, str], None],
        clock_ns: Callable[[], int] = monotonic_ns,
        *,
        event: EventEntry = CONNECTION_REFUSED,
    ) -> None:
        self._log = log
        self._event = event
        self._clock_ns = clock_ns
        self._reports: Reports[tuple[EventEntry, str, str]] = Reports(others=_others)

    def add(self, host: str, why: Why) -> None:
        """Count a refusal, and report it if that is due."""
        self.count(self._event, host, why.value)

    def count(self, event: EventEntry, host: str, why: str, more: str = "") -> None:
        """As :meth:`add`, with another event; ``more`` is of this refusal only, and not part of the key."""
        key = self._reports.counted_as((event, host, why))
        if count := self._reports.due(key, self._clock_ns()):
            self._log(event, f"{key[1]}: {why}{times(count)}{more}")
