"""The units as systemd's own tool sees them: verified, and rated with what is left open."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "systemd"
UNITS = ("pitch-gateway-relay.service", "pitch-gateway-supervisor.service")
LARGEST_EXPOSURE = 1.5
REALTIME = ("RestrictRealtime=no", "LimitRTPRIO=", "LimitMEMLOCK=infinity", "SystemCallFilter=")


def analyze(*arguments: str) -> "subprocess.CompletedProcess[str]":
    found = shutil.which("systemd-analyze")
    assert found, "systemd-analyze is missing: tools/test_programs.sh installs it (Debian: systemd)"
    environment = {"LC_ALL": "C.UTF-8", "SYSTEMD_PAGER": "", "PATH": "/usr/bin:/bin"}
    return subprocess.run([found, *arguments], capture_output=True, text=True, check=False, env=environment)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A root folder in which the gateway is installed as far as a unit can see."""
    shutil.copytree("/lib/systemd/system", tmp_path / "lib/systemd/system", symlinks=True)
    program = tmp_path / "opt/pitch-gateway/bin/pitch-gateway"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    units = tmp_path / "etc/systemd/system"
    units.mkdir(parents=True)
    for unit in FOLDER.glob("pitch-gateway*"):
        shutil.copy(unit, units)
    return tmp_path


def verified(tree: Path) -> str:
    names = sorted(unit.name for unit in FOLDER.glob("pitch-gateway*"))
    assert names == [*UNITS, "pitch-gateway.target"]
    done = analyze("verify", "--man=no", f"--root={tree}", *names)
    return f"{done.returncode}{done.stdout}{done.stderr}"


def test_the_units_are_verified_without_a_word(tree: Path) -> None:
    assert verified(tree) == "0"


def test_the_tool_that_verifies_says_what_is_wrong(tree: Path) -> None:
    unit = tree / "etc/systemd/system" / UNITS[0]
    unit.write_text(unit.read_text().replace("ProtectSystem=strict", "ProtectSytem=strict"))
    assert "ProtectSytem" in verified(tree)


@pytest.mark.parametrize("drop_in", ["realtime.conf", "low-ports.conf"])
def test_the_units_are_verified_with_each_drop_in(tree: Path, drop_in: str) -> None:
    for unit in UNITS:
        folder = tree / "etc/systemd/system" / f"{unit}.d"
        folder.mkdir()
        shutil.copy(FOLDER / "drop-ins" / drop_in, folder)
    assert verified(tree) == "0"


@pytest.mark.parametrize("unit", UNITS)
def test_little_of_a_unit_is_exposed(unit: str) -> None:
    done = analyze("security", "--offline=yes", f"--threshold={LARGEST_EXPOSURE * 10:g}", str(FOLDER / unit))
    [level] = re.findall(r"exposure level for \S+: ([0-9.]+)", done.stdout)
    assert float(level) <= LARGEST_EXPOSURE
    assert done.returncode == 0


@pytest.mark.parametrize("unit", UNITS)
def test_what_a_unit_leaves_open_stands_in_it_with_its_reason(unit: str) -> None:
    comments = "".join(line for line in (FOLDER / unit).read_text().splitlines() if line.startswith("#"))
    done = analyze("security", "--offline=yes", "--json=short", str(FOLDER / unit))
    assert done.returncode == 0, done.stderr
    for option in ("PrivateNetwork=", "IPAddressDeny=", "RootDirectory="):
        assert (
            f"{option} is left open" in comments
            or f"({option}) is left open" in comments
            or (f"{option} and " in comments or f" and {option}" in comments)
        ), option


def test_nothing_ties_the_relay_to_the_supervisor() -> None:
    relay, supervisor = ((FOLDER / unit).read_text().splitlines() for unit in UNITS)
    settings = [line for line in relay if not line.startswith("#")]
    assert not any("supervisor" in line for line in settings)
    ties = [line for line in supervisor if UNITS[0] in line and not line.startswith("#")]
    assert sorted(line.partition("=")[0] for line in ties) == ["After", "Wants"]
    assert not any(line.startswith(("BindsTo", "Requires", "Requisite")) for line in (*relay, *supervisor))


def test_the_accounts_and_folders_are_good_to_their_own_tools(tree: Path) -> None:
    for kind, tool in (("sysusers.d", "systemd-sysusers"), ("tmpfiles.d", "systemd-tmpfiles")):
        folder = tree / "usr/lib" / kind
        folder.mkdir(parents=True)
        shutil.copy(FOLDER / kind / "pitch-gateway.conf", folder)
        found = shutil.which(tool)
        assert found, f"{tool} is missing: tools/test_programs.sh installs it (Debian: systemd)"
        what = ["--dry-run"] if kind == "sysusers.d" else ["--cat-config"]
        done = subprocess.run(
            [found, f"--root={tree}", *what, "pitch-gateway.conf"],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert "pitch-gateway" in done.stdout + done.stderr


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give folders away")
def test_a_folder_of_tables_that_was_given_to_the_operator_stays_his(tree: Path) -> None:
    """systemd-tmpfiles runs with every start of the machine, and with every upgrade."""
    for name, users in (("passwd", "{}:x:{}:{}:::/:/bin/sh\n"), ("group", "{}:x:{}:\n")):
        known = (("root", 0), ("pitch-gateway", 65533))
        (tree / "etc" / name).write_text("".join(users.format(user, uid, uid) for user, uid in known))
    tool = shutil.which("systemd-tmpfiles")
    assert tool
    create = [tool, f"--root={tree}", "--create", str(FOLDER / "tmpfiles.d" / "pitch-gateway.conf")]
    subprocess.run(create, check=True)
    tables, secrets = tree / "etc/pitch-gateway/tables", tree / "etc/pitch-gateway/secrets"
    assert (tables.stat().st_mode & 0o7777, tables.owner(), tables.stat().st_gid) == (0o750, "root", 65533)
    for folder in (tables, secrets):
        os.chown(folder, 65532, 65533)
        folder.chmod(0o770)
    subprocess.run(create, check=True)
    assert (tables.stat().st_mode & 0o7777, tables.stat().st_uid) == (0o770, 65532)
    assert (secrets.stat().st_mode & 0o7777, secrets.stat().st_uid) == (0o700, 0)
