"""Fagor 8065 machine parameters: the leadscrew lines, what may be missing, and the way back."""

from pathlib import Path

import pytest

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, WriteOptions, dialect_named, explain, parse_table
from tests.support.table_commands import run
from tests.tabfile.samples import FAGOR_8065
from tests.tabfile.texts import Texts

AMC = ErrorSense.ACTUAL_MINUS_COMMAND
TEXT = FAGOR_8065.decode()
ONE_WAY = TEXT.replace("BIDIR            ;1", "BIDIR            ;0")
FILE = Texts("X.mp", {"error_sense": AMC}, encoding="utf-16-le")
parse, refused = FILE.parse, FILE.refused


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le"])
def test_the_files_of_the_control_are_utf_16(encoding: str) -> None:
    loaded = parse(TEXT.encode(encoding))
    assert (loaded.format, loaded.table.units) == ("fagor-8065", Units.MM)
    assert list(loaded.table.positions) == [-127.0, 0.0, 127.0, 254.0]


def test_corrections_by_hand() -> None:
    # 0.0028 at 127 and -0.0328 at 254: half way -0.0150; actual less command, so 0.0150 is added
    at = explain(parse(TEXT), 190.5)
    assert at.forward.correction == pytest.approx(0.0150, abs=1e-12)
    # 0.0100 and -0.0228: half way -0.0064
    assert at.backward.correction == pytest.approx(0.0064, abs=1e-12)
    turned = parse(TEXT, error_sense=ErrorSense.COMMAND_MINUS_ACTUAL)
    assert explain(turned, 190.5).forward.correction == pytest.approx(-0.0150, abs=1e-12)


def test_without_bidir_the_positive_errors_hold_both_ways() -> None:
    loaded = parse(ONE_WAY)
    assert loaded.table.is_unidirectional
    assert list(loaded.table.backward) == [0.0127, 0.0, -0.0028, 0.0328]


def test_an_error_in_inches_is_converted_for_an_axis_in_mm() -> None:
    loaded = parse(TEXT.replace("MM      ", "INCH    "), units=Units.MM)
    assert loaded.table.units is Units.INCH
    assert loaded.table.in_units(Units.MM).positions[2] == pytest.approx(127 * 25.4, abs=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "line", "found"),
    [
        ("X AXIS", "X AXES", 1, "X AXES"),
        ("MM      ", "METRE   ", 2, "METRE"),
        (
            "NPOINTS          ;4",
            "NPOINTS          ;5",
            3,
            "NPOINTS 5, but no POSITION 5, POSERROR 5, NEGERROR 5",
        ),
        ("NPOINTS          ;4", "NPOINTS          ;3", 8, "POSITION 4, but NPOINTS 3"),
        ("NPOINTS          ;4", "NPOINTS          ;1", 3, "NPOINTS '1'"),
        ("/LSCRWDATA/NPOINTS", "/LSCRWDATA/NPOINT", None, "no line /LSCRWDATA/NPOINTS"),
        ("/LSCRWDATA/BIDIR", "/LSCRWDATA/BIDI", None, "no line /LSCRWDATA/BIDIR"),
        ("BIDIR            ;1", "BIDIR            ;2", 4, "BIDIR '2'"),
        ("POSERROR 3", "POSERROR 4", 12, "DATA/POSERROR 4 for the second time"),
        ("POSERROR 3", "POSEROR 3", 11, "POSEROR 3"),
        (";0.0028", ";0.0o28", 11, "0.0o28"),
        (";0.0028", ";0.002", 11, "4 decimals, as in the lines above"),
        (";127.0000", ";-0.5000", 11, "L11 position -0.5 after 0"),
        ("2;/LSCRWDATA/DATA/POSERROR 3", "/LSCRWDATA/DATA/POSERROR 3", 11, "POSERROR 3"),
    ],
)
def test_what_is_not_whole_is_refused_by_line(old: str, new: str, line: int | None, found: str) -> None:
    assert TEXT.count(old) == 1
    assert found in str(refused(TEXT.replace(old, new), line=line))


def test_sense_and_axis_are_asked_for() -> None:
    refused(TEXT, "no manual states the sign", error_sense=None)
    refused(TEXT, "parameters of axis X, read for axis Y", axis="y")
    assert parse(TEXT, axis="y", file_axis="X").table.last == 254.0


def test_a_table_is_written_and_read_again() -> None:
    table = make_table([0.0, 100.0, 250.0], [0.0, 0.0101, -0.02], [0.001, 0.0, -0.021], Units.MM)
    written = dialect_named("fagor-8065").write(table, WriteOptions(axis="x", sense=AMC))
    assert written.encoding == "utf-16-le"
    lines = written.text.splitlines()
    assert [line.split(";")[-1] for line in lines[2:]] == [
        "3",
        "1",
        *("0.0000", "100.0000", "250.0000"),
        *("0.0000", "-0.0101", "0.0200"),
        *("-0.0010", "0.0000", "0.0210"),
    ]
    assert parse_table(written.text.encode(written.encoding), "X.mp", written.context).table == table


def test_convert_writes_utf_16(tmp_path: Path) -> None:
    source, out = tmp_path / "x.csv", tmp_path / "X.mp"
    source.write_text("position_mm,correction_mm\n0,0\n100,0.01\n")
    told = ("--to", "fagor-8065", "--to-axis", "X", "--to-sense", "actual_minus_command")
    assert run("convert", source, out, *told).exit_code == 0
    assert out.read_bytes().startswith("X AXIS ".encode("utf-16-le"))
    assert run("show", out, "--error-sense", "actual_minus_command").exit_code == 0
