"""What the tests with whole processes share."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.gateway import Site, site_in


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """A configuration with a drive that answers."""
    with site_in(tmp_path) as site:
        yield site
