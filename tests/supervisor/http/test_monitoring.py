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

from gateway.catalogue.alarms import ALARMS
from tests.supervisor.http.exposition import Samples, samples
from tests.supervisor.http.http_bench import (
    ANSWERS,
    CONTROLLER,
    PLC,
    SICK,
    TERMS,
    model,
    snapshot,
    with_terms,
)
from tests.support.programs import ran

FOLDER = Path(__file__).parents[3] / "deploy" / "monitoring"
GROUPS = yaml.safe_load((FOLDER / "alerts.yml").read_text())["groups"]
RULES = [rule for group in GROUPS for rule in group["rules"]]
RECORDS = [
    rule
    for group in yaml.safe_load((FOLDER / "records.yml").read_text())["groups"]
    for rule in group["rules"]
]
DASHBOARDS = {
    path.name: json.loads(path.read_text()) for path in sorted((FOLDER / "grafana" / "dashboards").iterdir())
}
PROMTOOL = shutil.which("promtool")
with_promtool = pytest.mark.skipif(PROMTOOL is None, reason="promtool (Debian: prometheus) is not installed")
CERTIFICATE = {
    "key": "certificate",
    "file": "/etc/page.pem",
    "subject": "CN=mill",
    "ends": "1970-01-31T00:00:00+00:00",
    "days_left": 29,
}
EVERYWHERE = {"instance", "job"}
"""Labels that Prometheus adds."""
ILL = model(snapshot(line=SICK, axis={"terms": TERMS}), supervisor={"http": {"certificates": [CERTIFICATE]}})
NAME = r"(?:\w+:)?pitch_gateway_\w+(?::\w+)?"


def expressions() -> list[str]:
    found = []
    for dashboard in DASHBOARDS.values():
        found += [target["expr"] for panel in dashboard["panels"] for target in panel.get("targets", ())]
        variables = dashboard["templating"]["list"]
        found += [variable["definition"] for variable in variables if variable["type"] == "query"]
    return list(dict.fromkeys([*found, *(rule["expr"] for rule in (*RULES, *RECORDS))]))


def labels_of_metrics() -> dict[str, set[str]]:
    """The labels of each metric of a gateway, and of each record: those in its name."""
    labels: dict[str, set[str]] = {}
    for name, of_sample in samples(ILL):
        labels.setdefault(name, set()).update(name for name, _ in of_sample)
    for rule in RECORDS:
        labels[rule["record"]] = set(rule["record"].partition(":")[0].split("_"))
    return labels


@pytest.mark.parametrize("expression", expressions())
def test_every_metric_and_label_that_is_asked_for_exists(expression: str) -> None:
    labels = labels_of_metrics()
    found = re.findall(rf"({NAME})(?:\{{([^}}]*)\}})?", expression)
    assert found or expression == 'up{job=~"pitch-gateway.*"} == 0'
    for name, selector in found:
        assert name in labels
        assert set(re.findall(r"(\w+)!?=~?\"", selector)) <= labels[name] | EVERYWHERE
    for grouped in re.findall(r"\b(?:by|on|without|group_left) \(([^)]*)\)", expression):
        used = set(filter(None, re.split(r",\s*", grouped)))
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
    assert len({group["name"] for group in GROUPS}) == len(GROUPS) == 4
    assert len({rule["alert"] for rule in RULES}) == len(RULES)
    for rule in RULES:
        assert rule["labels"]["severity"] in {"error", "warning"}
        assert rule["annotations"]["summary"]
        assert rule["annotations"]["description"].endswith(".")
        assert re.fullmatch(r"\d+[sm]", rule["for"])


