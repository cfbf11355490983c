"""The statements of a Mint program that make its leadscrew tables; all others are ignored.

Grammar, after the Mint v4 Advanced Programming Guide (MN1270, 3.4 and the keywords), words in any case::

    DIM name (size) [AS FLOAT] = value, value, ...
    PRECISIONTABLE (axis, forward [, reverse])
    keyword.axis = value
    keyword [axis, axis ...] = value, value ...      brackets or parentheses
    keyword = value                                  where there is one axis only

    keyword: PRECISIONMODE PRECISIONINCREMENT PRECISIONOFFSET BACKLASH BACKLASHMODE BACKLASHINTERVAL
             (PCO for PRECISIONOFFSET, BLM for BACKLASHMODE)

Values are numbers (or, for the two modes, Mint's constants); an expression is refused, not evaluated. Other
statements are counted and ignored if they mention neither a keyword nor an array that is used. Statements
that may not run (in an IF or a loop, in an EVENT, in a program with GOTO) are refused, as is every array
whose size is not the number of its values.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Final, NamedTuple

from msgspec import Struct

from gateway.tabfile.errors import TabFileError
from gateway.tabfile.text import DECIMAL_ALLOWED, SourceText, shown, to_decimal, to_integer

# --- Statements, token by token

_TOKEN: Final = re.compile(
    r'"[^"]*"?|(?:[0-9]|\.(?=[0-9]))(?:[eE][+-](?=[0-9])|[0-9A-Za-z_.])*|[A-Za-z_][A-Za-z0-9_]*|\S'
)
WORD: Final = re.compile("[A-Za-z_][A-Za-z0-9_]*")


class Token(NamedTuple):
    """A word, a number or a sign, and its position in the file."""

    text: str
    line: int


Statement = Sequence[Token]


class MintValue(NamedTuple):
    """A number, or a constant of Mint in capitals, and its position in the file."""

    value: float | str
    line: int


def statements_of(source: SourceText) -> Iterator[Statement]:
    """Yield the statements of a program, none of them empty.

    They have lines of their own or follow ``:``. ``'`` begins a comment; so does ``REM`` at the start of a
    statement. A line that ends with ``_`` or a backslash continues on the next one.
    """
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
    """Parses a statement token by token."""

    def __init__(self, source: SourceText, statement: Statement) -> None:
        self.source = source
        self.line = statement[0].line
        self._statement = statement
        self._next = 1

    def error(self, allowed: str, found: str | None = None) -> TabFileError:
        """Return the error of the last token, or of ``found``."""
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
        """Take one of these texts."""
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

    def number(self) -> MintValue:
        """Take a number with its sign; return it with its position."""
        sign = "-" if self.is_next("-") else "+" if self.is_next("+") else ""
        token = self.take()
        value = to_decimal(sign + token.text)
        if value is None or self.is_next("(") or self._is_operator():
            raise self.error(f"{DECIMAL_ALLOWED}, no expression")
        return MintValue(value, token.line)

    def _is_operator(self) -> bool:
        return self._next < len(self._statement) and self._statement[self._next].text in "+-*/^"

    def end(self) -> None:
        """Check that nothing follows."""
        if self._next < len(self._statement):
            self.take()
            raise self.error("the end of the statement")


# --- The statements that make tables

TABLE: Final = "PRECISIONTABLE"
MODE: Final = "PRECISIONMODE"
INCREMENT: Final = "PRECISIONINCREMENT"
OFFSET: Final = "PRECISIONOFFSET"
BACKLASH: Final = "BACKLASH"
BACKLASH_MODE: Final = "BACKLASHMODE"
BACKLASH_INTERVAL: Final = "BACKLASHINTERVAL"
_MODES: Final = (MODE, BACKLASH_MODE)
"""Programs turn them off, load, and turn them on again: the last one counts."""
_SETTINGS: Final = (MODE, INCREMENT, OFFSET, BACKLASH, BACKLASH_MODE, BACKLASH_INTERVAL)
_ALIASES: Final = {"PCO": OFFSET, "BLM": BACKLASH_MODE}
_KEYWORDS: Final = frozenset((TABLE, *_SETTINGS, *_ALIASES))
_ABBREVIATION: Final = re.compile("(PC|BL)[A-Z]{0,2}")
_OPENERS: Final = frozenset(("IF", "FOR", "WHILE", "REPEAT", "SELECT", "LOOP", "DO", "EVENT"))
_LONGEST: Final = 20
_CLOSE: Final = 0.87
"""Words with this similarity to a keyword (one letter off) count as misspelt keywords."""
_MARKS: Final = ("#", "?")
"""A label and a short PRINT begin with these, all other statements with a word."""
_CLOSERS: Final = frozenset(("ENDIF", "NEXT", "ENDW", "WEND", "ENDL", "UNTIL", "ENDSELECT"))


class Array(Struct, frozen=True):
    """An array of numbers and their lines."""

    values: tuple[float, ...]
    lines: tuple[int, ...]


class Table(Struct, frozen=True):
    """One ``PRECISIONTABLE`` for one axis; ``reverse`` is None if one table holds in both directions."""

    forward: Array
    reverse: Array | None
    line: int


@dataclass(slots=True)
class Program:
    """Tables and settings by axis; ``others`` counts the ignored statements."""

    tables: dict[int, Table] = field(default_factory=dict)
    settings: dict[tuple[str, int], MintValue] = field(default_factory=dict)
    others: int = 0


_Settings = list[tuple[str, int | None, MintValue]]


def parse_program(source: SourceText) -> Program:
    """Return the tables of a program and their settings.

    Raises:
        TabFileError: no table, or a statement about a table that is outside the grammar.
    """
    statements = list(statements_of(source))
    used = _used_arrays(source, statements)
    program, arrays, settings = Program(), dict[str, Array](), list[tuple[str, int | None, MintValue]]()
    blocks = _Blocks(source, has_goto=any("GOTO" in words_of(statement) for statement in statements))
    for statement in statements:
        first = statement[0].text.upper()
        first = _ALIASES.get(first, first)
        is_array = first == "DIM" and not used.isdisjoint(words_of(statement))
        if not is_array and first not in _KEYWORDS:
            _check_other(source, statement, used)
            blocks.pass_over(statement)
            program.others += 1
            continue
        blocks.check(statement)
        cursor = Cursor(source, statement)
        if is_array:
            _add_array(cursor, arrays)
        elif first == TABLE:
            _add_table(cursor, arrays, program)
        else:
            _add_settings(cursor, first, settings)
    _give_to_axes(source, program, settings)
    return program


def _used_arrays(source: SourceText, statements: Sequence[Statement]) -> set[str]:
    calls = [statement for statement in statements if statement[0].text.upper() == TABLE]
    if not calls:
        raise source.error(
            f"a Mint program without a statement that begins with {TABLE}",
            f"DIM fwd(5) = ... and {TABLE}(axis, fwd) or {TABLE}(axis, fwd, rev)",
        )
    return {word for statement in calls for word in words_of(statement[1:])}


def _check_other(source: SourceText, statement: Statement, used: set[str]) -> None:
    """Refuse a statement that could change a table in a way outside the grammar."""
    first, line = statement[0].text.upper(), statement[0].line
    if not WORD.fullmatch(first) and first not in _MARKS:
        found = f"a statement that begins with {shown(first)}"
        raise source.error(
            found, "a word: check that the line above it, or the part before ':', is complete", line=line
        )
    meant = get_close_matches(first, _KEYWORDS, n=1, cutoff=_CLOSE) if len(first) <= _LONGEST else []
    if meant:
        raise source.error(f"{shown(first)}, which is nearly {meant[0]}", f"{meant[0]}", line=line)
    mentioned = sorted(words_of(statement) & (used | _KEYWORDS))
    if mentioned:
        raise source.error(
            f"a statement with {mentioned[0]} that this reader does not know: {shown(text_of(statement))}",
            f"only DIM, {TABLE} and assignments of numbers: other statements are not computed",
            line=line,
        )
    if _ABBREVIATION.fullmatch(first) and len(statement) > 1 and statement[1].text[0] in ".[(=":
        raise source.error(
            f"{first}, perhaps the short form of a keyword",
            "the keyword in full, such as BACKLASH",
            line=line,
        )


class _Blocks:
    """Tracks whether a statement is certain to run."""

    def __init__(self, source: SourceText, *, has_goto: bool) -> None:
        self._source = source
        self._has_goto = has_goto
        self._depth = 0
        self._conditional_line = 0

    def pass_over(self, statement: Statement) -> None:
        """Register a statement that opens or closes a block."""
        words = [token.text.upper() for token in statement]
        if words[0] == "IF" and words[-1] != "THEN" and "THEN" in words:
            self._conditional_line = statement[-1].line
        elif words[0] in _OPENERS:
            self._depth += 1
        elif words[0] in _CLOSERS or (words[0] == "END" and len(words) > 1 and words[1] in _OPENERS):
            self._depth = max(0, self._depth - 1)

    def check(self, statement: Statement) -> None:
        """Refuse a statement of a table that may not run.

        Raises:
            TabFileError: it is in a block, behind an IF, or in a program that jumps.
        """
        line = statement[0].line
        if self._depth or self._has_goto or self._conditional_line == line:
            where = "a program with GOTO" if self._has_goto else "an IF, a loop or an EVENT"
            raise self._source.error(
                f"{shown(text_of(statement))} in {where}, so it may not run",
                "tables and their settings outside of it, where they always run once",
                line=line,
            )


def _add_array(cursor: Cursor, arrays: dict[str, Array]) -> None:
    name = cursor.word("the name of an array")
    cursor.expect("(")
    size = cursor.whole("the number of its values")
    cursor.expect(")")
    if cursor.is_next("AS"):
        cursor.expect("FLOAT")
    cursor.expect("=")
    values = [cursor.number()]
    while cursor.is_next(","):
        values.append(cursor.number())
    cursor.end()
    if name in arrays:
        raise cursor.error("one DIM for each array", f"a second DIM of {name}")
    if len(values) != size:
        raise cursor.error(f"{size}, as DIM says", f"{len(values)} values in {name}({size})")
    arrays[name] = Array(tuple(float(value) for value, _ in values), tuple(line for _, line in values))


def _add_table(cursor: Cursor, arrays: dict[str, Array], program: Program) -> None:
    cursor.expect("(")
    axis = cursor.whole("the number of an axis")
    cursor.expect(",")
    names = [cursor.word("the name of an array")]
    if cursor.expect(",", ")") == ",":
        names.append(cursor.word("the name of an array"))
        cursor.expect(")")
    cursor.end()
    for name in names:
        if name not in arrays:
            raise cursor.error(f"DIM {name}(n) = ... above it", f"an array {name} without values")
    if axis in program.tables:
        raise cursor.error(f"one {TABLE} for each axis", f"a second {TABLE} of axis {axis}")
    reverse = arrays[names[1]] if len(names) > 1 else None
    program.tables[axis] = Table(arrays[names[0]], reverse, cursor.line)


def _add_settings(cursor: Cursor, key: str, settings: _Settings) -> None:
    axes: list[int | None] = []
    if cursor.is_next("(") or cursor.is_next("["):
        axes.append(cursor.whole("the number of an axis"))
        while cursor.expect(",", ")", "]") == ",":
            axes.append(cursor.whole("the number of an axis"))
        cursor.expect("=")
    else:
        text = cursor.take().text
        axis = to_integer(text[1:]) if text.startswith(".") else None
        if text != "=" and axis is None:
            raise cursor.error(f"{key}.axis = value, {key}[axis, axis] = value, value, or {key} = value")
        axes.append(axis)
        if text != "=":
            cursor.expect("=")
    values = [_value(cursor, key)]
    while cursor.is_next(","):
        values.append(_value(cursor, key))
    cursor.end()
    if len(values) != len(axes):
        raise cursor.error("one value for each axis", f"{len(values)} values for {len(axes)} axes of {key}")
    settings.extend((key, axis, value) for axis, value in zip(axes, values, strict=True))


def _value(cursor: Cursor, key: str) -> MintValue:
    if key not in _MODES:
        return cursor.number()
    token = cursor.take()
    number = to_integer(token.text)
    if number is None and not WORD.fullmatch(token.text):
        raise cursor.error("a whole number or a constant of Mint")
    return MintValue(token.text.upper() if number is None else float(number), token.line)


def _give_to_axes(source: SourceText, program: Program, settings: _Settings) -> None:
    for key, own, setting in settings:
        if own is None and len(program.tables) > 1:
            raise source.error(
                f"{key} without an axis, in a program with tables for {len(program.tables)} axes",
                f"{key}.axis = value",
                line=setting.line,
            )
        axis = next(iter(program.tables)) if own is None else own
        before = program.settings.get((key, axis))
        if before is not None and before.value != setting.value and key not in _MODES:
            raise source.error(
                f"{key} of axis {axis}: {setting.value:g} here, {before.value:g} on line {before.line}",
                "one value",
                line=setting.line,
            )
        program.settings[key, axis] = setting
