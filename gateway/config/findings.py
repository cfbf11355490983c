"""A configuration file as read, and what is wrong with it: model errors in plain words."""

import hashlib
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, NamedTuple, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from gateway.config.bounds import bounds_text
from gateway.config.problems import ConfigErrors, Problem, in_file_order, key_text, shown
from gateway.config.toml import GRAMMAR, KeyLines, KeyPath, in_words
from gateway.drives.strict import Mark, marks_of
from gateway.files import FileRefusedError, read_regular_file
from gateway.state.folder import LARGEST_CONFIGURATION
from gateway.state.include import INCLUDE, sets

# --- One configuration file as text: its tables, and the lines of its keys

_SYNTAX_ERROR: Final = re.compile(
    r"(?P<what>.*) \(at (?:line (?P<line>\d+), column (?P<column>\d+)|end of document)\)"
)
DEEPEST: Final = 50
"""No key is nested so deep. Copying or comparing a deeper document would exhaust the stack."""
TOO_DEEP: Final = ("tables or arrays nested too deeply", "write the keys that the reference lists")
_PART: Final = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_DOTTED: Final = re.compile(
    rf"(?:^|[{{,])[ \t\[]*{_PART}(?:[ \t]*\.[ \t]*{_PART}){{{DEEPEST}}}", re.MULTILINE
)
"""A key of more parts than any valid key has: the standard reader's time grows with the square of the
parts."""
_TWICE: Final = re.compile("overwrite|declare|duplicate|namespace", re.IGNORECASE)
"""The standard reader's words for keys and tables that are given twice."""


class Place(NamedTuple):
    """Where a value is written; None: the line is not known."""

    file: Path
    line: int | None


@dataclass(frozen=True, slots=True)
class Document:
    """A configuration that is valid TOML and not interpreted yet."""

    path: Path
    tables: Mapping[str, Any]
    lines: KeyLines
    files: Mapping[str, str] = field(default_factory=dict)
    """The files that it was read from, by absolute path, with the SHA-256 of each."""
    text: str = ""
    """That of its file; with ``include`` the text of all its files as one (``config.included``)."""
    parts: "tuple[Document, ...]" = ()
    """With ``include`` its files: the included ones in their order, then its own."""
    unmatched: tuple[int, ...] = ()
    """Elements of ``include`` that match no file."""

    @property
    def sha256(self) -> str:
        """Digest of the bytes of its own file; "" if it was not read from one."""
        return self.files.get(str(self.path.resolve()), "")

    def place_of(self, key: KeyPath) -> Place:
        """Return where a key is written, or the nearest table around it."""
        part = self._part_of(key)
        return Place(part.path, part.lines.of(key))

    def line_of(self, key: KeyPath) -> str:
        """Return the line of text with a key; "" if it is not known."""
        part = self._part_of(key)
        number = part.lines.of(key)
        return "" if number is None else part.text.split("\n")[number - 1]

    def order_of(self, key: KeyPath) -> tuple[int, int]:
        """Return what sorts keys as a reader meets them."""
        part = self._part_of(key)
        number = next((at for at, each in enumerate(self.parts) if each is part), 0)
        return number, part.lines.of(key) or 0

    def _part_of(self, key: KeyPath) -> "Document":
        """Return the file that decides the value at a key, or the table around a key that no file has."""
        for length in range(len(key), 0, -1):
            for part in reversed(self.parts):
                if sets(part.tables, key[:length]):
                    return part
        return self.parts[-1] if self.parts else self


def read_document(path: Path, what: str = "a configuration file") -> Document:
    """Read one TOML file; ``what`` names the expected kind of file in errors.

    Raises:
        ConfigErrors: the file cannot be read, is not text, or is not TOML; with line and column.
    """
    text, sha256 = _read_text(path, what)
    return parse_document(path, text, {str(path.resolve()): sha256})


