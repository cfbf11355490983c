"""The Ansible role and the playbook: from bare Debians to machines with one command, and again."""

import json
import os
import re
import shutil
import subprocess
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from tests.package.conftest import SYSTEMS, only_when_asked
from tests.support.config import RAMP, tab
from tools import bare_debian
from tools.bare_debian import MANAGED, PATH, ROOT, BareDebian, Suite

FOLDER = ROOT / "deploy" / "ansible"
TOOLS = ROOT / "build" / "tools" / "ansible"
MACHINES = ("mill-1", "mill-2")
SITE = """
[site]
name = "hall-2"
files = "common"

[base.line.x]
drives = { tcp = "127.0.0.1:5020" }

[[base.line.x.controllers]]
name = "cnc"
tcp = "127.0.0.1:1502"

[base.axis.x]
line = "x"
unit_id = 1
units = "mm"
counts_per_unit = 1000.0
travel = [0.0, 100.0]
referenced = "absolute"
compensation = "on"
table = "x.tab"
registers.command = [{ address = 100, type = "int32" }]

[base.mqtt]
host = "127.0.0.1"

[machine.mill-1]

[machine.mill-2]
axis.x.max_speed = 150.0
"""
HANDLER = re.compile(r"RUNNING HANDLER \[pitch_gateway : (\w+) pitch-gateway\]")
RECAP = re.compile(r"^(\S+) +: ok=\d+ +changed=(\d+) +unreachable=0 +failed=(\d+) ", re.MULTILINE)

pytestmark = pytest.mark.timeout(2700)


def handlers(said: str) -> list[str]:
    """The handlers that ran; one that is skipped on each host has a heading too."""
    blocks = [block for block in said.split("\n\n") if re.search(r"^(changed|ok): ", block, re.MULTILINE)]
    return [name for block in blocks for name in HANDLER.findall(block)]


