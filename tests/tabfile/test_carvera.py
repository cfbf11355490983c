"""Multipliers of the Carvera firmware: their integral by hand, and what is refused."""

import pytest

from gateway.compensation.curve import Curve
from gateway.tabfile import TabFileError, WriteOptions, dialect_named
from tests.tabfile.samples import CARVERA
from tests.tabfile.texts import Texts

FILE = Texts("pitch_compensation.dat")
load, refused = FILE.parse, FILE.said


def test_the_correction_is_the_integral_from_0_on() -> None:
    # 100 mm at 1.0002 are 20 µm longer; over the next 100 mm the multiplier falls to 1, on average 1.0001:
    # 10 µm. Below 0 a hundred mm at 1.0002 are 20 µm as well, the other way.
    rows = load("X -100 1.0002\nX 200 1.0\nX 100 1.0002\n").source.rows
    assert [(row.position, round(row.forward * 1e6)) for row in rows] == [
        (-100.0, -20_000),
        (100.0, 20_000),
        (200.0, 30_000),
    ]
    assert [row.forward for row in rows] == [row.backward for row in rows]


def test_points_that_do_not_reach_0_count_from_there_with_the_nearest_multiplier() -> None:
    # The firmware holds the multiplier outside: 50 mm at 1.0001 are 5 µm, 5 more up to 100.
    rows = load("Y 50 1.0001\nY 100 1.0001\n").source.rows
    assert [round(row.forward * 1e6) for row in rows] == [5_000, 10_000]
    # -100 to -50 at 0.9999: at -50 the command is 5 µm nearer to 0, at -100 10 µm.
    rows = load("Y -100 0.9999\nY -50 0.9999\n").source.rows
    assert [round(row.forward * 1e6) for row in rows] == [10_000, 5_000]


def test_by_how_much_straight_lines_leave_the_parabola_is_said() -> None:
    found = load("Z 0 1\nZ 100 1.0002\n")
    # The parabola is 1e-6 x^2: 10 µm at 100 and 2.5 µm at 50, where the line has 5.
    assert Curve(found.table).forward(50.0) == pytest.approx(0.005)
    (said,) = [each for each in found.source.decisions if "parabola" in each]
    assert "at most 2.5 µm, near 50" in said
    assert any("continues with the last multiplier" in each for each in found.source.decisions)


def test_an_axis_of_several_is_told() -> None:
    both = CARVERA.decode() + "Y 0 1\nY 10 1.0001\n"
    assert "points of X, Y" in refused(both)
    assert "but file_axis = 'Z'" in refused(both, file_axis="Z")
    assert [row.position for row in load(both, file_axis="y").source.rows] == [0.0, 10.0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("1.000120", "1.600120", "pitch_compensation.dat:2: multiplier 1.60012"),
        ("X 10.000000", "A 10.000000", "pitch_compensation.dat:2: 'A 10.000000 1.000120'"),
        ("X 10.000000 1.000120", "X 10.000000", "pitch_compensation.dat:2: 'X 10.000000'"),
        (
            "X 10.000000",
            "X 30.000000",
            "pitch_compensation.dat:3: a second point of X at 30 (the first is on line 2)",
        ),
        ("1.000120", "nan", "pitch_compensation.dat:2: "),
    ],
)
def test_what_the_firmware_would_pass_over_is_refused_with_its_line(old: str, new: str, words: str) -> None:
    text = CARVERA.decode()
    assert old in text
    assert words in refused(text.replace(old, new, 1))


def test_one_multiplier_is_a_scale_and_no_table() -> None:
    assert "into counts_per_unit" in refused("X 0 1.0001\n", format="carvera")


def test_it_is_read_only() -> None:
    with pytest.raises(TabFileError, match="the firmware's multipliers are not corrections"):
        dialect_named("carvera").write(load(CARVERA.decode()).table, WriteOptions(axis="X"))
