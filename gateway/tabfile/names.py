"""Names of table files: the axis of a file, and the path of a name in any case.

Software of the old controls: ``CNC7?.TAB`` (CNC7, MS-DOS), ``cnc10?.tab`` (CNC10, Linux), ``cnc-?.tab``
(CNC11 and CNC12, Windows); ``?`` is the letter of the axis. A name does not indicate the dialect. Disabling
compensation renamed the file to ``.bak``. Files of other systems have other suffixes. Each is disabled in the
same way, by ``.bak`` in place of its suffix or behind it.
"""

import os
import re
from enum import Enum
from pathlib import Path
from typing import Final

from msgspec import Struct

from gateway.tabfile.errors import FileProblem, TabFileError

_NAME: Final = re.compile(r"cnc(?:7|10|-)([a-z])\.(?:tab|bak)", re.IGNORECASE)
_COMMENT: Final = re.compile(r"\b([a-z])[\s-]*axis\b", re.IGNORECASE)
OFF_SUFFIX: Final = ".bak"
KEEP_ONE: Final = "one of them; remove or rename the others"


class TableState(Enum):
    """Whether a table is in its folder; ``off``: it was renamed to ``.bak``."""

    PRESENT = "present"
    OFF = "off"
    MISSING = "missing"


class FoundTable(Struct, frozen=True):
    """The path of a table; if the table is missing, the path at which it was expected."""

    state: TableState
    path: Path


def axis_of_name(name: str) -> str | None:
    """Return the axis letter, in upper case, of a file named after the convention, else None.

    >>> [axis_of_name(name) for name in ("cnc10z.tab", "CNC7X.TAB", "cnc-a.tab", "mill.tab")]
    ['Z', 'X', 'A', None]
    """
    match = _NAME.fullmatch(name)
    return match[1].upper() if match else None


def axis_of_comment(comment: str) -> str | None:
    """Return the letter of the only axis that a comment names, else None.

    >>> axis_of_comment(" Ver. 2 compensation tables for Z axis")
    'Z'
    """
    letters = {letter.upper() for letter in _COMMENT.findall(comment)}
    return letters.pop() if len(letters) == 1 else None


def find_table(folder: Path, name: str) -> FoundTable:
    """Find a file by its name in any case, or detect that it was disabled by renaming it to ``.bak``.

    Raises:
        TabFileError: the folder cannot be read, or several names in it differ by case only.
    """
    lowered = name.lower()
    matches = _matches(folder, lowered)
    if matches:
        return FoundTable(TableState.PRESENT, matches)
    # First behind the suffix: x.bak may be another file, a disabled x.cal.
    for backup in (lowered + OFF_SUFFIX, str(Path(lowered).with_suffix(OFF_SUFFIX))):
        switched_off = _matches(folder, backup)
        if switched_off:
            return FoundTable(TableState.OFF, switched_off)
    return FoundTable(TableState.MISSING, folder / name)


def find_axis_tables(folder: Path, axis: str) -> list[Path]:
    """Return the ``.tab`` files of an axis by the convention, sorted by name.

    Raises:
        TabFileError: the folder cannot be read.
    """
    return [
        folder / name
        for name in sorted(_names(folder))
        if Path(name).suffix.lower() == ".tab" and axis_of_name(name) == axis.upper()
    ]


def _matches(folder: Path, lowered: str) -> Path | None:
    found = sorted(name for name in _names(folder) if name.lower() == lowered)
    if len(found) > 1:
        names = ", ".join(found)
        raise TabFileError(
            FileProblem(str(folder), f"{names}, which differ only in upper and lower case", KEEP_ONE)
        )
    return folder / found[0] if found else None


def _names(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)  # noqa: PTH208 - looked at each second: names will do
    except OSError as error:
        raise TabFileError(
            FileProblem(str(folder), error.strerror or str(error), "a folder that can be read")
        ) from error
