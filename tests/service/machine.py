"""A machine in a box: systemd itself as process 1, in namespaces of its own, over this system's files.

Nothing that it writes is left: its root is an overlay in memory. The network is that of this system, so that
tests reach the ports of the services. It needs root, and is not for machines without systemd's program.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.support.processes import started

ROOT = Path(__file__).parents[2]
SYSTEMD: Final = Path("/lib/systemd/systemd")
SECONDS: Final = 60.0
INSTALLED: Final = "/opt/pitch-gateway"
MASKED: Final = (
    *("systemd-udevd.service", "systemd-udev-trigger.service", "systemd-udevd-control.socket"),
    *("systemd-udevd-kernel.socket", "systemd-sysctl.service", "systemd-modules-load.service"),
    *("systemd-binfmt.service", "systemd-remount-fs.service", "systemd-random-seed.service"),
    *("proc-sys-fs-binfmt_misc.automount", "proc-sys-fs-binfmt_misc.mount", "dev-hugepages.mount"),
    *("dev-mqueue.mount", "sys-kernel-debug.mount", "sys-kernel-tracing.mount", "modprobe@.service"),
    *("sys-fs-fuse-connections.mount", "kmod-static-nodes.service", "systemd-hwdb-update.service"),
    *("systemd-tmpfiles-setup-dev.service", "systemd-tmpfiles-setup.service", "getty.target"),
)
"""What would change the machine that the tests run on: its devices, its kernel's settings and modules."""
NAMESPACES: Final = ("unshare", "--cgroup", "--mount", "--pid", "--uts", "--ipc", "--fork", "--kill-child")
BOOT = """
set -e
echo $$ > {cgroup}/cgroup.procs
cd /
exec {namespaces} sh -e -c '
mount --make-rprivate /
mount -t tmpfs tmpfs {folder}
mkdir {folder}/upper {folder}/work {folder}/root
cp -a {folder}.files/. {folder}/upper/
mount -t overlay overlay -o lowerdir=/,upperdir={folder}/upper,workdir={folder}/work {folder}/root
cd {folder}/root
mount --bind {packages} opt/pitch-gateway/packages
mount --bind {python} opt/pitch-gateway/python
mount -t proc proc proc
mount -t sysfs sysfs sys
mount --rbind /dev dev
mount -t tmpfs tmpfs run
mount -t tmpfs tmpfs tmp
mkdir run/old
pivot_root . run/old
umount -l /run/old
exec env -i container=box PATH=/usr/sbin:/usr/bin:/sbin:/bin {systemd} --log-target=journal \
    --show-status=no systemd.unified_cgroup_hierarchy=1
'
"""
COMMAND = f"""#!/bin/sh
export PYTHONPATH={INSTALLED}/src:{INSTALLED}/packages PYTHONDONTWRITEBYTECODE=1
export LD_LIBRARY_PATH={INSTALLED}/python/lib
exec {INSTALLED}/python/bin/{Path(sys.executable).resolve().name} -c \
    'from gateway.cli.main import main; main()' "$@"
"""


def why_not() -> str:
    """Say why no machine can be booted here, "" where it can."""
    if os.geteuid() != 0:
        return "booting systemd in namespaces needs root"
    if not SYSTEMD.exists():
        return f"there is no {SYSTEMD}"
    packages = Path(sysconfig.get_path("purelib"))
    if packages.stat().st_mode & 0o005 != 0o005:
        return f"{packages} is closed to the user of the service (a umask)"
    cgroups = _cgroups()
    if cgroups is None or not os.access(cgroups, os.W_OK):
        return "no cgroup2 is mounted that can be written"
    tried = subprocess.run([*NAMESPACES, "true"], capture_output=True, text=True, check=False)
    return "" if tried.returncode == 0 else f"namespaces cannot be made: {tried.stderr.strip()}"


class Machine:
    """A machine that runs; ``init`` is its process 1 as this system sees it."""

    def __init__(self, init: int) -> None:
        self._init = init

    def run(self, *command: str, is_checked: bool = True) -> str:
        """Run a command in it; returns what it said."""
        inside = ["nsenter", f"--target={self._init}", "--all", "--wdns=/", *command]
        done = subprocess.run(inside, capture_output=True, text=True, timeout=SECONDS, check=False)
        assert done.returncode == 0 or not is_checked, f"{command}: {done.stdout}{done.stderr}"
        return (done.stdout + done.stderr).strip()

    def property(self, unit: str, name: str) -> str:
        return self.run("systemctl", "show", "--value", f"--property={name}", unit)

    def write(self, path: str, text: str) -> None:
        """Write a file as a root of it would."""
        Path(f"/proc/{self._init}/root{path}").write_text(text)

    def log(self, unit: str) -> str:
        return self.run("journalctl", "--no-pager", "--output=cat", f"--unit={unit}")

    def until(self, unit: str, name: str, wanted: str) -> None:
        """Wait until a property has a value, or begins with it."""
        end_s = time.monotonic() + SECONDS
        while not (found := self.property(unit, name)).startswith(wanted):
            assert time.monotonic() < end_s, f"{unit}: {name} is {found}; log:\n{self.log(unit)}"
            time.sleep(0.1)

    def kill(self, unit: str, number: signal.Signals) -> None:
        """Send a signal to the main process of a unit."""
        self.run("systemctl", "kill", f"--signal={number.name}", "--kill-who=main", unit)

    def of_process(self, unit: str, name: str) -> str:
        """Return a file of /proc of the main process of a unit."""
        return self.run("cat", f"/proc/{self.property(unit, 'MainPID')}/{name}")


