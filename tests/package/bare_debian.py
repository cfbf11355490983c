"""A bare Debian 12 in a folder, to install packages in. Needs root, mmdebstrap and, once, a network."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build" / "package-tests"
SEED = BUILD / "bookworm.tar"
WHEELS = BUILD / "wheels"
INCLUDED = "python3,python3-venv,systemd,udev"
"""What the package needs, so that nothing but the package itself comes and goes in a test."""
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


def why_not() -> str:
    """Return why there can be no bare Debian here, "" where there can."""
    if os.environ.get("PACKAGE_TESTS", "") == "0":
        return "PACKAGE_TESTS=0 leaves it out, because it takes minutes"
    if os.geteuid() != 0:
        return "only root can make a bare Debian and enter it"
    missing = [name for name in ("mmdebstrap", "unshare", "dpkg-deb") if shutil.which(name) is None]
    if missing:
        return f"missing: {', '.join(missing)} (Debian: apt-get install mmdebstrap)"
    tried = subprocess.run(["unshare", "--mount", "--pid", "--fork", "sh", "-c", TRIED], check=False)
    return "" if tried.returncode == 0 else "this root may not mount or make devices, as in most containers"


def make_seed() -> None:
    """Make the archive that every test unpacks; kept for the next run."""
    BUILD.mkdir(parents=True, exist_ok=True)
    if not SEED.exists():
        part = BUILD / "part.tar"
        run(["mmdebstrap", "--quiet", "--variant=minbase", f"--include={INCLUDED}", "bookworm", str(part)])
        part.rename(SEED)


def make_wheels() -> Path:
    """Fetch everything that an installation needs, and later needs no network; returns our own wheel."""
    for old in WHEELS.glob("pitch_gateway-*.whl"):
        old.unlink()
    run([sys.executable, "-m", "pip", "wheel", "--quiet", "--wheel-dir", str(WHEELS), f"{ROOT}[uvloop]"])
    (wheel,) = WHEELS.glob("pitch_gateway-*.whl")
    return wheel


def run(command: list[str], **environment: str) -> str:
    """Run a program to its end; returns what it said.

    Raises:
        AssertionError: it failed; with what it said.
    """
    done = subprocess.run(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )
    assert done.returncode == 0, f"{command}: {done.returncode}\n{done.stdout}"
    return done.stdout


class BareDebian:
    """One unpacked system."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True)
        run(["tar", "--extract", "--file", str(SEED), "--directory", str(folder), "--exclude=./dev/*"])
        (folder / "dev").mkdir(exist_ok=True)
        (folder / "opt" / "of-others").mkdir(parents=True)  # dpkg takes a folder away that is empty then

    def does(self, command: str, expected: int = 0) -> str:
        """Run a line of shell in it, as root; returns what it said on either stream."""
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
        assert done.returncode == expected, f"{command}: {done.returncode}\n{done.stdout}"
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
