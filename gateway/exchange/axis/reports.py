"""What an axis reports: events that wait for its line, and what it reported last.

An event of a moment is reported when it happens. A lasting state is compared with the state that was reported
last, so that each change is reported once. The line collects the events after each of its inputs
(``Axis.take_events``).
"""

from collections import deque
from collections.abc import Iterable
from typing import Final

from gateway.catalogue import exchange_events
from gateway.catalogue.entry import EventEntry
from gateway.exchange.axis.reach import DriveReach
from gateway.exchange.axis.reference import AxisReference
from gateway.exchange.events import Event
from gateway.exchange.plan import AxisPlan
from gateway.times import NS_PER_S

REWRITTEN_EVERY_NS: Final = 60 * NS_PER_S
"""Minimum time between reports of restaging; every restaging is counted."""
MOST_BRANCH_CHANGES: Final = 5
HUNTS_WITHIN_NS: Final = 10 * NS_PER_S
"""More branch changes than that within this time are reported."""
HUNTING_EVERY_NS: Final = 60 * NS_PER_S
"""Minimum time between two such reports."""


class Hunting:
    """The newest branch changes of one axis: a controller may repeat one target with jitter.

    Time is monotonic, in ns.
    """

    __slots__ = ("_changes_ns", "_reported_ns")

    def __init__(self) -> None:
        self._changes_ns: deque[int] = deque(maxlen=MOST_BRANCH_CHANGES + 1)
        self._reported_ns: int | None = None

    def count_change(self, now_ns: int) -> bool:
        """Count a change; return whether to report it now."""
        self._changes_ns.append(now_ns)
        if len(self._changes_ns) <= MOST_BRANCH_CHANGES or now_ns - self._changes_ns[0] > HUNTS_WITHIN_NS:
            return False
        if self._reported_ns is not None and now_ns - self._reported_ns < HUNTING_EVERY_NS:
            return False
        self._reported_ns = now_ns
        return True


class AxisReports:
    """The events of one axis. Time is monotonic, in ns."""

    __slots__ = (
        "_name",
        "_reach",
        "_reference",
        "_units",
        "began",
        "events",
        "hunting",
        "reported_referenced",
        "reported_rewrite_ns",
        "reported_unknown",
        "reported_unsure",
    )

    def __init__(self, plan: AxisPlan, reference: AxisReference, reach: DriveReach) -> None:
        self._name, self._units = plan.name, plan.settings.units.value
        self._reference, self._reach = reference, reach
        self.events: list[Event] = []
        """Events that the line has not collected yet."""
        self.hunting = Hunting()
        self.began: tuple[float, float] | None = None
        """Offset with which a stream began, and the rest that was motion, in units; until reported."""
        self.reported_referenced = None if reference.follows_homed_bit else reference.is_referenced
        self.reported_unsure = False
        self.reported_rewrite_ns: int | None = None
        self.reported_unknown: tuple[tuple[int, int], ...] | None = None
        """Register contents that were last reported as unknown."""

    def report(self, kind: EventEntry, detail: str = "") -> None:
        """Report an event of this axis."""
        self.events.append(Event(kind, self._name, detail))

    def add(self, events: Iterable[Event]) -> None:
        """Report events that another part of this axis has made."""
        self.events += events

    def take(self, *, is_unsure: bool) -> tuple[Event, ...]:
        """Return the new events; ``is_unsure``: whether the branch in force was assumed, and matters."""
        reference = self._reference
        if reference.is_referenced is not self.reported_referenced and reference.was_reported:
            self._report_reference()
        if is_unsure is not self.reported_unsure:
            self.reported_unsure = is_unsure
            if is_unsure:
                detail = "its position is not known well enough; its branch is assumed"
                if self._reach.is_unreadable:
                    detail += "; its drive refuses to report its actual position"
                self.report(exchange_events.DIRECTION_UNSURE, detail)
        if not self.events:
            return ()
        taken = tuple(self.events)
        self.events = []
        return taken

    def _report_reference(self) -> None:
        self.reported_referenced = self._reference.is_referenced
        if self._reference.is_referenced:
            self.report(exchange_events.AXIS_REFERENCED)
            return
        detail = "the drive does not say that it is homed: positions pass 1:1"
        if not self._reference.follows_homed_bit:
            detail = "its drive may report a wrong position: positions pass 1:1"
        if self._reference.waits_for_peers and self._reference.is_found:
            detail = "another axis of its group is not referenced: positions pass 1:1"
        self.report(exchange_events.REFERENCE_LOST, detail)

    def report_unknown(self, contents: tuple[tuple[int, int], ...]) -> None:
        """Report register contents that the map does not know; the same contents only once."""
        if self.reported_unknown == contents:
            return
        self.reported_unknown = contents
        shown = ", ".join(f"{address:#06x} = {word:#06x}" for address, word in contents)
        what = f"the register map does not know {shown}" if shown else "a frame has no known meaning"
        self.report(exchange_events.UNKNOWN_MODE, f"{what}: it passed unchanged")

    def report_rewritten(self, count: int, now_ns: int) -> None:
        """Report restaging, but not too often: an axis that alternates needs it at every second move."""
        reported_ns = self.reported_rewrite_ns
        if reported_ns is None or now_ns - reported_ns >= REWRITTEN_EVERY_NS:
            self.reported_rewrite_ns = now_ns
            detail = f"a staged target was rewritten for its trigger; {count} on this line since the start"
            self.report(exchange_events.RESTAGED, detail)

    def count_branch_change(self, now_ns: int) -> None:
        """Count a change of the branch; report too many of them."""
        if self.hunting.count_change(now_ns):
            detail = f"its branch changed more than {MOST_BRANCH_CHANGES} times in 10 s"
            self.report(exchange_events.BRANCH_HUNTS, detail)

    def begin_stream(self, offset: float, rest: float) -> None:
        """A stream begins with an offset, in units; ``rest``: what was motion. Reported if it is sent."""
        self.began = (offset, rest)

    def report_beginning(self) -> None:
        """Report the offset with which a stream began."""
        if self.began is None:
            return
        (offset, rest), units = self.began, self._units
        self.began = None
        if offset or rest:
            what = f"the drive was {offset:+.6g} {units} from the first setpoint; this offset stays in force"
            motion = f"; {rest:+.6g} {units} more cannot be a correction and was dropped" if rest else ""
            self.report(exchange_events.STREAM_BEGAN, f"{what} until the table has taken over{motion}")
