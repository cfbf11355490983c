"""What a writer writes its reader reads back, and what it cannot hold it refuses or says."""

from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import FileContext, V1Layout, WriteOptions, dialect_named
from tests.tabfile.drawn import assert_same, means_of, read_back, there_and_back

_SIZES = st.integers(min_value=3, max_value=40)
_STEPS = st.sampled_from([0.5, 1.0, 0.05, 25.0, 2.54, 0.3])
_UNITS = st.sampled_from([Units.INCH, Units.MM])


@st.composite
def tables(
    draw: st.DrawFn,
    *,
    resolution: dict[Units, float],
    largest: int,
    at_home: bool = False,
    mean_at_home: bool = True,
) -> CorrectionTable:
    """Even grids whose corrections are whole multiples of the resolution of a dialect.

    Without ``mean_at_home`` the two directions cancel each other at home.
    """
    units, size, step = draw(_UNITS), draw(_SIZES), draw(_STEPS)
    values = st.lists(st.integers(-largest, largest), min_size=size, max_size=size)
    forward, backward = draw(values), draw(values)
    first = -(size - 1) if draw(st.booleans()) else 0
    if not at_home:
        first += draw(st.integers(-3, 3))
    positions = [(first + i) * step for i in range(size)]
    if not mean_at_home:
        backward[-first] = -forward[-first]
    unit = resolution[units]
    return make_table(positions, [v * unit for v in forward], [v * unit for v in backward], units)


@given(tables(resolution={Units.INCH: 1e-8, Units.MM: 1e-7}, largest=99_999))
def test_version_2_with_the_start_outside_the_file(table: CorrectionTable) -> None:
    assert_same(there_and_back("centroid-2", table)[1].table, table)


@given(
    tables(resolution={Units.INCH: 1e-8, Units.MM: 1e-7}, largest=99_999),
    st.sampled_from([25400.0, -200000.0]),
)
def test_version_2_with_counts_and_start_in_the_file(table: CorrectionTable, scale: float) -> None:
    written = dialect_named("centroid-2").write(table, WriteOptions(file_counts_per_unit=scale))
    assert_same(read_back(written, file_counts_per_unit=scale).table, table)


@given(tables(resolution={Units.INCH: 1e-8, Units.MM: 1e-8}, largest=99_999, at_home=True))
def test_version_3(table: CorrectionTable) -> None:
    assert_same(there_and_back("centroid-3", table, axis="x")[1].table, table)


@given(
    tables(
        resolution={Units.INCH: 1 / 40000, Units.MM: 1 / 40000}, largest=400, at_home=True, mean_at_home=False
    ),
    st.sampled_from([40000.0, -40000.0]),
    st.sampled_from(list(V1Layout)),
)
def test_version_1_keeps_the_mean_of_both_directions(
    table: CorrectionTable, scale: float, layout: V1Layout
) -> None:
    _, again = there_and_back("centroid-1", table, file_counts_per_unit=scale, v1_layout=layout)
    # whole counts: half a count of rounding; positions: half a count of TOTAL
    assert_same(again.table, means_of(table), 0.51 / 40000, 0.51 / 40000)


HOME_MINUS = make_table([0.0, 1.0, 2.0], [0.0, 0.0004, 0.0006], [0.0, 0.0002, 0.0004], Units.INCH)


def test_version_1_says_that_it_averages_and_rounds() -> None:
    written = dialect_named("centroid-1").write(HOME_MINUS, WriteOptions(file_counts_per_unit=40000.0))
    # means 3 and 5 tenths: 12 and 20 counts at 40000 per inch
    assert written.text == "2 80000\r\n12\r\n20\r\n"
    assert any("0.0002 inch is not in the file" in loss for loss in written.losses)
    assert any("0.000025 inch" in loss or "2.5e-05 inch" in loss for loss in written.losses)


def test_version_1_with_home_listed() -> None:
    options = WriteOptions(file_counts_per_unit=-40000.0, v1_layout=V1Layout.LISTED)
    assert dialect_named("centroid-1").write(HOME_MINUS, options).text == "3 -80000\r\n0\r\n-12\r\n-20\r\n"


def test_version_2_texts() -> None:
    written = dialect_named("centroid-2").write(
        HOME_MINUS, WriteOptions(axis="z", file_counts_per_unit=25400.0)
    )
    assert written.text.splitlines() == [
        "2 2 1 20 50800 0.000000 ; Ver. 2 compensation tables for Z axis",
        "    0.0000",
        "    4.0000",
        "    6.0000",
        "; backward data",
        "    0.0000",
        "    2.0000",
        "    4.0000",
    ]


def test_version_3_of_a_home_plus_axis_begins_at_home_with_the_backward_corrections() -> None:
    table = make_table([-2.0, -1.0, 0.0], [0.3, 0.2, 0.1], [-0.1, -0.2, 0.0], Units.MM)
    written = dialect_named("centroid-3").write(table, WriteOptions(axis="z"))
    assert written.text.splitlines()[1:7] == [
        "AXIS Z",
        "UNITS MILLIMETER",
        "INTERVAL 1",
        "ENTRIES 3",
        "\t+0.00000000\t+0.00000000\t+0.10000000",
        "\t-1.00000000\t-0.20000000\t+0.20000000",
    ]


def test_context_of_a_reader_is_what_the_file_does_not_say() -> None:
    written = dialect_named("centroid-2").write(HOME_MINUS, WriteOptions())
    assert written.context == FileContext(file_start=0.0)
    assert any("file_start 0" in loss for loss in written.losses)
