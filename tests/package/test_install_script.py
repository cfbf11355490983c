"""The installer's words and refusals; what it does is tried in ``test_in_a_bare_debian.py``."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

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
    done = subprocess.run(
        ["shellcheck", "-x", *map(str, SCRIPTS)], cwd=ROOT, capture_output=True, text=True, check=False
    )
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


def test_an_interpreter_that_the_service_may_not_run_is_refused(tmp_path: Path) -> None:
    (tmp_path / "private").mkdir(mode=0o700)
    (tmp_path / "root").mkdir()
    copy = tmp_path / "private" / "python3"
    copy.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    copy.chmod(0o755)
    home = Path(os.path.realpath(sys.executable))
    if all(folder.stat().st_mode & 1 for folder in (home, *home.parents)):
        pytest.skip("the interpreter of the tests stands where everybody may run it")
    said = installer("--prefix-root", tmp_path / "root", "--python", copy, "install", expected=1)
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
