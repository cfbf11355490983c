"""The commands for tables give the same result without what is Unix only, as on Windows and macOS."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.commands import Typed, typed

ROOT = Path(__file__).parents[2]
CNC10Z = f"{ROOT}/tables/centroid-v3/cnc10z.tab"
MILL_X = f"{ROOT}/tables/readings/mill-x.csv"


def _elsewhere(*words: str) -> Typed:
    command = [sys.executable, "-m", "tests.support.without_unix", *words]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return Typed(found.returncode, found.stdout, found.stderr)


@pytest.mark.parametrize(
    "words",
    [
        ("table", "show", CNC10Z),
        ("table", "evaluate", MILL_X, "--json"),
        ("drives", "show", "oriental-az"),
        ("explain", "unsure"),
    ],
    ids=["show", "evaluate", "drives", "explain"],
)
def test_a_command_shows_the_same(words: tuple[str, ...]) -> None:
    found = _elsewhere(*words)
    assert found == typed(*words)
    assert found.returncode == 0
    assert found.stdout


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("table", "build", MILL_X, "--home", "switch-positive", "--step", "12.5", "--to", "csv"), "x.csv"),
        (("table", "convert", CNC10Z, "--to", "csv"), "z.csv"),
        (("table", "plot", CNC10Z), "z.svg"),
    ],
    ids=["build", "convert", "plot"],
)
def test_a_command_writes_the_same_file(words: tuple[str, ...], name: str, tmp_path: Path) -> None:
    here, elsewhere = tmp_path / f"here-{name}", tmp_path / f"elsewhere-{name}"
    assert typed(*words, str(here)).returncode == 0
    for force in ((), ("--force",)):  # a new file, and one that is replaced
        assert _elsewhere(*words, str(elsewhere), *force).returncode == 0
    assert elsewhere.read_bytes() == here.read_bytes() != b""


@pytest.mark.parametrize("command", ["run", "measure"])
def test_a_command_that_needs_linux_says_so(command: str) -> None:
    found = _elsewhere(command, "gateway.toml", "--json")
    assert (found.returncode, found.stdout) == (1, "")
    assert found.stderr.startswith(f"error: pitch-gateway {command} needs Linux, and this is ")


def test_the_status_of_a_configuration_is_asked_for_by_address() -> None:
    found = _elsewhere("status", "gateway.toml")
    assert (found.returncode, found.stdout) == (1, "")
    assert "give the address of its page, such as http://" in found.stderr


def test_the_help_lists_every_command() -> None:
    found = _elsewhere("--help").stdout
    assert "certificate  Only on Linux." in found
    assert "Show, check and convert correction tables" in found
