"""``make release``: the same commit gives the same bytes, and what is no release is refused in one sentence.

Each test has a checkout of its own, with one commit of the files that lie here.
"""

import datetime as dt
import hashlib
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

import gateway
from tests.package.conftest import EPOCH, SYSTEMS, only_when_asked
from tests.support.programs import ran
from tools import bare_debian
from tools.bare_debian import KEPT, ROOT, Suite
from tools.packages import PARTS, build_package, fetched
from tools.release import FETCHED

QUICK = ("--without-debs", "--without-compiled")
DATE = "2026-11-22T12:00:00+00:00"
OWN = ("-c", "user.name=test", "-c", "user.email=test@localhost", "-c", "commit.gpgsign=false")

pytestmark = [
    pytest.mark.timeout(1800),
    pytest.mark.skipif(
        shutil.which("git") is None or not (ROOT / ".git").exists(),
        reason="a release is made from a checkout of git",
    ),
]


def git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *OWN, *arguments]
    dates = {"GIT_AUTHOR_DATE": DATE, "GIT_COMMITTER_DATE": DATE}
    return ran(*command, check=True, env={**os.environ, **dates}).stdout.strip()


def commit(folder: Path) -> str:
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "all")
    return git(folder, "rev-parse", "--short=7", "HEAD")


def checkout(folder: Path) -> Path:
    """A checkout with one commit: what lies here, changed or not. It shares what was fetched here."""
    for name in git(ROOT, "ls-files", "-z", "--cached", "--others", "--exclude-standard").split("\0"):
        if name and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
    git(folder, "init", "--quiet")
    commit(folder)
    KEPT.mkdir(parents=True, exist_ok=True)
    (folder / "build").mkdir()
    (folder / "build" / "kept").symlink_to(KEPT)
    return folder


@pytest.fixture(scope="module")
def committed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = checkout(tmp_path_factory.mktemp("committed") / "checkout")
    yield folder
    assert git(folder, "status", "--porcelain") == ""  # its copies share its files


@pytest.fixture
def own(committed: Path, tmp_path: Path) -> Path:
    """A copy of that checkout: to commit all of it anew takes longer than most of what is tried on it.

    Its files are the same ones, for to write thousands takes seconds too: what changes is written anew.
    """
    folder = tmp_path / "checkout"
    subprocess.run(["cp", "--archive", "--link", committed, folder], check=True)
    return folder


def release(
    folder: Path,
    *options: str,
    expected: int = 0,
    before: tuple[str, ...] = (),
    environment: Mapping[str, str] | None = None,
) -> str:
    """What `make release` runs; returns what it said on either stream."""
    done = subprocess.run(
        [*before, sys.executable, "-m", "tools.release", *options],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        env={**os.environ, **(environment or {})},
    )
    assert done.returncode == expected, done.stdout
    return done.stdout


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.unlink()
    path.write_text(text.replace(old, new, 1))


VERSION = gateway.__version__


def left(folder: Path) -> set[str]:
    """What a refusal must not leave: anything in dist/, anything new in build/."""
    return {path.name for path in (folder / "build").iterdir()} | {
        path.name for path in folder.iterdir() if path.name == "dist"
    }


NO_ROOM = "release: the disk is full, here or in the folder of temporary files: make room. dist/ is as it was"


@pytest.mark.parametrize("names", [["notes.txt"], ["notes.txt", "other.txt"], ["Maße der Achse.txt"]])
def test_what_is_not_committed_is_no_release(own: Path, names: list[str]) -> None:
    for name in names:
        (own / name).write_text("")
    more = "" if len(names) == 1 else " and 1 more"
    assert release(own, *QUICK, expected=1) == (
        f"release: not committed: {names[0]}{more}; commit, or put aside with git stash --include-untracked\n"
    )
    assert left(own) == {"kept"}


def test_an_archive_of_the_sources_is_no_checkout(own: Path) -> None:
    shutil.rmtree(own / ".git")
    assert release(own, *QUICK, expected=1) == (
        f"release: {own} is no checkout of git, and a release is made from a commit: clone the repository\n"
    )


