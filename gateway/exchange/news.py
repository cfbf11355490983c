"""What happened to the axes of a line, as events: each change once."""

from collections.abc import Callable, Iterable

from gateway.exchange.axis import AxisExchange
from gateway.exchange.events import Event, EventKind
from gateway.exchange.groups import hold_back


class AxisNews:
    """Compares what was said, and written down, last of each axis with what is so now."""

    def __init__(self, axes: Iterable[AxisExchange], on_event: Callable[[Event], None]) -> None:
        self._on_event = on_event
        self._said_referenced: dict[int, bool | None] = {
            id(axis): None if axis.reference.follows_bit else axis.is_referenced for axis in axes
        }

    def look(self, axes: Iterable[AxisExchange]) -> None:
        """Report what is new about these axes."""
        for axis in axes:
            if axis.peers:
                hold_back(axis)
                for peer in axis.peers:
                    self._look(peer)
            self._look(axis)

    def _look(self, axis: AxisExchange) -> None:
        if axis.memory is not None:
            axis.memory.look()
        for event in axis.news:
            self._on_event(event)
        axis.news.clear()
        if axis.is_referenced is not self._said_referenced[id(axis)] and axis.reference.is_known:
            self._say_reference(axis)
        if axis.is_unsure is not axis.was_unsure:
            axis.was_unsure = axis.is_unsure
            if axis.was_unsure:
                detail = "where the axis is could not be told; it keeps its branch"
                self._on_event(Event(EventKind.DIRECTION_UNSURE, axis.plan.name, detail))

    def _say_reference(self, axis: AxisExchange) -> None:
        self._said_referenced[id(axis)] = axis.is_referenced
        if axis.is_referenced:
            self._on_event(Event(EventKind.AXIS_REFERENCED, axis.plan.name))
            return
        detail = "the drive does not say that it is homed: positions pass 1:1"
        if not axis.reference.follows_bit:
            detail = "it may not stand where its drive says any more: positions pass 1:1"
        if axis.is_held_back and axis.reference.is_found:
            detail = "another axis of its group is not referenced: positions pass 1:1"
        self._on_event(Event(EventKind.REFERENCE_LOST, axis.plan.name, detail))
