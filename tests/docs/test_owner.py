"""No name or address is invented: one marker stands where an owner writes his own, and one page lists it."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
LIST = ROOT / ".github" / "OWNER.md"
# In two pieces, or this file would have the marker itself.
MARKER = "owner-to-fill-in" + ".invalid"
MADE = {line.rstrip("/") for line in (ROOT / ".gitignore").read_text().splitlines() if line.endswith("/")}
MADE |= {".git"}
ADDRESS = re.compile(r"[\w.+-]+@[A-Za-z][\w-]*(?:\.[A-Za-z][\w-]*)+")
RESERVED = re.compile(r"\bexample\.(?:org|com|net)\b")


def texts() -> Iterator[tuple[str, str]]:
    """Give each text file of the project with its path from the root."""
    for folder, folders, names in os.walk(ROOT):
        folders[:] = sorted(set(folders) - MADE)
        for name in sorted(names):
            path = Path(folder, name)
            if path.is_symlink() or not path.is_file():
                continue
            try:
                yield path.relative_to(ROOT).as_posix(), path.read_text()
            except UnicodeDecodeError:
                continue


def listed() -> list[str]:
    places = LIST.read_text().split("## Places")[1].split("\n## ")[0]
    return re.findall(r"^\| `([^`]+)` \|", places, re.MULTILINE)


def test_each_place_that_the_owner_has_to_fill_in_is_listed_and_each_that_is_listed_has_the_marker() -> None:
    marked = [path for path, text in texts() if MARKER in text and path != ".github/OWNER.md"]
    assert sorted(listed()) == sorted(marked)


def test_the_list_names_the_marker_that_is_looked_for() -> None:
    assert f"`{MARKER}`" in LIST.read_text()


def test_no_mail_address_stands_outside_the_tests_but_the_one_to_be_filled_in() -> None:
    found = {
        f"{path}: {address}"
        for path, text in texts()
        if not path.startswith("tests/")
        for address in ADDRESS.findall(text)
        if not address.endswith((MARKER, ".service"))
    }
    assert found == set()


def test_no_domain_that_is_reserved_for_examples_poses_as_a_place_of_the_project() -> None:
    found = [path for path, text in texts() if not path.startswith("tests/") and RESERVED.search(text)]
    assert found == []
