"""Metrics of Prometheus."""

import re
import shutil
import subprocess
import time

import pytest

from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.http.metrics import Metrics
from tests.supervisor.http.exposition import Samples, families, samples
from tests.supervisor.http.http_bench import SICK, TERMS, Served, model, snapshot, with_terms
from tests.support.status_models import model_of


def of(found: Samples, metric: str, /, **labels: str) -> float:
    return found[f"pitch_gateway_{metric}", tuple(sorted(labels.items()))]


@pytest.mark.parametrize(
    "accept", ["", "application/openmetrics-text;version=1.0.0", "text/plain;version=0.0.4"]
)
def test_every_number_stands_under_its_name(accept: str) -> None:
    found = samples(model(), accept)
    assert of(found, "info", name="mill-1", version="0.1.0", compiled="false") == 1
    assert of(found, "relay_up") == 1
    assert of(found, "snapshot_age_seconds") == 0.1
    assert of(found, "relay_uptime_seconds") == 12.5
    assert of(found, "line_up", line="xyz") == 1
    assert of(found, "line_exchanges_total", line="xyz") == 7
    assert of(found, "line_timeouts_total", line="xyz") == 1
    assert of(found, "line_refused_total", line="xyz") == 2
    assert of(found, "line_crc_errors_total", line="xyz") == 3
    assert of(found, "line_wire_seconds_total", line="xyz") == 1.5
    assert of(found, "line_added_frames_seconds_total", line="xyz") == 0.25
    assert of(found, "controller_connections", line="xyz", controller="cnc") == 2
    assert of(found, "axis_position", axis="x", units="mm", frame="nominal", of="setpoint") == 50.0
    assert of(found, "axis_position", axis="x", units="mm", frame="corrected", of="setpoint") == 50.05
    assert of(found, "axis_position", axis="x", units="mm", frame="nominal", of="actual") == 49.0
    assert of(found, "axis_correction", axis="x", units="mm") == 0.05
    assert of(found, "axis_gain_ratio", axis="x", direction="backward") == 0.5
    assert of(found, "axis_direction", axis="x", direction="forward") == 1
    assert of(found, "axis_table_loaded_timestamp_seconds", axis="x") == 1_000_000_000.25
    assert of(found, "axis_table_info", axis="x", file="x.tab", format="centroid-3", sha256="ab") == 1
    assert of(found, "axis_latency_budget_seconds", axis="x") == 0.001
    assert of(found, "axis_over_budget", axis="x") == 0
    assert of(found, "axis_budget_overruns_total", axis="x") == 5
    assert of(found, "axis_latency_max_seconds", axis="x") == 0.00012
    assert of(found, "axis_latency_minute_max_seconds", axis="x") == 0.00006
    # What nobody knows is not there, rather than 0.
    assert not [
        key
        for key in found
        if key[0] == "pitch_gateway_axis_position"
        and ("frame", "corrected") in key[1]
        and ("of", "actual") in key[1]
    ]


def test_latency_has_the_buckets_of_the_relay_in_seconds() -> None:
    found = samples(model())
    buckets = {
        labels: value
        for (name, labels), value in found.items()
        if name == "pitch_gateway_line_latency_seconds_bucket"
    }
    assert {dict(labels)["le"]: value for labels, value in buckets.items()} == {
        "5e-06": 1,
        "1e-05": 4,
        "0.0001": 6,
        "0.001": 7,
        "+Inf": 7,
    }
    assert of(found, "axis_latency_seconds_bucket", axis="x", le="+Inf") == 4


def test_before_the_first_figures_there_is_no_histogram() -> None:
    took = {"p50": None, "p99": None, "p999": None, "max": 0.0, "max_minute": 0.0}
    found = samples(model(snapshot(line={"gateway_us": took})))
    assert not [key for key in found if key[0] == "pitch_gateway_line_latency_seconds_bucket"]
    assert of(found, "line_latency_max_seconds", line="xyz") == 0.0


def test_states_are_one_where_the_axis_is_and_zero_elsewhere() -> None:
    found = samples(model(snapshot(axis={"compensation": "blocked", "direction": "unsure"})))
    states = {
        dict(labels)["state"]: value
        for (name, labels), value in found.items()
        if name == "pitch_gateway_axis_compensation"
    }
    assert states == {
        "active": 0,
        "blending": 0,
        "shadow": 0,
        "off": 0,
        "unreferenced": 0,
        "no-table": 0,
        "outside": 0,
        "blocked": 1,
    }
    assert of(found, "axis_direction", axis="x", direction="forward") == 0
    assert of(found, "axis_direction", axis="x", direction="unsure") == 1


def of_terms(found: Samples) -> set[str]:
    return {name for name, _ in found if "_axis_term" in name or "_temperature_" in name}


