"""``pitch-gateway init``: asks, writes, never overwrites, and says what is left to do."""

import json
import os
import pwd
import re
import socket
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from gateway.cli.app import app
from gateway.commissioning.serial_ports import serial_ports
from gateway.config.load import load
from gateway.drives import library
from tests.support.processes import COMMAND, press_ctrl_c_at_question, started

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


def good(folder: Path, *arguments: str, answers: str | None = None) -> Result:
    result = run(folder, *arguments, answers=answers)
    assert result.exit_code == 0, result.stderr
    return result


def written(folder: Path) -> dict[str, Any]:
    return tomllib.loads((folder / "gateway.toml").read_text())


def test_the_written_file_passes_the_check(tmp_path: Path) -> None:
    result = good(tmp_path, *options())
    assert "is written and good" in result.stdout
    loaded = load(tmp_path / "gateway.toml")
    (line,) = loaded.plan.lines
    (axis,) = line.axes
    assert (axis.unit_id, axis.settings.counts_per_unit, axis.compensation.value) == (3, -1000.0, "shadow")
    assert axis.referenced.value == "drive-bit"
    assert loaded.drives["x"].profile.title == "A drive of mine"


def test_serial_ports_are_set_like_the_drive_when_nothing_else_is_said(tmp_path: Path) -> None:
    run(tmp_path, *options(drives_at="/dev/ttyUSB0", controller_at="/dev/ttyUSB1", baudrate="9600"))
    line = written(tmp_path)["line"]["main"]
    assert line["drives"] == {"rtu": "/dev/ttyUSB0", "baudrate": 9600, "parity": "even", "stop_bits": 2}
    assert line["controllers"][0]["rtu"] == "/dev/ttyUSB1"
    assert line["controllers"][0]["parity"] == "even"


def test_a_device_server_is_named_by_its_scheme(tmp_path: Path) -> None:
    run(tmp_path, *options(drives_at="rtu://10.0.0.5:4001"))
    line = written(tmp_path)["line"]["main"]
    assert line["drives"] == {"rtu_over_tcp": "10.0.0.5:4001"}


@pytest.mark.parametrize("name", library.names())
def test_every_shipped_drive_gives_a_file_in_which_nothing_is_wrong(tmp_path: Path, name: str) -> None:
    result = good(tmp_path, *options(drive=name, referenced="absolute"), "--json")
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


@pytest.mark.parametrize("no", ["n", "N", "no", ""])
def test_a_no_to_the_first_question_ends_it(tmp_path: Path, no: str) -> None:
    result = run(tmp_path, *options()[1:], "--ask", answers=f"{no}\n")
    assert result.exit_code == 1
    assert "nothing was written: " in result.stderr
    assert "then start this again and answer y" in result.stderr
    assert not (tmp_path / "gateway.toml").exists()


def test_it_asks_for_everything_that_is_missing(tmp_path: Path) -> None:
    answers = (
        "y\nmill-7\nx\n./mine.toml\n127.0.0.1:5020\n127.0.0.1:1502\n"
        "7\ninch\n25400\nabsolute\n0\n12\nforward\n\nn\n"
    )
    good(tmp_path, "--ask", answers=answers)
    found = written(tmp_path)
    assert found["gateway"]["name"] == "mill-7"
    axis = found["axis"]["x"]
    assert (axis["referenced"], axis["home_approach"]) == ("absolute", "forward")
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
    good(tmp_path, *options(), "--force")
    assert "[line.main]" in target.read_text()


def test_a_drive_that_does_not_exist_is_bad_input(tmp_path: Path) -> None:
    result = run(tmp_path, *options(drive="leadshine"))
    assert result.exit_code == 1
    assert "did you mean leadshine-el7 or leadshine-pr?" in result.stderr


@pytest.mark.parametrize(
    ("changed", "said"),
    [({"units": "cm"}, '"inch" or "degree"'), ({"axis": "x]"}, "letters"), ({"unit_id": "256"}, "255")],
)
def test_words_that_are_not_allowed_are_wrong_usage(
    tmp_path: Path, changed: dict[str, str], said: str
) -> None:
    result = run(tmp_path, *options(**changed))
    assert result.exit_code == 2
    assert said in result.stderr


def test_odd_texts_stay_texts(tmp_path: Path) -> None:
    run(tmp_path, *options(table='my"table\\'))
    assert written(tmp_path)["axis"]["x"]["table"] == 'my"table\\'


