"""PMAC's DEFINE COMP: entries in 1/16 count, negative travel at the end of the table, and what is refused."""

from pathlib import Path

import pytest

from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, FileContext, TabFileError, WriteOptions, dialect_named, parse_table
from tests.support.commands import typed
from tests.tabfile.texts import Texts

AMC, CMA = ErrorSense.ACTUAL_MINUS_COMMAND, ErrorSense.COMMAND_MINUS_ACTUAL
TABLE = "DEFINE COMP 4,4000\n16 32 16 0\n"
"""4 entries over 4000 counts: one each 1000 counts, +1, +2, +1 and 0 counts."""
UP = [(0.0, 0.0), (1.0, 0.001), (2.0, 0.002), (3.0, 0.001), (4.0, 0.0)]
"""What it adds at 1000 counts per mm from 0 to 4 mm."""
TOLD = {"units": Units.MM, "file_counts_per_unit": 1000.0, "error_sense": CMA, "travel": (0.0, 4.0)}
FILE = Texts("x.pmc", TOLD)
load, refused = FILE.parse, FILE.said


def read(text: str, **told: object) -> list[tuple[float, float]]:
    rows = load(text, **told).source.rows
    assert [row.backward for row in rows] == [row.forward for row in rows]
    return [(row.position, row.forward) for row in rows]


def test_the_first_entry_lies_one_spacing_from_0_and_the_last_one_also_stands_for_0() -> None:
    assert read(TABLE) == UP
    assert [row.forward_value for row in load(TABLE).source.rows] == [0, 16, 32, 16, 0]


def test_negative_travel_is_stored_at_the_end_of_the_table() -> None:
    uneven = "DEFINE COMP 4,4000\n16 32 48 0\n"
    # -1 mm is 3 mm in the table: entry 3, 48/16 counts
    assert read(uneven, travel=(-4.0, 0.0)) == [
        (-4.0, 0.0),
        (-3.0, 0.001),
        (-2.0, 0.002),
        (-1.0, 0.003),
        (0.0, 0.0),
    ]
    assert read(uneven, travel=(-1.0, 2.0)) == [(-1.0, 0.003), (0.0, 0.0), (1.0, 0.001), (2.0, 0.002)]
    # an end between two entries takes the entry beyond it too: between them the control takes a straight line
    assert [position for position, _ in read(uneven, travel=(-0.5, 1.25))] == [-1.0, 0.0, 1.0, 2.0]


def test_counts_that_fall_while_the_axis_goes_up_turn_place_and_sign() -> None:
    uneven = "DEFINE COMP 4,4000\n16 32 48 0\n"
    # 1000 counts of the motor are -1 mm, and one count that is added there moves the axis down
    assert read(uneven, travel=(-4.0, 0.0), file_counts_per_unit=-1000.0) == [
        (-4.0, 0.0),
        (-3.0, -0.003),
        (-2.0, -0.002),
        (-1.0, -0.001),
        (0.0, 0.0),
    ]
    assert read(uneven, travel=(0.0, 1.0), file_counts_per_unit=-1000.0) == [(0.0, 0.0), (1.0, -0.003)]


def test_the_other_sense_is_the_same_with_its_sign_changed() -> None:
    assert read(TABLE, error_sense=AMC) == [(position, -added + 0.0) for position, added in UP]


def test_units_are_those_of_the_axis_or_told() -> None:
    # 25400 counts per inch are 1000 per mm
    inch = load(TABLE, units=Units.INCH, file_counts_per_unit=25_400.0, travel=(0.0, 0.15)).table
    assert inch.units is Units.INCH
    assert inch.positions[1] == pytest.approx(1 / 25.4)
    assert inch.forward[1] == pytest.approx(0.001 / 25.4)
    told = load(
        TABLE, units=Units.INCH, file_units=Units.MM, file_counts_per_unit=25_400.0, travel=(0.0, 0.15)
    ).table
    assert told.units is Units.MM
    assert told.forward == pytest.approx([added for _, added in UP])


