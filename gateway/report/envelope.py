"""Curves of very many points: what a picture can show of them, and nothing that it would hide."""

from collections.abc import Sequence
from typing import Final

MOST_POINTS: Final = 2000
"""A picture is at most some thousand pixels wide: more points make it slower, not better."""


def thinned(positions: Sequence[float], values: Sequence[float]) -> tuple[list[float], list[float]]:
    """Return a curve of at most :data:`MOST_POINTS` points that covers the same ink.

    Of each stretch of neighbouring points the smallest and the largest stay, in their order, and with them
    both ends: no peak is lost. A shorter curve is returned as it is.

    >>> x, y = thinned(range(10_000), [0.0] * 7_000 + [9.0] + [0.0] * 2_999)
    >>> len(x) <= MOST_POINTS, max(y), x[y.index(9.0)], x[0], x[-1]
    (True, 9.0, 7000, 0, 9999)
    """
    count = len(positions)
    if count <= MOST_POINTS:
        return list(positions), list(values)
    stretch = stretch_of(count)
    kept = {0, count - 1}
    for start in range(0, count, stretch):
        part = range(start, min(start + stretch, count))
        kept |= {min(part, key=values.__getitem__), max(part, key=values.__getitem__)}
    order = sorted(kept)
    return [positions[i] for i in order], [values[i] for i in order]


def stretch_of(count: int) -> int:
    """Return how many neighbouring points of ``count`` make one stretch: two points of the picture."""
    return -(-count // ((MOST_POINTS - 2) // 2))


def thinning_note(count: int) -> str:
    """Say that a curve of ``count`` points was thinned; empty where it was not."""
    if count <= MOST_POINTS:
        return ""
    return f" Of each {stretch_of(count)} of the {count} points the smallest and the largest are drawn."
