"""Drives that do not answer: which unit ids, and what their axes make of it."""

from collections.abc import Callable

from gateway.exchange.dispatch import Units
from gateway.exchange.events import Event, EventKind
from gateway.exchange.news import AxisNews


class SilentUnits:
    """The unit ids of a line whose last request was not answered."""

    def __init__(self, units: Units, news: AxisNews, on_event: Callable[[Event], None]) -> None:
        self._units = units
        self._news = news
        self._on_event = on_event
        self.ids: set[int] = set()

    def timed_out(self, unit_id: int) -> None:
        """Note that a request was not answered."""
        if unit_id not in self.ids:
            self.ids.add(unit_id)
            self._on_event(Event(EventKind.DRIVE_SILENT, None, f"unit id {unit_id}"))

    def doubt(self, unit_id: int, now_ns: int) -> None:
        """Let the axes of a unit doubt what they know."""
        axes = self._units.axes_of(unit_id)
        for axis in axes:
            axis.doubt(now_ns)
        self._news.look(axes)

    def answered(self, unit_id: int) -> None:
        """Note that one of them answered."""
        self.ids.discard(unit_id)
        self._on_event(Event(EventKind.DRIVE_ANSWERS, None, f"unit id {unit_id}"))
