"""Compiled in an environment that was empty, by pip and by the installer, where there is a compiler."""

import shutil
from collections.abc import Iterator

import pytest

from gateway import __version__
from tests.package.conftest import SYSTEMS
from tests.package.test_in_a_bare_debian import ends_well
from tools.bare_debian import BUILDING, ROOT, BareDebian, Suite
from tools.packages import PARTS, wheels

COMPILED = f"pitch-gateway {__version__} (compiled)\n"
WORK = "mkdir -p /var/tmp/work && export TMPDIR=/var/tmp/work"
"""So that what is left behind is seen."""

pytestmark = pytest.mark.timeout(1800)


@pytest.fixture
def with_compiler(suite: Suite, request: pytest.FixtureRequest) -> Iterator[BareDebian]:
    """What builds the package: python3-dev and gcc are there, an index of packages is not."""
    folder = SYSTEMS / request.node.name
    shutil.rmtree(folder, ignore_errors=True)
    debian = BareDebian(folder, suite, BUILDING)
    for part in PARTS:
        debian.copy_in(ROOT / part, f"src/{part}")
    debian.copy_in(wheels(suite), "wheels")
    yield debian
    shutil.rmtree(folder)


def test_pip_compiles_in_an_environment_that_was_empty(with_compiler: BareDebian) -> None:
    # It builds in isolation: what the compiling needs is what the hook says that it needs.
    said = with_compiler.does(
        f"{WORK} PIP_NO_INDEX=1 PIP_FIND_LINKS=/wheels PITCH_GATEWAY_COMPILED=1 && python3 -m venv /env && "
        "/env/bin/pip install --quiet /src && /env/bin/pitch-gateway --version"
    )
    assert said == COMPILED
    assert list((with_compiler.folder / "var/tmp/work").iterdir()) == []
    assert not (with_compiler.folder / "src" / "build").exists()


def test_the_installer_compiles_without_being_asked(with_compiler: BareDebian) -> None:
    install = f"{WORK} && /src/deploy/install.sh --find-links /wheels"
    said = with_compiler.does(f"{install} install")
    assert "not compiled" not in said
    assert with_compiler.does("pitch-gateway --version") == COMPILED
    ends_well(with_compiler)
    assert list((with_compiler.folder / "var/tmp/work").iterdir()) == []
    for same in ("", "--compiled "):
        assert "nothing to do" in with_compiler.does(f"{install} {same}install")
    # Asked for as Python it is another release, though all else is the same.
    assert "would make /opt/pitch-gateway.releases/" in with_compiler.does(
        f"{install} --pure --dry-run install"
    )
    # Without the headers it goes on, and says what it goes on without.
    (header,) = (with_compiler.folder / "usr/include").glob("python3.*/Python.h")
    header.unlink()
    lacking = f"there is no /{header.relative_to(with_compiler.folder)} (Debian: apt install python3-dev)"
    said = with_compiler.does(f"{install} --dry-run install")
    assert said.startswith(f"not compiled: {lacking}; as Python it does the same, ")
    assert "would make /opt/pitch-gateway.releases/" in said
    said = with_compiler.does(f"{install} --compiled install", expected=1)
    assert said == f"environment.sh: --compiled: {lacking}\n"
