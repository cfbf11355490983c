"""The page on adding a dialect: its pieces, put into a copy of the package, are one."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import ROOT, assert_promised, blocks

PAGE = blocks("add-a-dialect.md")
PLACES = (
    "gateway/tabfile/dialects.py",
    "gateway/tabfile/dialects.py",
    "tests/tabfile/meanings.py",
    "tests/tabfile/samples.py",
    "tests/tabfile/test_every_pair.py",
)
"""Where the changes of the page belong, in their order; the text above each names its file."""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of what the page is about, with its dialect in it."""
    folder = tmp_path_factory.mktemp("copy")
    ignored = shutil.ignore_patterns("__pycache__", "*.so")
    for name in ("gateway", "tables", "tests/support", "tests/tabfile"):
        shutil.copytree(ROOT / name, folder / name, ignore=ignored)
    for path in (ROOT / "pyproject.toml", *(ROOT / "tests").glob("*.py")):
        shutil.copy(path, folder / path.relative_to(ROOT))
    for block in PAGE:
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")
    changes = [block.text for block in PAGE if block.language == "diff"]
    for place, change in zip(PLACES, changes, strict=True):
        apply(folder / place, change)
    return folder


def apply(path: Path, change: str) -> None:
    """Make a change of the page: lines that begin with + are new, the others stand there, once."""
    lines = change.splitlines(keepends=True)
    before = "".join(line[1:] for line in lines if not line.startswith("+"))
    text = path.read_text(encoding="utf-8")
    assert text.count(before) == 1, f"{path}: {before}"
    path.write_text(text.replace(before, "".join(line[1:] for line in lines)), encoding="utf-8")


def run(copy: Path, *command: str) -> "subprocess.CompletedProcess[str]":
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(copy)}
    return subprocess.run(
        command, cwd=copy, env=environment, capture_output=True, text=True, timeout=110, check=False
    )


def test_the_text_above_each_change_names_its_file() -> None:
    page = (ROOT / "docs" / "add-a-dialect.md").read_text(encoding="utf-8")
    at = 0
    for place in PLACES[1:]:
        at = page.index(f"`{Path(place).name}`" if place.startswith("tests") else f"`{place}`", at)


def test_the_commands_of_the_page_say_what_it_shows(copy: Path) -> None:
    commands = [each for block in PAGE if block.language == "console" for each in block.commands()]
    assert len(commands) == 4
    for command, promised in commands:
        done = run(copy, "bash", "-c", command)
        assert (done.returncode, done.stderr) == (0, "")
        assert_promised(promised, done.stdout)


def test_its_code_is_written_as_that_of_the_project(copy: Path) -> None:
    for command in (("format", "--check"), ("check",)):
        done = run(copy, "ruff", *command, "--no-cache", "gateway/tabfile", "tests/tabfile")
        assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("text", "refused"),
    [
        ("ERRTAB X\n0 0\n50 4\n", "x.err:1: 'ERRTAB X'; allowed: ERRTAB, the axis and the number of points"),
        ("ERRTAB X 3\n0 0\n50 4\n", "x.err:3: 2 points; allowed: 3, as line 1 says, and at least 2"),
        ("ERRTAB X 2\n50 0\n0 4\n", "x.err:3: position 0 behind 50; allowed: ascending positions"),
        (
            "ERRTAB X 2\n0 0\n50 4,5\n",
            "x.err:3: '50 4,5'; allowed: position and error, each a decimal number",
        ),
    ],
)
def test_its_reader_names_what_is_wrong(copy: Path, tmp_path: Path, text: str, refused: str) -> None:
    (tmp_path / "x.err").write_text(text, encoding="utf-8")
    done = run(copy, "bash", "-c", f"cd {tmp_path} && pitch-gateway table show x.err")
    assert done.returncode == 1
    assert refused in done.stderr


def test_the_tests_of_every_dialect_hold_with_it(copy: Path) -> None:
    told = ("-p", "no:cacheprovider", "-p", "no:xdist", "--override-ini", "testpaths=tests", "-q")
    chosen = "errtab or has_a_sample or has_a_row or is_listed"
    done = run(copy, sys.executable, "-m", "pytest", *told, "-k", chosen, "tests/tabfile")
    assert done.returncode == 0, done.stdout[-3000:]
    passed = re.search(r"(\d+) passed, \d+ deselected", done.stdout)
    assert passed is not None
    assert int(passed[1]) > 30
