"""The catalogue of events is complete: all that is told of is in it, and nothing is in it for show."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from gateway.catalogue import exchange_events
from gateway.catalogue.entry import NOTHING_TO_DO, EventEntry, Severity, entries_of
from gateway.catalogue.events import EVENTS, GROUPS

PACKAGE = Path(__file__).parents[2] / "gateway"
CONSTANTS = {
    name: value for group in GROUPS for name, value in vars(group).items() if isinstance(value, EventEntry)
}
MAKERS = {"ipc/log.py", "supervisor/supervisor.py"}
"""Who may make a log entry from a name: the one place where events become log entries, and the supervisor,
for what the relay told it."""
TELLERS = {"add", "log", "_log", "log_entry"}


@cache
def sources() -> dict[Path, ast.Module]:
    """The modules that use the catalogue; read when asked, for every run imports this file."""
    return {
        path: ast.parse(path.read_text())
        for path in sorted(PACKAGE.rglob("*.py"))
        if PACKAGE / "catalogue" not in path.parents
    }


def calls(tree: ast.AST) -> Iterator[tuple[str, ast.Call]]:
    """Yield each call with the last part of the name of what is called."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = node.func
            yield called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", ""), node


def used_names(tree: ast.AST) -> Iterator[str]:
    """Yield every name and every attribute that a program reads; imports are no use."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr


def test_every_name_is_there_once() -> None:
    names = [entry.name for group in GROUPS for entry in entries_of(group)]
    assert sorted(names) == sorted(EVENTS)
    assert len(names) == len(CONSTANTS), "two constants of one name in two groups"


def test_every_constant_is_called_as_its_event() -> None:
    assert {name: entry.name.upper().replace("-", "_") for name, entry in CONSTANTS.items()} == {
        name: name for name in CONSTANTS
    }


def test_every_file_of_the_catalogue_is_listed() -> None:
    files = {path.stem for path in (PACKAGE / "catalogue").glob("*_events.py")}
    assert files == {group.__name__.rpartition(".")[2] for group in GROUPS}


def test_a_log_entry_is_made_of_an_entry_everywhere() -> None:
    makers = {
        str(path.relative_to(PACKAGE))
        for path, tree in sources().items()
        for called, _ in calls(tree)
        if called == "LogEntry"
    }
    assert makers == MAKERS


def test_nobody_tells_of_an_event_by_a_text() -> None:
    """mypy refuses it too, but not where an interface says Any."""
    texts = [
        f"{path.relative_to(PACKAGE)}:{call.lineno}: {call.args[0].value!r}"
        for path, tree in sources().items()
        if path.parts[len(PACKAGE.parts)] in {"relay", "supervisor", "ipc"} or path.name == "processes.py"
        for called, call in calls(tree)
        if called in TELLERS and call.args and isinstance(call.args[0], ast.Constant)
    ]
    assert texts == []


def test_every_event_is_told_of_somewhere() -> None:
    used = {name for tree in sources().values() for name in used_names(tree)}
    assert CONSTANTS.keys() - used == set()
    # Other things of the exchange have the same names: its own events are named with their file.
    told = {
        node.attr
        for path, tree in sources().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "exchange_events"
    }
    assert {name for name, value in vars(exchange_events).items() if isinstance(value, EventEntry)} <= told


def test_a_severity_of_one_s_own_is_only_given_where_the_catalogue_leaves_it_open() -> None:
    given = {
        call.args[0].id
        for tree in sources().values()
        for called, call in calls(tree)
        if called in TELLERS
        and len(call.args) == 2
        and isinstance(call.args[0], ast.Name)
        # the detail of a note of a controller, or the fields of note_of, are no severity
        and "severity" in ast.unparse(call.args[1]).lower()
    }
    assert given == {name for name, entry in CONSTANTS.items() if entry.also is not None}


@pytest.mark.parametrize("entry", EVENTS.values(), ids=lambda entry: entry.name)
def test_an_entry_says_everything(entry: EventEntry) -> None:
    for text in (entry.description, entry.cause, entry.remedy):
        assert text
        assert text == text.strip()
        assert not text.endswith(".")
        assert "|" not in text, "it stands in a table"
        assert "  " not in text
    if entry.severity is Severity.ERROR:
        assert entry.remedy != NOTHING_TO_DO
