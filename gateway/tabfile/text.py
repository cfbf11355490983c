"""Text of a file: its lines, its numbers, and comments that reveal damage.

It accepts many encodings; it is strict about content.
"""

import contextlib
import re
from collections.abc import Iterable, Sequence
from hashlib import sha256
from itertools import islice
from math import isfinite
from typing import Final

from msgspec import Struct

from gateway.tabfile.errors import FileProblem, TabFileError

MAX_BYTES: Final = 16 * 1024 * 1024
MAX_LINES: Final = 500_000
"""Capacity for a hundred thousand points in the widest dialect, several times over; more is not a table."""
DOS_END: Final = "\x1a"
"""CP/M and DOS editors end a text file with Ctrl-Z."""
_CONTROL: Final = re.compile("[\x00-\x08\x0b-\x19\x1b-\x1f\x7f]")
_LINE_END: Final = re.compile("\r\n|\r|\n")
_UTF16_MARKS: Final = (b"\xff\xfe", b"\xfe\xff")
_FIRST_BYTES: Final = 256
"""This many bytes show whether a text without a mark is UTF-16: every second one is 0 then."""
SHOWN_CHARACTERS: Final = 60
SHOWN_NAMES: Final = 20


class SourceLine(Struct, frozen=True):
    """One line without its end and without blanks around it; ``number`` counts from 1."""

    number: int
    text: str


class SourceText(Struct, frozen=True):
    """A decoded file: its lines from the first to the last that is not blank."""

    name: str
    lines: tuple[SourceLine, ...]
    sha256: str

    @property
    def last_line(self) -> int:
        """Number of the last line that is not blank."""
        return self.lines[-1].number

    def problem(
        self, found: str, allowed: str, *, line: int | None = None, code: str | None = None
    ) -> FileProblem:
        """Return a problem of this file."""
        return FileProblem(self.name, found, allowed, line, code)

    def error(
        self,
        found: str,
        allowed: str,
        *,
        line: int | None = None,
        code: str | None = None,
        readings: Iterable[str] = (),
    ) -> TabFileError:
        """Return the error of one problem of this file, for ``raise``."""
        return TabFileError(FileProblem(self.name, found, allowed, line, code, tuple(readings)))


def decode(data: bytes, name: str, what: str = "a table") -> SourceText:
    """Convert the bytes of a file of ``what`` to lines.

    A byte order mark, CRLF, CR or LF, blank lines around the text and a trailing Ctrl-Z are accepted. Text
    that is neither UTF-8 nor UTF-16 is read as Latin-1 (comments of old editors).

    Raises:
        TabFileError: the file is empty, binary, longer than 16 MiB or 500 000 lines, or continues after its
            Ctrl-Z.
    """
    allowed = f"the plain text of {what}"
    if len(data) > MAX_BYTES:
        raise TabFileError(FileProblem(name, f"{len(data)} bytes", f"at most {MAX_BYTES} bytes"))
    text, *rest = _to_text(data).split(DOS_END, 1)
    line_ends = text.count("\n") + text.count("\r") - text.count("\r\n")
    if line_ends > MAX_LINES:
        raise TabFileError(FileProblem(name, f"{line_ends} lines", f"at most {MAX_LINES} lines"))
    lines = _lines(text)
    _check_control(lines, name, allowed)
    if rest and rest[0].strip("\x00\x1a \t\r\n"):
        line = lines[-1].number if lines else 1
        raise TabFileError(
            FileProblem(name, "text after an end-of-file mark (Ctrl-Z)", "nothing after it", line)
        )
    while lines and not lines[-1].text:
        lines.pop()
    first = next((index for index, line in enumerate(lines) if line.text), len(lines))
    if first == len(lines):
        found = "no text in it" if data else "an empty file"
        raise TabFileError(FileProblem(name, found, allowed))
    return SourceText(name, tuple(lines[first:]), sha256(data).hexdigest())


def _to_text(data: bytes) -> str:
    if (utf16 := _utf16_of(data)) is not None and len(data) % 2 == 0:
        with contextlib.suppress(UnicodeDecodeError):
            return data.decode(utf16)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _utf16_of(data: bytes) -> str | None:
    """Return the UTF-16 encoding of a text, with or without its mark, or None."""
    if data.startswith(_UTF16_MARKS):
        return "utf-16"
    first = data[:_FIRST_BYTES]
    if len(first) >= 4 and not any(first[1::2]) and all(first[::2]):
        return "utf-16-le"
    return "utf-16-be" if len(first) >= 4 and not any(first[::2]) and all(first[1::2]) else None


def _lines(text: str) -> list[SourceLine]:
    # Not str.splitlines: it also splits at characters that are allowed inside a comment.
    return [
        SourceLine(number, part.strip(" \t")) for number, part in enumerate(_LINE_END.split(text), start=1)
    ]


def _check_control(lines: Iterable[SourceLine], name: str, allowed: str) -> None:
    for line in lines:
        control = _CONTROL.search(line.text)
        if control:
            found = f"control character 0x{ord(control.group()):02X}: the file is binary"
            raise TabFileError(FileProblem(name, found, allowed, line.number))


