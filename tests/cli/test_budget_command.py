"""``pitch-gateway budget``: the table, the data, the exit codes, and the worked example of the document."""

import json
import os
import pty
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from gateway.cli.app import app
from tests.config.config_bench import TWO_WAYS, edited, written
from tests.support.processes import COMMAND, started

DOCUMENT = (Path(__file__).parents[2] / "docs" / "latency.md").read_text()
SLOW = edited(
    ("baudrate = 115200", "baudrate = 9600"), ("baudrate = 38400", 'baudrate = 9600\nparity = "even"')
)
"""9600 8E1 on both sides."""


def run(path: Path, *options: str) -> Result:
    return CliRunner().invoke(app, ["budget", str(path), *options])


def data(path: Path, *options: str) -> dict[str, Any]:
    result = run(path, "--json", *options)
    assert (result.exit_code, result.stderr) == (0, "")
    said: dict[str, Any] = json.loads(result.stdout)
    return said


def test_the_table(tmp_path: Path) -> None:
    result = run(written(tmp_path, SLOW))
    assert (result.exit_code, result.stderr) == (0, "")
    lines = [line.rstrip() for line in result.stdout.splitlines()]
    assert "  drives: RTU 9600 8E1, 1145.8 µs/character" in lines
    assert "  silence before each request to them: 4.01 (the standard's)" in lines
    assert "  time that a drive takes itself: not known, 0 assumed (x)" in lines
    assert "controller cnc (motion): RTU 9600 8E1, 1145.8 µs/character, time-out 1000" in lines
    rows = [" ".join(line.split()) for line in lines]
    # 13 and 8 bytes: in 14.9, gateway 1, drives 14.9 + 9.17, out 9.17; direct 24.1; waits 34.2 of 1000 ms.
    assert "x write target 13+8 14.9 1.00 24.1 9.17 49.1 24.1 3.4 %" in rows
    # 8 and 9 bytes for the position, 8 and 7 for the state.
    assert "x read position 8+9 9.17 1.00 19.5 10.3 40.0 19.5 3.1 %" in rows
    assert "x read status 8+7 9.17 1.00 17.2 8.02 35.4 17.2 2.6 %" in rows
    # 49.125 + 39.958 + 35.375 and three silences of 4.010; without the gateway 24.0625 + 19.479 + 17.1875.
    assert "  a round of these 3: 136, that is 7.3 a second; without the gateway 72.8" in lines
    # A character is 1.1458 ms: 9 and 6 of them less 0.36, and 49.1 less both; 6 and 5; 6 and 4.
    assert "x write target 9.95 6.51 32.7" in rows
    assert "x read position 6.51 5.37 28.1" in rows
    assert "x read status 6.51 4.22 24.6" in rows
    assert "a round 97.4" in rows
    assert all(len(line) <= 80 for line in lines)
    assert "\x1b" not in result.stdout


def test_the_gap_of_the_drives_has_a_column_and_a_slow_round_its_seconds(tmp_path: Path) -> None:
    """Three exchanges of a controller on TCP, each held for 10 s less the gateway's 1 ms: 30 s."""
    text = edited(
        (
            'drives = { rtu = "/dev/serial/by-id/usb-B", baudrate = 115200, parity = "even" }',
            'drives = { tcp = "10.0.0.2:502" }\ngap_ms = 10000',
        ),
        ('rtu = "/dev/serial/by-id/usb-A"\nbaudrate = 38400', 'tcp = "127.0.0.1:1503"\ntimeout_ms = 25000'),
        ('name = "hmi"', 'name = "hmi"\ntimeout_ms = 20000'),
    )
    result = run(written(tmp_path, text))
    assert result.exit_code == 0
    lines = [line.rstrip() for line in result.stdout.splitlines()]
    rows = [" ".join(line.split()) for line in lines]
    assert "  silence before each request to them: 10000 (gap_ms)" in lines
    assert "axis exchange bytes in gateway gap drives out sum direct time-out" in rows
    # 17 and 12 bytes of TCP; 10 000 of 25 000 ms.
    assert "x write target 17+12 0 1.00 9999 0 0 10000 0 40.0 %" in rows
    assert "  a round of these 3: 30000, that is one in 30 s; without the gateway 30000" in lines
    assert all(len(line) <= 80 for line in lines)
    legs = json.loads(run(written(tmp_path, text), "--json").stdout)["lines"]["xyz"]["controllers"]["cnc"]
    assert legs["exchanges"][0]["legs_ms"]["gap"] == 9999.0
    assert legs["exchanges"][0]["timeout_share"] == 0.4


