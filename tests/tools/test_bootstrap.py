"""tools/bootstrap.sh on a machine where something is missing: a sentence, and nothing half made."""

import contextlib
import os
import pty
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = """\
[build-system]
requires = []
build-backend = "backend"
backend-path = ["."]

[project]
name = "small"
version = "1"
classifiers = ["Programming Language :: Python :: 3.11", "Programming Language :: Python :: 3.12"]
"""
BACKEND = '''\
"""Makes a wheel of nothing, so that pip needs no index."""

import zipfile


def build_editable(folder, settings=None, metadata=None):
    name = "small-1-py3-none-any.whl"
    with zipfile.ZipFile(f"{folder}/{name}", "w") as wheel:
        wheel.writestr("small-1.dist-info/METADATA", "Metadata-Version: 2.1\\nName: small\\nVersion: 1\\n"
                       "Provides-Extra: dev\\nProvides-Extra: docs\\n")
        wheel.writestr("small-1.dist-info/WHEEL", "Wheel-Version: 1.0\\nRoot-Is-Purelib: true\\n"
                       "Tag: py3-none-any\\n")
        wheel.writestr("small-1.dist-info/RECORD", "")
    return name
'''
OLD = f"""\
#!/bin/sh
[ "$1" = -c ] || exit 1
exec "{sys.executable}" -c "import platform, sys
sys.version_info = (3, 9, 18)
platform.python_version = lambda: '3.9.18'
$2"
"""
"""A Python that says that it is too old."""
QUICK = """\
#!/bin/sh
if [ "$1 $2" = "-m venv" ]; then
    "{python}" -m venv --without-pip "$3"
    for site in "{ready}"/lib/python*/site-packages; do
        cp -a "$site"/pip "$site"/pip-* "$3/lib/${{site#*/lib/}}"
    done
    sed "s|{ready}|$PWD/$3|" "{ready}/bin/pip" >"$3/bin/pip"
    chmod +x "$3/bin/pip"
    exit
fi
exec "{python}" "$@"
"""
"""A Python that puts the pip of another environment into each that it makes: to unpack that takes seconds."""
TOOL = "build/tools/small"
"""The environment of a tool, in its checkout."""


pytestmark = pytest.mark.timeout(600)
"""An environment takes some seconds, and minutes where everything else runs, too."""


def small_checkout(parent: Path) -> Path:
    """Make a checkout of a package that needs nothing, in a path with a blank and an umlaut."""
    folder = parent / "small gateway ä"
    (folder / "tools").mkdir(parents=True)
    shutil.copy(ROOT / "tools" / "bootstrap.sh", folder / "tools")
    (folder / "pyproject.toml").write_text(PROJECT)
    (folder / "backend.py").write_text(BACKEND)
    return folder


@pytest.fixture(name="checkout")
def _checkout(tmp_path: Path) -> Path:
    return small_checkout(tmp_path)


