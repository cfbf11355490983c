import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.formats import ReadingsContext, Runs, parse_survey
from gateway.metrology.readings import Reading, Survey, merged, understood
from gateway.tabfile import TabFileError
from tests.metrology.samples import RTL, TB058_MANUAL, TB058_SIMULATED

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
ISO = """\
# axis: x
# machine: mill 7
target_mm,direction,run,measured_mm
0,forward,1,0.001
50,forward,1,50.003
100,forward,1,100.002
100,backward,1,99.995
50,backward,1,49.994
0,backward,1,-0.006
"""


def read(text: str, **told: object) -> Survey:
    return parse_survey(text.encode(), "laser.csv", ReadingsContext(**told))  # type: ignore[arg-type]


def refused(text: str, **told: object) -> str:
    with pytest.raises(TabFileError) as caught:
        read(text, **told)
    return str(caught.value)


def deviations_um(survey: Survey) -> list[tuple[float, Direction, int, float]]:
    return [(r.target, r.direction, r.run, round(r.deviation * 1e3, 6)) for r in survey.readings]


def test_an_iso_csv_is_read_with_facts_and_axis() -> None:
    survey = read(ISO)
    assert survey.units is Units.MM
    assert (survey.axis, survey.facts["machine"], survey.source) == ("x", "mill 7", "laser.csv")
    assert survey.remarks == ()
    assert deviations_um(survey) == [
        (0, UP, 1, 1.0),
        (50, UP, 1, 3.0),
        (100, UP, 1, 2.0),
        (100, DOWN, 1, -5.0),
        (50, DOWN, 1, -6.0),
        (0, DOWN, 1, -6.0),
    ]


def test_directions_that_every_run_contradicts_are_named() -> None:
    exchanged = ISO.replace("forward", "~").replace("backward", "forward").replace("~", "backward")
    [remark] = read(exchanged).remarks
    assert "exchange the directions" in remark
    # Sorted by a program, both ways alike: the order of the lines says nothing.
    heading, lines = ISO.splitlines()[:3], ISO.splitlines()[3:]
    assert read("\n".join([*heading, *lines[2::-1], *lines[3:]])).remarks == ()


def test_more_runs_one_way_than_the_other_are_named() -> None:
    again = "".join(f"{target},forward,2,{target}\n" for target in (0, 50, 100))
    [remark] = read(ISO + again).remarks
    assert "2 forward and 1 backward runs: measure the same number in both directions" in remark


def test_columns_in_another_order_with_semicolons_and_deviations_in_um() -> None:
    text = "run;deviation_um;direction;target_mm;note\n1;2.5;up;10;a\n1;-1;+;20;\n1;-3;down;20;\n1;0;-;10;\n"
    assert deviations_um(read(text)) == [
        (10, UP, 1, 2.5),
        (20, UP, 1, -1),
        (20, DOWN, 1, -3),
        (10, DOWN, 1, 0),
    ]


def test_quotes_of_a_spreadsheet_around_whole_cells_change_nothing() -> None:
    quoted = (
        ISO.replace("forward", '"forward"').replace("backward", '"backward"').replace("50.003", '"50.003"')
    )
    quoted = quoted.replace(
        "target_mm,direction,run,measured_mm", '"target_mm","direction","run","measured_mm"'
    )
    assert read(quoted).readings == read(ISO).readings
    assert "direction '\"forward'" in refused(ISO.replace("forward", '"forward', 1))


