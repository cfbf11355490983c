"""What a test needs beside Python and this checkout, and which tests are quick because they need nothing.

The rule: a test is ``quick`` where a word of ``NEEDS`` stands neither in its file, nor in a ``conftest.py``
above it, nor in a file below ``tests``, ``bench`` or ``tools`` that these import, directly or not. A file is
quick as a whole or not at all: what needs nothing stands in a file of its own, apart from what needs more.

pytest marks them (``pytest -m quick``), nobody does by hand; and it holds them to it in every run: a quick
test that starts a program nevertheless, through whatever code, fails with a sentence that says so.
"""

import functools
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

ROOT: Final = Path(__file__).parents[1]
PROGRAM: Final = "another program"
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
}
"""Words of a file, and what each of them says that its tests need.

A broker, systemd, OpenSSL, all that is installed and another Python are programs.
"""
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
WORDS: Final = re.compile(rf"\b(?:{'|'.join(NEEDS)})\b")


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
    seen = {Path(__file__)}
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
    """Whether a quick test is running, and what it started."""

    def __init__(self) -> None:
        self.is_quick = False
        self.started = ""
        sys.addaudithook(self._heard)

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.is_quick and event in STARTS and not DISPENSABLE.intersection(map(str, arguments[:1])):
            started = (
                f"a quick test started a program ({event} {arguments[:2]}): it needs {PROGRAM}; "
                f"move it to a file that imports what starts it, or name that in NEEDS of tests/needs.py"
            )
            self.started = started
            raise pytest.fail.Exception(started, pytrace=False)

    def over(self, item: pytest.Item) -> Iterator[None]:
        """Watch while a test is set up, run or taken down."""
        self.is_quick = item.get_closest_marker("quick") is not None
        self.started = ""
        try:
            return (yield)
        finally:
            self.is_quick = False
            if self.started:  # also where the code under test caught it, or a thread died of it
                pytest.fail(self.started, pytrace=False)


_watch = _Watch()


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "quick: needs nothing but Python and this checkout (tests/needs.py)")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Where quick tests alone are asked for, load no other file."""
    is_file = config.option.markexpr == "quick" and collection_path.suffix == ".py"
    return True if is_file and needs_of(collection_path) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if not needs_of(item.path):
            item.add_marker("quick")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    return (yield from _watch.over(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    return (yield from _watch.over(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Iterator[None]:
    return (yield from _watch.over(item))
