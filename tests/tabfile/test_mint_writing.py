"""What is written as a Mint program and read back, and what it says is lost."""

import re
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import (
    FileContext,
    LoadedTable,
    WriteOptions,
    Written,
    dialect_named,
    explain,
    parse_table,
)


def write(table: CorrectionTable, **options: Any) -> Written:
    return dialect_named("mint").write(table, WriteOptions(**options))


def read_back(written: Written) -> LoadedTable:
    return parse_table(written.text.encode(), "x.mnt", written.context)


def said(written: Written) -> float:
    """The largest difference that the writer admits."""
    found = re.search(r"differs by up to (\S+) ", written.losses[0])
    assert found is not None
    return float(found[1])


def along(table: CorrectionTable, curve: Sequence[float], at: float) -> float:
    index = table.segment(at)
    low, high = table.positions[index], table.positions[index + 1]
    share = min(1.0, max(0.0, (at - low) / (high - low)))
    return curve[index] * (1 - share) + curve[index + 1] * share


def largest_difference(one: CorrectionTable, other: CorrectionTable, places: Sequence[float]) -> float:
    return max(
        abs(along(one, ours, at) - along(other, theirs, at))
        for at in places
        for ours, theirs in ((one.forward, other.forward), (one.backward, other.backward))
    )


def test_entries_are_the_inverse_at_even_motor_positions() -> None:
    # m = x + c: 0, 10.1, 20.05, 30. Motor at 10: x = 10 - 0.1 * 10 / 10.1 = 9.9009901, at 20: x =
    # 10 + 10 * 9.9 / 9.95 = 19.94974874
    curve = [0, 0.1, 0.05, 0]
    written = write(make_table([0, 10, 20, 30], curve, curve, Units.MM), file_axis="2")
    assert written.text.splitlines() == [
        "' Leadscrew table of axis 2 in mm, mark A at 0",
        "DIM fwdTable(3) = 9.9009901, 19.94974874, 30",
        "PRECISIONTABLE(2, fwdTable)",
        "PRECISIONINCREMENT.2 = 10",
        "PRECISIONOFFSET.2 = 0",
        "' Switch it on with the single table mode of axis 2",
    ]
    # the bend at 10 is cut: between (9.9009901, 0.0990099) and (19.94974874, 0.05025126) it is 0.09852943
    assert said(written) == pytest.approx(0.1 - 0.09852943, rel=0.005)
    assert written.context == FileContext(file_units=Units.MM, file_axis="2", file_start=0.0)


def test_two_directions_make_two_tables() -> None:
    written = write(make_table([-20, -10, 0], [0, 0.01, 0.0], [0, -0.01, 0], Units.INCH))
    assert [line.split("(")[0] for line in written.text.splitlines()] == [
        "' Leadscrew table of axis 0 in inch, mark A at -20",
        "DIM fwdTable",
        "DIM revTable",
        "PRECISIONTABLE",
        "PRECISIONINCREMENT.0 = 10",
        "PRECISIONOFFSET.0 = -20",
        "BACKLASHMODE.0 = _blOFF : REM the tables contain the lost motion",
        "PRECISIONMODE.0 = _lsDUAL_TABLE",
    ]
    assert any("axis 0" in loss for loss in written.losses)
    assert read_back(written).source.behaves_as == ('outside = "zero"',)


def test_published_program_comes_back_as_it_was() -> None:
    program = (
        "DIM f(5) = 10.02, 20.01, 30.00, 40.01, 50.01\nDIM r(5) = 10.01, 20.02, 29.99, 40.00, 50.01\n"
        "PRECISIONTABLE(0, f, r)\nPRECISIONINCREMENT.0 = 10\n"
    )
    loaded = parse_table(program.encode(), "x", FileContext(file_units=Units.MM, file_start=-7.5))
    written = write(loaded.table)
    assert "(5) = 10.02, 20.01, 30, 40.01, 50.01\n" in written.text
    assert "(5) = 10.01, 20.02, 29.99, 40, 50.01\n" in written.text
    assert "PRECISIONINCREMENT.0 = 10\nPRECISIONOFFSET.0 = -7.5\n" in written.text
    assert said(written) < 1e-9


