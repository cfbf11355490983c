"""Every command that documents and help show: it is one, with options that it has, and it runs as it stands.

Lines of code blocks, and the examples of each help, are typed in a folder that has what a reader has by then:
the configuration of README, tables and readings. What needs a machine gets as far as its sentence about that.
"""

import contextlib
import functools
import re
import shlex
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from secrets import token_urlsafe
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple

import pytest
from typer.main import get_command

from gateway.cli.app import app
from tests.support.commands import typed

ROOT: Final = Path(__file__).parents[2]
PAGES: Final = (
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "SECURITY.md",
    *sorted((ROOT / "docs").glob("*.md")),
)
PROGRAM: Final = r"(?<![\w/.-])pitch-gateway ([a-z]+(?![\w.])[^`\n|;#&>]*)"
ROOT_COMMAND: Any = get_command(app)  # typer brings a click of its own


class Example(NamedTuple):
    """A whole line that is typed."""

    where: str
    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.where}: {shlex.join(self.words)}"


def typed_words(line: str) -> tuple[str, ...] | None:
    """Return what stands behind the name of the program, up to what the shell takes for itself.

    None where something is left out of the line.
    """
    lexer = shlex.shlex(line, posix=True, punctuation_chars="();<>|&")
    lexer.whitespace_split = True
    words: list[str] = []
    for word in lexer:
        if word[0] in "();<>|&":
            if word[0] in "<>" and words and words[-1] == "2":
                words.pop()  # of 2> FILE
            break
        words.append(word)
    return None if any("…" in word for word in words) else tuple(words)