def test_a_table_of_one_turn_needs_no_travel_and_begins_again() -> None:
    loaded = load(
        "DEFINE COMP 4,36000\n16 32 -16 0\n", units=Units.DEGREE, file_counts_per_unit=100.0, travel=None
    )
    assert [(row.position, row.forward) for row in loaded.source.rows] == [
        (0.0, 0.0),
        (90.0, 0.01),
        (180.0, 0.02),
        (270.0, -0.01),
        (360.0, 0.0),
    ]
    assert (loaded.source.modulo, loaded.source.behaves_as) == (360.0, ("modulo = 360",))
    assert load(TABLE).source.modulo is None


@pytest.mark.parametrize(
    "text",
    [
        "define comp 4,4000\n16 32 16 0",
        "DEF COMP 4, 4000\r\n16\r\n32\r\n\r\n16 0\r\n",
        "#1\nDEFINE COMP 4,#1,4000\n16 32\n16 0\n",
        "#1 DEFINE COMP 4,#1d,4000\n16 32 16 0\n",
        "#2\n#1->1000X\nDEFINE COMP 4,#1D,#1,4000\n16 32 16 0\n",
        "; X\nCLOSE\n#1 DEL COMP\nDEFINE COMP 4,4000 ; all of X\n+16 32 ; 1 and 2\n// half\n16\n0\nI51=1\n",
    ],
)
def test_the_command_is_read_in_every_form(text: str) -> None:
    assert read(text) == UP


def test_of_several_motors_one_is_told() -> None:
    both = f"#2\n{TABLE}#1\nDEFINE COMP 2,4000\n16 0\n"
    assert "x.pmc:5: tables of motor 2, 1; allowed: file_axis = one of 2, 1" in refused(both)
    assert read(both, file_axis="2") == UP
    assert read(both, file_axis="#1") == [(0.0, 0.0), (2.0, 0.001), (4.0, 0.0)]
    assert "but file_axis = '3'" in refused(both, file_axis="3")
    assert "x.pmc:4: a second table of motor 1" in refused(f"#1\n{TABLE}DEFINE COMP 4,4000\n0 0 0 0\n")
    assert "x.pmc:1: a table for the addressed motor" in refused(TABLE + TABLE)


def test_a_source_alone_corrects_the_addressed_motor_which_must_be_known() -> None:
    alone = TABLE.replace("4,4000", "4,#1,4000")
    assert "'#1' on a line above it" in refused(alone)
    assert read(alone, file_axis="1") == UP
    assert "corrects motor 2 over the position of motor 1" in refused(f"#2\n{alone}")
    assert "corrects motor 2 over the position of motor 1" in refused(alone, file_axis="2")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("16 32 16 0", "16 32 16", "x.pmc:2: 3 entries; allowed: 4 whole numbers below line 1"),
        ("16 32 16 0", "16 32 16 0 0", "x.pmc:2: 5 entries; allowed: 4 whole numbers"),
        ("16 0\n", "16 0\n0\n", "x.pmc:3: '0' outside of a table"),
        ("DEFINE", "16\nDEFINE", "x.pmc:1: '16' outside of a table"),
        ("32", "32.5", "x.pmc:2: '16 32.5 16 0' after 0 entries"),
        ("32", "x", "x.pmc:2: '16 x 16 0' after 0 entries"),
        ("16 0", "16\nI51=1", "x.pmc:3: 'I51=1' after 3 entries"),
        (
            "16 0\n",
            "16 8\n",
            "x.pmc:2: a last entry of 8, but it is also the entry for the zero of the motor",
        ),
        ("4,4000", "4", "x.pmc:1: 'DEFINE COMP 4'"),
        ("4,4000", "0,4000", "x.pmc:1: 'DEFINE COMP 0,4000'"),
        ("4,4000", "4,0", "x.pmc:1: 'DEFINE COMP 4,0'"),
        ("4,4000", "4,1,4000", "x.pmc:1: 'DEFINE COMP 4,1,4000'"),
        ("4,4000", "4,#1,#1D,4000", "x.pmc:1: 'DEFINE COMP 4,#1,#1D,4000'"),
        ("4,4000", "4,#1,#1,#1,4000", "x.pmc:1: 'DEFINE COMP 4,#1,#1,#1,4000'"),
        ("4,4000", "2.2,#1,#2,#1,4000,4000", "x.pmc:1: a table in two dimensions"),
        ("4,4000", "4,#2,#1,4000", "x.pmc:1: a table that corrects motor 1 over the position of motor 2"),
    ],
)
def test_what_is_damaged_or_of_two_motors_is_refused_with_its_line(old: str, new: str, words: str) -> None:
    assert old in TABLE
    assert words in refused(TABLE.replace(old, new, 1))


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"units": None}, "file_units = 'mm', 'inch' or 'degree'"),
        (
            {"file_counts_per_unit": None},
            "file_counts_per_unit = counts of the motor per mm on the OLD control",
        ),
        ({"error_sense": None}, "error_sense = 'actual_minus_command' or 'command_minus_actual'"),
        ({"travel": None}, "travel = [lowest, highest] of the axis (--travel LO HI on the command line)"),
        ({"travel": (-1.0, 4.0)}, "x.pmc:1: a length of 4000 counts, that is 4 mm, for a travel of 5"),
    ],
)
def test_what_the_file_does_not_say_is_asked_for(told: dict[str, object], words: str) -> None:
    assert words in refused(TABLE, **told)


