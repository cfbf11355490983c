"""Acknowledged alarms: a person has seen them. An acknowledgement changes nothing at the machine.

An acknowledgement belongs to one occurrence of an alarm and ends with it. The next occurrence is new. An
alarm that a worse one hides has not ended. After a restart, acknowledged alarms do not end until the
supervisor has had time to find them again.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Final

import msgspec

from gateway.supervisor.active_alarms import Alarm, SourcePath, is_hidden

FOUND_AGAIN_S: Final = 30.0
"""Time after a restart in which an acknowledged alarm may be found again. The supervisor first has to reach
the relay and check files and connections."""
MOST: Final = 256
"""Maximum number of acknowledgements. One more removes the oldest."""
Key = tuple[str, SourcePath]


@dataclass(frozen=True, slots=True)
class AlarmAcknowledgement:
    """Who has seen an alarm, and when."""

    kind: str
    place: SourcePath
    since: str
    """Start of the alarm, as in the status."""
    by: str
    """Name of a token."""
    at: str

    def as_data(self) -> dict[str, str]:
        """Return what the status adds to the alarm."""
        return {"by": self.by, "at": self.at}


class Acknowledged:
    """The acknowledgements in force."""

    def __init__(self) -> None:
        self._kept: dict[Key, AlarmAcknowledgement] = {}
        self._stays_until_s = 0.0
        self.version = 0
        """Grows with each change."""

    def __getitem__(self, key: Key) -> AlarmAcknowledgement | None:
        return self._kept.get(key)

    def add(self, alarm: Alarm, since: str, by: str, now: datetime) -> AlarmAcknowledgement:
        """Acknowledge an alarm. An earlier acknowledgement of the same alarm stays."""
        key = alarm.source_key
        if key not in self._kept:
            at = now.isoformat(timespec="seconds")
            self._kept[key] = AlarmAcknowledgement(*key, since, by, at)
            while len(self._kept) > MOST:
                del self._kept[next(iter(self._kept))]
            self.version += 1
        return self._kept[key]

    def follow(self, found: Sequence[Alarm], now_s: float) -> None:
        """End the acknowledgements of alarms that are over; ``now_s`` is monotonic."""
        there = {alarm.source_key for alarm in found}
        for key in [key for key in self._kept if key not in there]:
            if now_s >= self._stays_until_s and not is_hidden(*key, found):
                del self._kept[key]
                self.version += 1

    def encoded(self) -> bytes:
        """Return all acknowledgements, for :meth:`restore`."""
        return msgspec.json.encode([asdict(one) for one in self._kept.values()])

    def restore(self, content: bytes, now_s: float) -> None:
        """Take over what :meth:`encoded` returned before a restart.

        Raises:
            ValueError: the content is something else.
        """
        try:
            kept = msgspec.json.decode(content, type=list[AlarmAcknowledgement])
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise ValueError(str(error)) from error
        self._kept = {(one.kind, one.place): one for one in kept[-MOST:]}
        self._stays_until_s = now_s + FOUND_AGAIN_S
