"""The sources of readings at a stop: a person, a growing file, a gauge on a serial port.

Each gives the next reading after the axis is at standstill. Data from before, during the motion, are not of
this stop: they are an error, never skipped.

A row ``50,0053`` of a file is 50.0053 with a decimal comma, or 50 and 53 in two columns. Read as two columns
it would show a perfect axis. So a row must have as many columns as the header. Without a header, a whole
number beside another number is not a reading.
"""

import asyncio
import contextlib
import csv
import os
import re
import select
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Final, Protocol

from gateway.commissioning.measure.errors import (
    BadReadingError,
    InstrumentError,
    StoppedError,
    TakenBackError,
)
from gateway.metrology.gauge_kinds import GaugeKind
from gateway.metrology.gauges import GaugeError, GaugeLines, reading_of
from gateway.transport.channel import Channel
from gateway.transport.devices import open_port
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.errors import TransportError
from gateway.transport.serial_channel import SerialChannel

SHOWN: Final = 60
TAB: Final = ("tab", r"\t")
_CELL: Final = re.compile(r"\s*[+-]?(\d+[.,]?\d*|[.,]\d+)\s*")
_WHOLE: Final = re.compile(r"\s*[+-]?\d+\s*")


class Columns:
    """The columns of one file; ``column`` is its name in the first row, or its number from 1.

    Raises:
        InstrumentError: a delimiter that is not one character, column 0.
    """

    def __init__(self, path: str, column: str, delimiter: str) -> None:
        self._path = path
        self._column = column
        self._delimiter = "\t" if delimiter in TAB else delimiter
        if len(self._delimiter) != 1 or self._delimiter in '"\r\n':
            raise InstrumentError(
                f"--delimiter {delimiter!r}: give the one character between columns, such as ; or tab"
            )
        if column.isdecimal() and int(column) < 1:
            raise InstrumentError("--column 0: columns count from 1")
        self._index = int(column) - 1 if column.isdecimal() else 0
        self._width: int | None = None

    def settle(self, rows: bytes) -> None:
        """Take the existing rows; the first one may hold the column names.

        Raises:
            InstrumentError: no column has that name, or two have.
        """
        above = [self._cells(row) for row in rows.decode("utf-8-sig", "replace").splitlines()]
        names = [name.strip() for name in above[0]] if above else []
        if not self._column.isdecimal():
            if names.count(self._column) != 1:
                raise InstrumentError(
                    f"{self._path}: --column {self._column}: its first row has "
                    f"{', '.join(names) or 'nothing'}; give one of these names, or a number from 1, and "
                    "with --delimiter the character between columns"
                )
            self._index = names.index(self._column)
        heads = [row for row in above if any(row) and not any(_CELL.fullmatch(cell) for cell in row)]
        if heads:
            self._width = len(heads[-1])

    def reading(self, row: bytes) -> str:
        """Return the cell with the reading.

        Raises:
            BadReadingError: the row has another number of columns, or may have a decimal comma.
        """
        shown = repr(row[:SHOWN].decode("utf-8", "replace"))
        cells = self._cells(row.decode("utf-8", "replace"))
        if self._width is not None and len(cells) != self._width:
            raise BadReadingError(
                f"{shown} has {len(cells)} column(s), but the heading has {self._width}; {self._remedy()}"
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
            "give with --delimiter the character between columns; the instrument must write numbers with a "
            "decimal point"
        )

    def _cells(self, row: str) -> list[str]:
        try:
            return next(csv.reader([row.rstrip("\r\n")], delimiter=self._delimiter, strict=True), [])
        except csv.Error:  # an unmatched quotation mark: the cells as written
            return row.split(self._delimiter)


POLL_S: Final = 0.05
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")


class Instrument(Protocol):
    """A source of position readings; numbers are as displayed."""

    @property
    def title(self) -> str:
        """Its description for a person."""
        ...

    async def open(self) -> None:
        """Prepare the instrument. Raises InstrumentError."""
        ...

    def arm(self) -> None:
        """Start a stop: the axis is at standstill, and later data are of this stop.

        Raises:
            BadReadingError: data came before.
            InstrumentError: the instrument is lost.
            StoppedError: the user ended the run.
        """
        ...

    async def read(self, stop: str) -> float:
        """Return one reading of a stop; ``stop`` is its name for the user.

        Raises:
            BadReadingError: the data are not a reading.
            InstrumentError: the instrument is lost.
            StoppedError: the user ended the run.
        """
        ...

    def close(self) -> None:
        """Release the instrument."""
        ...