def test_tenths_are_ten_thousandths_of_an_inch() -> None:
    survey = read("target_inch,direction,run,deviation_tenth\n1,forward,1,5\n2,forward,1,-2\n")
    assert survey.units is Units.INCH
    assert [r.measured for r in survey.readings] == pytest.approx([1.0005, 1.9998], abs=1e-12)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends_a_byte_order_mark_and_blanks_change_nothing(end: str) -> None:
    data = b"\xef\xbb\xbf" + ISO.replace("\n", "  " + end).encode()
    assert parse_survey(data, "laser.csv").readings == read(ISO).readings


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("target_mm", "target_inch", "mixed units: 'target_inch' is in inch, 'measured_mm' in mm"),
        ("_mm", "", "no units"),
        ("50.003", "50,003", "laser.csv:5: 5 cells, perhaps because of a decimal comma"),
        ("50.003", "5O.003", "laser.csv:5: measured '5O.003'"),
        ("50,forward", "50,sideways", "direction 'sideways'"),
        ("50,forward,1", "50,forward,one", "run 'one'"),
        ("50,forward,1", "50,forward,0", "run '0'"),
        ("50,forward,1", "100,forward,1", "a second reading of forward run 1 at 100; the first is in line 5"),
        (
            "50,backward",
            "50.0001,backward",
            "target 50.0001, but 50 in line 5; allowed: the same number",
        ),
        ("50.003", "100.003", "100.003 at target 50, the reading of target 100: +50.003 away"),
        ("50.003", "80", "80 at target 50, the reading of target 100"),
        (",run,", ",pass,", "'pass' in the heading"),
        (",measured_mm", ",measured_furlong", "unknown unit"),
        (",measured_mm", ",measured_um", "'measured_um' in the heading"),
        (",measured_mm", ",deviation", "'deviation' in the heading, without a unit"),
    ],
)
def test_what_is_wrong_in_an_iso_csv_is_named(old: str, new: str, words: str) -> None:
    assert words in refused(ISO.replace(old, new, 2 if old == "_mm" else 1))


def test_a_decimal_comma_between_semicolons_is_named() -> None:
    assert "with a decimal comma" in refused(ISO.replace(",", ";").replace("50.003", "50,003"))


def test_targets_out_of_order_are_named_with_both_lines() -> None:
    lines = ISO.splitlines()
    lines[3:6] = [lines[3], lines[5], lines[4]]
    assert "laser.csv:6: target 50 after 100 (line 5) in forward run 1, out of order" in refused(
        "\n".join(lines)
    )


def test_a_missing_direction_is_a_remark_with_a_remedy() -> None:
    survey = read("".join(line for line in ISO.splitlines(keepends=True) if "backward" not in line))
    [remark] = survey.remarks
    assert "no backward reading: measure" in remark
    assert "--one-way" in remark


def test_runs_of_unequal_length_are_named() -> None:
    survey = read(ISO + "0,forward,2,0\n100,forward,2,100\n")
    _, remark = survey.remarks
    assert "forward run 2 has 2 of 3 readings, none at 50" in remark


def test_the_manual_table_of_tb058_takes_its_directions_from_the_order_of_the_dro() -> None:
    survey = read(TB058_MANUAL)
    assert (survey.units, survey.axis) == (Units.INCH, "z")
    assert [(r.target, r.direction) for r in survey.readings] == [
        *((at, UP) for at in (-2.5, -2.0, -1.5, -1.0, -0.5, 0.0)),
        *((at, DOWN) for at in (-0.5, -1.0, -1.5, -2.0, -2.5)),
    ]
    assert survey.remarks == (
        (
            "laser.csv:3: -2.5 is the first stop: assumed to be approached forward; next time "
            "approach it from further outside"
        ),
        "laser.csv:8: the axis reversed at 0, backward from there",
        "laser.csv: no backward reading at 0, an end: a table estimates it from the neighbour",
    )


def test_a_turning_point_that_is_read_again_belongs_to_the_way_back() -> None:
    survey = read("dro_mm,measured_mm\n0,0\n10,10.01\n10,10.02\n0,0.01\n")
    assert [r.direction for r in survey.readings] == [UP, UP, DOWN, DOWN]


