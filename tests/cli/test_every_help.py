"""The help of every command: it runs, and it shows examples."""

import itertools
import re
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from gateway.cli.app import app
from tests.support.processes import typed_apart

APP: Any = typer.main.get_command(app)  # typer brings a click of its own


def _commands(command: Any, *before: str) -> Iterator[tuple[str, ...]]:
    """Yield every command that does something, by the words that a person types."""
    if hasattr(command, "commands"):
        for name, each in command.commands.items():
            yield from _commands(each, *before, name)
    else:
        yield before


COMMANDS = tuple(_commands(APP))


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_the_help_of_a_command_shows_examples_of_it(command: tuple[str, ...]) -> None:
    result = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "120"})
    assert result.exit_code == 0
    _, examples = result.stdout.split("Examples:")
    assert f"pitch-gateway {' '.join(command)}" in examples


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_an_example_that_takes_several_lines_can_be_pasted(command: tuple[str, ...]) -> None:
    found = APP
    for name in command:
        found = found.commands[name]
    _, _, examples = found.help.partition("Examples:")
    lines = [line.strip() for line in examples.splitlines() if line.strip()]
    for before, line in itertools.pairwise(lines):
        assert line.startswith(("pitch-gateway ", "sudo pitch-gateway ")) or before.endswith(" \\"), line


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_nothing_of_a_help_is_lost_on_its_way_to_the_terminal(command: tuple[str, ...]) -> None:
    """A word in brackets would be taken for a style, and nothing shown of it."""
    found = APP
    for name in command:
        found = found.commands[name]
    result = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "250"})
    said, _, _ = (found.help or "").partition("Examples:")
    assert said.split()
    assert " ".join(said.split()) in " ".join(result.stdout.split())
    assert "``" not in said
    shown = "".join(re.sub(r"[│╭╮╰╯─]", " ", result.stdout).split())
    for parameter in found.params:
        if parameter.hidden:
            continue
        assert "".join((getattr(parameter, "help", None) or "").split()) in shown


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_the_lines_of_a_help_end_where_the_terminal_does(command: tuple[str, ...]) -> None:
    result = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "80"})
    said, _, _ = result.stdout.partition("Examples:")
    lines = [line.strip() for line in said.splitlines()]
    for line, following in itertools.pairwise(lines):
        if line and following and not following.startswith("-"):
            assert len(f"{line} {following.split()[0]}") > 78, f"{line}\n{following}"


def test_the_commands_are_found() -> None:
    assert {
        *((name,) for name in ("demo", "run", "check", "budget", "init", "simulate", "probe", "signtest")),
        *((name,) for name in ("enable", "disable", "reference", "record", "replay")),
        *((name,) for name in ("relay", "supervise", "reload", "explain")),
        *(
            ("table", name)
            for name in (
                "show",
                "explain",
                "lint",
                "convert",
                "formats",
                "plot",
                "build",
                "refine",
                "evaluate",
                "program",
            )
        ),
        ("drives", "show"),
        *(("certificate", name) for name in ("ca", "server", "controller", "revoke", "show")),
    } <= set(COMMANDS)


@pytest.mark.parametrize("arguments", [[], ["table"]])
def test_without_arguments_the_help_is_shown_as_wrong_usage(arguments: list[str]) -> None:
    process = typed_apart(*arguments, seconds=60.0)
    assert process.returncode == 2
    assert "Commands" in process.stdout + process.stderr


@pytest.mark.parametrize(("group", "one"), [("journal", "verify"), ("table", "lint"), ("drives", "show")])
def test_a_file_in_place_of_a_subcommand_is_answered_with_their_names(group: str, one: str) -> None:
    result = CliRunner().invoke(app, [group, "gateway.toml"], env={"COLUMNS": "200"})
    assert result.exit_code == 2
    names = re.search(r"No such command 'gateway.toml'. Its commands: ([a-z, ]+)\.", result.stderr)
    assert names is not None
    assert one in names[1].split(", ")


def test_a_command_waits_for_nothing_that_only_others_need() -> None:
    program = (
        "import sys\n"
        "from gateway.cli.main import main\n"
        "try:\n    main()\n"
        "except SystemExit:\n    print(*(name for name in sys.modules if name.startswith('gateway.')))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, "token", "--help"], capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.splitlines()[-1].split())
    assert "gateway.cli.token" in loaded
    assert not loaded & {"gateway.tabfile", "gateway.config.load", "gateway.cli.table", "gateway.exchange"}
