"""A state folder of an older release is taken over, one of a newer release is left as it is.

``tests/data/state_of_version_2`` was written by a real run of the release before: axis x stood at 50.000 mm
when it was stopped. Its table adds 0.05 mm there on the way up, so that its drive was told 50 050 counts.
"""

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

import gateway
from gateway.cli.configuration import compile_for_start_or_exit
from gateway.config.compile import compile_into_state
from gateway.config.load import load
from gateway.config.problems import ConfigErrors
from gateway.exchange.axis import record_layout
from gateway.exchange.axis.record_layout import RecordSlots, why_not_readable
from gateway.exchange.rights import UNLIMITED
from gateway.relay.axis_record import record_path
from gateway.state import tables as compiled_table
from gateway.state.folder import PLAN_NAME, StateError
from gateway.state.last_good import last_plan
from gateway.state.plan import (
    VERSION,
    in_force,
    newer_release,
    read_plan,
    refuse_newer,
    sealed,
    unsealed,
    writer_of,
)

OLD = Path(__file__).parents[1] / "data" / "state_of_version_2"
OF_1_0_0 = Path(__file__).parents[1] / "data" / "state_of_1.0.0"


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A configuration with its table, and the state that the release before left of it."""
    shutil.copytree(OLD, tmp_path / "state")
    (tmp_path / "tables").mkdir()
    (tmp_path / "state" / "x.tab").rename(tmp_path / "tables" / "x.tab")
    return (tmp_path / "state" / "gateway.toml").rename(tmp_path / "gateway.toml")


def mark(state: Path, **fields: Any) -> bytes:
    """Let another release have written the plan."""
    path = state / PLAN_NAME
    was = unsealed(path.read_bytes())
    content = sealed(msgspec.msgpack.encode(msgspec.msgpack.decode(was) | fields))
    path.write_bytes(content)
    return content


def files_in(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_version_of_the_state_is_raised_with_each_layout_in_it() -> None:
    # Whoever changes the layout of a table or a record raises VERSION too, and says here with what.
    assert (VERSION, compiled_table.VERSION, record_layout.VERSION) == (7, 1, 3)


def test_a_plan_of_the_version_before_is_not_run_but_named(config: Path) -> None:
    with pytest.raises(StateError) as caught:
        read_plan(config.parent / "state", config)
    assert str(caught.value) == (
        f"{config.parent}/state/plan.msgpack was made by release 0.1.0, and this is release "
        f"{gateway.__version__} (state versions 2 and {VERSION}); run: pitch-gateway check --compile {config}"
    )


def test_what_an_older_plan_says_is_taken_over(config: Path) -> None:
    found = last_plan(config.parent / "state")
    assert found is not None
    (line,) = found.plan.lines
    assert [each.plan.rights for each in line.controllers] == [UNLIMITED]
    (axis,) = line.axes
    assert axis.table_name == "x.tab"
    assert axis.table is not None
    assert list(axis.table.forward) == [0.0, 0.05, 0.1]
    assert list(axis.table.backward) == [0.0, 0.04, 0.08]


def test_an_upgrade_with_a_bad_table_starts_with_the_last_good_one(config: Path) -> None:
    (config.parent / "tables" / "x.tab").write_text("CNC10 TAB FILE VERSION 3\nAXIS X\nnothing more\n")
    compile_for_start_or_exit(config)
    (axis,) = read_plan(config.parent / "state", config).plan.lines[0].axes
    assert axis.table is not None
    assert list(axis.table.forward) == [0.0, 0.05, 0.1]


def test_an_upgrade_keeps_what_an_axis_remembers(config: Path) -> None:
    path = record_path(config.parent / "state", "x")
    before = path.read_bytes()
    compile_into_state(load(config))
    assert path.read_bytes() == before
    assert why_not_readable(before, "x") == ""
    remembered = RecordSlots(memoryview(bytearray(before)), b"").read()
    assert remembered is not None
    assert (remembered.nominal_counts, remembered.corrected_counts) == (50_000, 50_050)
    assert remembered.has_target
    written_by = writer_of(config.parent / "state")
    assert written_by is not None
    assert (written_by.version, written_by.gateway_version) == (VERSION, gateway.__version__)


def test_a_newer_state_is_left_as_it_is(config: Path) -> None:
    state = config.parent / "state"
    mark(state, version=VERSION + 1, gateway_version="9.1.0")
    before = files_in(state)
    expected = (
        f"{state} was written by a newer release, 9.1.0 (state version {VERSION + 1}; this is release "
        f"{gateway.__version__}, which knows versions up to {VERSION}): install that release again, or "
        f"stop the gateway and move {state} away: the axes then start without what they remember"
    )
    with pytest.raises(StateError) as running:
        read_plan(state, config)
    assert str(running.value) == expected
    with pytest.raises(StateError) as compiling:
        compile_into_state(load(config))
    assert str(compiling.value) == expected
    assert files_in(state) == before
    os.rename(state, config.parent / "state.newer")  # noqa: PTH104 - what the error says
    compile_into_state(load(config))
    read_plan(state, config)


def test_a_newer_release_with_the_same_state_version_is_compiled_over(config: Path) -> None:
    state = config.parent / "state"
    compile_into_state(load(config))
    mark(state, gateway_version="9.1.0")
    with pytest.raises(
        StateError, match=r"made by release 9\.1\.0, and .*; run: pitch-gateway check --compile"
    ):
        read_plan(state, config)
    compile_into_state(load(config))
    read_plan(state, config)


def test_a_key_that_only_a_newer_release_knows_is_named_as_such(config: Path) -> None:
    state = config.parent / "state"
    mark(state, gateway_version="9.1.0")
    config.write_text(config.read_text().replace('units = "mm"', 'units = "mm"\nwarp_factor = 9'))
    with pytest.raises(ConfigErrors) as caught:
        load(config)
    (problem,) = caught.value.problems
    assert (problem.key, problem.found) == ("axis.x.warp_factor", "unknown key")
    assert problem.remedy.endswith(
        "; or a key of release 9.1.0, which ran here before: install that release again, or remove the key"
    )


def test_without_a_newer_release_an_unknown_key_is_only_that(config: Path) -> None:
    config.write_text("[gatewey]\n" + config.read_text())
    with pytest.raises(ConfigErrors) as caught:
        load(config)
    assert str(caught.value) == f"{config}:1: gatewey: unknown key; did you mean gateway?"


@pytest.mark.parametrize(
    ("release", "is_newer"),
    [("0.0.9", False), ("0.1.0", False), ("0.1.1", True), ("0.10.0", True), ("?", False)],
)
def test_releases_are_compared_as_numbers(
    config: Path, monkeypatch: pytest.MonkeyPatch, release: str, is_newer: bool
) -> None:
    monkeypatch.setattr(gateway, "__version__", "0.1.0")
    mark(config.parent / "state", gateway_version=release)
    assert newer_release(config.parent / "state") == (release if is_newer else "")


def test_what_is_no_state_was_written_by_nobody(tmp_path: Path) -> None:
    assert writer_of(tmp_path) is None
    (tmp_path / PLAN_NAME).write_bytes(b"\x93no plan")
    assert writer_of(tmp_path) is None
    refuse_newer(tmp_path, None)
    assert newer_release(tmp_path) == ""


@pytest.mark.parametrize("version", [0, 1, VERSION + 1])
def test_from_a_version_that_is_not_known_nothing_is_taken_over(config: Path, version: int) -> None:
    mark(config.parent / "state", version=version)
    assert last_plan(config.parent / "state") is None


def test_the_plan_of_1_0_0_is_what_this_release_makes_of_its_configuration(tmp_path: Path) -> None:
    shutil.copytree(OF_1_0_0, tmp_path, dirs_exist_ok=True)
    (tmp_path / "written").rename(tmp_path / "state")
    config = tmp_path / "gateway.toml"
    found = last_plan(tmp_path / "state")
    assert found is not None
    # Newer than 1.0.0: a line keeps 4 MB of its last minutes.
    lines = tuple(replace(line, tape_bytes=4_000_000) for line in found.plan.lines)
    assert replace(found.plan, lines=lines) == in_force(load(config).plan)
    assert found.configuration == config.read_text()
    assert [Path(source).name for source in found.sources] == ["gateway.toml"]
    assert found.tables_folder is not None
    assert Path(found.tables_folder.path).name == "tables"
