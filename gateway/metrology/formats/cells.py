"""Lines of cells: a heading, a separator, numbers with a point, comments with facts."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.readings import STATED
from gateway.tabfile.csv_text import GROUPED, MAX_PROBLEMS, split_cells
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.text import DECIMAL_ALLOWED, SourceLine, SourceText, shown, to_decimal

SEPARATORS: Final = ("\t", ";", ",")
_WITH_COMMA: Final = re.compile(r"[+-]?[0-9]*,[0-9]+")
_WITH_POINT: Final = re.compile(r"[+-]?[0-9]*\.[0-9]+")
_NOT_A_WORD: Final = re.compile(r"[^a-z0-9.µ]+")
UNITS: Final = {
    "mm": Units.MM,
    "inch": Units.INCH,
    "inches": Units.INCH,
    "in": Units.INCH,
    "deg": Units.DEGREE,
    "degree": Units.DEGREE,
    "degrees": Units.DEGREE,
}
SMALL_UNITS: Final = {
    "um": (Units.MM, 1e-3),
    "µm": (Units.MM, 1e-3),
    "micron": (Units.MM, 1e-3),
    "microns": (Units.MM, 1e-3),
    "tenth": (Units.INCH, 1e-4),
    "tenths": (Units.INCH, 1e-4),
    "arcsec": (Units.DEGREE, 1 / 3600),
}
"""Units of deviations only, each with its size in units of the positions."""
NO_COMMA: Final = f"{DECIMAL_ALLOWED}: replace the commas, or change the setting in the program that saves it"


@dataclass(frozen=True, slots=True)
class Worksheet:
    """A text of cells: its heading, the lines under it, and the facts in its comments."""

    heading: SourceLine
    names: tuple[str, ...]
    lines: tuple[tuple[int, tuple[str, ...]], ...]
    """Line number and cells."""
    facts: dict[str, str]


def heading_of(source: SourceText) -> tuple[SourceLine, str] | None:
    """Return the first line that is not a comment, and its separator; None without a separator."""
    for line in source.lines:
        if line.text.strip('"\t;,') and not _is_comment(line):
            separator = next((each for each in SEPARATORS if each in line.text), None)
            return None if separator is None else (line, separator)
    return None


def heading_words(source: SourceText) -> list[tuple[str, ...]]:
    """Return the words of each name in the heading; empty without a heading."""
    found = heading_of(source)
    return [words(cell) for cell in found[0].text.split(found[1])] if found else []


def worksheet_of(source: SourceText, allowed: str) -> Worksheet:
    """Split a text into cells.

    Decimal commas become points if semicolons or tabs are the separators. Additions of a spreadsheet are
    removed: quotation marks around a cell, empty cells behind the last name, rows of empty cells.

    Raises:
        TabFileError: no heading, lines with another number of cells; a decimal comma is named in the message.
    """
    found = heading_of(source)
    if found is None:
        raise source.error("no heading with a separator", allowed, line=source.lines[0].number)
    heading, separator = found
    names = split_cells(heading.text, separator)
    while names and not names[-1]:
        names = names[:-1]
    facts: dict[str, str] = {}
    lines, problems = [], []
    for line in source.lines:
        if _is_comment(line):
            _state(source, line, separator, facts)
        elif line.number > heading.number and any(cells := split_cells(line.text, separator)):
            if len(cells) >= len(names) and not any(cells[len(names) :]):
                lines.append((line.number, cells[: len(names)]))
            else:
                problems.append(_wrong_count(source, line, len(cells), len(names), separator))
    if len(problems) > MAX_PROBLEMS:
        more = f"the same in {len(problems) - MAX_PROBLEMS + 1} more lines"
        problems = [*problems[: MAX_PROBLEMS - 1], source.problem(more, "")]
    if problems:
        raise TabFileError(*problems)
    return Worksheet(heading, names, _with_points(source, lines, separator), facts)


def _with_points(
    source: SourceText, lines: list[tuple[int, tuple[str, ...]]], separator: str
) -> tuple[tuple[int, tuple[str, ...]], ...]:
    """Convert decimal commas to points, if commas separate nothing and no number of the file has a point.

    Raises:
        TabFileError: numbers with commas beside numbers with points, one of which may separate thousands; or
            only commas that may separate thousands.
    """
    if separator == ",":
        return tuple(lines)
    commas = [(line, c) for line, cells in lines for c in cells if _WITH_COMMA.fullmatch(c)]
    comma = next(iter(commas), None)
    point = next(((line, c) for line, cells in lines for c in cells if _WITH_POINT.fullmatch(c)), None)
    if comma is None:
        return tuple(lines)
    if point is not None:
        raise source.error(
            f"{shown(comma[1])} with a decimal comma, but {shown(point[1])} with a point in line {point[0]}",
            "only one of them in a file: the other may separate thousands",
            line=comma[0],
        )
    if all(GROUPED.fullmatch(text) for _, text in commas):
        raise source.error(
            f"{shown(comma[1])}, which means {comma[1].replace(',', '.')} or {comma[1].replace(',', '')}",
            "decimal points, or at least one number whose comma cannot separate thousands, such as 0,5",
            line=comma[0],
        )
    return tuple(
        (line, tuple(c.replace(",", ".") if _WITH_COMMA.fullmatch(c) else c for c in cells))
        for line, cells in lines
    )


def _is_comment(line: SourceLine) -> bool:
    return line.text.lstrip('"').startswith("#")


def _state(source: SourceText, line: SourceLine, separator: str, facts: dict[str, str]) -> None:
    """Store the fact of a comment; a spreadsheet ends it with empty cells.

    Raises:
        TabFileError: two different statements of a fact that decides something.
    """
    key, _, fact = (
        part.strip() for part in line.text.rstrip(separator).strip('"').lstrip("# ").partition(":")
    )
    key = key.lower() if key.lower() in STATED else key
    if not fact:
        return
    if key in STATED and facts.get(key, fact) != fact:
        raise source.error(
            f"{key} {shown(fact)}, but {shown(facts[key])} in an earlier line",
            "in one file only readings of one axis, all with the same table or all without",
            line=line.number,
        )
    facts[key] = fact


def _wrong_count(
    source: SourceText, line: SourceLine, found: int, expected: int, separator: str
) -> FileProblem:
    comma = ", perhaps because of a decimal comma" if separator == "," and found > expected else ""
    return source.problem(
        f"{found} cells{comma}",
        f"{expected}, as in the heading; numbers with a decimal point",
        line=line.number,
    )


def decimal(source: SourceText, line: int, text: str, what: str) -> float:
    """Return the number in a cell.

    Raises:
        TabFileError: it is not a number, or has a decimal comma.
    """
    number = to_decimal(text)
    if number is None:
        if _WITH_COMMA.fullmatch(text):
            raise source.error(f"{what} {shown(text)} with a decimal comma", NO_COMMA, line=line)
        raise source.error(f"{what} {shown(text)}", DECIMAL_ALLOWED, line=line)
    return number


def words(name: str) -> tuple[str, ...]:
    """Split a name of a heading into words.

    >>> words("Measured position (mm)"), words("deviation_um")
    (('measured', 'position', 'mm'), ('deviation', 'um'))
    """
    return tuple(word for word in _NOT_A_WORD.split(name.lower()) if word)


def unit_of(name: str) -> tuple[Units, float] | None:
    """Return the units of positions implied by a name of a heading, and the factor from its own unit.

    >>> unit_of("deviation_um"), unit_of("run")
    ((<Units.MM: 'mm'>, 0.001), None)
    >>> unit_of("Forward Error Correction (* 0.0001 inches)")
    (<Units.INCH: 'inch'>, 0.0001)
    """
    parts = words(name)
    for index, word in enumerate(parts):
        if word in SMALL_UNITS:
            return SMALL_UNITS[word]
        if word in UNITS:
            scale = to_decimal(parts[index - 1]) if index else None
            return UNITS[word], scale or 1.0
    return None


def units_of(source: SourceText, worksheet: Worksheet) -> Units | None:
    """Return the units of positions that a heading states, or None.

    Raises:
        TabFileError: names of different units.
    """
    stated = [(name, unit[0]) for name in worksheet.names if (unit := unit_of(name)) is not None]
    for name, units in _others(stated):
        raise source.error(
            f"mixed units: {shown(stated[0][0])} is in {stated[0][1].value}, {shown(name)} in {units.value}",
            "one unit for target and reading (µm are allowed with mm, tenths with inches)",
            line=worksheet.heading.number,
        )
    return stated[0][1] if stated else None


def _others(stated: list[tuple[str, Units]]) -> Iterator[tuple[str, Units]]:
    return ((name, units) for name, units in stated if units is not stated[0][1])
