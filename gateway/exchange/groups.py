"""Axes that carry one beam together: what holds for one holds for all of them (M11)."""

from collections.abc import Iterable, Sequence

from gateway.exchange.axis import AxisExchange


def join(axes: Sequence[AxisExchange], groups: Iterable[Iterable[str]]) -> None:
    """Make the axes of each group know each other."""
    by_name = {axis.plan.name: axis for axis in axes}
    for names in groups:
        members = [by_name[name] for name in names if name in by_name]
        for axis in members:
            axis.peers = tuple(other for other in members if other is not axis)
            hold_back(axis)


def hold_back(axis: AxisExchange) -> None:
    """Compensate the axes of a group only while every one of them knows where it is."""
    members = (axis, *axis.peers)
    is_whole = all(member.reference.is_found for member in members)
    for member in members:
        was_referenced = member.is_referenced
        member.is_held_back = not is_whole
        member.follow_reference(was_referenced=was_referenced)
