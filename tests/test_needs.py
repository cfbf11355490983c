"""What is quick is found by itself, and held to it: ``tests/needs.py``."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.needs import needs_of

ROOT = Path(__file__).parents[1]
FAILED = "a test for anywhere started a program ("
SWALLOWED = """
import contextlib, os

def test_that_swallows_everything():
    with contextlib.suppress(BaseException):
        os.system("true")
"""
OF_A_FIXTURE = """
import os, pytest

@pytest.fixture(scope="module")
def program():
    os.system("true")

def test_with_a_fixture(program):
    pass
"""
OF_A_THREAD = """
import os, threading

def test_with_a_thread():
    thread = threading.Thread(target=os.system, args=("true",))
    thread.start()
    thread.join()
"""
OUT_OF_SIGHT = """
from gateway.cli.processes import _started

def test_of_what_starts_a_program():
    _started(["true"])
"""
DECLARED = """
import subprocess

def test_that_says_so():
    subprocess.run(["true"], check=True)
"""
DRAWN = """
from hypothesis import given, strategies

@given(strategies.integers())
def test_of_any_number(number):
    pass
"""


def pytest_said(*arguments: str | Path) -> "subprocess.CompletedProcess[str]":
    """What pytest says of some files, or of the whole project."""
    environment = {name: text for name, text in os.environ.items() if not name.startswith("PYTEST")}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--quiet", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, env=environment)


@pytest.mark.parametrize("text", [SWALLOWED, OF_A_FIXTURE, OF_A_THREAD, OUT_OF_SIGHT])
def test_one_that_needs_nothing_and_starts_a_program_fails(tmp_path: Path, text: str) -> None:
    (tmp_path / "test_it.py").write_text(text)
    done = pytest_said("-p", "tests.needs", "--rootdir", tmp_path, tmp_path / "test_it.py", "-m", "quick")
    assert done.returncode == 1, done.stdout
    assert FAILED in done.stdout
    assert "it needs another program; move it to a file" in done.stdout


def test_who_says_what_it_starts_is_not_for_anywhere_and_may(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(DECLARED)
    words = ("-p", "tests.needs", "--rootdir", tmp_path, tmp_path / "test_it.py")
    assert "1 deselected" in pytest_said(*words, "-m", "anywhere").stdout
    assert "1 passed" in pytest_said(*words).stdout


def test_who_draws_its_cases_at_random_is_for_anywhere_and_not_quick(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(DRAWN)
    words = ("-p", "tests.needs", "--rootdir", tmp_path, tmp_path / "test_it.py")
    assert "1 passed" in pytest_said(*words, "-m", "anywhere").stdout
    assert "1 deselected" in pytest_said(*words, "-m", "quick").stdout


@pytest.mark.parametrize(
    ("file", "needs"),
    [
        ("modbus/test_rtu_requests.py", set()),
        ("relay/test_kill_and_restart.py", {"another program", "time"}),  # imports subprocess itself
        ("attacks/test_legitimate.py", {"another program"}),  # imports a file that does
        ("package/test_udev_rules.py", {"another program"}),
        ("report/test_in_a_browser.py", {"a browser", "time"}),
        ("supervisor/mqtt/test_mqtt_discovery.py", {"another program"}),  # a broker
        ("config/test_config_state.py", {"root"}),
        ("modbus/test_rtu_properties.py", {"time"}),  # imports hypothesis
        ("relay/test_connections.py", {"time"}),  # imports a file that runs a relay
    ],
)
def test_what_a_file_needs_is_what_it_and_its_imports_name(file: str, needs: set[str]) -> None:
    assert needs_of(ROOT / "tests" / file) == needs


def test_an_import_over_several_lines_is_followed(tmp_path: Path) -> None:
    file = tmp_path / "test_it.py"
    file.write_text("from tests.support import (\n    ports,\n    processes,  # it starts things\n)\n")
    assert needs_of(file) == {"another program"}
    other = tmp_path / "test_other.py"
    other.write_text("from tests.support.ports import free_port\nimport tests.support.processes\n")
    assert needs_of(other) == {"another program"}


@pytest.mark.parametrize(("mark", "number"), [("quick", 7500), ("anywhere", 14_000)])
def test_at_least_so_many_tests_need_so_little(
    request: pytest.FixtureRequest, mark: str, number: int
) -> None:
    items = request.session.items
    if len({item.path for item in items}) < len(list((ROOT / "tests").rglob("test_*.py"))):
        pytest.skip("only some of the files were asked for: of all of them is counted")
    assert sum(item.get_closest_marker(mark) is not None for item in items) >= number
