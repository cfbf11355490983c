"""``pitch-gateway check``: one line a problem on stderr, exit code 1; a summary when all is well."""

import json
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from gateway.cli.check import check
from tests.config.config_bench import GOOD, edited, line_of, written


def run(path: Path, *options: str) -> Result:
    app = typer.Typer()
    app.command()(check)
    return CliRunner().invoke(app, [str(path), *options])


def test_a_good_configuration_is_summed_up(tmp_path: Path) -> None:
    result = run(written(tmp_path))
    assert (result.exit_code, result.stderr) == (0, "")
    assert "line xyz: drives RTU /dev/serial/by-id/usb-B 115200 8E1" in result.stdout
    assert "controller hmi: TCP 127.0.0.1:1502, monitor" in result.stdout
    assert "table cnc10x.tab (centroid-3): 3 points, -300 to 0 mm" in result.stdout
    # Largest |correction| 0.02; steepest (0.01 + 0.003)/150; forward - backward at 0: 0.01.
    assert (
        "corrections up to 0.02 mm, slope up to 8.67e-05, between the directions up to 0.01 mm"
        in result.stdout
    )
    # At 200 mm/s: 200 × 8.667e-5 = 0.01733 mm/s.
    assert "a step of 0.01 mm at a reversal, 0.01733 mm/s of speed" in result.stdout
    assert result.stdout.endswith("gateway.toml: good\n")


def test_speed_that_nobody_knows_is_not_said_to_be_nothing(tmp_path: Path) -> None:
    result = run(written(tmp_path, edited(("max_speed = 200.0\n", ""))))
    assert (
        "  can cause a step of 0.01 mm at a reversal; give max_speed to see how much speed it adds\n"
        in result.stdout
    )
    assert "0 mm/s" not in result.stdout


def test_corrections_are_summed_up_with_their_gain(tmp_path: Path) -> None:
    gain = "max_speed = 200.0\ngain = { forward = 0, backward = 0.5 }"
    result = run(written(tmp_path, edited(("max_speed = 200.0", gain))))
    assert (result.exit_code, result.stderr) == (0, "")
    # Away from home is backward: 0.5 × 0.02 at -300, 0.5 × 0.01/150, and nothing forward.
    assert (
        "with a gain of 0 forward and 0.5 backward:\n  corrections up to 0.01 mm, slope up to 3.33e-05, "
        "between the directions up to 0.01 mm" in result.stdout
    )


def test_a_gain_of_0_is_warned_of_and_no_corrections_are_promised(tmp_path: Path) -> None:
    text = edited(("max_speed = 200.0", "max_speed = 200.0\ngain = 0"))
    result = run(written(tmp_path, text))
    assert result.exit_code == 0
    line = line_of(text, "gain = 0")
    assert result.stderr.startswith(
        f"warning: {tmp_path / 'gateway.toml'}:{line}: axis.x.gain: a gain of 0: positions pass uncorrected"
    )
    assert "corrections up to" not in result.stdout
    assert "  gain 0: nothing of it is applied\n" in result.stdout
    off = run(written(tmp_path, text.replace('compensation = "on"', 'compensation = "off"')))
    assert "gain" not in off.stderr


def test_an_axis_without_a_table_is_summed_up(tmp_path: Path) -> None:
    result = run(written(tmp_path, edited(('table = "cnc10x.tab"\n', ""))))
    assert "no table: positions pass 1:1" in result.stdout


def test_warnings_do_not_make_it_bad(tmp_path: Path) -> None:
    result = run(written(tmp_path, edited(("travel = [-300.0, 0.0]\n", ""))))
    assert result.exit_code == 0
    assert result.stderr.startswith(f"warning: {tmp_path / 'gateway.toml'}:17: axis.x: no travel")


def test_every_problem_is_one_line_on_stderr(tmp_path: Path) -> None:
    text = edited(("unit_id = 1", "unit_id = 256"), ('role = "monitor"', 'rol = "monitor"'))
    result = run(written(tmp_path, text))
    assert (result.exit_code, result.stdout) == (1, "")
    file = tmp_path / "gateway.toml"
    assert result.stderr.splitlines() == [
        f"{file}:{line_of(text, 'rol =')}: line.xyz.controllers[2].rol: unknown key; did you mean role?",
        f"{file}:{line_of(text, 'unit_id')}: axis.x.unit_id: found 256; allowed: at least 0, at most 255",
    ]


def test_a_missing_file_is_bad_input(tmp_path: Path) -> None:
    result = run(tmp_path / "none.toml")
    assert result.exit_code == 1
    assert result.stderr == f"{tmp_path / 'none.toml'}: no such file; give the path of a configuration file\n"


def test_json_of_a_good_configuration(tmp_path: Path) -> None:
    result = run(written(tmp_path), "--json")
    said: dict[str, Any] = json.loads(result.stdout)
    assert result.exit_code == 0
    assert (said["ok"], said["problems"], said["warnings"]) == (True, [], [])
    table = said["summary"]["axes"]["x"]["table"]
    assert (table["points"], table["range"], table["max_correction"]) == (3, [-300.0, 0.0], 0.02)
    assert table["can_cause"]["largest_step"] == pytest.approx(0.01)


