"""What a test needs beside Python and this checkout, and which tests are quick because they need nothing.

The rule: a test needs what the words of ``NEEDS`` say that stand in its file, in a ``conftest.py`` above it,
or in a file below ``tests``, ``bench`` or ``tools`` that these import, directly or not. All tests of a file
need the same: what needs less stands in a file of its own.

A test is ``quick`` where it needs nothing, and runs ``anywhere`` where it needs nothing but time. pytest
marks them (``pytest -m quick``), nobody does by hand; and it holds them to it in every run: a test for
anywhere that starts a program nevertheless, through whatever code, fails with a sentence that says so.
"""

import functools
import re
import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any, Final

import pytest

ROOT: Final = Path(__file__).parents[1]
PROGRAM: Final = "another program"
TIME: Final = "time"
NEEDS: Final = {
    "subprocess": PROGRAM,
    "multiprocessing": PROGRAM,
    "ProcessPoolExecutor": PROGRAM,
    "create_subprocess_exec": PROGRAM,
    "create_subprocess_shell": PROGRAM,
    "fork": PROGRAM,
    "forkpty": PROGRAM,
    "playwright": "a browser",
    "chown": "root",
    "setuid": "root",
    "seteuid": "root",
    "setresuid": "root",
    "hypothesis": TIME,  # hundreds of cases, drawn at random
    "tests.soak": TIME,  # repeated
    "tests.verify": TIME,  # walks
    "tests.ledger": TIME,
    "gateway.relay": TIME,  # a whole relay, whose clock no test moves
    "CliRunner": TIME,  # whole commands, each of which reads all options anew
    "gateway.report": TIME,  # pages, with their pictures
    "matplotlib": TIME,
}
"""Words of a file, and what each of them says that its tests need.

A broker, systemd, OpenSSL, all that is installed and another Python are programs.
"""
MARKS: Final = {"quick": frozenset[str](), "anywhere": frozenset({TIME})}
"""Marks of tests, and what those that have it may need."""
FOLLOWED: Final = ("tests", "bench", "tools")
"""Whose imports count. What the gateway could start is not what a test of it starts."""
STARTS: Final = frozenset(
    {
        "subprocess.Popen",
        "os.exec",
        "os.fork",
        "os.forkpty",
        "os.posix_spawn",
        "os.system",
        "pty.spawn",
    }
)
"""Python's audit events of starting a program, https://docs.python.org/3/library/audit_events.html."""
DISPENSABLE: Final = frozenset({"fc-list"})
"""Whom a library asks, and does without where it is not there: matplotlib, for more fonts than its own."""


MODULE: Final = rf"(?:{'|'.join(FOLLOWED)})(?:\.\w+)*"
IMPORTS: Final = re.compile(rf"^\s*(?:from|import)\s+({MODULE})(?:\s+import\s+(\([^)]*\)|.*))?", re.MULTILINE)
WORDS: Final = re.compile(rf"\b(?:{'|'.join(map(re.escape, NEEDS))})\b")


@functools.cache
def _read(file: Path) -> tuple[frozenset[str], frozenset[Path]]:
    """Return the words of ``NEEDS`` in a file, and the files that it imports."""
    text = file.read_text(encoding="utf-8")
    folders = [(ROOT / module.replace(".", "/"), names) for module, names in IMPORTS.findall(text)]
    modules = {folder.with_suffix(".py") for folder, _ in folders}
    inside = {folder / f"{name}.py" for folder, names in folders for name in re.findall(r"\w+", names)}
    return frozenset(WORDS.findall(text)), frozenset(path for path in modules | inside if path.exists())


@functools.cache
def needs_of(file: Path) -> frozenset[str]:
    """Return what the tests of a file need: values of ``NEEDS``; none where they are quick."""
    found: set[str] = set()
    seen = {Path(__file__), ROOT / "tests" / "conftest.py"}  # what all of them load makes no difference
    ahead = [file, *(path for folder in file.parents if (path := folder / "conftest.py").exists())]
    while ahead:
        path = ahead.pop()
        if path not in seen:
            seen.add(path)
            words, imported = _read(path)
            found.update(NEEDS[word] for word in words)
            ahead.extend(imported)
    return frozenset(found)


class _Watch:
    """Whether a test for anywhere is running, and what it started."""

    def __init__(self) -> None:
        self.is_for_anywhere = False
        self.started = ""
        sys.addaudithook(self._heard)

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.is_for_anywhere and event in STARTS and not DISPENSABLE.intersection(map(str, arguments[:1])):
            started = (
                f"a test for anywhere started a program ({event} {arguments[:2]}): it needs {PROGRAM}; "
                f"move it to a file that imports what starts it, or name that in NEEDS of tests/needs.py"
            )
            self.started = started
            raise pytest.fail.Exception(started, pytrace=False)

    def over(self, item: pytest.Item) -> Iterator[None]:
        """Watch while a test is set up, run or taken down."""
        self.is_for_anywhere = item.get_closest_marker("anywhere") is not None
        self.started = ""
        try:
            return (yield)
        finally:
            self.is_for_anywhere = False
            if self.started:  # also where the code under test caught it, or a thread died of it
                pytest.fail(self.started, pytrace=False)


_watch = _Watch()


def pytest_configure(config: pytest.Config) -> None:
    for mark, needed in MARKS.items():
        more = "".join(f", and {need}" for need in needed)
        config.addinivalue_line(
            "markers", f"{mark}: needs nothing but Python and this checkout{more} (tests/needs.py)"
        )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Where the tests of one mark alone are asked for, load no other file."""
    allowed = MARKS.get(config.option.markexpr)
    is_other = allowed is not None and collection_path.suffix == ".py" and needs_of(collection_path) - allowed
    return True if is_other else None


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(
    file_path: Path,
) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Mark the files, not each of their thousands of tests: these have the marks of their file."""
    collectors = yield
    for collector in collectors:
        for mark, needed in MARKS.items():
            if needs_of(file_path) <= needed:
                collector.add_marker(mark)
    return collectors


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    return (yield from _watch.over(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    return (yield from _watch.over(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Iterator[None]:
    return (yield from _watch.over(item))
