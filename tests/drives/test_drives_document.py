"""docs/drives.md: its table is the one that the code makes, and its example is a profile."""

import re
from pathlib import Path

from gateway.config.drive_files import read_profile
from gateway.drives.described import markdown_lines
from gateway.drives.profile import Profile

DOCUMENT = (Path(__file__).parents[2] / "docs" / "drives.md").read_text(encoding="utf-8")


def test_the_table_is_in_step_with_the_profiles() -> None:
    """If not: make docs."""
    assert "".join(f"{line}\n" for line in markdown_lines()) in DOCUMENT


def test_the_example_is_a_profile(tmp_path: Path) -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", DOCUMENT, re.DOTALL)
    path = tmp_path / "example.toml"
    path.write_text(example)
    assert read_profile(path).title == "The drive on my lathe"


def test_every_key_of_a_profile_is_explained() -> None:
    for name in Profile.model_fields:
        assert f"`{name}`" in DOCUMENT