def test_the_typo_in_the_simulated_table_of_tb058_is_named() -> None:
    survey = read(TB058_SIMULATED)
    slips = [remark for remark in survey.remarks if "correction" in remark]
    assert [slip.partition(";")[0] for slip in slips] == [
        "laser.csv:4: check this line: correction 4 at 1.5, but DRO - measured is 1"
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("dro,measured\n0,0\n1,1\n", "no units"),
        ("dro_mm,measured_mm\n0,0\n", "at least two"),
        (
            "dro_mm,measured_mm\n0,0\n10,10\n0,0\n10,10\n",
            "laser.csv:5: DRO 10 after 0: the axis reverses for the second time",
        ),
        ("dro_mm,measured_inch\n0,0\n10,10\n", "mixed units"),
        ("dro_mm,reading_mm\n0,0\n10,10\n", "'reading_mm' in the heading"),
        ("dro_mm,measured_mm\n0,0\n0,0\n", "DRO 0 twice"),
    ],
)
def test_what_is_wrong_in_a_manual_table_is_named(text: str, words: str) -> None:
    assert words in refused(text)


def test_a_renishaw_file_keeps_its_directions() -> None:
    survey = parse_survey(RTL.encode(), "x.rtl")
    assert deviations_um(survey)[:2] == [(0, UP, 1, 0.0), (20, UP, 1, 1.5)]
    assert deviations_um(survey)[6:8] == [(100, DOWN, 1, -2.5), (80, DOWN, 1, 1.0)]
    assert len(survey.readings) == 12
    assert survey.axis == "X"
    assert survey.facts["Serial No"] == "4711"
    assert survey.facts["environment"] == "Air temp: 20.1"


def test_targets_that_fall_make_the_odd_runs_backward() -> None:
    text = RTL.replace("  0.0000  20.0000  40.0000  60.0000  80.0000", " 0 -20 -40 -60 -80").replace(
        "  100.0000", " -100"
    )
    survey = read(text)
    assert deviations_um(survey)[1] == (-20, DOWN, 1, 1.5)
    assert deviations_um(survey)[6] == (-100, UP, 1, -2.5)
    assert "the targets descend, so odd runs are backward" in survey.remarks[0]


def one_order() -> str:
    """The same file with run 2 sorted like run 1."""
    lines = RTL.split("\r\n")
    start = lines.index("Run Target Data:") + 7
    lines[start : start + 6] = reversed(lines[start : start + 6])
    return "\r\n".join(lines)


def test_runs_of_one_order_prove_no_direction() -> None:
    assert "this does not prove their directions; allowed: --runs alternate" in refused(one_order())
    alternate = read(one_order(), runs=Runs.ALTERNATE)
    assert sorted(deviations_um(alternate), key=str) == sorted(deviations_um(read(RTL)), key=str)
    forward = read(one_order(), runs=Runs.FORWARD)
    assert {(r.direction, r.run) for r in forward.readings} == {(UP, 1), (UP, 2)}
    assert "but --runs is forward" in refused(RTL, runs=Runs.FORWARD)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("Target-count: 6", "Target-count: 7", "Target-count 7, but 6 targets"),
        ("Target-count: 6\r\n", "", "no Target-count"),
        ("Run-count: 2", "Run-count: 3", "Run-count 3, but 2 runs"),
        ("  2   4   4.0", "  2   4   4,0", "with a decimal comma"),
        ("  2   3   5.0\r\n", "", "run 2 has no target 3"),
        ("  2   3   5.0", "  2   4   5.0", "run 2 has no target 3 and target 4 twice"),
        ("  2   3   5.0", "  2   7   5.0", "target 7; allowed: 1 to 6"),
        ("  2   3   5.0", "  2   3", "2 numbers"),
        ("  2   3   5.0", "  4   3   5.0", "run 4 after run 2"),
        ("  1   2   1.5", "  1   2   15020", "35.02 at target 20, the reading of target 40"),
        ("40.0000", "10.0000", "target 10 after 20, out of order"),
        ("Filetype: LINEAR", "Filetype: ANGULAR", "a measurement of type 'ANGULAR'"),
        ("RUNS::", "RUNZ::", "section 'RUNZ::'"),
        ("Run-count: 2", "Run count 2", "'Run count 2' in section RUNS"),
    ],
)
def test_what_is_wrong_in_a_renishaw_file_is_named(old: str, new: str, words: str) -> None:
    assert old in RTL
    assert words in refused(RTL.replace(old, new))


