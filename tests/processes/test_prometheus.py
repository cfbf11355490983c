"""A real Prometheus asks a whole gateway, and gets an answer to each query of each dashboard."""

import contextlib
import itertools
import json
import re
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

from gateway.exchange.commands import SetTemperature
from gateway.ipc.address import socket_path
from gateway.ipc.client import ask
from gateway.ipc.messages import Done
from tests.processes.sick_line import Client, Health, SickLine
from tests.support.certificates import Shop
from tests.support.config import tab
from tests.support.ports import free_port
from tests.support.processes import ROOT, SECONDS, eventually, started

PROMETHEUS: Final = shutil.which("prometheus")
pytestmark = pytest.mark.skipif(PROMETHEUS is None, reason="prometheus is not installed")
MONITORING: Final = ROOT / "deploy" / "monitoring"
BOARDS: Final = {
    path.stem: json.loads(path.read_text()) for path in (MONITORING / "grafana" / "dashboards").iterdir()
}
Sample = dict[str, Any]


class Prometheus:
    """The shipped configuration with two targets: a gateway, and an address where nobody listens."""

    def __init__(self, folder: Path, gateway: str) -> None:
        self.gateway, self.absent = gateway, f"127.0.0.1:{free_port()}"
        self.address = f"127.0.0.1:{free_port()}"
        shipped = yaml.safe_load((MONITORING / "prometheus.yml").read_text())
        shipped["global"] = {"scrape_interval": "1s", "evaluation_interval": "1s"}
        shipped["rule_files"] = [str(MONITORING / name) for name in shipped["rule_files"]]
        [job] = shipped["scrape_configs"]
        job["static_configs"] = [{"targets": [gateway, self.absent], "labels": {"machine": "mill-1"}}]
        self.config = folder / "prometheus.yml"
        self.config.write_text(yaml.safe_dump(shipped))
        self.data = folder / "prometheus"
        self.began_s = time.time()

    def command(self) -> list[str]:
        """What starts it."""
        assert PROMETHEUS is not None
        return [
            PROMETHEUS,
            f"--config.file={self.config}",
            f"--storage.tsdb.path={self.data}",
            f"--web.listen-address={self.address}",
            "--log.level=error",
        ]

    def get(self, path: str, **parameters: object) -> Any:
        """Return the data of an answer; a query that is wrong fails with what Prometheus says of it."""
        query = urllib.parse.urlencode(parameters)
        try:
            with urllib.request.urlopen(
                f"http://{self.address}/api/v1/{path}?{query}", timeout=SECONDS
            ) as answer:
                return json.load(answer)["data"]
        except urllib.error.HTTPError as error:
            with error:
                raise AssertionError(f"{parameters}: {error.read().decode()}") from None

    def is_there(self) -> bool:
        """Whether it answers queries: it serves before it does."""
        try:
            urllib.request.urlopen(f"http://{self.address}/-/ready", timeout=SECONDS).close()
        except (urllib.error.URLError, ConnectionError):
            return False
        return True

    def now(self, query: str) -> list[Sample]:
        """Return the samples of now, with their value under ``value``."""
        result = self.get("query", query=query)["result"]
        return [{**each["metric"], "value": float(each["value"][1])} for each in result]

    def answer(self, target: dict[str, Any], axis: str) -> list[Any]:
        """Answer a target of a panel: as of now, or since the start."""
        query = target["expr"].replace("$__rate_interval", "1m")
        query = query.replace("$instance", self.gateway).replace("$axis", axis)
        if target.get("instant"):
            return self.now(query)
        until_s = time.time()
        found = self.get("query_range", query=query, start=self.began_s, end=until_s, step=2)["result"]
        return [each for each in found if any(value != "NaN" for _, value in each["values"])]


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SickLine, Client, Prometheus]]:
    """An axis x whose drive falls silent, an axis y that is off and has a bad table file; Prometheus."""
    folder = tmp_path_factory.mktemp("plant")
    sick = SickLine(folder)
    shop = Shop(folder)
    shop.server()
    (folder / "tables" / "over-y.tab").write_text(tab(0.0, 0.01, 0.0))
    text = sick.config.read_text()
    for old, new in (
        (
            'table = "x.tab"\n',
            (
                'table = "x.tab"\ncross = [{ axis = "y", table = "over-y.tab" }]\n'
                'thermal = { alpha = 1e-5, source = { modbus = "127.0.0.1:1", address = 0 } }\n'
            ),
        ),
        ('compensation = "on"\ntable = "y.tab"\n', 'compensation = "off"\ntable = "y.tab"\n'),
        (
            'name = "panel"\n',
            (
                'name = "panel"\nroles.Viewer = { role = "monitor" }\n'
                'tls = { certificate = "server.pem", key = "server.key", clients = "ca.pem" }\n'
            ),
        ),
    ):
        assert text.count(old) == 1, text
        text = text.replace(old, new)
    sick.config.write_text(text)
    prometheus = Prometheus(folder, urllib.parse.urlsplit(sick.address).netloc)
    with (
        sick.running(),
        started(prometheus.command(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL),
        contextlib.closing(Client(sick.cnc_port)) as client,
    ):
        reply = ask(socket_path(folder / "state"), SetTemperature(axis="x", celsius=25.0))
        assert reply == Done(changed=("x",))
        targets = itertools.cycle((40_000, 50_000))

        def move() -> None:
            client.move(1, next(targets))
            client.move(2, 40_000)
            read()

        def read() -> None:
            client.read(1)
            client.read(2)

        # While its drive is silent an axis may have no target, and so nothing that was added to it.
        sick.until(
            lambda _: (
                prometheus.is_there() and len(prometheus.now("pitch_gateway_axis_term_correction")) == 2
            ),
            move,
        )
        (folder / "tables" / "y.tab").write_text("no table")
        sick.until_trouble("table-rejected", read)
        sick.drives.health[1] = Health.SILENT
        sick.until_trouble("drive-silent", read)
        yield sick, client, prometheus
    sick.close()


Plant = tuple[SickLine, Client, Prometheus]


@pytest.mark.parametrize("board", BOARDS)
def test_each_query_of_a_dashboard_has_an_answer(plant: Plant, board: str) -> None:
    _, client, prometheus = plant
    for panel in BOARDS[board]["panels"]:
        for target in panel.get("targets", ()):

            def answers(target: dict[str, Any] = target) -> dict[str, list[Any]]:
                client.read(2)
                return {axis: prometheus.answer(target, axis) for axis in ("x", "y")}

            found = eventually(answers, lambda found: any(found.values()))
            [first, *_] = next(filter(None, found.values()))
            sys.stdout.write(f"{board}, {panel['title']}: {target['expr']}\n    {first}\n")


@pytest.mark.parametrize("board", BOARDS)
def test_each_variable_of_a_dashboard_has_values(plant: Plant, board: str) -> None:
    _, _, prometheus = plant
    for variable in BOARDS[board]["templating"]["list"]:
        if variable["type"] == "query":
            found = re.fullmatch(r"label_values\((.*), (\w+)\)", variable["definition"])
            assert found
            metric, label = found.groups()
            values = prometheus.get(
                f"label/{label}/values", **{"match[]": metric.replace("$instance", prometheus.gateway)}
            )
            assert values == {"instance": [prometheus.gateway], "axis": ["x", "y"]}[label]


def panel(title: str) -> str:
    """Return the first query of a panel of the fleet."""
    [found] = [each for each in BOARDS["pitch-gateway-fleet"]["panels"] if each["title"] == title]
    query: str = found["targets"][0]["expr"]
    return query


def test_the_fleet_shows_what_is_wrong_with_each_gateway(plant: Plant) -> None:
    _, _, prometheus = plant

    def shown(title: str, *keys: str) -> list[tuple[Any, ...]]:
        return sorted(tuple(each[key] for key in keys) for each in prometheus.now(panel(title)))

    counts = {
        title: shown(title, "value") for title in ("Not reached", "Error", "Warning", "Waiting", "Healthy")
    }
    assert counts == {
        "Not reached": [(1.0,)],
        "Error": [(1.0,)],
        "Warning": [(0.0,)],
        "Waiting": [(0.0,)],
        "Healthy": [(0.0,)],
    }
    assert shown("Gateways, the worst first", "instance", "machine", "value") == sorted(
        [(prometheus.gateway, "mill-1", 3.0), (prometheus.absent, "mill-1", 4.0)]
    )
    assert shown("Axes that are not compensated", "axis", "state") == [("y", "off")]
    assert shown("Tables that differ from their file", "axis", "state", "file") == [
        ("y", "rejected", "y.tab")
    ]
    assert shown("Silent drives, the longest first", "line", "unit_id", "axes") == [("xy", "1", "x")]
    certificates = shown("Certificates, the first to end", "where", "subject", "value")
    assert [each[0] for each in certificates] == ["line xy, controller panel"] * len(certificates)
    assert all(days > 0 for _, _, days in certificates)


def test_the_alerts_see_the_silent_drive_and_the_gateway_that_is_not_there(plant: Plant) -> None:
    _, _, prometheus = plant
    found = eventually(
        lambda: prometheus.now('ALERTS{alertname=~"PitchGateway(NotScraped|DriveSilent)"}'),
        lambda found: len(found) == 2,
    )
    assert {(each["alertname"], each["instance"]) for each in found} == {
        ("PitchGatewayNotScraped", prometheus.absent),
        ("PitchGatewayDriveSilent", prometheus.gateway),
    }
