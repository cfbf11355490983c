"""Makes a release of the commit that is checked out, into dist/ (make release; docs/release.md).

The source archive, a wheel for every machine and a compiled one for this Python, a Debian package for each
suite, the list of what is installed, and the sums of these files. The same commit gives the same bytes,
wherever it lies. All of it is made in a temporary folder and comes into dist/ at one stroke.
"""

import argparse
import datetime as dt
import errno
import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from tools import bare_debian, compiled
from tools.bare_debian import BUILDING, INSTALLED, ROOT, SUITES, FailedError, run
from tools.packages import BUILD, RUN, build_package, fetched, wheels

DIST = ROOT / "dist"
TOOLS = "tools/release-requirements.txt"
FETCHED = (RUN, BUILD, TOOLS)
SPACE_MB = 800
SPACE_WITH_DEBS_MB = 5000
"""Needed beside the checkout, rounded up: packages, archives of two systems, and one of them unpacked."""
SPACE_FOR_TEMPORARY_MB = 200
"""Needed where pip unpacks and the compiler writes, rounded up."""
CHANGING = ("CFLAGS", "CPPFLAGS", "CXXFLAGS", "LDFLAGS", "CC", "PYTHONPATH", "PITCH_GATEWAY_COMPILED")
"""Settings of a person's shell that would change what is made."""
FULL = "No space left on device"
"""What programs say of a full disk, wherever it is: in the checkout, in dist/ or in the temporary folder."""
NO_ROOM = "release: the disk is full, here or in the folder of temporary files: make room. dist/ is as it was"
console = Console(stderr=True, highlight=False, soft_wrap=True)


class RefusedError(Exception):
    """There is to be no release; one sentence says why, and what to do."""


@dataclass(frozen=True)
class Release:
    """Which release it is; ``epoch`` is the time of the commit in s since 1970."""

    version: str
    commit: str
    epoch: int


def git(*arguments: str) -> str:
    """Return what git says about the checkout, "" where it refuses.

    Raises:
        RefusedError: it refuses because the checkout belongs to somebody else.
    """
    command = ["git", "-C", str(ROOT), *arguments]
    done = subprocess.run(
        command,
        capture_output=True,
        encoding="utf-8",
        errors="backslashreplace",
        check=False,
        env=os.environ | {"LC_ALL": "C"},
    )
    if "dubious ownership" in done.stderr:
        raise RefusedError(
            f"{ROOT} belongs to another user, and git trusts only its owner's: clone it as this one"
        )
    return done.stdout.rstrip("\n") if done.returncode == 0 else ""


def examined() -> Release:
    """Return the release that the checkout is, or say why it is none.

    Raises:
        RefusedError: see there.
    """
    if shutil.which("git") is None:
        raise RefusedError(
            "git is missing, and a release is made from a commit (Debian: apt-get install git)"
        )
    commit = git("rev-parse", "--verify", "HEAD")
    if not commit or Path(git("rev-parse", "--show-toplevel")) != ROOT:
        raise RefusedError(
            f"{ROOT} is no checkout of git, and a release is made from a commit: clone the repository"
        )
    # With -z a name stands as it is, and not in quotes and octal numbers.
    status = git("status", "--porcelain", "-z", "--no-renames").split("\0")
    if changed := [entry for entry in status if entry]:
        more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
        raise RefusedError(
            f"not committed: {changed[0][3:]}{more}; commit, or put aside with git stash --include-untracked"
        )
    text = (ROOT / "gateway" / "__init__.py").read_text()
    version = re.findall(r'^__version__ = "(.+)"$', text, re.MULTILINE)[0]
    dates = re.findall(
        rf"^## \[{re.escape(version)}\] - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE
    )
    try:
        (date,) = dates
        dt.date.fromisoformat(date)
    except ValueError:
        raise RefusedError(
            f"CHANGELOG.md has no section ## [{version}] - YYYY-MM-DD: put what is below [Unreleased] "
            "into one with today's date, or raise __version__ in gateway/__init__.py"
        ) from None
    tagged = git("rev-parse", "--verify", "--quiet", f"refs/tags/v{version}^{{commit}}")
    if tagged not in ("", commit):
        raise RefusedError(
            f"the tag v{version} is at commit {tagged[:7]} already, and this is {commit[:7]}: check that one "
            "out, or raise __version__ in gateway/__init__.py and give it a section in CHANGELOG.md"
        )
    return Release(version, commit, int(git("log", "-1", "--format=%ct")))


