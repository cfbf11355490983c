"""Who was refused, on its way to the log: the first time at once, and then once a minute with how often."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gateway.catalogue.entry import EventEntry
from gateway.supervisor.http.wrong_tries import site_of
from gateway.supervisor.saying import Say

EVERY_S: Final = 60.0
MOST: Final = 1024
"""Of which something is kept; for one more the one that was heard of longest ago is forgotten."""


Refused = Callable[[str, str], None]
"""Is told of who was refused, by his address, and why."""


def tell_nobody(_peer: str, _why: str) -> None:
    """Tell nobody: on the Unix socket whoever asks is this machine's own."""


@dataclass(slots=True)
class _Kept:
    told_s: float
    reason: str
    untold: int = 0


class Refusals:
    """Tells of refusals by event and address, never of what was shown."""

    def __init__(self, say: Say) -> None:
        self._say = say
        self._kept: OrderedDict[tuple[EventEntry, str], _Kept] = OrderedDict()

    def note(self, event: EventEntry, address: str, reason: str, now_s: float) -> None:
        """Count a refusal, and tell of it where nothing was told of that address for a minute."""
        key = (event, site_of(address))
        kept = self._kept.get(key)
        if kept is None:
            self._kept[key] = _Kept(now_s, reason)
            self._tell(key, reason, 1)
            while len(self._kept) > MOST:
                self._kept.popitem(last=False)
            return
        self._kept.move_to_end(key)
        kept.untold += 1
        kept.reason = reason
        self._tell_if_due(key, kept, now_s)

    def sweep(self, now_s: float) -> None:
        """Tell of what was held back, and forget who has been quiet since."""
        for key, kept in list(self._kept.items()):
            if not kept.untold and now_s - kept.told_s >= EVERY_S:
                del self._kept[key]
            else:
                self._tell_if_due(key, kept, now_s)

    def _tell_if_due(self, key: tuple[EventEntry, str], kept: _Kept, now_s: float) -> None:
        if kept.untold and now_s - kept.told_s >= EVERY_S:
            times, kept.untold, kept.told_s = kept.untold, 0, now_s
            self._tell(key, kept.reason, times)

    def _tell(self, key: tuple[EventEntry, str], reason: str, times: int) -> None:
        event, address = key
        self._say(event, peer=address, detail=reason, times=times)
