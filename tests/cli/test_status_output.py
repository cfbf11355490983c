"""What ``status`` shows on a terminal, from a status model."""

import copy
import io
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from gateway.cli.status_output import status_parts
from gateway.status.model import Model
from tests.support.status_models import model_of

CONFIG = Path("/etc/pitch gateway/mill.toml")
TOOK = {"p50": 101.26, "p99": 187.4, "p999": 493.6, "max": 495.1, "max_minute": 300.0}
NOTHING_YET = {"p50": None, "p99": None, "p999": None, "max": 0.0, "max_minute": 0.0}
X = {
    "compensation": "active",
    "units": "mm",
    "direction": "forward",
    "correction": 0.05,
    "nominal_setpoint": 50.199,
    "corrected_setpoint": 50.249,
    "nominal_actual": 50.1,
    "corrected_actual": 50.15,
    "writer": "cnc (192.168.0.9)",
    "table": {"file": "x[1].tab", "format": "", "points": 3, "status": "active", "error": None},
    "latency": {"gateway_us": TOOK, "budget_us": 1000.0, "budget_overruns": 2, "is_over_budget": True},
}
Y = {
    "compensation": "unreferenced",
    "units": "inch",
    "direction": "unknown",
    "correction": None,
    "nominal_setpoint": None,
    "corrected_setpoint": None,
    "nominal_actual": None,
    "corrected_actual": None,
    "table": {"file": None, "format": None, "points": 0, "status": "none", "error": None},
    "latency": {"gateway_us": NOTHING_YET, "budget_us": 500.0, "budget_overruns": 0, "is_over_budget": False},
}
SINCE = "2026-05-01T12:00:00+00:00"
MODEL: dict[str, Any] = {
    "gateway": {
        "name": "mill",
        "version": "1.2.3",
        "relay": "up",
        "snapshot_age_s": 0.0,
        "uptime_s": 3_725.4,
        "scheduling": {"fifo": 0, "cpus": [0, 3], "memory_locked": False},
    },
    "lines": {
        "xyz": {
            "state": "down",
            "exchanges": 1234,
            "timeouts": 0,
            "exceptions": 5,
            "refused": 0,
            "late_targets": 7,
            "late_replies": 6,
            "computed": {"cnc": {"exchange_ms": 34.154, "round_ms": 136.5, "timeout_ms": 1000.0}},
            "drives": {"address": "/dev/ttyUSB0", "failure": "[Errno 2] No such file"},
            "controllers": [
                {"name": "cnc", "role": "motion", "connections": ["a", "b"], "gateway_us": TOOK},
                {"name": "hmi", "role": "monitor", "state": "up", "failure": "", "gateway_us": NOTHING_YET},
            ],
        }
    },
    "axes": {"x": X, "y": Y},
}


def show_status(console: Console, status: Model) -> None:
    for part in status_parts(status, CONFIG):
        console.print(part)


def shown(model: dict[str, Any]) -> list[str]:
    file = io.StringIO()
    show_status(Console(file=file, width=100, highlight=False), model_of(model))
    return [" ".join(line.split()) for line in file.getvalue().splitlines()]


def test_everything_that_a_person_looks_for_stands_in_a_line_of_its_own() -> None:
    lines = shown(MODEL)
    assert lines[:2] == [
        "gateway mill 1.2.3, runs for 1 h 2 min",
        "scheduling: ordinary priority, CPUs 0, 3, memory not locked",
    ]
    # A failure is shown as it is, brackets and all.
    assert "line xyz: down, drives /dev/ttyUSB0 ([Errno 2] No such file)" in lines
    # Those that are 0 are left out, but for time-outs; what the line has not, is no 0 either.
    assert "exchanges 1234, time-outs 0, exceptions 5, late replies 6, late targets 7" in lines
    # Connections, measured microseconds, computed milliseconds.
    assert "cnc motion 2 101.3 187.4 495.1 34.15 136.50 1000" in lines
    assert "hmi monitor up – – 0.0 – – –" in lines
    assert "x active forward 50.1990 50.2490 50.1000 50.1500 mm" in lines
    assert "y unreferenced unknown – – – – inch" in lines
    # Who holds an axis, as the remedy of `second-writer` says.
    assert "x x[1].tab 3 active cnc (192.168.0.9)" in lines
    assert "y – 0 none –" in lines
    assert "x 101.3 187.4 495.1 300.0 1000 2" in lines
    assert "y – – 0.0 0.0 500 0" in lines


