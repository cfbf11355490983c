"""Metrics, and what the shipped monitoring makes of them."""

import json
import re
import shutil
import subprocess
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from gateway.catalogue.alarms import ALARMS
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.http.metrics import Metrics
from tests.supervisor.http.exposition import Samples, families, samples
from tests.supervisor.http.http_bench import ANSWERS, CONTROLLER, PLC, SICK, TERMS, Served, model, snapshot
from tests.support.programs import ran
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


def with_terms(**changes: Any) -> dict[str, Any]:
    return model(snapshot(axis={"terms": {**TERMS, **changes}}))


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


# ``deploy/monitoring``: what it asks for is what /metrics says, and each alert comes when it should.


FOLDER = Path(__file__).parents[3] / "deploy" / "monitoring"
RULES = yaml.safe_load((FOLDER / "alerts.yml").read_text())["groups"][0]["rules"]
DASHBOARD = json.loads((FOLDER / "grafana" / "dashboards" / "pitch-gateway.json").read_text())
PROMTOOL = shutil.which("promtool")
with_promtool = pytest.mark.skipif(PROMTOOL is None, reason="promtool (Debian: prometheus) is not installed")
EVERYWHERE = {"instance", "job"}
"""Labels that Prometheus adds."""
ILL = model(snapshot(line=SICK, axis={"terms": TERMS}))


def expressions() -> list[str]:
    targets = [target["expr"] for panel in DASHBOARD["panels"] for target in panel.get("targets", ())]
    queries = [
        variable["definition"] for variable in DASHBOARD["templating"]["list"] if variable["type"] == "query"
    ]
    return [*targets, *queries, *(rule["expr"] for rule in RULES)]


@pytest.mark.parametrize("expression", expressions())
def test_every_metric_and_label_that_is_asked_for_exists(expression: str) -> None:
    labels: dict[str, set[str]] = {}
    for name, of_sample in samples(ILL):
        labels.setdefault(name, set()).update(name for name, _ in of_sample)
    found = re.findall(r"(pitch_gateway_\w+)(?:\{([^}]*)\})?", expression)
    assert found or expression == 'up{job="pitch-gateway"} == 0'
    for name, selector in found:
        assert name in labels
        assert set(re.findall(r"(\w+)=~?\"", selector)) <= labels[name] | EVERYWHERE
    for grouped in re.findall(r"\b(?:by|on) \(([^)]*)\)", expression):
        used = set(re.split(r",\s*", grouped))
        assert used <= set().union(*(labels[name] for name, _ in found)) | EVERYWHERE


def test_every_state_that_is_asked_for_exists() -> None:
    states = {
        (name, value)
        for name, of_sample in samples(ILL)
        for label, value in of_sample
        if label in {"state", "component"}
    }
    for expression in expressions():
        for name, named in re.findall(r"(pitch_gateway_\w+)\{(?:state|component)=~?\"([^\"]+)\"", expression):
            for value in named.split("|"):
                assert (name, value) in states


def test_every_alert_says_what_to_do() -> None:
    assert len({rule["alert"] for rule in RULES}) == len(RULES)
    for rule in RULES:
        assert rule["labels"]["severity"] in {"error", "warning"}
        assert rule["annotations"]["summary"]
        assert rule["annotations"]["description"].endswith(".")
        assert re.fullmatch(r"\d+[sm]", rule["for"])


DASHBOARD_SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": ["uid", "title", "schemaVersion", "panels", "templating", "time"],
    "properties": {
        "schemaVersion": {"type": "integer", "minimum": 36},
        "panels": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["id", "type", "title", "gridPos"],
                "properties": {
                    "id": {"type": "integer"},
                    "gridPos": {
                        "type": "object",
                        "required": ["x", "y", "w", "h"],
                        "properties": {
                            "x": {"type": "integer", "minimum": 0, "maximum": 23},
                            "w": {"type": "integer", "minimum": 1, "maximum": 24},
                        },
                    },
                    "targets": {
                        "type": "array",
                        "items": {
                            "type": "object",
                            "required": ["refId", "expr", "datasource"],
                            "properties": {
                                "datasource": {"const": {"type": "prometheus", "uid": "${datasource}"}}
                            },
                        },
                    },
                },
            },
        },
    },
}


