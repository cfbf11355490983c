"""What ``pitch-gateway provision`` writes for others: a real mosquitto, promtool and openssl read it."""

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tests.cli.test_provision_command import made, site
from tests.supervisor.mqtt.test_mqtt_access import DEPLOY
from tests.support.mosquitto import Broker, BrokerLeftError, broker_in, mosquitto_passwd, speaking, watching
from tests.support.programs import ran

__all__ = ["site"]  # a fixture
ROOT = Path(__file__).parents[2]
PROMTOOL = shutil.which("promtool")


@pytest.fixture
def plant(site: Path) -> Path:
    """The folder of a site, with a user at its broker whom mosquitto_passwd has made."""
    plant = made(site)
    passwords = plant / "broker/pitch-gateway.passwd"
    subprocess.run([mosquitto_passwd(), "-b", passwords, "viewer", "three"], check=True, capture_output=True)
    with (plant / "broker/pitch-gateway.acl").open("a") as access:
        access.write("\nuser viewer\ntopic read pitch-gateway/#\n")
    return plant


@pytest.fixture
def broker(plant: Path, tmp_path: Path) -> Iterator[Broker]:
    text = (DEPLOY / "mosquitto.conf").read_text().replace("listener 1883 ", "listener {port} ")
    with broker_in(tmp_path, text.replace("/etc/mosquitto/", f"{plant}/broker/")) as broker:
        yield broker


def password(plant: Path, machine: str) -> str:
    return (plant / f"machines/{machine}/mqtt.password").read_text().strip()


async def test_each_machine_gets_in_and_keeps_to_its_topics(plant: Path, broker: Broker) -> None:
    heard = []
    async with watching(broker.port, "#", username="viewer", password="three") as watcher:
        for machine in ("mill-1", "mill-2"):
            async with speaking(broker.port, username=machine, password=password(plant, machine)) as client:
                for topic in ("mill-1/axis/x", "mill-2/axis/x", "mill-1/command/disable", f"{machine}/event"):
                    await client.publish(f"pitch-gateway/{topic}", machine, qos=1)
            await watcher.until(f"pitch-gateway/{machine}/event")
        heard = [(message.topic, bytes(message.payload)) for message in watcher.heard]
    assert heard == [
        ("pitch-gateway/mill-1/axis/x", b"mill-1"),
        ("pitch-gateway/mill-1/event", b"mill-1"),
        ("pitch-gateway/mill-2/axis/x", b"mill-2"),
        ("pitch-gateway/mill-2/event", b"mill-2"),
    ]


async def test_the_password_of_another_machine_is_refused(plant: Path, broker: Broker) -> None:
    with pytest.raises(BrokerLeftError, match="Not authorized"):
        async with speaking(broker.port, username="mill-1", password=password(plant, "mill-2")):
            pass


@pytest.mark.skipif(PROMTOOL is None, reason="promtool (Debian: prometheus) is not installed")
def test_prometheus_finds_the_targets_by_the_job_of_the_document(plant: Path, tmp_path: Path) -> None:
    [job] = re.findall(r"^```yaml\n(.*?)^```", (ROOT / "docs/fleet.md").read_text(), re.DOTALL | re.MULTILINE)
    config = tmp_path / "prometheus.yml"
    config.write_text(job.replace("/etc/prometheus/pitch-gateway", str(plant / "prometheus")))
    assert PROMTOOL is not None
    done = ran(PROMTOOL, "check", "config", str(config))
    assert done.returncode == 0, done.stderr
    done = ran(PROMTOOL, "check", "service-discovery", "--timeout", "1s", str(config), "pitch-gateway")
    found = [each["labels"] for each in yaml.safe_load(done.stdout)]
    first = {"machine": "mill-1", "site": "hall-2", "hall": "2", "instance": "mill-1.plant:8480"}
    assert len(found) == 2
    assert {**first, "__address__": "mill-1.plant:8480", "__scheme__": "https"}.items() <= found[0].items()


def test_prometheus_is_a_client_and_a_machine_a_server(plant: Path) -> None:
    for file, purpose, is_fit in (
        ("prometheus/client.pem", "sslclient", True),
        ("prometheus/client.pem", "sslserver", False),
        ("machines/mill-1/server.pem", "sslserver", True),
        ("machines/mill-1/server.pem", "sslclient", False),
    ):
        options = ("-x509_strict", "-CAfile", str(plant / "ca/ca.pem"), "-purpose", purpose)
        assert (ran("openssl", "verify", *options, str(plant / file)).returncode == 0) == is_fit
