"""The help of every command: it runs, and it shows examples."""

import subprocess
import sys

import pytest
from typer.testing import CliRunner

from gateway.cli.main import app
from gateway.cli.table import app as table

COMMANDS = (
    ("demo",),
    ("run",),
    ("check",),
    ("simulate",),
    ("table", "show"),
    ("table", "explain"),
    ("table", "lint"),
    ("table", "convert"),
)


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_the_help_of_a_command_shows_examples_of_it(command: tuple[str, ...]) -> None:
    result = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "120"})
    assert result.exit_code == 0
    _, examples = result.stdout.split("Examples:")
    assert f"pitch-gateway {' '.join(command)}" in examples


def test_no_command_is_missing_here() -> None:
    top = [command.name for command in app.registered_commands]
    in_table = [
        command.name or command.callback.__name__ for command in table.registered_commands if command.callback
    ]
    assert sorted([*((name,) for name in top), *(("table", name) for name in in_table)]) == sorted(COMMANDS)


@pytest.mark.parametrize("arguments", [[], ["table"]])
def test_without_arguments_the_help_is_shown_as_wrong_usage(arguments: list[str]) -> None:
    process = subprocess.run(
        [sys.executable, "-c", "from gateway.cli.main import main; main()", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert process.returncode == 2
    assert "Commands" in process.stdout + process.stderr
