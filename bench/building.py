"""What must be there before the bench runs: its C programs, the compiled gateway, what it compares with."""

import hashlib
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from bench.errors import BenchError
from bench.places import BUILD, ROOT, SOURCES

FLAGS: Final = ("-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror")
SHARED: Final = ("endpoints.c", "frames.c")
PROGRAMS: Final = ("load", "drive", "relay", "wire", "witness", "calls", "counter")
COMPARED: Final = ("modbus-proxy>=0.8,<0.9", "pymodbus>=3.16.1,<3.17", "matplotlib>=3.8,<4")
"""From the package index, into an environment of its own: the gateway's stays as its users have it."""


@dataclass(frozen=True, slots=True)
class Programs:
    """The bench's own programs, built."""

    load: Path
    drive: Path
    relay: Path
    wire: Path
    witness: Path
    calls: Path
    counter: Path


def build_programs(folder: Path = BUILD / "bin") -> Programs:
    """Compile what is older than its sources.

    Raises:
        BenchError: there is no gcc, or it finds something wrong.
    """
    compiler = shutil.which("gcc")
    if compiler is None:
        raise BenchError("gcc is not installed; as root: apt-get install gcc libc6-dev")
    folder.mkdir(parents=True, exist_ok=True)
    newest = max(source.stat().st_mtime for source in SOURCES.iterdir())
    for name in PROGRAMS:
        target = folder / name
        if target.exists() and target.stat().st_mtime > newest:
            continue
        sources = [str(SOURCES / source) for source in (f"{name}.c", *SHARED)]
        done = subprocess.run(
            [compiler, *FLAGS, "-o", str(target), *sources], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise BenchError(f"gcc refuses {name}.c:\n{done.stderr}")
    return Programs(*(folder / name for name in PROGRAMS))


def compared_python(say: Callable[[str], None], folder: Path = BUILD / "venv") -> Path:
    """Return the interpreter of the environment that holds ``COMPARED``; made where it is missing.

    Raises:
        BenchError: it cannot be made.
    """
    python, stamp = folder / "bin" / "python", folder / "installed"
    wanted = "\n".join(COMPARED)
    if python.exists() and stamp.exists() and stamp.read_text() == wanted:
        return python
    say(f"installing {', '.join(COMPARED)} into {folder}")
    install = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *COMPARED]
    for command in ([sys.executable, "-m", "venv", str(folder)], install):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise BenchError(f"{' '.join(command)} failed:\n{done.stderr}")
    stamp.write_text(wanted)
    return python


def compiled_package(say: Callable[[str], None], folder: Path = BUILD / "compiled") -> Path:
    """Return a folder that holds the gateway with its hot path compiled; made anew when a source changed.

    Raises:
        BenchError: it cannot be compiled.
    """
    tool, stamp = ROOT / "tools" / "compiled.py", folder / "sources"
    found = hashlib.sha256()
    for source in (tool, *sorted((ROOT / "gateway").rglob("*.py")), *sorted((ROOT / "gateway").rglob("*.c"))):
        found.update(str(source.relative_to(ROOT)).encode() + source.read_bytes())
    if stamp.exists() and stamp.read_text() == found.hexdigest():
        return folder
    say(f"compiling the gateway into {folder}, about a minute")
    shutil.rmtree(folder, ignore_errors=True)
    done = subprocess.run(
        [sys.executable, str(tool), str(folder)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise BenchError(f"the gateway cannot be compiled:\n{done.stdout}{done.stderr}")
    stamp.write_text(found.hexdigest())
    return folder
