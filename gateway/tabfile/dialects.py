"""The dialects that can be read and written, and kinds of file that are known but not read.

A new dialect is one file and one entry in :data:`DIALECTS`.
"""

import re
from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import Final, Protocol

from msgspec import Struct

from gateway.compensation.table import CorrectionTable
from gateway.tabfile import (
    aerotech,
    carvera,
    centroid_v1,
    centroid_v2,
    centroid_v3,
    csv_table,
    fagor,
    fagor_8065,
    fanuc,
    heidenhain,
    isg,
    linuxcnc,
    mint,
    mitsubishi,
    pmac,
    renishaw_ren,
    siemens,
    siemens_cec,
    weihong,
)
from gateway.tabfile.decoded import Decoded, steepest
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.options import FileContext, option_hint
from gateway.tabfile.text import SourceText, decode, shown
from gateway.tabfile.writing import WriteOptions, Written, unwritable


class UnitsOf(Enum):
    """Where a reader gets the units of a file."""

    FILE = "file"
    """The file states them."""
    AXIS = "axis"
    """The numbers are counts of the old control; they become lengths in units of the axis."""
    TOLD = "told"
    """Only the author of the file knows them: ``file_units``."""


class Dialect(Struct, frozen=True):
    """One file format: how to recognise, read and write it."""

    name: str
    title: str
    recognise: Callable[[SourceText], bool]
    """Returns true as soon as the text can be nothing else, so that errors in it can be named."""
    read: Callable[[SourceText, FileContext], Decoded]
    written: Callable[[CorrectionTable, WriteOptions], Written]
    """Makes the text, for :meth:`write`."""
    uses: frozenset[str]
    """Names of table options that it may need; other given options get remark R3."""
    units: UnitsOf = UnitsOf.FILE
    suffix: str = ".tab"
    """The usual suffix of such files."""
    directions: int = 2
    """1: its files hold one correction for both directions."""
    is_writable: bool = True
    """False if no system reads such files; :meth:`write` then raises."""
    moves_points: bool = False
    """A value is where the nut is, so that another correction moves its point."""
    writes: frozenset[str] = frozenset()
    """Names of the :class:`WriteOptions` that its writer uses, besides ``axis`` and ``is_modulo``."""

    def write(self, table: CorrectionTable, options: WriteOptions) -> Written:
        """Return the text of a table, with its losses and the options that its reader needs.

        Raises:
            TabFileError: the format cannot hold the table, or its digits would make a correction as steep as
                the positions, which no reader accepts.
        """
        written = self.written(table, options)
        text = decode(written.text.encode(), f"a file of {self.name}")
        rows = self.read(text, written.context).rows
        slope, before, after = steepest(rows)
        if abs(slope) >= 1:
            raise unwritable(
                self.name,
                f"a slope of {slope:.4g} between {before.position:g} and {after.position:g}, in its digits",
                "a slope below 1: from 1 on, two positions would get the same corrected position",
            )
        return written


class Module(Protocol):
    """The content of a file that is one dialect with reader and writer."""

    NAME: str
    TITLE: str
    USES: frozenset[str]

    def recognise(self, source: SourceText, /) -> bool:
        """See :class:`Dialect`."""

    def read(self, source: SourceText, context: FileContext, /) -> Decoded:
        """See :class:`Dialect`."""

    def write(self, table: CorrectionTable, options: WriteOptions, /) -> Written:
        """See :class:`Dialect`."""


def _of(module: Module) -> partial[Dialect]:
    """Return a constructor for the entry of such a file; its caller adds the other fields."""
    return partial(
        Dialect, module.NAME, module.TITLE, module.recognise, module.read, module.write, module.USES
    )


