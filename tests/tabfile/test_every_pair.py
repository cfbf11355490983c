"""Any two dialects that can hold a table: from one into the other and back, as far as the target resolves."""

from dataclasses import dataclass
from itertools import pairwise, product
from typing import Final

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import DIALECTS, ErrorSense, WriteOptions, dialect_named, parse_table
from gateway.tabfile.conversion import Converted, converted, resample
from tests.soak import repeated


@dataclass(frozen=True, slots=True)
class Holds:
    """What a dialect can hold: ``step`` of its corrections and ``place`` of its positions, in units.

    ``largest`` correction that fits, ``scale`` in counts per unit of the control that reads the file.
    """

    step: float
    place: float = 0.0
    is_even: bool = True
    home: str = "anywhere"
    """Where the table may have its 0: anywhere, at either end, at the start."""
    largest: float = 0.05
    scale: float | None = 100_000.0
    file_axis: str = "X"
    is_backward_filled: bool = False
    """A backward column that is all 0 means something else there, and is not written."""
    slope_error: float = 0.0
    """Share of slope x correction that the dialect cuts off at bends."""

    def within(self, table: CorrectionTable) -> float:
        """Return how far off a correction may be: half a step, and what a shifted point makes of a slope."""
        bends = self.slope_error * table.max_slope() * table.max_correction()
        return 0.5 * self.step * (1 + 1e-6) + table.max_slope() * self.place + bends + 1e-12


HOLDS: Final = {
    # whole counts, of the travel too
    "centroid-1": Holds(1e-5, 1e-5, home="end"),
    "centroid-2": Holds(1e-7, 1e-6),
    "centroid-3": Holds(1e-8, 1e-8, home="end"),
    "csv": Holds(0.0, is_even=False),
    # 1 µm and -7 to 7 of them from point to point, half a µm and -128 to 127
    "fanuc-csv": Holds(1e-3, largest=0.003, scale=1000.0),
    "mitsubishi-csv": Holds(0.5e-3, largest=0.03, scale=1000.0),
    # both numbers of type 0 are rounded
    "linuxcnc-0": Holds(2e-8, 1e-8, is_even=False),
    "linuxcnc-1": Holds(1e-8, 1e-8, is_even=False),
    # 0.01 of an increment
    "isg": Holds(1e-7, 1e-7, is_even=False),
    "fagor-8055": Holds(1e-4, 1e-4, is_even=False, is_backward_filled=True),
    "fagor-8065": Holds(1e-4, 1e-4, is_even=False),
    "aerotech-cal": Holds(1e-6, 1e-6),
    "siemens-eec": Holds(1e-8),
    "siemens-cec": Holds(1e-8),
    "weihong": Holds(1e-6, 1e-6, is_even=False),
    "mint": Holds(2e-8, 2e-8, home="start", file_axis="0", slope_error=4.0),
    "heidenhain-com": Holds(1e-6, 1e-6, is_even=False, is_backward_filled=True),
}
PAIRS: Final = list(product(HOLDS, HOLDS))


@st.composite
def tables(draw: st.DrawFn, names: tuple[str, str]) -> CorrectionTable:
    """What both can hold: slopes up to 0.5 %, 0 at home."""
    one, other = (HOLDS[name] for name in names)
    size = draw(st.integers(3, 12))
    sides = st.integers(-size + 1, 0)
    homes = {one.home, other.home}
    if "start" in homes:
        sides = st.just(0)
    elif "end" in homes:
        sides = st.sampled_from([-size + 1, 0])
    home = -draw(sides)
    if one.is_even or other.is_even:
        step = draw(st.sampled_from([0.5, 1.0, 2.5, 25.0]))
        positions = [(index - home) * step for index in range(size)]
    else:
        widths = draw(st.lists(st.integers(500, 30_000), min_size=size - 1, max_size=size - 1))
        positions = [sum(widths[:index]) / 1000 for index in range(size)]
        positions = [round(x - positions[home], 3) for x in positions]
    shortest = min(high - low for low, high in pairwise(positions))
    largest = min(0.0025 * shortest, one.largest, other.largest)
    values = st.lists(st.floats(-largest, largest), min_size=size, max_size=size)
    forward = draw(values)
    backward = draw(values) if all(dialect_named(name).directions == 2 for name in names) else forward
    if any(holds.is_backward_filled for holds in (one, other)) and backward is not forward:
        backward[1 if home == 0 else 0] = -largest
    # home is where the measurement is 0
    forward, backward = ([*curve[:home], 0.0, *curve[home + 1 :]] for curve in (forward, backward))
    return make_table(positions, forward, backward, Units.MM)


def turned_into(table: CorrectionTable, name: str) -> tuple[Converted, CorrectionTable]:
    """Return how a dialect holds a table, and what is read back."""
    holds = HOLDS[name]
    options = WriteOptions(
        axis="x",
        file_counts_per_unit=holds.scale,
        file_axis=holds.file_axis,
        sense=ErrorSense.ACTUAL_MINUS_COMMAND,
    )
    result = converted(table, dialect_named(name), options)
    again = parse_table(result.written.text.encode(), f"a {name} file", result.written.context)
    return result, again.table.in_units(table.units)


def on_grid_for(table: CorrectionTable, name: str, step: float) -> tuple[CorrectionTable, float]:
    """Return the table on a grid that a dialect can hold, and what that changes.

    A Mint program has its points where the nut is, for each direction elsewhere: what is read from one is on
    no even grid, and points may lie closer together than others can write them.
    """
    shortest = min(high - low for low, high in pairwise(table.positions))
    if table.even_step or (not HOLDS[name].is_even and shortest > 0.1):
        return table, 0.0
    even = resample(table, step, name)
    return even.table, even.difference


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_a_table_goes_from_one_dialect_into_the_other_and_back(one: str, other: str) -> None:
    @settings(max_examples=repeated(60))
    @given(tables((one, other)))
    def check(table: CorrectionTable) -> None:
        assume(table.max_correction() > 0)
        step = (table.last - table.first) / (len(table.positions) - 1)
        for name in (one, other, one, other, one):
            table, changed = on_grid_for(table, name, step)
            # only bends between the points of a grid are cut, and these programs bend beside it
            assert changed <= 4 * table.max_slope() * table.max_correction() + 1e-7
            result, table = turned_into(table, name)
            assert result.difference <= HOLDS[name].within(table)
            assert table.units is Units.MM

    check()


def test_every_dialect_that_can_be_written_has_a_row() -> None:
    assert set(HOLDS) == {dialect.name for dialect in DIALECTS if dialect.is_writable}


@pytest.mark.parametrize("name", HOLDS)
def test_what_is_said_of_directions_is_so(name: str) -> None:
    has_two = dialect_named(name).directions == 2
    both = make_table([0.0, 10.0, 20.0], [0.0, 0.003, 0.006], [0.0, 0.001, 0.002], Units.MM)
    result, again = turned_into(both, name)
    assert again.is_unidirectional is not has_two
    assert any("lost motion" in loss for loss in result.written.losses) is not has_two