def number_of(text: str) -> float:
    """Return a number with a decimal point. Raises BadReadingError."""
    stripped = text.strip()
    if not _NUMBER.fullmatch(stripped):
        hint = "; write a decimal point" if "," in stripped else ""
        raise BadReadingError(f"{text[:SHOWN]!r} is not a number{hint}")
    value = float(stripped)
    if not isfinite(value):
        raise BadReadingError(f"{text[:SHOWN]!r} is too large")
    return value


class Lines:
    """Lines on standard input, typed or from a pipe."""

    def __init__(self, descriptor: int = 0) -> None:
        self._descriptor = descriptor
        self._data = b""
        self._has_ended = False

    async def line(self) -> str | None:
        """Return the next line; None at the end."""
        while b"\n" not in self._data:
            if self._has_ended:
                return None
            await self._more()
        line, _, self._data = self._data.partition(b"\n")
        return line.decode("utf-8", "replace").strip()

    def early(self) -> str:
        """Discard and return what was typed on a terminal before the question; "" for a pipe, or nothing."""
        if not os.isatty(self._descriptor):
            return ""
        while select.select((self._descriptor,), (), (), 0)[0]:
            data = os.read(self._descriptor, 4096)
            self._data += data
            if not data:
                break
        early, self._data = self._data.decode("utf-8", "replace").strip(), b""
        return early

    async def _more(self) -> None:
        loop = asyncio.get_running_loop()
        readable = loop.create_future()

        def wake() -> None:
            if not readable.done():
                readable.set_result(None)

        try:
            loop.add_reader(self._descriptor, wake)
        except PermissionError:  # a regular file is always readable, and epoll does not accept it
            wake()
        try:
            await readable
        finally:
            with contextlib.suppress(OSError):
                loop.remove_reader(self._descriptor)
        try:
            data = os.read(self._descriptor, 4096)
        except OSError:  # the terminal is closed
            data = b""
        self._data += data
        self._has_ended = not data


class Keyboard:
    """A person reads the instrument and types the number."""

    title = "keyboard"

    def __init__(self, lines: Lines, show: Callable[[str], None], *, is_walk: bool = False) -> None:
        """``is_walk``: b takes a placement back."""
        self._lines = lines
        self._show = show
        self._is_walk = is_walk

    async def open(self) -> None:
        """See :class:`Instrument`."""

    def arm(self) -> None:
        """See :class:`Instrument`."""
        if early := self._lines.early():
            if early == "q":
                raise StoppedError("q on the keyboard")
            self._show(f"  {early!r} was typed before the axis was at standstill: not used\n")

    async def read(self, stop: str) -> float:
        """See :class:`Instrument`. Asks until it is a number; ``q`` ends the run."""
        while True:
            back = "b takes this placement back, " if self._is_walk else ""
            self._show(f"{stop}: reading ({back}q stops): ")
            line = await self._lines.line()
            if line is None:
                raise InstrumentError("standard input has ended, so no more readings can come")
            if line == "q":
                raise StoppedError("q on the keyboard")
            if line == "b" and self._is_walk:
                raise TakenBackError("b on the keyboard")
            try:
                return number_of(line)
            except BadReadingError as error:
                self._show(f"  {error}\n")

    def close(self) -> None:
        """See :class:`Instrument`."""


class GrowingCsv:
    """A file to which the software of an instrument appends a row for each reading.

    ``column``: its name in the header, or its number from 1.
    """

    def __init__(self, path: Path, column: str, delimiter: str = ",") -> None:
        self.title = str(path)
        self._path = path
        self._columns = Columns(str(path), column, delimiter)
        self._at = 0

    async def open(self) -> None:
        """Find the end of the file: existing rows belong to no stop."""
        try:
            data = self._path.read_bytes()
        except OSError as error:
            raise InstrumentError(f"{self._path}: {error.strerror or error}") from None
        whole, _, part = data.rpartition(b"\n")
        if part:
            raise InstrumentError(
                f"{self._path}: its last row {part[:SHOWN]!r} is not complete: let the instrument finish it"
            )
        self._at = len(data)
        self._columns.settle(whole)

    def arm(self) -> None:
        """See :class:`Instrument`."""
        early, begun = self._rows()
        if early or begun:
            self._at += sum(len(row) + 1 for row in early)
            what = f"{len(early)} rows" if early else f"the beginning of a row, {begun[:SHOWN]!r},"
            raise BadReadingError(
                f"{self._path}: {what} came before the axis was at its target: let the instrument write "
                "one row for each stop, after the axis has come to standstill"
            )

    async def read(self, stop: str) -> float:
        """See :class:`Instrument`. Waits for one more row."""
        while not (rows := self._rows()[0]):  # noqa: ASYNC110 - files do not report their growth
            await asyncio.sleep(POLL_S)
        self._at += sum(len(row) + 1 for row in rows)
        if len(rows) > 1:
            raise BadReadingError(
                f"{self._path}: {len(rows)} rows for one stop; let the instrument write one"
            )
        try:
            return number_of(self._columns.reading(rows[0]))
        except BadReadingError as error:
            raise BadReadingError(f"{self._path}: {error}") from None

    def close(self) -> None:
        """See :class:`Instrument`."""

    def _rows(self) -> tuple[list[bytes], bytes]:
        """Return the new complete rows, and the beginning of the next one."""
        try:
            with self._path.open("rb") as stream:
                size = stream.seek(0, os.SEEK_END)
                if size < self._at:
                    raise InstrumentError(
                        f"{self._path}: is shorter than before: another program started it again"
                    )
                stream.seek(max(0, self._at - 1))
                before, data = stream.read(min(1, self._at)), stream.read()
        except OSError as error:
            raise InstrumentError(f"{self._path}: {error.strerror or error}") from None
        if before not in (b"", b"\n"):
            raise InstrumentError(f"{self._path}: its rows have changed: another program wrote it again")
        *rows, begun = data.split(b"\n")
        return rows, begun


