"""What a page of the documents shows, taken out of it to be tried."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
DOCS: Final = ROOT / "docs"
OMITTED: Final = "…"
_BLOCK: Final = re.compile(
    r"(?P<before>[^\n]*)\n\n```(?P<language>[a-z]+)\n(?P<text>.*?)^```$", re.DOTALL | re.MULTILINE
)


class Block(NamedTuple):
    """A block of code, and the line of text above it."""

    before: str
    language: str
    text: str

    @property
    def file(self) -> str | None:
        """The file that the reader is told to save it as."""
        named = re.search(r"[Ss]ave it as `([^`]+)`", self.before)
        return named[1] if named else None

    def commands(self) -> Iterator[tuple[str, list[str]]]:
        """Yield what is typed behind each ``$``, and the lines that are promised to follow."""
        for part in re.split(r"^\$ ", self.text, flags=re.MULTILINE)[1:]:
            command, *promised = part.splitlines()
            yield command, promised


def blocks(page: str) -> list[Block]:
    """Return the blocks of code of a page in their order."""
    return _blocks((DOCS / page).read_text(encoding="utf-8"))


def blocks_by_section(page: str) -> dict[str, list[Block]]:
    """Return the blocks of code of a page by the sections in which they are."""
    _, *sections = re.split(r"^## ", (DOCS / page).read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {section.partition("\n")[0]: _blocks(section) for section in sections}


def _blocks(text: str) -> list[Block]:
    return [Block(*found.groups()) for found in _BLOCK.finditer(text)]


def assert_promised(promised: list[str], said: str) -> None:
    """Assert that a program said what a page shows; see ``is_promised``."""
    assert is_promised(promised, said), f"promised:\n{chr(10).join(promised)}\n\nsaid:\n{said}"


def is_promised(promised: list[str], said: str) -> bool:
    """Whether a program said what a page shows.

    A line that is … stands for any number of lines, … in a line for the rest of it or of a cell.
    """
    pattern = ""
    for promise in promised:
        if promise == OMITTED:
            pattern += r"(?:.*\n)*?"
        else:
            parts = re.split(rf"{OMITTED} *", promise)
            pattern += ".*".join(map(re.escape, parts)) + r" *\n"
    return re.fullmatch(pattern, said) is not None