def test_without_git_there_is_no_release(own: Path, tmp_path: Path) -> None:
    assert release(own, *QUICK, expected=1, environment={"PATH": str(tmp_path)}) == (
        "release: git is missing, and a release is made from a commit (Debian: apt-get install git)\n"
    )


@pytest.mark.parametrize("heading", ["", "## [9.9.9]", "## [9.9.9] - 2026-13-40", "## [9.9.90] - 2026-11-22"])
def test_a_version_without_its_dated_section_is_no_release(own: Path, heading: str) -> None:
    edit(own / "gateway/__init__.py", VERSION, "9.9.9")
    edit(own / "CHANGELOG.md", "## [Unreleased]\n", f"## [Unreleased]\n\n{heading}\n")
    commit(own)
    assert release(own, *QUICK, expected=1) == (
        "release: CHANGELOG.md has no section ## [9.9.9] - YYYY-MM-DD: put what is below [Unreleased] "
        "into one with today's date, or raise __version__ in gateway/__init__.py\n"
    )


def test_a_version_that_is_another_commit_already_is_no_release(own: Path) -> None:
    git(own, "tag", f"v{VERSION}")
    tagged = git(own, "rev-parse", "--short=7", "HEAD")
    (own / "README.md").unlink()
    (own / "README.md").write_text("another\n")
    now = commit(own)
    assert release(own, *QUICK, expected=1) == (
        f"release: the tag v{VERSION} is at commit {tagged} already, and this is {now}: check that one out, "
        "or raise __version__ in gateway/__init__.py and give it a section in CHANGELOG.md\n"
    )


def test_who_is_not_root_is_told_what_can_be_made(own: Path) -> None:
    become = ("unshare", "--user", "--map-user=1000", "--map-group=1000") if os.geteuid() == 0 else ()
    if become and subprocess.run([*become, "true"], check=False, capture_output=True).returncode:
        pytest.skip("this root may not make a namespace of users")
    assert release(own, expected=1, before=become) == (
        "release: no Debian packages: only root can make a bare Debian and enter it; RELEASE=--without-debs "
        "makes the rest of the release\n"
    )


def test_without_a_compiler_the_rest_can_be_made(own: Path) -> None:
    assert release(own, "--without-debs", expected=1, environment={"CC": "no-such-compiler"}) == (
        "release: no compiled wheel: there is no C compiler (no-such-compiler; Debian: apt install gcc "
        "python3-dev); RELEASE=--without-compiled makes the rest\n"
    )


def index(address: str) -> dict[str, str]:
    """What lets pip know one index of packages, and none of those of this machine."""
    none = {"PIP_CONFIG_FILE": os.devnull, "PIP_FIND_LINKS": "", "PIP_EXTRA_INDEX_URL": ""}
    return {**none, "PIP_INDEX_URL": address}


def test_without_a_network_nothing_is_begun(own: Path) -> None:
    (own / "build/kept").unlink()
    (own / "build/kept").mkdir()
    nowhere = index("http://127.0.0.1:1/") | {"PIP_RETRIES": "0"}
    said = release(own, *QUICK, expected=1, environment=nowhere).splitlines()
    assert said[-1].startswith(
        "release: packages could not be fetched (ERROR: No matching distribution found for "
    )
    assert said[-1].endswith("): is there a network? What was fetched stays in build/kept")
    assert left(own) == {"kept"}
    assert list((own / "build/kept").iterdir()) == []


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_what_is_stopped_leaves_nothing(own: Path, stop: signal.Signals) -> None:
    (own / "build/kept").unlink()
    (own / "build/kept").mkdir()
    with socket.create_server(("127.0.0.1", 0)) as silent:
        command = [sys.executable, "-m", "tools.release", *QUICK]
        environment = {**os.environ, **index(f"http://127.0.0.1:{silent.getsockname()[1]}/")}
        process = subprocess.Popen(command, cwd=own, stderr=subprocess.DEVNULL, env=environment)
        asked, _ = silent.accept()  # pip waits for an answer now
        process.send_signal(stop)
        assert process.wait() == (130 if stop == signal.SIGINT else 143)
        asked.close()
    assert left(own) == {"kept"}
    assert list((own / "build/kept").iterdir()) == []


