"""TOML as written by a person: the line of each key, and its errors in plain words."""

import contextlib
import re
from functools import cached_property
from typing import Final, NamedTuple

# --- The lines of keys in a TOML text

KeyPath = tuple[str | int, ...]

_BLANK: Final = re.compile(r"[ \t]*")
_BLANK_LINES: Final = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR: Final = re.compile(r"[^,\]}#\r\n]*")
STRING: Final = re.compile(
    r"""
    "{3}(?:[^"\\]|\\.|"{1,2}(?!"))*"{3,5}   # a multi-line string may end in up to two quotes of its own
    | '{3}(?:[^']|'{1,2}(?!'))*'{3,5}
    | "(?:[^"\\\n]|\\.)*"
    | '[^'\n]*'
    """,
    re.VERBOSE | re.DOTALL,
)
_ESCAPE: Final = re.compile(r"\\(u[0-9A-Fa-f]{4}|U[0-9A-Fa-f]{8}|.)", re.DOTALL)
_ESCAPED: Final = {"b": "\b", "t": "\t", "n": "\n", "f": "\f", "r": "\r", '"': '"', "\\": "\\"}


class Duplicate(NamedTuple):
    """A key or table that is given twice, with its line."""

    path: KeyPath
    first_line: int
    second_line: int


