"""A spreadsheet (.xlsx) -> the text of each of its sheets: a line for each row, cells between tabs.

A sheet is then processed like a file with tabs; the line number is that of the row. openpyxl reads it, from
the extra ``xlsx``. Cells that are invisible on the sheet are never read silently: a formula without its
result, a hidden row or column.
"""

import zipfile
import zlib
from collections.abc import Iterator
from datetime import date, time
from io import BytesIO
from typing import TYPE_CHECKING, Final

from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.text import SourceText, decode, listed

if TYPE_CHECKING:
    from openpyxl.workbook import Workbook
    from openpyxl.worksheet.worksheet import Worksheet

MAX_UNPACKED_BYTES: Final = 64 * 1024 * 1024
MAX_COLUMNS: Final = 1000
_ZIP: Final = b"PK\x03\x04"
_OLE: Final = b"\xd0\xcf\x11\xe0"
_DIGITS: Final = 15
"""The most digits that spreadsheets show. More are binary rounding of 0.1, and would split one target."""
_AS_CSV: Final = "save the sheet with the readings as CSV"
_INSTALL: Final = (
    "pip install 'pitch-gateway[xlsx]' where pitch-gateway is installed (or pip install openpyxl)"
)
# The exceptions of openpyxl for a damaged file are not documented: these are those of its parsers.
_DAMAGED: Final = (
    zipfile.BadZipFile,
    zlib.error,
    LookupError,
    ValueError,
    TypeError,
    AttributeError,
    SyntaxError,
    EOFError,
    OSError,
    NotImplementedError,
)


def is_workbook(data: bytes) -> bool:
    """Whether bytes are a spreadsheet and not a text."""
    return data.startswith((_ZIP, _OLE))


def sheets(data: bytes, name: str) -> tuple[SourceText, ...]:
    """Return the sheets with content, each named ``file[sheet]``.

    Raises:
        TabFileError: not an .xlsx, a damaged one, openpyxl is not installed, a formula without its result, a
            hidden row or column.
    """
    if data.startswith(_OLE):
        raise TabFileError(
            FileProblem(name, "a spreadsheet of an old format (.xls)", f"save it as .xlsx, or {_AS_CSV}")
        )
    try:
        import openpyxl
        from openpyxl.utils.exceptions import InvalidFileException
    except ImportError:
        raise TabFileError(
            FileProblem(
                name,
                "a spreadsheet, and openpyxl, which reads it, is not installed",
                f"{_INSTALL}; or {_AS_CSV}",
            )
        ) from None
    try:
        with zipfile.ZipFile(BytesIO(data)) as file:
            unpacked = sum(each.file_size for each in file.infolist())
        if unpacked > MAX_UNPACKED_BYTES:
            found = f"{unpacked} bytes when unpacked"
            raise TabFileError(FileProblem(name, found, f"at most {MAX_UNPACKED_BYTES}; {_AS_CSV}"))
        values = openpyxl.load_workbook(BytesIO(data), data_only=True)
        formulas = openpyxl.load_workbook(BytesIO(data))
    except (InvalidFileException, *_DAMAGED):
        raise TabFileError(
            FileProblem(
                name,
                "a spreadsheet that cannot be read: damaged, locked or of another format",
                f"an .xlsx; {_AS_CSV}",
            )
        ) from None
    sources = tuple(_sources(values, formulas, name))
    if not sources:
        raise TabFileError(FileProblem(name, "an empty spreadsheet", "a sheet with readings"))
    return sources


def _sources(values: "Workbook", formulas: "Workbook", name: str) -> Iterator[SourceText]:
    for worksheet in values.worksheets:
        where = f"{name}[{worksheet.title}]"
        text = "\n".join(_lines(worksheet, formulas[worksheet.title], where))
        if text.strip():
            yield decode(text.encode(), where, "a sheet")


def _lines(worksheet: "Worksheet", formulas: "Worksheet", where: str) -> Iterator[str]:
    if worksheet.max_column > MAX_COLUMNS:
        raise TabFileError(FileProblem(where, f"{worksheet.max_column} columns", f"at most {MAX_COLUMNS}"))
    hidden = [key for key, each in worksheet.column_dimensions.items() if each.hidden]
    for number, cells in enumerate(worksheet.iter_rows(), start=1):
        texts = [_text(cell.value) for cell in cells]
        is_hidden = bool(worksheet.row_dimensions[number].hidden) and any(texts)
        if is_hidden or (hidden and any(texts)):
            what = "row" if is_hidden else f"column {listed(hidden)}"
            raise TabFileError(
                FileProblem(
                    where,
                    f"a hidden {what}",
                    "only visible rows and columns: show or delete the hidden ones",
                    number,
                )
            )
        for cell in cells:
            if cell.value is None and formulas[cell.coordinate].data_type == "f":
                raise TabFileError(
                    FileProblem(
                        where,
                        f"a formula without its result in {cell.coordinate}",
                        f"open and save the file in the spreadsheet program, or {_AS_CSV}",
                        number,
                    )
                )
        while texts and not texts[-1]:
            texts.pop()
        yield "\t".join(texts)


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    if isinstance(value, date | time):
        return value.isoformat()
    return " ".join(str(value).split())
