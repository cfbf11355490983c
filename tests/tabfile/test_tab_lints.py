"""Each lint with a table that trips it and one that does not."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.tabfile import (
    Decoded,
    FileContext,
    LintSeverity,
    LoadedTable,
    SourceRow,
    TabFileError,
    parse_table,
    read_table,
)
from gateway.tabfile.lints import run_lints
from tests.support.config import tab

TABLES = Path(__file__).parents[2] / "tables"


def codes(loaded: LoadedTable) -> set[str]:
    return {lint.code for lint in loaded.lints}


def tenths(forward: Sequence[float], backward: Sequence[float], **facts: Any) -> LoadedTable:
    """A version 2 table, a point each inch from 0 upwards, values in tenths."""
    name = facts.pop("name", "table.tab")
    comment = facts.pop("comment", "")
    lines = [f"2 {len(forward) - 1} 1.0 20 1 0 ;{comment}", *map(repr, forward), ";", *map(repr, backward)]
    return parse_table("\n".join(lines).encode(), name, FileContext(**({"file_start": 0.0} | facts)))


def microns(forward: Sequence[float], backward: Sequence[float], step: int = 10, **facts: Any) -> LoadedTable:
    """A version 3 table, a point each 10 mm from 0 upwards, values in mm."""
    rows = [f"{step * i} {f!r} {b!r}" for i, (f, b) in enumerate(zip(forward, backward, strict=True))]
    head = f"CNC10 TAB FILE VERSION 3\nAXIS X\nUNITS MILLIMETER\nINTERVAL {step}\nENTRIES {len(rows)}"
    return parse_table("\n".join([head, *rows]).encode(), "table.tab", FileContext(**facts))


SOUND = ([0.0, 1.0, 2.0, 3.0, 3.5, 3.0], [-1.0, 0.0, 1.0, 2.0, 2.5, 2.0])
"""Tenths: a bow with one tenth of lost motion."""


def test_sound_table_has_no_lint() -> None:
    assert codes(tenths(*SOUND, counts_per_unit=25400.0, travel=(0.0, 5.0), axis="x")) == set()


def test_l1_slope_above_its_limit_is_an_error_with_the_limit() -> None:
    # 0.11 mm over 10 mm: 0.011 against 0.01
    loaded = microns([0.0, 0.11, 0.11], [0.0, 0.11, 0.11])
    (lint,) = loaded.errors
    assert (lint.code, lint.line) == ("L1", 7)
    assert "0.01" in lint.message
    assert microns([0.0, 0.1, 0.1], [0.0, 0.1, 0.1]).errors == ()
    assert microns([0.0, 0.11, 0.11], [0.0, 0.11, 0.11], max_slope=0.02).errors == ()


def test_l1_slope_of_1_makes_no_table_at_all() -> None:
    with pytest.raises(TabFileError) as caught:
        microns([0.0, 10.0, 10.0], [0.0, 0.0, 0.0], max_slope=0.9999, max_correction=100.0)
    assert caught.value.problems[0].code == "L1"
    assert caught.value.line == 7
    assert microns([0.0, 9.99, 9.99], [0.0, 0.0, 0.0], max_slope=0.9999, max_correction=100.0).errors == ()


FORWARD, BACKWARD = SOUND
LOGGED = [0.0, 2.0, 5.0, 9.0, 14.0, 20.0], [-1.0, 1.0, 4.0, 8.0, 13.0, 19.0]
INCHES = [[value / 1e4 for value in values] for values in SOUND]
STRAIGHT = [round(i / 3, 4) for i in range(10)]
TRIPPED: list[tuple[str, bool, LoadedTable]] = [
    # L2: the mean of forward minus backward is below 0, as where the columns are exchanged
    ("L2", True, tenths(BACKWARD, FORWARD)),
    ("L2", False, tenths(FORWARD, FORWARD)),
    # L3: the backward list was logged from the other end
    ("L3", True, tenths(LOGGED[0], LOGGED[1][::-1])),
    ("L3", False, tenths(*LOGGED)),
    # L4: inches written as tenths
    ("L4", True, tenths(*INCHES)),
    ("L4", False, tenths([0.0, 0.01, 0.0], [0.0, 0.0, 0.0])),
    # L5: the correction at home: of a home minus axis the first forward one, …
    ("L5", True, tenths([1.0, 1.0, 1.0], [0.0, 0.0, 0.0])),
    ("L5", False, tenths([0.0, 1.0, 1.0], [-1.0, -1.0, -1.0])),
    # … of a home plus axis the last backward one, …
    ("L5", True, tenths([1.0, 1.0, 1.0], [0.0, 0.0, 1.0], file_start=-2.0)),
    ("L5", False, tenths([1.0, 1.0, 1.0], [1.0, 1.0, 0.0], file_start=-2.0)),
    # … at a reference mark the forward one at 0; half way between -1 at -0.5 and +1 at 0.5 it is 0
    ("L5", False, tenths([0.0, -1.0, 1.0], [9.0, 9.0, 9.0], file_start=-1.5)),
    ("L5", True, tenths([0.0, -1.0, 2.0], [9.0, 9.0, 9.0], file_start=-1.5)),
    # L6: rounding of a straight line is no outlier
    ("L6", False, tenths(STRAIGHT, STRAIGHT)),
    # L7: 0.24 tenths x 40000 counts per inch = 0.96 counts; 0.25 tenths are one count
    ("L7", True, tenths([0.0, 0.24, 0.1], [0.0, 0.2, 0.1], counts_per_unit=40000.0)),
    ("L7", False, tenths([0.0, 0.25, 0.1], [0.0, 0.2, 0.1], counts_per_unit=-40000.0)),
    ("L7", False, tenths([0.0, 0.24, 0.1], [0.0, 0.2, 0.1])),
    # L9: an empty column
    ("L9", True, tenths([0.0, 1.0, 1.0], [0.0, 0.0, 0.0])),
    ("L9", True, tenths([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])),
    ("L9", False, tenths([0.0, 1.0, 1.0], [0.0, 0.0, 0.1])),
    # L10: names that contradict each other
    ("L10", True, tenths(*SOUND, name="cnc10z.tab", axis="x")),
    ("L10", True, tenths(*SOUND, name="CNC7Z.TAB", comment=" for X axis")),
    ("L10", True, tenths(*SOUND, comment=" Z axis, inches", axis="x")),
    ("L10", False, tenths(*SOUND, name="CNC7Z.TAB", comment=" for z axis", axis="z")),
]


@pytest.mark.parametrize(("code", "is_tripped", "loaded"), TRIPPED)
def test_a_lint_is_there_or_not(code: str, loaded: LoadedTable, *, is_tripped: bool) -> None:
    assert (code in codes(loaded)) is is_tripped


@pytest.mark.parametrize(
    ("name", "facts"), [("centroid-v2-tb058", {"file_start": -2.5}), ("centroid-v2", {}), ("centroid-v3", {})]
)
def test_l2_passes_for_every_published_sample(name: str, facts: dict[str, Any]) -> None:
    loaded = read_table(TABLES / name / "cnc10z.tab", FileContext(**facts))
    mean = sum(f - b for f, b in zip(loaded.table.forward, loaded.table.backward, strict=True))
    # +3.67, +2.66 and +2.08 tenths with the published meaning of the columns
    expected = {"centroid-v2-tb058": 3.6667, "centroid-v2": 2.6652, "centroid-v3": 2.0778}[name]
    assert mean / len(loaded.table.positions) * 1e4 == pytest.approx(expected, abs=1e-4)
    assert "L2" not in codes(loaded)


def test_l3_is_silent_where_the_turned_list_is_hardly_smoother() -> None:
    # CNC Services' sample: 3.93 turned against 4.54 as given, 0.87
    assert "L3" not in codes(read_table(TABLES / "centroid-v2" / "cnc10z.tab", FileContext()))


def tb058(**facts: Any) -> LoadedTable:
    return read_table(TABLES / "centroid-v2-tb058" / "cnc10z.tab", FileContext(travel=(-2.6, 0.0), **facts))


def test_l3_is_silent_where_the_turned_list_would_break_the_rule_of_home() -> None:
    """TB058's own table ends at home with a last reverse value of 0; turned round it would be 3 tenths."""
    assert "L3" not in codes(tb058())
    # lists that were logged from the other end are still found: turned round, home is as good as before
    forward, backward = [5.0, 4.0, 2.0, 1.0, 0.5, 0.0], [4.0, 3.0, 1.0, 0.5, -0.5, 0.0]
    assert "L3" not in codes(tenths(forward, backward, file_start=-5.0))
    assert "L3" in codes(tenths(forward, [0.0, -0.5, 0.5, 1.0, 3.0, 4.0], file_start=-5.0))


