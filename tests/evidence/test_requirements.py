"""The table of IEC 62443-4-2: whole, with tests and keys that exist, and judged against configurations."""

import ast
import csv
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from gateway.commissioning.evidence.requirements import (
    EITHER,
    NOT,
    Requirement,
    as_csv,
    as_markdown,
    requirements,
    verdict_here,
)
from gateway.config.findings import field_at
from gateway.config.sections import NAMED, SINGLE

ROOT = Path(__file__).parents[2]
ROWS = {each.number: each for each in requirements()}
# IEC 62443-4-2:2019. CR 1.6, 1.13, 2.4, 2.13, 3.2, 3.10 to 3.14, 5.2 and 5.3 depend on the kind of component.
LAST = {1: 14, 2: 13, 3: 14, 4: 3, 5: 4, 6: 2, 7: 8}
OF_A_KIND = {
    **dict.fromkeys(("1.6", "1.13", "5.2", "5.3"), "NDR"),
    **dict.fromkeys(("2.4", "3.2"), "SAR"),
    **dict.fromkeys(("2.13", "3.10", "3.11", "3.12", "3.13", "3.14"), "EDR/HDR/NDR"),
}


@cache
def names_in(path: Path) -> set[str]:
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    return {each.name for each in ast.parse(path.read_bytes()).body if isinstance(each, functions)}


def test_each_requirement_stands_there_once_in_its_order() -> None:
    numbers = [f"{part}.{number}" for part, last in LAST.items() for number in range(1, last + 1)]
    assert [each.number for each in requirements()] == [
        f"{OF_A_KIND.get(each, 'CR')} {each}" for each in numbers
    ]


@pytest.mark.parametrize("row", ROWS.values(), ids=ROWS)
def test_each_named_test_exists_and_what_is_met_has_one(row: Requirement) -> None:
    for test in row.tests:
        path, _, name = test.partition("::")
        assert name in names_in(ROOT / path), test
    assert row.tests or row.verdict in {"not met", "none"}


@pytest.mark.parametrize("row", ROWS.values(), ids=ROWS)
def test_each_named_key_exists_and_only_settings_have_some(row: Requirement) -> None:
    assert bool(row.keys) == (row.verdict == "setting")
    for key in (each for keys in row.keys for each in keys.removeprefix(NOT).split(EITHER)):
        section, *path = key.split(".")
        model = {**SINGLE, **NAMED}[section]
        assert not path or field_at(model, tuple(path)) is not None, key


TLS = {"certificate": "a", "key": "b", "clients": "c"}
REVOKED = {**TLS, "revoked": "d"}


def line(*controllers: dict[str, Any]) -> dict[str, Any]:
    return {"line": {"xyz": {"controllers": list(controllers)}}}


@pytest.mark.parametrize(
    ("number", "tables", "here"),
    [
        ("CR 1.1", {}, "not set"),  # the page is on without its section
        ("CR 1.1", {"http": {"listen": ""}}, "nothing to set"),
        ("CR 1.1", {"http": {"tokens": []}}, "not set"),
        ("CR 1.1", {"http": {"tokens": [{"name": "a", "file": "b"}]}}, "set"),
        ("CR 1.1", {"http": {"tls": {"clients": "ca.pem"}}}, "set"),
        ("CR 1.1", {"http": {"tls": {}}}, "not set"),
        ("CR 1.9", line({"tcp": "a"}), "nothing to set"),  # without certificates there is nothing to revoke
        ("CR 1.9", line({"tcp": "a", "tls": REVOKED}), "set"),
        ("CR 1.9", {**line({"tcp": "a", "tls": REVOKED}), "http": {"tls": {}}}, "set in part"),
        ("CR 2.1", line({"tcp": "a"}), "not set"),
        ("CR 2.1", line({"tcp": "a", "role": "monitor"}, {"tcp": "b"}), "set in part"),
        ("CR 2.1", line({"tcp": "a", "roles": {"Viewer": {"role": "monitor"}}}), "set"),
        ("CR 2.12", {}, "nothing to set"),
        ("CR 2.12", {"mqtt": {}}, "set"),
        ("CR 2.12", {"mqtt": {"commands": False}}, "set"),
        ("CR 2.12", {"mqtt": {"commands": True}}, "not set"),
        ("CR 3.1", {"http": {"listen": ""}, **line({"rtu": "/dev/a"})}, "nothing to set"),
        ("CR 3.1", {"http": {"listen": ""}, **line({"tcp": "a", "tls": TLS}, {"rtu": "/dev/a"})}, "set"),
        (
            "CR 3.1",
            {"http": {"listen": ""}, "mqtt": {"tls": {}}},
            "set",
        ),  # {} trusts the system's authorities
        ("CR 3.1", {"http": {"tls": TLS}, "mqtt": {}}, "set in part"),
        ("CR 3.6", {}, "not set"),
        ("CR 3.6", {"alarm_output": {"tcp": "a"}}, "set"),
    ],
)
def test_a_setting_is_judged_against_the_configuration(
    number: str, tables: dict[str, Any], here: str
) -> None:
    assert verdict_here(ROWS[number], tables) == f"met with this setting: {here} here"


def test_what_needs_no_setting_is_the_same_everywhere() -> None:
    assert verdict_here(ROWS["CR 1.2"], {}) == "not met"
    assert verdict_here(ROWS["CR 2.8"], {}) == "met"
    assert verdict_here(ROWS["CR 2.2"], {}) == "not applicable"


def test_document_and_spreadsheet_have_every_row() -> None:
    text = as_markdown({}, "1.0.0")
    rows = list(csv.DictReader(as_csv({}).splitlines()))
    assert [row["number"] for row in rows] == list(ROWS)
    for row in rows:
        [line] = [
            each for each in text.splitlines() if each.startswith(f"| {row['number']} {row['title']} |")
        ]
        assert line.count(" | ") == 3, line
        assert row["why"] in line
    counted = [
        int(each.split("|")[2]) for each in text.split("| requirement |")[0].splitlines()[8:] if "|" in each
    ]
    assert sum(counted) == len(ROWS)
