"""Files for the editor, and what reads them."""

from pathlib import Path
from typing import Any

from gateway.cli.table_reading import own_units
from gateway.commissioning.editor.editing import Editing
from gateway.commissioning.table_options import ReadOptions
from gateway.tabfile import FileContext, LoadedTable, dialect_of, parse_table
from tests.tabfile.mutants import Sample

UP_TO_HOME = """CNC10 TAB FILE VERSION 3
AXIS X
UNITS MILLIMETER
INTERVAL 100
ENTRIES 6
0 0 0.004
-100 0.001 0.006
-200 0.003 0.009
-300 0.002 0.009
-400 0.004 0.010
-500 0.005 0.011
"""
"""Home is at the plus end: the second column holds while the axis moves away from it, backward."""


def opened(file: Path, **facts: Any) -> Editing:
    """Open a file as the command does."""
    source = ReadOptions(**facts)
    context = source.context()
    return Editing(file, own_units(dialect_of(file, context.format), context), source)


def sampled(sample: Sample, folder: Path) -> tuple[Editing, FileContext]:
    """Put a sample into a folder and open it; return the context of its reader too."""
    file = folder / sample.name
    file.write_bytes(sample.data)
    given = sample.context.given()
    return Editing(file, sample.context, ReadOptions(**given, units=sample.context.units)), sample.context


def read(editing: Editing, context: FileContext | None = None) -> LoadedTable:
    """Read what is on the disk."""
    return parse_table(editing.file.read_bytes(), editing.file.name, context or FileContext())