def test_l6_is_silent_of_the_value_at_home_which_is_0_by_definition() -> None:
    """TB058: the error at home must be 0. Its own last reverse value, 0, stands beside -1 and 0 tenths."""
    assert "L6" not in codes(tb058())
    # a slip elsewhere in the same list is named: 30 tenths among 3, 2, 1
    text = (
        (TABLES / "centroid-v2-tb058" / "cnc10z.tab").read_text().replace("2.0000\n1.0000", "30.0000\n1.0000")
    )
    slipped = parse_table(text.encode(), "cnc10z.tab", FileContext(travel=(-2.6, 0.0)))
    assert [lint.line for lint in slipped.lints if lint.code == "L6"] == [10]


def test_l6_is_silent_of_home_at_the_end_of_a_curve_of_both_directions() -> None:
    """CNC Services' version 1 sample: 0 at home, then -32, -38, -47 counts, in positions that fall."""
    sample = TABLES / "centroid-v1" / "CNC7X.TAB"
    told = FileContext(units=Units.INCH, file_counts_per_unit=64000.0)
    assert "L6" not in codes(read_table(sample, told))
    # 64000 counts an inch; a slip of 100 counts away from home is still named, on its line
    text = sample.read_text().replace("-82\n", "-182\n")
    slipped = parse_table(text.encode(), "CNC7X.TAB", told)
    assert [lint.line for lint in slipped.lints if lint.code == "L6"] == [1 + 10]


