"""``pitch-gateway init``: asks, writes, never overwrites, and says what is left to do."""

import json
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from gateway.cli.main import app
from gateway.config.load import load
from gateway.drives import library

OWN = """\
title = "A drive of mine"
transports = ["rtu", "tcp"]
serial = { baudrate = 57600, parity = "even", stop_bits = 2 }
[registers]
command = [{ address = 0x10, type = "int32" }]
actual = [{ address = 0x20, type = "int32" }]
bits.homed = { address = 0x30, bit = 2 }
"""


def options(**changed: str | None) -> list[str]:
    given = {
        "drive": "./mine.toml",
        "drives-at": "127.0.0.1:5020",
        "controller-at": "127.0.0.1:1502",
        "unit-id": "3",
        "units": "mm",
        "counts-per-unit": "-1000",
        "travel": "-300 0",
        **{name.replace("_", "-"): value for name, value in changed.items()},
    }
    pairs = [part for name, value in given.items() if value for part in (f"--{name}", *value.split())]
    return ["--controller-compensation-off", *pairs]


def run(folder: Path, *arguments: str, answers: str | None = None) -> Result:
    (folder / "mine.toml").write_text(OWN)
    return CliRunner().invoke(app, ["init", str(folder / "gateway.toml"), *arguments], input=answers)


def test_the_written_file_passes_the_check(tmp_path: Path) -> None:
    result = run(tmp_path, *options())
    assert result.exit_code == 0, result.stderr
    assert "is written and good" in result.stdout
    loaded = load(tmp_path / "gateway.toml")
    (line,) = loaded.plan.lines
    (axis,) = line.axes
    assert (axis.unit_id, axis.settings.counts_per_unit, axis.compensation.value) == (3, -1000.0, "shadow")
    assert axis.referenced.value == "drive-bit"
    assert loaded.drives["x"].profile.title == "A drive of mine"


def test_serial_ports_are_set_like_the_drive_when_nothing_else_is_said(tmp_path: Path) -> None:
    run(tmp_path, *options(drives_at="/dev/ttyUSB0", controller_at="/dev/ttyUSB1", baudrate="9600"))
    line = tomllib.loads((tmp_path / "gateway.toml").read_text())["line"]["main"]
    assert line["drives"] == {"rtu": "/dev/ttyUSB0", "baudrate": 9600, "parity": "even", "stop_bits": 2}
    assert line["controllers"][0]["rtu"] == "/dev/ttyUSB1"
    assert line["controllers"][0]["parity"] == "even"


def test_a_device_server_is_named_by_its_scheme(tmp_path: Path) -> None:
    run(tmp_path, *options(drives_at="rtu://10.0.0.5:4001"))
    line = tomllib.loads((tmp_path / "gateway.toml").read_text())["line"]["main"]
    assert line["drives"] == {"rtu_over_tcp": "10.0.0.5:4001"}


@pytest.mark.parametrize("name", library.names())
def test_every_shipped_drive_gives_a_file_in_which_nothing_is_wrong(tmp_path: Path, name: str) -> None:
    result = run(tmp_path, *options(drive=name, referenced="absolute"), "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["left"] == []


def test_what_is_left_to_do_is_said_line_by_line(tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    result = run(tmp_path, *options(table="x.tab"))
    assert result.exit_code == 0
    assert "left to do:" in result.stdout
    assert "axis.x.table: there is no x.tab" in result.stdout


def test_without_the_word_that_the_controllers_compensation_is_off_nothing_is_written(tmp_path: Path) -> None:
    result = run(tmp_path, *options()[1:], "--no-ask")
    assert result.exit_code == 1
    assert "--controller-compensation-off" in result.stderr
    assert not (tmp_path / "gateway.toml").exists()


def test_a_no_to_the_first_question_ends_it(tmp_path: Path) -> None:
    result = run(tmp_path, *options()[1:], "--ask", answers="n\n")
    assert result.exit_code == 1
    assert "switch them off there" in result.stderr
    assert not (tmp_path / "gateway.toml").exists()


def test_it_asks_for_everything_that_is_missing(tmp_path: Path) -> None:
    answers = "y\n./mine.toml\n127.0.0.1:5020\n127.0.0.1:1502\n7\ninch\n25400\n0\n12\n\n"
    result = run(tmp_path, "--ask", answers=answers)
    assert result.exit_code == 0, result.stderr
    axis = tomllib.loads((tmp_path / "gateway.toml").read_text())["axis"]["x"]
    assert (axis["unit_id"], axis["units"], axis["counts_per_unit"]) == (7, "inch", 25400.0)
    assert axis["travel"] == [0.0, 12.0]
    assert "table" not in axis


def test_everything_that_is_missing_is_said_at_once_where_nobody_can_be_asked(tmp_path: Path) -> None:
    result = run(tmp_path, "--controller-compensation-off", "--no-ask")
    assert result.exit_code == 2
    said = " ".join(result.stderr.replace("│", " ").split())
    for option in ("--drive", "--drives-at", "--unit-id", "--counts-per-unit", "--travel", "--referenced"):
        assert option in said


def test_a_file_that_exists_is_not_overwritten_unless_that_is_asked_for(tmp_path: Path) -> None:
    target = tmp_path / "gateway.toml"
    target.write_text("# mine")
    result = run(tmp_path, *options())
    assert result.exit_code == 1
    assert "--force" in result.stderr
    assert target.read_text() == "# mine"
    assert run(tmp_path, *options(), "--force").exit_code == 0
    assert "[line.main]" in target.read_text()


def test_a_drive_that_does_not_exist_is_bad_input(tmp_path: Path) -> None:
    result = run(tmp_path, *options(drive="leadshine"))
    assert result.exit_code == 1
    assert "did you mean leadshine-el7 or leadshine-pr?" in result.stderr


@pytest.mark.parametrize(
    ("changed", "said"),
    [({"units": "cm"}, "mm, inch, degree"), ({"axis": "x]"}, "letters"), ({"unit_id": "256"}, "255")],
)
def test_words_that_are_not_allowed_are_wrong_usage(
    tmp_path: Path, changed: dict[str, str], said: str
) -> None:
    result = run(tmp_path, *options(**changed))
    assert result.exit_code == 2
    assert said in result.stderr


def test_odd_texts_stay_texts(tmp_path: Path) -> None:
    run(tmp_path, *options(table='my"table\\'))
    assert tomllib.loads((tmp_path / "gateway.toml").read_text())["axis"]["x"]["table"] == 'my"table\\'


def test_a_folder_that_does_not_exist_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(OWN)
    target = tmp_path / "missing" / "gateway.toml"
    drive = str(tmp_path / "mine.toml")
    result = CliRunner().invoke(app, ["init", str(target), *options(drive=drive)])
    assert result.exit_code == 1
    assert "cannot be written" in result.stderr