def test_a_folder_that_does_not_exist_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(OWN)
    target = tmp_path / "missing" / "gateway.toml"
    drive = str(tmp_path / "mine.toml")
    result = CliRunner().invoke(app, ["init", str(target), *options(drive=drive)])
    assert result.exit_code == 1
    assert "cannot be written" in result.stderr


ANSWERS = {
    "controller": "y",
    "name": "",
    "axis": "",
    "drive": "./mine.toml",
    "drives at": "/dev/ttyUSB0",
    "format": "",
    "controller at": "127.0.0.1:1502",
    "unit id": "7",
    "units": "mm",
    "counts": "1000",
    "referenced": "",
    "travel": "0\n12",
    "home": "",
    "table": "",
    "another": "",
}


def typed(answers: dict[str, str]) -> str:
    return "".join(f"{answer}\n" for answer in answers.values())


def asked(folder: Path, wrong: dict[str, str]) -> Result:
    """Answer every question, those in ``wrong`` wrongly first."""
    given = [text for key, right in ANSWERS.items() for text in (*wrong.get(key, "").splitlines(), right)]
    return run(folder, "--ask", answers="\n".join(given) + "\n")


@pytest.mark.parametrize(
    ("question", "wrong", "said"),
    [
        ("name", "mill 1", "letters"),
        ("axis", "x]", "letters"),
        ("format", "fast", 'as in "115200 8E1"'),
        ("format", "57600 7E1", 'as in "115200 8E1"'),
        ("referenced", "always", 'allowed: "absolute"'),
        ("home", "up", 'allowed: "none"'),
        ("drive", "leadshine", "did you mean leadshine-el7 or leadshine-pr?"),
        ("drive", "./none.toml", "no such file; give the path of a drive profile"),
        ("drives at", "banana", 'found "banana"; allowed: "HOST:PORT"'),
        ("drives at", "rtu://10.0.0.5:99999", "allowed: a port from 1 to 65535"),
        ("controller at", "ttyUSB1", "or the full path of a serial port"),
        ("controller at", "/dev/ttyUSB0", "/dev/ttyUSB0 is already used by line.main.drives.rtu"),
        ("unit id", "one", 'found "one"; allowed: a whole number'),
        ("unit id", "0", "unit_id = 0 on a serial line; allowed: 1 to 255"),
        ("unit id", "300", "found 300; allowed: at least 0, at most 255"),
        ("units", "cm", 'found "cm"; allowed: "mm", "inch" or "degree"'),
        ("counts", "1,5", 'found "1,5"; allowed: a number'),
        ("counts", "0", "allowed: a number other than 0"),
        ("counts", "nan", "allowed: a finite number"),
        ("travel", "12\n0", "allowed: [lowest, highest], the first below the second"),
    ],
)
def test_a_wrong_answer_is_explained_and_asked_again(
    tmp_path: Path, question: str, wrong: str, said: str
) -> None:
    result = asked(tmp_path, {question: wrong})
    assert result.exit_code == 0, result.stderr
    assert said in result.stderr
    (line,) = load(tmp_path / "gateway.toml").plan.lines
    (axis,) = line.axes
    assert (str(line.drives), axis.unit_id, axis.settings.travel) == ("/dev/ttyUSB0", 7, (0.0, 12.0))
    assert axis.settings.counts_per_unit == 1000.0


def test_a_baud_rate_alone_leaves_the_rest_as_offered(tmp_path: Path) -> None:
    good(tmp_path, "--ask", answers=typed({**ANSWERS, "format": "38400"}))
    drives = written(tmp_path)["line"]["main"]["drives"]
    assert drives == {"rtu": "/dev/ttyUSB0", "baudrate": 38400, "parity": "even", "stop_bits": 2}


def test_a_drive_is_chosen_by_its_number_in_the_list(tmp_path: Path) -> None:
    name = "leadshine-pr"
    number = str(library.names().index(name) + 1)
    answers = {**ANSWERS, "drive": number, "referenced": "absolute"}
    result = good(tmp_path, "--ask", answers=typed(answers))
    assert re.search(rf"^ +{number}  {name} ", result.stderr, re.MULTILINE)
    assert written(tmp_path)["axis"]["x"]["drive"] == name


def test_the_drives_are_listed_above_the_question(tmp_path: Path) -> None:
    said = asked(tmp_path, {}).stderr
    above = said[: said.index("Drive (")]
    assert all(name in above for name in library.names())


