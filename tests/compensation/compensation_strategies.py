"""Hypothesis strategies for tables and settings, shared by the tests of the compensation."""

from itertools import pairwise
from typing import Any

from hypothesis import strategies as st

from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units


@st.composite
def tables(draw: st.DrawFn, max_slope: float = 0.95, max_points: int = 12) -> CorrectionTable:
    """A table of any shape whose slopes stay below ``max_slope`` on both branches."""
    count = draw(st.integers(2, max_points))
    start = draw(st.floats(-1000, 1000))
    if draw(st.booleans()):
        steps = [draw(st.floats(0.01, 100))] * (count - 1)
    else:
        steps = draw(st.lists(st.floats(0.01, 100), min_size=count - 1, max_size=count - 1))
    positions = [start]
    for step in steps:
        positions.append(positions[-1] + step)
    branches = []
    for _ in range(2):
        curve = [draw(st.floats(-0.5, 0.5))]
        for left, right in pairwise(positions):
            slope = draw(st.floats(-max_slope, max_slope))
            curve.append(curve[-1] + slope * (right - left))
        branches.append(curve)
    return make_table(positions, branches[0], branches[1], Units.MM)


COUNTS_PER_UNIT = st.floats(0.5, 1e6).flatmap(lambda k: st.sampled_from([k, -k]))


def plain_settings(counts_per_unit: float = 1000.0, **more: Any) -> AxisSettings:
    """Settings without travel limits."""
    return AxisSettings(Units.MM, counts_per_unit, **more)
