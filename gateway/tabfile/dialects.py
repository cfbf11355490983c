"""The dialects that can be read and written. A new one is one file and one entry in :data:`DIALECTS`."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gateway.compensation.table import CorrectionTable
from gateway.tabfile import centroid_v1, centroid_v2, centroid_v3
from gateway.tabfile.context import FileContext
from gateway.tabfile.decoded import Decoded
from gateway.tabfile.errors import Problem, TabFileError
from gateway.tabfile.text import SourceText, shown
from gateway.tabfile.writing import WriteOptions, Written


@dataclass(frozen=True, slots=True)
class Dialect:
    """One file format: how to tell it, read it and write it."""

    name: str
    title: str
    recognise: Callable[[str], bool]
    """Judges the first line that is not blank."""
    read: Callable[[SourceText, FileContext], Decoded]
    write: Callable[[CorrectionTable, WriteOptions], Written]
    has_units: bool = True
    """Whether the file states its own units."""


DIALECTS: Final = (
    Dialect(centroid_v3.NAME, centroid_v3.TITLE, centroid_v3.recognise, centroid_v3.read, centroid_v3.write),
    Dialect(centroid_v2.NAME, centroid_v2.TITLE, centroid_v2.recognise, centroid_v2.read, centroid_v2.write),
    Dialect(
        centroid_v1.NAME,
        centroid_v1.TITLE,
        centroid_v1.recognise,
        centroid_v1.read,
        centroid_v1.write,
        has_units=False,
    ),
)


_OF_A_TABLE: Final = re.compile(r"(?i)(cnc|#)[\w .#-]*|[0-9e+., \t-]*")
"""What is quoted in messages. Where a table should be, a link may lead to a password, and messages go far."""


def sniff(source: SourceText) -> Dialect:
    """Return the dialect of a file by its first line.

    Raises:
        TabFileError: no dialect knows the line.
    """
    first = source.lines[0]
    for dialect in DIALECTS:
        if dialect.recognise(first.text):
            return dialect
    is_shown = _OF_A_TABLE.fullmatch(first.text) is not None
    what = shown(first.text) if is_shown else f"of {len(first.text)} characters, which is of no table"
    raise source.error(
        f"an unknown first line {what}",
        "'CNC10 TAB FILE VERSION 3', or six numbers that begin with 2 (version 2), or two whole numbers "
        "(version 1)",
        line=first.number,
    )


def dialect_named(name: str) -> Dialect:
    """Return the dialect of a name such as ``centroid-3``.

    Raises:
        TabFileError: no dialect has this name.
    """
    for dialect in DIALECTS:
        if dialect.name == name:
            return dialect
    raise TabFileError(
        Problem("dialect", repr(name), ", ".join(sorted(dialect.name for dialect in DIALECTS)))
    )