DATA_SOURCE = {"const": {"type": "prometheus", "uid": "${datasource}"}}
TARGET = {
    "type": "object",
    "required": ["refId", "expr", "legendFormat", "datasource"],
    "properties": {
        "datasource": DATA_SOURCE,
        "refId": {"pattern": "^[A-Z]$"},
        "expr": {"type": "string", "minLength": 1},
        "instant": {"type": "boolean"},
        "format": {"enum": ["table", "heatmap", "time_series"]},
    },
}
FIELD_CONFIG = {
    "type": "object",
    "required": ["defaults", "overrides"],
    "properties": {
        "overrides": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["matcher", "properties"],
                "properties": {
                    "matcher": {
                        "required": ["id", "options"],
                        "properties": {"id": {"enum": ["byName", "byRegexp"]}},
                    },
                    "properties": {"items": {"required": ["id", "value"]}, "minItems": 1},
                },
            },
        },
    },
}
PANEL = {
    "type": "object",
    "required": ["id", "type", "title", "gridPos"],
    "properties": {
        "id": {"type": "integer", "minimum": 1},
        "type": {"enum": ["row", "stat", "table", "timeseries", "state-timeline", "heatmap"]},
        "title": {"type": "string", "minLength": 1},
        "gridPos": {
            "type": "object",
            "required": ["x", "y", "w", "h"],
            "additionalProperties": False,
            "properties": {
                "x": {"type": "integer", "minimum": 0, "maximum": 23},
                "y": {"type": "integer", "minimum": 0},
                "w": {"type": "integer", "minimum": 1, "maximum": 24},
                "h": {"type": "integer", "minimum": 1},
            },
        },
        "targets": {"type": "array", "items": TARGET, "minItems": 1},
        "transformations": {"items": {"required": ["id", "options"]}},
    },
    "if": {"properties": {"type": {"const": "row"}}},
    "then": {"properties": {"gridPos": {"properties": {"x": {"const": 0}, "w": {"const": 24}}}}},
    "else": {
        "required": ["description", "datasource", "fieldConfig", "options", "targets"],
        "properties": {
            "description": {"pattern": r"\.$"},
            "datasource": DATA_SOURCE,
            "fieldConfig": FIELD_CONFIG,
        },
    },
}
DASHBOARD_SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": ["uid", "title", "description", "tags", "schemaVersion", "panels", "templating", "time"],
    "properties": {
        "uid": {"type": "string", "pattern": "^[a-zA-Z0-9_-]{1,40}$"},
        "title": {"type": "string", "minLength": 1},
        "schemaVersion": {"type": "integer", "minimum": 36},
        "id": False,  # the one that a Grafana gave it
        "panels": {"type": "array", "items": PANEL},
        "templating": {
            "properties": {
                "list": {
                    "contains": {
                        "properties": {"name": {"const": "datasource"}, "query": {"const": "prometheus"}}
                    },
                    "items": {"required": ["name", "label", "type", "query"]},
                }
            }
        },
        "time": {"required": ["from", "to"]},
    },
}
"""What Grafana reads of a dashboard, as far as these ones use it."""


@pytest.mark.parametrize("name", DASHBOARDS)
def test_a_dashboard_fits_the_schema_and_its_panels_do_not_overlap(name: str) -> None:
    dashboard = DASHBOARDS[name]
    Draft202012Validator(DASHBOARD_SCHEMA).validate(dashboard)
    panels = dashboard["panels"]
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
        letters = [target["refId"] for target in panel.get("targets", ())]
        assert len(set(letters)) == len(letters)


@pytest.mark.parametrize("name", DASHBOARDS)
def test_a_dashboard_asks_with_its_own_variables_and_formats_columns_that_it_has(name: str) -> None:
    dashboard = DASHBOARDS[name]
    variables = {variable["name"] for variable in dashboard["templating"]["list"]}
    labels = set().union(*labels_of_metrics().values())
    for panel in dashboard["panels"]:
        targets = panel.get("targets", ())
        for target in targets:
            assert set(re.findall(r"\$(\w+)", target["expr"])) <= variables | {"__rate_interval"}
        columns = labels | {target["legendFormat"] for target in targets}
        for change in panel.get("transformations", ()):
            renamed = change["options"].get("renameByName", {})
            values = {"Value", *(f"Value #{target['refId']}" for target in targets)}
            assert renamed.keys() <= labels | values
            columns |= set(renamed.values())
        for override in panel.get("fieldConfig", {}).get("overrides", ()):
            if override["matcher"]["id"] == "byName":
                assert override["matcher"]["options"] in columns, panel["title"]


def test_each_dashboard_is_one_and_leads_to_the_others() -> None:
    assert {board["uid"]: board["title"] for board in DASHBOARDS.values()} == {
        "pitch-gateway-fleet": "Pitch gateway: fleet",
        "pitch-gateway": "Pitch gateway: machine",
        "pitch-gateway-axis": "Pitch gateway: axis",
    }
    for board in DASHBOARDS.values():
        assert [link["tags"] for link in board["links"]] == [board["tags"]] == [["pitch-gateway"]]
        leads = re.findall(r'"/d/([\w-]+)\?', json.dumps(board))
        assert set(leads) <= {other["uid"] for other in DASHBOARDS.values()}


def test_the_provisioning_leads_to_the_dashboard_and_to_prometheus() -> None:
    scrape = yaml.safe_load((FOLDER / "prometheus.yml").read_text())
    assert [job["job_name"] for job in scrape["scrape_configs"]] == ["pitch-gateway"]
    assert scrape["rule_files"] == ["records.yml", "alerts.yml"]
    sources = yaml.safe_load((FOLDER / "grafana/provisioning/datasources/pitch-gateway.yml").read_text())
    assert [(one["type"], one["url"]) for one in sources["datasources"]] == [
        ("prometheus", "http://127.0.0.1:9090")
    ]
    boards = yaml.safe_load((FOLDER / "grafana/provisioning/dashboards/pitch-gateway.yml").read_text())
    assert boards["providers"][0]["type"] == "file"


@with_promtool
@pytest.mark.parametrize(
    ("what", "file"), [("rules", "records.yml"), ("rules", "alerts.yml"), ("config", "prometheus.yml")]
)
def test_promtool_takes_the_files(what: str, file: str) -> None:
    assert PROMTOOL is not None
    done = ran(PROMTOOL, "check", what, file, cwd=FOLDER)
    assert done.returncode == 0, done.stdout + done.stderr


def table(status: str) -> dict[str, Any]:
    return {"file": "x.tab", "format": "", "points": 3, "status": status, "error": "bad"}


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