class KeyLines:
    r"""Line numbers, from 1, of every key and table header of a TOML text; found when one is asked for.

    >>> KeyLines('[axis.x]\nunits = "mm"\ntravel = [\n 0, 1]').of(("axis", "x", "travel"))
    3
    """

    def __init__(self, text: str) -> None:
        self._text = text

    @cached_property
    def _scanner(self) -> "_Scanner":
        scanner = _Scanner(self._text)
        with contextlib.suppress(IndexError, AttributeError, RecursionError):
            # Otherwise invalid TOML, or nested too deep: the lines found so far still help.
            scanner.document()
        return scanner

    @property
    def duplicate(self) -> Duplicate | None:
        """The first key that is given twice, which TOML forbids."""
        return self._scanner.duplicate

    def of(self, path: KeyPath) -> int | None:
        """Line of a key, or of the nearest table around it if the key is not in the text."""
        lines = self._scanner.lines
        for length in range(len(path), 0, -1):
            if path[:length] in lines:
                return lines[path[:length]]
        return None


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.lines: dict[KeyPath, int] = {}
        self.duplicate: Duplicate | None = None
        self._counts: dict[KeyPath, int] = {}
        self._values: dict[KeyPath, int] = {}
        self._headers: dict[KeyPath, int] = {}
        self._line = 1
        self._line_at = 0

    def document(self) -> None:
        table: KeyPath = ()
        self._skip(_BLANK_LINES)
        while self.at < len(self.text):
            if self.text[self.at] == "[":
                table = self._header()
            else:
                self._pair(table)
            self._skip(_BLANK_LINES)

    def _header(self) -> KeyPath:
        line = self._line_here()
        brackets = 2 if self.text.startswith("[[", self.at) else 1
        self.at += brackets
        keys = self._dotted()
        self.at += brackets
        parent = self._in_last_element(keys[:-1])
        path = (*parent, keys[-1])
        if brackets == 2:
            index = self._counts.get(path, 0)
            self._counts[path] = index + 1
            self.lines.setdefault(path, line)
            path = (*path, index)
        elif path in self._counts:
            path = (*path, self._counts[path] - 1)
        self._give(path, line, self._headers)
        self._set_line(path, line)
        return path

    def _in_last_element(self, keys: list[str]) -> KeyPath:
        """The name of an array of tables means its last element."""
        path: KeyPath = ()
        for key in keys:
            path = (*path, key)
            if path in self._counts:
                path = (*path, self._counts[path] - 1)
        return path

    def _give(self, path: KeyPath, line: int, given: dict[KeyPath, int]) -> None:
        """Note that a key gets its value or a table its header. Neither may happen twice."""
        first = self._values.get(path) or self._headers.get(path)
        if first is not None and self.duplicate is None:
            self.duplicate = Duplicate(path, first, line)
        given.setdefault(path, line)

    def _set_line(self, path: KeyPath, line: int) -> None:
        for length in range(1, len(path)):
            self.lines.setdefault(path[:length], line)
        self.lines[path] = line

    def _pair(self, table: KeyPath) -> None:
        line = self._line_here()
        path = (*table, *self._dotted())
        self._give(path, line, self._values)
        self._set_line(path, line)
        self.at += 1  # the equals sign
        self._skip(_BLANK)
        self._value(path)

    def _dotted(self) -> list[str]:
        keys: list[str] = []
        while True:
            self._skip(_BLANK)
            keys.append(self._key())
            self._skip(_BLANK)
            if self.text[self.at] != ".":
                return keys
            self.at += 1

    def _key(self) -> str:
        if self.text[self.at] not in "\"'":
            return self._take(_BARE)
        quoted = self._take(STRING)
        inside = quoted[1:-1]
        return inside if quoted[0] == "'" else _ESCAPE.sub(_unescape, inside)

    def _value(self, path: KeyPath) -> None:
        first = self.text[self.at]
        if first == "[":
            self._array(path)
        elif first == "{":
            self._inline_table(path)
        elif first in "\"'":
            self._take(STRING)
        else:
            self._take(_SCALAR)

    def _array(self, path: KeyPath) -> None:
        self.at += 1
        index = 0
        self._skip(_BLANK_LINES)
        while self.text[self.at] != "]":
            element = (*path, index)
            self.lines[element] = self._line_here()
            self._value(element)
            self._skip(_BLANK_LINES)
            if self.text[self.at] == ",":
                self.at += 1
                self._skip(_BLANK_LINES)
            index += 1
        self.at += 1

    def _inline_table(self, path: KeyPath) -> None:
        self.at += 1
        self._skip(_BLANK_LINES)
        while self.text[self.at] != "}":
            self._pair(path)
            self._skip(_BLANK_LINES)
            if self.text[self.at] == ",":
                self.at += 1
                self._skip(_BLANK_LINES)
        self.at += 1

    def _skip(self, pattern: re.Pattern[str]) -> None:
        self._take(pattern)

    def _take(self, pattern: re.Pattern[str]) -> str:
        found = pattern.match(self.text, self.at)
        if found is None or (not found[0] and pattern in (_BARE, STRING, _SCALAR)):
            raise IndexError(f"nothing to read at {self.at}")
        self.at = found.end()
        return found[0]

    def _line_here(self) -> int:
        self._line += self.text.count("\n", self._line_at, self.at)
        self._line_at = self.at
        return self._line


def _unescape(escape: re.Match[str]) -> str:
    code = escape[1]
    if len(code) > 1:
        return chr(int(code[1:], 16))
    return _ESCAPED.get(code, code)


# --- What is wrong with a line that is not TOML, in words for readers who do not know TOML

GRAMMAR: Final = "see https://toml.io for the grammar"
_ASSIGNED: Final = re.compile(r"""(?P<key>[\w.\-"']+)[ \t]*=[ \t]*(?P<begun>[^=\[{,"']*)$""")
_COLON: Final = re.compile(r"""[ \t]*(?P<key>[\w.\-]+)[ \t]*:[ \t]*(?P<value>\S.*)""")
_NAKED: Final = re.compile(r"[ \t]*[\w.\-]+[ \t]+(?P<value>[^=\s].*)")
_NUMBER: Final = r"[+-]?\d[\d_]*"
_BOOLEANS: Final = {"yes": "true", "no": "false", "true": "true", "false": "false"}
_TYPED: Final = "“”„‟«»‘’"
"""Typographic quotes, which word processors put in place of straight ones."""