def test_who_came_by_certificate_and_who_was_turned_away_is_said() -> None:
    model = copy.deepcopy(MODEL)
    session = {"peer": "192.168.0.7:50000", "certified": "Fitter", "role": "motion", "subject": "CN=[panel]"}
    tls = {"handshakes": 2, "failed_handshakes": 1, "running_handshakes": 0, "sessions": [session]}
    cnc, _ = model["lines"]["xyz"]["controllers"]
    cnc |= {"refused_connections": 3, "tls": tls}
    lines = shown(model)
    assert "cnc by role 2 101.3 187.4 495.1 34.15 136.50 1000" in lines
    assert "cnc: TLS with 192.168.0.7:50000, CN=[panel], Fitter (motion)" in lines
    assert "cnc: connections refused 3, handshakes failed 1" in lines
    assert not any(line.startswith("hmi:") for line in lines)


def test_a_certificate_that_ends_soon_is_said() -> None:
    model = copy.deepcopy(MODEL)
    cnc, _ = model["lines"]["xyz"]["controllers"]
    ends = "2026-04-10T12:00:00+00:00"
    files = [("[a].pem", ends, 29), ("b.pem", ends, 30), ("c.pem", None, None), ("d.pem", ends, -1)]
    cnc["tls"] = {"certificates": [{"file": file, "ends": end, "days_left": n} for file, end, n in files]}
    assert [line for line in shown(model) if line.startswith("cnc: TLS")] == [
        f"cnc: TLS: [a].pem is valid until {ends}, days left: 29",
        f"cnc: TLS: d.pem is valid until {ends}, days left: -1",
    ]


def test_what_the_gateway_runs_with_is_named() -> None:
    model = copy.deepcopy(MODEL)
    model["gateway"] |= {
        "compiled": True,
        "scheduling": {"fifo": 50, "cpus": [3], "memory_locked": True},
        "uptime_s": 7.9,
    }
    assert shown(model)[:2] == [
        "gateway mill 1.2.3, compiled, runs for 7 s",
        "scheduling: real-time priority 50, CPUs 3, memory locked",
    ]


@pytest.mark.parametrize(
    ("is_closed", "word"), [(True, "closed"), (False, "open"), (None, "not known")], ids=str
)
def test_the_alarm_contact_is_shown_where_there_is_one(*, is_closed: bool | None, word: str) -> None:
    model = copy.deepcopy(MODEL)
    model["supervisor"] = {"alarm_output": {}}
    assert not [each for each in shown(model) if "contact" in each]
    model["supervisor"]["alarm_output"] = {"contact": "/dev/ttyS3, unit id 1, coil 5", "is_closed": is_closed}
    assert f"alarm contact: {word}, /dev/ttyS3, unit id 1, coil 5" in shown(model)


def test_eighty_columns_are_enough_and_no_number_is_cut() -> None:
    model = copy.deepcopy(MODEL)
    model["axes"]["x"] |= {"nominal_setpoint": -12345.67891, "corrected_actual": -12345.67891}
    file = io.StringIO()
    show_status(Console(file=file, width=80, highlight=False), model_of(model))
    assert max(map(len, file.getvalue().splitlines())) <= 80
    assert file.getvalue().count("-12345.6789") == 2
    assert "…" not in file.getvalue()


