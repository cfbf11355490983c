"""What the CSV dialects share: comments above the rows, one separator throughout, sums that show damage.

Grammar::

    file    := comment* row+
    comment := "#" text                 above the first row only; blank lines may stand between comments
    row     := cell (separator cell)*   separator: comma, semicolon or tab, the same in all rows

A comment ``# key: value`` is provenance. Three keys mean something: ``points`` is the number of points,
``sha256`` the sum of all rows (without blanks around them, each ended by a line feed), ``axis`` a letter.
Whatever was lost, added or changed in the rows of a file that carries both sums is found.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Final

from gateway.tabfile.context import FileContext
from gateway.tabfile.errors import TabFileError
from gateway.tabfile.fields import to_integer
from gateway.tabfile.text import Line, SourceText, shown

SEPARATORS: Final = {",": "commas", ";": "semicolons", "\t": "tabs"}
MAX_PROBLEMS: Final = 20
_FACT: Final = re.compile(r"#\s*(points|sha256|axis)\s*:\s*(.*)", re.IGNORECASE)
_SUM: Final = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class CsvRow:
    """One row; ``cells`` without blanks around them."""

    number: int
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CsvText:
    """The rows of a file and what its comments state; ``facts`` maps a key to its value and line."""

    separator: str
    rows: tuple[CsvRow, ...]
    facts: dict[str, tuple[str, int]]


def first_row(source: SourceText) -> Line | None:
    """Return the first line that is neither blank nor a comment."""
    return next((line for line in source.lines if line.text and not line.text.startswith("#")), None)


def parse_csv(source: SourceText, separators: str, what: str) -> CsvText:
    """Split a text into rows and check its sum; ``what`` names the first row that is expected.

    Raises:
        TabFileError: nothing but comments, no separator or several in the first row, a comment or a blank
            line among the rows, a key stated twice, rows that do not have the sum that the file states.
    """
    first = first_row(source)
    if first is None:
        raise source.error("nothing but comments", what, line=source.last_line)
    start = source.lines.index(first)
    facts = _facts(source, source.lines[:start])
    found = [separator for separator in SEPARATORS if separator in first.text]
    if len(found) != 1 or found[0] not in separators:
        names = " or ".join(SEPARATORS[separator] for separator in separators)
        raise source.error(shown(first.text), f"{what}, with {names} between its cells", line=first.number)
    body = source.lines[start:]
    _check_lines(source, body)
    _check_sum(source, body, facts)
    rows = tuple(
        CsvRow(line.number, tuple(cell.strip() for cell in line.text.split(found[0]))) for line in body
    )
    return CsvText(found[0], rows, facts)


def check_points(source: SourceText, csv: CsvText, points: int) -> None:
    """Check the number of points against the one that a comment states.

    Raises:
        TabFileError: they differ.
    """
    if "points" not in csv.facts:
        return
    value, line = csv.facts["points"]
    if to_integer(value) != points:
        raise source.error(
            f"{points} points",
            f"{shown(value)}, as '# points' on line {line} says: is a row lost?",
            line=source.last_line,
        )


def axis_letter(source: SourceText, csv: CsvText, context: FileContext) -> str | None:
    """Return the letter that a comment states; other words about an axis are provenance.

    Raises:
        TabFileError: the file is for another axis than it is read for.
    """
    value, line = csv.facts.get("axis", ("", 0))
    if not re.fullmatch("[A-Za-z]", value):
        return None
    letter = value.upper()
    if context.axis is not None and context.axis.upper() != letter:
        told = context.axis.upper()
        raise source.error(
            f"axis {letter}, read for axis {told}", f"axis {told}: is this the right file?", line=line
        )
    return letter


def csv_file(comments: Iterable[str], rows: Sequence[str], points: int) -> str:
    """Return the text of a file: comments, both sums, rows."""
    head = [*comments, f"points: {points}", f"sha256: {_sum_of(rows)}"]
    return "".join(f"{line}\n" for line in (*(f"# {comment}" for comment in head), *rows))


def _facts(source: SourceText, lines: Iterable[Line]) -> dict[str, tuple[str, int]]:
    facts: dict[str, tuple[str, int]] = {}
    for line in lines:
        fact = _FACT.fullmatch(line.text)
        if fact is None:
            continue
        key = fact[1].lower()
        if key in facts:
            raise source.error(
                f"'# {key}' a second time", f"it once (line {facts[key][1]})", line=line.number
            )
        facts[key] = (fact[2], line.number)
    return facts


def _check_lines(source: SourceText, body: Iterable[Line]) -> None:
    problems = [
        source.problem(
            "a comment among the rows" if line.text else "a blank line among the rows",
            "comments above the first row, rows without a gap",
            line=line.number,
        )
        for line in body
        if not line.text or line.text.startswith("#")
    ]
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])


def _check_sum(source: SourceText, body: Iterable[Line], facts: dict[str, tuple[str, int]]) -> None:
    if "sha256" not in facts:
        return
    value, line = facts["sha256"]
    if not _SUM.fullmatch(value):
        raise source.error(f"'# sha256' of {shown(value)}", "64 digits 0-9 a-f, or no such line", line=line)
    if value != _sum_of([row.text for row in body]):
        raise source.error(
            "rows that were changed since '# sha256' was written",
            "the file as it was; or, if the change is meant, the file without this line",
            line=line,
        )


def _sum_of(rows: Iterable[str]) -> str:
    return sha256("".join(f"{row}\n" for row in rows).encode()).hexdigest()
