"""Rows of the file of an instrument: which cell is the reading, and whether it can be the whole of it.

A row ``50,0053`` is 50.0053 with a decimal comma, or 50 and 53 in two columns. Taken for two columns it would
show a perfect axis. So a row must have as many columns as the names above it; where there are none, a whole
number beside another one is no reading.
"""

import csv
import re
from typing import Final

from gateway.cli.measuring.errors import BadReadingError, InstrumentError

SHOWN: Final = 60
TAB: Final = ("tab", r"\t")
_NUMBER: Final = re.compile(r"\s*[+-]?(\d+[.,]?\d*|[.,]\d+)\s*")
_WHOLE: Final = re.compile(r"\s*[+-]?\d+\s*")


class Columns:
    """The columns of one file; ``wanted`` is the name of one in its first row, or its number from 1.

    Raises:
        InstrumentError: no delimiter of one character, column 0.
    """

    def __init__(self, path: str, wanted: str, delimiter: str) -> None:
        self._path = path
        self._wanted = wanted
        self._delimiter = "\t" if delimiter in TAB else delimiter
        if len(self._delimiter) != 1 or self._delimiter in '"\r\n':
            raise InstrumentError(
                f"--delimiter {delimiter!r}: the one character that stands between columns, such as ; or tab"
            )
        if wanted.isdecimal() and int(wanted) < 1:
            raise InstrumentError("--column 0: columns count from 1")
        self._index = int(wanted) - 1 if wanted.isdecimal() else 0
        self._width: int | None = None

    def settle(self, rows: bytes) -> None:
        """Take the rows that are there already; the first one may name the columns.

        Raises:
            InstrumentError: no column of that name, or two.
        """
        above = [self._cells(row) for row in rows.decode("utf-8-sig", "replace").splitlines()]
        names = [name.strip() for name in above[0]] if above else []
        if not self._wanted.isdecimal():
            if names.count(self._wanted) != 1:
                raise InstrumentError(
                    f"{self._path}: --column {self._wanted}: its first row has "
                    f"{', '.join(names) or 'nothing'}; give one of these names, or a number from 1, and with "
                    "--delimiter what stands between columns"
                )
            self._index = names.index(self._wanted)
        heads = [row for row in above if any(row) and not any(_NUMBER.fullmatch(cell) for cell in row)]
        if heads:
            self._width = len(heads[-1])

    def reading(self, row: bytes) -> str:
        """Return the cell that is the reading.

        Raises:
            BadReadingError: the row has another number of columns, or may have a decimal comma.
        """
        shown = repr(row[:SHOWN].decode("utf-8", "replace"))
        cells = self._cells(row.decode("utf-8", "replace"))
        if self._width is not None and len(cells) != self._width:
            raise BadReadingError(
                f"{shown} has {len(cells)} column(s), the names above {self._width}; {self._remedy()}"
            )
        if self._index >= len(cells):
            raise BadReadingError(f"{shown} has no column {self._index + 1}; {self._remedy()}")
        if self._width is None and self._delimiter == ",":
            beside = cells[max(0, self._index - 1) : self._index + 2]
            if sum(_WHOLE.fullmatch(cell) is not None for cell in beside) > 1:
                raise BadReadingError(
                    f"{shown} may be a number with a decimal comma; {self._remedy()}, or a first "
                    "row with the names of the columns"
                )
        return cells[self._index]

    def _remedy(self) -> str:
        return (
            "--delimiter is what stands between columns, and the instrument must write numbers with a "
            "decimal point"
        )

    def _cells(self, row: str) -> list[str]:
        try:
            return next(csv.reader([row.rstrip("\r\n")], delimiter=self._delimiter, strict=True), [])
        except csv.Error:  # a quotation mark without its other one: the cells as they stand
            return row.split(self._delimiter)