def parse_document(
    path: Path, text: str, files: Mapping[str, str] | None = None, *, has_lines: bool = True
) -> Document:
    """Parse the text of the TOML file at ``path``, which was read from ``files``; no file is read.

    Without ``has_lines`` its lines are those of no file.

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
    return Document(path, tables, KeyLines(text if has_lines else ""), files or {}, text)


def _too_deep_at(tables: Mapping[str, Any], text: str) -> int | None:
    """Return the first line with tables or arrays deeper than any key; None if there is none."""
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
        # Editors on Windows write a byte order mark; TOML itself permits CR LF.
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"byte {content[error.start]:#04x} is not UTF-8"
        raise _refuse(path, found, "save the file as UTF-8 text", line) from None
    return text, hashlib.sha256(content).hexdigest()


def _syntax_error(path: Path, text: str, error: ValueError) -> ConfigErrors:
    match = _SYNTAX_ERROR.fullmatch(str(error))
    if match is None:
        return _refuse(path, f"not TOML: {error}", GRAMMAR)
    line, column = match["line"], match["column"]
    last_line = text.count("\n") + 1
    what = f"{match['what'][:1].lower()}{match['what'][1:]}"
    number = int(line) if line else last_line
    remedy = in_words(text.split("\n")[number - 1], int(column) if column else None)
    duplicate = KeyLines(text).duplicate
    if duplicate is not None and _TWICE.search(what):
        twice, first, second = duplicate
        what = f"{what}: {key_text(twice)} is given on line {first} and again on line {second}"
        remedy = "give every key and every table once"
    if path.suffix.lower() != ".toml":
        remedy = f"give the path of a configuration file; or, if this is one: {remedy}"
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


# --- The problems of one configuration


@dataclass(slots=True)
class Findings:
    """Collects all errors and warnings of one document."""

    document: Document
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)
    refused: set[KeyPath] = field(default_factory=set)
    """Keys with an error."""
    _lines_of: dict[KeyPath, KeyPath] = field(default_factory=dict)

    def refuse(self, path: KeyPath, found: str, remedy: str) -> None:
        """Add an error of the key at ``path``."""
        self.refused.add(path)
        self.problems.append(self._problem(path, found, remedy))

    def refuse_elsewhere(self, path: KeyPath, problem: Problem) -> None:
        """Add an error in another file, which the key at ``path`` names."""
        self.refused.add(path)
        self.problems.append(problem)

    def warn(self, path: KeyPath, found: str, remedy: str) -> None:
        """Add a warning of the key at ``path``."""
        self.warnings.append(self._problem(path, found, remedy))

    def is_refused(self, path: KeyPath) -> bool:
        """Whether this key, a key in it or a table around it already has an error."""
        return any(path[: len(other)] == other or other[: len(path)] == path for other in self.refused)

    def part(self) -> "Findings":
        """Return findings for a part of the same document that is checked separately.

        Keys refused so far count there too. :meth:`include` takes over the part's own findings.
        """
        return Findings(self.document, refused=set(self.refused), _lines_of=self._lines_of)

    def include(self, part: "Findings") -> None:
        """Take over the findings of a part."""
        self.problems += part.problems
        self.warnings += part.warnings
        self.refused |= part.refused

    def raise_if_any(self) -> None:
        """Raise all errors together, in the order of the file.

        Raises:
            ConfigErrors: there are errors.
        """
        if self.problems:
            file = str(self.document.path)
            raise ConfigErrors(in_file_order(self.problems, file), in_file_order(self.warnings, file))

    def stand_on_line_of(self, path: KeyPath, other: KeyPath) -> None:
        """Show problems of keys below ``path``, which is not in the file, at the line of ``other``."""
        self._lines_of[path] = other

    def _problem(self, path: KeyPath, found: str, remedy: str) -> Problem:
        shown = next((other for key, other in self._lines_of.items() if path[: len(key)] == key), path)
        place = self.document.place_of(shown)
        return Problem(str(place.file), key_text(path), found, remedy, place.line)


# --- Schema errors in words for the author of the file

UNKNOWN_KEY: Final = "unknown key"
_ALLOWED: Final[Mapping[str, str]] = {
    "bool_type": "true or false",
    "dict_type": "a table",
    "finite_number": "a finite number",
    "float_type": "a number",
    "int_from_float": "a whole number",
    "int_type": "a whole number",
    "model_attributes_type": "a table",
    "model_type": "a table",
    "string_type": "a text in quotes",
    "tuple_type": "a list in [ ]",
}
_OUT_OF_BOUNDS: Final = frozenset({"greater_than", "greater_than_equal", "less_than", "less_than_equal"})
_WITH_CONTEXT: Final[Mapping[str, str]] = {
    "too_short": "at least {min_length} of them",
    "too_long": "{max_length} of them",
    "string_too_short": "a text of at least {min_length} character",
    "string_pattern_mismatch": "a text that matches {pattern}",
    "enum": "{expected}",
}


def explain(
    findings: Findings, root: type[BaseModel], raw: object, base: KeyPath, error: ValidationError
) -> None:
    """Turn every schema error of one section into a problem of the file."""
    seen: set[tuple[KeyPath, str]] = set()
    for detail in error.errors(include_url=False):
        if _is_aftermath(detail):
            continue
        path = base + existing(raw, detail)
        found, remedy = _words(root, detail)
        if (path, remedy) not in seen:
            seen.add((path, remedy))
            findings.refuse(path, found, remedy)


def existing(raw: object, detail: ErrorDetails) -> KeyPath:
    """Return the path of an error as far as it exists in the file; a missing key still counts."""
    key_path = detail["loc"]
    here = raw
    for depth, part in enumerate(key_path):
        try:
            here = here[part]  # type: ignore[index]
        except (TypeError, KeyError, IndexError):
            is_missing_key = (
                detail["type"] == "missing" and depth == len(key_path) - 1 and isinstance(part, str)
            )
            return key_path[: depth + 1] if is_missing_key else key_path[:depth]
    return key_path


def _is_aftermath(detail: ErrorDetails) -> bool:
    """A list whose elements were refused counts as too short; that error adds nothing."""
    found = detail["input"]
    return (
        detail["type"] == "too_short"
        and isinstance(found, list)
        and len(found) >= detail["ctx"]["min_length"]
    )


def _words(root: type[BaseModel], detail: ErrorDetails) -> tuple[str, str]:
    kind = detail["type"]
    key_path = detail["loc"]
    if kind == "missing" and isinstance(key_path[-1], str):
        return "missing", f"needed: {_description(root, key_path)}"
    if kind == "missing":
        return f"found {shown(detail['input'])}", f"allowed: a list of {int(key_path[-1]) + 1} or more"
    if kind == "extra_forbidden" and key_path[-1] == INCLUDE:
        return UNKNOWN_KEY, "write it at the top of the file, before the first table in [ ]"
    if kind == "extra_forbidden":
        return UNKNOWN_KEY, suggest(str(key_path[-1]), keys_at(root, key_path[:-1]))
    found = f"found {shown(detail['input'])}"
    if kind == "value_error":
        return found, str(detail["ctx"]["error"])
    if kind in _OUT_OF_BOUNDS:
        field = field_at(root, key_path)
        return found, f"allowed: {bounds_text(field) if field is not None else detail['msg']}"
    if kind in _WITH_CONTEXT:
        return found, "allowed: " + _WITH_CONTEXT[kind].format(**detail["ctx"]).replace("'", '"')
    return found, "allowed: " + _ALLOWED.get(kind, detail["msg"])


def suggest(unknown: str, allowed: Sequence[str]) -> str:
    """Return the likely intended key, or the allowed keys.

    >>> suggest("counts_per_units", ["counts_per_unit", "units"])
    'did you mean counts_per_unit?'
    """
    near = get_close_matches(unknown.lower(), allowed, n=1, cutoff=0.6)
    return f"did you mean {near[0]}?" if near else f"allowed: {', '.join(allowed)}"


def keys_at(root: type[BaseModel], key_path: KeyPath) -> list[str]:
    """Return the allowed keys of the table at ``key_path`` of a section."""
    model = _model_at(root, key_path)
    return list(model.model_fields) if model is not None else []


def _description(root: type[BaseModel], key_path: KeyPath) -> str:
    field = field_at(root, key_path)
    return (field.description or "") if field is not None else ""


def field_at(root: type[BaseModel], key_path: KeyPath) -> FieldInfo | None:
    """Return the field of the key at ``key_path`` of a section; None for an unknown key."""
    names = [part for part in key_path if isinstance(part, str)]
    model = _model_at(root, tuple(names[:-1]))
    return model.model_fields.get(names[-1]) if model is not None and names else None


def marks_at(root: type[BaseModel], key_path: KeyPath) -> frozenset[Mark]:
    """Return the marks in the type of the key at ``key_path`` of a section; empty for an unknown key."""
    names = [part for part in key_path if isinstance(part, str)]
    model = _model_at(root, tuple(names[:-1]))
    return marks_of(model).get(names[-1], frozenset()) if model is not None and names else frozenset()


def _model_at(root: type[BaseModel], key_path: KeyPath) -> type[BaseModel] | None:
    model = root
    names_follow = False
    for part in key_path:
        if isinstance(part, int):
            continue
        if names_follow:  # the file chose this name; the keys of its table come next
            names_follow = False
            continue
        if part not in model.model_fields:
            return None
        inside = next(models_in(model.model_fields[part].annotation), None)
        if inside is None:
            return None
        names_follow = get_origin(model.model_fields[part].annotation) is dict
        model = inside
    return model


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models in a field's type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_in(part)
