"""Writing a table in another dialect: read back first, then replace the file in one step; even grids."""

import os
from dataclasses import replace
from enum import Enum
from math import ceil, floor
from pathlib import Path
from typing import Final

from msgspec import Struct

from gateway.compensation.curve import Curve
from gateway.compensation.table import CorrectionTable, make_table
from gateway.files import FileRefusedError, write_file
from gateway.plain import JsonObject
from gateway.tabfile import (
    DIALECTS,
    OPTIONS,
    Dialect,
    FileProblem,
    LoadedTable,
    SourceRow,
    TabFileError,
    UnitsOf,
    WriteOptions,
    Written,
    parse_table,
)
from gateway.tabfile.checks import largest_difference
from gateway.tabfile.options import DECLARED
from gateway.tabfile.text import decode

WRITE_OPTIONS: Final = {
    "file_counts_per_unit": "--to-counts-per-unit",
    "v1_layout": "--to-v1-layout",
    "file_axis": "--to-file-axis",
    "sense": "--to-sense",
}
SAME_REVOLUTION: Final = 1e-9
"""A revolution may differ by this fraction of it: the rounding of positions."""


class Converted(Struct, frozen=True):
    """A text, the largest change of its corrections when read back, and where, in units of the table."""

    written: Written
    difference: float
    at: float
    modulo: float | None = None
    """The table that is read back repeats after this length."""


def converted(table: CorrectionTable, target: Dialect, options: WriteOptions) -> Converted:
    """Return the text of a table, and the difference between the table and what is read back.

    Raises:
        TabFileError: the target cannot hold the table.
    """
    written = write_text(table, target, options)
    data = written.text.encode()
    name = f"a {target.name} file"
    if written.context.format is None and sum(d.recognise(decode(data, name)) for d in DIALECTS) > 1:
        written = replace(written, context=replace(written.context, format=target.name))
    loaded = parse_table(data, name, written.context)
    again = loaded.table.in_units(table.units)
    return Converted(
        written, *largest_difference(rows_of(table), rows_of(again)), modulo=loaded.source.modulo
    )


def is_modulo(loaded: LoadedTable, table: CorrectionTable) -> bool:
    """Whether a table repeats at its end, as the table of its source file does."""
    if loaded.source.modulo is None:
        return False
    revolution = loaded.source.modulo * loaded.table.units.convert_factor(table.units)
    is_closed = table.forward[0] == table.forward[-1] and table.backward[0] == table.backward[-1]
    return is_closed and abs(table.last - table.first - revolution) <= SAME_REVOLUTION * revolution


def lost_modulo(loaded: LoadedTable, modulo: float | None) -> list[str]:
    """Report that a table repeats at its end, if the file made from it does not state this."""
    if loaded.source.modulo is None or modulo is not None:
        return []
    revolution, unit = f"{loaded.source.modulo:.10g}", loaded.table.units.value
    remedy = f"set it on the control (modulo = {revolution} for an axis of the gateway)"
    return [f"the table repeats every {revolution} {unit}: {remedy}"]


def write_text(table: CorrectionTable, target: Dialect, options: WriteOptions) -> Written:
    """Return the text of a table; given options without a field in this format are losses too.

    Raises:
        TabFileError: the target cannot hold the table.
    """
    written = target.write(table, options)
    unused = [
        f"{option}: {target.name} cannot hold it"
        for name, option in WRITE_OPTIONS.items()
        if name not in target.writes and getattr(options, name) is not None
    ]
    return replace(written, losses=(*written.losses, *unused))


def reader_options(written: Written, target: Dialect) -> JsonObject:
    """Return the options that a reader of the file needs, by name."""
    names = ["format", *OPTIONS]
    if target.units is not UnitsOf.FILE:
        names.append("file_units" if target.units is UnitsOf.TOLD else "units")
    options = {name: getattr(written.context, name) for name in names}
    given = {name: fact for name, fact in options.items() if fact is not None}
    return {name: fact.value if isinstance(fact, Enum) else fact for name, fact in given.items()}


def reader_lines(written: Written, target: Dialect) -> list[str]:
    """Return the same as options of the command line; no line if no option is needed."""
    options = " ".join(
        f"{DECLARED[name].typed if name in DECLARED else f'--{name}'} {fact}"
        for name, fact in sorted(reader_options(written, target).items())
    )
    return [f"to read it, give: {options}"] if options else []