@pytest.mark.skipif(bool(bare_debian.why_not()), reason="only root can make a small disk")
@pytest.mark.parametrize(
    ("disk", "said"),
    [
        # Sixty megabytes; and room enough, but for some thousand files, of which the tools alone have more.
        ("size=60m", "release: the disk is full: {} has [0-9]+ MB left and 800 MB are needed; make room"),
        ("size=2g,nr_inodes=7000", NO_ROOM),
    ],
)
def test_a_full_disk_leaves_what_was_there(own: Path, tmp_path: Path, disk: str, said: str) -> None:
    only_when_asked()
    small = tmp_path / "small"
    small.mkdir()
    (own / "dist").mkdir()
    (own / "dist" / "before").write_text("of the last release")
    script = (
        f'mount -t tmpfs -o {disk} tmpfs "$1" && cp -r "$2" "$1/checkout" && cd "$1/checkout" || exit 9;'
        f' "$0" -m tools.release {" ".join(QUICK)}; code=$?; ls build dist; exit $code'
    )
    command = ["unshare", "--mount", "sh", "-c", script, sys.executable, str(small), str(own)]
    done = ran(*command)
    assert done.returncode == 1, done.stdout + done.stderr
    assert re.fullmatch(said.format(f"{small}/checkout"), done.stderr.splitlines()[-1]), done.stderr
    assert done.stdout == "build:\nkept\n\ndist:\nbefore\n"


@pytest.mark.skipif(bool(bare_debian.why_not()), reason="only root can make a small disk")
def test_a_small_folder_of_temporary_files_is_named_before_anything_is_made(
    own: Path, tmp_path: Path
) -> None:
    script = f'mount -t tmpfs -o size=60m tmpfs "$TMPDIR" && exec "$0" -m tools.release {" ".join(QUICK)}'
    command = ["unshare", "--mount", "sh", "-c", script, sys.executable]
    small = tmp_path / "small"
    small.mkdir()
    before = left(own)
    environment = os.environ | {"TMPDIR": str(small)}
    done = ran(*command, cwd=own, env=environment)
    assert done.returncode == 1, done.stdout + done.stderr
    said = f"release: the disk is full: {small} has [0-9]+ MB left and 200 MB are needed; make room\n"
    assert re.fullmatch(said, done.stderr), done.stderr
    assert left(own) == before


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """What two checkouts make: other names, other modes, one with the tag on its commit."""
    only_when_asked()
    made = []
    for name, mask in (("first", 0o022), ("and the second, längere", 0o077)):
        before = os.umask(mask)
        try:
            folder = checkout(tmp_path_factory.mktemp("clone") / name)
            if mask == 0o022:
                (folder / "dist").mkdir()
                (folder / "dist" / "of-the-last-release.deb").write_text("")
            else:
                git(folder, "tag", f"v{VERSION}")
            release(folder, "--without-debs", environment={"CFLAGS": "-O0", "TZ": "Asia/Tokyo"})
        finally:
            os.umask(before)
        made.append(folder / "dist")
    return made[0], made[1]


def test_two_checkouts_of_a_commit_make_the_same_bytes(twice: tuple[Path, Path]) -> None:
    first, second = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in twice)
    wanted = {
        f"pitch_gateway-{VERSION}.tar.gz",
        f"pitch_gateway-{VERSION}-py3-none-any.whl",
        f"pitch-gateway-{VERSION}.cdx.json",
        "SHA256SUMS",
    }
    assert wanted <= set(first)
    assert len(first) == len(wanted) + 1
    assert [name for name in first if first[name] != second.get(name)] == []


def test_the_sums_are_of_all_files_and_right(twice: tuple[Path, Path]) -> None:
    done = ran("sha256sum", "--check", "--strict", "SHA256SUMS", cwd=twice[0])
    names = sorted(path.name for path in twice[0].iterdir() if path.name != "SHA256SUMS")
    assert (done.returncode, done.stdout.splitlines()) == (0, [f"{name}: OK" for name in names])


