"""Parameter lists of the ISG kernel: ``key value`` lines with comments, as entries with their lines.

Grammar (ISG kernel and TwinCAT CNC documentation, "Compensation value lists")::

    key value              the key has no blanks, the value is the rest of the line
    # comment              to the end of the line
    /* comment */          also over several lines

A comment begins the line or follows a blank: a stray mark inside a number is an error, not its end. A comment
must not begin inside another: the end of the first is probably damaged, and entries would be lost in it. Case
of a key does not matter here.
"""

import re
from dataclasses import dataclass
from typing import Final

from gateway.tabfile.errors import Problem, TabFileError
from gateway.tabfile.text import SourceText, shown

MAX_PROBLEMS: Final = 20
_KEY: Final = re.compile(r"[a-z_]\w*(?:\[[0-9]{1,6}\])*(?:\.[a-z_]\w*(?:\[[0-9]{1,6}\])*)*", re.ASCII)
_OPENING: Final = re.compile(r"(?:^|(?<=[ \t]))(?:#|/\*)")
_OPENING_THERE: Final = re.compile(r"#|/\*")
_LIST_LINE: Final = "a line 'key value', such as 'kw.ssfk.table[0].pos 24', or a comment"


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of a list; ``key`` is in lower case."""

    key: str
    value: str
    line: int


def parse_list(source: SourceText) -> list[Entry]:
    """Return the entries of a list in the order of the file; nothing but comments and blanks is left out.

    Raises:
        TabFileError: a line that is neither an entry nor a comment, or a comment that does not end.
    """
    entries: list[Entry] = []
    problems: list[Problem] = []
    opened: int | None = None
    """Line of the block comment that is open."""
    for line in source.lines:
        text, is_open, is_nested = _without_comments(line.text, is_open=opened is not None)
        if is_nested:
            allowed = f"'*/' first, for the comment that began on line {opened or line.number}"
            problems.append(source.problem("'/*' inside a comment", allowed, line=line.number))
        opened = (opened or line.number) if is_open else None
        found = _entry(text, line.number)
        if isinstance(found, Entry):
            entries.append(found)
        elif found is not None:
            problems.append(source.problem(found, _LIST_LINE, line=line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if opened is not None:
        raise source.error("a comment that does not end", "'*/' after each '/*'", line=opened)
    return entries


def _entry(text: str, line: int) -> Entry | str | None:
    """Return the entry, None for a line without one, or what was found instead."""
    if not text:
        return None
    key, *value = text.split(None, 1)
    if not _KEY.fullmatch(key.lower()):
        return shown(text)
    if not value:
        return f"{shown(key)} without a value"
    return Entry(key.lower(), value[0], line)


def _without_comments(text: str, *, is_open: bool) -> tuple[str, bool, bool]:
    """Return what is no comment, whether one is open at the end, and whether one began in another."""
    kept: list[str] = []
    is_nested, at = False, 0
    while True:
        if is_open:
            # a place in the text, not the rest of it: a line may hold very many comments
            end = text.find("*/", at)
            is_nested = is_nested or "/*" in text[at : end if end >= 0 else None]
            if end < 0:
                return "".join(kept).strip(), True, is_nested
            kept.append(" ")
            at = end + 2
        # what begins right behind a comment is a comment, too
        opening = _OPENING_THERE.match(text, at) if is_open else None
        opening = opening or _OPENING.search(text, at)
        if opening is None:
            return "".join((*kept, text[at:])).strip(), False, is_nested
        kept.append(text[at : opening.start()])
        if opening.group() == "#":
            return "".join(kept).strip(), False, is_nested
        is_open, at = True, opening.end()
