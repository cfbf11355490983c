"""Tables as the text of a TOML file."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

DELETE: Final = "\x7f"
_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")


def quoted(text: str) -> str:
    """Return a text in quotes.

    JSON strings are TOML strings, except for one character that TOML requires to be escaped.
    """
    return json.dumps(text, ensure_ascii=False).replace(DELETE, "\\u007F")


def toml_text(tables: Mapping[str, Any]) -> str:
    """Return a document that reads as the same tables: a header for each section, a key on each line.

    Sections are the tables of the document, and the named ones of a table that has nothing else.

    >>> print(toml_text({"gateway": {"name": "mill-1"}, "axis": {"x": {"gain": {"forward": 1}}}}))
    [gateway]
    name = "mill-1"
    <BLANKLINE>
    [axis.x]
    gain.forward = 1
    <BLANKLINE>
    """
    return "\n".join("\n".join((*lines, "")) for lines in _sections(tables))


def _sections(tables: Mapping[str, Any]) -> Iterator[list[str]]:
    alone = {key: value for key, value in tables.items() if not isinstance(value, dict)}
    if alone:  # before the first header; no configuration has such keys, but a file may
        yield list(_lines(alone))
    for name, table in tables.items():
        if name in alone:
            continue
        if table and all(isinstance(each, dict) for each in table.values()):
            for inner, section in table.items():
                yield from _section(f"{_key(name)}.{_key(inner)}", section)
        else:
            yield from _section(_key(name), table)


def _section(path: str, section: Mapping[str, Any]) -> Iterator[list[str]]:
    lists = {key: value for key, value in section.items() if _is_of_tables(value)}
    rest = {key: value for key, value in section.items() if key not in lists}
    yield [f"[{path}]", *_lines(rest)]
    for key, elements in lists.items():
        for element in elements:
            yield [f"[[{path}.{_key(key)}]]", *_lines(element)]


def _is_of_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(each, dict) for each in value)


def _lines(table: Mapping[str, Any], before: str = "") -> Iterator[str]:
    for key, value in table.items():
        if isinstance(value, dict) and value:
            yield from _lines(value, f"{before}{_key(key)}.")
        else:
            yield f"{before}{_key(key)} = {_value(value)}"


def _value(value: object) -> str:
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        inside = ", ".join(f"{_key(key)} = {_value(each)}" for key, each in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return str(value)  # of a number and a date as TOML has it


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else quoted(key)