def test_l4_single_value_in_another_unit() -> None:
    forward, backward = SOUND
    slipped = [*backward[:4], 0.0001, backward[5]]
    (lint,) = (lint for lint in tenths(forward, slipped).lints if lint.code == "L4")
    assert lint.line == 1 + 6 + 1 + 5
    assert "L4" not in codes(tenths(forward, [*backward[:4], 0.001, backward[5]]))


def test_l4_tenths_written_as_inches() -> None:
    text = (TABLES / "centroid-v3" / "cnc10z.tab").read_text()
    slipped = text.replace("+0.00014000", "+0.11000000")
    assert {"L4", "L12", "L1"} <= codes(parse_table(slipped.encode(), "cnc10z.tab", FileContext()))
    assert "L4" not in codes(parse_table(text.encode(), "cnc10z.tab", FileContext()))


def test_l6_outlier() -> None:
    smooth = [0.0, 1.0, 2.1, 3.3, 4.6, 6.0, 7.5, 9.1, 10.8, 12.6, 14.5]
    # all bends are 0.1 but the three around the spike
    spiked = [*smooth[:4], 14.6, *smooth[5:]]
    (lint,) = (lint for lint in tenths(spiked, spiked).lints if lint.code == "L6")
    assert "at 4 inch" in lint.message
    assert "L6" not in codes(tenths(smooth, smooth))


HAND = [0.0, 0.0071, 0.0148, 0.0216, 0.0289, 0.0357, 0.0421]
"""Seven points typed by hand, in mm; forward lies 12 µm above backward."""
BACK = [c - 0.012 for c in HAND]


@pytest.mark.parametrize("index", range(7))
@pytest.mark.parametrize("column", ["forward", "backward"])
def test_l6_a_decimal_point_that_slipped_in_a_short_table(index: int, column: str) -> None:
    forward, backward = list(HAND), list(BACK)
    (forward if column == "forward" else backward)[index] += 0.379  # 0.4210 for 0.0421
    loaded = microns(forward, backward, max_slope=0.5)
    found = [lint for lint in loaded.lints if lint.code == "L6"]
    assert [lint.message.split()[0] for lint in found] == [column]
    assert f"at {10 * index} mm does not fit:" in found[0].message
    assert found[0].line == 6 + index
    # Following the advice to exchange the columns would ruin the other six points.
    assert "L2" not in codes(loaded)


def test_l6_two_rows_with_digits_exchanged() -> None:
    forward = list(HAND)
    forward[2], forward[4] = 0.0481, 0.0829  # 0.0148 and 0.0289
    found = [lint for lint in microns(forward, BACK).lints if lint.code == "L6"]
    assert [lint.line for lint in found] == [8, 10]
    assert "the other values lead to 0.01435 there" in found[0].message  # half way from 0.0071 to 0.0216


@pytest.mark.parametrize("count", [12, 18, 19, 31])
def test_l6_names_two_slips_in_one_curve_where_one_is_ten_times_the_other(count: int) -> None:
    """A bow that bends by 0.2 µm; one value is 0.1 mm too high, another 0.01 mm too low."""
    bow = [0.0001 * index * index for index in range(count)]
    back = [c - 0.012 for c in bow]
    slipped = list(bow)
    slipped[3] += 0.1
    slipped[8] -= 0.01
    found = [lint for lint in microns(slipped, back).lints if lint.code == "L6"]
    assert sorted(lint.message.split(" mm ")[0].split(" at ")[1] for lint in found) == ["30", "80"]
    assert {lint.line for lint in found} == {9, 14}
    # So are two side by side.
    slipped = list(bow)
    slipped[5] += 0.03
    slipped[6] -= 0.04
    found = [lint for lint in microns(slipped, back).lints if lint.code == "L6"]
    assert {lint.line for lint in found} == {11, 12}


