"""``make house``: what it counts of a small program, worked out by hand, and two revisions side by side."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tools.house import figures_of, table

ROOT = Path(__file__).parents[2]
FIRST = '''\
"""A module: a place of its own."""

from dataclasses import dataclass
from typing import Any, NamedTuple


@dataclass
class Point:
    """A record."""

    x: float
    """Where it stands."""


class Pair(NamedTuple):
    """Another."""

    whereabouts: dict[str, Any]


class Passing:
    """It hands on."""

    def __init__(self, to: "Passing") -> None:
        self.to = to

    def ask(self, what: int, *, how: str) -> int:
        """See Point."""
        return self.to.ask(what, how=how)

    def answer(self, what: int) -> int:
        # It does something: that is no delegation.
        return self.to.answer(what + 1)
'''
SECOND = """\
from program.first import Point


class Point:
    pass
"""


def small_tree(folder: Path) -> Path:
    package = folder / "gateway"
    package.mkdir()
    (package / "first.py").write_text(FIRST)
    (package / "second.py").write_text(SECOND.replace("program", "gateway"))
    (folder / "docs").mkdir()
    (folder / "docs" / "page.md").write_text("Nobody keeps a tally: it is told at once.\n\n| – | - |\n")
    return folder


def test_what_is_counted_of_a_small_program(tmp_path: Path) -> None:
    figures = figures_of(small_tree(tmp_path))
    assert figures == {
        "files": 2,
        "lines": 33 + 5,
        # Of the first: imports 2, Point 3, Pair 2, Passing 1, each of its functions 2. Of the second 3.
        "code lines": 14 + 3,
        # Of the first: classes 3, functions 3, attributes 2, other 3. Of the second: class, pass.
        "statements": 11 + 2,
        "files under 70 lines": 2,
        "modules with one importer": 1,
        "classes": 4,
        "record types": 2,
        "enums": 0,
        "protocols": 0,
        "public class names used twice": 1,
        "pure delegations": 1,
        '"See X" docstrings': 1,
        "dict[str, Any]": 1,
        "house words in identifiers": 1,
        "house words in strings": 2,  # place, stands
        "house words in pages": 2,  # tally, told
        "idioms in strings and pages": 1 + 1 + 3,  # of its own, stands; nobody, is told, at once
        "words in pages": 9,  # bars and dashes of a table are none
        "words in decisions": 0,
        "files of tests": 0,
        "lines of tests": 0,
        "lines of tools": 0,
    }


def test_two_columns_say_what_has_changed() -> None:
    lines = list(table([("before", {"files": 619, "lines": 86448}), ("after", {"files": 360, "new": 3})]))
    assert [line.split() for line in lines] == [
        ["before", "after"],
        ["files", "619", "360", "-259"],
        ["lines", "86,448", "-"],
        ["new", "-", "3"],
    ]


@pytest.mark.skipif(shutil.which("git") is None, reason="it asks git")
def test_a_revision_that_is_not_there_is_said() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tools.house", "no-such-revision"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("no-such-revision: fatal: ")
