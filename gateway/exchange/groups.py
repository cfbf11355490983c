"""Axes that carry one beam together: what holds for one holds for all of them (M11)."""

from collections.abc import Iterable, Sequence

from gateway.exchange.axis import AxisExchange
from gateway.exchange.rewriting import Rewriting
from gateway.exchange.terms import join_terms


def join(axes: Sequence[AxisExchange], groups: Iterable[Iterable[str]]) -> None:
    """Make the axes of each group know each other, and each axis those that act on it."""
    join_terms(axes)
    by_name = {axis.plan.name: axis for axis in axes}
    for names in groups:
        members = [by_name[name] for name in names if name in by_name]
        for axis in members:
            axis.peers = tuple(other for other in members if other is not axis)
            hold_back(axis)


def end_remapped(rewritings: Iterable[Rewriting]) -> list[AxisExchange]:
    """End the compensation of every axis whose registers a request moved about; return those it ended for."""
    ended = []
    for rewriting in rewritings:
        for own in rewriting.request.unit.axes if rewriting.remaps else ():
            for axis in (own, *own.peers):
                if not axis.is_ended:
                    axis.end()
                    ended.append(axis)
    return ended


def hold_back(axis: AxisExchange) -> None:
    """Compensate the axes of a group only while every one of them knows where it is."""
    members = (axis, *axis.peers)
    is_whole = all(member.reference.is_found for member in members)
    for member in members:
        was_referenced = member.is_referenced
        member.is_held_back = not is_whole
        member.follow_reference(was_referenced=was_referenced)
