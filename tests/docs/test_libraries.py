"""The page on what the gateway stands on names every dependency, and nothing else as one."""

import re
import tomllib
from collections.abc import Iterator

from tests.docs.pages import DOCS, ROOT

PAGE = (DOCS / "libraries.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def name_of(requirement: str) -> str:
    found = re.match(r"[A-Za-z0-9._-]+", requirement)
    assert found is not None, requirement
    return re.sub(r"[-_.]+", "-", found[0]).lower()


def required() -> Iterator[str]:
    yield from map(name_of, PROJECT["build-system"]["requires"])
    yield from map(name_of, PROJECT["project"]["dependencies"])
    for extra in PROJECT["project"]["optional-dependencies"].values():
        yield from map(name_of, extra)


def test_every_dependency_has_a_row_and_every_row_is_one() -> None:
    tables = re.findall(r"^\| library \|.*\n\|.*\n((?:\|.*\n)+)", PAGE, re.MULTILINE)
    rows = [row for table in tables for row in table.splitlines()]
    named = [name for row in rows for name in re.findall(r"`([^`]+)`", row.split("|")[1])]
    assert len(rows) > 30
    assert sorted(named) == sorted(set(required()) - {"pitch-gateway"})
    for row in rows:
        assert row.split("|")[2].strip(), row


def test_the_page_repeats_no_bound() -> None:
    assert re.findall(r"[<>=~]=?\s*\d", PAGE) == []


def test_every_place_that_it_names_is_there() -> None:
    places = re.findall(r"`((?:gateway|tests|tools)/[^`]+)`", PAGE)
    assert len(places) >= 20
    for place in places:
        assert (ROOT / place).exists(), place


def test_it_names_every_test_that_uses_pymodbus() -> None:
    using = {
        str(path.relative_to(ROOT))
        for path in (ROOT / "tests").rglob("test_*.py")
        if re.search(r"^from pymodbus", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert using <= set(re.findall(r"`(tests/[^`]+)`", PAGE))
