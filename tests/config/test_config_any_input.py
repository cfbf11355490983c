"""Whatever stands in the file, it is either good or refused with reasons; nothing else is ever raised."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.config.axis_model import AxisSection
from gateway.config.line_model import ControllerSection, DrivesEndpoint, LineSection
from gateway.config.load import load
from gateway.config.problems import ConfigErrors
from gateway.config.toml import KeyLines
from gateway.drives.registers import PositionSpec, RegisterMap
from tests.config.config_bench import GOOD, written

Quick = settings(
    max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)

texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
scalars = (
    st.booleans()
    | st.integers()
    | st.floats()
    | texts
    | st.dates()
    | st.datetimes()
    | st.sampled_from(
        ["mm", "on", "stream", "absolute", "xyz", "cnc10x.tab", "127.0.0.1:502", "int32", "hold", "step"]
    )
)
MODELS = (AxisSection, LineSection, ControllerSection, DrivesEndpoint, RegisterMap, PositionSpec)
keys = st.sampled_from([key for model in MODELS for key in model.model_fields]) | texts
values: st.SearchStrategy[Any] = st.recursive(
    scalars,
    lambda inside: st.lists(inside, max_size=3) | st.dictionaries(keys, inside, max_size=4),
    max_leaves=12,
)
sections = st.dictionaries(keys, values, max_size=8)
documents = st.dictionaries(
    st.sampled_from(["gateway", "line", "axis", "group", "http", "mqtt"]) | texts,
    st.dictionaries(st.sampled_from(["xyz", "x"]) | texts, sections | values, max_size=3) | values,
    max_size=4,
)


def toml(found: Any) -> str:
    """Write a value as TOML."""
    if isinstance(found, bool):
        return "true" if found else "false"
    if isinstance(found, str):
        return '"' + "".join(c if c.isalnum() else f"\\U{ord(c):08x}" for c in found) + '"'
    if isinstance(found, dict):
        return "{" + ", ".join(f"{toml(key)} = {toml(inside)}" for key, inside in found.items()) + "}"
    if isinstance(found, list):
        return "[" + ", ".join(map(toml, found)) + "]"
    return str(found)


def as_file(document: dict[str, Any]) -> str:
    return "".join(f"{toml(key)} = {toml(found)}\n" for key, found in document.items())


def good_or_refused(path: Path) -> None:
    try:
        load(path)
    except ConfigErrors as errors:
        problems = errors.problems
    else:
        return
    assert problems
    for problem in problems:
        assert problem.found
        assert str(problem).count("\n") == 0


@Quick
@given(document=documents)
def test_any_document_is_good_or_refused(tmp_path: Path, document: dict[str, Any]) -> None:
    text = as_file(document)
    tomllib.loads(text)
    good_or_refused(written(tmp_path, text))


@Quick
@given(section=st.sampled_from(["axis.x", "axis.x.registers", "line.xyz"]), key=keys, found=values)
def test_any_value_in_a_good_file_is_good_or_refused(
    tmp_path: Path, section: str, key: str, found: object
) -> None:
    lines = GOOD.splitlines()
    at = lines.index(f"[{section}]") + 1
    kept = [line for line in lines if line.split(" ")[0] != key]
    good_or_refused(written(tmp_path, "\n".join([*kept[:at], f"{toml(key)} = {toml(found)}", *kept[at:]])))


@Quick
@given(content=st.binary(max_size=200))
def test_any_bytes_are_good_or_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "gateway.toml"
    path.write_bytes(content)
    good_or_refused(path)


@Quick
@given(data=st.data())
def test_a_good_file_with_damage_is_good_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(GOOD) - 1))
    cut = data.draw(st.integers(0, 30))
    put = data.draw(texts | st.sampled_from(["[", "]", "{", '"', "\n", "=", "0", "-", "x"]))
    good_or_refused(written(tmp_path, GOOD[:at] + put + GOOD[at + cut :]))


@Quick
@given(document=documents)
def test_every_key_of_a_document_is_found_on_its_line(document: dict[str, Any]) -> None:
    lines = KeyLines(as_file(document))
    for number, (key, found) in enumerate(document.items(), start=1):
        assert lines.of((key,)) == number
        if isinstance(found, dict):
            assert all(lines.of((key, inside)) == number for inside in found)


@pytest.mark.parametrize(
    "text",
    [
        "axis = []",
        "line.x.controllers = 3",
        "line.x.controllers = [3, {}]",
        "line.x = {}\naxis.x = {}",
        "axis.x.registers = []",
        "axis.x.registers.command = [[]]",
        "axis.x.registers.bits.homed = 1",
        "axis.x.travel = [[1], {}]",
        "gateway.tables = ''",
        'gateway.tables = "\\u0000"',
        "gateway = [1]\naxis.x.table = 'a'",
        "gateway.tables = 'nowhere'\naxis.x.table = 'a'",
        "line.x.drives = 'tcp'",
    ],
)
def test_shapes_that_nobody_means_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigErrors):
        load(written(tmp_path, text))
