"""Table files: text <-> correction table, one file for each dialect; lints; explain.

All dialects have one sign: a file's value becomes the amount that is ADDED to a commanded position. A reader
infers only what the file proves. The rest must be given, or the reader refuses the file.
"""

from gateway.tabfile.decoded import Decoded, Lint, LintSeverity, LoadedTable, SourceRow
from gateway.tabfile.dialects import DIALECTS, Dialect, UnitsOf, dialect_named
from gateway.tabfile.errors import ContextError, FileProblem, TabFileError
from gateway.tabfile.explanation import PositionExplanation, explain
from gateway.tabfile.load import dialect_of, inspect_table, parse_table, read_bytes, read_table
from gateway.tabfile.names import KEEP_ONE, FoundTable, TableState, axis_of_name, find_axis_tables, find_table
from gateway.tabfile.options import OPTIONS, ErrorSense, FileContext, HomeSide, TableOptions, V1Layout
from gateway.tabfile.writing import WriteOptions, Written

__all__ = [
    "DIALECTS",
    "KEEP_ONE",
    "OPTIONS",
    "ContextError",
    "Decoded",
    "Dialect",
    "ErrorSense",
    "FileContext",
    "FileProblem",
    "FoundTable",
    "HomeSide",
    "Lint",
    "LintSeverity",
    "LoadedTable",
    "PositionExplanation",
    "SourceRow",
    "TabFileError",
    "TableOptions",
    "TableState",
    "UnitsOf",
    "V1Layout",
    "WriteOptions",
    "Written",
    "axis_of_name",
    "dialect_named",
    "dialect_of",
    "explain",
    "find_axis_tables",
    "find_table",
    "inspect_table",
    "parse_table",
    "read_bytes",
    "read_table",
]
