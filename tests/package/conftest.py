"""What the tests of the packages share; each part is made once.

What takes minutes, a bare Debian or a release made twice, is tried with ``PACKAGE_TESTS=all`` only, that is
by ``make test-package``: in every Debian that there is a package for. ``PACKAGES`` names a folder with
packages that are tried as they are.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools import bare_debian
from tools.bare_debian import ROOT, SUITES, BareDebian, Suite
from tools.packages import build_package, wheels

SYSTEMS = ROOT / "build" / "systems"
EPOCH = 1_795_305_600
"""2026-11-22 00:00 UTC: the same package, whenever a test builds it."""


def only_when_asked() -> None:
    """Leave a test out that takes minutes, unless such tests were asked for."""
    if os.environ.get("PACKAGE_TESTS") != "all":
        pytest.skip("it takes minutes: tried with PACKAGE_TESTS=all (make test-package)")


@pytest.fixture(scope="session", params=SUITES, ids=[suite.name for suite in SUITES])
def suite(request: pytest.FixtureRequest) -> Suite:
    """A release of Debian."""
    wanted: Suite = request.param
    only_when_asked()
    if why := bare_debian.why_not():
        pytest.skip(why)
    return wanted


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Our own, for every machine."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="session")
def package(suite: Suite, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package of a suite, built as ``make release`` does; or that in the folder that PACKAGES names."""
    if named := os.environ.get("PACKAGES"):
        (found,) = Path(named).glob(f"pitch-gateway_*+deb{suite.number}u*.deb")
        return found
    folder = tmp_path_factory.mktemp("package")
    work = SYSTEMS / f"{os.getpid()}-builds"
    return build_package(ROOT, suite, work, EPOCH, folder)


@pytest.fixture
def debian(suite: Suite, request: pytest.FixtureRequest) -> Iterator[BareDebian]:
    """A bare system of that suite, which knows no index of packages."""
    folder = SYSTEMS / request.node.name
    shutil.rmtree(folder, ignore_errors=True)
    yield BareDebian(folder, suite)
    shutil.rmtree(folder)


@pytest.fixture
def given_wheels(debian: BareDebian, wheel: Path) -> Path:
    """The folder in the bare system with all that an installation takes, our own wheel among it."""
    debian.copy_in(wheels(debian.suite), "wheels")
    debian.copy_in(wheel, f"wheels/{wheel.name}")
    return Path("/wheels", wheel.name)
