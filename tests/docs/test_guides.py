"""The commands that the guides show: each is one, with options that it has."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.main import get_command

from gateway.cli.app import app

DOCS = Path(__file__).parents[2] / "docs"
GUIDES = ("install.md", "measure.md", "metrology.md", "operations.md")
TYPED = r"(?<![\w/.-])pitch-gateway ([a-z][^`\n|;#&>]*)"
ROOT = get_command(app)


def words_of(guide: str) -> Iterator[tuple[str, ...]]:
    """Yield what stands behind the name of the program, in code; other sentences are not typed."""
    text = (DOCS / guide).read_text()
    for code in re.findall(r"```.*?```|`[^`]+`", text, re.DOTALL):
        for typed in re.findall(TYPED, code):
            yield tuple(typed.split())


SHOWN = sorted({(guide, words) for guide in GUIDES for words in words_of(guide)})


def test_the_guides_show_commands() -> None:
    assert {words[0] for _, words in SHOWN} >= {
        "init",
        "check",
        "probe",
        "budget",
        "signtest",
        "status",
        "table",
    }


@pytest.mark.parametrize(
    ("guide", "words"), SHOWN, ids=lambda part: part if isinstance(part, str) else " ".join(part)
)
def test_a_command_of_a_guide_is_one(guide: str, words: tuple[str, ...]) -> None:
    command, rest = ROOT, list(words)
    while rest and rest[0] in (inside := getattr(command, "commands", {})):
        command = inside[rest.pop(0)]
    assert command is not ROOT, f"{guide}: {' '.join(words)}"
    options = {option for parameter in command.params for option in parameter.opts}
    for word in rest:
        assert not word.startswith("--") or word in options, f"{guide}: {' '.join(words)}"
