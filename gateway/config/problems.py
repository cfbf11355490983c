"""What is wrong with a configuration: file, line, key, what was found, what is allowed or what to do."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from gateway.config.toml import KeyPath


@dataclass(frozen=True, slots=True)
class Problem:
    """One error or warning.

    ``found`` is what was found, ``remedy`` what is allowed or what to do. ``line`` and ``column`` count from
    1; they are None if the whole file is meant.
    """

    file: str
    key: str
    found: str
    remedy: str
    line: int | None = None
    column: int | None = None

    @property
    def is_of_whole_file(self) -> bool:
        """Whether the whole file is meant: it is missing, a folder, or not readable."""
        return self.line is None and not self.key

    def __str__(self) -> str:
        location = ":".join(str(part) for part in (self.file, self.line, self.column) if part is not None)
        what = "; ".join(part for part in (self.found, self.remedy) if part)
        return ": ".join(part for part in (location, self.key, what) if part)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for ``--json``."""
        return {
            "file": self.file,
            "line": self.line,
            "column": self.column,
            "key": self.key,
            "found": self.found,
            "remedy": self.remedy,
        }


class ConfigErrors(Exception):  # noqa: N818 (several errors in one)
    """All errors of one configuration. The text has one line for each."""

    def __init__(self, problems: Sequence[Problem], warnings: Sequence[Problem] = ()) -> None:
        super().__init__("\n".join(map(str, problems)))
        self.problems = tuple(problems)
        self.warnings = tuple(warnings)


def in_file_order(problems: Iterable[Problem], first_file: str) -> tuple[Problem, ...]:
    """Sort problems in the order of the files, without duplicates."""
    unique = dict.fromkeys(problems)
    return tuple(sorted(unique, key=lambda p: (p.file != first_file, p.file, p.line or 0, p.column or 0)))


def key_text(path: KeyPath) -> str:
    """Write a key path for display; elements of a list count from 1.

    >>> key_text(("line", "xyz", "controllers", 1, "tcp"))
    'line.xyz.controllers[2].tcp'
    """
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            bare = part if part and all(c.isalnum() or c in "_-" for c in part) else shown(part)
            text += f".{bare}" if text else bare
    return text


LONGEST_SHOWN = 80


def shown(found: object) -> str:
    """Write a value as in a TOML file, shortened if it is long.

    >>> shown({"tcp": "127.0.0.1:502", "rtu": True})
    '{ tcp = "127.0.0.1:502", rtu = true }'
    """
    text = _toml(found, 0)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 1] + "…"


DEEPEST_SHOWN = 4


def _toml(found: object, depth: int) -> str:
    if isinstance(found, str):
        return f'"{"".join(map(_escaped, found[:LONGEST_SHOWN]))}{"…" if len(found) > LONGEST_SHOWN else ""}"'
    if isinstance(found, bool):
        return "true" if found else "false"
    if isinstance(found, int) and abs(found) >= 10**LONGEST_SHOWN:
        return "a number of very many digits"
    if isinstance(found, dict | list) and depth == DEEPEST_SHOWN:
        return "…"
    if isinstance(found, dict):
        inside = ", ".join(f"{key_text((str(k),))} = {_toml(v, depth + 1)}" for k, v in found.items())
        return f"{{ {inside} }}" if inside else "{ }"
    if isinstance(found, list):
        return "[" + ", ".join(_toml(element, depth + 1) for element in found) + "]"
    return str(found)


def _escaped(character: str) -> str:
    """Escape what does not print, so that a line of output stays one line."""
    if character in '"\\':
        return f"\\{character}"
    return character if character.isprintable() else repr(character)[1:-1]