@pytest.mark.parametrize("kind", ["rta", "RTS", ""])
def test_an_rtl_of_angles_is_not_read_as_lengths(kind: str) -> None:
    text = RTL.replace("File type: LINEAR", f"File type  : {kind}")
    assert f"laser.csv:2: a file of type {kind!r}; allowed: rtl: a linear measurement" in refused(text)
    for sound in ("rtl", "RTL", "linear"):
        assert deviations_um(read(RTL.replace("LINEAR", sound))) == deviations_um(read(RTL))


def test_variants_of_other_programs_read_as_the_same_readings() -> None:
    # Titles in small letters, other names of the kind, blanks before the colons, all targets on one line.
    variant = (
        RTL.replace("HEADER::", "Header::")
        .replace("DEVIATIONS::", "Deviations::")
        .replace("File type: LINEAR", "File type  : rtl\r\nOwner      : Linear\r\nVersion no : 1")
        .replace("Filetype: LINEAR", "Filetype  : ISO")
        .replace("80.0000\r\n  100.0000", "80.0000 100.0000 ")
        .replace("Run-count: 2", "Run-count:2")
        .replace("Run Target Data:", "Run Target Data: ")
        .replace("  1   4   2.0", "1\t4\t2.0")
    )
    assert "Owner" in variant
    assert "80.0000 100.0000 " in variant
    assert "1\t4\t2.0" in variant
    assert read(variant).readings == read(RTL).readings


def test_a_run_that_was_filled_in_with_zeros_is_no_way_back() -> None:
    head, _, rest = RTL.partition("  2   6   -2.5")
    filled = (
        head
        + "".join(f"  2   {target}   0\r\n" for target in range(6, 0, -1))
        + rest[rest.index("\r\nENV") :]
    )
    text = refused(filled)
    assert "laser.csv:28: only 0 in run 2" in text
    assert "give --runs forward" in text
    way_out = filled.replace("Run-count: 2", "Run-count: 1")
    way_out = "\r\n".join(line for line in way_out.split("\r\n") if not line.startswith("  2 "))
    assert len(read(way_out, runs=Runs.FORWARD).readings) == 6
    # one reading that differs from 0 is a measurement
    assert len(read(filled.replace("  2   3   0", "  2   3   0.001")).readings) == 12


def test_an_rtl_without_its_end_mark_is_named_or_refused() -> None:
    assert RTL.endswith("\r\nAir temp: 20.1\r\nEOF::\r\n")
    (said,) = read(RTL.replace("EOF::\r\n", "")).remarks
    assert said == ("laser.csv: no EOF:: at its end, so the file was cut short; all readings are there")
    # Cut among the deviations: 2.0 may have been 2.04.
    cut = RTL.partition("\r\n\r\nENVIRONMENT::")[0]
    assert (
        "laser.csv:33: the end of the file among the deviations; allowed: EOF:: as the last line"
        in refused(cut)
    )
    assert deviations_um(read(cut + "\r\nEOF::\r\n")) == deviations_um(read(RTL))
    assert "in section EOF" in refused(RTL + "  3   1   0.0\r\n")


@pytest.mark.parametrize("encoding", ["latin-1", "gbk", "cp1250"])
def test_names_in_the_alphabets_of_old_programs_change_nothing(encoding: str) -> None:
    name = {"latin-1": "Fräse 20 °C", "gbk": "机床一", "cp1250": "frézka č. 1"}[encoding]
    data = RTL.replace("Machine: mill", f"Machine: {name}").encode(encoding)
    assert deviations_um(parse_survey(data, "x.rtl")) == deviations_um(read(RTL))


def test_a_column_for_each_run_is_read() -> None:
    survey = read("Target (mm),1 up,1 down,2 up\n0,0.001,0.002,0.003\n50,0.004,0.005,\n")
    assert deviations_um(survey) == [
        *((0, UP, 1, 1.0), (50, UP, 1, 4.0)),
        *((0, DOWN, 1, 2.0), (50, DOWN, 1, 5.0)),
        (0, UP, 2, 3.0),
    ]


