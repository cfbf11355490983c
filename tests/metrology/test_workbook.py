"""Readings in spreadsheets, as openpyxl writes them: what is read, and what nobody would see is refused."""

import sys
import zipfile
from datetime import date
from io import BytesIO
from pathlib import Path
from random import Random

import openpyxl
import pytest

from gateway.compensation.direction import Direction
from gateway.metrology.formats import ReadingsContext, Runs, is_readings, parse_survey, read_survey
from gateway.metrology.readings import Survey
from gateway.tabfile import TabFileError
from tests.soak import repeated

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
PLAIN: list[list[object]] = [
    ["# axis: x"],
    ["target_mm", "forward 1 (um)", "backward 1 (um)", ""],
    [0, 1, -4],
    [50, 2.5, -3],
    [0.1 + 0.2 + 99.7, 3, -2],
]


def workbook(*sheets: list[list[object]]) -> bytes:
    book = openpyxl.Workbook()
    for number, rows in enumerate(sheets):
        worksheet = book.active if number == 0 else book.create_sheet()
        assert worksheet is not None
        worksheet.title = f"S{number + 1}"
        for row in rows:
            worksheet.append(row)
    return saved(book)


def saved(book: openpyxl.Workbook) -> bytes:
    out = BytesIO()
    book.save(out)
    return out.getvalue()


def read(data: bytes, **told: object) -> Survey:
    return parse_survey(data, "x.xlsx", ReadingsContext(**told))  # type: ignore[arg-type]


def refused(data: bytes, **told: object) -> str:
    with pytest.raises(TabFileError) as caught:
        read(data, **told)
    return str(caught.value)


def test_a_sheet_is_read_as_a_file_with_tabs_would_be() -> None:
    survey = read(workbook(PLAIN))
    assert (survey.axis, survey.source) == ("x", "x.xlsx[S1]")
    # 99.99999999999999 as a program keeps it is the 100 that the sheet shows.
    assert [(r.target, r.direction, round(r.deviation * 1e3, 6)) for r in survey.readings] == [
        (0, UP, 1.0),
        (50, UP, 2.5),
        (100, UP, 3.0),
        (0, DOWN, -4.0),
        (50, DOWN, -3.0),
        (100, DOWN, -2.0),
    ]


def test_the_sheet_with_the_readings_is_found_by_its_heading() -> None:
    notes: list[list[object]] = [["measured by", "somebody"], ["on", date(2026, 3, 2)]]
    assert read(workbook(notes, PLAIN)).source == "x.xlsx[S2]"
    assert "2 sheets with readings: [S1], [S2]" in refused(workbook(PLAIN, PLAIN))
    assert "no sheet with readings: [S1], [S2]" in refused(workbook(notes, notes))
    assert "an empty spreadsheet" in refused(workbook([]))


def test_an_error_names_the_sheet_and_the_row() -> None:
    broken = [*PLAIN[:3], [50, "2,5?", -3]]
    assert "x.xlsx[S1]:4: " in refused(workbook(broken))


def test_a_formula_is_its_result_or_refused() -> None:
    rows = [list(row) for row in PLAIN]
    rows[3][0] = "=25*2"
    without = workbook(rows)
    assert "x.xlsx[S1]:4: a formula without its result in A4" in refused(without)
    # Spreadsheet programs keep the result beside the formula; openpyxl has none to write.
    with_result = replaced(without, "<v></v>", "<v>50</v>")
    assert {r.target for r in read(with_result).readings} == {0, 50, 100}


def replaced(data: bytes, old: str, new: str) -> bytes:
    """The same spreadsheet with a text of its first sheet replaced."""
    out = BytesIO()
    with zipfile.ZipFile(BytesIO(data)) as source, zipfile.ZipFile(out, "w") as target:
        for each in source.infolist():
            content = source.read(each)
            if each.filename.endswith("sheet1.xml"):
                text = content.decode()
                assert old in text or "<v />" in text, text
                content = text.replace(old, new).replace("<v />", new).encode()
            target.writestr(each, content)
    return out.getvalue()


@pytest.mark.parametrize("what", ["row", "column"])
def test_what_is_hidden_is_not_read_in_silence(what: str) -> None:
    book = openpyxl.load_workbook(BytesIO(workbook(PLAIN)))
    worksheet = book["S1"]
    if what == "row":
        worksheet.row_dimensions[4].hidden = True
    else:
        worksheet.column_dimensions["C"].hidden = True
    found = refused(saved(book))
    assert f"a hidden {what}" in found
    assert ("x.xlsx[S1]:4" in found) == (what == "row")


def test_runs_without_a_way_are_told_theirs_here_too() -> None:
    rows: list[list[object]] = [["target_mm", "run 1", "run 2"], [0, 0.001, -0.004], [500, 0.002, -0.003]]
    survey = read(workbook(rows), runs=Runs.ALTERNATE)
    assert [r.direction for r in survey.readings] == [UP, UP, DOWN, DOWN]


def test_other_files_of_spreadsheet_programs_are_refused_with_a_remedy() -> None:
    assert "save it as .xlsx" in refused(b"\xd0\xcf\x11\xe0" + bytes(600))
    assert "damaged, locked or of another format" in refused(b"PK\x03\x04" + bytes(600))
    data = workbook(PLAIN)
    random, refusals = Random(7), set[str]()
    for _ in range(repeated(400)):
        at = random.randrange(len(data))
        mutant = data[:at] + bytes((random.randrange(256),)) + data[at + 1 :]
        try:
            found = read(mutant)
        except TabFileError as error:
            refusals.add(str(error)[:6])
        else:
            assert found.readings == read(data).readings
    assert refusals == {"x.xlsx"}


def test_without_openpyxl_the_error_names_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.xlsx"
    path.write_bytes(workbook(PLAIN))
    assert is_readings(path)
    assert len(read_survey(path).readings) == 6
    # As Python has it where a module cannot be found.
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(TabFileError) as caught:
        read_survey(path)
    assert "openpyxl, which reads it, is not installed" in str(caught.value)
    assert "pip install 'pitch-gateway[xlsx]'" in str(caught.value)
