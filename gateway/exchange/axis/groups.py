"""Axes that know each other: those that carry one beam together (M11), and those that act on each other."""

from collections.abc import Iterable, Sequence

from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.beam import Beam
from gateway.exchange.axis.cross_term import Partner


def join(axes: Sequence[Axis], groups: Iterable[Iterable[str]]) -> None:
    """Make the axes of each group know each other, and each axis those that act on it."""
    join_terms(axes)
    by_name = {axis.plan.name: axis for axis in axes}
    for names in groups:
        members = [by_name[name] for name in names if name in by_name]
        beam = Beam()
        for axis in members:
            axis.join(tuple(other for other in members if other is not axis), beam)


def join_terms(axes: Iterable[Axis]) -> None:
    """Let each axis find the axes that act on it, also those of other lines."""
    axes = tuple(axes)
    partners = {axis.plan.name: Partner(axis.motion, axis.reference) for axis in axes}
    for axis in axes:
        if axis.terms is not None:
            axis.terms.join(partners)
