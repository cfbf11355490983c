"""The installer's words and refusals; what it does is tried in ``test_in_a_bare_debian.py``."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.processes import started
from tests.support.programs import ran

ROOT = Path(__file__).parents[2]
INSTALL = ROOT / "deploy" / "install.sh"
SCRIPTS = [
    *sorted((ROOT / "deploy").glob("*.sh")),
    *sorted((ROOT / "tools").glob("*.sh")),
    *(ROOT / "deploy" / "debian" / name for name in ("preinst", "postinst", "prerm", "postrm")),
]


def installer(*arguments: str | Path, expected: int = 0) -> str:
    done = subprocess.run(
        [str(INSTALL), *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert done.returncode == expected, done.stdout
    return done.stdout


@pytest.mark.skipif(shutil.which("shellcheck") is None, reason="shellcheck is not there (Debian: shellcheck)")
def test_shellcheck_finds_nothing() -> None:
    done = ran("shellcheck", "-x", *map(str, SCRIPTS), cwd=ROOT)
    assert (done.returncode, done.stdout) == (0, "")


def test_help_names_every_option() -> None:
    said = installer("--help")
    options = {
        word for line in INSTALL.read_text().splitlines() for word in line.split(")")[:1] if "--" in word
    }
    for option in (each.strip() for words in options for each in words.split("|")):
        if option.startswith("--") and option.isascii() and " " not in option:
            assert option in said, option
    assert installer(expected=2).startswith("usage: ")


def test_wrong_usage_is_named() -> None:
    assert "no such option: --bogus; see --help" in installer("--bogus", expected=1)
    assert "no such command: instal; see --help" in installer("instal", expected=1)
    assert "one command only: status is one too many" in installer("install", "status", expected=1)
    assert "--wheel needs a value" in installer("install", "--wheel", expected=1)


def test_what_is_missing_is_named_and_nothing_is_changed(tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    into = ("--prefix-root", root)
    assert f"there is no folder {tmp_path}/none" in installer(
        "--prefix-root", tmp_path / "none", "status", expected=1
    )
    said = installer(*into, "--wheel", tmp_path / "x.whl", "install", expected=1)
    assert f"--wheel: there is no file {tmp_path}/x.whl" in said
    assert f"{tmp_path} is no checkout" in installer(*into, "--from", tmp_path, "install", expected=1)
    said = installer(*into, "--python", "/bin/false", "install", expected=1)
    assert "needs Python 3.11 or newer; /bin/false was found" in said
    assert "there is no release before this one" in installer(*into, "rollback", expected=1)
    assert [path.name for path in root.rglob("*")] == ["opt"]  # which was locked meanwhile, and is empty


def in_installer(script: str, **environment: str | Path) -> str:
    """What a line says that stands in the installer, with its own options of the shell."""
    system = ROOT / "deploy" / "install_system.sh"
    head = f'set -euo pipefail; say() {{ echo "$*"; }}; . "{system}"; '
    told = os.environ | {name: str(value) for name, value in environment.items()}
    return ran("bash", "-c", head + script, env=told, check=True).stdout


def test_a_release_that_runs_is_in_use_however_processes_come_and_go(tmp_path: Path) -> None:
    # A process that ends between the list and the look has cat fail, with all else that it read.
    stub = tmp_path / "cat"
    stub.write_text(f'#!/bin/sh\n{shutil.which("cat")} "$@"; exit 1\n')
    stub.chmod(0o755)
    release = f"{tmp_path}/releases/1"
    ask = 'if is_in_use "$release"; then echo yes; fi'
    path = f"{tmp_path}:{os.environ['PATH']}"
    with started(["bash", "-c", f"exec -a {release}/bin/python3 sleep 300"]) as running:
        # The shell that becomes it has the path among its arguments too, and while it does nobody has any.
        while not Path(f"/proc/{running.pid}/cmdline").read_bytes().startswith(release.encode()):
            assert running.poll() is None
        assert in_installer(ask, PATH=path, release=release) == "yes\n"
        assert in_installer(ask, PATH=path, release=f"{tmp_path}/releases/11") == ""
        assert in_installer(ask, PATH=path, release=f"{tmp_path}/releases") == "yes\n"
    assert in_installer(ask, release=release) == ""


def test_a_tree_may_have_spaces_in_its_path(tmp_path: Path) -> None:
    root = tmp_path / "my disk"
    units = root / "opt/pitch-gateway.releases/1/share/pitch-gateway/systemd"
    units.mkdir(parents=True)
    (units / "a.service").write_text("[Unit]\n")
    names = {"NAME": "pitch-gateway", "LIB": "/usr/local/lib", "SHARE": "/usr/local/share"}
    in_installer(
        "put_system_files pitch-gateway.releases/1",
        root=root,
        has_changed="",
        COMMAND_LINK="/usr/local/bin/pitch-gateway",
        CURRENT="/opt/pitch-gateway",
        **names,
    )
    assert (root / "usr/local/lib/systemd/system/a.service").read_text() == "[Unit]\n"
    assert (root / "usr/local/bin/pitch-gateway").readlink() == Path("/opt/pitch-gateway/bin/pitch-gateway")


def test_an_interpreter_that_the_service_may_not_run_is_refused(tmp_path: Path) -> None:
    (tmp_path / "private").mkdir(mode=0o700)
    (tmp_path / "root").mkdir()
    copies = tmp_path / "private" / "a python"
    subprocess.run([sys.executable, "-m", "venv", "--copies", "--without-pip", str(copies)], check=True)
    python = copies / "bin" / "python3"
    said = installer("--prefix-root", tmp_path / "root", "--python", python, "install", expected=1)
    assert "is below a folder that other users may not enter" in said


def test_a_dry_run_changes_nothing(tmp_path: Path) -> None:
    python = "/usr/bin/python3"
    if subprocess.run(
        [python, "-c", "import ensurepip, tomllib"], check=False, capture_output=True
    ).returncode:
        pytest.skip(f"{python} has no venv, or is older than 3.11")
    said = installer("--prefix-root", tmp_path, "--python", python, "--dry-run", "install")
    assert "would make /opt/pitch-gateway.releases/" in said
    assert "would not touch /etc/pitch-gateway and /var/lib/pitch-gateway" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() != 0, reason="the installer asks for root")
def test_purge_removes_what_was_added_to_the_units_and_says_so(tmp_path: Path) -> None:
    folders = [
        tmp_path / f"etc/systemd/system/pitch-gateway-{unit}.service.d" for unit in ("relay", "supervisor")
    ]
    for folder in folders:
        folder.mkdir(parents=True)
        (folder / "configuration.conf").write_text("[Service]\n")
    (tmp_path / "etc/passwd").touch()
    said = installer("--prefix-root", tmp_path, "uninstall")
    for folder in folders:
        assert f"left: /{folder.relative_to(tmp_path)}" in said
    said = installer("--prefix-root", tmp_path, "--purge", "uninstall", expected=1)
    assert "pitch-gateway-relay.service.d" in said
    assert all(folder.exists() for folder in folders)
    said = installer("--prefix-root", tmp_path, "--purge", "--yes", "uninstall")
    assert not any(folder.exists() for folder in folders)
    for folder in folders:
        assert f"/{folder.relative_to(tmp_path)}" in said.partition("removed: ")[2]