def test_first_correction_grows_from_mark_a_below_the_table() -> None:
    table = make_table([0, 10, 20, 30], [0.03, 0.02, 0.03, 0.0], [0.01, 0.0, 0.01, -0.01], Units.MM)
    written = write(table)
    # 0.03 at a slope of 0.004 takes 7.5 mm, so one increment is enough
    assert "PRECISIONOFFSET.0 = -10" in written.text
    assert any("grows to that of the first point, 0" in loss for loss in written.losses)
    back = read_back(written)
    assert back.errors == ()
    assert back.table.first == -10.0
    # the motor is at 0 when the nut is at -0.03; from -10 to there 0.03 grows in a line
    assert explain(back, -5.0).forward.correction == pytest.approx(0.03 * 5 / 9.97, abs=1e-8)
    assert explain(back, 0.0).forward.correction == pytest.approx(0.03, abs=3.1e-5)
    # where an increment is too short for it, it takes several
    steep = write(make_table([0, 0.5, 1], [0.03, 0.03, 0.03], [0.03, 0.03, 0.03], Units.MM))
    assert "PRECISIONOFFSET.0 = -8" in steep.text
    assert read_back(steep).errors == ()
    assert largest_difference(table, back.table, [0.0, 5.0, 10.0, 20.0, 30.0]) <= said(written) + 2e-8


@given(
    st.lists(st.tuples(st.integers(-20_000, 20_000), st.integers(-20_000, 20_000)), min_size=2, max_size=30),
    st.sampled_from([5.0, 10.0, 25.4, 12.5]),
    st.integers(-5, 5),
    st.sampled_from([Units.MM, Units.DEGREE]),
)
def test_even_tables_come_back_within_what_was_said(
    curves: list[tuple[int, int]], step: float, first: int, units: Units
) -> None:
    positions = [(first + index) * step for index in range(len(curves))]
    forward, backward = ([point[column] * 1e-6 for point in curves] for column in (0, 1))
    table = make_table(positions, forward, backward, units)
    written = write(table)
    places = [position + part * step for position in positions[:-1] for part in (0, 0.01, 0.5, 0.99)]
    difference = largest_difference(table, read_back(written).table, [*places, positions[-1]])
    assert difference <= said(written) * 1.01 + 3e-8
    # bends are cut by no more than slope x correction, and both are small; below the table the slope is 0.004
    assert said(written) <= 4 * (table.max_slope() + 0.004) * table.max_correction() + 3e-8


@given(
    st.lists(st.tuples(st.integers(-9000, 9000), st.integers(-9000, 9000)), min_size=1, max_size=30),
    st.sampled_from([1.0, 10.0, 0.5]),
    st.integers(-1000, 1000),
)
def test_programs_come_back_exactly(entries: list[tuple[int, int]], increment: float, start: int) -> None:
    size = len(entries)
    tables = [
        [round(i * increment + entry[column] * 1e-6, 8) for i, entry in enumerate(entries, start=1)]
        for column in (0, 1)
    ]
    program = "".join(
        f"DIM {name}({size}) = {', '.join(f'{value:.6f}' for value in values)}\n"
        for name, values in zip("fr", tables, strict=True)
    )
    program += f"PRECISIONTABLE(3, f, r)\nPRECISIONINCREMENT.3 = {increment}\nPRECISIONOFFSET.3 = {start}\n"
    context = FileContext(file_units=Units.MM, file_start=float(start))
    loaded = parse_table(program.encode(), "x", context)
    written = write(loaded.table, file_axis="3")
    assert said(written) <= 1e-6
    back = read_back(written)
    assert largest_difference(loaded.table, back.table, loaded.table.positions) <= said(written) + 4e-8
