"""The readable formats of readings. A new one is one file and one entry in :data:`FORMATS`."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.files import FileRefusedError, read_regular_file
from gateway.metrology.formats import api_pos, block_walk, iso_csv, manual, renishaw_rtl, wide_csv, workbook
from gateway.metrology.formats.context import ReadingsContext
from gateway.metrology.readings import Survey
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.text import MAX_BYTES, SourceText, decode, listed


@dataclass(frozen=True, slots=True)
class ReadingsFormat:
    """One file format: how to recognise and read it."""

    name: str
    title: str
    recognise: Callable[[SourceText], bool]
    read: Callable[[SourceText, ReadingsContext], Survey]


FORMATS: Final = (
    ReadingsFormat(renishaw_rtl.NAME, renishaw_rtl.TITLE, renishaw_rtl.recognise, renishaw_rtl.read),
    ReadingsFormat(api_pos.NAME, api_pos.TITLE, api_pos.recognise, api_pos.read),
    ReadingsFormat(iso_csv.NAME, iso_csv.TITLE, iso_csv.recognise, iso_csv.read),
    ReadingsFormat(block_walk.NAME, block_walk.TITLE, block_walk.recognise, block_walk.read),
    ReadingsFormat(wide_csv.NAME, wide_csv.TITLE, wide_csv.recognise, wide_csv.read),
    ReadingsFormat(manual.NAME, manual.TITLE, manual.recognise, manual.read),
)


def read_survey(path: Path, context: ReadingsContext | None = None) -> Survey:
    """Read a file of readings: whole or not at all.

    Raises:
        TabFileError: the file cannot be read, has no known format, breaks its grammar, or does not prove its
            meaning.
    """
    try:
        data = read_regular_file(path, MAX_BYTES, "a file of readings")
    except FileRefusedError as error:
        raise TabFileError(FileProblem(str(path), str(error), "")) from None
    return parse_survey(data, str(path), context)


def parse_survey(data: bytes, name: str, context: ReadingsContext | None = None) -> Survey:
    """Process the content of a file as :func:`read_survey` does.

    Raises:
        TabFileError: see :func:`read_survey`.
    """
    context = context or ReadingsContext()
    source = _worksheet_text(data, name) if workbook.is_workbook(data) else decode(data, name, "readings")
    return _choose(source, context.format).read(source, context)


def is_readings(path: Path) -> bool:
    """Whether a file exists and looks like a file of readings."""
    try:
        data = read_regular_file(path, MAX_BYTES, "a file of readings")
        source = _worksheet_text(data, str(path)) if workbook.is_workbook(data) else decode(data, str(path))
    except (FileRefusedError, TabFileError):
        return False
    return _is_known(source)


def _is_known(source: SourceText) -> bool:
    return any(each.recognise(source) for each in FORMATS)


def _worksheet_text(data: bytes, name: str) -> SourceText:
    """Return the sheet of a spreadsheet that has the readings.

    Raises:
        TabFileError: see :func:`gateway.metrology.formats.workbook.sheets`; no sheet looks like readings, or
            several do.
    """
    found = workbook.sheets(data, name)
    recognized = [each for each in found if _is_known(each)]
    if len(recognized) == 1:
        return recognized[0]
    if len(found) == 1:
        return found[0]
    what = f"{len(recognized)} sheets with readings" if recognized else "no sheet with readings"
    names = listed(each.name.removeprefix(name) for each in recognized or found)
    raise TabFileError(
        FileProblem(
            name, f"{what}: {names}", "one sheet of readings in a spreadsheet: delete the others in a copy"
        )
    )


def _choose(source: SourceText, given: str | None) -> ReadingsFormat:
    named = {each.name: each for each in FORMATS}
    if given is not None and given not in named:
        raise source.error(f"format {given!r}", ", ".join(named))
    fitting = [each for each in FORMATS if each.recognise(source)]
    if given is not None:
        return named[given]
    if len(fitting) == 1:
        return fitting[0]
    raise source.error(
        "a text of no known format of readings" if not fitting else "a text that fits several formats",
        f"a heading such as {iso_csv.HEADING!r}, with a line for each stop, or {wide_csv.HEADING!r}, with a "
        f"column for each run, or {manual.HEADING!r}, or a Renishaw .rtl or API .pos; "
        f"--readings-format {', '.join(named)}",
        line=source.lines[0].number,
    )