@dataclass(frozen=True)
class Plant:
    """A site file, the folder that is made of it, and bare systems that Ansible reaches."""

    folder: Path
    package: Path
    tools: Path

    def play(self, *options: str) -> tuple[str, dict[str, tuple[int, int]]]:
        """Run the playbook; return what it said, and how much changed and failed on each host."""
        settings = {
            "pitch_gateway_site": str(self.folder / "site.toml"),
            "pitch_gateway_out": str(self.folder / "plant"),
            "pitch_gateway_package": str(self.package),
            "ansible_host": f"{self.folder}/{{{{ inventory_hostname }}}}",
            "ansible_chroot_exe": str(self.folder / "enter"),
            "ansible_become": False,
        }
        inventories = ("-i", str(self.folder / "plant/hosts.json"), "-i", str(self.folder / "chroot.yml"))
        environment = {
            **os.environ,
            "PATH": f"{self.tools / 'bin'}:{ROOT / '.venv/bin'}:{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "ANSIBLE_NOCOLOR": "1",
            "ANSIBLE_LOCALHOST_WARNING": "0",
            "ANSIBLE_PIPELINING": "1",  # a program less for each step of a task
            "HOME": str(self.folder),
        }
        done = subprocess.run(
            [
                "ansible-playbook",
                *inventories,
                str(FOLDER / "site.yml"),
                "-e",
                json.dumps(settings),
                *options,
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            env=environment,
        )
        found = {host: (int(changed), int(failed)) for host, changed, failed in RECAP.findall(done.stdout)}
        assert found, done.stdout
        return done.stdout, found


@pytest.fixture(scope="session")
def ansible() -> Path:
    """Ansible with its collections, and what lints it, in an environment of their own."""
    only_when_asked()
    command = [str(ROOT / "tools/bootstrap.sh"), "ansible", "ansible-lint"]
    subprocess.run(command, env={**os.environ, "VENV": str(TOOLS)}, check=True, capture_output=True)
    return TOOLS


@pytest.fixture
def plant(ansible: Path, suite: Suite, package: Path, request: pytest.FixtureRequest) -> Iterator[Plant]:
    folder = SYSTEMS / request.node.name
    shutil.rmtree(folder, ignore_errors=True)
    for name in MACHINES:
        BareDebian(folder / name, suite, MANAGED)
    (folder / "common/tables").mkdir(parents=True)
    (folder / "common/tables/x.tab").write_text(RAMP)
    (folder / "site.toml").write_text(SITE)
    hosts = dict.fromkeys(MACHINES)
    settings = {
        "ansible_connection": "community.general.chroot",
        "ansible_python_interpreter": "/usr/bin/python3",
    }
    (folder / "chroot.yml").write_text(yaml.safe_dump({"all": {"hosts": hosts, "vars": settings}}))
    # community.general.chroot calls it as it calls chroot. It adds /proc and /dev; nothing is booted.
    inside = f"/usr/bin/env -i PATH={PATH} LC_ALL=C.UTF-8 HOME=/root SYSTEMD_OFFLINE=1"
    enter = folder / "enter"
    enter.write_text(
        "#!/bin/sh\nroot=$1\nshift\n"
        f"exec unshare --mount --pid --fork --kill-child sh -c '{bare_debian.ENTER}' "
        f'"$root" {inside} "$@"\n'
    )
    enter.chmod(0o755)
    yield Plant(folder, package, ansible)
    shutil.rmtree(folder)


def etc(plant: Plant, machine: str) -> Path:
    return plant.folder / machine / "etc/pitch-gateway"


def test_the_second_time_nothing_changes_and_a_change_does_what_it_needs(plant: Plant) -> None:
    said, found = plant.play()
    assert {host: failed for host, (_, failed) in found.items()} == dict.fromkeys(
        ("localhost", *MACHINES), 0
    ), said
    assert all(changed > 0 for changed, _ in found.values())
    assert handlers(said) == ["Restart"]
    for machine in MACHINES:
        config = tomllib.loads((etc(plant, machine) / "gateway.toml").read_text())
        assert (config["gateway"]["name"], config["axis"]["x"].get("max_speed")) == (
            machine,
            {"mill-1": None, "mill-2": 150.0}[machine],
        )
        modes = {path.stat().st_mode & 0o777 for path in etc(plant, machine).rglob("*") if path.is_file()}
        assert modes == {0o640}
        root = plant.folder / machine
        assert (root / "etc/systemd/system/multi-user.target.wants/pitch-gateway.target").is_symlink()
        assert (root / "etc/systemd/system/pitch-gateway-relay.service.d/configuration.conf").exists()

    said, found = plant.play()
    assert found == dict.fromkeys(("localhost", *MACHINES), (0, 0)), said
    assert not handlers(said)

    (plant.folder / "common/tables/x.tab").write_text(tab(0.0, 0.02, 0.04))
    said, found = plant.play()
    assert {host: failed for host, (_, failed) in found.items()} == dict.fromkeys(
        ("localhost", *MACHINES), 0
    ), said
    assert handlers(said) == ["Reload"]

    (plant.folder / "site.toml").write_text(SITE.replace("150.0", "180.0"))
    said, found = plant.play()
    assert (found["mill-1"][0], handlers(said)) == (0, ["Restart"]), said
    assert [path.name for path in etc(plant, "mill-2").glob("gateway.toml.*")]  # what it had before

    said, found = plant.play()
    assert found == dict.fromkeys(("localhost", *MACHINES), (0, 0)), said

    # What the machine's own release refuses does not get there.
    before = (etc(plant, "mill-1") / "gateway.toml").read_text()
    made = plant.folder / "plant/machines/mill-1/gateway.toml"
    made.write_text(made.read_text().replace("unit_id = 1", "unit_id = 999"))
    said, found = plant.play("--limit", "mill-1")
    assert found["mill-1"][1] == 1
    assert "axis.x.unit_id: found 999" in said
    assert (etc(plant, "mill-1") / "gateway.toml").read_text() == before


def test_the_linters_of_ansible_find_nothing(ansible: Path) -> None:
    environment = {**os.environ, "PATH": f"{ansible / 'bin'}:{os.environ['PATH']}", "ANSIBLE_NOCOLOR": "1"}
    rules = "{extends: default, rules: {line-length: {max: 120}, comments: {min-spaces-from-content: 1}}}"
    for command in (
        ["yamllint", "--strict", "--config-data", rules, "."],
        ["ansible-lint", "--offline", "--strict", "--profile", "production", "site.yml", "roles"],
    ):
        done = subprocess.run(
            command, cwd=FOLDER, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_each_file_of_the_role_is_yaml_and_notifies_handlers_that_there_are() -> None:
    files = sorted(FOLDER.rglob("*.yml"))
    found = {str(path.relative_to(FOLDER)): yaml.safe_load(path.read_text()) for path in files}
    handlers = {each["name"] for each in found["roles/pitch_gateway/handlers/main.yml"]}
    notified = {task["notify"] for task in found["roles/pitch_gateway/tasks/main.yml"] if "notify" in task}
    assert notified == handlers == {"Restart pitch-gateway", "Reload pitch-gateway"}
