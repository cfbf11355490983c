"""What the documents name exists."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from gateway.drives.library import names

ROOT = Path(__file__).parents[2]
PACKAGES = {path.name for path in (ROOT / "gateway").iterdir() if (path / "__init__.py").exists()}
NAMES = sorted(
    {
        name
        for name in re.findall(
            r"`([a-z_]+(?:\.[A-Za-z_]+)+)`", (ROOT / "docs" / "architecture.md").read_text()
        )
        if name.split(".")[0] in PACKAGES
    }
)


@pytest.mark.parametrize("name", NAMES)
def test_every_function_that_the_architecture_names_exists(name: str) -> None:
    parts = name.split(".")
    module, rest = import_module("gateway." + parts[0]), parts[1:]
    while rest:
        try:
            module = import_module(f"{module.__name__}.{rest[0]}")
        except ModuleNotFoundError:
            break
        rest = rest[1:]
    found: object = module
    for part in rest:
        found = getattr(found, part)
    assert found is not None


def test_the_architecture_names_the_functions_of_its_routes() -> None:
    assert len(NAMES) >= 11


DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]


def test_the_readme_counts_the_drives_that_have_a_name() -> None:
    (number,) = re.findall(r"\[(\w+) families of drives\]", (ROOT / "README.md").read_text())
    words = {18: "Eighteen", 19: "Nineteen", 20: "Twenty", 21: "Twenty-one", 22: "Twenty-two"}
    assert number == words[len(names())]


def anchors(text: str) -> set[str]:
    """Return what links may point to: each heading as web pages make an anchor of it."""
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_and_test_files_that_a_document_names_exist(document: Path) -> None:
    text = document.read_text()
    for target in re.findall(r"\]\((?!https?://|#)([^)#]+)", text):
        assert (document.parent / target).exists(), target
    for target, anchor in re.findall(r"\]\((?!https?://)([^)#]*)#([^)]+)\)", text):
        there = (document.parent / target) if target else document
        assert anchor in anchors(there.read_text()), f"{target}#{anchor}"
    tests = {path.name for path in (ROOT / "tests").glob("**/*.py")}
    for name in re.findall(r"(test_[a-z_]+\.py)", text):
        assert name in tests, name
