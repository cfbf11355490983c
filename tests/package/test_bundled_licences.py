"""debian/copyright has a paragraph for each package that the Debian package brings."""

import re
import sys
import sysconfig
from importlib.metadata import PathDistribution, version
from pathlib import Path

import pytest

from tests.support.programs import ran
from tools import bundled_licences

ROOT = Path(__file__).parents[2]


def test_every_package_that_is_installed_has_its_files_its_holders_and_its_licence() -> None:
    tool = ROOT / "tools" / "bundled_licences.py"
    done = ran(sys.executable, tool, sysconfig.get_path("purelib"), check=True)
    paragraphs = done.stdout.strip().split("\n\nFiles: ")
    assert all(re.search(r"^Copyright: .", each, re.MULTILINE) for each in paragraphs)
    licences = re.findall(r"^License: (.*)$", done.stdout, re.MULTILINE)
    assert len(licences) == len(paragraphs)
    for name in ("numpy", "cryptography", "h11", "pyserial"):
        assert f"{name}-{version(name)}" in licences
    (h11,) = (each for each in paragraphs if f"License: h11-{version('h11')}\n" in each)
    assert "site-packages/h11/*\n" in h11
    assert "Nathaniel J. Smith" in h11
    assert "\n Permission is hereby granted, free of charge" in h11
    # A line without a blank in front would begin another field.
    assert {line.split(" ")[0] for line in h11.splitlines()[1:]} <= {"", "Copyright:", "License:"}


def test_a_package_that_says_nowhere_what_its_licence_is_ends_the_build(tmp_path: Path) -> None:
    folder = tmp_path / "nameless-1.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: nameless\nVersion: 1\n")
    with pytest.raises(ValueError, match="nameless 1 says nowhere what its licence is"):
        bundled_licences.paragraph(PathDistribution(folder))
