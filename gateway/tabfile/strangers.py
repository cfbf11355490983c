"""A text that was called a table of some format and is none."""

from gateway.tabfile.errors import TabFileError
from gateway.tabfile.text import SourceText


def stranger(source: SourceText, allowed: str) -> TabFileError:
    """Return the error of a text that its format does not recognise, told or not.

    Nothing of it is quoted: where a table should be, a link may lead to a password, and messages go far.
    """
    first = source.lines[0]
    return source.error(
        f"a first line of {len(first.text)} characters, and nothing of that format in the file",
        allowed,
        line=first.number,
    )