def test_the_dashboard_is_one_and_its_panels_do_not_overlap() -> None:
    Draft202012Validator(DASHBOARD_SCHEMA).validate(DASHBOARD)
    panels = DASHBOARD["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    cells: set[tuple[int, int]] = set()
    for panel in panels:
        place = panel["gridPos"]
        assert place["x"] + place["w"] <= 24
        its = {
            (place["x"] + across, place["y"] + down)
            for across in range(place["w"])
            for down in range(place["h"])
        }
        assert not its & cells, panel["title"]
        cells |= its
        assert panel["type"] == "row" or panel["description"]


def test_the_provisioning_leads_to_the_dashboard_and_to_prometheus() -> None:
    scrape = yaml.safe_load((FOLDER / "prometheus.yml").read_text())
    assert [job["job_name"] for job in scrape["scrape_configs"]] == ["pitch-gateway"]
    assert scrape["rule_files"] == ["alerts.yml"]
    sources = yaml.safe_load((FOLDER / "grafana/provisioning/datasources/pitch-gateway.yml").read_text())
    assert [(one["type"], one["url"]) for one in sources["datasources"]] == [
        ("prometheus", "http://127.0.0.1:9090")
    ]
    boards = yaml.safe_load((FOLDER / "grafana/provisioning/dashboards/pitch-gateway.yml").read_text())
    assert boards["providers"][0]["type"] == "file"


@with_promtool
@pytest.mark.parametrize(("what", "file"), [("rules", "alerts.yml"), ("config", "prometheus.yml")])
def test_promtool_takes_the_files(what: str, file: str) -> None:
    assert PROMTOOL is not None
    done = ran(PROMTOOL, "check", what, file, cwd=FOLDER)
    assert done.returncode == 0, done.stdout + done.stderr


def table(status: str) -> dict[str, Any]:
    return {"file": "x.tab", "format": "", "points": 3, "status": status, "error": "bad"}


CERTIFICATE = {
    "key": "certificate",
    "file": "/etc/page.pem",
    "subject": "CN=mill",
    "ends": "1970-01-31T00:00:00+00:00",
    "days_left": 29,
}
LATENCY = {
    "gateway_us": {"p50": 1.0, "p99": 1.0, "p999": 1.0, "max": 1.0, "max_minute": 1.0},
    "budget_us": 1000.0,
    "budget_overruns": 5,
    "is_over_budget": True,
}


SINCE_S = 1200
"""When troubles of the tests of alerts began: 20 minutes after 1970 began."""
SINCE = "1970-01-01 00:20:00 +0000 UTC"


def since_then(newest: dict[str, Any]) -> dict[str, Any]:
    instant = datetime.fromtimestamp(SINCE_S, UTC).isoformat()
    return {**newest, "troubles": [{**trouble, "since": instant} for trouble in newest["troubles"]]}


def sick(**changes: Any) -> dict[str, Any]:
    """A line that is sick in one way: parts of ``unit_ids``, ``drive`` or ``controllers`` are changed."""
    drives = {"1": {**ANSWERS, **changes.get("drive", {})}}
    unit_ids = {**SICK["unit_ids"], "heard": [1], "strangers": [], "drives": drives}
    unit_ids |= changes.get("unit_ids", {})
    controllers = [SICK["controllers"][0], *changes.get("controllers", ())]
    minute = {"exchanges": 97, "damaged": 3}
    return since_then(
        model(snapshot(line={"unit_ids": unit_ids, "controllers": controllers, "minute": minute}))
    )


SILENT = {"silent_s": 12.5, "timeouts_in_a_row": 12}
FIGHT = {"writers": ["cnc", "panel"], "since_s": 20.0, "refused": 7, "changes": 0}

CASES: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    (model(is_relay_up=False), {}, "PitchGatewayRelayDown"),
    (model(age_s=6.0), {}, "PitchGatewaySnapshotStale"),
    (model(snapshot(line={"state": "down"})), {"line": "xyz"}, "PitchGatewayLineDown"),
    (sick(drive=SILENT), {"kind": "drive-silent", "where": "axis x"}, "PitchGatewayDriveSilent"),
    (
        sick(drive={**SILENT, "damaged_in_a_row": 12}),
        {"kind": "drive-garbled", "where": "axis x"},
        "PitchGatewayDriveSilent",
    ),
    (
        sick(controllers=[PLC]),
        {"kind": "controller-garbled", "where": "line xyz, controller plc"},
        "PitchGatewayControllerGarbled",
    ),
    (
        sick(controllers=[{**CONTROLLER, "connections": [], "asked_s": 40.0}]),
        {"kind": "controller-absent", "where": "line xyz, controller cnc"},
        "PitchGatewayNoController",
    ),
    (
        since_then(model(snapshot(axis={"rivals": FIGHT}))),
        {"kind": "two-writers", "where": "axis x"},
        "PitchGatewayTwoWriters",
    ),
    (
        sick(drive={"damaged_minute": 3}),  # of 100 frames
        {"kind": "drive-damaged", "where": "line xyz, unit id 1"},
        "PitchGatewayFramesDamaged",
    ),
    (
        sick(unit_ids={"heard": [1, 17], "strangers": [17], "asked_by": {"cnc": [17]}}),
        {"kind": "unheard-controller", "where": "line xyz, controller cnc"},
        "PitchGatewayUnitIdWithoutAxis",
    ),
    (
        model(snapshot(axis={"compensation": "blocked"})),
        {"axis": "x", "state": "blocked"},
        "PitchGatewayAxisBlocked",
    ),
    (
        model(snapshot(axis={"table": table("rejected")})),
        {"axis": "x", "state": "rejected"},
        "PitchGatewayTableRejected",
    ),
    (
        since_then(model(snapshot(axis={"compensation": "off"}))),
        {"kind": "off", "where": "axis x"},
        "PitchGatewayAxisNotCorrected",
    ),
    (
        since_then(model(snapshot(axis={"compensation": "no-table"}))),
        {"kind": "no-table", "where": "axis x"},
        "PitchGatewayAxisNotCorrected",
    ),
    (
        model(snapshot(axis={"table": table("removed")})),
        {"axis": "x", "state": "removed"},
        "PitchGatewayTableRemoved",
    ),
    (
        since_then(model(snapshot(axis={"group": {"is_skewed": True, "skew": 0.5}}))),
        {"kind": "group-skewed", "where": "axis x"},
        "PitchGatewayOtherError",
    ),
    (
        since_then(model(snapshot(line={"drives": {"address": "a", "echo": "it returns"}}))),
        {"kind": "adapter-echoes", "where": "line xyz"},
        "PitchGatewayOtherError",
    ),
    (
        sick(drive={**SILENT, "other_ids_in_a_row": 12}),
        {"kind": "other-transaction-id", "where": "axis x"},
        "PitchGatewayOtherError",
    ),
    (
        since_then(model(supervisor={"state_folder": {"problem": "full"}})),
        {"kind": "state_folder", "where": "state folder"},
        "PitchGatewayOtherWarning",
    ),
    (
        since_then(model(supervisor={"http": {"problem": "taken"}})),
        {"kind": "http", "where": "http"},
        "PitchGatewayOtherWarning",
    ),
    (with_terms(thermal={**TERMS["thermal"], "is_silent": True}), {"axis": "x"}, "PitchGatewaySensorSilent"),
    (
        with_terms(cross={**TERMS["cross"], "state": "faded"}),
        {"axis": "x", "state": "faded", "term": "cross"},
        "PitchGatewayOtherAxisUnknown",
    ),
    (with_terms(is_too_large=True), {"axis": "x"}, "PitchGatewayTermsTooLarge"),
    (model(snapshot(axis={"latency": LATENCY})), {"axis": "x"}, "PitchGatewayOverBudget"),
    (model(supervisor={"mqtt": {"problem": "refused"}}), {"component": "mqtt"}, "PitchGatewayMqttDown"),
    (
        model(supervisor={"alarm_output": {"contact": "c", "problem": "silent"}}),
        {"component": "alarm_output"},
        "PitchGatewayAlarmOutputFailed",
    ),
    (
        model(supervisor={"tables_folder": {"problem": "gone"}}),
        {"component": "tables_folder"},
        "PitchGatewayConfigurationNotTaken",
    ),
    (  # promtool looks 50 minutes after 1970 began
        model(supervisor={"http": {"problem": None, "certificates": [CERTIFICATE]}}),
        {"where": "http", "key": "certificate", "file": "/etc/page.pem", "subject": "CN=mill"},
        "PitchGatewayCertificateEndsSoon",
    ),
]


