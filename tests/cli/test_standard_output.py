"""Standard output that cannot be written to, as a shell makes it."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
COMMAND = f"{shlex.quote(sys.executable)} -c 'from gateway.cli.main import main; main()'"
COMMANDS = (
    "table show tables/centroid-v3/cnc10z.tab",
    "table explain tables/centroid-v3/cnc10z.tab --at -1 --json",
    "check {folder}/gateway.example.toml",
    "--version",
    "--help",
    "table convert --help",
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The examples, where a path is short enough for the sockets that belong to them."""
    return shutil.copytree(ROOT / "deploy", tmp_path / "deploy")


def shell(line: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", line],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        cwd=ROOT,
    )


@pytest.mark.parametrize("arguments", COMMANDS)
@pytest.mark.parametrize(
    ("redirection", "reason"), [(">/dev/full", "No space left on device"), (">&-", "Bad file descriptor")]
)
def test_output_that_cannot_be_written_is_one_line_and_code_1(
    arguments: str, redirection: str, reason: str, folder: Path
) -> None:
    result = shell(f"{COMMAND} {arguments.format(folder=folder)} {redirection}")
    assert result.returncode == 1
    warnings, last = result.stderr.splitlines()[:-1], result.stderr.splitlines()[-1]
    assert last == f"standard output cannot be written to: {reason}"
    assert all(line.startswith("warning: ") for line in warnings)


@pytest.mark.parametrize("arguments", COMMANDS)
def test_a_pipe_that_was_closed_ends_without_words(arguments: str, folder: Path) -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    result = subprocess.run(
        ["bash", "-c", f"{COMMAND} {arguments.format(folder=folder)}"],
        stdout=write_end,
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
        check=False,
        cwd=ROOT,
    )
    os.close(write_end)
    assert result.returncode == 1
    assert [line for line in result.stderr.splitlines() if not line.startswith("warning: ")] == []


def test_the_first_line_is_all_that_head_lets_through() -> None:
    result = shell(f"{COMMAND} table show tables/centroid-v3/cnc10z.tab | head -1")
    assert result.stdout == "file            tables/centroid-v3/cnc10z.tab\n"
    assert result.stderr == ""


def test_a_command_that_says_nothing_on_standard_output_needs_none() -> None:
    result = shell(f"{COMMAND} check nowhere.toml >&-")
    assert result.returncode == 1
    assert result.stderr == "nowhere.toml: no such file; give the path of a configuration file\n"


def test_wrong_usage_stays_wrong_usage_without_standard_streams() -> None:
    assert shell(f"{COMMAND} check >&- 2>&- <&-").returncode == 2