DIALECTS: Final = (
    _of(centroid_v3)(),
    _of(centroid_v2)(
        writes=frozenset({"file_counts_per_unit"}),
    ),
    _of(centroid_v1)(
        units=UnitsOf.AXIS,
        directions=1,
        writes=frozenset({"file_counts_per_unit", "v1_layout"}),
    ),
    _of(csv_table)(
        suffix=".csv",
    ),
    _of(fanuc)(
        units=UnitsOf.TOLD,
        suffix=".csv",
        directions=1,
        writes=frozenset({"file_counts_per_unit"}),
    ),
    _of(mitsubishi)(
        units=UnitsOf.TOLD,
        suffix=".csv",
        directions=1,
        writes=frozenset({"file_counts_per_unit"}),
    ),
    Dialect(
        linuxcnc.NAME_0,
        linuxcnc.TITLE_0,
        linuxcnc.recognise,
        linuxcnc.read_type_0,
        linuxcnc.write_type_0,
        linuxcnc.USES,
        units=UnitsOf.TOLD,
        suffix=linuxcnc.SUFFIX,
    ),
    Dialect(
        linuxcnc.NAME_1,
        linuxcnc.TITLE_1,
        linuxcnc.recognise,
        linuxcnc.read_type_1,
        linuxcnc.write_type_1,
        linuxcnc.USES,
        units=UnitsOf.TOLD,
        suffix=linuxcnc.SUFFIX,
    ),
    _of(isg)(
        units=UnitsOf.TOLD,
        suffix=".lis",
        writes=frozenset({"file_counts_per_unit", "sense"}),
    ),
    _of(fagor)(
        units=UnitsOf.TOLD,
        suffix="",
        writes=frozenset({"file_axis", "sense"}),
    ),
    _of(fagor_8065)(
        suffix=fagor_8065.SUFFIX,
        writes=frozenset({"file_axis", "sense"}),
    ),
    _of(aerotech)(
        units=UnitsOf.TOLD,
        suffix=".cal",
        directions=1,
        writes=frozenset({"file_axis"}),
    ),
    _of(renishaw_ren)(
        units=UnitsOf.TOLD,
        suffix=".ren",
        is_writable=False,
    ),
    _of(mint)(
        units=UnitsOf.TOLD,
        suffix=mint.SUFFIX,
        moves_points=True,
        writes=frozenset({"file_axis"}),
    ),
    _of(heidenhain)(
        suffix=".com",
        writes=frozenset({"file_axis", "sense"}),
    ),
    _of(siemens)(
        units=UnitsOf.TOLD,
        suffix=siemens.SUFFIX,
        directions=1,
        writes=frozenset({"file_axis"}),
    ),
    _of(siemens_cec)(
        units=UnitsOf.TOLD,
        suffix=siemens_cec.SUFFIX,
        writes=frozenset({"file_axis", "sense"}),
    ),
    _of(weihong)(
        suffix=weihong.SUFFIX,
        writes=frozenset({"file_axis", "sense"}),
    ),
    _of(carvera)(
        suffix=carvera.SUFFIX,
        directions=1,
        is_writable=False,
    ),
    _of(pmac)(
        units=UnitsOf.TOLD,
        suffix=pmac.SUFFIX,
        directions=1,
        is_writable=False,
    ),
)


_IN_COLUMNS: Final = re.compile(r"[,;\t].*\S")
"""A line with cell separators: of a CSV that should begin with a header."""
_OF_A_TABLE: Final = re.compile(r"(?i)cnc[0-9]*[ \t][\w .-]*|[0-9e+., \t-]*")
"""The part that messages may quote. A link in the place of a table may lead to a password, and messages
travel."""


def choose(source: SourceText, given: str | None) -> Dialect:
    """Return the dialect of a file: the given one, or the only possible one.

    Raises:
        TabFileError: no dialect matches the text, several do, or it is clearly not the given one.
    """
    candidates = [dialect for dialect in DIALECTS if dialect.recognise(source)]
    if not candidates and (recognized := unsupported_of(source)) is not None:
        unsupported, number = recognized
        raise source.error(f"{unsupported.title}, which is not read", unsupported.remedy, line=number)
    names = " or ".join(repr(dialect.name) for dialect in candidates)
    if given is not None:
        dialect = dialect_named(given)
        if dialect in candidates:
            return dialect
        if candidates:
            raise source.error(f"a text of {names}, but format = {given!r}", f"format = {names}, or none")
        # The text is not quoted: a link in the place of a table may lead to a password.
        size = len(source.lines[0].text)
        raise source.error(
            f"a first line of {size} characters, and no sign of format {given!r} in the file",
            f"a file of {dialect.title}",
            line=source.lines[0].number,
        )
    if len(candidates) == 1:
        return candidates[0]
    first = source.lines[0]
    if candidates:
        raise source.error(
            f"a text that fits {names}, in which the numbers have different meanings",
            option_hint("format", names),
            line=first.number,
        )
    is_shown = _OF_A_TABLE.fullmatch(first.text) is not None
    what = shown(first.text) if is_shown else f"of {len(first.text)} characters"
    if _IN_COLUMNS.search(first.text) is not None:
        header = "position_mm,forward_mm,backward_mm", "position_mm,correction_mm"
        two_ways, one_way = (each.replace(",", ";") if ";" in first.text else each for each in header)
        raise source.error(
            f"a CSV whose first line, {what}, is not the header of a table",
            f"the first line {two_ways}, or {one_way} for both directions; units are mm, inch or degree, of "
            "corrections also um and arcsec (pitch-gateway table template prints such a file); or a file of "
            "one of the other formats: pitch-gateway table formats",
            line=first.number,
        )
    raise source.error(
        f"the first line {what} is unknown{'' if is_shown else ', and belongs to no table'}",
        "'CNC10 TAB FILE VERSION 3', or six numbers that begin with 2 (version 2), or two whole numbers "
        "(version 1), or a file of one of the other formats: pitch-gateway table formats",
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
        FileProblem(
            "a table file", f"format {name!r}", ", ".join(sorted(dialect.name for dialect in DIALECTS))
        )
    )


