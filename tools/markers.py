"""Parts of a document that the code writes: each between two comments, everything around them by hand."""

import re
from collections.abc import Callable, Sequence
from typing import Final

_PART: Final = re.compile(r"(<!-- make docs: ([a-z._ ]+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


def filled(text: str, part: Callable[[str], str]) -> str:
    r"""Return a document with all of its generated parts made anew; ``part`` makes one of its name.

    >>> filled("a\n<!-- make docs: b -->\nold\n<!-- end -->\n", lambda name: f"new {name}\n")
    'a\n<!-- make docs: b -->\nnew b\n<!-- end -->\n'
    """
    return _PART.sub(lambda found: f"{found[1]}{part(found[2])}{found[4]}", text)


def table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    r"""Return a table in Markdown.

    >>> table(("a", "b"), [("1", "2")])
    '| a | b |\n|---|---|\n| 1 | 2 |\n'
    """
    lines = [head, *rows]
    texts = [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |" for line in lines]
    return "\n".join((texts[0], "|" + "---|" * len(head), *texts[1:], ""))
