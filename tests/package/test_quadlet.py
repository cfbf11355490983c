"""The Podman quadlet: as closed as the compose file, and Podman's own generator takes it."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from tests.package.conftest import SYSTEMS, only_when_asked
from tools import bare_debian
from tools.bare_debian import PODMAN, TRIXIE, BareDebian

DEPLOY = Path(__file__).parents[2] / "deploy"
QUADLET = DEPLOY / "quadlet" / "pitch-gateway.container"
SERIAL = DEPLOY / "quadlet" / "pitch-gateway.container.d" / "serial.conf"
GENERATORS = ("/usr/libexec/podman/quadlet", "/usr/lib/systemd/system-generators/podman-system-generator")


def keys(path: Path) -> dict[str, list[str]]:
    """The values of each key of a unit, in their order."""
    found: dict[str, list[str]] = {}
    for key, value in re.findall(r"^([A-Za-z]+)=(.*)$", path.read_text(), re.MULTILINE):
        found.setdefault(key, []).append(value)
    return found


def test_it_is_the_container_of_the_compose_file() -> None:
    service = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"]["gateway"]
    found = keys(QUADLET)
    assert found["Image"] == [f"localhost/{service['image']}:latest"]
    assert (found["ReadOnly"], found["NoNewPrivileges"], found["DropCapability"]) == (
        ["true"],
        ["true"],
        ["all"],
    )
    state, configuration = (
        volume.replace("state:", "pitch-gateway-state:") for volume in service["volumes"][::-1]
    )
    assert found["Volume"] == [configuration, state]
    [health] = re.findall(r"CMD (\[.*healthcheck.*\])", (DEPLOY / "Dockerfile").read_text())
    assert json.loads(found["HealthCmd"][0]) == json.loads(health)


def test_it_has_the_serial_ports_of_the_compose_file() -> None:
    service = yaml.safe_load((DEPLOY / "compose.serial.yaml").read_text())["services"]["gateway"]
    found = keys(SERIAL)
    assert found["Volume"] == service["volumes"]
    assert found["GroupAdd"] == service["group_add"]
    assert (
        re.findall(r'--device-cgroup-rule "(.*?)"', " ".join(found["PodmanArgs"]))
        == (service["device_cgroup_rules"])
    )


def command_of(said: str) -> str:
    """The command that a generator has made of the quadlet."""
    [command] = re.findall(r"^ExecStart=(.*)$", said, re.MULTILINE)
    return str(command)


OPTIONS = (
    "--network host",
    "--read-only",
    "--cap-drop all",
    "--security-opt=no-new-privileges",
    "-v /etc/pitch-gateway:/etc/pitch-gateway:ro",
    "-v pitch-gateway-state:/var/lib/pitch-gateway",
    "--health-interval 10s",
)
WITH_SERIAL = ("-v /dev:/dev", '--device-cgroup-rule "c 188:* rw"', "--group-add 20")


def test_the_generator_of_this_machine_takes_it() -> None:
    generator = next(filter(shutil.which, GENERATORS), None)
    if generator is None:
        pytest.skip("there is no quadlet here (Debian 13: podman)")
    command = [generator, "-dryrun", "-no-kmsg-log"]
    environment = {"QUADLET_UNIT_DIRS": str(QUADLET.parent)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(option in command_of(done.stdout) for option in OPTIONS)


@pytest.mark.timeout(2700)
def test_the_generator_of_debian_13_takes_it() -> None:
    only_when_asked()
    if why := bare_debian.why_not():
        pytest.skip(why)
    folder = SYSTEMS / "quadlet"
    shutil.rmtree(folder, ignore_errors=True)
    try:
        debian = BareDebian(folder, TRIXIE, PODMAN)
        debian.copy_in(QUADLET.parent, "etc/containers/systemd")
        generate = f"{GENERATORS[0]} -dryrun -no-kmsg-log"
        command = command_of(debian.does(generate))
        assert [option for option in (*OPTIONS, *WITH_SERIAL) if option not in command] == []
        # A key that there is none of is what it refuses.
        debian.write(
            "etc/containers/systemd/pitch-gateway.container", QUADLET.read_text() + "[Container]\nNo=1\n"
        )
        assert "unsupported key 'No'" in debian.does(generate, expected=1)
        debian.does("rm -r /etc/containers/systemd/pitch-gateway.container.d")
        debian.copy_in(QUADLET, "etc/containers/systemd/pitch-gateway.container")
        assert not any(option in command_of(debian.does(generate)) for option in WITH_SERIAL)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