def series(found: Samples, growing: dict[str, int], **target: str) -> list[dict[str, str]]:
    """Samples scraped every 5 s for an hour; counters in ``growing`` grow by so much each time."""
    listed = []
    for (name, of_sample), value in found.items():
        pairs = (*of_sample, *{"instance": "m", **target}.items())
        labels = ",".join(f"{key}={json.dumps(text)}" for key, text in pairs)
        values = f"{value:g}+{growing.get(name, 0)}x720"
        listed.append({"series": f"{name}{{{labels}}}", "values": values})
    return listed


def alerts_test(
    newest: dict[str, Any] | None, growing: dict[str, int], firing: dict[str, dict[str, Any]]
) -> dict[str, Any]:
    rules = {rule["alert"]: rule for rule in RULES}
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
        {
            **alerts_test(None, {}, {"PitchGatewayNotScraped": {"job": "pitch-gateway-network"}}),
            "input_series": [{"series": 'up{instance="m",job="pitch-gateway-network"}', "values": "0x720"}],
        },
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


def recorded(by_record: dict[str, dict[str, float]]) -> list[dict[str, Any]]:
    """What each record is after 50 minutes, by the labels of its samples."""
    return [
        {
            "expr": record,
            "eval_time": "50m",
            "exp_samples": [
                {"labels": f"{record.partition('{')[0]}{labels}", "value": value}
                for labels, value in found.items()
            ],
        }
        for record, found in by_record.items()
    ]


@with_promtool
def test_each_record_is_what_the_gateways_say_and_keeps_the_labels_of_a_target(tmp_path: Path) -> None:
    assert PROMTOOL is not None
    bad = model(
        snapshot(line=SICK, axis={"compensation": "off", "table": table("rejected")}),
        supervisor={"http": {"problem": None, "certificates": [CERTIFICATE]}},
    )
    warned = model(supervisor={"mqtt": {"problem": "refused"}})
    grows = {
        "pitch_gateway_line_exchanges_total": 8192,
        "pitch_gateway_line_timeouts_total": 16,
        "pitch_gateway_line_crc_errors_total": 8,
        "pitch_gateway_axis_latency_seconds_bucket": 1,  # each exchange took less than the first bound, 5 µs
    }
    gateways = {"bad": bad, "warned": warned, "no-relay": model(is_relay_up=False)}
    labels = {
        name: f'{{instance="{name}", job="pitch-gateway", site="hall-2"}}' for name in (*gateways, "off")
    }
    inputs = [
        {"series": f"up{of}", "values": "0x720" if name == "off" else "1x720"} for name, of in labels.items()
    ]
    for name, newest in gateways.items():
        growing = grows if name == "bad" else {}
        inputs += series(samples(newest), growing, instance=name, job="pitch-gateway", site="hall-2")
    of_line, of_axis = (
        f'{{instance="bad", job="pitch-gateway", {kind}, site="hall-2"}}'
        for kind in ('line="xyz"', 'axis="x"')
    )
    expected: dict[str, dict[str, float]] = {
        "instance:pitch_gateway_rank:max": dict(
            zip(
                (labels["bad"], labels["warned"], labels["no-relay"], labels["off"]),
                (3, 2, 3, 4),
                strict=True,
            )
        ),
        "instance:pitch_gateway_axes:count": {labels[name]: 1 for name in gateways},
        # Of the one without a relay nobody knows.
        "instance:pitch_gateway_axes_not_compensated:count": {
            labels["bad"]: 1,
            labels["warned"]: 0,
            labels["no-relay"]: 1,
        },
        "instance:pitch_gateway_tables_not_in_force:count": {
            labels["bad"]: 1,
            labels["warned"]: 0,
            labels["no-relay"]: 0,
        },
        # Of unit ids 1, axis x, and 17, another device, the first does not answer.
        "instance:pitch_gateway_drives_silent:count": {labels["bad"]: 1},
        'instance:pitch_gateway_certificate_end_timestamp_seconds:min{instance="bad"}': {
            labels["bad"]: 30 * 86400
        },
        'instance_line:pitch_gateway_line_timeouts:ratio5m{instance="bad"}': {of_line: 1 / 512},
        'instance_line:pitch_gateway_line_crc_errors:ratio5m{instance="bad"}': {of_line: 1 / 1024},
        # 99 of 100 in a bucket from 0 to 5 µs, between whose ends Prometheus draws a line.
        'instance_axis:pitch_gateway_axis_latency_seconds:p99_5m{instance="bad"}': {of_axis: 4.95e-6},
    }
    assert [query.partition("{")[0] for query in expected] == [rule["record"] for rule in RECORDS]
    test = {"interval": "5s", "input_series": inputs, "promql_expr_test": recorded(expected)}
    file = tmp_path / "records_test.yml"
    file.write_text(yaml.safe_dump({"rule_files": [str(FOLDER / "records.yml")], "tests": [test]}))
    done = ran(PROMTOOL, "test", "rules", str(file))
    assert done.returncode == 0, done.stdout + done.stderr