def must_be_possible(*, has_compiled: bool, has_debs: bool) -> None:
    """Find what this machine lacks before anything is made.

    Raises:
        RefusedError: see there.
    """
    if has_debs and (why := bare_debian.why_not()):
        raise RefusedError(f"no Debian packages: {why}; RELEASE=--without-debs makes the rest of the release")
    if has_compiled and (lacking := compiled.missing()):
        raise RefusedError(f"no compiled wheel: {lacking}; RELEASE=--without-compiled makes the rest")
    space = SPACE_WITH_DEBS_MB if has_debs else SPACE_MB
    for folder, needed in ((ROOT, space), (Path(gettempdir()), SPACE_FOR_TEMPORARY_MB)):
        free = shutil.disk_usage(folder).free // 1_000_000
        if free < needed:
            raise RefusedError(
                f"the disk is full: {folder} has {free} MB left and {needed} MB are needed; make room"
            )


@contextmanager
def step(name: str) -> Iterator[None]:
    """Show on a terminal what is going on and for how long; anywhere, what was done and how long it took."""
    start = time.monotonic()
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        progress.add_task(escape(name), total=None)
        yield
    console.print(f"{time.monotonic() - start:5.0f} s  {escape(name)}")


def fetch(*, has_debs: bool) -> None:
    """Fetch all that a release takes: from here on it needs no network.

    Raises:
        RefusedError: something is not to be had.
    """
    try:
        fetched("release", FETCHED)
        for suite in SUITES if has_debs else ():
            wheels(suite)
            for packages in (BUILDING, INSTALLED):
                bare_debian.seed(suite, packages)
    except FailedError as failed:
        if FULL in str(failed):
            raise
        last = str(failed).strip().splitlines()[-1]
        raise RefusedError(
            f"packages could not be fetched ({last}): is there a network? "
            "What was fetched stays in build/kept"
        ) from failed


def install(environment: Path, *options: str) -> None:
    """Install into an environment what was fetched, or a wheel of ours."""
    python = str(environment / "bin" / "python")
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "--python", python)
    run([*pip, "install", "--no-index", "--no-compile", *options])


def new_environment(environment: Path, *pinned: str) -> None:
    """Make an environment with nothing in it but the packages of files of pinned versions."""
    run([sys.executable, "-m", "venv", "--without-pip", str(environment)])
    links = ("--find-links", str(fetched("release", FETCHED)))
    install(
        environment,
        *links,
        "--require-hashes",
        *(part for name in pinned for part in ("-r", str(ROOT / name))),
    )


def make(release: Release, work: Path, out: Path, *, has_compiled: bool, has_debs: bool) -> None:
    """Make all files of the release in ``out``; ``work`` is a folder for what is on the way."""
    archive, sources, tools, installed = (
        work / name for name in ("archive", "sources", "tools", "installed")
    )
    for folder in (archive, out):
        folder.mkdir(parents=True)
    with step("tools"):
        new_environment(tools, BUILD, TOOLS)
    with step("source archive"):
        # Not what lies in the folder but what is in the commit; its modes are not of whoever checked it out.
        run(
            [
                "git",
                "-C",
                str(ROOT),
                "-c",
                "tar.umask=0022",
                "-c",
                "core.autocrlf=false",
                "archive",
                "-o",
                str(work / "tar"),
                release.commit,
            ]
        )
        run(["tar", "--extract", "--file", str(work / "tar"), "--directory", str(archive)])
        hatchling(tools, archive, "sdist", out)
        run(["tar", "--extract", "--file", str(*out.glob("*.tar.gz")), "--directory", str(work)])
        # All else is made of the source archive: so it is known to be whole.
        (work / f"pitch_gateway-{release.version}").rename(sources)
    with step("wheel for every machine"):
        hatchling(tools, sources, "wheel", out)
    with step("what it runs on"):
        new_environment(installed, RUN)
        works(installed, out, f"pitch-gateway {release.version}")
    if has_compiled:
        with step(f"compiled wheel for Python {sysconfig.get_python_version()}"):
            hatchling(tools, sources, "wheel", work / "wheel", PITCH_GATEWAY_COMPILED="1")
            (wheel,) = (work / "wheel").iterdir()
            granted = work / "granted"
            path = f"{tools / 'bin'}:{os.environ['PATH']}"
            run(
                [str(tools / "bin" / "auditwheel"), "repair", "--wheel-dir", str(granted), str(wheel)],
                PATH=path,
            )
            works(installed, granted, f"pitch-gateway {release.version} (compiled)")
            shutil.move(next(granted.iterdir()), out)
    with step("list of what is installed"):
        sbom = out / f"pitch-gateway-{release.version}.cdx.json"
        command = ["env", "-C", str(sources), str(tools / "bin" / "python"), "-m", "tools.sbom"]
        run([*command, str(installed / "bin" / "python"), str(sources), release.version, str(sbom)])
    for suite in SUITES if has_debs else ():
        with step(f"package for {suite}"):
            build_package(sources, suite, work / suite.name, release.epoch, out)
    sums = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in sorted(out.iterdir())
    ]
    (out / "SHA256SUMS").write_text("".join(sums))