def test_each_kind_of_trouble_has_an_alert_of_its_own_or_the_one_for_the_others() -> None:
    others = {rule["alert"]: rule["expr"] for rule in RULES if "kind!~" in rule["expr"]}
    assert list(others) == ["PitchGatewayOtherError", "PitchGatewayOtherWarning"]
    left_out = {expr: set(re.findall(r'kind!~"([^"]*)"', expr)[0].split("|")) for expr in others.values()}
    [named, again] = left_out.values()
    assert named == again
    selected = {
        value
        for rule in RULES
        for values in re.findall(r'(?:kind|state|component)=~?"([^"]*)"', rule["expr"])
        for value in values.split("|")
    }
    tested = {
        trouble["kind"] for newest, _, name in CASES if name not in others for trouble in newest["troubles"]
    }
    assert named <= ALARMS.keys() & (selected | tested)


def series(found: Samples, growing: dict[str, int]) -> list[dict[str, str]]:
    """Samples scraped every 5 s for an hour; counters in ``growing`` grow by so much each time."""
    listed = []
    for (name, of_sample), value in found.items():
        labels = ",".join(f"{key}={json.dumps(text)}" for key, text in (*of_sample, ("instance", "m")))
        values = f"{value:g}+{growing.get(name, 0)}x720"
        listed.append({"series": f"{name}{{{labels}}}", "values": values})
    return listed