@contextlib.contextmanager
def booted(folder: Path, files: dict[str, str]) -> Iterator[Machine]:
    """Boot a machine with the gateway installed and with these files beside, by path."""
    cgroups = _cgroups()
    assert cgroups is not None
    cgroup = cgroups / f"pitch-gateway-test-{uuid.uuid4().hex}"
    box = folder / "box"
    _lay_out(Path(f"{box}.files"), files)
    box.mkdir()
    cgroup.mkdir()
    script = BOOT.format(
        namespaces=" ".join(NAMESPACES),
        cgroup=cgroup,
        folder=box,
        packages=sysconfig.get_path("purelib"),
        python=sys.base_prefix,
        systemd=SYSTEMD,
    )
    try:
        with (
            (folder / "boot.log").open("w") as log,
            started(["sh", "-c", script], stdout=log, stderr=log) as box_,
        ):
            machine = Machine(_init_of(box_.pid, folder / "boot.log"))
            try:
                yield machine
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(machine._init, signal.SIGKILL)
    finally:
        _remove(cgroup)


def _lay_out(tree: Path, files: dict[str, str]) -> None:
    units = {each.name: each.read_text() for each in (ROOT / "systemd").glob("pitch-gateway*")}
    laid = {f"/etc/systemd/system/{name}": text for name, text in units.items()}
    for kind in ("sysusers.d", "tmpfiles.d"):
        laid[f"/usr/lib/{kind}/pitch-gateway.conf"] = (
            ROOT / "systemd" / kind / "pitch-gateway.conf"
        ).read_text()
    laid[f"{INSTALLED}/bin/pitch-gateway"] = COMMAND
    for path, text in {**laid, **files}.items():
        place = tree / path.lstrip("/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
    (tree / f"{INSTALLED}/bin/pitch-gateway".lstrip("/")).chmod(0o755)
    for mount in ("packages", "python"):
        (tree / INSTALLED.lstrip("/") / mount).mkdir()
    # Copied, for the service has a user of its own, who may not be able to enter where the sources are.
    installed = tree / INSTALLED.lstrip("/") / "src" / "gateway"
    shutil.copytree(ROOT / "gateway", installed, ignore=shutil.ignore_patterns("__pycache__"))
    for shared in ROOT.glob("*.so"):  # what compiled modules have in common, where they are compiled
        shutil.copy(shared, installed.parent)
    for copied in installed.parent.rglob("*"):
        copied.chmod(0o755 if copied.is_dir() else 0o644)
    system = tree / "etc/systemd/system"
    for unit in MASKED:
        (system / unit).symlink_to("/dev/null")
    (system / "default.target").symlink_to("/lib/systemd/system/basic.target")
    for made in (tree, *tree.rglob("*")):
        if made.is_dir():
            made.chmod(0o755)


def _init_of(shell: int, log: Path) -> int:
    """Return process 1 of the machine, once it takes commands."""
    end_s = time.monotonic() + SECONDS
    while time.monotonic() < end_s:
        with contextlib.suppress(OSError, ValueError, AssertionError, subprocess.TimeoutExpired):
            [init] = map(int, Path(f"/proc/{shell}/task/{shell}/children").read_text().split())
            if Path(f"/proc/{init}/comm").read_text() == "systemd\n":
                state = Machine(init).run("systemctl", "is-system-running", is_checked=False)
                if state in {"running", "degraded"}:
                    return init
        time.sleep(0.1)
    raise AssertionError(f"systemd did not start: {log.read_text()}")


def _cgroups() -> Path | None:
    for line in Path("/proc/mounts").read_text().splitlines():
        _, place, kind, *_ = line.split()
        if kind == "cgroup2":
            return Path(place)
    return None


def _remove(cgroup: Path) -> None:
    """Remove what the machine had; its processes may take a moment to end."""
    for _ in range(50):
        for each in sorted(cgroup.rglob("*/"), key=lambda path: len(path.parts), reverse=True):
            with contextlib.suppress(OSError):
                each.rmdir()
        with contextlib.suppress(OSError):
            cgroup.rmdir()
        if not cgroup.exists():
            return
        time.sleep(0.1)