def test_what_is_added_to_a_table_is_shown_where_there_is_something() -> None:
    assert not any("temperature" in line for line in shown(MODEL))
    model = copy.deepcopy(MODEL)
    thermal = {"state": "held", "celsius": 29.96, "age_s": 70.0, "difference": 9.5}
    cross = {"state": "following", "axes": ["y"], "correction": 0.04}
    model["axes"]["x"]["terms"] = {"correction": -0.0523, "thermal": thermal, "cross": cross}
    lines = shown(model)
    assert "axis added temperature counts sensor other axes" in lines
    assert "x -0.0523 30.0 °C +9.50 K held y: following" in lines


def test_what_is_wrong_comes_first_with_what_to_do() -> None:
    troubles = [
        {
            "kind": "table-rejected",
            "severity": "error",
            "where": "axis x",
            "what": "x[1].tab:3: no number",
            "remedy": "mend it",
        },
        {
            "kind": "off",
            "severity": "warning",
            "where": "axis y",
            "what": "off",
            "remedy": "run `enable CONFIG AXIS`",
            "axes": ["y"],
        },
    ]
    lines = shown({**MODEL, "troubles": troubles})
    assert lines[:6] == [
        "error axis x: x[1].tab:3: no number",
        "→ mend it",
        "warning axis y: off",
        "→ run `enable '/etc/pitch gateway/mill.toml' y`",  # as a shell needs it
        "",
        "gateway mill 1.2.3, runs for 1 h 2 min",
    ]


def test_a_gateway_whose_relay_is_away_says_how_old_the_rest_is() -> None:
    gone = copy.deepcopy(MODEL)
    gone["gateway"] |= {"relay": "down", "snapshot_age_s": 61.0}
    assert shown(gone)[0] == "gateway mill 1.2.3, its relay is not running; the data below is 1 min 1 s old"
    never = {
        "gateway": {
            "name": "mill",
            "version": "1.2.3",
            "relay": "down",
            "snapshot_age_s": None,
            "uptime_s": None,
        },
        "lines": {},
        "axes": {},
    }
    assert shown(never) == ["gateway mill 1.2.3, its relay is not running"]


def test_an_axis_whose_drive_is_silent_says_that_and_where_it_was_seen_last() -> None:
    model = copy.deepcopy(MODEL)
    last = {"of": "last-reading", "nominal": 49.5, "corrected": 49.55, "age_s": 75.2, "is_at_least": False}
    silent = {"state": "error", "kind": "drive-silent", "title": "Drive silent", "since": SINCE}
    model["axes"]["x"] |= {"verdict": silent, "position": last}
    shown = io.StringIO()
    show_status(Console(file=shown, width=200), model_of(model))
    [row] = [
        line for line in shown.getvalue().splitlines() if line.split()[:1] == ["x"] and "forward" in line
    ]
    assert row.split() == [
        *("x", "Drive", "silent", "forward", "50.1990", "50.2490"),
        *("49.5000", "49.5500", "mm"),
    ]
    assert "  x: its position was last read 1 min 15 s ago" in shown.getvalue().splitlines()


def test_a_target_that_nobody_reads_is_dim_with_its_age() -> None:
    model = copy.deepcopy(MODEL)
    unread = {"nominal_actual": None, "corrected_actual": None}
    target = {"of": "target", "nominal": 50.199, "corrected": 50.249, "age_s": 40.2, "is_at_least": True}
    model["axes"]["x"] |= {**unread, "position": target}
    file = io.StringIO()
    show_status(Console(file=file, width=200, force_terminal=True, color_system="standard"), model_of(model))
    dim = "\x1b[2m"
    lines = file.getvalue().splitlines()
    [row] = [line for line in lines if "50.1990" in line]
    assert f"{dim}50.1990" in row
    assert f"{dim}50.2490" in row
    age = "x: its position was not read since its target was written more than 40 s ago"
    assert f"  {dim}{age}\x1b[0m" in lines


