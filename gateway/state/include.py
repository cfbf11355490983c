"""``include``: which files a configuration is read from, and how they become one (decision 58)."""

import os
from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final

INCLUDE: Final = "include"
_PATTERN: Final = frozenset("*?[")
_A_LIST: Final = 'allowed: a list of file names, as in include = ["conf.d/*.toml"]'


class IncludeError(Exception):
    """A list that cannot be followed: its element (None: the whole list), what was found, and the remedy."""

    def __init__(self, index: int | None, found: str, remedy: str) -> None:
        where = INCLUDE if index is None else f"{INCLUDE}[{index + 1}]"
        super().__init__(f"{where}: {found}; {remedy}")
        self.index = index
        self.found = found
        self.remedy = remedy


def included_files(config: Path, tables: Mapping[str, Any]) -> list[list[Path]]:
    """Return the files of each element of ``include``, in their order; a pattern may match none.

    ``tables`` is the content of ``config``. Names are relative to its folder. The files of a pattern are
    sorted by name, without those that begin with a dot.

    Raises:
        IncludeError: the list is no list of names, a folder cannot be read, or a file would be read twice.
    """
    names = tables.get(INCLUDE, [])
    if not isinstance(names, list):
        raise IncludeError(None, "found no list", _A_LIST)
    seen: dict[str, int | None] = {os.path.realpath(config): None}
    found = []
    for index, name in enumerate(names):
        if not isinstance(name, str) or not name or "\0" in name:
            raise IncludeError(index, "found no file name", _A_LIST)
        paths = _files_of(index, config.parent / name)
        for path in paths:
            if (whole := os.path.realpath(path)) in seen:  # unlike Path.resolve() it bears a loop of links
                raise _twice(index, path, seen[whole])
            seen[whole] = index
        found.append(paths)
    return found


def _twice(index: int, path: Path, first: int | None) -> IncludeError:
    if first is None:
        remedy = "give the included files a folder of their own, as conf.d/*.toml"
        return IncludeError(index, f"{path} would include itself", remedy)
    return IncludeError(index, f"{path} is also in include[{first + 1}]", "include each file once")


def _files_of(index: int, path: Path) -> list[Path]:
    if not _PATTERN.intersection(path.name):
        return [path]
    try:
        names = os.listdir(path.parent)  # noqa: PTH208 - names will do
    except OSError as error:
        remedy = "name a folder that can be read; * ? [ ] stand for files, not for folders"
        raise IncludeError(index, f"{path.parent}: {error.strerror or error}", remedy) from None
    return [path.parent / name for name in sorted(names) if _is_meant(name, path.name)]


def _is_meant(name: str, pattern: str) -> bool:
    return not name.startswith(".") and fnmatchcase(name, pattern)


def merged(files: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the content of files as one: tables merge key by key; any other value of a later file replaces.

    >>> merged([{"axis": {"x": {"gain": 1, "travel": [0, 1]}}}, {"axis": {"x": {"travel": [5]}}}])
    {'axis': {'x': {'gain': 1, 'travel': [5]}}}
    """
    result: dict[str, Any] = {}
    for tables in files:
        waiting: list[tuple[dict[str, Any], Mapping[str, Any]]] = [(result, tables)]
        while waiting:  # not a function that calls itself: a file may nest deeper than the stack
            into, more = waiting.pop()
            for key, value in more.items():
                if not isinstance(value, dict):
                    into[key] = value
                    continue
                if not isinstance(into.get(key), dict):
                    into[key] = {}
                waiting.append((into[key], value))
    result.pop(INCLUDE, None)
    return result


def sets(tables: Mapping[str, Any], key: tuple[str | int, ...]) -> bool:
    """Whether a file decides the value at a key: it gives it, or a value in place of a table around it.

    >>> sets({"gain": 0.5}, ("gain", "forward")), sets({"gain": {"forward": 1}}, ("gain", "backward"))
    (True, False)
    """
    here: Any = tables
    for part in key:
        if not isinstance(here, dict):
            return True
        if part not in here:
            return False
        here = here[part]
    return True
