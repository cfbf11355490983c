"""tools/debian_packages.sh beside another program that has a package lock: it waits, and says for whom."""

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from typing import IO

import pytest

pytestmark = pytest.mark.skipif(shutil.which("apt-get") is None, reason="needs apt-get")

ROOT = Path(__file__).parents[2]
INSTALLED = """\
Package: zsh
Status: install ok installed
Version: 1
Architecture: all
Maintainer: Nobody <nobody@example.org>
Description: a package of a machine that has this one alone

"""
SETTINGS = 'Dir "{0}"; Dir::State::status "{0}/dpkg/status"; APT::Sandbox::User "";'
FOLDERS = (
    "dpkg",
    "etc/apt/apt.conf.d",
    "etc/apt/preferences.d",
    "etc/apt/sources.list.d",
    "var/cache/apt/archives/partial",
    "var/lib/apt/lists/partial",
)
LOCKS = {
    "update": "var/lib/apt/lists/lock",
    "install": "dpkg/lock-frontend",
}
"""What apt-get has locked while it runs."""


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """The folders of apt and dpkg of a machine that has zsh and no place to get anything from."""
    for folder in FOLDERS:
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "etc/apt/sources.list").touch()
    (tmp_path / "dpkg/status").write_text(INSTALLED)
    (tmp_path / "apt.conf").write_text(SETTINGS.format(tmp_path))
    return tmp_path


@contextmanager
def held(lock: Path) -> Iterator[str]:
    """Have a lock as apt-get and dpkg have it, and give what apt-get says of it."""
    program = Path("/proc/self/comm").read_text().strip()
    with lock.open("w") as file:
        fcntl.lockf(file, fcntl.LOCK_EX)
        yield f"E: Could not get lock {lock}. It is held by process {os.getpid()} ({program})\n"


@contextmanager
def installing(machine: Path, package: str, **settings: str) -> Iterator[tuple[Popen[str], IO[str]]]:
    """Run it with the real apt-get; gives it, and what it says."""
    environment = {**os.environ, "APT_CONFIG": str(machine / "apt.conf"), **settings}
    command = (str(ROOT / "tools" / "debian_packages.sh"), package)
    with Popen(command, stdout=DEVNULL, stderr=PIPE, text=True, env=environment) as script:
        assert script.stderr is not None
        yield script, script.stderr


@pytest.mark.parametrize("command", LOCKS)
def test_a_lock_that_is_held_is_waited_for_and_told_once(machine: Path, command: str) -> None:
    with ExitStack() as stack:
        lock = stack.enter_context(held(machine / LOCKS[command]))
        with installing(machine, "zsh") as (script, said):
            assert said.readline() == f"waiting, at most 600 s: {lock}"
            stack.close()
            assert (said.read(), script.wait()) == ("", 0)


@pytest.mark.parametrize("command", LOCKS)
def test_one_that_is_held_for_too_long_is_told_with_what_to_do(machine: Path, command: str) -> None:
    with (
        held(machine / LOCKS[command]) as lock,
        installing(machine, "zsh", PATIENCE_S="1") as (script, said),
    ):
        assert said.read() == (
            f"waiting, at most 1 s: {lock}"
            f"apt-get {command} failed, after 1 s: {lock}"
            "let that program finish, then start this again; PATIENCE_S=3600 waits for an hour\n"
        )
        assert script.wait() == 1


def test_another_failure_is_shown_and_not_tried_again(machine: Path) -> None:
    with installing(machine, "promtheus") as (script, said):
        assert said.read() == "apt-get install failed:\nE: Unable to locate package promtheus\n"
        assert script.wait() == 1


def test_where_nothing_is_wrong_nothing_is_said(machine: Path) -> None:
    with installing(machine, "zsh") as (script, said):
        assert (said.read(), script.wait()) == ("", 0)
