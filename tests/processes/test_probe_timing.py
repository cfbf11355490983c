"""``probe --timing`` on a line with drives that take their time."""

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.processes.sick_line import Health, SickLine
from tests.support.commands import typed


@pytest.fixture
def sick(tmp_path: Path) -> Iterator[SickLine]:
    line = SickLine(tmp_path)
    yield line
    line.close()


def test_times_are_measured_and_what_they_ask_for_is_proposed_with_its_cost(sick: SickLine) -> None:
    sick.drives.takes_s[2] = 0.02
    # No answer is late on a busy machine.
    sick.config.write_text(
        sick.config.read_text().replace("response_timeout_ms = 300", "response_timeout_ms = 900")
    )
    result = typed("probe", str(sick.config), "--timing", "--json")
    assert result.returncode == 0, result.stderr
    line = json.loads(result.stdout)["lines"]["xy"]
    x, y = line["units"]["1"], line["units"]["2"]
    assert (x["axis"], x["reads"]) == ("x", 100)
    assert (y["axis"], y["reads"]) == ("y", 100)
    assert (x["lost"], y["lost"]) == (0, 0)
    assert x["p50_ms"] < y["p50_ms"]
    assert 20.0 <= y["p50_ms"] <= y["p99_ms"] <= y["max_ms"]
    assert line["lost_with_gap_ms"] == {"0": 0}
    proposed = line["proposed"]
    assert 4.0 * y["max_ms"] <= proposed["response_timeout_ms"] <= 6.0 * y["max_ms"] + 50.0
    assert 2.0 * y["max_ms"] <= proposed["drain_ms"] <= 3.0 * y["max_ms"] + 50.0
    assert line["now"] == {
        "response_timeout_ms": 900.0,
        "drain_ms": 20.0,
        "gap_ms": 0.0,
        "silent_drive_costs_ms": 1020.0,  # the controller plc waits for 1000 ms
    }
    assert proposed["silent_drive_costs_ms"] == 1000.0 + proposed["drain_ms"]
    assert {pdu[0] for pdu in sick.drives.asked} == {3}  # nothing was written
    # A hundred reads of each, then fifty of each with no silence.
    assert len(sick.drives.asked) == 300


def test_the_silence_that_a_drive_needs_is_found(sick: SickLine) -> None:
    sick.drives.needs_silence_s = 0.0195
    sick.config.write_text(sick.config.read_text().replace("drain_ms = 20", "drain_ms = 20\ngap_ms = 30"))
    result = typed("probe", str(sick.config), "--timing")
    assert result.returncode == 0, result.stderr
    lost = [line for line in result.stdout.splitlines() if "of silence before each request" in line]
    assert [line.split()[0] for line in lost] == ["0", "1", "2", "5", "10", "20"]
    # On a busy machine a silence of 10 ms may last as long as this drive needs.
    assert all("3 answers lost" in line for line in lost[:4])
    assert "nothing lost" in lost[5]
    assert "gap_ms = 30 is configured or in the register map" in result.stdout
    assert "a silent drive makes others wait three times: " in result.stdout


def test_init_measures_and_writes_what_the_drive_asks_for(sick: SickLine, tmp_path: Path) -> None:
    profile = tmp_path / "mine.toml"
    profile.write_text(
        'title = "Mine"\n[registers]\ncommand = [{ address = 100, type = "int32" }]\n'
        'actual = [{ address = 200, type = "int32" }]\nbits.homed = { address = 300, bit = 0 }\n'
    )
    sick.drives.takes_s[1] = 0.03
    target = tmp_path / "new.toml"
    result = typed(
        *("init", str(target), "--controller-compensation-off", "--measure", "--drive", str(profile)),
        *("--drives-at", sick.drives.port.path, "--controller-at", "127.0.0.1:1502", "--unit-id", "1"),
        *("--units", "mm", "--counts-per-unit", "1000", "--travel", "0", "100", "--no-ask"),
    )
    assert result.returncode == 0, result.stderr
    (longest,) = re.findall(r"axis x, unit id 1: 100 answers, .*longest ([0-9.]+),", result.stderr)
    longest_ms = float(longest)
    line = tomllib.loads(target.read_text())["line"]["main"]
    assert longest_ms >= 30.0
    assert 4.0 * longest_ms <= line["response_timeout_ms"] <= 6.0 * longest_ms + 50.0
    assert 60 <= line["drain_ms"] < line["response_timeout_ms"]
    assert typed("check", str(target)).returncode == 0


def test_a_drive_that_does_not_answer_is_named_and_nothing_is_proposed(sick: SickLine) -> None:
    sick.drives.health[1] = Health.SILENT
    result = typed("probe", str(sick.config), "--timing")
    assert result.returncode == 1
    assert "axis x, unit id 1: no answer" in result.stdout
    assert "error: unit id 1 did not answer within response_timeout_ms = " in result.stdout
    assert "raise response_timeout_ms and measure again" in result.stdout
    assert "proposed:" not in result.stdout
