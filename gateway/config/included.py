"""A configuration with ``include``: several files, read as one document (decision 58)."""

from pathlib import Path
from typing import Final

from gateway.config.findings import Document, Findings, read_document
from gateway.config.problems import ConfigErrors, Problem, key_text
from gateway.config.toml import KeyLines
from gateway.config.toml_text import toml_text
from gateway.state.include import INCLUDE, IncludeError, included_files, merged

MERGED: Final = "# Merged from "
"""A text that begins so was made of several files: its lines are those of no file."""


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
