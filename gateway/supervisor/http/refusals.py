"""Clients that were refused: the first refusal is reported at once, and then one a minute with how often."""

from collections.abc import Callable
from typing import Final

from gateway.catalogue.entry import EventEntry
from gateway.limits import Reports
from gateway.supervisor.http.wrong_tries import site_of
from gateway.supervisor.saying import Say
from gateway.times import NS_PER_S

MOST: Final = 1024
"""So many addresses are reported by name, all others together: a flood must not fill the log."""
OTHERS: Final = "further addresses"


Refused = Callable[[str, str], None]
"""Is told of who was refused, by his address, and why."""


def tell_nobody(_peer: str, _why: str) -> None:
    """Tell nobody: on the Unix socket whoever asks is this machine's own."""


def _others(key: tuple[EventEntry, str]) -> tuple[EventEntry, str]:
    return key[0], OTHERS


class Refusals:
    """Reports refusals by event and address, never what was shown."""

    def __init__(self, say: Say) -> None:
        self._say = say
        self._reports: Reports[tuple[EventEntry, str]] = Reports(most=MOST, others=_others)
        self._reasons: dict[tuple[EventEntry, str], str] = {}
        """Of the newest refusal of each."""

    def note(self, event: EventEntry, address: str, reason: str, now_s: float) -> None:
        """Count a refusal, and report it where none of that address was reported for a minute."""
        now_ns = int(now_s * NS_PER_S)
        key = self._reports.counted_as((event, site_of(address)))
        self._reasons[key] = reason
        if count := self._reports.due(key, now_ns):
            self._tell(key, count)

    def sweep(self, now_s: float) -> None:
        """Report what was held back, and forget the addresses that have been quiet since."""
        for key, count in self._reports.held_back(int(now_s * NS_PER_S)):
            self._tell(key, count)
        self._reasons = {key: reason for key, reason in self._reasons.items() if self._reports.knows(key)}

    def _tell(self, key: tuple[EventEntry, str], times: int) -> None:
        event, address = key
        self._say(event, peer=address, detail=self._reasons[key], times=times)
