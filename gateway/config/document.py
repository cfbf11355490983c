"""One configuration file as text: its tables, and the lines its keys stand on."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gateway.config.problems import ConfigErrors, Problem
from gateway.config.toml_lines import KeyLines, key_lines

_PLACE: Final = re.compile(
    r"(?P<what>.*) \(at (?:line (?P<line>\d+), column (?P<column>\d+)|end of document)\)"
)
LARGEST_FILE: Final = 4_000_000
"""Bytes. A configuration has a few thousand; whatever is larger is another file."""


@dataclass(frozen=True, slots=True)
class Document:
    """A configuration that is TOML; what it means is not known yet."""

    path: Path
    tables: Mapping[str, Any]
    lines: KeyLines


def read_document(path: Path) -> Document:
    """Read a TOML file.

    Raises:
        ConfigErrors: the file cannot be read, is no text, or is not TOML; with line and column.
    """
    text = _read_text(path)
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise _refuse(
            path, "tables or arrays nested beyond reason", "write the keys that the reference lists"
        ) from None
    except ValueError as error:
        raise _syntax_error(path, text, error) from None
    return Document(path, tables, key_lines(text))


def _read_text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise _refuse(path, "no such file", "give the path of the configuration") from None
    except IsADirectoryError:
        raise _refuse(path, "a folder", "give the path of the configuration file in it") from None
    except PermissionError:
        raise _refuse(
            path, "may not be read", "give this user read permission to the file and its folders"
        ) from None
    except (OSError, ValueError) as error:
        raise _refuse(path, f"cannot be read ({error})", "give the path of the configuration") from None
    if len(content) > LARGEST_FILE:
        raise _refuse(path, f"more than {LARGEST_FILE} bytes", "this is not a configuration file")
    try:
        # Editors on Windows put a byte order mark in front; CR LF is TOML's own.
        return content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"byte {content[error.start]:#04x} is not UTF-8"
        raise _refuse(path, found, "save the file as UTF-8 text", line) from None


def _syntax_error(path: Path, text: str, error: ValueError) -> ConfigErrors:
    place = _PLACE.fullmatch(str(error))
    if place is None:
        return _refuse(path, f"not TOML: {error}", "see https://toml.io for the grammar")
    line, column = place["line"], place["column"]
    last_line = text.count("\n") + 1
    return _refuse(
        path,
        f"not TOML: {place['what'][:1].lower()}{place['what'][1:]}",
        "see https://toml.io for the grammar",
        int(line) if line else last_line,
        int(column) if column else None,
    )


def _refuse(
    path: Path, found: str, remedy: str, line: int | None = None, column: int | None = None
) -> ConfigErrors:
    return ConfigErrors([Problem(str(path), "", found, remedy, line, column)])