def rows_of(table: CorrectionTable) -> list[SourceRow]:
    """Return the points of a table as rows of no file."""
    points = zip(table.positions, table.forward, table.backward, strict=True)
    return [SourceRow(x, forward, backward, 0.0, 0.0, None, None) for x, forward, backward in points]


def write(out: Path, text: str, *, force: bool, encoding: str = "utf-8") -> None:
    """Write the file; replace an existing one only with ``force``, in one step, keeping its mode.

    A symbolic link is followed: the file that it names is written.

    Raises:
        TabFileError: a file of this name exists, it is not a regular file, or the path cannot be written.
    """
    try:
        write_file(out, text.encode(encoding), force=force)
    except FileExistsError:
        raise TabFileError(
            FileProblem(str(out), "a file of this name exists", "a new name, or --force")
        ) from None
    except FileRefusedError as error:
        replaced = os.path.realpath(out)  # the target of a link
        raise TabFileError(FileProblem(replaced, error.found, "a regular file, or a new name")) from None
    except OSError as error:
        raise TabFileError(
            FileProblem(str(out), error.strerror or str(error), "a path that can be written")
        ) from error


# --- Resampling of a free grid for controls that need an even one, and the resulting change

MAX_POINTS: Final = 100_000
DECIMALS: Final = 11
"""Of a unit: far below the resolution of any instrument or drive, and above the rounding of sums."""
MEASURED_DECIMALS: Final = 7
"""Of a unit: a tenth of a nanometre, where instruments show a hundred times as much."""
ON_GRID: Final = 1e-6
"""An end within this fraction of a step from a grid point is that point."""


class Resampled(Struct, frozen=True):
    """The table on its new grid; the largest change of its corrections, and its position."""

    table: CorrectionTable
    difference: float
    at: float


def resample(table: CorrectionTable, step: float, name: str) -> Resampled:
    """Return a table with points every ``step``, in units of the table; ``name`` is for the error.

    Home is a point of the grid if the table reaches home, else the first point is. If the length is not a
    multiple of the step, the grid ends within one step behind the table, with the value at its end.

    Raises:
        TabFileError: a step that is not above 0, is above the length of the table, or makes more than 100 000
            points.
    """
    length = table.last - table.first
    unit = table.units.value
    if not 0 < step <= length * (1 + ON_GRID) or length / step > MAX_POINTS:
        raise TabFileError(
            FileProblem(
                name,
                f"a step of {step:g} for a table of {length:g} {unit}",
                f"--resample with a step from {length / MAX_POINTS:g} to {length:g} {unit}",
            )
        )
    origin = 0.0 if table.first - ON_GRID * step <= 0 <= table.last + ON_GRID * step else table.first
    lowest = floor((table.first - origin) / step + ON_GRID)
    highest = ceil((table.last - origin) / step - ON_GRID)
    positions = [origin + index * step for index in range(lowest, highest + 1)]
    curve = Curve(table)
    forward, backward = ([branch(x) for x in positions] for branch in (curve.forward, curve.backward))
    even = make_table(positions, forward, backward, table.units, has_backlash=table.facts.has_backlash)
    again = Curve(even)
    # Both are straight between the points of either, and equal at those of the new grid.
    difference, at = max(
        (abs(value - branch(x)), x)
        for values, branch in ((table.forward, again.forward), (table.backward, again.backward))
        for x, value in zip(table.positions, values, strict=True)
    )
    return Resampled(even, difference, at)


def tidied(table: CorrectionTable, decimals: int = DECIMALS) -> CorrectionTable:
    """Return a computed table without the rounding of sums behind its last significant digit.

    A measured table has :data:`MEASURED_DECIMALS`.

    >>> from gateway.compensation.units import Units
    >>> table = make_table([0.1, 0.1 + 0.2], [400.0123 - 400.0, 1e-9], [0.0, 0.0], Units.MM)
    >>> table.positions[1], tidied(table).positions[1], table.forward[0], tidied(table).forward[0]
    (0.30000000000000004, 0.3, 0.012299999999981992, 0.0123)
    """
    positions, *curves = (
        [round(number, decimals) + 0.0 for number in numbers]
        for numbers in (table.positions, table.forward, table.backward)
    )
    if len(set(positions)) < len(positions):
        positions = list(table.positions)
    return make_table(positions, curves[0], curves[1], table.units)
