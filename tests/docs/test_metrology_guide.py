"""The page on metrology: its commands run, and give the numbers that it shows."""

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gateway.cli.app import app
from tests.metrology.iso230_results import PRINTED, RIGHT

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "metrology.md").read_text()
EVIDENCE = (ROOT / "docs" / "metrology-evidence.md").read_text()
COMMANDS = [
    shlex.split(line)[1:]
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    for line in block.splitlines()
]


def test_every_command_of_the_page_runs_in_its_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tables").symlink_to(ROOT / "tables")
    monkeypatch.chdir(tmp_path)
    assert len(COMMANDS) >= 11
    said = {}
    for command in COMMANDS:
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 0, (command, result.output)
        said[" ".join(command)] = result.stdout
    values = re.findall(r"^\s*(-?\d+\.\d{4})$", (tmp_path / "cnc10z.tab").read_text(), re.MULTILINE)
    shown = re.findall(r"^ {4}((?:-?\d+\.\d{4} )+) *(?:for|back)ward", PAGE, re.MULTILINE)
    assert values == " ".join(shown).split()
    assert (tmp_path / "CNC7X.TAB").read_text().split()[2:] == ["20", "12", "4", "-4", "-12", "-16", "-3"]
    compared = next(text for command, text in said.items() if "--after" in command)
    for before, after in re.findall(r"^\| [AREMB] \|.*\| (0\.\d{5}) \| (0\.\d{5}) \|$", PAGE, re.MULTILINE):
        assert before in compared
        assert after in compared


def test_the_table_of_reports_is_what_was_recomputed() -> None:
    lines = [line for line in EVIDENCE.splitlines() if "(20" in line and line[0] == "|"]
    rows = [line.strip("| ").split(" | ") for line in lines]
    assert [row[0] for row in rows] == list(RIGHT)
    for name, *cells in rows:
        for key, cell in zip("BREMA", cells, strict=True):
            right, printed = re.fullmatch(r"([\d.]+) \((.*)\)", cell).groups()  # type: ignore[union-attr]
            digits = len(right.partition(".")[2])
            assert float(right) == pytest.approx(RIGHT[name][key], abs=0.51 * 10**-digits)
            if name in PRINTED:
                assert float(printed) == pytest.approx(PRINTED[name][key], abs=0.51 * 10**-digits)
            else:
                assert printed == "not at hand"


def test_the_example_of_the_page_leaves_little_of_the_error() -> None:
    before, after = re.search(r"^\| A \|.*\| (\S+) \| (\S+) \|$", PAGE, re.MULTILINE).groups()  # type: ignore[union-attr]
    assert float(after) <= 0.15 * float(before)
