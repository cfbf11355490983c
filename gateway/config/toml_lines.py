"""Where the keys of a TOML text stand.

The standard reader keeps no line numbers. This scanner walks a text that the standard reader has already
accepted, so it checks nothing and only needs to tell keys, strings, brackets and comments apart. In a text
that was refused for a key given twice it finds both places.
"""

import contextlib
import re
from functools import cached_property
from typing import Final, NamedTuple

KeyPath = tuple[str | int, ...]

_BLANK: Final = re.compile(r"[ \t]*")
_BLANK_LINES: Final = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR: Final = re.compile(r"[^,\]}#\r\n]*")
_STRING: Final = re.compile(
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
    """A key or table that is given twice, and where."""

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
            # Else not TOML after all, or nested beyond reason: the lines found so far still help.
            scanner.document()
        return scanner

    @property
    def duplicate(self) -> Duplicate | None:
        """The first key that is given twice; such a text is no TOML."""
        return self._scanner.duplicate

    def of(self, path: KeyPath) -> int | None:
        """Line of a key; of the nearest table around it when the key itself is not in the text."""
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
        self._note(path, line)
        return path

    def _in_last_element(self, keys: list[str]) -> KeyPath:
        """A name that stands for an array of tables means its last element."""
        path: KeyPath = ()
        for key in keys:
            path = (*path, key)
            if path in self._counts:
                path = (*path, self._counts[path] - 1)
        return path

    def _give(self, path: KeyPath, line: int, given: dict[KeyPath, int]) -> None:
        """Note that a key gets its value or a table its header: neither may happen twice."""
        first = self._values.get(path) or self._headers.get(path)
        if first is not None and self.duplicate is None:
            self.duplicate = Duplicate(path, first, line)
        given.setdefault(path, line)

    def _note(self, path: KeyPath, line: int) -> None:
        for length in range(1, len(path)):
            self.lines.setdefault(path[:length], line)
        self.lines[path] = line

    def _pair(self, table: KeyPath) -> None:
        line = self._line_here()
        path = (*table, *self._dotted())
        self._give(path, line, self._values)
        self._note(path, line)
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
        quoted = self._take(_STRING)
        inside = quoted[1:-1]
        return inside if quoted[0] == "'" else _ESCAPE.sub(_unescape, inside)

    def _value(self, path: KeyPath) -> None:
        first = self.text[self.at]
        if first == "[":
            self._array(path)
        elif first == "{":
            self._inline_table(path)
        elif first in "\"'":
            self._take(_STRING)
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
        if found is None or (not found[0] and pattern in (_BARE, _STRING, _SCALAR)):
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
