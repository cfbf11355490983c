"""What the tests of the packages share; each part is made once."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.package import bare_debian
from tests.package.bare_debian import BUILD, ROOT, WHEELS, BareDebian, make_seed, make_wheels, run


@pytest.fixture(scope="session")
def wheel() -> Path:
    return make_wheels()


@pytest.fixture(scope="session")
def package(wheel: Path) -> Path:
    """The package, as ``make deb`` builds it, but without the network; or the one that PACKAGE names."""
    if why := bare_debian.why_not():
        pytest.skip(why)
    if named := os.environ.get("PACKAGE"):
        return Path(named)
    run([str(ROOT / "tools" / "deb.sh")], FIND_LINKS=str(WHEELS), WHEEL=str(wheel))
    (found,) = (ROOT / "dist").glob("pitch-gateway_*.deb")
    return found


@pytest.fixture
def debian(request: pytest.FixtureRequest) -> Iterator[BareDebian]:
    if why := bare_debian.why_not():
        pytest.skip(why)
    make_seed()
    folder = BUILD / "roots" / request.node.name
    shutil.rmtree(folder, ignore_errors=True)
    yield BareDebian(folder)
    shutil.rmtree(folder, ignore_errors=True)
