"""The reference and the example know every key."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import BaseModel

from gateway.config.findings import models_in
from gateway.config.load import load
from gateway.config.sections import NAMED, SINGLE

ROOT = Path(__file__).parents[2]
REFERENCE = (ROOT / "docs" / "configuration.md").read_text()
EXAMPLE = ROOT / "deploy" / "gateway.example.toml"
PROFILE_EXAMPLE = ROOT / "deploy" / "gateway.profile.example.toml"


def fields_of(model: type[BaseModel], path: str) -> Iterator[tuple[str, str, str]]:
    for name, field in model.model_fields.items():
        yield path, name, field.description or ""
        for inside in models_in(field.annotation):
            yield from fields_of(inside, f"{path}.{name}")


FIELDS = [field for name, model in {**SINGLE, **NAMED}.items() for field in fields_of(model, name)]


@pytest.mark.parametrize(("path", "name", "description"), FIELDS, ids=[f"{f[0]}.{f[1]}" for f in FIELDS])
def test_every_key_is_in_the_reference_and_the_example(path: str, name: str, description: str) -> None:
    assert re.search(rf"`{name}`|\b{name} = |[{{ ]{name}[ ,}}]", REFERENCE), (
        f"{path}.{name} is not in the reference"
    )
    assert re.search(rf"\b{name}\b", EXAMPLE.read_text()), f"{path}.{name} is not in the example"
    assert description, f"{path}.{name} says nothing about itself"


@pytest.mark.parametrize("name", [*SINGLE, *NAMED])
def test_every_section_has_a_heading_in_the_reference(name: str) -> None:
    assert re.search(rf"^## `\[{name}(\.NAME)?\]`$", REFERENCE, re.MULTILINE)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The examples, where a path is short enough for the sockets that belong to them."""
    return shutil.copytree(EXAMPLE.parent, tmp_path / "deploy")


def test_the_example_has_nothing_wrong_and_nothing_to_warn_of(folder: Path) -> None:
    result = load(folder / EXAMPLE.name)
    assert result.warnings == ()
    assert [axis.table_name for line in result.plan.lines for axis in line.axes] == ["cnc10x.tab"]


def test_the_example_of_known_drives_is_a_gantry_with_nothing_to_warn_of(folder: Path) -> None:
    result = load(folder / PROFILE_EXAMPLE.name)
    assert result.warnings == ()
    [line] = result.plan.lines
    assert line.groups == (("y1", "y2"),)
    assert [axis.drive for axis in line.axes] == ["oriental-az", "oriental-az"]
    assert [axis.table_name for axis in line.axes] == ["gantry-y1.tab", "gantry-y2.tab"]
    assert [link.plan.role.value for link in line.controllers] == ["motion", "operator"]


def test_the_example_as_it_stands_with_its_defaults_written_out(folder: Path) -> None:
    """A default that the example shows behind a # may be uncommented and changes nothing."""
    text = EXAMPLE.read_text()
    for key in (
        "zero_counts",
        "machine_offset",
        "gain",
        "hysteresis",
        "outside",
        "fresh_ms",
        "in_position",
        "unseen_ms",
        "repeat_within",
        "max_correction",
        "max_slope",
        "travel_margin",
        "added_frames",
        "unmapped",
        "stored_moves",
        "relative_unknown",
        "write",
        "exception",
        "safe_read",
        "checks_crc",
        "max_registers",
        "response_timeout_ms",
        "turnaround_ms",
        "quiet_ms",
        "monitor_max_wait_ms",
        "budget_us",
        "state",
    ):
        text, count = re.subn(rf"^# ({key} = )", r"\1", text, flags=re.MULTILINE)
        assert count == 1, f"{key} stands {count} times behind a #"
    path = folder / "gateway.toml"
    path.write_text(text)
    assert load(path).plan == load(folder / EXAMPLE.name).plan


@pytest.mark.parametrize(
    ("key", "said"),
    [("state", ["`relay.sock`"]), ("hysteresis", ["`stream`:", "`targets`:", "measured position"])],
)
def test_the_reference_says_what_a_key_does(key: str, said: list[str]) -> None:
    (row,) = re.findall(rf"^\| `{key}` \|.*$", REFERENCE, re.MULTILINE)
    assert all(words in row for words in said)