def test_json_of_a_bad_configuration(tmp_path: Path) -> None:
    text = edited(("unit_id = 1", "unit_id = 256"), ("travel = [-300.0, 0.0]\n", ""))
    result = run(written(tmp_path, text), "--json")
    said: dict[str, Any] = json.loads(result.stdout)
    assert (result.exit_code, result.stderr, said["ok"]) == (1, "", False)
    assert said["problems"] == [
        {
            "file": str(tmp_path / "gateway.toml"),
            "line": line_of(text, "unit_id"),
            "column": None,
            "key": "axis.x.unit_id",
            "found": "found 256",
            "remedy": "allowed: at least 0, at most 255",
        }
    ]
    assert said["warnings"] == []


def test_the_help_shows_examples() -> None:
    app = typer.Typer()
    app.command()(check)
    assert "pitch-gateway check gateway.toml --json" in CliRunner().invoke(app, ["--help"]).stdout


def test_problems_keep_their_words_on_one_line(tmp_path: Path) -> None:
    result = run(written(tmp_path, GOOD.replace('"mill-1"', '"a\\nb"')))
    assert result.stderr.count("\n") == 1
    assert 'found "a\\nb"' in result.stderr


# Where each value comes from.


SECRET = "correct-horse-battery-staple"


@pytest.fixture
def two_files(tmp_path: Path) -> Path:
    (tmp_path / "plant.toml").write_text("[axis.x]\nmax_speed = 150.0\ngain = 0.5\n")
    return written(tmp_path, f'include = ["plant.toml"]\n{GOOD}')


def test_resolved_shows_each_key_with_its_place_and_what_it_replaces(two_files: Path) -> None:
    result = run(two_files, "--resolved")
    assert (result.exit_code, result.stderr) == (0, "")
    text = two_files.read_text()
    plant = two_files.with_name("plant.toml")
    lines = result.stdout.splitlines()
    assert lines[:3] == [
        f"axis.x.max_speed = 200.0  # {two_files}:{line_of(text, 'max_speed')}",
        f"    in place of 150.0  # {plant}:2",
        f"axis.x.gain = 0.5  # {plant}:3",
    ]
    assert f'gateway.name = "mill-1"  # {two_files}:{line_of(text, "name = ")}' in lines
    assert "controllers[2].role" in result.stdout
    assert (lines[-1], "include =" in result.stdout) == (f"{two_files}: good", False)


def test_resolved_in_json_has_values_files_and_lines(two_files: Path) -> None:
    said = json.loads(run(two_files, "--resolved", "--json").stdout)
    assert (said["ok"], "summary" in said) == (True, True)
    speed, replaced = (each for each in said["resolved"] if each["key"] == "axis.x.max_speed")
    text, plant = two_files.read_text(), str(two_files.with_name("plant.toml"))
    here = {"file": str(two_files), "line": line_of(text, "max_speed")}
    assert speed == {"key": "axis.x.max_speed", "value": 200.0, "hidden": "", **here, "replaced_by": None}
    assert (replaced["value"], replaced["file"], replaced["line"]) == (150.0, plant, 2)
    assert replaced["replaced_by"] == here
    (travel,) = (each for each in said["resolved"] if each["key"] == "axis.x.travel")
    assert travel["value"] == [-300.0, 0.0]


def test_resolved_shows_a_bad_configuration_too(two_files: Path) -> None:
    two_files.with_name("plant.toml").write_text("[axis.x]\nmax_slope = 7\n")
    result = run(two_files, "--resolved")
    assert result.exit_code == 1
    plant = two_files.with_name("plant.toml")
    assert result.stderr.startswith(f"{plant}:2: axis.x.max_slope: found 7; allowed: ")
    assert f"axis.x.max_slope = 7  # {plant}:2\n" in result.stdout
    assert "good" not in result.stdout


def test_resolved_without_include_is_the_one_file(tmp_path: Path) -> None:
    path = written(tmp_path)
    result = run(path, "--resolved")
    assert result.stdout.startswith(f'gateway.name = "mill-1"  # {path}:2\nline.xyz.drives.rtu = ')


@pytest.mark.parametrize("options", [["--resolved"], ["--resolved", "--json"]])
@pytest.mark.parametrize(
    ("written_in", "why"),
    [
        (f'[mqtt]\nhost = "localhost"\nusername = "mill"\npassword_file = "{SECRET}"', "it names no file"),
        (f'[mqtt]\nhost = "localhost"\npassword = "{SECRET}"', "unknown key"),
        (f'[[http.tokens]]\nname = "eva"\nfile = "{SECRET}"', "it names no file"),
        (f'[tokens]\neva = ["{SECRET}"]', "unknown key"),
        (f'[axis.x.gain]\nforward = 1.0\ntoken = "{SECRET}"', ""),
    ],
)
def test_resolved_shows_no_secret(two_files: Path, options: list[str], written_in: str, why: str) -> None:
    plant = two_files.with_name("plant.toml")
    plant.write_text(f"{written_in}\n")
    result = run(two_files, *options)
    assert result.exit_code == 1
    assert why in result.stdout
    shown = json.loads(result.stdout)["resolved"] if "--json" in options else result.stdout
    assert SECRET not in str(shown)


def test_a_file_of_a_secret_is_shown_by_its_name(two_files: Path) -> None:
    secret = two_files.with_name("secret")
    secret.write_text(SECRET)
    secret.chmod(0o600)
    two_files.with_name("plant.toml").write_text(
        '[mqtt]\nhost = "h"\nusername = "m"\npassword_file = "secret"\n'
    )
    result = run(two_files, "--resolved")
    assert 'mqtt.password_file = "secret"  # ' in result.stdout
    assert SECRET not in result.stdout
