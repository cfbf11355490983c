"""The page on using the gateway as a library: what it types gives what it shows, without a machine."""

import doctest
from pathlib import Path

import pytest

from tests.docs.pages import ROOT, blocks_by_section

AT_A_MACHINE = "Commission a machine"
"""Its section is typed in test_library_at_a_machine.py."""


def test_what_the_page_types_gives_what_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    sections = blocks_by_section("library.md")
    typed = [block.text for name, found in sections.items() if name != AT_A_MACHINE for block in found]
    example = doctest.DocTestParser().get_doctest("\n".join(typed), {}, "library.md", None, 0)
    said: list[str] = []
    results = doctest.DocTestRunner().run(example, out=said.append)
    assert results.failed == 0, "".join(said)
    assert results.attempted > 60
    assert Path("tables").is_dir()
