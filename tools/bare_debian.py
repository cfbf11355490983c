"""A bare Debian in a folder, to build packages and to install them in.

Needs root, mmdebstrap and, once, a network.
"""

import hashlib
import os
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "build" / "kept"
"""What was fetched and is kept for the next time: an archive of each bare Debian, and wheels."""
INSTALLED = ("python3", "python3-venv", "systemd", "udev")
"""What the package needs, so that nothing but the package itself comes and goes where it is installed."""
MANAGED = (*INSTALLED, "python3-apt")
"""What Ansible needs beside it."""
PODMAN = ("podman", "systemd")
"""What reads a quadlet."""
BUILDING = ("python3-venv", "python3-dev", "build-essential", "debhelper", "fakeroot")
"""What building it needs."""
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
ENTER = """
set -e
mount -t proc proc "$0/proc"
mount -t tmpfs -o mode=755 tmpfs "$0/dev"
for device in null:3 zero:5 full:7 random:8 urandom:9; do
    mknod -m 666 "$0/dev/${device%:*}" c 1 "${device#*:}"
done
mkdir "$0/dev/pts" "$0/dev/shm"
mount -t devpts -o newinstance,ptmxmode=666 devpts "$0/dev/pts"
ln -s pts/ptmx "$0/dev/ptmx"
ln -s /proc/self/fd "$0/dev/fd"
umask 022
exec chroot "$0" "$@"
"""
"""What a program needs of /proc and /dev, in namespaces that end with it."""
TRIED = "mount -t tmpfs tmpfs /mnt && mknod /mnt/null c 1 3 && chroot / true"
LEFT_OUT = (
    "proc",
    "sys",
    "dev",
    "tmp",
    "src",
    "wheels",
    "var/log",
    "var/cache",
    "var/lib/apt",
    "var/lib/dpkg",
)
LEFT_FILES = {"etc/passwd-", "etc/group-", "etc/shadow-", "etc/gshadow-", "etc/.pwd.lock"}
"""What every package leaves: the records of dpkg, and copies of the lists of users."""


@dataclass(frozen=True)
class Suite:
    """A release of Debian, with the Python and the C library that it brings."""

    name: str
    number: int
    python: str
    glibc_minor: int

    def __str__(self) -> str:
        """Name it as people do."""
        return f"Debian {self.number}"


BOOKWORM = Suite("bookworm", 12, "3.11", 36)
TRIXIE = Suite("trixie", 13, "3.13", 41)
SUITES = (BOOKWORM, TRIXIE)
"""Those that there is a package for."""


class FailedError(Exception):
    """A program did not do what it was started for; the text is what it said."""


def why_not() -> str:
    """Return why there can be no bare Debian here, "" where there can."""
    if os.geteuid() != 0:
        return "only root can make a bare Debian and enter it"
    missing = [name for name in ("mmdebstrap", "unshare") if shutil.which(name) is None]
    if missing:
        return f"missing: {', '.join(missing)} (Debian: apt-get install mmdebstrap util-linux)"
    command = ["unshare", "--mount", "--pid", "--fork", "sh", "-c", TRIED]
    tried = subprocess.run(command, check=False)
    return "" if tried.returncode == 0 else "this root may not mount or make devices, as in most containers"


def run(command: list[str], **environment: str) -> str:
    """Run a program to its end; returns what it said on either stream.

    Raises:
        FailedError: it ended with another code than 0.
    """
    done = subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )
    if done.returncode:
        raise FailedError(f"{' '.join(command)}: exit code {done.returncode}\n{done.stdout}")
    return done.stdout


def seed(suite: Suite, packages: tuple[str, ...]) -> Path:
    """Return the archive of a bare Debian with some packages; it is made once and kept.

    Raises:
        FailedError: it could not be made.
    """
    purpose = {INSTALLED: "installed", BUILDING: "building", MANAGED: "managed", PODMAN: "podman"}[packages]
    asked = hashlib.sha256(" ".join(packages).encode()).hexdigest()[:8]
    archive = KEPT / f"{suite.name}-{purpose}-{asked}.tar"
    if not archive.exists():
        KEPT.mkdir(parents=True, exist_ok=True)
        part = KEPT / f"{os.getpid()}.tar"
        include = f"--include={','.join(packages)}"
        try:
            run(["mmdebstrap", "--quiet", "--variant=minbase", include, suite.name, str(part)])
            part.rename(archive)
        finally:
            part.unlink(missing_ok=True)
    return archive


class BareDebian:
    """One unpacked system."""

    def __init__(self, folder: Path, suite: Suite, packages: tuple[str, ...] = INSTALLED) -> None:
        self.folder = folder
        self.suite = suite
        archive = seed(suite, packages)
        folder.mkdir(parents=True)
        run(["tar", "--extract", "--file", str(archive), "--directory", str(folder), "--exclude=./dev/*"])
        (folder / "dev").mkdir(exist_ok=True)
        (folder / "opt" / "of-others").mkdir(parents=True)  # dpkg takes a folder away that is empty then

    def does(self, command: str, expected: int = 0) -> str:
        """Run a line of shell in it, as root; returns what it said on either stream.

        Raises:
            FailedError: it ended with another code than expected.
        """
        enter = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c", ENTER, str(self.folder)]
        environment = ["/usr/bin/env", "-i", f"PATH={PATH}", "LC_ALL=C.UTF-8", "HOME=/root"]
        done = subprocess.run(
            [*enter, *environment, "DEBIAN_FRONTEND=noninteractive", "/bin/sh", "-c", command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        if done.returncode != expected:
            raise FailedError(f"in {self.suite}: {command}: exit code {done.returncode}\n{done.stdout}")
        return done.stdout

    def copy_in(self, source: Path, name: str) -> None:
        """Put a file or a folder into it."""
        target = self.folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)
        else:
            shutil.copy(source, target)

    def write(self, name: str, text: str) -> None:
        """Write a file in it, as a person would."""
        (self.folder / name).write_text(text)

    def tree(self) -> Mapping[str, str]:
        """Return what there is, by its path: kind, mode, owner, where a link leads."""
        found = {}
        for folder, names, files in os.walk(self.folder):
            here = Path(folder).relative_to(self.folder)
            names[:] = [name for name in names if str(here / name) not in LEFT_OUT]
            for name in (*names, *files):
                path = Path(folder, name)
                status = path.lstat()
                leads = f" -> {path.readlink()}" if path.is_symlink() else ""
                found[str(here / name)] = f"{status.st_mode:o} {status.st_uid}:{status.st_gid}{leads}"
        return {path: what for path, what in found.items() if path not in LEFT_FILES}
