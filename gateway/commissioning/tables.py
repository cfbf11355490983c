"""A table made from readings, as a file: written as text, read back, and put in its place."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import ceil, floor, log10
from pathlib import Path
from typing import Final

from gateway.compensation.errors import TableError
from gateway.compensation.settings import DEFAULT_MAX_SLOPE
from gateway.compensation.table import CorrectionTable
from gateway.metrology.formats import is_readings
from gateway.metrology.readings import APPROACHES
from gateway.metrology.tables import correction_at
from gateway.plain import JsonObject
from gateway.tabfile import (
    Dialect,
    FileProblem,
    LoadedTable,
    TabFileError,
    WriteOptions,
    Written,
    conversion,
    dialect_named,
    parse_table,
)
from gateway.tabfile.conversion import MEASURED_DECIMALS, tidied

STEEP: Final = "L1"
"""Lint of a table that is steeper than the axis allows."""


@dataclass(frozen=True, slots=True)
class WrittenTable:
    """A table as the text of a file, and as read back from it."""

    result: Written
    again: LoadedTable
    difference: float
    """The largest difference of a correction."""

    def as_data(self) -> JsonObject:
        """Return the result as plain data."""
        return {
            "losses": list(self.result.losses),
            "largest_difference": self.difference,
            "read_with": conversion.reader_options(self.result, dialect_named(self.again.format)),
            "lints": [lint.as_data() for lint in self.again.lints],
        }

    def lines(self, out: Path) -> Iterator[str]:
        """Yield in words what was written."""
        table = self.again.table
        yield (
            f"{out}: {self.again.format}, {len(table.positions)} points from {table.first:g} to "
            f"{table.last:g} {table.units.value}, corrections up to {table.max_correction():.6g}"
        )
        yield from (f"not in the file: {loss}" for loss in self.result.losses)
        yield from conversion.reader_lines(self.result, dialect_named(self.again.format))
        yield from (lint.line_in(str(out)) for lint in self.again.lints)
        yield f"largest difference of a correction after reading it back: {self.difference:.3g}"

    def put(self, out: Path, *, force: bool) -> None:
        """Write the file; see :func:`write_file`."""
        write_file(out, self.result.text, force=force, encoding=self.result.encoding)


def written_table(
    table: CorrectionTable,
    target: Dialect,
    options: WriteOptions,
    max_slope: float = DEFAULT_MAX_SLOPE,
    own_options: Mapping[str, str] | None = None,
) -> WrittenTable:
    """Write a table as text and read it back; refuse one that is steeper than ``max_slope``.

    ``own_options`` are a command's names for some options of ``table convert``, used in remedies.

    Raises:
        TabFileError: the target cannot hold the table, or the gateway would refuse the result.
    """
    table = tidied(table, MEASURED_DECIMALS)
    try:
        result = conversion.write_text(table, target, options)
    except TabFileError as error:
        remedy = error.allowed
        # Writers use the option names of table convert.
        for option, own in (own_options or {}).items():
            remedy = remedy.replace(option, own)
        if "subtract it" in remedy and not table.is_unidirectional:
            remedy += ": --one-way makes one curve that is 0 at home"
        raise TabFileError(replace(error.problems[0], allowed=remedy)) from None
    context = replace(result.context, format=target.name, max_slope=max_slope)
    again = parse_table(result.text.encode(), f"the {target.name} file", context)
    if again.errors:
        # No line: nothing is written, so there is no file to check.
        raise TabFileError(
            *(
                _steep(table, max_slope)
                if lint.code == STEEP
                else FileProblem("the new table", lint.message, "", code=lint.code)
                for lint in again.errors
            )
        )
    same = again.table.in_units(table.units)
    difference = max(
        abs(correction_at(table, x, way) - correction_at(same, x, way))
        for x in table.positions
        for way in APPROACHES
    )
    return WrittenTable(result, again, difference)


def _steep(table: CorrectionTable, limit: float) -> FileProblem:
    slope = table.max_slope()
    remedy = (
        f"--max-slope {_up(slope):g}, if the screw is really so bad, and max_slope = {_up(slope):g} for "
        "the axis that uses the table"
    )
    return FileProblem("the new table", f"its slope is {slope:.4g}, above {limit:g}", remedy, code=STEEP)


def write_file(out: Path, text: str, *, force: bool, encoding: str = "utf-8") -> None:
    """Write a file; overwrite an existing one only with ``force``, and a file of readings never.

    If the user forgets OUT, the last file of readings takes its place.

    Raises:
        TabFileError: a file of this name exists, it holds readings, or the path cannot be written.
    """
    if is_readings(out):
        raise TabFileError(
            FileProblem(str(out), "a file of readings", "another name for OUT, the last argument")
        )
    conversion.write(out, text, force=force, encoding=encoding)


def refusal(target: Dialect, table: CorrectionTable, options: WriteOptions, max_slope: float) -> str | None:
    """Return why a table cannot be written or the gateway would refuse it, with the remedy; None: neither."""
    try:
        written_table(table, target, options, max_slope)
    except TabFileError as error:
        if error.problems[0].code is None:
            allowed = f", allowed: {error.allowed}" if error.allowed else ""
            return f"this format does not hold it ({error.found}{allowed}); --to csv does"
        # A limit of the gateway holds for every format.
        return f"{error.found}; {error.allowed}" if error.allowed else error.found
    except TableError as error:
        return str(error)
    return None


def steep_notes(table: CorrectionTable) -> list[str]:
    """Return the requirements of a steep table for its axis."""
    slope = table.max_slope()
    if slope <= DEFAULT_MAX_SLOPE:
        return []
    return [
        (
            f"a slope of {slope:.4g}: set max_slope = {_up(slope):g} in the configuration of the axis; the "
            f"default is {DEFAULT_MAX_SLOPE:g}"
        )
    ]


def _up(slope: float) -> float:
    """Return a slope with two digits that is not smaller.

    >>> _up(0.01131), _up(0.02)
    (0.012, 0.02)
    """
    scale = 10.0 ** (1 - floor(log10(slope)))
    return round(ceil(slope * scale * (1 - 1e-9)) / scale, 12)