def alerts_test(
    newest: dict[str, Any], growing: dict[str, int], firing: dict[str, dict[str, Any]]
) -> dict[str, Any]:
    rules = {rule["alert"]: rule for rule in RULES if rule["alert"] != "PitchGatewayNotScraped"}
    return {
        "interval": "5s",
        "input_series": series(samples(newest), growing),
        "alert_rule_test": [
            {
                "eval_time": "50m",
                "alertname": name,
                "exp_alerts": [
                    {
                        "exp_labels": {
                            "severity": rule["labels"]["severity"],
                            "instance": "m",
                            **firing[name],
                        },
                        "exp_annotations": {
                            key: re.sub(
                                r"\{\{ \$labels\.(\w+) \}\}",
                                lambda match: {"instance": "m", **firing[name]}[match[1]],  # noqa: B023
                                text.replace("{{ $value | humanizeTimestamp }}", SINCE),
                            )
                            for key, text in rule["annotations"].items()
                        },
                    }
                ]
                if name in firing
                else [],
            }
            for name, rule in rules.items()
        ],
    }


@with_promtool
def test_each_alert_comes_when_it_should_and_no_other(tmp_path: Path) -> None:
    assert PROMTOOL is not None
    exchanges, crc = "pitch_gateway_line_exchanges_total", "pitch_gateway_line_crc_errors_total"
    timeouts = "pitch_gateway_line_timeouts_total"
    xyz = {"line": "xyz"}
    tests = [
        alerts_test(model(), {exchanges: 10_000, crc: 9, timeouts: 9}, {}),
        alerts_test(with_terms(cross={**TERMS["cross"], "state": "held"}), {}, {}),
        alerts_test(model(), {exchanges: 10_000, crc: 11}, {"PitchGatewayCheckSumErrors": xyz}),
        alerts_test(model(), {exchanges: 10_000, timeouts: 11}, {"PitchGatewayTimeouts": xyz}),
        *(alerts_test(newest, {}, {name: labels}) for newest, labels, name in CASES),
    ]
    assert {name for _, _, name in CASES} | {
        "PitchGatewayNotScraped",
        "PitchGatewayCheckSumErrors",
        "PitchGatewayTimeouts",
    } == {rule["alert"] for rule in RULES}
    file = tmp_path / "alerts_test.yml"
    file.write_text(yaml.safe_dump({"rule_files": [str(FOLDER / "alerts.yml")], "tests": tests}))
    done = ran(PROMTOOL, "test", "rules", str(file))
    assert done.returncode == 0, done.stdout + done.stderr
