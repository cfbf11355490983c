"""Where an installation lacks something: one sentence says what, and nothing half made is left."""

import platform
import sys
from pathlib import Path

import pytest

from gateway import __version__
from tools.bare_debian import BOOKWORM, KEPT, ROOT, BareDebian, run
from tools.packages import PARTS, wheels

pytestmark = pytest.mark.timeout(900)
INSTALL = "/src/deploy/install.sh"
LACKING = f"there is no C compiler ({platform.machine()}-linux-gnu-gcc; Debian: apt install gcc python3-dev)"
PURE = f"not compiled: {LACKING}; as Python it does the same, and adds more to an exchange over TCP\n"
FROM_FOLDER = f"{INSTALL} --pure --find-links /wheels install"
UNCHANGED = "install.sh: nothing was changed\n"


@pytest.fixture
def poor(debian: BareDebian) -> BareDebian:
    """Without a compiler and without an index; with the checkout, and the wheels in a folder."""
    for part in PARTS:
        debian.copy_in(ROOT / part, f"src/{part}")
    debian.copy_in(wheels(debian.suite), "wheels")
    return debian


def what_is_there(debian: BareDebian) -> set[str]:
    """All paths; the folder of the releases, which has a lock meanwhile, may come."""
    temporary = {str(path.relative_to(debian.folder)) for path in (debian.folder / "tmp").iterdir()}
    return ({*debian.tree()} | temporary) - {"opt/pitch-gateway.releases"}


def test_without_a_compiler_the_installer_goes_on_as_python_and_says_so(poor: BareDebian) -> None:
    install = f"{INSTALL} --find-links /wheels"
    before = what_is_there(poor)
    said = poor.does(f"{install} --compiled install", expected=1)
    assert said == f"environment.sh: --compiled: {LACKING}\n"
    assert what_is_there(poor) == before
    said = poor.does(f"{install} install")
    assert said.startswith(PURE)
    assert said.count("not compiled") == 1
    assert poor.does("pitch-gateway --version") == f"pitch-gateway {__version__}\n"
    assert list((poor.folder / "tmp").iterdir()) == []
    again = poor.does(f"{install} --pure install")
    assert "nothing to do" in again
    assert "not compiled" not in again  # it was asked for


def fails_on_a_disk(debian: BareDebian, folder: str, option: str) -> str:
    """What the installer says where a folder is a disk of its own, and what it leaves there."""
    return debian.does(
        f"mount -n -t tmpfs -o {option} tmpfs {folder} && {FROM_FOLDER}; code=$?; "
        f"find {folder} -mindepth 1 ! -name pitch-gateway.releases; exit $code",
        expected=1,
    )


def test_what_cannot_be_installed_is_told_in_one_sentence_and_leaves_nothing(poor: BareDebian) -> None:
    before = what_is_there(poor)

    # No network.
    said = poor.does(f"unshare --net {INSTALL} --pure install", expected=1)
    assert said.startswith("environment.sh: annotated-doc==")
    assert said.endswith(
        " cannot be fetched. Is there a network? Without one: --find-links DIR, with all packages in DIR "
        f"(docs/install.md)\n{UNCHANGED}"
    )
    assert said.count("\n") == 2
    assert what_is_there(poor) == before

    # A full disk: where it goes, where temporary files are, or without room for names.
    for folder, size, needed, more in (
        ("/opt", 60, 400, ""),
        ("/tmp", 60, 200, ", or set TMPDIR to another folder"),
    ):
        said = fails_on_a_disk(poor, folder, f"size={size * 1000}k")
        assert said.startswith(f"environment.sh: {folder}")
        assert f" has {size} MB free, and {needed} MB are needed while the environment is made: " in said
        assert f"make room{more}\n{UNCHANGED}" in said
        assert said.count("\n") == 2
    said = fails_on_a_disk(poor, "/opt", "nr_inodes=2000")
    assert said == (
        "environment.sh: the disk is full, in /opt/pitch-gateway.releases or in /tmp: make room "
        f"(df and df -i show where)\n{UNCHANGED}"
    )
    assert what_is_there(poor) == before

    # A package that is another one than the one that was pinned.
    (wheel,) = (poor.folder / "wheels").glob("idna-*.whl")
    whole = wheel.read_bytes()
    wheel.write_bytes(whole + b"\n")
    said = poor.does(FROM_FOLDER, expected=1)
    assert said.startswith("environment.sh: a package is not the one that deploy/requirements.txt")
    assert f"idna=={wheel.name.split('-')[1]} from file:///wheels/{wheel.name}" in said
    assert said.endswith(UNCHANGED)
    assert said.count("\n") == 2
    wheel.unlink()
    assert poor.does(FROM_FOLDER, expected=1) == (
        f"environment.sh: idna=={wheel.name.split('-')[1]} for this Python and machine is not in the folder "
        f"of --find-links; docs/install.md says how to fill it\n{UNCHANGED}"
    )
    wheel.write_bytes(whole)
    assert what_is_there(poor) == before


def test_a_pip_that_is_too_old_is_named(poor: BareDebian) -> None:
    if poor.suite != BOOKWORM:
        pytest.skip("the Python of a newer Debian does not run a pip that is too old")
    old = KEPT / "pip-22.0.4-py3-none-any.whl"  # came with Python 3.10
    if not old.exists():
        run(
            [
                sys.executable,
                "-m",
                "pip",
                "download",
                "--quiet",
                "--no-deps",
                "--dest",
                str(KEPT),
                "pip==22.0.4",
            ]
        )
    (own,) = (poor.folder / "usr/share/python-wheels").glob("pip-*.whl")
    own.unlink()
    poor.copy_in(old, f"usr/share/python-wheels/{old.name}")
    before = what_is_there(poor)
    said = poor.does(FROM_FOLDER, expected=1)
    assert said == (
        "environment.sh: /usr/bin/python3.11 brings pip 22.0.4, and 22.3 or newer is needed: update Python, "
        f"or name another one with --python\n{UNCHANGED}"
    )
    assert what_is_there(poor) == before


def test_a_python_that_is_too_old_is_named(poor: BareDebian) -> None:
    # It says its version, and fails at what a newer one can do.
    poor.write("usr/local/bin/python3.9", '#!/bin/sh\n[ "$1" = --version ] && echo Python 3.9.2\n')
    (Path(poor.folder) / "usr/local/bin/python3.9").chmod(0o755)
    before = what_is_there(poor)
    said = poor.does(f"{INSTALL} --python /usr/local/bin/python3.9 install", expected=1)
    assert said.startswith("install.sh: needs Python 3.11 or newer; /usr/local/bin/python3.9 was found")
    said = poor.does("/src/deploy/environment.sh --python /usr/local/bin/python3.9 /new", expected=1)
    assert said.startswith(
        "environment.sh: needs Python 3.11 or newer; /usr/local/bin/python3.9 is Python 3.9.2 ("
    )
    assert said.count("\n") == 1
    assert what_is_there(poor) == before
