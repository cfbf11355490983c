"""``pitch-gateway drives``: the list and one profile, for people and for programs."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from gateway.cli.app import app
from gateway.drives import library
from gateway.drives.profile import Profile


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["drives", *arguments])


def test_the_list_has_every_profile_with_its_tier_and_transports() -> None:
    result = run()
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["name", "tier", "transports", "drive"]
    assert [line.split()[0] for line in lines[1:]] == list(library.names())
    assert "delta-asda            A     rtu" in result.stdout


def test_the_list_as_data() -> None:
    data = json.loads(run("--json").stdout)
    assert [drive["name"] for drive in data] == list(library.names())
    (kinco,) = (drive for drive in data if drive["name"] == "kinco-fd")
    assert (kinco["tier"], kinco["vendor"], kinco["transports"]) == ("A", "Kinco", ["rtu"])


@pytest.mark.parametrize("name", library.names())
def test_a_profile_is_shown_with_its_traps_and_sources(name: str) -> None:
    result = run("show", name)
    assert result.exit_code == 0
    profile = library.shipped(name)
    shown = " ".join(result.stdout.split())
    assert profile.title in shown
    for trap in profile.traps:
        assert " ".join(trap.what.split()) in shown
        assert " ".join(trap.check.split()) in shown
    for source in profile.sources.values():
        assert " ".join(source.title.split()) in shown
        assert source.url in shown
    assert all(len(line) <= 110 or "://" in line for line in result.stdout.splitlines())


def test_a_shown_map_says_addresses_meanings_and_how_well_they_are_known() -> None:
    shown = " ".join(run("show", "leadshine-pr").stdout.split())
    assert "actual[1] verified address 0x602c, type int32, words high-first [icl, robot-dc]" in shown
    assert "start 0x0010" in shown
    assert "bits.homed verified address 0x1003, bit 6" in shown
    assert "relative_to_commanded single-source [icl]" in shown


def test_a_shown_map_says_why_something_is_refused_or_passes() -> None:
    shown = " ".join(run("show", "leadshine-el7").stdout.split())
    assert "position_like are positions that the drive keeps: writing one is refused with 2" in shown
    assert '"stored" values' not in shown  # it has none
    assert "passes unchanged, and counts as unknown" in shown
    assert '"stored" values run a position that the drive keeps: refused with 4' in " ".join(
        run("show", "festo-cmmt-111").stdout.split()
    )


def test_a_shown_number_is_never_broken_between_two_lines() -> None:
    shown = run("show", "oriental-blv-r").stdout
    assert not [line for line in shown.splitlines() if re.search(r"0x[0-9a-f]{0,3}$", line)]
    assert "0x000d/0x000e" in shown


def test_a_shown_register_that_starts_is_an_address() -> None:
    assert "0x9901/0x9904/0x9905/0x9906/0x9907" in run("show", "iai-robo-cylinder").stdout


@pytest.mark.parametrize("name", library.names())
def test_a_profile_can_be_copied(tmp_path: Path, name: str) -> None:
    text = run("show", name, "--toml").stdout
    assert Profile.model_validate(tomllib.loads(text)) == library.shipped(name)
    path = tmp_path / "copy.toml"
    path.write_text(text, encoding="utf-8")
    assert json.loads(run("show", str(path), "--json").stdout)["title"] == library.shipped(name).title


def test_a_profile_as_data_is_the_profile() -> None:
    data = json.loads(run("show", "tl-r", "--json").stdout)
    assert data.pop("name") == "tl-r"
    seen = data.pop("public_traffic")
    assert (seen["stop"], seen["stored"]) == (2, 0)
    assert Profile.model_validate(data) == library.shipped("tl-r")


def test_a_name_that_does_not_exist_is_bad_input_with_a_suggestion() -> None:
    result = run("show", "orientl-az")
    assert result.exit_code == 1
    assert 'there is no profile "orientl-az"; did you mean oriental-az' in result.stderr
    assert result.stdout == ""


def test_a_file_with_mistakes_is_bad_input_with_its_lines(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('title = "T"\n[registers]\ncommand = [{ address = 1, type = "int31" }]\n')
    result = run("show", str(path))
    assert result.exit_code == 1
    assert f"{path}:3: registers.command[1].type" in result.stderr


def test_a_file_that_does_not_exist_is_asked_for_as_a_profile(tmp_path: Path) -> None:
    result = run("show", str(tmp_path / "none.toml"))
    assert result.exit_code == 1
    assert result.stderr == f"{tmp_path / 'none.toml'}: no such file; give the path of a drive profile\n"


@pytest.mark.parametrize(
    ("wrong", "key"),
    [
        ('write = "fc06"', "registers.write"),
        (
            'mode = { source = "sticky", address = 9, absolute = [1], relative_to_actual = [2] }',
            "registers.mode.relative_to_actual",
        ),
    ],
)
def test_a_profile_that_the_configuration_would_refuse_is_not_shown(
    tmp_path: Path, wrong: str, key: str
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'title = "T"\n[registers]\ncommand = [{{ address = 1, type = "int32" }}]\n{wrong}\n')
    result = run("show", str(path))
    assert result.exit_code == 1
    assert f"{path}:4: {key}: " in result.stderr


def test_two_forms_at_once_are_wrong_usage() -> None:
    assert run("show", "tl-r", "--json", "--toml").exit_code == 2


@pytest.mark.parametrize("command", [(), ("show",)])
def test_the_help_shows_examples(command: tuple[str, ...]) -> None:
    result = CliRunner().invoke(app, ["drives", *command, "--help"], env={"COLUMNS": "120"})
    assert result.exit_code == 0
    assert "pitch-gateway drives" in result.stdout
