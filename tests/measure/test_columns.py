"""A decimal comma in the file of an instrument is never taken for two columns."""

from pathlib import Path

import pytest

from gateway.commissioning.measure.errors import BadReadingError, InstrumentError
from gateway.commissioning.measure.instruments import Columns, GrowingCsv


async def read(tmp_path: Path, above: str, row: str, column: str = "1", delimiter: str = ",") -> float:
    path = tmp_path / "laser.csv"
    path.write_bytes(above.encode())
    csv = GrowingCsv(path, column, delimiter)
    await csv.open()
    csv.arm()
    with path.open("ab") as stream:
        stream.write(row.encode())
    return await csv.read("50 forward")


@pytest.mark.parametrize(
    ("above", "row", "column"),
    [
        ("position\n", "50,0053\n", "1"),
        ("position\r\n", "50,0053\r\n", "position"),
        ("time,position\n", "12:00,50,0053\n", "position"),
        ("title of the program\ntime,position\n12:00,0.0001\n", "12:00,50,0053\n", "2"),
        ("", "50,0053\n", "1"),
        ("", "50,0053\n", "2"),
        ("0,0012\n", "50,0053\n", "1"),
    ],
)
async def test_a_decimal_comma_is_no_reading_without_its_decimals(
    tmp_path: Path, above: str, row: str, column: str
) -> None:
    with pytest.raises(BadReadingError, match=r"laser\.csv: .*50,0053.*decimal"):
        await read(tmp_path, above, row, column)


@pytest.mark.parametrize(
    ("above", "row", "column", "delimiter"),
    [
        ("position\n", "50.0053\n", "1", ","),
        ("", "50.0053\n", "1", ","),
        ("", "12:00,50.0053,20\n", "2", ","),
        ('\ufeff"time","position"\r\n', '"12:00","50.0053"\r\n', "position", ","),
        ("time\tposition\n", "12:00\t50.0053\n", "position", "tab"),
        ("time\tposition\n", "12:00\t50.0053\n", "position", r"\t"),
        ("title\ntime;position\n", "12:00;50.0053\n", "2", ";"),
        ("run,position\n", "3,50.0053\n", "2", ","),
    ],
)
async def test_one_whole_number_is_read(
    tmp_path: Path, above: str, row: str, column: str, delimiter: str
) -> None:
    assert await read(tmp_path, above, row, column, delimiter) == 50.0053


async def test_a_whole_number_beside_another_is_read_where_names_say_that_they_are_two(
    tmp_path: Path,
) -> None:
    assert await read(tmp_path, "position_um,run\n", "50005,1\n", "position_um") == 50005.0


@pytest.mark.parametrize("delimiter", ["", ";;", '"', "\n"])
def test_a_delimiter_is_one_character(delimiter: str) -> None:
    with pytest.raises(InstrumentError, match="--delimiter"):
        Columns("laser.csv", "1", delimiter)