def test_the_help_says_what_is_known_of_the_drives_own_time() -> None:
    said = " ".join(CliRunner().invoke(app, ["budget", "--help"]).stdout.replace("│", " ").split())
    assert "A drive takes its response_ms; an unknown response_ms counts as 0" in said


def test_colours_only_on_a_terminal(tmp_path: Path) -> None:
    path = written(tmp_path, SLOW)
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "80"}
    environment.pop("NO_COLOR", None)
    command = [*COMMAND, "budget", str(path)]
    with started(command, stdout=theirs, env=environment) as process:
        os.close(theirs)
        shown = b""
        while True:
            try:
                part = os.read(ours, 65536)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            shown += part
        assert process.wait(60) == 0
    os.close(ours)
    assert b"\x1b[" in shown
    assert b"write target" in shown


def test_the_data(tmp_path: Path) -> None:
    said = data(written(tmp_path, SLOW))
    assert (said["ok"], said["gateway"], said["problems"], said["warnings"]) == (True, "mill-1", [], [])
    line = said["lines"]["xyz"]
    assert line["drives"] == {
        "baudrate_bd": 9600,
        "bits_per_character": 11,
        "character_us": 1145.833,
        "wire_known": True,
        "silence_ms": 4.01,
        "gap_ms": 4.01,
        "drive_gap_ms": 0.0,
        "broadcast_ms": 100.0,
    }
    assert line["drive_time_ms"] == {}
    exchange = line["controllers"]["cnc"]["exchanges"][0]
    assert exchange == {
        "axis": "x",
        "what": "write target",
        "request_bytes": 13,
        "reply_bytes": 8,
        "legs_ms": {
            "controller_to_gateway": 14.896,
            "silence_after_request": 0.0,
            "gateway": 1.0,
            "gap": 0.0,
            "gateway_to_drive": 14.896,
            "drive": 0.0,
            "drive_to_gateway": 9.167,
            "silence_after_reply": 0.0,
            "silence": 0.0,
            "gateway_to_controller": 9.167,
        },
        "total_ms": 49.125,
        "waited_ms": 34.229,
        "direct_ms": 24.062,
        "direct_waited_ms": 9.167,
        # 4 and 2 characters of 1.1458 ms and 0.3615; of 13 and 8 the rest.
        "cut_through": {
            "request_lead_ms": 4.945,
            "request_saves_ms": 9.951,
            "reply_lead_ms": 2.653,
            "reply_saves_ms": 6.514,
            "total_ms": 32.66,
            "waited_ms": 17.765,
        },
        "added_frames_ms": 23.49,
        "timeout_share": 0.0342,
    }
    assert line["controllers"]["cnc"]["round"]["total_ms"] == pytest.approx(136.49, abs=0.001)
    # Less 15, 11 and 10 characters and three times two margins of 0.3615.
    assert line["controllers"]["cnc"]["round"]["cut_through_ms"] == pytest.approx(97.408, abs=0.001)
    assert line["controllers"]["hmi"]["baudrate_bd"] is None
    assert [each["what"] for each in line["remedies"]["cnc"]] == [
        "drives at 115200 Bd",
        "cnc at 115200 Bd",
        "both at 115200 Bd",
    ]
    assert line["added_frames"] == [
        {"axis": "x", "why": "position, for the direction (M6)", "before": "write target", "hold_ms": 23.49}
    ]


def test_a_block_that_the_controller_also_reads(tmp_path: Path) -> None:
    said = data(written(tmp_path, SLOW), "--registers", "16")
    last = said["lines"]["xyz"]["controllers"]["cnc"]["exchanges"][-1]
    assert (last["what"], last["request_bytes"], last["reply_bytes"]) == ("read block", 8, 37)


