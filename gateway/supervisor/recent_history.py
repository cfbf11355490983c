"""The supervisor's memory: since when something is wrong, and where the axes were.

All of it is bounded and ends with the process; ``supervisor.past`` keeps some of it for the next one.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final, NamedTuple

from gateway.status.axis import AxisStatus, Reading
from gateway.status.model import AcknowledgedBy, AlarmStatus, RelayModel
from gateway.supervisor.acknowledged import Acknowledged, AlarmAcknowledgement
from gateway.supervisor.active_alarms import Alarm, SourcePath

HISTORY_S: Final = 600
"""Ten minutes of each axis are kept."""
EVERY_S: Final = 1.0
"""Interval between the positions that are kept."""
EARLY_S: Final = 0.1
"""Tolerance: snapshots that come every second are sometimes a little early."""


@dataclass(frozen=True, slots=True)
class PositionSample:
    """Where an axis was; positions in its unit."""

    at_s: float
    nominal: float | None
    corrected: float | None
    correction: float | None
    compensation: str
    """State of the compensation, as in the status."""


@dataclass(frozen=True, slots=True)
class TargetSample:
    """The last target of an axis, on the controller's scale; None: it has no target."""

    nominal: float | None
    at_s: float
    """When it was first seen."""
    is_older: bool
    """It is older: the first snapshot already had it."""


class LastTarget(NamedTuple):
    """Age of the target of an axis."""

    age_s: float
    is_at_least: bool
    """The real age is more: the first snapshot already had the target."""


def _now() -> datetime:
    return datetime.now(UTC)


class RecentHistory:
    """The recent past. Times in seconds are those of ``time.monotonic``; ``now`` returns the time of day."""

    def __init__(self, now: Callable[[], datetime] = _now) -> None:
        self._now = now
        self.acknowledged = Acknowledged()
        self._since: dict[tuple[str, SourcePath], str] = {}
        self._found: Sequence[Alarm] = ()
        self._words: dict[tuple[str, ...], tuple[str, str]] = {}
        """By subject: what is reported of it, and since when."""
        self._last: dict[str, PositionSample] = {}
        self._targets: dict[str, TargetSample] = {}
        self._history: dict[str, deque[PositionSample]] = {}
        self._snapshot: RelayModel | None = None

    def stamp(self, found: Sequence[Alarm], now: datetime) -> list[AlarmStatus]:
        """Return alarms as the status shows them: since when each is active, and who has acknowledged it."""
        self._found = found
        self._since = {each.source_key: self._since_of(each, now) for each in found}
        return [self._status(each) for each in found]

    def _since_of(self, each: Alarm, now: datetime) -> str:
        if (since := self._since.get(each.source_key)) is not None:
            return since
        if (seen := self.acknowledged[each.source_key]) is not None:
            return seen.since
        begin = datetime.fromtimestamp(now.timestamp() - (each.age_s or 0.0), UTC)
        return begin.isoformat(timespec="seconds")

    def _status(self, each: Alarm) -> AlarmStatus:
        seen = self.acknowledged[each.source_key]
        by = None if seen is None else AcknowledgedBy(by=seen.by, at=seen.at)
        return each.status(self._since[each.source_key], by)

    def acknowledge(
        self, kind: str, where: str, since: str, by: str, now: datetime
    ) -> AlarmAcknowledgement | None:
        """Record who has acknowledged an alarm; None: there is no such alarm, or it has ended."""
        for each in self._found:
            if (*each.key, self._since[each.source_key]) == (kind, where, since):
                return self.acknowledged.add(each, since, by, now)
        return None

    def since_of(self, alarm: Alarm) -> str:
        """Return since when a stamped alarm is active, as ISO 8601."""
        return self._since[alarm.entry.kind, alarm.source_path]

    def since(self, about: tuple[str, ...], word: str) -> str:
        """Return since when the same word is reported on a subject, as ISO 8601; not before this process."""
        before = self._words.get(about)
        if before is None or before[0] != word:
            before = self._words[about] = word, self._now().isoformat(timespec="seconds")
        return before[1]

    def take(self, snapshot: RelayModel | None, now_s: float) -> None:
        """Keep the positions of a new snapshot."""
        if snapshot is None or snapshot is self._snapshot:
            return
        self._snapshot = snapshot
        for name in self._history.keys() - snapshot.axes.keys():
            del self._history[name]
            self._last.pop(name, None)
            self._targets.pop(name, None)
            self._words.pop((name,), None)
        for name, axis in snapshot.axes.items():
            seen = _seen(axis, now_s)
            if seen.nominal is not None:
                self._last[name] = seen
            elif name not in self._last and (actual := axis.last_actual) is not None:
                at_s = now_s - actual.age_s  # read before the first snapshot
                self._last[name] = PositionSample(
                    at_s, actual.nominal, actual.corrected, None, axis.compensation
                )
            nominal, before = axis.nominal_setpoint, self._targets.get(name)
            if before is None or before.nominal != nominal:
                self._targets[name] = TargetSample(nominal, now_s, before is None)
            kept = self._history.setdefault(name, deque(maxlen=int(HISTORY_S / EVERY_S)))
            if not kept or seen.at_s - kept[-1].at_s >= EVERY_S - EARLY_S:
                kept.append(seen)

    def last(self, axis: str, now_s: float) -> Reading | None:
        """Return the last reading of an axis, with its age; None if there is none."""
        seen = self._last.get(axis)
        if seen is None:
            return None
        age_s = round(now_s - seen.at_s, 1)
        return Reading(nominal=seen.nominal, corrected=seen.corrected, age_s=age_s)

    def target(self, axis: str, now_s: float) -> LastTarget | None:
        """Return the age of the target of an axis; None if it has none."""
        target = self._targets.get(axis)
        if target is None or target.nominal is None:
            return None
        return LastTarget(round(now_s - target.at_s, 1), target.is_older)

    def history(self, axis: str) -> Sequence[PositionSample] | None:
        """Return the last ten minutes of an axis, oldest first; None: no such axis."""
        kept = self._history.get(axis)
        return None if kept is None else tuple(kept)

    def newest(self) -> dict[str, PositionSample]:
        """Return the newest sample of each axis; its position may be unknown."""
        return {axis: kept[-1] for axis, kept in self._history.items() if kept}


def _seen(axis: AxisStatus, now_s: float) -> PositionSample:
    nominal, corrected = axis.nominal_actual, axis.corrected_actual
    correction = axis.correction
    if axis.compensation != "shadow" and nominal is not None and corrected is not None:
        correction = corrected - nominal
    at_s = now_s - (axis.actual_age_s or 0.0)
    return PositionSample(at_s, nominal, corrected, correction, axis.compensation)