# --- Systems that are recognised but not read: what they are, and how to convert their tables
#
# Each is recognised by its own words on any line. Its text names what is missing, so that users need not
# guess: a sign that no manual states, a unit that is not in the file, or lines that no available source
# shows.

CSV: Final = "write it as CSV: position_mm,{} (the other units: pitch-gateway table formats)"
BOTH: Final = "error_um or correction_um"


class UnsupportedFile(Struct, frozen=True):
    """A kind of file that is known but not read."""

    title: str
    sign: re.Pattern[str]
    remedy: str


def _unsupported(title: str, sign: str, remedy: str) -> UnsupportedFile:
    return UnsupportedFile(title, re.compile(sign, re.IGNORECASE | re.ASCII), remedy)


UNSUPPORTED: Final = (
    _unsupported(
        "a PMAC backlash table (DEFINE BLCOMP)",
        r"(#[0-9]+[ \t]*)?DEF(INE)?[ \t]+BLCOMP\b.*",
        "it belongs to a DEFINE COMP table: "
        + CSV.format("forward_um,backward_um")
        + "; an entry is 1/16 count, subtracted in the negative direction only",
    ),
    _unsupported(
        "a PMAC torque table (DEFINE TCOMP)",
        r"(#[0-9]+[ \t]*)?DEF(INE)?[ \t]+TCOMP\b.*",
        "remove it from the file: it corrects torque, not positions. DEFINE COMP tables are read",
    ),
    _unsupported(
        "a list of a Heidenhain display unit (ND)",
        r"[#*]?[ \t]*(ND[ -]?[0-9]{3}\b.*|(COMP\. ?NO\.|[A-Z][ \t]+NR\.)[ \t]*[0-9]+[ \t]*=.*)",
        "it corrects the readings of a scale, at steps of a power of two from a datum; measure the axis, and "
        + CSV.format(BOTH),
    ),
    _unsupported(
        "parameters of a Fanuc control (N... P...)",
        r"N[0-9]{4,5}[ \t]*([AQ][0-9]+[ \t]*)*P-?[0-9]+.*",
        "their numbers differ between series: put 3620 to 3624 and the points into format fanuc-csv",
    ),
    _unsupported(
        "a COMP.ERR of PC-DMIS (Hexagon, STARTW)",
        r"START[A-Z]",
        "each line is: reading of the scale = reading of the laser; "
        + CSV.format("error_mm")
        + "; position_degree,error_degree of a rotary table"
        + "; the error is the right number minus the left one",
    ),
    _unsupported(
        "a look-up table of ecmc (PREC=)",
        r"PREC[ \t]*=[ \t]*[0-9]+",
        "it holds positions and corrections of an encoder, in units of the axis; their sign depends on the "
        "program that uses them: " + CSV.format("correction_mm"),
    ),
    _unsupported(
        "a screw map of Mach3 or Mach4",
        r".*\bscrew ?map.*",
        "its guide does not state whether expected or actual position is subtracted: make one test move, "
        "and " + CSV.format(BOTH),
    ),
)


def unsupported_of(source: SourceText) -> tuple[UnsupportedFile, int] | None:
    """Return the known kind of a file and the line that shows it, or None."""
    for unsupported in UNSUPPORTED:
        for line in source.lines:
            if unsupported.sign.fullmatch(line.text):
                return unsupported, line.number
    return None