def test_a_gain_stands_beside_the_table_if_not_all_of_it_is_applied() -> None:
    half = copy.deepcopy(MODEL)
    half["axes"]["x"]["gain"] = {"forward": 0.0, "backward": 0.5}
    half["axes"]["y"]["gain"] = {"forward": 0.0, "backward": 0.0}
    lines = shown(half)
    assert "x x[1].tab 3 active, gain 0 forward, 0.5 backward cnc (192.168.0.9)" in lines
    assert "y – 0 none, gain 0 –" in lines
    assert not [line for line in shown(MODEL) if "gain" in line]


def test_the_verdict_stands_on_top_in_one_word_with_since_when() -> None:
    then = datetime(2026, 5, 1, 12, tzinfo=UTC).astimezone()
    well = {"state": "healthy", "since": SINCE, "errors": 0, "warnings": 0}
    lines = shown({**MODEL, "verdict": well, "troubles": []})
    assert lines[:3] == [
        f"HEALTHY since {then:%Y-%m-%d %H:%M:%S}",
        "",
        "gateway mill 1.2.3, runs for 1 h 2 min",
    ]
    ill = {"state": "error", "since": SINCE, "errors": 1, "warnings": 2}
    assert shown({**MODEL, "verdict": ill})[0] == (
        f"ERROR since {then:%Y-%m-%d %H:%M:%S}: 1 error, 2 warnings"
    )


def test_a_trouble_says_since_when_and_who_has_seen_it() -> None:
    model = copy.deepcopy(MODEL)
    model["troubles"] = [
        {
            "severity": "error",
            "where": "axis x",
            "what": "its drive (unit id 1) has not answered for 12 s",
            "remedy": "check power",
            "since": "2026-05-01T12:00:00+00:00",
            "acknowledged": {"by": "shift", "at": "2026-05-01T12:00:00+00:00"},
        }
    ]
    shown = io.StringIO()
    show_status(Console(file=shown, width=200), model_of(model))
    first, second, third = shown.getvalue().splitlines()[:3]
    assert first == "error axis x: its drive (unit id 1) has not answered for 12 s"
    then = datetime(2026, 5, 1, 12, tzinfo=UTC).astimezone()
    assert second == f"  since {then:%Y-%m-%d %H:%M:%S} → check power"
    assert third == f"  acknowledged by shift, {then:%Y-%m-%d %H:%M:%S}"


def test_headings_stay_whole_on_eighty_columns_beside_long_times() -> None:
    """A gateway that took 10.9537 ms, before a controller of which six rounds take six time-outs."""
    model = copy.deepcopy(MODEL)
    line = model["lines"]["xyz"]
    line["controllers"][0] |= {"gateway_us": {"p50": 194.72, "p99": 10_001.4, "max": 10_953.7}}
    line["controllers"][0]["name"] = "controller"
    line["computed"] = {"controller": {"exchange_ms": 1000.0, "round_ms": 6000.0, "timeout_ms": 1000.0}}
    line["controllers"][1].pop("state")
    line["controllers"][1]["connections"] = []
    file = io.StringIO()
    show_status(Console(file=file, width=80, highlight=False), model_of(model))
    words = file.getvalue().split()
    assert {"connected", "controller", "exchange", "time-out"} <= set(words)
    # Of a time from 1 ms on, tenths of a µs say nothing.
    assert {"194.7", "10001", "10954"} <= set(words)


def test_names_and_numbers_stay_whole_on_eighty_columns() -> None:
    model = copy.deepcopy(MODEL)
    model["lines"]["xyz"]["controllers"][0]["name"] = "controller-mill"
    far = {"nominal_setpoint": -1250.199, "corrected_setpoint": -1250.249, "corrected_actual": -1250.15}
    model["axes"] = {"crossbeam-left": X | far | {"compensation": "unreferenced"}}
    file = io.StringIO()
    show_status(Console(file=file, width=80, highlight=False), model_of(model))
    words = file.getvalue().split()
    assert words.count("controller-mill") == 1
    assert words.count("crossbeam-left") == 3
    assert {"-1250.1990", "-1250.2490", "-1250.1500"} <= set(words)
    assert "…" not in file.getvalue()