@pytest.mark.parametrize(
    "heading",
    ["position_mm;forward_1_um;backward_1_um", "target_mm;+1 (um);-1 (um)", "Nominal mm\tup 1 µm\tdown 1 µm"],
)
def test_columns_of_micrometres_are_deviations(heading: str) -> None:
    separator = ";" if ";" in heading else "\t"
    lines = [separator.join(cells) for cells in (("0", "1", "2"), ("50", "4", "5"))]
    assert deviations_um(read("\n".join([heading, *lines]))) == [
        *((0, UP, 1, 1.0), (50, UP, 1, 4.0)),
        *((0, DOWN, 1, 2.0), (50, DOWN, 1, 5.0)),
    ]


def test_columns_of_positions_are_told_from_deviations_by_their_size() -> None:
    assert deviations_um(read("target_mm,up 1\n0,0.001\n50,50.002\n100,100.003\n")) == [
        (0, UP, 1, 1.0),
        (50, UP, 1, 2.0),
        (100, UP, 1, 3.0),
    ]
    # 0.4 at 1: a deviation of 0.4, or a position 0.6 short.
    assert "positions, or deviations?" in refused("target_mm,up 1\n0,0\n1,0.4\n2,1.1\n")


def test_runs_without_a_way_are_told_theirs() -> None:
    text = "target_mm,run 1,run 2,run 3\n0,0.001,0.002,0.003\n50,0.004,0.005,0.006\n"
    assert "--runs alternate" in refused(text)
    told = read(text, runs=Runs.ALTERNATE)
    assert [(r.direction, r.run) for r in told.readings[::2]] == [(UP, 1), (DOWN, 1), (UP, 2)]
    assert {r.direction for r in read(text, runs=Runs.BACKWARD).readings} == {DOWN}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("target_mm,up 1,up 1\n0,0,0\n50,0,0\n", "a second 'up 1' in the heading"),
        ("target_mm,up 1\n0,x\n50,0\n", "laser.csv:2: up 1 'x'"),
        ("target_mm,up 1\n0,0.001,3\n50,0\n", "laser.csv:2: 3 cells"),
        ("target_mm,up 1\n50,0.001\n0,0.001\n100,0.001\n", "out of order"),
    ],
)
def test_columns_that_are_damaged_are_refused_with_their_line(text: str, words: str) -> None:
    assert words in refused(text)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_are_read_where_commas_separate_nothing(separator: str) -> None:
    text = ISO.replace(",", separator).replace(".", ",")
    assert "0,001" in text
    assert read(text).readings == read(ISO).readings


def test_commas_beside_points_are_refused_with_both_lines() -> None:
    said = refused(ISO.replace(",", ";").replace("50.003", "50,003"))
    assert "laser.csv:5: '50,003' with a decimal comma, but '0.001' with a point in line 4" in said
    assert "perhaps because of a decimal comma" in refused(ISO.replace("50.003", "50,003"))


def test_a_column_that_is_no_run_is_named_also_where_the_format_is_told() -> None:
    noted = "target_mm;forward 1;backward 1;note\n0;0.0;0.01;x\n10;10.0;10.01;y\n"
    assert "laser.csv:1: 'note' in the heading; allowed: target_mm;forward 1" in refused(noted)
    assert "'measured_mm' in the heading" in refused("target_mm,measured_mm\n0,0\n", format="wide-csv")


def test_target_and_reading_alone_lack_the_directions() -> None:
    said = refused("target_mm,measured_mm\n0,0\n25,25.01\n")
    assert "laser.csv:1: no direction and no run in the heading" in said
    assert "or dro_mm,measured_mm: then the order of the lines gives the directions" in said


def test_commas_that_may_group_thousands_are_refused_where_nothing_proves_them_decimal() -> None:
    """Targets of 1 m, 2 m and 3 m as a spreadsheet shows them; as decimals they were 1, 2 and 3 mm."""
    text = "target_mm;direction;run;deviation_um\n1,000;up;1;12\n2,000;up;1;15\n3,000;up;1;11\n"
    assert "laser.csv:2: '1,000', which means 1.000 or 1000; allowed: decimal points, or at" in refused(text)
    proven = read(text.replace("12", "12,5"))
    assert [each.target for each in proven.readings] == [1.0, 2.0, 3.0]


