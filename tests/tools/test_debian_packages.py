"""tools/debian_packages.sh beside another program that installs packages: it waits, and says for whom."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# As apt 2.6 of Debian 12 says it.
LISTS = (
    "E: Could not get lock /var/lib/apt/lists/lock. It is held by process 4630 (apt-get)\n"
    "E: Unable to lock directory /var/lib/apt/lists/"
)
DPKG = (
    "E: Could not get lock /var/lib/dpkg/lock-frontend. It is held by process 4630 (apt-get)\n"
    "E: Unable to acquire the dpkg frontend lock (/var/lib/dpkg/lock-frontend), is another process using it?"
)
MISSING = "E: Unable to locate package promtheus"
APT = """\
#!/bin/sh
echo "$@" >> "${0%/*}/asked"
for said in "${0%/*}/$2".*; do
    [ -e "$said" ] || exit 0
    cat "$said" >&2
    rm "$said"
    exit 100
done
"""
"""An apt-get that fails with each of the files ``COMMAND.NUMBER`` beside it once, and then succeeds."""
UPDATE = "-qq update"
INSTALL = "-qq install -y --no-install-recommends mosquitto zsh"


def install(folder: Path, *failures: tuple[str, str]) -> tuple[int, str, list[str]]:
    """Run it; returns its exit code, what it said, and what apt-get was asked for."""
    apt = folder / "apt-get"
    apt.write_text(APT)
    apt.chmod(0o755)
    for number, (command, said) in enumerate(failures):
        (folder / f"{command}.{number}").write_text(said + "\n")
    done = subprocess.run(
        [ROOT / "tools" / "debian_packages.sh", "mosquitto", "zsh"],
        env={"PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr, (folder / "asked").read_text().splitlines()


@pytest.mark.parametrize(
    ("command", "held", "asked"),
    [
        ("update", LISTS, [UPDATE, UPDATE, UPDATE, INSTALL]),
        ("install", DPKG, [UPDATE, INSTALL, INSTALL, INSTALL]),
    ],
)
def test_a_lock_that_is_held_is_waited_for_and_told_once(
    tmp_path: Path, command: str, held: str, asked: list[str]
) -> None:
    told = f"waiting, at most 600 s: {held.splitlines()[0]}\n"
    assert install(tmp_path, (command, held), (command, held)) == (0, told, asked)


def test_another_failure_is_shown_and_not_tried_again(tmp_path: Path) -> None:
    told = f"apt-get install failed:\n{MISSING}\n"
    assert install(tmp_path, ("install", MISSING)) == (1, told, [UPDATE, INSTALL])


def test_where_nothing_is_wrong_nothing_is_said(tmp_path: Path) -> None:
    assert install(tmp_path) == (0, "", [UPDATE, INSTALL])