def test_a_block_in_which_the_target_is_written(tmp_path: Path) -> None:
    said = data(written(tmp_path, SLOW), "--target-registers", "16")
    first = said["lines"]["xyz"]["controllers"]["cnc"]["exchanges"][0]
    assert (first["request_bytes"], first["legs_ms"]["gateway_to_drive"]) == (41, 46.979)
    [warning] = said["warnings"]
    assert warning["key"] == "line.xyz.controllers[1].timeout_ms"
    assert "give up after 50 ms" in warning["found"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--registers", "11"], "takes at most 10 registers in one frame (max_registers), not 11"),
        (["--target-registers", "11"], "takes at most 10 registers in one frame (max_registers), not 11"),
        (["--target-registers", "1"], "a target of axis x needs at least 2 registers, not 1"),
    ],
)
def test_a_block_that_the_drive_does_not_take_is_bad_input(
    tmp_path: Path, options: list[str], said: str
) -> None:
    result = run(written(tmp_path, SLOW + "max_registers = 10\n"), *options)
    assert (result.exit_code, result.stdout) == (1, "")
    assert said in result.stderr


@pytest.mark.parametrize(
    "options", [["--registers", "126"], ["--registers", "-1"], ["--target-registers", "124"]]
)
def test_a_block_that_no_frame_holds_is_wrong_usage(tmp_path: Path, options: list[str]) -> None:
    assert run(written(tmp_path, SLOW), *options).exit_code == 2


def test_a_time_out_that_cannot_be_met_is_exit_code_1_after_the_table(tmp_path: Path) -> None:
    text = SLOW.replace('name = "cnc"', 'name = "cnc"\ntimeout_ms = 30')
    path = written(tmp_path, text)
    result = run(path)
    assert result.exit_code == 1
    assert "write target" in result.stdout
    assert result.stderr.startswith(
        f"{path}:9: line.xyz.controllers[1].timeout_ms: timeout_ms = 30, but the reply"
    )
    in_data = run(path, "--json")
    said = json.loads(in_data.stdout)
    assert (in_data.exit_code, in_data.stderr, said["ok"]) == (1, "", False)
    assert [problem["line"] for problem in said["problems"]] == [9]


def test_what_is_wrong_with_a_configuration_is_said_as_by_every_command(tmp_path: Path) -> None:
    path = written(tmp_path, edited(("unit_id = 1", "unit_id = 256")))
    result = run(path)
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr == f"{path}:19: axis.x.unit_id: found 256; allowed: at least 0, at most 255\n"


def test_a_line_without_axes_says_so(tmp_path: Path) -> None:
    path = written(tmp_path, SLOW[: SLOW.index("[axis.x]")])
    assert "no axis on this line, so its frames are unknown" in run(path).stdout
    assert "read block" in run(path, "--registers", "2").stdout
    line = data(path)["lines"]["xyz"]["controllers"]["cnc"]
    assert (line["exchanges"], line["round"]["total_ms"]) == ([], 0.0)


def test_the_worked_example_of_the_document(tmp_path: Path) -> None:
    """Its configuration, run as it says, prints what it shows; its words go by the same figures."""
    [text] = re.findall(r"```toml\n(.*?)```", DOCUMENT, re.DOTALL)
    [shown] = re.findall(r"```text\n(.*?)```", DOCUMENT, re.DOTALL)
    command, *expected = shown.splitlines()
    result = run(written(tmp_path, text, {"x.tab": TWO_WAYS}), *command.split()[4:])
    assert command.startswith("$ pitch-gateway budget gateway.toml --target-registers 16")
    assert [line.rstrip() for line in result.stdout.splitlines()] == expected
    for figures in ("1.00 + 47.0 + 9.17 + 9.17 = 66.3 ms", "the 66.3 ms become 14.8 ms"):
        assert figures in DOCUMENT
    assert (
        "(1.00 gateway + 47.0 to the drive + 9.17 from the drive + 9.17 to the controller)" in result.stderr
    )
    assert "drives at 115200 Bd: from 66.3 to 14.8 ms" in result.stderr
