"""One configuration file as text: its tables, and the lines its keys stand on."""

import hashlib
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gateway.config.problems import ConfigErrors, Problem, key_text
from gateway.config.toml_lines import KeyLines
from gateway.config.toml_words import GRAMMAR, in_words
from gateway.files import FileRefusedError, read_regular_file
from gateway.state.folder import LARGEST_CONFIGURATION

_PLACE: Final = re.compile(
    r"(?P<what>.*) \(at (?:line (?P<line>\d+), column (?P<column>\d+)|end of document)\)"
)
DEEPEST: Final = 50
"""No key lies so deep, and what copies or compares such a document would run out of stack."""
TOO_DEEP: Final = ("tables or arrays nested beyond reason", "write the keys that the reference lists")
_PART: Final = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_DOTTED: Final = re.compile(
    rf"(?:^|[{{,])[ \t\[]*{_PART}(?:[ \t]*\.[ \t]*{_PART}){{{DEEPEST}}}", re.MULTILINE
)
"""A key of more parts than any has: the standard reader takes the square of their number over it."""
_TWICE: Final = re.compile("overwrite|declare|duplicate|namespace", re.IGNORECASE)
"""How the standard reader speaks of keys and tables that are given twice."""


@dataclass(frozen=True, slots=True)
class Document:
    """A configuration that is TOML; what it means is not known yet."""

    path: Path
    tables: Mapping[str, Any]
    lines: KeyLines
    sha256: str = ""
    """Of the bytes of the file."""
    text: str = ""


def read_document(path: Path, what: str = "a configuration file") -> Document:
    """Read a TOML file; ``what`` is named where another file is needed.

    Raises:
        ConfigErrors: the file cannot be read, is no text, or is not TOML; with line and column.
    """
    return parse_document(path, *_read_text(path, what))


def parse_document(path: Path, text: str, sha256: str = "") -> Document:
    """Read the text of a TOML file that stands, or stood, at ``path``.

    Raises:
        ConfigErrors: it is not TOML; with line and column.
    """
    if (dotted := _DOTTED.search(text)) is not None:
        raise _refuse(path, *TOO_DEEP, text.count("\n", 0, dotted.start()) + 1)
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise _refuse(path, *TOO_DEEP) from None
    except ValueError as error:
        raise _syntax_error(path, text, error) from None
    if (line := _too_deep_at(tables, text)) is not None:
        raise _refuse(path, *TOO_DEEP, line)
    return Document(path, tables, KeyLines(text), sha256, text)


def _too_deep_at(tables: Mapping[str, Any], text: str) -> int | None:
    """Return the first line with tables or arrays deeper than any key; None where there are none."""
    waiting: list[tuple[object, int]] = [(tables, 0)]
    while waiting:
        here, depth = waiting.pop()
        if depth > DEEPEST:
            dots = (
                number for number, line in enumerate(text.split("\n"), start=1) if line.count(".") > DEEPEST
            )
            return next(dots, 1)
        inside = here.values() if isinstance(here, dict) else here if isinstance(here, list) else ()
        waiting += ((each, depth + 1) for each in inside)
    return None


def _read_text(path: Path, what: str) -> tuple[str, str]:
    """Return the text of a file, and the digest of its bytes."""
    try:
        content = read_regular_file(path, LARGEST_CONFIGURATION, what)
    except FileRefusedError as error:
        raise _refuse(path, error.found, error.remedy) from None
    try:
        # Editors on Windows put a byte order mark in front; CR LF is TOML's own.
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"byte {content[error.start]:#04x} is not UTF-8"
        raise _refuse(path, found, "save the file as UTF-8 text", line) from None
    return text, hashlib.sha256(content).hexdigest()


def _syntax_error(path: Path, text: str, error: ValueError) -> ConfigErrors:
    place = _PLACE.fullmatch(str(error))
    if place is None:
        return _refuse(path, f"not TOML: {error}", GRAMMAR)
    line, column = place["line"], place["column"]
    last_line = text.count("\n") + 1
    what = f"{place['what'][:1].lower()}{place['what'][1:]}"
    number = int(line) if line else last_line
    remedy = in_words(text.split("\n")[number - 1], int(column) if column else None)
    duplicate = KeyLines(text).duplicate
    if duplicate is not None and _TWICE.search(what):
        twice, first, second = duplicate
        what = f"{what}: {key_text(twice)} is given on line {first} and again on line {second}"
        remedy = "give every key and every table once"
    return _refuse(
        path,
        f"not TOML: {what}",
        remedy,
        number,
        int(column) if column else None,
    )


def _refuse(
    path: Path, found: str, remedy: str, line: int | None = None, column: int | None = None
) -> ConfigErrors:
    return ConfigErrors([Problem(str(path), "", found, remedy, line, column)])