def test_a_wrong_option_is_explained_and_asked_for_where_somebody_can_be_asked(tmp_path: Path) -> None:
    arguments = [part.replace("127.0.0.1:5020", "banana") for part in options()]
    result = good(tmp_path, *arguments, "--ask", answers="\n\n127.0.0.1:5020\n\n\n\n\n")
    assert '--drives-at: found "banana"' in result.stderr


def test_what_does_not_fit_together_is_said_at_once_and_can_be_mended_in_the_file(tmp_path: Path) -> None:
    # 3 000 000 mm are 3 000 000 000 counts: more than an int32 holds.
    result = run(tmp_path, "--ask", answers=typed({**ANSWERS, "travel": "0\n3e6"}))
    assert result.exit_code == 0
    assert "note: axis.x.registers.command[1]: travel ends at 3e+06 mm" in result.stderr
    assert "left to do:" in result.stdout


@pytest.mark.parametrize("answers", range(len(ANSWERS)))
def test_where_the_answers_end_nothing_is_written(tmp_path: Path, answers: int) -> None:
    given = "".join(f"{answer}\n" for answer in list(ANSWERS.values())[:answers])
    result = run(tmp_path, "--ask", answers=given)
    assert result.exit_code == 1
    assert result.stderr.endswith("stopped before all questions were answered: nothing was written\n")
    assert "Traceback" not in result.output
    assert not (tmp_path / "gateway.toml").exists()


@pytest.mark.parametrize(
    ("changed", "option"),
    [
        ({"drives_at": "banana"}, "--drives-at"),
        ({"controller_at": "127.0.0.1:5020"}, "--controller-at"),
        ({"counts_per_unit": "0"}, "--counts-per-unit"),
        ({"travel": "1 0"}, "--travel"),
        ({"referenced": "homing"}, "--referenced"),
        ({"home_approach": "up"}, "--home-approach"),
        ({"baudrate": "7"}, "--baudrate"),
        ({"parity": "mark"}, "--parity"),
        ({"stop_bits": "3"}, "--stop-bits"),
        ({"controller_baudrate": "7"}, "--controller-baudrate"),
        ({"name": "mill/1"}, "--name"),
    ],
)
def test_a_wrong_option_is_wrong_usage_where_nobody_can_be_asked(
    tmp_path: Path, changed: dict[str, str], option: str
) -> None:
    result = run(tmp_path, *options(**changed), "--no-ask")
    assert result.exit_code == 2
    assert f"Invalid value for {option}" in result.stderr
    assert not (tmp_path / "gateway.toml").exists()


def test_without_a_name_it_is_that_of_the_computer(tmp_path: Path) -> None:
    run(tmp_path, *options())
    name = written(tmp_path)["gateway"]["name"]
    assert name == re.sub("[^A-Za-z0-9_-]", "-", socket.gethostname().partition(".")[0])


def test_the_formats_of_both_sides_are_asked_for_each_and_offered_as_the_drive_is(tmp_path: Path) -> None:
    answers = {**ANSWERS, "format": "9600 8N2", "controller at": "/dev/ttyUSB1\n19200 even 1"}
    result = good(tmp_path, "--ask", answers=typed(answers))
    assert "Baud rate, parity and stop bits of the drives [57600 8E2]" in result.stderr
    assert "Baud rate, parity and stop bits of the controller [9600 8N2]" in result.stderr
    line = written(tmp_path)["line"]["main"]
    assert line["drives"] == {"rtu": "/dev/ttyUSB0", "baudrate": 9600, "parity": "none", "stop_bits": 2}
    its = {key: line["controllers"][0][key] for key in ("rtu", "baudrate", "parity", "stop_bits")}
    assert its == {"rtu": "/dev/ttyUSB1", "baudrate": 19200, "parity": "even", "stop_bits": 1}


def test_the_controllers_format_has_options_of_its_own(tmp_path: Path) -> None:
    given = options(
        drives_at="/dev/ttyUSB0",
        controller_at="/dev/ttyUSB1",
        controller_baudrate="19200",
        controller_parity="odd",
    )
    good(tmp_path, *given)
    line = written(tmp_path)["line"]["main"]
    assert (line["drives"]["baudrate"], line["drives"]["parity"]) == (57600, "even")
    controller = line["controllers"][0]
    assert (controller["baudrate"], controller["parity"], controller["stop_bits"]) == (19200, "odd", 2)