@pytest.mark.parametrize("accept", ["", "application/openmetrics-text;version=1.0.0"])
def test_terms_have_what_each_added_and_how_well_it_is_known(accept: str) -> None:
    found = samples(with_terms(), accept)
    assert of(found, "axis_temperature_celsius", axis="x") == 30.5
    assert of(found, "axis_temperature_age_seconds", axis="x") == 1.35  # the report is 0.1 s old
    assert of(found, "axis_temperature_difference_kelvin", axis="x") == 10.0
    assert of(found, "axis_temperature_silent", axis="x") == 0
    assert of(found, "axis_term_correction", axis="x", units="mm", term="thermal") == -0.0575
    assert of(found, "axis_term_correction", axis="x", units="mm", term="cross") == 0.04
    assert of(found, "axis_terms_too_large", axis="x") == 0
    states = {
        (labels["term"], labels["state"]): value
        for (name, pairs), value in found.items()
        if name == "pitch_gateway_axis_term_state" and (labels := dict(pairs))
    }
    words = ("waiting", "following", "held", "fading", "faded")
    assert states == {(t, word): float(word == "following") for t in ("thermal", "cross") for word in words}


def test_what_is_not_known_of_a_term_is_left_out_and_what_is_wrong_is_one() -> None:
    unheard = {
        "state": "waiting",
        "celsius": None,
        "age_s": None,
        "difference": 0.0,
        "correction": None,
        "is_silent": True,
    }
    lost = {"state": "faded", "axes": ["y"], "correction": None}
    found = samples(with_terms(correction=None, is_too_large=True, thermal=unheard, cross=lost))
    assert of_terms(found) == {
        "pitch_gateway_axis_temperature_difference_kelvin",
        "pitch_gateway_axis_temperature_silent",
        "pitch_gateway_axis_term_state",
        "pitch_gateway_axis_terms_too_large",
    }
    assert of(found, "axis_temperature_silent", axis="x") == 1
    assert of(found, "axis_term_state", axis="x", term="cross", state="faded") == 1
    assert of(found, "axis_terms_too_large", axis="x") == 1


def test_only_a_term_that_is_there_is_shown() -> None:
    found = samples(model(snapshot(axis={"terms": {k: v for k, v in TERMS.items() if k != "thermal"}})))
    assert of_terms(found) == {
        "pitch_gateway_axis_term_correction",
        "pitch_gateway_axis_term_state",
        "pitch_gateway_axis_terms_too_large",
    }
    assert {dict(labels).get("term") for name, labels in found if "_axis_term_" in name} == {"cross"}


def test_without_terms_there_is_not_even_a_name() -> None:
    assert not [family.name for family in families(model()) if "term" in family.name or "temp" in family.name]
    none = families(model(snapshot(axis={"terms": None})))
    assert [family.name for family in none] == [family.name for family in families(model())]


def test_troubles_are_counted_and_named() -> None:
    well = samples(model())
    assert (of(well, "troubles", severity="error"), of(well, "troubles", severity="warning")) == (0, 0)
    ill = samples(model(snapshot(line={"state": "down"}), supervisor={"mqtt": {"problem": "refused"}}))
    assert (of(ill, "troubles", severity="error"), of(ill, "troubles", severity="warning")) == (1, 1)
    assert of(ill, "trouble", kind="line-down", severity="error", where="line xyz") == 1
    since_s = of(ill, "trouble_since_timestamp_seconds", kind="line-down", severity="error", where="line xyz")
    assert time.time() - since_s < 60.0
    gone = samples(model(snapshot(line={"state": "down"}), is_relay_up=False))
    assert (of(gone, "relay_up"), of(gone, "troubles", severity="error")) == (0, 1)  # the line is not known
    assert of(ill, "component_ok", component="mqtt") == 0
    assert of(ill, "component_ok", component="http") == 1


def test_each_drive_and_each_serial_port_says_how_well_it_is_heard() -> None:
    found = samples(model(snapshot(line=SICK)))
    x, stranger = {"line": "xyz", "unit_id": "1", "axes": "x"}, {"line": "xyz", "unit_id": "17", "axes": ""}
    assert (of(found, "drive_answers", **x), of(found, "drive_answers", **stranger)) == (0, 1)
    assert (of(found, "drive_silent_seconds", **x), of(found, "drive_silent_seconds", **stranger)) == (
        12.5,
        0,
    )
    assert of(found, "drive_timeouts_in_a_row", **x) == 12
    assert of(found, "drive_damaged_total", **x) == 3
    plc = {"line": "xyz", "controller": "plc"}
    assert of(found, "controller_frames_total", **plc) == 0
    assert of(found, "controller_damaged_frames_total", **plc) == 12


