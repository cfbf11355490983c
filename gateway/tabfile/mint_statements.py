"""Mint statements, token by token.

Statements stand on lines of their own or behind ``:``. ``'`` begins a comment, and so does ``REM`` where a
statement begins. A line that ends with ``_`` or a backslash goes on in the next one.
"""

import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from gateway.tabfile.errors import TabFileError
from gateway.tabfile.fields import DECIMAL_ALLOWED, to_decimal, to_integer
from gateway.tabfile.text import SourceText, shown

_TOKEN: Final = re.compile(
    r'"[^"]*"?|(?:[0-9]|\.(?=[0-9]))(?:[eE][+-](?=[0-9])|[0-9A-Za-z_.])*|[A-Za-z_][A-Za-z0-9_]*|\S'
)
WORD: Final = re.compile("[A-Za-z_][A-Za-z0-9_]*")


class Token(NamedTuple):
    """A word, a number or a sign, and where it stands."""

    text: str
    line: int


Statement = Sequence[Token]


class Setting(NamedTuple):
    """A number, or a constant of Mint in capitals, and where it stands."""

    value: float | str
    line: int


def statements_of(source: SourceText) -> Iterator[Statement]:
    """Yield the statements of a program, none of them empty."""
    statement: list[Token] = []
    for line in source.lines:
        tokens = [Token(match.group(), line.number) for match in _TOKEN.finditer(line.text)]
        goes_on = False
        for index, token in enumerate(tokens):
            if token.text == "'" or (token.text.upper() == "REM" and not statement):
                break
            if token.text in {"_", "\\"} and (index + 1 == len(tokens) or tokens[index + 1].text == "'"):
                goes_on = True
                break
            if token.text != ":":
                statement.append(token)
            elif statement:
                yield statement
                statement = []
        if statement and not goes_on:
            yield statement
            statement = []
    if statement:
        yield statement


def words_of(statement: Statement) -> set[str]:
    """Return the words of a statement, in capitals."""
    return {token.text.upper() for token in statement if WORD.fullmatch(token.text)}


def text_of(statement: Statement) -> str:
    """Return a statement as text."""
    return " ".join(token.text for token in statement)


class Cursor:
    """Takes a statement apart, token by token."""

    def __init__(self, source: SourceText, statement: Statement) -> None:
        self.source = source
        self.line = statement[0].line
        self._statement = statement
        self._next = 1

    def error(self, allowed: str, found: str | None = None) -> TabFileError:
        """Return the error of the token that was taken last, or of ``found``."""
        if found is None:
            at = self._next - 1
            token = shown(self._statement[at].text) if at < len(self._statement) else "its end"
            found = f"{token} in {shown(text_of(self._statement))}"
        last = self._statement[min(self._next, len(self._statement)) - 1]
        return self.source.error(found, allowed, line=last.line)

    def take(self) -> Token:
        """Return the next token; an empty one at the end."""
        self._next += 1
        return self._statement[self._next - 1] if self._next <= len(self._statement) else Token("", self.line)

    def is_next(self, text: str) -> bool:
        """Take the next token if it is this one, in any case."""
        is_it = self._next < len(self._statement) and self._statement[self._next].text.upper() == text
        self._next += is_it
        return is_it

    def expect(self, *texts: str) -> str:
        """Take one of these."""
        text = self.take().text.upper()
        if text not in texts:
            raise self.error(" or ".join(texts))
        return text

    def word(self, what: str) -> str:
        """Take a name, in capitals."""
        text = self.take().text
        if not WORD.fullmatch(text):
            raise self.error(what)
        return text.upper()

    def whole(self, what: str) -> int:
        """Take a whole number that is not negative."""
        number = to_integer(self.take().text)
        if number is None or number < 0:
            raise self.error(what)
        return number

    def number(self) -> Setting:
        """Take a number with its sign, and say where it stands."""
        sign = "-" if self.is_next("-") else "+" if self.is_next("+") else ""
        token = self.take()
        value = to_decimal(sign + token.text)
        if value is None or self.is_next("(") or self._is_operator():
            raise self.error(f"{DECIMAL_ALLOWED}, no expression")
        return Setting(value, token.line)

    def _is_operator(self) -> bool:
        return self._next < len(self._statement) and self._statement[self._next].text in "+-*/^"

    def end(self) -> None:
        """Check that nothing follows."""
        if self._next < len(self._statement):
            self.take()
            raise self.error("the end of the statement")
