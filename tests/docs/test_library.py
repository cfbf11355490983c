"""The page on using the gateway as a library: what it types gives what it shows."""

import doctest
from pathlib import Path

import pytest

from tests.docs.pages import ROOT, blocks


def test_what_the_page_types_gives_what_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    typed = [block.text for block in blocks("library.md")]
    example = doctest.DocTestParser().get_doctest("\n".join(typed), {}, "library.md", None, 0)
    said: list[str] = []
    results = doctest.DocTestRunner().run(example, out=said.append)
    assert results.failed == 0, "".join(said)
    assert results.attempted > 45
    assert Path("tables").is_dir()