BLOCKS = """target_mm,direction,run,measured_mm
0.0012,up,1,0
25.0031,up,1,25
50.0044,up,1,50
50.0104,down,1,50
25.0095,down,1,25
0.0071,down,1,0
0.0019,up,2,0
25.0040,up,2,25
50.0046,up,2,50
50.0101,down,2,50
25.0090,down,2,25
0.0077,down,2,0
"""


def test_readings_over_gauge_blocks_have_the_blocks_as_targets() -> None:
    """The dial is brought to 0 at each block, and the DRO is written down."""
    survey = read(BLOCKS)
    assert sorted({each.target for each in survey.readings}) == [0, 25, 50]
    # The DRO shows 25.0031 where the nut is at 25: it is 3.1 µm short of where it should be.
    assert deviations_um(survey)[:3] == [(0, UP, 1, -1.2), (25, UP, 1, -3.1), (50, UP, 1, -4.4)]
    (remark,) = [each for each in survey.remarks if "gauge blocks" in each]
    assert "3 gauge blocks from 0 to 50" in remark
    # Run 1 begins at 0.0012, run 2 at 0.0019; that the way back ends elsewhere is lost motion.
    assert "begin at 0.0012 to 0.0019, which adds to the scatter" in remark
    (alone,) = [each for each in read(one_run(BLOCKS)).remarks if "gauge blocks" in each]
    assert "scatter" not in alone


def test_a_stop_that_is_missing_over_gauge_blocks_is_named_and_the_others_are_used() -> None:
    survey = read(one_run(BLOCKS).replace("25.0031,up,1,25\n", ""))
    assert sorted({each.target for each in survey.readings}) == [0, 25, 50]
    assert len(survey.readings) == 5
    assert any("no forward reading at 25" in each or "none at 25" in each for each in survey.remarks)


def one_run(text: str) -> str:
    return "".join(line for line in text.splitlines(keepends=True) if ",2," not in line)


BOTH_VARY = """target_mm,direction,run,measured_mm
0.0012,up,1,0.0002
25.0031,up,1,24.9998
50.8044,up,1,50.8001
50.8104,down,1,50.8004
25.0095,down,1,25.0003
0.0071,down,1,-0.0001
0.0019,up,2,-0.0002
25.0040,up,2,25.0001
50.8046,up,2,50.7998
50.8101,down,2,50.8000
25.0090,down,2,24.9999
0.0077,down,2,0.0001
"""


def test_readings_whose_dro_and_dial_both_vary_belong_to_the_nearest_block() -> None:
    survey = read(BOTH_VARY)
    # Blocks of 25 and 25.8 mm, wrung together for the second.
    assert sorted({each.target for each in survey.readings}) == [0, 25, 50.8]
    # 24.9998 where the DRO shows 25.0031 is 3.3 µm short.
    assert deviations_um(survey)[:3] == [(0, UP, 1, -1.0), (25, UP, 1, -3.3), (50.8, UP, 1, -4.3)]
    (remark,) = [each for each in survey.remarks if "gauge blocks" in each]
    assert "3 gauge blocks from 0 to 50.8" in remark


def test_a_sheet_of_dro_and_dial_over_blocks_is_one_way_there_and_one_back() -> None:
    rows = [line.split(",") for line in BOTH_VARY.splitlines()[1:7]]
    worksheet = "dro_mm,measured_mm\n" + "".join(f"{dro},{dial}\n" for dro, _, _, dial in rows)
    assert {r.target for r in read(worksheet).readings} == {0, 25, 50.8}
    assert deviations_um(read(worksheet))[3:] == [
        (50.8, DOWN, 1, -10.0),
        (25, DOWN, 1, -9.2),
        (0, DOWN, 1, -7.2),
    ]


