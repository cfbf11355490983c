"""Fanuc and Mitsubishi increments: sums from the reference outward, turns, rounding of sums."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import WriteOptions, dialect_named, explain, parse_table
from tests.tabfile.texts import Texts

TABLES = Path(__file__).parents[2] / "tables"
FANUC = (TABLES / "fanuc" / "x.csv").read_text()
MITSUBISHI = (TABLES / "mitsubishi" / "x.csv").read_text()
MM: dict[str, Any] = {"file_units": Units.MM, "file_counts_per_unit": 1000.0}
DEGREES: dict[str, Any] = {"file_units": Units.DEGREE, "file_counts_per_unit": 1000.0}
FILE = Texts("table.csv")
parse, refused = FILE.parse, FILE.refused


def fanuc(parameters: str, values: str, first: int) -> str:
    names = ("3620", "3621", "3622", "3623", "3624")
    lines = [f"{name},{number}" for name, number in zip(names, parameters.split(), strict=True)]
    points = [f"{first + index},{value}" for index, value in enumerate(values.split())]
    return "\n".join([*lines, "point,value", *points])


def one_way(positions: list[float], values: list[float], units: Units) -> CorrectionTable:
    return make_table(positions, values, values, units)


def in_micrometres(numbers: list[int]) -> Any:
    return pytest.approx([number / 1000 for number in numbers], abs=1e-15)


def test_fanuc_manual_example_is_summed_up_from_the_reference_outward() -> None:
    loaded = parse(FANUC, **MM)
    assert loaded.format == "fanuc-csv"
    assert list(loaded.table.positions) == [50.0 * step for step in range(-8, 10)]
    # Up from 0 with the values of points 41 to 49: +2 +1 0 -1 -1 -2 0 +1 +2.
    # Down from 0 against the values of points 40 to 33: -1 0 -1 0 -2 +1 +1 +2, each with its sign turned.
    sums = [0, 2, 3, 4, 2, 2, 1, 1, 0, 2, 3, 3, 2, 1, -1, -1, 0, 2]
    assert list(loaded.table.forward) == in_micrometres(sums)
    assert loaded.table.is_unidirectional
    # half way between 4 um at -250 and 2 um at -200
    assert explain(loaded, -225.0).forward.correction == pytest.approx(0.003, abs=1e-15)
    assert loaded.source.behaves_as == ('outside = "hold"',)
    assert "reference point 40 is at 0 mm" in loaded.source.decisions[0]
    assert loaded.source.decisions[1].startswith("assumed")


def test_line_of_a_point_is_that_of_the_value_which_leads_there() -> None:
    rows = parse(FANUC, **MM).source.rows
    # 33 stands on line 9 and is crossed last on the way down; 49 stands on line 25
    assert [rows[0].forward_line, rows[8].forward_line, rows[-1].forward_line] == [9, None, 25]


def test_fanuc_magnification_multiplies_and_start_moves_the_reference() -> None:
    loaded = parse(fanuc("1 1 2 10 0.5", "3 -7", 1), file_start=-20.0, **MM)
    # point 1 is the section below the reference, point 2 the one above: -30 um at its lower end, 0, -70 um
    assert list(loaded.table.positions) == [-20.0, -19.5, -19.0]
    assert list(loaded.table.forward) == in_micrometres([-30, 0, -70])


def test_fanuc_reference_at_either_end() -> None:
    above = parse(fanuc("0 1 3 1 10", "1 2 -4", 1), **MM).table
    assert (list(above.positions), list(above.forward)) == ([0, 10, 20, 30], in_micrometres([0, 1, 3, -1]))
    below = parse(fanuc("3 1 3 1 10", "1 2 -4", 1), **MM).table
    assert (list(below.positions), list(below.forward)) == ([-30, -20, -10, 0], in_micrometres([1, 2, 4, 0]))


def test_fanuc_turn_has_its_first_point_twice_and_sums_up_to_nothing() -> None:
    # the rotary example of the manual: reference 60, 45 degrees, 60 = 68; values are ours
    revolution = fanuc("60 60 68 1 45", "-2 1 2 -1 0 3 -2 -1 -2", 60)
    table = parse(revolution, **DEGREES).table
    assert (table.first, table.last) == (0.0, 360.0)
    assert list(table.forward) == in_micrometres([0, 1, 3, 2, 2, 5, 3, 2, 0])
    error = refused(revolution.replace("60,-2", "60,-3"), **DEGREES)
    assert (error.line, error.found) == (7, "-3 at point 60, but -2 at point 68, one turn later")
    error = refused(revolution.replace("65,3", "65,4"), **DEGREES)
    assert "the sum of the values over a turn is 1" in error.found
    assert "at most one turn" in str(refused(fanuc("0 1 3 1 121", "0 0 0", 1), **DEGREES))
    # on a linear axis point 60 is a section like any other
    assert parse(revolution, **MM).table.first == -45.0


def test_mitsubishi_values_are_twice_the_step_on_both_sides() -> None:
    # Commanded steps of 100 mm. Above home the axis moves 100.003 and 100.002: (100 - 100.003) x 2 = -6, then
    # -4, in 0.001 mm. Below it moves -100.002 and -100.003: (100 + -100.002) x 2 = -4, then -6.
    loaded = parse(MITSUBISHI, **MM)
    assert loaded.format == "mitsubishi-csv"
    assert list(loaded.table.positions) == [-200, -100, 0, 100, 200]
    # the nut stands at -200.005, -100.002, 0, 100.003, 200.005: what is missing is added
    assert list(loaded.table.forward) == in_micrometres([5, 2, 0, -3, -5])
    assert [row.forward_line for row in loaded.source.rows] == [8, 9, None, 11, 12]


def test_mitsubishi_scale_factor_and_reference() -> None:
    double = parse(MITSUBISHI.replace("magnification,1", "magnification,2"), **MM)
    assert list(double.table.forward) == in_micrometres([10, 4, 0, -6, -10])
    error = refused(MITSUBISHI.replace("3,0", "3,1"), **MM)
    assert (error.line, error.allowed) == (10, "0: no section ends there")
    error = refused(MITSUBISHI.replace("reference,3", "reference,6"), **MM)
    assert (error.line, error.found) == (2, "reference point 6, points 1 to 5")


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"file_counts_per_unit": 1000.0}, "states no units"),
        ({"file_units": Units.MM}, "file_counts_per_unit is missing"),
        ({"file_units": Units.MM, "file_counts_per_unit": -1000.0}, "file_counts_per_unit = -1000"),
        ({**MM, "units": Units.DEGREE}, "axis in degree"),
        ({**MM, "travel": (3000.0, 4000.0)}, "outside travel"),
    ],
)
@pytest.mark.parametrize("text", [FANUC, MITSUBISHI])
def test_what_must_be_told_and_must_fit(text: str, facts: dict[str, Any], message: str) -> None:
    assert message in str(refused(text, **facts))


@pytest.mark.parametrize("text", [FANUC, MITSUBISHI])
def test_a_table_outside_travel_is_asked_for_once(text: str) -> None:
    error = refused(text, **MM, travel=(3000.0, 4000.0))
    assert error.allowed == "a table of this axis; the right file_units, file_start and travel"


def test_scale_is_per_unit_of_the_axis() -> None:
    # 25400 counts per inch are 1000 per mm
    told: dict[str, Any] = {"units": Units.INCH, "file_units": Units.MM, "file_counts_per_unit": 25400.0}
    assert list(parse(FANUC, **told).table.forward) == pytest.approx(list(parse(FANUC, **MM).table.forward))


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("3620,40", "3620,4O", 3, "a whole number 0 to"),
        ("3620,40", "3620,32", None, ""),
        ("3620,40", "3620,31", 3, "3620 from 32 to 49"),
        ("3620,40", "3620,50", 3, "3620 from 32 to 49"),
        ("3621,33", "3622,33", 4, "3621 and its number"),
        ("3621,33", "3621,32", 9, "point 32: every point once"),
        ("3622,49", "3622,48", 25, "no more points after 48"),
        ("3622,49", "3622,50", 25, "points up to 50"),
        ("3622,49", "3622,32", 5, "33 to"),
        ("3623,1", "3623,0", 6, "1 to 100"),
        ("3624,50", "3624,-50", 7, "above 0"),
        ("3624,50", "3624,50,1", 7, "3624 and its number"),
        ("3624,50\n", "3624,50\n3626,3\n", 8, "bidirectional compensation"),
        ("3621,33", "3605,1", 4, "bidirectional compensation"),
        ("point,value\n", "", 8, "'point,value' above the values"),
        ("37,0", "37,8", 13, "-7 to 7"),
        ("37,0", "37,-8", 13, "-7 to 7"),
        ("37,0", "37,0.5", 13, "a whole number"),
        ("37,0", "37", 13, "a whole number"),
        ("37,0\n", "", 13, "point 37: every point once"),
        ("37,0\n", "37,0\n37,0\n", 14, "point 38: every point once"),
        ("37,0\n38,-1\n", "38,-1\n37,0\n", 13, "point 37: every point once"),
    ],
)
def test_fanuc_grammar_is_strict(old: str, new: str, line: int | None, message: str) -> None:
    text = FANUC.replace(old, new, 1)
    if line is None:
        parse(text, **MM)  # the reference one below the first point: the first section begins there
        return
    assert message in str(refused(text, **MM, line=line))


def test_limit_of_the_values_may_be_raised() -> None:
    text = FANUC.replace("point,value", "limit,127\npoint,value").replace("37,0", "37,-127")
    # sections 37 to 40 lie between -200 and 0: -127 - 1 + 0 - 1 = -129, so 129 at -200
    assert explain(parse(text, **MM), -200.0).forward.correction == pytest.approx(0.129)
    assert "limit and a whole number 7 to 127" in str(refused(text.replace("limit,127", "limit,128"), **MM))
    assert "-127 to 127" in str(refused(text.replace("37,-127", "37,-128"), **MM))


@pytest.mark.parametrize(("text", "values"), [(FANUC, "17"), (MITSUBISHI, "5")])
def test_sums_in_comments_and_axis_are_checked(text: str, values: str) -> None:
    assert parse(f"# points: {values}\n# axis: x\n{text}", axis="X", **MM).source.axis == "X"
    assert "'points' on line 1" in str(refused(f"# points: 4\n{text}", **MM))
    assert "read for axis Y" in str(refused(f"# axis: x\n{text}", axis="Y", **MM))


def test_fanuc_writer_rounds_sums_and_not_steps() -> None:
    # 0.4 um a step: single steps would all round to 0 and lose 1.6 um
    table = one_way([0, 10, 20, 30, 40], [i * 0.0004 for i in range(5)], Units.MM)
    result = dialect_named("fanuc-csv").write(table, WriteOptions(axis="x", file_counts_per_unit=1000.0))
    # sums in um 0, 0.4, 0.8, 1.2, 1.6 -> 0, 0, 1, 1, 2
    assert result.text.splitlines()[4:] == [
        "3620,0",
        "3621,1",
        "3622,4",
        "3623,1",
        "3624,10",
        "point,value",
        "1,0",
        "2,1",
        "3,0",
        "4,1",
    ]
    assert result.text.splitlines()[1:3] == ["# axis: X", "# points: 4"]
    assert "a resolution of 0.001 mm" in result.losses[0]


def test_fanuc_writer_takes_the_smallest_magnification_that_fits() -> None:
    table = make_table([-10, 0, 10], [0.02, 0, 0.003], [0.02, 0, 0.003], Units.MM)
    result = dialect_named("fanuc-csv").write(table, WriteOptions(file_counts_per_unit=1000.0))
    # -20 um in one section: with 3 pulses a value round(20 / 3) = 7 values, which fit
    assert "3623,3\n" in result.text
    assert "1,-7\n2,1\n" in result.text
    assert "a resolution of 0.003 mm" in result.losses[0]


def test_fanuc_writer_of_a_turn_repeats_the_last_value_at_the_reference() -> None:
    table = one_way([0, 90, 180, 270, 360], [0, 0.001, 0.003, 0.002, 0], Units.DEGREE)
    result = dialect_named("fanuc-csv").write(table, WriteOptions(file_counts_per_unit=1000.0))
    assert result.text.splitlines()[3:5] == ["3620,0", "3621,0"]
    assert result.text.splitlines()[-5:] == ["0,-2", "1,1", "2,2", "3,-1", "4,-2"]


def test_mitsubishi_writer_turns_the_sample_into_itself() -> None:
    table = parse(MITSUBISHI, **MM).table
    result = dialect_named("mitsubishi-csv").write(table, WriteOptions(file_counts_per_unit=1000.0))
    assert result.text.splitlines()[3:] == MITSUBISHI.splitlines()[1:]
    assert "a resolution of 0.0005 mm" in result.losses[0]


@st.composite
def _tables(draw: st.DrawFn) -> CorrectionTable:
    size = draw(st.integers(2, 60))
    zero = draw(st.integers(0, size - 1))
    step = draw(st.sampled_from([0.5, 10.0, 25.4, 50.0]))
    values = st.lists(st.floats(-0.05, 0.05), min_size=size, max_size=size)
    forward, backward = draw(values), draw(values)
    forward[zero] = backward[zero] = 0.0
    units = draw(st.sampled_from([Units.MM, Units.INCH]))
    return make_table([(i - zero) * step for i in range(size)], forward, backward, units)


@given(_tables(), st.sampled_from(["fanuc-csv", "mitsubishi-csv"]))
def test_no_sum_is_off_by_more_than_half_a_value(table: CorrectionTable, name: str) -> None:
    result = dialect_named(name).write(table, WriteOptions(file_counts_per_unit=1000.0))
    again = parse_table(result.text.encode(), "x.csv", result.context)
    magnification = int(result.text.split("3623," if name == "fanuc-csv" else "magnification,")[1].split()[0])
    value = magnification / 1000 / (1 if name == "fanuc-csv" else 2)
    means = [(f + b) / 2 for f, b in zip(table.forward, table.backward, strict=True)]
    assert list(again.table.positions) == pytest.approx(list(table.positions), abs=1e-7)
    assert list(again.table.forward) == pytest.approx(means, abs=value / 2 + 1e-12)