def hatchling(tools: Path, sources: Path, target: str, out: Path, **environment: str) -> None:
    """Build an archive or a wheel of sources."""
    command = [str(tools / "bin" / "python"), "-m", "hatchling", "build", "--target", target]
    run(["env", "-C", str(sources), *command, "--directory", str(out)], **environment)


def works(installed: Path, folder: Path, version: str) -> None:
    """Install the wheel in a folder; it says its version, and moves worn axes to where they should be."""
    (wheel,) = folder.glob("*.whl")
    install(installed, "--no-deps", "--force-reinstall", str(wheel))
    command = str(installed / "bin" / "pitch-gateway")
    said = run([command, "--version"]).strip()
    if said != version:
        raise FailedError(f"{wheel.name}: --version says {said!r} and not {version!r}")
    run([command, "demo", "--once", "--json"])


def try_packages(out: Path) -> None:
    """Install each package in a bare Debian of its own, run it and remove it again, as the tests do."""
    if shutil.which("lintian") is None:
        console.print("not checked with lintian, which is not here (Debian: apt-get install lintian)")
    tests = ROOT / "tests" / "package" / "test_in_a_bare_debian.py"
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-n",
        "0",
        "-p",
        "no:cacheprovider",
        "--rootdir",
        str(ROOT),
    ]
    run([*command, "-k", "package_comes or lintian", str(tests)], PACKAGES=str(out), PACKAGE_TESTS="all")


def must_be_the_same(first: Path, second: Path) -> None:
    """Compare what was made twice.

    Raises:
        FailedError: files differ; it names them.
    """
    sums = [set((folder / "SHA256SUMS").read_text().splitlines()) for folder in (first, second)]
    if differing := sorted({line.split()[1] for line in sums[0] ^ sums[1]}):
        raise FailedError(f"made twice, these are not the same: {', '.join(differing)}")


def put_in_place(out: Path, work: Path) -> None:
    """Let what was made take the place of what dist/ held."""
    if DIST.exists():
        DIST.rename(work / "before")
    out.rename(DIST)


def main() -> int:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(prog="release.py", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument(
        "--without-debs", action="store_true", help="leave out the Debian packages, which need root"
    )
    parser.add_argument("--without-compiled", action="store_true", help="leave out the compiled wheel")
    parser.add_argument("--verify", action="store_true", help="make it twice, and compare")
    options = parser.parse_args()
    parts = {"has_compiled": not options.without_compiled, "has_debs": not options.without_debs}
    start = time.monotonic()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    os.umask(0o022)
    try:
        release = examined()
        must_be_possible(**parts)
        for name in CHANGING:
            os.environ.pop(name, None)
        os.environ |= {
            "SOURCE_DATE_EPOCH": str(release.epoch),
            "PYTHONHASHSEED": "0",
            "LC_ALL": "C.UTF-8",
            "TZ": "UTC",
        }
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        console.print(f"pitch-gateway {release.version}, commit {release.commit[:7]}")
        with step("packages and bare Debians" if parts["has_debs"] else "packages"):
            fetch(has_debs=parts["has_debs"])
        with TemporaryDirectory(prefix="release-", dir=ROOT / "build") as folder:
            work = Path(folder)
            make(release, work / "first", work / "dist", **parts)
            if options.verify:
                make(release, work / "the second time", work / "again", **parts)
                must_be_the_same(work / "dist", work / "again")
            if parts["has_debs"]:
                with step("each package installed, tried and removed"):
                    try_packages(work / "dist")
            put_in_place(work / "dist", work)
    except RefusedError as refused:
        console.print(f"release: {escape(str(refused))}")
        return 1
    except FailedError as failed:
        if FULL in str(failed):
            console.print(NO_ROOM)
        else:
            console.print(f"{escape(str(failed))}\nrelease: failed, see above; dist/ is as it was")
        return 1
    except OSError as error:
        if error.errno != errno.ENOSPC:
            raise
        console.print(NO_ROOM)
        return 1
    except KeyboardInterrupt:
        console.print("release: interrupted; dist/ is as it was")
        return 130
    print((DIST / "SHA256SUMS").read_text(), end="")
    console.print(f"in {DIST}, after {time.monotonic() - start:.0f} s; see docs/release.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
