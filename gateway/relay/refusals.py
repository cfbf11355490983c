"""Connections that were not let in: counted one by one, told of once in a while."""

import time
from collections.abc import Callable
from typing import Final

from gateway.catalogue.entry import EventEntry
from gateway.catalogue.line_events import CONNECTION_REFUSED
from gateway.transport.places import Closing
from gateway.transport.tcp import Refusal

EVERY_S: Final = 60.0
"""Whoever is refused tries again at once, for ever: so seldom a host is told of, with a count."""
HOSTS: Final = 256
"""So many hosts are told of by name, all others together: names of hosts must not fill the memory."""
OTHERS: Final = "further hosts"


Why = Refusal | Closing


class Refusals:
    """Notes the first refusal of a host for a reason, and then one a minute with how many there were.

    ``event``: what such a note is called; connections that were closed later are told of in the same way.
    """

    def __init__(
        self,
        note: Callable[[EventEntry, str], None],
        clock_s: Callable[[], float] = time.monotonic,
        *,
        event: EventEntry = CONNECTION_REFUSED,
    ) -> None:
        self._note = note
        self._event = event
        self._clock_s = clock_s
        self._noted_s: dict[tuple[EventEntry, str, str], float] = {}
        self._counts: dict[tuple[EventEntry, str, str], int] = {}

    def add(self, host: str, why: Why) -> None:
        """Count a refusal, and note it where one is due."""
        self.count(self._event, host, why.value)

    def count(self, event: EventEntry, host: str, why: str, more: str = "") -> None:
        """As :meth:`add`, under another name; ``more`` is of this one alone, and is not counted by."""
        if (event, host, why) not in self._counts and len(self._counts) >= HOSTS:
            host = OTHERS
        key = (event, host, why)
        self._counts[key] = self._counts.get(key, 0) + 1
        now_s = self._clock_s()
        if key in self._noted_s and now_s - self._noted_s[key] < EVERY_S:
            return
        self._noted_s[key] = now_s
        times = f", {self._counts[key]} times since the last note" if self._counts[key] > 1 else ""
        self._counts[key] = 0
        self._note(event, f"{host}: {why}{times}{more}")
