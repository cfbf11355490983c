"""A long list as text: what belongs to one heading is one paragraph, ``HEADING: ITEM; ITEM; ITEM``."""

import textwrap
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Final

WIDTH: Final = 110
Listed = set[tuple[str, str]]
"""Headings and items."""


def text_of(listed: Listed) -> str:
    """Return a list as text. An item that is a row of a table (``A | B``) has a line of its own.

    >>> print(text_of({("event", "ready info"), ("event", "stopped info"), ("key http", "listen | text")}))
    event: ready info; stopped info
    key http: listen | text
    <BLANKLINE>
    """
    paragraphs: dict[tuple[str, str], list[str]] = defaultdict(list)
    for heading, item in sorted(listed):
        paragraphs[heading, item if " | " in item else ""].append(item)
    return "".join(
        textwrap.fill(
            f"{heading}: {'; '.join(items)}",
            WIDTH,
            subsequent_indent="  ",
            break_long_words=False,
            break_on_hyphens=False,
        )
        + "\n"
        for (heading, _), items in paragraphs.items()
    )


def listed_in(text: str) -> Listed:
    """Return the headings and items of a text.

    >>> sorted(listed_in("event: ready info;\\n  stopped info\\n"))
    [('event', 'ready info'), ('event', 'stopped info')]
    """
    found: Listed = set()
    for paragraph in text.replace("\n  ", " ").splitlines():
        heading, _, items = paragraph.partition(": ")
        found.update((heading, item) for item in items.split("; "))
    return found


def write(file: Path, listed: Iterable[tuple[str, str]]) -> None:
    """Add items to those of a file. None goes: who means it takes it out by hand."""
    before = listed_in(file.read_text(encoding="utf-8")) if file.exists() else set[tuple[str, str]]()
    text = text_of(before | set(listed))
    assert listed_in(text) == before | set(listed), "an item has the form of several"
    file.write_text(text, encoding="utf-8")
