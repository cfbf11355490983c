"""The package and the installer on a Debian that has never seen them: they come, they work, they go."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tools.bare_debian import ROOT, BareDebian

CONFIG = """
[gateway]
state = "/var/lib/pitch-gateway"
tables = "tables"

[line.x]
drives = { tcp = "127.0.0.1:5020" }

[[line.x.controllers]]
name = "cnc"
tcp = "127.0.0.1:1502"

[axis.x]
line = "x"
unit_id = 1
units = "mm"
counts_per_unit = 1000.0
travel = [0.0, 100.0]
referenced = "absolute"
compensation = "on"
table = "x.tab"
registers.command = [{ address = 100, type = "int32" }]
"""
TABLE = """CNC10 TAB FILE VERSION 3
AXIS X
UNITS MILLIMETER
INTERVAL 100.0
ENTRIES 2
0.0 0.0 0.0
100.0 0.1 0.1
"""
OWN = ("etc/pitch-gateway", "var/lib/pitch-gateway")
AS_USER = "setpriv --reuid pitch-gateway --regid pitch-gateway --init-groups --inh-caps=-all"

pytestmark = pytest.mark.timeout(2700)


def ends_well(debian: BareDebian) -> None:
    """The program works for the user of the service, and moves worn axes to where they should be."""
    said = debian.does(f"cd /var/lib/pitch-gateway && {AS_USER} pitch-gateway demo --once --json 2>/dev/null")
    axes = json.loads(said)["axes"]
    assert len(axes) == 3
    assert debian.does("pitch-gateway --version").startswith("pitch-gateway ")


def configure(debian: BareDebian) -> None:
    """What a person adds, and what a first start leaves."""
    debian.write("etc/pitch-gateway/gateway.toml", CONFIG)
    debian.write("etc/pitch-gateway/tables/x.tab", TABLE)
    debian.does("chgrp pitch-gateway /etc/pitch-gateway/gateway.toml /etc/pitch-gateway/tables/x.tab")
    debian.does(f"{AS_USER} pitch-gateway check --compile /etc/pitch-gateway/gateway.toml")
    assert (debian.folder / "var/lib/pitch-gateway/plan.msgpack").exists()


def what_stays(debian: BareDebian, before: dict[str, str]) -> set[str]:
    """The paths that were not there before; what was there must be as it was."""
    now = debian.tree()
    assert {path: now.get(path) for path in before} == before
    return set(now) - set(before)


def not_own(paths: set[str]) -> set[str]:
    return {path for path in paths if not path.startswith(OWN)}


@pytest.mark.skipif(shutil.which("lintian") is None, reason="lintian is not there (Debian: lintian)")
def test_lintian_finds_nothing(package: Path) -> None:
    command = ["lintian", "--allow-root", "--fail-on", "error,warning", str(package)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


def test_the_package_comes_works_and_goes(debian: BareDebian, package: Path) -> None:
    before = dict(debian.tree())
    debian.copy_in(package, "tmp/pitch-gateway.deb")
    debian.does("apt-get install -y /tmp/pitch-gateway.deb")
    # It starts nothing by itself.
    assert "disabled" in debian.does(
        "systemctl --root=/ is-enabled pitch-gateway.target || true"
    ) or not list((ROOT / "systemd").glob("*.target"))
    for path in (
        "usr/share/man/man1/pitch-gateway.1.gz",
        "usr/share/bash-completion/completions/pitch-gateway",
        "usr/share/zsh/vendor-completions/_pitch-gateway",
        "usr/share/fish/vendor_completions.d/pitch-gateway.fish",
        "usr/share/doc/pitch-gateway/examples/gateway.example.toml",
        "lib/udev/rules.d/60-pitch-gateway.rules",
        *(f"lib/systemd/system/{unit.name}" for unit in (ROOT / "systemd").glob("*.*") if unit.is_file()),
    ):
        assert (debian.folder / path).is_file(), path
    ends_well(debian)
    assert debian.does("pitch-gateway --version").endswith(" (compiled)\n")
    configure(debian)

    debian.does("apt-get remove -y pitch-gateway")
    left = what_stays(debian, before)
    # Debian's own notes on units last until the package is purged.
    assert {path for path in not_own(left) if "deb-systemd-helper" not in path} == set()
    assert {"etc/pitch-gateway/gateway.toml", "etc/pitch-gateway/tables/x.tab"} <= left
    assert "var/lib/pitch-gateway/plan.msgpack" in left

    said = debian.does("apt-get purge -y pitch-gateway")
    assert "left in place: /etc/pitch-gateway" in said
    left = what_stays(debian, before)
    assert {path for path in left if not path.startswith("etc/pitch-gateway")} == set()
    assert {"etc/pitch-gateway/gateway.toml", "etc/pitch-gateway/tables/x.tab"} <= left


def test_the_installer_comes_again_goes_back_and_goes(debian: BareDebian, given_wheels: Path) -> None:
    before = dict(debian.tree())
    for part in ("gateway", "deploy", "tools", "systemd", "pyproject.toml", "README.md", "LICENSE"):
        if (ROOT / part).exists():
            debian.copy_in(ROOT / part, f"src/{part}")
    install = f"/src/deploy/install.sh --find-links /wheels --wheel {given_wheels}"
    said = debian.does(f"umask 077 && {install} install")  # as root has it on hardened machines
    assert "installed: pitch-gateway" in said
    ends_well(debian)
    configure(debian)
    first = debian.tree()
    assert "nothing to do" in debian.does(f"{install} install")
    assert debian.tree() == first

    # Another release: the same, packed anew with another version.
    debian.does(
        "cd /wheels && python3 -m zipfile -e *pitch_gateway*.whl /tmp/other && rm *pitch_gateway*.whl"
    )
    other = debian.folder / "tmp" / "other"
    (info,) = other.glob("pitch_gateway-*.dist-info")
    version = info.name.removeprefix("pitch_gateway-").removesuffix(".dist-info")
    (other / "gateway" / "__init__.py").write_text('"""Another."""\n\n__version__ = "9.9.9"\n')
    for path in (info / "METADATA", info / "RECORD"):
        path.write_text(
            path.read_text().replace(f"Version: {version}", "Version: 9.9.9").replace(version, "9.9.9")
        )
    info.rename(other / "pitch_gateway-9.9.9.dist-info")
    shutil.make_archive(str(debian.folder / "tmp" / "whl"), "zip", other)
    (debian.folder / "tmp/whl.zip").rename(debian.folder / "wheels/pitch_gateway-9.9.9-py3-none-any.whl")
    newer = "/src/deploy/install.sh --find-links /wheels --wheel /wheels/pitch_gateway-9.9.9-py3-none-any.whl"
    assert "would make /opt/pitch-gateway.releases/9.9.9-" in debian.does(f"{newer} --dry-run install")
    assert debian.does("pitch-gateway --version") == f"pitch-gateway {version}\n"
    debian.does(f"{newer} install")
    assert debian.does("pitch-gateway --version") == "pitch-gateway 9.9.9\n"
    debian.does("/src/deploy/install.sh rollback")
    assert debian.does("pitch-gateway --version") == f"pitch-gateway {version}\n"
    said = debian.does("/src/deploy/install.sh status")
    assert f"installed: {version}" in said
    assert "before it: 9.9.9" in said
    # One that cannot be made leaves everything as it is.
    (debian.folder / "wheels/pitch_gateway-9.9.10-py3-none-any.whl").write_bytes(b"no wheel")
    broken = newer.replace("9.9.9", "9.9.10")
    assert "nothing was changed" in debian.does(f"{broken} install", expected=1)
    assert debian.does("pitch-gateway --version") == f"pitch-gateway {version}\n"
    assert len(list((debian.folder / "opt/pitch-gateway.releases").iterdir())) == 2

    said = debian.does("/src/deploy/install.sh uninstall")
    assert "left: /etc/pitch-gateway" in said
    left = what_stays(debian, before)
    assert not_own(left) == set()
    assert {"etc/pitch-gateway/gateway.toml", "etc/pitch-gateway/tables/x.tab"} <= left
    assert "var/lib/pitch-gateway/plan.msgpack" in left
    assert "it is not installed" in debian.does("/src/deploy/install.sh uninstall")
    assert "nothing more was removed" in debian.does("/src/deploy/install.sh --purge uninstall", expected=1)
    debian.does("/src/deploy/install.sh --purge --yes uninstall")
    assert what_stays(debian, before) == set()


def test_each_way_of_installing_refuses_the_other(debian: BareDebian, package: Path) -> None:
    debian.copy_in(package, "tmp/pitch-gateway.deb")
    for part in ("gateway", "deploy", "tools", "pyproject.toml"):
        debian.copy_in(ROOT / part, f"src/{part}")
    debian.does("ln -s pitch-gateway.releases/x /opt/pitch-gateway")
    said = debian.does("apt-get install -y /tmp/pitch-gateway.deb", expected=100)
    assert "run deploy/install.sh uninstall first" in said
    debian.does("rm /opt/pitch-gateway && apt-get install -y /tmp/pitch-gateway.deb")
    said = debian.does("/src/deploy/install.sh install", expected=1)
    assert "apt remove pitch-gateway first" in said


def test_the_steps_of_the_image_work(debian: BareDebian, given_wheels: Path) -> None:
    """Without a container engine: each RUN of the Dockerfile but apt's, in this Debian."""
    text = (ROOT / "deploy" / "Dockerfile").read_text().replace("\\\n", " ")
    runs = [line.removeprefix("RUN ") for line in text.splitlines() if line.startswith("RUN ")]
    copies = [
        line.split()[1:] for line in text.splitlines() if line.startswith("COPY ") and "--from" not in line
    ]
    for *sources, target in copies:
        for source in sources:
            inside = target + Path(source).name if target.endswith("/") and len(sources) > 1 else target
            debian.copy_in(
                ROOT / source, inside.lstrip("/") + (Path(source).name if inside.endswith("/") else "")
            )
    shutil.rmtree(
        debian.folder / "opt" / "pitch-gateway"
    )  # made by the copy of what belongs to the last stage
    steps = [step.strip() for line in runs for step in line.split("&&")]
    for step in steps:
        if step.startswith(("apt-get", "rm ")):
            continue  # what is installed here is installed already
        # The wheel is what it is; there is no compiler here.
        options = f"--find-links /wheels --wheel {given_wheels}"
        debian.does(step.replace("environment.sh --bare --compiled", f"environment.sh --bare {options}"))
    debian.copy_in(ROOT / "deploy/container/healthcheck.py", "opt/pitch-gateway/share/healthcheck.py")
    debian.write("etc/pitch-gateway/gateway.toml", CONFIG)
    debian.write("etc/pitch-gateway/tables/x.tab", TABLE)
    ends_well_in = f"{AS_USER} /opt/pitch-gateway/bin/pitch-gateway"
    health = "/opt/pitch-gateway/bin/python3 /opt/pitch-gateway/share/healthcheck.py"
    assert "No such file" in debian.does(health, expected=1)
    # As in the container: `run` in the foreground; healthy when the drives are reached, stopped by SIGTERM.
    debian.does(
        f"""
        cd /var/lib/pitch-gateway
        {ends_well_in} simulate /etc/pitch-gateway/gateway.toml >/tmp/simulated 2>&1 &
        {ends_well_in} run /etc/pitch-gateway/gateway.toml --log-format json >/tmp/log 2>&1 &
        gateway=$!
        for i in $(seq 300); do {health} >/tmp/health && break; sleep 0.1; done
        kill -TERM $gateway
        wait $gateway && grep -qx ok /tmp/health || {{ cat /tmp/simulated /tmp/log /tmp/health; exit 1; }}
        """
    )