def test_serial_ports_are_found_by_the_name_that_lasts(tmp_path: Path) -> None:
    by_id, by_path = tmp_path / "by-id", tmp_path / "by-path"
    near, far = os.openpty(), os.openpty()
    for folder, name, fd in (
        (by_id, "usb-FTDI_B", near[1]),
        (by_path, "pci-1", near[1]),
        (by_path, "pci-2", far[1]),
    ):
        folder.mkdir(exist_ok=True)
        (folder / name).symlink_to(os.ttyname(fd))
    found = serial_ports((by_id, by_path))
    first, second = os.ttyname(near[1]), os.ttyname(far[1])
    for fd in (*near, *far):
        os.close(fd)
    assert [(port.path, port.device) for port in found[:2]] == [
        (str(by_id / "usb-FTDI_B"), first),
        (str(by_path / "pci-2"), second),
    ]
    assert str(found[0]) == f"{by_id}/usb-FTDI_B (now {first})"
    assert serial_ports((tmp_path / "none",)) == found[2:]


def test_it_says_what_is_asked_for_and_what_comes_next(tmp_path: Path) -> None:
    result = asked(tmp_path, {})
    assert "serial port" in result.stderr
    assert "counts per motor turn × gear / lead of the screw" in result.stderr
    assert result.stdout.splitlines()[-5:] == [
        f"{tmp_path}/gateway.toml is written and good",
        "next:",
        f"  pitch-gateway check {tmp_path}/gateway.toml",
        f"  pitch-gateway probe {tmp_path}/gateway.toml",
        f"  pitch-gateway run {tmp_path}/gateway.toml",
    ]
    assert (tmp_path / "tables").is_dir()


def test_ctrl_c_at_a_question_ends_it_with_nothing_written(tmp_path: Path) -> None:
    controlling, terminal = os.openpty()
    command = [*COMMAND, "init"]
    with started(
        command, cwd=tmp_path, stdin=terminal, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        assert process.stderr is not None
        said = b""
        while b"[y/N]" not in said:
            more = os.read(process.stderr.fileno(), 1000)
            assert more, said
            said += more
        press_ctrl_c_at_question(process.pid)
        said += process.stderr.read()
        assert process.wait(30) == 1
    os.close(controlling)
    os.close(terminal)
    assert said.endswith(b"nothing was written\n")
    assert b"Traceback" not in said
    assert list(tmp_path.iterdir()) == []


SECOND = {
    "axis": "y",
    "drive": "",
    "unit id": "8",
    "units": "",
    "counts": "-2000",
    "referenced": "",
    "travel": "-40\n0",
    "home": "",
    "table": "y.tab",
}
THIRD = {**SECOND, "axis": "z", "drive": "oriental-az", "unit id": "9", "referenced": "absolute", "table": ""}


def answered(first: dict[str, str], *further: dict[str, str]) -> str:
    """Answer for these axes, one after the other."""
    parts = [[*first.values()][:-1], *([*axis.values()] for axis in further)]
    return "".join("\ny\n".join("\n".join(part) for part in parts)) + "\nn\n"


def test_axes_are_answered_for_one_after_the_other(tmp_path: Path) -> None:
    result = good(tmp_path, "--ask", answers=answered({**ANSWERS, "home": "forward"}, SECOND, THIRD))
    left = [line for line in result.stdout.splitlines() if "gateway.toml:" in line]
    assert len(left) == 1, result.stdout
    assert "axis.y.table: there is no y.tab" in left[0]
    assert result.stderr.count("Drives at (") == 1
    assert result.stderr.count("counts per motor turn") == 1
    axes = written(tmp_path)["axis"]
    assert [(name, axis["unit_id"], axis["counts_per_unit"]) for name, axis in axes.items()] == [
        ("x", 7, 1000.0),
        ("y", 8, -2000.0),
        ("z", 9, -2000.0),
    ]
    # Enter takes what the axis before has.
    assert [axes[name]["drive"] for name in "xyz"] == ["./mine.toml", "./mine.toml", "oriental-az"]
    assert [axes[name]["referenced"] for name in "xyz"] == ["drive-bit", "drive-bit", "absolute"]
    assert [axes[name]["home_approach"] for name in "xyz"] == ["forward"] * 3
    assert [axes[name].get("table") for name in "xyz"] == [None, "y.tab", None]
    assert {axis["compensation"] for axis in axes.values()} == {"shadow"}
    # The first drive decides how the port is set: they hang on one cable.
    drives = written(tmp_path)["line"]["main"]["drives"]
    assert (drives["baudrate"], drives["parity"]) == (57600, "even")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"axis": "x\ny"}, 'found "x"; there is an axis x already'),
        ({"unit id": "7\n8"}, "found 7; axis x has this unit id: each drive needs its own"),
        ({"travel": "0\n-40\n-40\n0"}, "allowed: [lowest, highest], the first below the second"),
    ],
)
def test_what_a_further_axis_cannot_have_is_asked_again(
    tmp_path: Path, wrong: dict[str, str], said: str
) -> None:
    result = good(tmp_path, "--ask", answers=answered(ANSWERS, {**SECOND, **wrong, "table": ""}))
    assert said in result.stderr
    axes = load(tmp_path / "gateway.toml").plan.lines[0].axes
    assert [(axis.name, axis.unit_id, axis.settings.travel) for axis in axes] == [
        ("x", 7, (0.0, 12.0)),
        ("y", 8, (-40.0, 0.0)),
    ]