@pytest.fixture(name="ready", scope="module")
def _ready(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkout with its environment, where another one was interrupted before: it takes seconds to make."""
    folder = small_checkout(tmp_path_factory.mktemp("ready"))
    (folder / ".venv" / "bin").mkdir(parents=True)
    script(folder / ".venv" / "bin" / "python", "#!/bin/sh\nexit 1\n")
    (folder / ".venv" / ".unfinished").touch()
    code, said = bootstrap(folder)
    assert code == 0, said
    return folder


@pytest.fixture(name="quick", scope="module")
def _quick(ready: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A Python for environments of which only what comes after the making is looked at."""
    text = QUICK.format(python=sys.executable, ready=ready / ".venv")
    return script(tmp_path_factory.mktemp("quick") / "python3", text)


@pytest.fixture(name="program", scope="module")
def _program(quick: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A checkout with the program alone, and what was said as that was made."""
    folder = small_checkout(tmp_path_factory.mktemp("program"))
    code, said = bootstrap(folder, "--editable", ".", PYTHON=quick)
    assert code == 0, said
    return folder, said


@pytest.fixture(name="tool", scope="module")
def _tool(quick: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    """A checkout with the environment of a tool alone, made on a terminal, and what was said there."""
    folder = small_checkout(tmp_path_factory.mktemp("tool"))
    master, slave = pty.openpty()
    command = [str(folder / "tools" / "bootstrap.sh"), "--editable", "."]
    environment = {"PATH": os.environ["PATH"], "HOME": str(folder), "PYTHON": quick, "VENV": TOOL}
    with subprocess.Popen(command, env=environment, stdout=slave, stderr=slave, stdin=slave) as process:
        os.close(slave)
        said = b""
        with contextlib.suppress(OSError):  # the other end is closed
            while data := os.read(master, 4096):
                said += data
    os.close(master)
    assert process.returncode == 0, said
    return folder, said


def bootstrap(folder: Path, *packages: str, **environment: str) -> tuple[int, str]:
    """Run it where no index answers; returns its exit code and what it said."""
    known = {
        "PATH": os.environ["PATH"],
        "HOME": str(folder),
        "PYTHON": sys.executable,
        "PIP_CONFIG_FILE": os.devnull,
        "PIP_INDEX_URL": "http://127.0.0.1:9/",
        "PIP_RETRIES": "0",
        "PIP_NO_CACHE_DIR": "1",
    }
    command = [str(folder / "tools" / "bootstrap.sh"), *packages]
    done = subprocess.run(command, env=known | environment, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def script(path: Path, text: str) -> str:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return str(path)


def test_what_is_ready_is_left_alone(ready: Path) -> None:
    made = (ready / ".venv" / "pyvenv.cfg").stat().st_mtime_ns
    assert bootstrap(ready) == (0, "")
    assert (ready / ".venv" / "pyvenv.cfg").stat().st_mtime_ns == made


def test_the_part_that_runs_comes_first_and_the_tools_are_added_to_it(program: tuple[Path, str]) -> None:
    """So `make demo` takes a quarter of what `make test` does, and what it has made is kept."""
    checkout, _ = program
    venv = checkout / ".venv"
    made = (venv / "pyvenv.cfg").stat().st_mtime_ns
    assert bootstrap(checkout, "--editable", ".") == (0, "")
    code, said = bootstrap(checkout)
    assert code == 0, said
    assert said.startswith("adding to .venv: about 160 MB to fetch, ")
    assert (venv / "pyvenv.cfg").stat().st_mtime_ns == made
    # All that runs is among what is there now.
    assert bootstrap(checkout, "--editable", ".") == (0, "")
    assert bootstrap(checkout) == (0, "")


def test_it_says_what_it_does_line_by_line(program: tuple[Path, str]) -> None:
    _, said = program
    first, installing, last = said.splitlines()
    assert first.startswith("setting up .venv with Python 3.")
    assert first.endswith(": about 55 MB to fetch, about 210 MB on the disk ...")
    assert installing == "  installing 1 packages"
    assert re.fullmatch(r"\.venv is ready after \d+ s: \d+ MB", last)


def test_on_a_terminal_one_line_changes(tool: tuple[Path, bytes]) -> None:
    _, said = tool
    assert re.search(rb"\r\x1b\[K  looking up what is needed, \d+ s", said)
    assert re.search(rb"\r\x1b\[K  installing 1 packages, \d+ s", said)
    assert re.search(rb"\r\x1b\[Kbuild/tools/small is ready after \d+ s", said)
    assert said.count(b"\n") == 2


def test_a_folder_that_was_moved_gets_an_environment_anew(ready: Path, quick: str, tmp_path: Path) -> None:
    moved = tmp_path / "elsewhere"
    shutil.copytree(ready, moved, symlinks=True)
    assert str(ready) in (moved / ".venv" / "bin" / "pip").read_text()
    code, said = bootstrap(moved, PYTHON=quick)
    assert code == 0, said
    pip = (moved / ".venv" / "bin" / "pip").read_text()
    assert str(moved) in pip
    assert str(ready) not in pip


def test_a_python_that_is_too_old_is_told_in_a_sentence(checkout: Path, ready: Path) -> None:
    old = script(checkout / "old" / "python3", OLD)
    said = f"setup: PYTHON={old} is Python 3.9.18; name a Python 3.11 or newer\n"
    assert bootstrap(checkout, PYTHON=old) == (1, said)
    assert not (checkout / ".venv").exists()
    assert bootstrap(ready, PYTHON=old) == (1, said)


def test_where_no_python_is_new_enough_it_says_how_to_name_one(checkout: Path) -> None:
    for name in ("python3", "python3.11", "python3.12"):
        script(checkout / "old" / name, OLD)
    path = f"{checkout / 'old'}{os.pathsep}{os.environ['PATH']}"
    said = "pitch-gateway needs Python 3.11 or newer and none was found; install one, or name it: "
    assert bootstrap(checkout, PYTHON="", PATH=path) == (1, f"setup: {said}PYTHON=/path/to/python3\n")
    assert not (checkout / ".venv").exists()


def test_a_python_that_does_not_run_is_named(checkout: Path) -> None:
    assert bootstrap(checkout, PYTHON="/nowhere/python3") == (
        1,
        "setup: PYTHON=/nowhere/python3 does not run; name a Python 3.11 or newer\n",
    )


def test_without_a_network_it_says_so_and_leaves_nothing(checkout: Path, quick: str) -> None:
    (checkout / "pyproject.toml").write_text(PROJECT.replace("requires = []", 'requires = ["hatchling"]'))
    code, said = bootstrap(checkout, PYTHON=quick)
    assert code == 1
    (told,) = said.splitlines()[1:]
    assert told.startswith(
        "setup: no index that has the packages could be reached: connect this machine, or let "
    )
    assert not (checkout / ".venv").exists()


def test_a_tool_has_an_environment_of_its_own(tool: tuple[Path, bytes]) -> None:
    checkout, _ = tool
    assert bootstrap(checkout, "--editable", ".", VENV=TOOL) == (0, "")
    assert (checkout / TOOL / "bin" / "python").exists()
    assert not (checkout / ".venv").exists()


def test_a_tool_that_cannot_be_fetched_is_told_in_a_sentence_and_leaves_nothing(
    checkout: Path, quick: str
) -> None:
    code, said = bootstrap(checkout, "pip-audit", VENV="build/tools/pip-audit", PYTHON=quick)
    assert code == 1
    (told,) = said.splitlines()[1:]
    assert told.startswith("setup: no index that has the packages could be reached: connect this machine")
    assert list((checkout / "build" / "tools").iterdir()) == []


def test_what_was_interrupted_counts_as_nothing(ready: Path) -> None:
    done = subprocess.run([ready / ".venv" / "bin" / "python", "-c", ""], check=False)
    assert done.returncode == 0
    assert not (ready / ".venv" / ".unfinished").exists()


def test_a_full_disk_is_named_and_left_as_it_was(checkout: Path) -> None:
    """A file system of 8 MB, of which pip alone needs more."""
    who = [] if os.geteuid() == 0 else ["--map-root-user"]
    small = checkout.with_name("small disk")
    small.mkdir()
    commands = (
        'mount -t tmpfs -o size=8m tmpfs "$1" && cp -r "$2/." "$1" && ls -A "$1" && "$1/tools/bootstrap.sh"'
    )
    inside = ["unshare", *who, "--mount", "bash", "-c", f'{commands}; echo "exit $?"; ls -A "$1"', "bash"]
    if subprocess.run([*inside[:-4], "true"], capture_output=True, check=False).returncode != 0:
        pytest.skip("this user may not mount")
    done = subprocess.run(
        [*inside, str(small), str(checkout)],
        env={"PATH": os.environ["PATH"], "PYTHON": sys.executable, "HOME": str(checkout)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split("exit 1\n") == ["backend.py\npyproject.toml\ntools\n"] * 2
    assert done.stderr.splitlines()[1].startswith("setup: the disk is full: .venv needs about 550 MB, and ")
    assert len(done.stderr.splitlines()) == 2
