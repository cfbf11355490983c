"""``tests/soak.py`` names every file of tests that does less in ``make test`` than in ``make soak``."""

import re
from pathlib import Path

from tests import soak

TESTS = Path(__file__).parent


def test_every_file_that_does_less_is_listed() -> None:
    asks = {
        path.relative_to(TESTS).as_posix()
        for path in TESTS.rglob("test_*.py")
        if re.search(r"^from tests\.soak import ", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert len(asks) > 10
    assert set(re.findall(r"``((?:\w+/)+test_\w+\.py)``", soak.__doc__ or "")) == asks