def test_l6_of_a_rough_curve_names_its_worst_point_alone() -> None:
    """Six points of thirty, two and two side by side, of which one lies higher than the others."""
    rough = [0.0] * 30
    for index in (5, 6, 12, 13, 19, 20):
        rough[index] = 0.01
    rough[12] = 0.03
    found = [lint for lint in microns(rough, [c - 0.012 for c in rough]).lints if lint.code == "L6"]
    assert [lint.line for lint in found] == [18, 18]  # of both directions


def test_l15_is_silent_of_a_screw_that_is_worn_in_one_place() -> None:
    """12 µm, and up to 20 µm more in the middle of thirty points; readings scatter by half a micron."""
    bump = {11: 2, 12: 6, 13: 12, 14: 18, 15: 20, 16: 18, 17: 12, 18: 6, 19: 2}
    back = [(0.0, -0.0004, 0.0004, 0.0001)[index % 4] for index in range(30)]
    worn = [(12 + bump.get(index, 0) + (0.0, 0.5, -0.5)[index % 3]) / 1000 for index in range(30)]
    assert not {"L6", "L15"} & codes(microns(worn, back))


@pytest.mark.parametrize("count", [5, 6, 7])
def test_l6_sees_a_slip_in_five_points_and_none_in_a_bow(count: int) -> None:
    bow = [0.0005 * index * index for index in range(count)]
    back = [c - 0.012 for c in bow]
    assert not {"L6", "L15"} & codes(microns(bow, back))
    assert "L6" in codes(microns([*bow[:2], bow[2] + 0.09, *bow[3:]], back))


def test_l2_goes_by_the_count_of_points() -> None:
    # Lost motion at four points of seven is negative, three are so large that the mean is positive.
    forward = [0.02, 0.02, 0.02, 0.0, 0.0, 0.0, 0.0]
    backward = [0.0, 0.0, 0.0, 0.001, 0.001, 0.001, 0.001]
    assert "L2" not in codes(microns(forward, backward))
    assert "L2" in codes(microns(BACK, HAND))


def test_l15_a_lost_motion_that_only_one_point_has() -> None:
    rough = [0.0, 0.011, 0.004, 0.02, 0.013, 0.03, 0.024, 0.041]
    back = [c - 0.012 for c in rough]
    assert "L15" not in codes(microns(rough, back))
    back[3] = rough[3] + 0.012  # the sign of a lost motion
    (lint,) = (lint for lint in microns(rough, back).lints if lint.code == "L15")
    assert "forward - backward is -0.012, at the other points 0.012" in lint.message


def test_l15_two_rows_with_digits_exchanged_in_one_direction() -> None:
    """Neither stands out of its own curve: the one is too small beside the other."""
    forward = [0.0, 0.0110, 0.0251, 0.0231, 0.0430, 0.0528, 0.0641]  # 0.0215 and 0.0321
    back = [-0.0120, -0.0012, 0.0097, 0.0201, 0.0311, 0.0411, 0.0522]
    found = [lint for lint in microns(forward, back).lints if lint.code == "L15"]
    # 25.1 - 9.7 and 23.1 - 20.1 µm; elsewhere 11.7, 11.7, 11.9, 12 and 12.2.
    assert len(found) == 2
    assert "at 20 mm" in found[0].message
    assert "is 0.0154, at the other points 0.0119" in found[0].message
    assert "at 30 mm" in found[1].message
    assert "is 0.003, at the other points 0.0119" in found[1].message
    # A lost motion that two of seven points have from wear, and a third half of it, is none.
    lost = [0.012, 0.012, 0.014, 0.018, 0.018, 0.014, 0.012]
    worn = [c - each for c, each in zip(forward, lost, strict=True)]
    assert "L15" not in codes(microns(forward, worn))


def test_l8_names_both_stretches_that_are_not_covered() -> None:
    loaded = tenths(*SOUND, travel=(-0.5, 5.25))
    messages = [lint.message for lint in loaded.lints if lint.code == "L8"]
    assert "travel -0.5 to 0 inch" in messages[0]
    assert "hold (the default) gives 0 forward, -0.0001 backward" in messages[0]
    assert "travel 5 to 5.25 inch" in messages[1]
    assert "L8" not in codes(tenths(*SOUND, travel=(0.0, 5.0)))