def listed(names: Iterable[str], between: str = ", ") -> str:
    """Join the first of some names for a message.

    >>> listed(["X1", "Y1"], " or ")
    'X1 or Y1'
    """
    first = list(islice(names, SHOWN_NAMES + 1))
    return between.join(first[:SHOWN_NAMES]) + (" …" if len(first) > SHOWN_NAMES else "")


def shown(text: str) -> str:
    """Quote a part of a file for a message, shortened if it is long.

    >>> shown('2,5')
    "'2,5'"
    """
    return repr(text if len(text) <= SHOWN_CHARACTERS else text[:SHOWN_CHARACTERS] + "…")


# --- Numbers in the spelling of files
#
# Python's own parsers accept more (``1_000``, ``nan``, ``٣``).

_INTEGER: Final = re.compile(r"[+-]?[0-9]{1,15}")
_DECIMAL: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
MAX_CHARACTERS: Final = 40
DECIMAL_ALLOWED: Final = "a decimal number with a point, such as -0.0001"
INTEGER_ALLOWED: Final = "a whole number, such as -32"


def to_integer(text: str) -> int | None:
    """Return a signed whole number of at most 15 digits, or None if ``text`` is not one.

    >>> to_integer("-1448819"), to_integer("1.0")
    (-1448819, None)
    """
    return int(text) if _INTEGER.fullmatch(text) else None


def with_point(text: str, allowed: str = DECIMAL_ALLOWED) -> str:
    """Return what is allowed in place of ``text``; for a number with a comma, add its correct form.

    >>> with_point("150,0", "a distance above 0")
    'a distance above 0: write 150.0'
    >>> with_point("x", "a distance above 0")
    'a distance above 0'
    """
    pointed = text.replace(",", ".")
    is_comma = text.count(",") == 1 and to_decimal(pointed) is not None
    return f"{allowed}: write {pointed}" if is_comma else allowed


def to_decimal(text: str) -> float | None:
    """Return a finite decimal number, or None if ``text`` is not one.

    >>> to_decimal("+0.00010000"), to_decimal("0,5")
    (0.0001, None)
    """
    if len(text) > MAX_CHARACTERS or not _DECIMAL.fullmatch(text):
        return None
    number = float(text)
    return number if isfinite(number) else None


# --- Comments that reveal damage: the number of points and the sum of the lines below them
#
# Formats with comments carry them as ``key: value``; other readers of the file skip them::
#
#     points: 24          the number of points of the table
#     sha256: 64 digits   of all lines from the first that is not a comment on, each without blanks around it
#                         and ended by a line feed
#
# Both are optional. Damage of a file that carries both is always detected.

Facts = dict[str, tuple[str, int]]
"""Value and line of each key that has a meaning."""
_FACT: Final = re.compile(r"(points|sha256|axis)\s*:\s*(.*)", re.IGNORECASE)
_SUM: Final = re.compile("[0-9a-f]{64}")


def stated_facts(source: SourceText, comments: Iterable[SourceLine], marks: str) -> Facts:
    """Return the facts in the comments; ``marks`` are the characters that begin one.

    Raises:
        TabFileError: a repeated key.
    """
    facts: Facts = {}
    for line in comments:
        fact = _FACT.fullmatch(line.text.lstrip(marks).strip())
        if fact is None:
            continue
        key = fact[1].lower()
        if key in facts:
            raise source.error(f"'{key}' a second time", f"only one (line {facts[key][1]})", line=line.number)
        facts[key] = (fact[2], line.number)
    return facts


def check_points(source: SourceText, facts: Facts, points: int) -> None:
    """Check the number of points against that of a comment.

    Raises:
        TabFileError: they differ.
    """
    if "points" not in facts:
        return
    value, line = facts["points"]
    if to_integer(value) != points:
        raise source.error(
            f"{points} points",
            f"{shown(value)}, as 'points' on line {line} says: check for a lost row",
            line=source.last_line,
        )


def check_sum(source: SourceText, body: Iterable[SourceLine], facts: Facts) -> None:
    """Check the lines below the comments against the sum of a comment.

    Raises:
        TabFileError: the lines were changed, or the comment does not hold a sum.
    """
    if "sha256" not in facts:
        return
    value, line = facts["sha256"]
    if not _SUM.fullmatch(value):
        raise source.error(f"'sha256' of {shown(value)}", "64 digits 0-9 a-f, or no such line", line=line)
    if value != _sum_of(row.text for row in body):
        raise source.error(
            "rows that changed after 'sha256' was written",
            "the original file; or, if the change is intended, the file without this line",
            line=line,
        )


def stamped(comments: Iterable[str], rows: Sequence[str], points: int, mark: str) -> list[str]:
    """Return the lines of a file: comments, both sums, rows."""
    head = [*comments, f"points: {points}", f"sha256: {_sum_of(rows)}"]
    return [*(f"{mark} {comment}" for comment in head), *rows]


def _sum_of(rows: Iterable[str]) -> str:
    return sha256("".join(f"{row}\n" for row in rows).encode()).hexdigest()
