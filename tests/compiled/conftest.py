"""What compares the compiled gateway with its sources."""

import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    """A checkout in which nothing is compiled."""
    shutil.copytree(ROOT / "gateway", tmp_path / "gateway", ignore=shutil.ignore_patterns("*.so"))
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    return tmp_path
