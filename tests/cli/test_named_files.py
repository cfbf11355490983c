"""Every command that reads a file that a person names: missing, unreadable, no regular file, too large."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.lesser import LATE, ROOT, SECONDS, Lesser, lesser
from tests.support.processes import typed_apart

COMMANDS = (
    "check {}",
    "run {}",
    "relay {}",
    "supervise {}",
    "reload {}",
    "simulate {}",
    "record {} never.jsonl",
    "replay {}",
    "probe {}",
    "signtest {} --axis x",
    "enable {}",
    "disable {}",
    "reference {} x --yes",
    "evidence {} --out never",
    "table show {}",
    "table explain {} --at 0",
    "table lint {}",
    "table convert {} out.tab --to centroid-2",
    "table build {} out.tab",
    "table refine {} never.csv out.tab",
    "table evaluate {}",
)


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder that anybody may enter."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name)
        path.chmod(0o777)
        yield path


@pytest.fixture(scope="module")
def somebody() -> Iterator[Lesser]:
    with lesser() as somebody:
        yield somebody


def refused(somebody: Lesser, command: str, path: Path | str) -> str:
    """Run a command as somebody whom the kernel refuses things; return its one line on stderr."""
    ended = somebody.run(command, path)
    assert ended.returncode == 1, ended.stderr
    assert ended.stdout == ""
    assert ended.stderr.count("\n") == 1
    assert str(path) in ended.stderr
    return ended.stderr


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_that_is_not_there_is_bad_input(somebody: Lesser, command: str, folder: Path) -> None:
    assert "no such file; give the path of" in refused(somebody, command, folder / "none")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_without_permission_is_bad_input(somebody: Lesser, command: str, folder: Path) -> None:
    path = folder / "secret"
    path.write_text("")
    path.chmod(0)
    assert "may not be read; give this user read permission" in refused(somebody, command, path)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_fifo_is_not_waited_for(somebody: Lesser, command: str, folder: Path) -> None:
    path = folder / "fifo"
    os.mkfifo(path, 0o666)
    assert "a FIFO, not a regular file; give the path of" in refused(somebody, command, path)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_device_is_not_read(somebody: Lesser, command: str) -> None:
    assert "a device, not a regular file; give the path of" in refused(somebody, command, "/dev/zero")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_of_gigabytes_is_refused_with_the_limit(somebody: Lesser, command: str, folder: Path) -> None:
    path = folder / "huge"
    path.write_bytes(b"")
    os.truncate(path, 8 * 1024**3)  # a hole: it takes no room
    limits = {"table": 16 * 1024**2, "replay": 64_000_000}
    limit = limits.get(command.split(maxsplit=1)[0], 4_000_000)
    assert f"more than {limit} bytes" in refused(somebody, command, path)


@pytest.mark.parametrize("kind", ["fifo", "device", "large"])
def test_a_table_that_a_configuration_names_is_no_other_kind_of_file(kind: str, folder: Path) -> None:
    config = folder / "gateway.toml"
    shutil.copy(ROOT / "deploy" / "gateway.example.toml", config)
    table = folder / "tables" / "cnc10x.tab"
    table.parent.mkdir()
    if kind == "fifo":
        os.mkfifo(table)
        said = "a FIFO, not a regular file"
    elif kind == "device":
        table.symlink_to("/dev/zero")
        said = "a device, not a regular file"
    else:
        table.write_bytes(b"")
        os.truncate(table, 8 * 1024**3)
        said = f"more than {16 * 1024**2} bytes"
    process = typed_apart("check", str(config), seconds=SECONDS)
    assert process.returncode == 1
    assert said in process.stderr
    assert str(table) in process.stderr


@pytest.mark.parametrize(
    ("late", "event"),
    [("import wave", "import of wave"), ("open(json.__file__)", f"open of {json.__file__}")],
)
def test_what_another_user_may_not_be_able_to_read_ends_a_command(late: str, event: str) -> None:
    code = f"import json; from tests.support.lesser import become_lesser; become_lesser(); {late}"
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=SECONDS, check=False, cwd=ROOT
    )
    assert process.returncode == LATE
    assert process.stderr == (f"{event} by a user who may not be able to enter its folder: do it before\n")
