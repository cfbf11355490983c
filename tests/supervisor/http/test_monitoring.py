"""``deploy/monitoring``: what it asks for is what /metrics says, and each alert comes when it should."""

import json
import re
import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from tests.supervisor.http.exposition import Samples, samples
from tests.supervisor.http.http_bench import ANSWERS, CONTROLLER, PLC, SICK, TERMS, model, snapshot
from tests.support.programs import ran

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
                                "datasource": {
                                    "const": {"type": "prometheus", "uid": "${datasource}"},
                                },
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


def with_terms(**changes: Any) -> dict[str, Any]:
    return model(snapshot(axis={"terms": {**TERMS, **changes}}))


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
        model(snapshot(axis={"compensation": "off"})),
        {"axis": "x", "state": "off"},
        "PitchGatewayAxisNotCorrected",
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
