"""A configuration with ``include``: several files, read as one document (decision 58)."""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from gateway.config.findings import Document, Findings, read_document
from gateway.config.problems import ConfigErrors, Problem, key_text
from gateway.config.toml import KeyLines
from gateway.state.include import INCLUDE, IncludeError, included_files, merged

MERGED: Final = "# Merged from "
"""A text that begins so was made of several files: its lines are those of no file."""
_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")


def read_configuration(path: Path) -> Document:
    """Read a configuration file with the files that it includes.

    Raises:
        ConfigErrors: a file cannot be read or is not TOML, each with file, line and column; or an included
            file includes others.
    """
    own = read_document(path)
    if INCLUDE not in own.tables:
        return own
    try:
        elements = included_files(path, own.tables)
    except IncludeError as error:
        raise ConfigErrors([_problem(own, error.index, error.found, error.remedy)]) from None
    parts: list[Document] = []
    problems: list[Problem] = []
    for index, paths in enumerate(elements):
        for each in paths:
            part = _included(own, index, each)
            if isinstance(part, Document):
                parts.append(part)
            else:
                problems += part
    if problems:
        raise ConfigErrors(problems)
    parts.append(own)
    tables = merged(part.tables for part in parts)
    names = ", ".join(_beside(part.path, path) for part in parts)
    return Document(
        path,
        tables,
        KeyLines(""),
        {name: digest for part in parts for name, digest in part.files.items()},
        f"{MERGED}{names}\n{toml_text(tables)}",
        tuple(parts),
        tuple(index for index, paths in enumerate(elements) if not paths),
    )


def _beside(path: Path, config: Path) -> str:
    """Return the name of a file for a comment, independent of where the program runs."""
    is_inside = path.is_relative_to(config.parent)
    return ascii(str(path.relative_to(config.parent) if is_inside else path))


def _included(own: Document, index: int, path: Path) -> Document | list[Problem]:
    """Return an included file, or what is wrong with it."""
    try:
        part = read_document(path)
    except ConfigErrors as errors:
        return [
            _problem(own, index, f"{problem.file}: {problem.found}", problem.remedy)
            if problem.is_of_whole_file
            else problem
            for problem in errors.problems
        ]
    if INCLUDE not in part.tables:
        return part
    remedy = f"remove it, and list its files in {own.path}"
    line = part.lines.of((INCLUDE,))
    return [Problem(str(path), INCLUDE, "an included file includes no others", remedy, line)]


def _problem(own: Document, index: int | None, found: str, remedy: str) -> Problem:
    key = (INCLUDE,) if index is None else (INCLUDE, index)
    return Problem(str(own.path), key_text(key), found, remedy, own.lines.of(key))


def check_include(findings: Findings) -> None:
    """Warn of patterns that match no file."""
    for index in findings.document.unmatched:
        findings.warn(
            (INCLUDE, index),
            f"{shown_element(findings.document, index)} matches no file",
            "put a file there, or remove the pattern",
        )


def shown_element(document: Document, index: int) -> str:
    """Return an element of ``include`` as it is written."""
    return str(document.parts[-1].tables[INCLUDE][index])


# --- The merged content as TOML, for what is kept with a plan or a recording


def toml_text(tables: Mapping[str, Any]) -> str:
    """Return tables as TOML that reads as the same tables.

    >>> print(toml_text({"axis": {"x": {"unit_id": 1, "cross": [{"axis": "y"}]}}}), end="")
    [axis.x]
    unit_id = 1
    [[axis.x.cross]]
    axis = "y"
    """
    return "".join(f"{line}\n" for line in _lines((), tables))


def _lines(path: tuple[str, ...], table: Mapping[str, Any]) -> Iterator[str]:
    inside = {key: value for key, value in table.items() if isinstance(value, dict) or _is_of_tables(value)}
    for key, value in table.items():
        if key not in inside:
            yield f"{_key(key)} = {_value(value)}"
    for key, value in inside.items():
        below = (*path, key)
        name = ".".join(map(_key, below))
        if isinstance(value, dict):
            has_values = any(not isinstance(each, dict) for each in value.values())
            if has_values or not value:
                yield f"[{name}]"
            yield from _lines(below, value)
        else:
            for each in value:
                yield f"[[{name}]]"
                yield from _lines(below, each)


def _is_of_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(each, dict) for each in value)


def _value(value: object) -> str:
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        inside = ", ".join(f"{_key(key)} = {_value(each)}" for key, each in value.items())
        return f"{{ {inside} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return str(value)  # a number, or a date or time, whose ISO form TOML has too


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _string(key)


def _string(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")  # JSON permits it, TOML does not
