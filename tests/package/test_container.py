"""Image and compose file: whole, and as closed as they say. No container engine is needed."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.support.programs import ran

DEPLOY = Path(__file__).parents[2] / "deploy"
ROOT = DEPLOY.parent
FILES = ("compose.yaml", "compose.serial.yaml")


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((DEPLOY / "compose.yaml").read_text())
    return found


def stages() -> list[list[tuple[str, str]]]:
    """The instructions of each stage of the Dockerfile."""
    text = re.sub(r"^#.*\n", "", (DEPLOY / "Dockerfile").read_text(), flags=re.MULTILINE).replace("\\\n", " ")
    found: list[list[tuple[str, str]]] = []
    for line in filter(None, text.splitlines()):
        instruction, _, rest = line.strip().partition(" ")
        if instruction == "FROM":
            found.append([])
        if found:  # before them stands which image they begin with
            found[-1].append((instruction, rest))
    return found


def test_both_stages_begin_with_one_image_that_one_line_pins(tmp_path: Path) -> None:
    text = (DEPLOY / "Dockerfile").read_text()
    assert [stage[0][1].split()[0] for stage in stages()] == ["${BASE}", "${BASE}"]
    assert re.findall(r"^ARG BASE=(.*)$", text, re.MULTILINE) == ["debian:bookworm-slim"]
    # The command of the comment, with a docker that knows one digest.
    (command,) = re.findall(r"^#   (base=.*)$", text, re.MULTILINE)
    (tmp_path / "deploy").mkdir()
    (tmp_path / "deploy" / "Dockerfile").write_text(text)
    digest = f"sha256:{'5' * 64}"
    subprocess.run(["bash", "-ec", f"docker() {{ echo {digest}; }}; {command}"], cwd=tmp_path, check=True)
    pinned = (tmp_path / "deploy" / "Dockerfile").read_text()
    assert re.findall(r"^ARG BASE=(.*)$", pinned, re.MULTILINE) == [f"debian:bookworm-slim@{digest}"]


def mounts(service: dict[str, Any]) -> dict[str, str]:
    """What is mounted from the host, by where it is in the container."""
    pairs = (volume.split(":") for volume in service.get("volumes", []))
    return {target: source for source, target, *_ in pairs if source.startswith((".", "/"))}


@pytest.mark.parametrize("files", [FILES[:1], FILES])
def test_compose_itself_takes_the_files(files: tuple[str, ...]) -> None:
    arguments = [part for name in files for part in ("-f", str(DEPLOY / name))]
    for command in (["docker", "compose"], ["docker-compose"]):
        if shutil.which(command[0]) is None:
            continue
        if subprocess.run([*command, "version"], capture_output=True, check=False).returncode:
            continue
        done = ran(*command, *arguments, "config", "-q")
        assert (done.returncode, done.stdout) == (0, ""), done.stderr
        return
    pytest.skip("no docker compose here (Debian: docker-compose); its files are read by the other tests only")


def test_there_is_what_the_issue_names_and_all_of_it_is_closed(compose: dict[str, Any]) -> None:
    assert set(compose["services"]) == {"network", "gateway", "mosquitto", "prometheus", "grafana"}
    for name, service in compose["services"].items():
        assert service["read_only"] is True, name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert "privileged" not in service, name
        assert "cap_add" not in service, name
        own = "networks" in service
        assert own == (name == "network")
        assert own or service["network_mode"] == "service:network", name


def test_only_modbus_and_grafana_leave_the_network(compose: dict[str, Any]) -> None:
    ports = {name: service["ports"] for name, service in compose["services"].items() if "ports" in service}
    assert ports == {"network": ["502:1502", "127.0.0.1:3000:3000"]}


def test_every_mounted_file_exists_and_every_name_is_declared(compose: dict[str, Any]) -> None:
    for name, service in compose["services"].items():
        for volume in service.get("volumes", []):
            source = volume.split(":")[0]
            if source.startswith("./"):
                assert (DEPLOY / source).exists(), volume
                assert volume.endswith(":ro"), volume
            elif not source.startswith("/"):
                assert source in compose["volumes"], (name, volume)
        for secret in service.get("secrets", []):
            assert (secret["source"] if isinstance(secret, dict) else secret) in compose["secrets"], name


def test_what_the_configurations_name_is_where_they_look(compose: dict[str, Any]) -> None:
    services = compose["services"]
    broker = mounts(services["mosquitto"]) | {each["target"]: "" for each in services["mosquitto"]["secrets"]}
    for key in ("acl_file", "password_file"):
        (path,) = re.findall(
            rf"^{key} (.*)$", (DEPLOY / "mosquitto/mosquitto.conf").read_text(), re.MULTILINE
        )
        assert path in broker
    prometheus = yaml.safe_load((DEPLOY / "monitoring/prometheus.yml").read_text())
    assert {f"/etc/prometheus/{name}" for name in prometheus["rule_files"]} <= set(
        mounts(services["prometheus"])
    )
    assert prometheus["scrape_configs"][0]["static_configs"][0]["targets"] == ["127.0.0.1:8480"]
    assert "--web.listen-address=127.0.0.1:9090" in services["prometheus"]["command"]
    provisioning = DEPLOY / "monitoring" / "grafana" / "provisioning"
    source = yaml.safe_load((provisioning / "datasources" / "pitch-gateway.yml").read_text())
    assert source["datasources"][0]["url"] == "http://127.0.0.1:9090"
    boards = yaml.safe_load((provisioning / "dashboards" / "pitch-gateway.yml").read_text())
    assert boards["providers"][0]["options"]["path"] in mounts(services["grafana"])


def test_every_copied_file_exists_and_gets_into_the_build() -> None:
    ignored = (ROOT / ".dockerignore").read_text().splitlines()
    assert ignored[0] == "*"
    let_in = {line.removeprefix("!") for line in ignored if line.startswith("!")}
    for stage in stages():
        for instruction, rest in stage:
            if instruction == "COPY" and not rest.startswith("--from"):
                for source in rest.split()[:-1]:
                    assert (ROOT / source).exists(), source
                    assert source.split("/")[0] in let_in, source


def test_the_image_runs_as_a_user_and_checks_its_health() -> None:
    build, last = stages()
    assert ("USER", "pitch-gateway") in last
    told = [instruction for instruction, _ in last]
    assert told.index("USER") < told.index("ENTRYPOINT")
    for stage in (build, last):
        for instruction, rest in stage:
            assert instruction != "ADD", rest
    assert any(
        instruction == "RUN" and "ca-certificates" in rest for instruction, rest in last
    )  # TLS of MQTT
    (health,) = [rest for instruction, rest in last if instruction == "HEALTHCHECK"]
    command = json.loads(health.partition("CMD ")[2])
    assert command == ["/opt/pitch-gateway/bin/python3", "/opt/pitch-gateway/share/healthcheck.py"]
    assert dict(last)["ENTRYPOINT"] == '["/opt/pitch-gateway/bin/pitch-gateway"]'


def test_an_adapter_that_comes_back_under_another_number_is_seen_in_the_container() -> None:
    """``devices`` are made once, by the number of that moment; the host's /dev has what comes and goes."""
    gateway = yaml.safe_load((DEPLOY / "compose.serial.yaml").read_text())["services"]["gateway"]
    assert "devices" not in gateway
    assert gateway["volumes"] == ["/dev:/dev"]
    rules = [rule.split() for rule in gateway["device_cgroup_rules"]]
    assert {number for _, number, _ in rules} == {"188:*", "166:*", "4:*", "204:*"}
    assert all((kind, may) == ("c", "rw") for kind, _, may in rules)  # character devices, and none is made
