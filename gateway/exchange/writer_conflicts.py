"""Whether another writer moves an axis too, or tries to: figures for the status, which decide nothing."""

from dataclasses import dataclass
from typing import Final

from gateway.status.axis import WriterConflictStatus
from gateway.times import NS_PER_S

CALM_NS: Final = 60 * NS_PER_S
"""A conflict ends after this time without another attempt."""


@dataclass(slots=True)
class WriterConflict:
    """Two writers of one axis, as long as their conflict lasts."""

    writers: tuple[str, str]
    """The holder, and the writer that tried to move the axis or did so, in the newest attempt."""
    since_ns: int
    last_ns: int
    refused: int = 0
    """Requests of one of them that were refused because the other moves the axis."""
    changes: int = 0
    """Times that one took the axis over from the other."""

    def count_refused(self) -> None:
        """A request of one of them was refused."""
        self.refused += 1

    def count_changed(self) -> None:
        """One of them took the axis over."""
        self.changes += 1

    def go_on(self, one: str, other: str, now_ns: int) -> None:
        """Record another attempt."""
        self.writers, self.last_ns = (one, other), now_ns


class WriterConflicts:
    """The writer conflicts of one line, by axis."""

    def __init__(self) -> None:
        self._found: dict[str, WriterConflict] = {}

    def refused(self, axis: str, holder: str, writer: str, now_ns: int) -> None:
        """Record that a writer was refused because another one moves the axis."""
        self._met(axis, holder, writer, now_ns).count_refused()

    def changed(self, axis: str, former: str, writer: str, now_ns: int) -> None:
        """Record that a writer took an axis over from another one."""
        self._met(axis, former, writer, now_ns).count_changed()

    def status(self, axis: str, now_ns: int) -> WriterConflictStatus | None:
        """Return the conflict about an axis; None: there is none any more."""
        found = self._found.get(axis)
        if found is None or now_ns - found.last_ns > CALM_NS:
            return None
        return WriterConflictStatus(
            writers=sorted(found.writers),
            since_s=round((now_ns - found.since_ns) / NS_PER_S, 3),
            refused=found.refused,
            changes=found.changes,
        )

    def _met(self, axis: str, one: str, other: str, now_ns: int) -> WriterConflict:
        found = self._found.get(axis)
        if found is None or now_ns - found.last_ns > CALM_NS:
            found = self._found[axis] = WriterConflict((one, other), now_ns, now_ns)
        found.go_on(one, other, now_ns)
        return found