def test_l11_positions_out_of_order_are_refused_with_their_line() -> None:
    text = (TABLES / "centroid-v3" / "cnc10z.tab").read_text().replace("-2.00000000", "-1.50000000")
    with pytest.raises(TabFileError) as caught:
        parse_table(text.encode(), "cnc10z.tab", FileContext())
    assert [(problem.code, problem.line) for problem in caught.value.problems] == [("L11", 10)]


def test_l12_correction_above_its_limit_is_an_error() -> None:
    # 0.5 mm unless told otherwise
    rising = [0.1 * i for i in range(6)]
    assert microns(rising, rising, max_slope=0.1).errors == ()
    too_far = [*rising, 0.51]
    (lint,) = microns(too_far, too_far, max_slope=0.1).errors
    assert (lint.code, lint.severity, lint.line) == ("L12", LintSeverity.ERROR, 12)
    (lint,) = microns(rising, rising, max_slope=0.1, max_correction=0.4).errors
    assert "0.4" in lint.message


def test_l13_names_the_hole_in_an_even_grid() -> None:
    def holes(*positions: float) -> list[tuple[int | None, str]]:
        rows = tuple(SourceRow(x, 0.001 * x, 0.0, 0.0, 0.0, n, n) for n, x in enumerate(positions, start=1))
        table = make_table(positions, [0.001 * x for x in positions], [0.0] * len(positions), Units.MM)
        lints = run_lints("table.csv", table, Decoded(rows, Units.MM, FileContext(), "mm", "", ""))
        return [(lint.line, lint.message) for lint in lints if lint.code == "L13"]

    (hole,) = holes(0, 10, 20, 40, 50, 60)
    assert hole[0] == 4
    assert "points at 20 and 40 mm are 20 apart, most others 10" in hole[1]
    # a position mistyped: 31 for 30
    assert [line for line, _ in holes(0, 10, 20, 31, 40, 50, 60)] == [4, 5]
    assert holes(0, 10, 20, 30, 40.004, 50) == []
    # a free grid
    assert holes(0, 1, 3, 7, 15, 31) == []
    assert holes(0, 10, 30) == []


def test_l14_names_points_that_the_axis_never_reaches() -> None:
    # points at 0 to 5 inch; of the last two at one end both lie where the travel ends, or beyond
    lints = [lint for lint in tenths(*SOUND, travel=(-1.0, 4.0)).lints if lint.code == "L14"]
    assert len(lints) == 1
    assert "points at 5 and 4 inch" in lints[0].message
    assert lints[0].line == 7
    lints = [lint for lint in tenths(*SOUND, travel=(1.0, 6.5)).lints if lint.code == "L14"]
    assert ["points at 0 and 1 inch" in lint.message for lint in lints] == [True]
    assert "L14" not in codes(tenths(*SOUND, travel=(-1.0, 4.1)))
    assert "L14" not in codes(tenths(*SOUND))


def test_limits_are_converted_into_the_units_of_the_file() -> None:
    # 0.0127 mm is 5 tenths
    assert tenths([0.0, 5.0, 5.0], [0.0, 5.0, 5.0], units=Units.MM, max_correction=0.0127).errors == ()
    assert tenths([0.0, 5.1, 5.0], [0.0, 5.0, 5.0], units=Units.MM, max_correction=0.0127).errors


def test_the_gateway_refuses_a_table_with_an_error(tmp_path: Path) -> None:
    path = tmp_path / "cnc10x.tab"
    path.write_text(tab(0.0, 0.2, interval=10.0))
    with pytest.raises(TabFileError, match="L1 slope") as caught:
        read_table(path, FileContext())
    assert caught.value.line == 7


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        ("centroid-v1/CNC7X.TAB", {"units": Units.INCH, "file_counts_per_unit": 64000.0}),
        ("centroid-v2/cnc10z.tab", {"file_start": -4.5}),
        ("centroid-v2-tb058/cnc10z.tab", {"file_start": -2.5}),
        ("centroid-v3/cnc10z.tab", {}),
    ],
)
def test_shipped_samples_load_without_an_error(name: str, facts: dict[str, Any]) -> None:
    assert read_table(TABLES / name, FileContext(**facts)).errors == ()


@pytest.mark.parametrize(
    ("length", "correction", "is_refused"), [(300, 0.51, True), (2800, 0.84, False), (2800, 0.85, True)]
)
def test_l12_a_long_axis_may_be_off_by_more(length: int, correction: float, is_refused: bool) -> None:
    # 0.3 mm/m of 2.8 m are 0.84 mm.
    rising = [correction * i / 4 for i in range(5)]
    found = microns(rising, rising, step=length // 4)
    assert ("L12" in codes(found)) is is_refused
    assert ("L4" in codes(found)) is is_refused
