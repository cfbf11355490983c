"""Tables drawn at random, and what a dialect reads of what it has written of them."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import LoadedTable, WriteOptions, Written, dialect_named, parse_table


def read_back(written: Written, **facts: Any) -> LoadedTable:
    """Return what is read of a file that was written, with the facts that its writer names."""
    return parse_table(written.text.encode(), "written", replace(written.context, **facts))


def there_and_back(name: str, table: CorrectionTable, **options: Any) -> tuple[Written, LoadedTable]:
    """Return what a dialect writes of a table, and reads again."""
    written = dialect_named(name).write(table, WriteOptions(**options))
    return written, read_back(written)


def means_of(table: CorrectionTable) -> CorrectionTable:
    """Return what is left of a table where both directions have one correction: their mean."""
    means = [(f + b) / 2 for f, b in zip(table.forward, table.backward, strict=True)]
    return make_table(table.positions, means, means, table.units)


def assert_same(
    one: CorrectionTable, other: CorrectionTable, within: float = 1e-12, places: float = 1e-8
) -> None:
    """Two tables are the same but for so much in their corrections and their positions."""
    assert one.units is other.units
    assert list(one.positions) == pytest.approx(list(other.positions), abs=places)
    assert list(one.forward) == pytest.approx(list(other.forward), abs=within)
    assert list(one.backward) == pytest.approx(list(other.backward), abs=within)


def assert_same_but_for_zeros(
    written: Written, again: CorrectionTable, table: CorrectionTable, unit: float, within: float
) -> None:
    """As :func:`assert_same`; but a column of zeros would mean "as forward", and one unit is in it."""
    if any(table.backward) or not any(table.forward):
        assert_same(again, table, within, 1e-9)
        return
    assert_same(make_table(again.positions, again.forward, table.backward, again.units), table, within, 1e-9)
    assert [abs(error) for error in again.backward] == [unit, *[0.0] * (len(table.positions) - 1)]
    assert "is written as 0.0" in written.losses[1]


@st.composite
def uneven(
    draw: st.DrawFn,
    units: Mapping[Units, float],
    steps: tuple[int, int] = (10_000, 90_000_000),
    start: int = 10**9,
    largest: int = 400,
) -> CorrectionTable:
    """Any points, sometimes evenly spaced; all numbers are multiples of the last place of a format."""
    system = draw(st.sampled_from(list(units)))
    widths = draw(st.lists(st.integers(*steps), min_size=1, max_size=20))
    if draw(st.booleans()):
        widths = widths[:1] * len(widths)
    at, positions = draw(st.integers(-start, start)), []
    for width in [0, *widths]:
        at += width
        positions.append(at * units[system])
    values = st.lists(st.integers(-largest, largest), min_size=len(positions), max_size=len(positions))
    forward = draw(values)
    backward = draw(st.one_of(st.just(forward), values, st.just([0] * len(positions))))
    unit = units[system]
    return make_table(positions, [v * unit for v in forward], [v * unit for v in backward], system)