def further(*texts: str) -> list[str]:
    return [part for text in texts for part in ("--another-axis", text)]


def test_further_axes_are_options_too(tmp_path: Path) -> None:
    """As its help shows it; what is left out is as of the axis before."""
    given = options(home_approach="forward")
    y = "y,unit-id=4,counts-per-unit=2000,travel=-40:0"
    z = "z,unit-id=5,counts-per-unit=-1e3,travel=0:5.5,drive=oriental-az"
    z += ",referenced=absolute,home-approach=none"
    good(tmp_path, *given, *further(y, z), "--no-ask")
    (line,) = load(tmp_path / "gateway.toml").plan.lines
    assert [(a.name, a.unit_id, a.settings.counts_per_unit, a.settings.travel) for a in line.axes] == [
        ("x", 3, -1000.0, (-300.0, 0.0)),
        ("y", 4, 2000.0, (-40.0, 0.0)),
        ("z", 5, -1000.0, (0.0, 5.5)),
    ]
    axes = written(tmp_path)["axis"]
    assert [axes[name]["drive"] for name in "xyz"] == ["./mine.toml", "./mine.toml", "oriental-az"]
    assert [axes[name]["home_approach"] for name in "xyz"] == ["forward", "forward", "none"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("y", "unit-id of --another-axis y, counts-per-unit of --another-axis y, travel of --another-axis y"),
        ("y,unit=4", 'found "unit=4"; allowed: KEY=VALUE with drive, unit-id'),
        ("y,unit-id=four", 'found "unit-id=four"; allowed: a whole number'),
        ("y,travel=5", 'found "travel=5"; allowed: LOWEST:HIGHEST, as in travel=-300:0'),
        ("y,unit-id=4,unit-id=5", "unit-id is given twice"),
        ("x,unit-id=4,counts-per-unit=1,travel=0:5", "there is an axis x already"),
        ("y,unit-id=3,counts-per-unit=1,travel=0:5", "axis x has this unit id"),
        ("y,unit-id=4,counts-per-unit=0,travel=0:5", "allowed: a number other than 0"),
    ],
)
def test_a_wrong_further_axis_is_wrong_usage(tmp_path: Path, text: str, said: str) -> None:
    result = run(tmp_path, *options(), *further(text), "--no-ask")
    assert result.exit_code == 2
    assert said in " ".join(result.stderr.replace("│", " ").split())
    assert not (tmp_path / "gateway.toml").exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root writes for another user")
def test_root_is_told_to_run_it_as_the_user_whose_folder_it_is(tmp_path: Path) -> None:
    os.chown(tmp_path, pwd.getpwnam("nobody").pw_uid, -1)
    result = good(tmp_path, *options())
    assert result.stdout.splitlines()[-3:] == [
        f"  sudo -u nobody pitch-gateway {command} {tmp_path}/gateway.toml"
        for command in ("check", "probe", "run")
    ]


def test_what_check_would_warn_of_is_said_with_the_file(tmp_path: Path) -> None:
    """Two drives on one RTU line: with the time-outs of a new file one that is silent holds up the other."""
    given = options(drives_at="/dev/ttyUSB1")
    result = good(tmp_path, *given, *further("y,unit-id=4,counts-per-unit=1000,travel=-200:0"))
    (warned,) = [line for line in result.stdout.splitlines() if line.startswith("warning: ")]
    checked = CliRunner().invoke(app, ["check", str(tmp_path / "gateway.toml")])
    assert warned in checked.stderr.splitlines()
    assert "line.main.controllers[1].timeout_ms" in warned
