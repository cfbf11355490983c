"""The machine that figures come from, and the versions of what was measured."""

import contextlib
import functools
import json
import os
import platform
import shutil
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import gateway
from bench.errors import BenchError
from bench.places import ROOT
from bench.processes import pinned

Facts = list[tuple[str, str]]
COMPARED_PACKAGES: Final = ("modbus-proxy", "pymodbus", "matplotlib")

SYSTEM_CALLS: Final = {
    "getppid": "getppid",
    "pipe": "through a pipe",
    "epoll": "by epoll",
    "process": "to another process and back",
}
"""What ``c/calls.c`` times, in words."""


def machine() -> Facts:
    """Return processor, kernel and what else decides about latencies."""
    return [
        ("processor", f"{_cpu_model()}, {os.cpu_count()} cores{_virtual()}"),
        ("kernel", f"{platform.system()} {platform.release()}, {platform.machine()}"),
        ("memory", f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.1f} GiB"),
        ("clock source", _line("/sys/devices/system/clocksource/clocksource0/current_clocksource")),
        ("idle driver", _line("/sys/devices/system/cpu/cpuidle/current_driver")),
    ]


@functools.cache
def system_calls(program: Path, cpus: tuple[int, ...] | None) -> dict[str, float]:
    """Return how many microseconds the machine's own system calls take, as ``c/calls.c`` names them.

    They are measured once in a run: whatever quotes them quotes the same.
    """
    done = subprocess.run(pinned([program, "100"], cpus), capture_output=True, text=True, check=False)
    if done.returncode:
        raise BenchError(f"{program.name}: {done.stderr.strip()}")
    found: dict[str, int] = json.loads(done.stdout)
    return {name: ns / 1000 for name, ns in found.items()}


def system_calls_in_words(calls: dict[str, float]) -> str:
    """Return them as half a sentence.

    >>> system_calls_in_words({"getppid": 0.165, "pipe": 0.68, "epoll": 1.067, "process": 13.07})
    'getppid 0.17, through a pipe 0.68, by epoll 1.07, to another process and back 13.07 µs'
    """
    return ", ".join(f"{SYSTEM_CALLS[name]} {us:.2f}" for name, us in calls.items()) + " µs"


def versions(compared_python: Path) -> Facts:
    """Return versions of the gateway, of what it runs on and of what it is compared with."""
    facts = [
        ("pitch-gateway", f"{gateway.__version__}{_commit()}"),
        ("Python", f"{platform.python_implementation()} {platform.python_version()}"),
        ("gcc", _said("gcc", "-dumpfullversion")),
        ("socat", _socat()),
    ]
    asked = "import sys; from importlib.metadata import version; print(*map(version, sys.argv[1:]))"
    found = _said(str(compared_python), "-c", asked, *COMPARED_PACKAGES).split()
    return facts + list(zip(COMPARED_PACKAGES, found, strict=False))


def how_and_when(module: str = "bench.run") -> Facts:
    """Return the command line and the time of this run."""
    command = " ".join([f"python -m {module}", *sys.argv[1:]])
    return [("command", f"`{command}`"), ("date", datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"))]


class Disturbance:
    """What else the machine did during a run: time stolen by the host, load at the start."""

    def __init__(self) -> None:
        self._load = os.getloadavg()[0]
        self._start = _cpu_ticks()

    def facts(self) -> Facts:
        """Return the facts since the start."""
        ticks = [now - then for now, then in zip(_cpu_ticks(), self._start, strict=True)]
        stolen = 100 * ticks[7] / max(sum(ticks), 1)
        return [("load at the start", f"{self._load:.2f}"), ("time stolen by the host", f"{stolen:.2f} %")]


def _cpu_ticks() -> list[int]:
    return [int(word) for word in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]


def _cpu_model() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return " ".join(line.partition(":")[2].split())
    return platform.machine()


def _virtual() -> str:
    return ", virtual" if " hypervisor" in Path("/proc/cpuinfo").read_text() else ""


def _line(path: str) -> str:
    with contextlib.suppress(OSError):
        return Path(path).read_text().strip()
    return "unknown"


def _said(*command: str) -> str:
    if shutil.which(command[0]) is None:
        return "not installed"
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT).stdout.strip()


def _commit() -> str:
    commit = _said("git", "rev-parse", "--short", "HEAD")
    changed = _said("git", "status", "--porcelain", "--untracked-files=no", "--", "gateway", "bench/c")
    return f" ({commit}{', changed' if changed else ''})" if commit else ""


def _socat() -> str:
    for line in _said("socat", "-V").splitlines():
        if line.startswith("socat version"):
            return line.split()[2]
    return "not installed"
