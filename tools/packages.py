"""The wheels that an installation takes, and the Debian package of each suite, built in a bare Debian."""

import hashlib
import os
import platform
import shutil
import sys
from pathlib import Path

from tools.bare_debian import BUILDING, KEPT, ROOT, BareDebian, Suite, run

RUN = "deploy/requirements.txt"
BUILD = "deploy/build-requirements.txt"
PARTS = ("gateway", "deploy", "docs", "systemd", "tools", "pyproject.toml", "README.md", "LICENSE")
"""What of the sources the package is built from."""


def fetched(purpose: str, pinned: tuple[str, ...], *options: str) -> Path:
    """Return a folder with the wheels that files of pinned versions name.

    They are fetched once for each state of these files, and pip checks each by its hash.

    Raises:
        FailedError: they could not be fetched.
    """
    # Without options pip takes what fits the Python that runs this.
    fitting = " ".join(options) or sys.version
    content = fitting.encode() + b"".join((ROOT / name).read_bytes() for name in pinned)
    folder = KEPT / f"wheels-{purpose}-{hashlib.sha256(content).hexdigest()[:12]}"
    part = folder.with_suffix(f".{os.getpid()}")
    if not folder.exists():
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
        command += ["--require-hashes", "--only-binary", ":all:", "--dest", str(part), *options]
        try:
            for name in pinned:
                run([*command, "--requirement", str(ROOT / name)])
            part.rename(folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    return folder


def wheels(suite: Suite) -> Path:
    """Return a folder with all wheels that run, and that build, in a suite: a bare Debian knows no index.

    Raises:
        FailedError: they could not be fetched.
    """
    machine = platform.machine()
    older = [f"manylinux_2_{minor}_{machine}" for minor in range(suite.glibc_minor, 4, -1)]
    oldest = [f"manylinux{year}_{machine}" for year in ("2014", "2010", "1")]
    options = ["--python-version", suite.python, "--implementation", "cp"]
    for name in (*older, *oldest):
        options += ["--platform", name]
    return fetched(suite.name, (RUN, BUILD), *options)


def build_package(sources: Path, suite: Suite, work: Path, epoch: int, out: Path) -> Path:
    """Build the package of a suite from sources, in a bare Debian in ``work``; returns the file in ``out``.

    ``epoch`` is the newest time in s since 1970 that a file of the package has.

    Raises:
        FailedError: it could not be built.
    """
    try:
        debian = BareDebian(work, suite, BUILDING)
        for part in PARTS:
            debian.copy_in(sources / part, f"src/{part}")
        debian.copy_in(wheels(suite), "wheels")
        settings = f"SOURCE_DATE_EPOCH={epoch} FIND_LINKS=/wheels COMPILED=1"
        debian.does(f"cd /src && {settings} tools/deb.sh")
        (built,) = (work / "src" / "dist").glob("*.deb")
        out.mkdir(parents=True, exist_ok=True)
        return Path(shutil.copyfile(built, out / built.name))
    finally:
        shutil.rmtree(work, ignore_errors=True)