class SerialGauge:
    """A gauge on a serial port; it is polled with ``request``, else its own button or foot switch sends."""

    def __init__(
        self,
        kind: GaugeKind,
        endpoint: SerialEndpoint,
        request: str,
        timeout_s: float,
        *,
        pattern: re.Pattern[str] | None = None,
        unit: str = "mm",
    ) -> None:
        self.title = f"{kind.value} gauge on {endpoint.device}"
        self._unit = unit
        self._pattern = pattern
        self._kind = kind
        self._endpoint = endpoint
        self._request = request.encode("ascii")
        self._timeout_s = timeout_s
        self._channel: SerialChannel | None = None
        self._lines = GaugeLines()
        self._came: list[bytes] = []
        self._wrong = ""
        self._gone = ""
        self._changed = asyncio.Event()

    async def open(self) -> None:
        """See :class:`Instrument`."""
        try:
            port, _ = open_port(self._endpoint)
        except TransportError as error:
            raise InstrumentError(error.detail) from None
        self._channel = SerialChannel(port, self._endpoint, self)
        self._channel.begin()

    def arm(self) -> None:
        """See :class:`Instrument`."""
        if self._came or self._wrong or self._lines.rest:
            shown = self._wrong or repr((b" ".join(self._came) or self._lines.rest)[:SHOWN].decode("latin-1"))
            self._came, self._wrong, self._lines = [], "", GaugeLines()
            raise BadReadingError(f"{self.title}: {shown} came before the axis was at its target")

    async def read(self, stop: str) -> float:
        """See :class:`Instrument`."""
        channel = self._channel
        if channel is None or self._gone:
            raise InstrumentError(f"{self.title}: {self._gone or 'not open'}")
        if self._request:
            channel.write(self._request)
        try:
            async with asyncio.timeout(self._timeout_s if self._request else None):
                line = await self._line()
        except TimeoutError:
            raise BadReadingError(
                f"{self.title}: no reading within {self._timeout_s:g} s; check that it is on, and "
                "--gauge-request"
            ) from None
        try:
            return reading_of(self._kind, line, self._pattern, self._unit)
        except GaugeError as error:
            raise BadReadingError(str(error)) from None

    def close(self) -> None:
        """See :class:`Instrument`."""
        if self._channel is not None:
            self._channel.close()

    def opened(self, channel: Channel, now_ns: int) -> None:
        """See ``Receiver``."""

    def received(self, data: bytes, now_ns: int) -> None:
        """See ``Receiver``."""
        try:
            self._came += self._lines.feed(data)
        except GaugeError as error:
            self._wrong = str(error)
        self._changed.set()

    def closed(self, reason: str, now_ns: int) -> None:
        """See ``Receiver``."""
        self._gone = reason
        self._changed.set()

    async def _line(self) -> bytes:
        while True:
            if self._gone:
                raise InstrumentError(f"{self.title}: {self._gone}")
            if self._wrong:
                wrong, self._wrong = self._wrong, ""
                raise BadReadingError(f"{self.title}: {wrong}")
            echo = self._request.rstrip(b"\r\n")
            self._came = [line for line in self._came if not (echo and line == echo)]
            if len(self._came) > 1:
                shown = b" ".join(self._came)[:SHOWN].decode("latin-1")
                self._came = []
                raise BadReadingError(f"{self.title}: several lines for one stop: {shown!r}")
            if self._came:
                return self._came.pop()
            self._changed.clear()
            await self._changed.wait()