def test_a_line_that_cuts_through_says_what_was_stored_and_spoilt_and_why() -> None:
    requests = {"cut_through": 90, "gain_us": 8, "stored": {"kept": 7, "stalled": 1}, "spoilt": {"bad": 2}}
    replies = {"cut_through": 80, "gain_us": 5, "stored": {"kept": 17}, "spoilt": {}}
    cuts = {"requests": requests, "replies": replies, "torn": 3}
    found = samples(model(snapshot(line={"cut_through": cuts})))
    assert of(found, "line_frames_cut_through_total", line="xyz", frames="requests") == 90
    assert of(found, "line_frames_cut_through_total", line="xyz", frames="replies") == 80
    assert of(found, "line_frames_stored_total", line="xyz", frames="requests", why="kept") == 7
    assert of(found, "line_frames_stored_total", line="xyz", frames="requests", why="stalled") == 1
    assert of(found, "line_frames_stored_total", line="xyz", frames="replies", why="kept") == 17
    assert of(found, "line_frames_spoilt_total", line="xyz", frames="requests", why="bad") == 2
    assert of(found, "line_frames_torn_total", line="xyz") == 3
    assert len([key for key in found if key[0].startswith("pitch_gateway_line_frames_")]) == 7
    assert not [key for key in samples(model()) if key[0].startswith("pitch_gateway_line_frames_")]


def test_names_are_as_prometheus_wants_them() -> None:
    found = families(with_terms())
    assert len(found) > 37
    for family in found:
        assert family.name.startswith("pitch_gateway")
        assert family.documentation.endswith(".")
        assert not family.name.endswith(("_us", "_ms", "_total", "_count", "_sum"))
        if family.type == "counter":
            assert {sample.name for sample in family.samples} <= {f"{family.name}_total"}


PAST = re.compile(
    r"(_total|_bucket|_max_seconds|_info|_budget_seconds|_points|_timestamp_seconds"
    r"|_verdict|axis_table_state|component_ok|troubles?|relay_up|_age_seconds|relay_uptime_seconds)$"
)
"""Names of what stays true, or is the supervisor's own."""


@pytest.mark.parametrize("is_relay_up", [True, False])
def test_the_present_of_a_relay_that_reports_nothing_is_not_known(is_relay_up: bool) -> None:
    ill = snapshot(line=SICK, axis={"terms": TERMS})
    found = samples(model(ill, is_relay_up=is_relay_up, age_s=60.0))
    names = {name for name, _ in found if not PAST.search(name) or "minute_max" in name}
    names -= {"pitch_gateway_axis_temperature_age_seconds"}
    assert names == (set() if is_relay_up else {"pitch_gateway_line_up"})
    assert "pitch_gateway_axis_temperature_age_seconds" not in {name for name, _ in found}
    if not is_relay_up:
        assert of(found, "line_up", line="xyz") == 0
    assert of(found, "line_exchanges_total", line="xyz") == 7


def test_without_a_model_there_is_nothing_to_say() -> None:
    assert families(None) == []


def test_a_file_name_cannot_break_the_page() -> None:
    table = {"file": 'x"\n\\.tab', "format": None, "points": 3, "status": "rejected", "error": "bad"}
    found = samples(model(snapshot(axis={"table": table})))
    assert of(found, "axis_table_info", axis="x", file='x"\n\\.tab', format="", sha256="") == 1
    assert of(found, "axis_table_state", axis="x", state="rejected") == 1


async def test_the_page_has_the_type_that_was_asked_for(showing: Served) -> None:
    plain = await showing.ask("/metrics")
    assert (plain.status, plain.headers["content-type"]) == (200, "text/plain; version=0.0.4; charset=utf-8")
    open_metrics = await showing.ask("/metrics", "GET", "Accept: application/openmetrics-text;version=1.0.0")
    assert open_metrics.headers["content-type"].startswith("application/openmetrics-text; version=1.0.0")
    assert open_metrics.body.endswith(b"# EOF\n")


@pytest.mark.parametrize(
    "accept",
    [
        "application/openmetrics-text;version=abc",
        "application/openmetrics-text;version=1.x,text/plain",
        "text/plain;version=",
        "text/plain;version=abc;escaping=what",
        "application/openmetrics-text;version=" + "9" * 5000,
    ],
)
async def test_a_version_that_is_no_number_gets_plain_text(showing: Served, accept: str) -> None:
    page = await showing.ask("/metrics", "GET", f"Accept: {accept}")
    assert (page.status, page.headers["content-type"]) == (200, "text/plain; version=0.0.4; charset=utf-8")


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool (Debian: prometheus) is not installed")
def test_promtool_finds_nothing_to_say() -> None:
    broadcast = Broadcast()
    broadcast.publish(model_of(with_terms()))
    body, _ = Metrics(broadcast).page("")
    assert b"axis_temperature_difference_kelvin" in body
    done = subprocess.run(["promtool", "check", "metrics"], input=body, capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