def test_one_target_in_two_spellings_is_still_refused_where_no_blocks_are() -> None:
    damaged = ISO + ISO.split("\n", 3)[3].replace(",1,", ",2,").replace("50,forward", "50.0007,forward")
    assert "laser.csv:11: target 50.0007, but 50 in line 5" in refused(damaged)


def test_stops_that_lie_nowhere_together_are_no_blocks() -> None:
    spread = BOTH_VARY.replace("25.0040,up,2", "27.0040,up,2").replace("25.0090,down,2", "23.0090,down,2")
    spread = spread.replace("50.8101,down,2", "48.8101,down,2")
    assert "target 0.0019, but 0.0012 in line 2" in refused(spread)


def test_a_slip_over_gauge_blocks_is_named_in_its_own_line() -> None:
    assert refused(BLOCKS.replace("25.0040,up,2", "26.0040,up,2")) == (
        "laser.csv:9: 26.004, but the other stops at this block are at 25.0031 to 25.0095; allowed: stops "
        "close to each other at one block: check the digits, or it belongs to another block"
    )
    two = refused(BLOCKS.replace("25.0040,up,2", "26.0040,up,2").replace("50.0046,up,2", "49.0046,up,2"))
    assert "laser.csv:9: 26.004" in two
    assert "laser.csv:10: 49.0046, but the other stops at this block are at 50.0044 to 50.0104" in two
    assert "laser.csv:9: 26 at the stop at 25.004, but the others have 25" in refused(
        BLOCKS.replace("25.0040,up,2,25", "25.0040,up,2,26")
    )


def test_the_dro_and_the_block_may_be_called_so() -> None:
    """Whichever column stands first, and whichever is round: the DRO is where the control went."""
    same = read(BLOCKS)
    named = BLOCKS.replace("target_mm,direction,run,measured_mm", "dro_mm,direction,run,block_mm")
    assert read(named).readings == same.readings
    flipped = "block_mm,direction,run,dro_mm\n" + "".join(
        f"{block},{way},{run},{dro}\n"
        for dro, way, run, block in (line.split(",") for line in BLOCKS.splitlines()[1:])
    )
    assert read(flipped).readings == same.readings
    both = flipped.replace("block_mm", "target_mm")
    assert "laser.csv:1: 'dro_mm' beside 'target_mm' in the heading" in refused(both)
    worksheet = "dro_mm,measured_mm\n0.001,0\n25.003,25\n50.004,50\n49.994,50\n24.99,25\n-0.01,0\n"
    assert read(worksheet.replace("measured", "block")).readings == read(worksheet).readings


def test_what_was_understood_is_one_line() -> None:
    said = understood(read(ISO))
    assert said == (
        "laser.csv: axis x, mm, 3 targets from 0 to 100, runs 1 forward and 1 backward; deviations -6 to +3 "
        "µm, positive where the nut went too far"
    )


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le"])
def test_readings_in_utf_16_are_read(encoding: str) -> None:
    assert (
        parse_survey(RTL.encode(encoding), "x.rtl").readings == parse_survey(RTL.encode(), "x.rtl").readings
    )


def test_told_units_and_axis_that_contradict_the_file_are_refused() -> None:
    assert "positions in mm, but units = inch" in refused(ISO, units=Units.INCH)
    assert "readings of axis x, but axis = y" in refused(ISO, axis="y")
    assert "a text of no known format" in refused("a b c\n1 2 3\n")
    assert "format 'rtl'" in refused(ISO, format="rtl")


@given(st.integers(1, 4), st.lists(st.integers(-50, 50), min_size=3, max_size=8))
def test_a_csv_of_any_survey_reads_as_that_survey(runs: int, errors_um: list[int]) -> None:
    lines, expected = ["target_mm,direction,run,deviation_um"], []
    for run in range(1, runs + 1):
        for way, name in ((UP, "forward"), (DOWN, "backward")):
            stops = list(enumerate(errors_um))
            for place, error in stops if way is UP else reversed(stops):
                lines.append(f"{place * 10},{name},{run},{error + run}")
                expected.append((float(place * 10), way, run, float(error + run)))
    survey = read("\n".join(lines))
    assert deviations_um(survey) == expected
    assert survey.remarks == ()