def test_the_error_that_asks_for_the_sense_says_what_the_manual_says() -> None:
    said = refused(TABLE, error_sense=None)
    assert "by its manual an entry is added (command_minus_actual)" in said
    assert "no manual states" not in said


def test_a_table_of_backlash_in_the_same_file_is_refused() -> None:
    said = refused(f"#1\n{TABLE}DEFINE BLCOMP 4,4000\n16 16 16 16\n")
    assert "x.pmc:4: a PMAC backlash table (DEFINE BLCOMP), which is not read" in said


def test_entries_beyond_the_travel_are_named_where_they_would_do_something() -> None:
    remarks = {lint.code: lint for lint in load(TABLE, travel=(0.0, 1.0)).lints}
    assert remarks["R13"].line == 1
    assert "2 entries other than 0, from 2 to 3" in remarks["R13"].message
    assert not load("DEFINE COMP 4,4000\n16 8 0 0\n", travel=(0.0, 2.0)).lints


@pytest.mark.parametrize(("line", "codes"), [("I51=0", ["R11"]), ("I51=1", []), ("i51 = 0\nI51=1", [])])
def test_a_file_that_leaves_compensation_off_is_remarked(line: str, codes: list[str]) -> None:
    assert [lint.code for lint in load(f"{TABLE}{line}\n").lints] == codes


def test_it_is_read_only() -> None:
    with pytest.raises(TabFileError, match="PMAC tables are only read"):
        dialect_named("pmac").write(load(TABLE).table, WriteOptions(axis="X"))


def test_the_commands_show_convert_and_lint_it(tmp_path: Path) -> None:
    file, out = tmp_path / "x.pmc", tmp_path / "x.csv"
    file.write_text(TABLE)
    told = ("--units", "mm", "--file-counts-per-unit", "1000", "--error-sense", "command_minus_actual")
    travel = ("--travel", "-4", "0")
    shown = typed("table", "show", str(file), *told, *travel)
    assert shown.returncode == 0, shown.stderr
    assert "pmac" in shown.stdout
    assert typed("table", "lint", str(file), *told, *travel).returncode == 0
    converted = typed("table", "convert", str(file), str(out), "--to", "csv", *told, *travel)
    assert converted.returncode == 0, converted.stderr
    assert [
        (row.position, row.forward)
        for row in parse_table(out.read_bytes(), "x.csv", FileContext()).source.rows
    ] == [(-4.0, 0.0), (-3.0, 0.001), (-2.0, 0.002), (-1.0, 0.001), (0.0, 0.0)]
    untold = typed("table", "show", str(file), *told)
    assert (untold.returncode, "--travel LO HI" in untold.stderr) == (1, True)