def of_pages() -> Iterator[Example]:
    for page in PAGES:
        for code in re.findall(r"^```[a-z]*\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE):
            for line in re.findall(r"^(?:\$ |sudo )?pitch-gateway ([a-z].*)", code, re.MULTILINE):
                if words := typed_words(line):
                    yield Example(page.name, words)


def commands(command: Any, *before: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    if hasattr(command, "commands"):
        for name, each in command.commands.items():
            yield from commands(each, *before, name)
    else:
        yield before, command


def of_help() -> Iterator[Example]:
    for names, command in commands(ROOT_COMMAND):
        _, _, examples = command.help.partition("Examples:")
        whole = re.sub(r"\\\n\s*", "", examples)
        for line in re.findall(r"^\s*(?:sudo )?pitch-gateway (.*)", whole, re.MULTILINE):
            if words := typed_words(line):
                yield Example(f"{' '.join(names)} --help", words)


ELSEWHERE: Final = frozenset({"table convert x.tab y.err --to errtab --axis x"})
"""Of the dialect that docs/add-a-dialect.md adds: its own test runs it."""
EXAMPLES: Final = sorted(
    example for example in {*of_pages(), *of_help()} if shlex.join(example.words) not in ELSEWHERE
)


def command_of(words: tuple[str, ...]) -> tuple[Any, list[str]]:
    command, rest = ROOT_COMMAND, list(words)
    while rest and rest[0] in (inside := getattr(command, "commands", {})):
        command = inside[rest.pop(0)]
    return command, rest


def mentioned() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield what sentences name in code: a command and perhaps options, but not a whole line."""
    for page in PAGES:
        for code in re.findall(r"`[^`\n]+`", page.read_text()):
            for words in re.findall(PROGRAM, code):
                yield page.name, tuple(words.split())


@pytest.mark.parametrize(
    ("page", "words"),
    sorted(set(mentioned())),
    ids=lambda part: part if isinstance(part, str) else " ".join(part),
)
def test_a_command_that_a_sentence_names_is_one(page: str, words: tuple[str, ...]) -> None:
    command, rest = command_of(words)
    assert command is not ROOT_COMMAND, f"{page}: {' '.join(words)}"
    options = {option for parameter in command.params for option in parameter.opts + parameter.secondary_opts}
    for word in rest:
        assert not word.startswith("--") or word in options, f"{page}: {' '.join(words)}"


@pytest.mark.parametrize("example", EXAMPLES, ids=str)
def test_a_line_that_is_shown_can_be_typed(example: Example) -> None:
    command, rest = command_of(example.words)
    assert command is not ROOT_COMMAND
    command.make_context(" ".join(example.words), rest)  # raises what the user would be told


NOT_RUN: Final = {
    "run": "runs until it is told to end",
    "relay": "runs until it is told to end",
    "supervise": "runs until it is told to end",
    "simulate": "runs until it is told to end",
    "record": "runs until it is told to end",
    "listen": "needs a line that somebody speaks on",
    "replay": "needs a recording, which only a gateway makes",
    "demo": "has a test of its own, and takes a minute",
    "init": "asks, and has tests of its own",
    "table edit": "runs until its page is closed",
}
"""First words of lines that are only read, and why."""
OWN_TESTS: Final = frozenset({"add-a-dialect.md", "first-hour.md", "metrology.md"})
"""Pages whose lines are typed in their order, and what they say compared, by tests of their own."""
NO_MACHINE: Final = (
    "no gateway runs",
    "there is no journal",
    "the supervisor has to run",
    "is not there",
    "no address is known for mill-1",
    "give --at, --forward-reading and --backward-reading",
    "cannot ask for confirmation: standard input is not a terminal",
)
"""What is said where all of a line is right, but no gateway, drive or person is there."""
FILES: Final = {
    "my-drive.toml": "gateway/drives/profiles/oriental-az.toml",
    "cnc10z.tab": "tables/centroid-v3/cnc10z.tab",
    "CNC7X.TAB": "tables/centroid-v1/CNC7X.TAB",
    "CNC7Z.TAB": "tables/centroid-v2-tb058/cnc10z.tab",
    "achskw1.lis": "tables/isg/achskw2.lis",
    "x-table.csv": "tables/csv/x.csv",
    "x.csv": "tables/readings/mill-x.csv",
    "z.csv": "tables/readings/tb058-z.csv",
    "before.csv": "tables/readings/mill-x.csv",
    "after.csv": "tables/readings/mill-x-after.csv",
    "laser.rtl": "tables/readings/linear.rtl",
    "readings.rtl": "tables/readings/linear.rtl",
    "run1.rtl": "tables/readings/linear.rtl",
    "run2.rtl": "tables/readings/linear.rtl",
}
"""Files of a reader that lines name, and where this checkout has one of the kind."""
MADE: Final[Mapping[tuple[str, ...], tuple[tuple[str, ...], ...]]] = {
    ("certificate", "server"): (("ca", "machine-ca"),),
    ("certificate", "controller"): (("ca", "machine-ca"),),
    ("certificate", "show"): (
        ("ca", "machine-ca"),
        ("controller", "machine-ca", "cnc", "--role", "Operator"),
    ),
    ("certificate", "revoke"): (
        ("ca", "machine-ca"),
        ("controller", "machine-ca", "cnc", "--role", "Operator"),
    ),
}
"""What a reader has typed before."""
WITH_FILE_START: Final = "tables/centroid-v2-tb058/cnc10z.tab"
"""Where a line tells where the file begins, which only one of version 2 leaves open."""
READINGS: Final = re.findall(
    r"^# axis: x\n.*?(?=```)", (ROOT / "docs/measure.md").read_text(), re.DOTALL | re.MULTILINE
)[0]
WRITTEN: Final = {
    "warm-up.csv": "time_min,measured_um\n0,0\n30,6\n60,12\n90,15\n120,16\n150,16\n",
    "x.readings.csv": READINGS,
    "x-20261121-101500.readings.csv": READINGS,
}
"""Files of a reader that a page shows, or that are short."""


def output_of(words: tuple[str, ...]) -> str:
    """Return the name of the file that a line makes, which is not there before; "" where it makes none."""
    if words[:1] != ("table",) or words[1] not in ("build", "convert", "refine"):
        return ""
    names = [word for word in words[2:] if "." in word and not word.startswith("-")]
    options = next((at for at, word in enumerate(words) if word.startswith("--")), len(words))
    return [name for name in names if words.index(name) < options][-1]


@functools.cache
def built() -> str:
    """Return the table that later lines go on with, as docs/metrology.md has it made."""
    with TemporaryDirectory() as folder:
        table = Path(folder) / "cnc10x.tab"
        options = (
            "--to",
            "centroid-3",
            "--home",
            "switch-positive",
            "--step",
            "12.5",
            "--travel",
            "0",
            "500",
        )
        assert typed("table", "build", str(ROOT / FILES["before.csv"]), str(table), *options).returncode == 0
        return table.read_text()


@pytest.fixture
def desk() -> Iterator[Path]:
    """A folder with what a reader has by then; its path is short, as sockets in it want."""
    with TemporaryDirectory() as folder, contextlib.chdir(folder):
        _furnish(Path(folder))
        yield Path(folder)


def _toml_in(page: str) -> str:
    [text] = re.findall(r"^```toml\n(.*?)^```", (ROOT / page).read_text(), re.DOTALL | re.MULTILINE)
    return str(text)


def _furnish(folder: Path) -> None:
    config, site = map(_toml_in, ("README.md", "docs/fleet.md"))
    (folder / "gateway.toml").write_text(config)
    (folder / "site.toml").write_text(site)
    shutil.copytree(ROOT / "deploy/tables", folder / "common/tables")
    shutil.copytree(ROOT / "tables", folder / "tables")
    shutil.copy(ROOT / "deploy/tables/cnc10x.tab", folder / "tables/cnc10x.tab")
    (folder / "fleet.token").write_text(token_urlsafe(32))
    (folder / "fleet.token").chmod(0o600)
    etc = folder / "etc/pitch-gateway"
    shutil.copytree(folder / "tables", etc / "tables")
    (etc / "gateway.toml").write_text(config)
    (folder / "etc/systemd/system").mkdir(parents=True)


@pytest.mark.parametrize(
    "example", [each for each in EXAMPLES if {"measure", "--from"} <= {*each.words}], ids=str
)
def test_a_line_that_measures_stays_inside_the_travel_of_readme(example: Example) -> None:
    """Only a gateway that runs would refuse it: the axis turns round 1 mm beyond its targets."""
    low, high = (float(example.words[example.words.index(option) + 1]) for option in ("--from", "--to"))
    assert -300.0 <= low - 1.0 < high + 1.0 <= 0.0


@pytest.mark.parametrize(
    "example",
    [
        each
        for each in EXAMPLES
        if NOT_RUN.keys().isdisjoint({each.words[0], " ".join(each.words[:2])})
        and each.where not in OWN_TESTS
    ],
    ids=str,
)
def test_a_line_that_is_shown_runs(example: Example, desk: Path) -> None:
    words = tuple(
        "gateway.toml" if word == "CONFIG" else f"{desk}{word}" if word.startswith("/etc/") else word
        for word in example.words
    )
    output = output_of(words)
    for name in {Path(word).name for word in words} & FILES.keys() - {output}:
        has_start = name == "cnc10z.tab" and "--file-start" in words
        shutil.copy(ROOT / (WITH_FILE_START if has_start else FILES[name]), desk / name)
    for name, text in WRITTEN.items():
        (desk / name).write_text(text)
    if "cnc10x.tab" in words and output != "cnc10x.tab" and words[0] == "table":
        (desk / "cnc10x.tab").write_text(built())
    for before in MADE.get(words[:2], ()):
        assert typed("certificate", *before).returncode == 0
    if words[:2] == ("certificate", "show"):
        shutil.copy(desk / "machine-ca/cnc.pem", desk / "etc/pitch-gateway/server.pem")
    result = typed(*words)
    said = " ".join(re.sub("[│╭╮╰╯─]", " ", result.stdout + result.stderr).split())
    assert result.returncode == 0 or any(sentence in said for sentence in NO_MACHINE), said
