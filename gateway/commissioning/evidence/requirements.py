"""The component requirements of IEC 62443-4-2, judged for this program and against a configuration."""

import csv
import io
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from importlib.resources import files
from typing import Any, Final, Literal

import msgspec

TABLE: Final = "iec_62443_4_2.toml"
VERDICTS: Final[Mapping[str, str]] = {
    "met": "met",
    "setting": "met with this setting",
    "not met": "not met",
    "none": "not applicable",
}
SET, PARTLY, NOT_SET, NOTHING = "set", "set in part", "not set", "nothing to set"
"""What a configuration makes of a key. NOTHING: it has no such part, such as a broker."""
EITHER: Final = " | "
NOT: Final = "not "


class Requirement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A requirement; ``iec_62443_4_2.toml`` explains the fields."""

    number: str
    title: str
    verdict: Literal["met", "setting", "not met", "none"]
    why: str
    keys: tuple[str, ...] = ()
    tests: tuple[str, ...] = ()


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    requirement: tuple[Requirement, ...]


def requirements() -> tuple[Requirement, ...]:
    """Return all of them, in the order of the standard."""
    text = (files(__package__) / TABLE).read_text(encoding="utf-8")
    return msgspec.convert(tomllib.loads(text), _Table).requirement


def verdict_here(requirement: Requirement, tables: Mapping[str, Any]) -> str:
    """Return the verdict in words, for a setting with what the configuration makes of it."""
    words = VERDICTS[requirement.verdict]
    if requirement.verdict != "setting":
        return words
    found = [state_of(key, tables) for key in requirement.keys]
    needed = set(found) - {NOTHING}
    if not needed:
        here = NOTHING
    elif len(needed) == 1:
        here = needed.pop()
    else:
        here = PARTLY
    return f"{words}: {here} here"


def state_of(key: str, tables: Mapping[str, Any]) -> str:
    """Return SET, PARTLY, NOT_SET or NOTHING for a key of the table, in a configuration.

    >>> page = {"http": {"tokens": [{"name": "anna", "file": "a.token"}]}}
    >>> state_of("http.tokens | http.tls.clients", page), state_of("http.tls", page)
    ('set', 'not set')
    >>> state_of("mqtt.tls", page), state_of("not mqtt.commands", {"mqtt": {"commands": True}})
    ('nothing to set', 'not set')
    """
    if EITHER in key:
        states = {state_of(each, tables) for each in key.split(EITHER)}
        return next(state for state in (SET, PARTLY, NOT_SET, NOTHING) if state in states)
    is_negated = key.startswith(NOT)
    found = Counter(_settings(key.removeprefix(NOT).split("."), tables))
    if not found:
        return NOTHING
    if len(found) == 2:
        return PARTLY
    return SET if found[not is_negated] else NOT_SET


def _settings(path: list[str], tables: Mapping[str, Any]) -> Iterator[bool]:
    """Yield for each part of a configuration that may have a key whether it has."""
    section, *rest = path
    if section == "alarm_output":
        yield section in tables
        return
    if section == "http" and tables.get("http", {}).get("listen") == "":
        return  # there is no page
    if section == "mqtt" and section not in tables:
        return  # there is no broker
    found: Any = tables.get(section, {})
    here = list(found.values()) if section == "line" else [found]
    for part in rest[:-1]:
        inside = [each[part] for each in here if part in each]
        here = [each for found in inside for each in (found if isinstance(found, list) else [found])]
    for table in here:
        if rest[-2:] != ["controllers", "tls"] or "tcp" in table:  # a serial port has no TLS
            yield table.get(rest[-1]) not in (None, False, [])


def counts(tables: Mapping[str, Any]) -> dict[str, int]:
    """Return how many requirements have each verdict."""
    found = Counter(verdict_here(each, tables) for each in requirements())
    return dict(sorted(found.items()))


def as_markdown(tables: Mapping[str, Any], version: str) -> str:
    """Return the judged table as a document."""
    rows = requirements()
    counted = [f"| {verdict} | {count} |" for verdict, count in counts(tables).items()]
    lines = []
    for each in rows:
        keys = "".join(f"<br>`{key}`: {state_of(key, tables)}" for key in each.keys)
        tests = "<br>".join(f"`{test}`" for test in each.tests)
        verdict = f"{verdict_here(each, tables)}{keys}".replace(EITHER, "` or `")
        lines.append(f"| {each.number} {each.title} | {verdict} | {each.why} | {tests} |")
    template = (files(__package__) / "iec-62443-4-2.md").read_text(encoding="utf-8")
    return template.format(version=version, counts="\n".join(counted), rows="\n".join(lines))


def as_csv(tables: Mapping[str, Any]) -> str:
    """Return the judged table with a row for each requirement."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("number", "title", "verdict", "keys", "why", "tests"))
    for each in requirements():
        verdict = verdict_here(each, tables)
        writer.writerow(
            (each.number, each.title, verdict, "; ".join(each.keys), each.why, "; ".join(each.tests))
        )
    return text.getvalue()