def test_surveys_of_one_axis_are_counted_on() -> None:
    both = merged([read(ISO), read(ISO)])
    assert {(r.direction, r.run) for r in both.readings} == {(UP, 1), (UP, 2), (DOWN, 1), (DOWN, 2)}
    with pytest.raises(ReadingsError, match="units"):
        merged([read(ISO), read(TB058_MANUAL)])


def test_one_target_written_in_two_ways_in_two_files_is_refused() -> None:
    # The usual distance is 50: nearer than 0.5 is the same target.
    for other, found in (
        ("50.3", "has target 50.3, but the files before have 50:"),
        ("49.7", "has target 49.7"),
    ):
        with pytest.raises(ReadingsError, match=found):
            merged([read(ISO), read(ISO.replace("\n50,", f"\n{other},"))])
    merged([read(ISO), read(ISO.replace("\n50,", "\n51,"))])


def test_a_fine_run_of_two_turns_goes_beside_the_grid_that_it_completes() -> None:
    """What the warning of aliased targets says: --from 200 --to 202 --step 0.125, and both files."""

    def run(targets: list[float], source: str) -> Survey:
        return Survey(
            tuple(Reading(x, way, x) for way in (UP, DOWN) for x in targets), Units.MM, source=source
        )

    grid = run([20.0 * index for index in range(21)], "grid.csv")
    fine = run([200 + 0.125 * index for index in range(17)], "fine.csv")
    for both in ([grid, fine], [fine, grid]):
        assert len({each.target for each in merged(both).readings}) == 21 + 16
    # One target in two spellings is still one, by the distance of the finer file.
    slipped = run([200.001, 250.0, 300.0], "slip.csv")
    with pytest.raises(ReadingsError, match=r"slip.csv has target 200.001, but the files before have 200:"):
        merged([grid, fine, slipped])


def test_the_same_readings_twice_are_named() -> None:
    [remark] = merged([read(ISO), read(ISO)]).remarks
    assert "the same readings as laser.csv: if this is one measurement, name it only once" in remark
    assert merged([read(ISO), read(ISO.replace("50.003", "50.004"))]).remarks == ()


def test_a_survey_in_inches_is_the_same_in_mm() -> None:
    survey = read(TB058_MANUAL).in_units(Units.MM)
    assert survey.readings[1].target == pytest.approx(-50.8)
    assert survey.readings[1].deviation == pytest.approx(-0.00254)


PLAIN = "target_mm,direction,run,measured_mm\n0,forward,1,0.001\n50,forward,1,50.002\n50,backward,1,50.022\n"


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + PLAIN.replace(",", ";").replace("\n", "\r\n"),
        "\n".join(f"{line},," if line else "" for line in PLAIN.split("\n")) + ",,,,,\n,,,,,\n",
        "# axis: x,,,,\n" + PLAIN + ",,,\r\n",
        "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in PLAIN.splitlines()) + "\n",
        '"# axis: x"\n' + PLAIN,
    ],
)
def test_what_a_spreadsheet_adds_changes_nothing(text: str) -> None:
    survey = parse_survey(text.encode(), "r.csv")
    assert survey.readings == parse_survey(PLAIN.encode(), "r.csv").readings
    assert survey.axis == ("x" if "axis" in text else None)


def test_a_cell_under_no_name_is_refused() -> None:
    text = PLAIN.replace("measured_mm", "measured_mm,,").replace("50.022", "50.022,,7")
    with pytest.raises(TabFileError, match=r"r\.csv:4: 6 cells"):
        parse_survey(text.encode(), "r.csv")


def test_many_wrong_lines_are_counted() -> None:
    rows = "".join(f"{n},forward,1,{n},5\n" for n in range(30))
    with pytest.raises(TabFileError) as raised:
        parse_survey(f"target_mm,direction,run,measured_mm\n{rows}".encode(), "r.csv")
    assert len(raised.value.problems) == 20
    assert "the same in 11 more lines" in str(raised.value.problems[-1])