def test_the_list_names_what_is_pinned_and_nothing_of_this_machine(twice: tuple[Path, Path]) -> None:
    text = (twice[0] / f"pitch-gateway-{VERSION}.cdx.json").read_text()
    bom = json.loads(text)
    assert (bom["bomFormat"], bom["specVersion"]) == ("CycloneDX", "1.6")
    assert bom["metadata"]["timestamp"] == DATE
    assert (bom["metadata"]["component"]["name"], bom["metadata"]["component"]["version"]) == (
        "pitch-gateway",
        VERSION,
    )
    lock = (ROOT / "deploy/requirements.txt").read_text()
    pinned = {
        name.lower(): version for name, version in re.findall(r"^([\w.-]+)==([^\s;]+)", lock, re.MULTILINE)
    }
    found = {each["name"].lower().replace("_", "-"): each["version"] for each in bom["components"]}
    assert {name: pinned[name] for name in found} == found
    # What Linux does not need: a package for the colours of Windows.
    assert set(pinned) - set(found) == {"colorama"}
    for each in bom["components"]:
        assert each["licenses"], each["name"]
        assert each["hashes"], each["name"]
        for digest in each["hashes"]:
            assert f"--hash=sha256:{digest['content']}" in lock
    assert "file:" not in text
    assert str(ROOT) not in text
    assert str(twice[0].parent) not in text
    assert "/simple" not in text


def test_what_is_installed_without_a_pin_gets_into_no_list(tmp_path: Path) -> None:
    only_when_asked()
    tools = fetched("release", FETCHED)
    environment = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    pip = [str(environment / "bin/pip"), "install", "--quiet", "--no-index", "--find-links", str(tools)]
    subprocess.run([*pip, "cyclonedx-bom"], check=True)
    python = str(environment / "bin/python")
    command = [python, "-m", "tools.sbom", python, str(ROOT), VERSION, str(tmp_path / "out")]
    done = ran(*command, cwd=ROOT)
    assert done.returncode == 1
    assert re.search(
        r"^\S+==\S+ is installed, but deploy/requirements.txt does not pin it$", done.stderr, re.MULTILINE
    )
    assert not (tmp_path / "out").exists()


def test_the_archives_hold_the_commit_with_its_time_and_plain_modes(twice: tuple[Path, Path]) -> None:
    second = int(dt.datetime.fromisoformat(DATE).timestamp())
    with tarfile.open(twice[0] / f"pitch_gateway-{VERSION}.tar.gz") as archive:
        members = archive.getmembers()
    assert {(each.mtime, each.uid, each.gid) for each in members} == {(second, 0, 0)}
    assert {each.mode for each in members} == {0o644, 0o755}
    names = {each.name.removeprefix(f"pitch_gateway-{VERSION}/") for each in members}
    assert {
        "Makefile",
        "deploy/requirements.txt",
        "deploy/debian/rules",
        "tests/package/test_release.py",
    } <= names
    with zipfile.ZipFile(twice[0] / f"pitch_gateway-{VERSION}-py3-none-any.whl") as wheel:
        entries = wheel.infolist()
    assert {each.date_time for each in entries} == {(2026, 11, 22, 12, 0, 0)}
    assert {each.filename.partition("/")[0] for each in entries} == {
        "gateway",
        f"pitch_gateway-{VERSION}.dist-info",
    }


def test_the_compiled_wheel_says_where_it_runs(twice: tuple[Path, Path]) -> None:
    (wheel,) = twice[0].glob("*manylinux*.whl")
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    assert re.fullmatch(
        rf"pitch_gateway-{VERSION}-{python}-{python}-(\.?manylinux\w+_{os.uname().machine})+.whl", wheel.name
    )


def test_a_package_is_the_same_bytes_when_it_is_built_again(
    suite: Suite, package: Path, tmp_path: Path
) -> None:
    sources = tmp_path / "other sources"
    for part in PARTS:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, sources / part, copy_function=shutil.copyfile)
        else:
            shutil.copyfile(ROOT / part, sources / part)
    for path in sources.rglob("*.sh"):
        path.chmod(0o700)
    (sources / "deploy/debian/rules").chmod(0o700)
    again = build_package(sources, suite, SYSTEMS / f"{os.getpid()}-again", EPOCH, tmp_path)
    assert again.name == package.name
    sums = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (package, again)]
    assert sums[0] == sums[1]
