"""The glossary: each word of the project's own once, in order, explained, and in use."""

import re
from typing import Final

import pytest

from tests.docs.pages import DOCS, ROOT

ROWS: Final = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (DOCS / "glossary.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ")
][1:]
SOURCES: Final = (*(ROOT / "gateway").rglob("*.py"), *(ROOT / "tests" / "ledger").glob("*.py"))
USED: Final = " ".join(path.read_text(encoding="utf-8") for path in SOURCES).casefold()
"""All that the code says, with its messages."""


def test_each_word_has_one_line_in_the_order_of_the_alphabet() -> None:
    words = [row[0].casefold() for row in ROWS]
    assert words == sorted(set(words))


def test_it_is_short_because_other_words_are_the_usual_ones_of_the_field() -> None:
    assert 30 <= len(ROWS) <= 60


def test_each_line_says_what_the_word_means() -> None:
    for row in ROWS:
        assert len(row) == 2, row
        assert all(row), row


@pytest.mark.parametrize("word", [row[0] for row in ROWS])
def test_a_word_that_is_explained_is_used(word: str) -> None:
    """A word in brackets is the name in the configuration."""
    for each in re.sub(r" \([^)]*\)", "", word).split(", "):
        stem = re.escape(each.casefold()).replace(r"\ ", r"[\s_-]").replace(r"\-", r"[\s_-]")
        is_used = bool(re.search(rf"(?<![a-z]){stem}", USED))
        assert is_used, each