def in_words(line: str, column: int | None) -> str:
    """Return what to do about a line that is not TOML; ``column``, from 1, is where parsing stopped.

    >>> in_words("counts_per_unit = 1000,5", 23)
    'decimal point, not comma: counts_per_unit = 1000.5'
    >>> in_words("name = mill-1", 8)
    'text needs quotes: name = "mill-1"'
    """
    at = len(line) if column is None else column - 1
    before, rest = line[:at], line[at:]
    if line.lstrip().startswith(("//", ";", "--", "'")):
        return "a comment begins with #"
    if any(quote in line for quote in _TYPED):
        return "quotes are straight in TOML: \"text\" or 'text'"
    if opened := re.search(r"""([\w.\-]+)[ \t]*=[ \t]*(["'])([^"']*)$""", line):
        return f"a text ends with the quote that it begins with, on the same line: {_whole(opened)}"
    if "\\" in line and '"' in before:
        return "put a text with backslashes into single quotes, as in 'C:\\tables'"
    assigned = _ASSIGNED.search(before)
    if assigned is not None:
        value = (assigned["begun"] + re.split(r"[\n#}\]]", rest, maxsplit=1)[0]).strip()
        return _of_value(assigned["key"], value)
    return _of_line(line, before)


def _of_value(key: str, value: str) -> str:
    first = value.split(",", maxsplit=1)[0].strip()
    if not value:
        return f"a value is missing behind {key} ="
    if comma := re.fullmatch(rf"({_NUMBER}),(\d+)", value):
        return f"decimal point, not comma: {key} = {comma[1]}.{comma[2]}"
    if re.fullmatch(rf"{_NUMBER}(?:[ '’.]\d{{3}})+(?:[.,]\d+)?", value):
        plain = re.sub(r"[ '’.](?=\d{3})", "", value).replace(",", ".")
        return f"a number has nothing between its digits: {key} = {plain}"
    if re.fullmatch(r"[+-]?\.\d+|[+-]?\d+\.", first):
        number = re.sub(r"\.$", ".0", re.sub(r"^([+-]?)\.", r"\g<1>0.", first))
        return f"write a digit on both sides of the decimal point: {key} = {number}"
    if re.fullmatch(r"[+-]?0\d+", first):
        return f"a number does not begin with 0, and text needs quotes: {key} = {_quoted(first)}"
    if unit := re.fullmatch(rf"({_NUMBER}(?:\.\d+)?)\s*([A-Za-zµ°%/]+)", first):
        return f"write a number without its unit, and text in quotes: {key} = {unit[1]}"
    if first.lower() in _BOOLEANS:
        return f"true and false are written small, without quotes: {key} = {_BOOLEANS[first.lower()]}"
    return f"text needs quotes: {key} = {_quoted(first.strip(';'))}"


def _of_line(line: str, before: str) -> str:
    if line.lstrip().startswith("[") and "]" not in line:
        return (
            f"the name of a table ends with ]: {line.strip()}{']]' if line.strip().startswith('[[') else ']'}"
        )
    if (colon := _COLON.fullmatch(line)) is not None:
        return f"write = between a key and its value: {colon['key']} = {colon['value']}"
    if before.count("{") > before.count("}"):
        return "separate the items in { } by commas, and write } on the same line"
    if before.count("[") > before.count("]"):
        return "separate the items in [ ] by commas, and end the list with ]"
    if (naked := _NAKED.fullmatch(line)) is not None and "=" not in line:
        return f"write = between a key and its value, and # before a comment: {naked['value'].strip()}"
    return f"write a key, = and a value on a line, or the name of a table in [ ]; {GRAMMAR}"


def _whole(opened: re.Match[str]) -> str:
    key, quote, text = opened.groups()
    return f"{key} = {quote}{text.strip()}{quote}"


def _quoted(text: str) -> str:
    return f'"{text.strip(chr(34) + chr(39))}"'
