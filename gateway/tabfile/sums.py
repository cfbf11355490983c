"""Comments that show damage: the number of points and the sum of the lines below them.

Formats that tolerate comments carry them as ``key: value``; whoever else reads the file skips them::

    points: 24          the number of points of the table
    sha256: 64 digits   of all lines from the first that is no comment on, each without blanks around it and
                        ended by a line feed

Both are optional. A file that carries both cannot be damaged without notice.
"""

import re
from collections.abc import Iterable, Sequence
from hashlib import sha256
from typing import Final

from gateway.tabfile.fields import to_integer
from gateway.tabfile.text import Line, SourceText, shown

Facts = dict[str, tuple[str, int]]
"""Value and line of each key that means something."""
_FACT: Final = re.compile(r"(points|sha256|axis)\s*:\s*(.*)", re.IGNORECASE)
_SUM: Final = re.compile("[0-9a-f]{64}")


def stated_facts(source: SourceText, comments: Iterable[Line], marks: str) -> Facts:
    """Return what the comments state; ``marks`` are the characters that begin one.

    Raises:
        TabFileError: a key stated twice.
    """
    facts: Facts = {}
    for line in comments:
        fact = _FACT.fullmatch(line.text.lstrip(marks).strip())
        if fact is None:
            continue
        key = fact[1].lower()
        if key in facts:
            raise source.error(f"'{key}' a second time", f"it once (line {facts[key][1]})", line=line.number)
        facts[key] = (fact[2], line.number)
    return facts


def check_points(source: SourceText, facts: Facts, points: int) -> None:
    """Check the number of points against the one that a comment states.

    Raises:
        TabFileError: they differ.
    """
    if "points" not in facts:
        return
    value, line = facts["points"]
    if to_integer(value) != points:
        raise source.error(
            f"{points} points",
            f"{shown(value)}, as 'points' on line {line} says: is a row lost?",
            line=source.last_line,
        )


def check_sum(source: SourceText, body: Iterable[Line], facts: Facts) -> None:
    """Check the lines below the comments against the sum that a comment states.

    Raises:
        TabFileError: they were changed, or what is stated is no sum.
    """
    if "sha256" not in facts:
        return
    value, line = facts["sha256"]
    if not _SUM.fullmatch(value):
        raise source.error(f"'sha256' of {shown(value)}", "64 digits 0-9 a-f, or no such line", line=line)
    if value != _sum_of(row.text for row in body):
        raise source.error(
            "rows that were changed since 'sha256' was written",
            "the file as it was; or, if the change is meant, the file without this line",
            line=line,
        )


def stamped(comments: Iterable[str], rows: Sequence[str], points: int, mark: str) -> list[str]:
    """Return the lines of a file: comments, both sums, rows."""
    head = [*comments, f"points: {points}", f"sha256: {_sum_of(rows)}"]
    return [*(f"{mark} {comment}" for comment in head), *rows]


def _sum_of(rows: Iterable[str]) -> str:
    return sha256("".join(f"{row}\n" for row in rows).encode()).hexdigest()
