"""What the supervisor remembers of the time before: since when something is wrong, and where axes were.

All of it is bounded, and ends with the process; ``supervisor.past`` keeps some of it for the next one.
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
"""So often a place is kept."""
EARLY_S: Final = 0.1
"""Snapshots that come every second come a little earlier now and then."""


@dataclass(frozen=True, slots=True)
class PositionSample:
    """Where an axis was seen; positions in its unit."""

    at_s: float
    nominal: float | None
    corrected: float | None
    correction: float | None
    compensation: str
    """Its state, as the status says it."""


@dataclass(frozen=True, slots=True)
class TargetSample:
    """Where an axis was sent last, on the controller's scale; None: it has no target."""

    nominal: float | None
    at_s: float
    """When it was seen first."""
    is_older: bool
    """It was there before anybody looked."""


class LastTarget(NamedTuple):
    """How old the target of an axis is."""

    age_s: float
    is_at_least: bool
    """It was there before anybody looked."""


def _now() -> datetime:
    return datetime.now(UTC)


class RecentHistory:
    """The recent past; times in seconds are those of ``time.monotonic``, ``now`` tells the time of day."""

    def __init__(self, now: Callable[[], datetime] = _now) -> None:
        self._now = now
        self.acknowledged = Acknowledged()
        self._since: dict[tuple[str, SourcePath], str] = {}
        self._found: Sequence[Alarm] = ()
        self._words: dict[tuple[str, ...], tuple[str, str]] = {}
        """By what it is about: what is said of it, and since when."""
        self._last: dict[str, PositionSample] = {}
        self._targets: dict[str, TargetSample] = {}
        self._history: dict[str, deque[PositionSample]] = {}
        self._snapshot: RelayModel | None = None

    def stamp(self, found: Sequence[Alarm], now: datetime) -> list[AlarmStatus]:
        """Return troubles as the status shows them: since when each is there, and who has seen it."""
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
        """Note who has seen an alarm; None: there is none like that, or not any more."""
        for each in self._found:
            if (*each.key, self._since[each.source_key]) == (kind, where, since):
                return self.acknowledged.add(each, since, by, now)
        return None

    def since_of(self, alarm: Alarm) -> str:
        """Return since when a trouble is there that was stamped, as ISO 8601."""
        return self._since[alarm.entry.kind, alarm.source_path]

    def since(self, about: tuple[str, ...], word: str) -> str:
        """Return since when the same is said of something, as ISO 8601; not from before this process."""
        before = self._words.get(about)
        if before is None or before[0] != word:
            before = self._words[about] = word, self._now().isoformat(timespec="seconds")
        return before[1]

    def take(self, snapshot: RelayModel | None, now_s: float) -> None:
        """Keep where the axes are, of a snapshot that has not been taken yet."""
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
                at_s = now_s - actual.age_s  # read before anybody looked
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
        """Return where an axis was seen last, with its age; None where it never was."""
        seen = self._last.get(axis)
        if seen is None:
            return None
        age_s = round(now_s - seen.at_s, 1)
        return Reading(nominal=seen.nominal, corrected=seen.corrected, age_s=age_s)

    def target(self, axis: str, now_s: float) -> LastTarget | None:
        """Return how old the target of an axis is; None where it has none."""
        target = self._targets.get(axis)
        if target is None or target.nominal is None:
            return None
        return LastTarget(round(now_s - target.at_s, 1), target.is_older)

    def history(self, axis: str) -> Sequence[PositionSample] | None:
        """Return the last ten minutes of an axis, oldest first; None: nothing is known of it."""
        kept = self._history.get(axis)
        return None if kept is None else tuple(kept)

    def newest(self) -> dict[str, PositionSample]:
        """Return where each axis was seen last, or that nobody knew."""
        return {axis: kept[-1] for axis, kept in self._history.items() if kept}


def _seen(axis: AxisStatus, now_s: float) -> PositionSample:
    nominal, corrected = axis.nominal_actual, axis.corrected_actual
    correction = axis.correction
    if axis.compensation != "shadow" and nominal is not None and corrected is not None:
        correction = corrected - nominal
    at_s = now_s - (axis.actual_age_s or 0.0)
    return PositionSample(at_s, nominal, corrected, correction, axis.compensation)
