"""A command that a remedy names can be typed as it stands, and a key that it names is there."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from gateway.catalogue.lookup import everything
from gateway.cli.app import app
from gateway.config.reference import find_keys
from tests.support.commands import typed

REMEDIES = {entry.remedy for entries in everything().values() for entry in entries}
CODE = re.compile(r"`([^`]*)`")
CODES = sorted({code for remedy in REMEDIES for code in CODE.findall(remedy)})
COMMANDS = [code for code in CODES if code.startswith("pitch-gateway ")]
VALUES = [code for code in CODES if re.fullmatch(r"\w+ = .+", code)]
ROOT: Any = get_command(app)  # typer brings a click of its own


@pytest.mark.parametrize("code", COMMANDS)
def test_a_command_can_be_typed_as_it_stands(code: str) -> None:
    words, command = code.split()[1:], ROOT
    while hasattr(command, "commands"):
        command = command.commands[words.pop(0)]
    command.make_context(command.name, words)  # fails on a missing argument and an unknown option


@pytest.mark.parametrize("written", VALUES)
def test_a_value_that_is_to_be_written_belongs_to_a_key(written: str) -> None:
    [key] = tomllib.loads(written)
    assert list(find_keys(key))


def test_a_command_is_marked_as_one() -> None:
    texts = [CODE.sub("", remedy) for remedy in REMEDIES]
    assert [text for text in texts if "pitch-gateway " in text] == []


def test_a_link_names_its_page_where_there_are_no_links() -> None:
    says = typed("explain", "record-not-used").stdout
    assert "see what a restart knows in docs/operations.md. Most reasons end" in says
    assert "## What a restart knows" in (Path(__file__).parents[2] / "docs/operations.md").read_text()
