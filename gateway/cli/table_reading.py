"""The first step of each command of ``pitch-gateway table``: read the file, or report its errors."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import typer

from gateway.cli.output import print_lines
from gateway.commissioning.table_options import SlopeError
from gateway.compensation.errors import TableError
from gateway.compensation.units import Units
from gateway.metrology.errors import MetrologyError
from gateway.tabfile import (
    ContextError,
    Dialect,
    FileContext,
    LoadedTable,
    TabFileError,
    UnitsOf,
    dialect_of,
    inspect_table,
)


def inspect(file: Path, context: FileContext) -> LoadedTable:
    """Read a file in its own units; Centroid version 1, which has none, defaults to inches.

    Raises:
        TabFileError: see :func:`gateway.tabfile.inspect_table`.
    """
    dialect = dialect_of(file, context.format)
    loaded = inspect_table(file, own_units(dialect, context))
    if dialect.units is not UnitsOf.AXIS or context.units is not None:
        return loaded
    decision = "units inch: assumed, because the file states none and --units was not given"
    source = replace(loaded.source, decisions=(decision, *loaded.source.decisions))
    return replace(loaded, source=source)


def own_units(dialect: Dialect, context: FileContext) -> FileContext:
    """Return a context for reading a file in its own units; see :func:`inspect`."""
    if dialect.units is UnitsOf.FILE:
        return replace(context, same_units=True)
    if dialect.units is UnitsOf.TOLD:
        return replace(context, file_units=context.units)
    return context if context.units is not None else replace(context, units=Units.INCH)


def with_limits(context: FileContext, max_slope: float | None, max_correction: float | None) -> FileContext:
    """Return a context with the given limits of an axis."""
    context = replace(context, max_correction=max_correction)
    return context if max_slope is None else replace(context, max_slope=max_slope)


@contextmanager
def problems() -> Iterator[None]:
    """Convert errors of files to lines on stderr and exit code 1.

    Impossible facts about a file are wrong usage (exit code 2).
    """
    try:
        yield
    except ContextError as error:
        raise typer.BadParameter(str(error)) from error
    except SlopeError as error:
        raise typer.BadParameter(str(error), param_hint="--max-slope") from error
    except TabFileError as error:
        _print_notes(error)
        print_lines((f"error: {problem}" for problem in error.problems), err=True)
        raise typer.Exit(1) from None
    except (MetrologyError, TableError, ValueError) as error:
        _print_notes(error)
        print_lines([f"error: {error}"], err=True)
        raise typer.Exit(1) from None


def _print_notes(error: Exception) -> None:
    print_lines((f"note: {note}" for note in getattr(error, "__notes__", ())), err=True)
