"""From a file to a checked table."""

from dataclasses import replace
from pathlib import Path

from gateway.compensation.errors import TableError
from gateway.compensation.table import CorrectionTable, make_table
from gateway.files import FileRefusedError, read_regular_file
from gateway.tabfile.checks import under_new_names, unused_options
from gateway.tabfile.decoded import Decoded, LoadedTable, steepest
from gateway.tabfile.dialects import Dialect, choose
from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.lints import run_lints
from gateway.tabfile.options import DECLARED, MAX_POSITION, FileContext
from gateway.tabfile.text import MAX_BYTES, SourceText, decode


def read_table(path: Path, context: FileContext) -> LoadedTable:
    """Read a file as the gateway does: whole or not at all.

    The table is in the machine units of the file (version 1: of the context).

    Raises:
        TabFileError: all errors of :func:`inspect_table`, and every lint of severity error, such as a slope
            or a correction above its limit.
    """
    loaded = inspect_table(path, context)
    if loaded.errors:
        raise TabFileError(
            *(FileProblem(loaded.file, lint.message, "", lint.line, lint.code) for lint in loaded.errors)
        )
    return loaded


def inspect_table(path: Path, context: FileContext) -> LoadedTable:
    """Read a file for inspection: lints of severity error are reported, not raised.

    Raises:
        TabFileError: the file cannot be read, has no known dialect, breaks its grammar, does not prove its
            meaning, or makes no table.
    """
    return parse_table(read_bytes(path), str(path), context)


def read_bytes(path: Path) -> bytes:
    """Return the content of a file.

    Raises:
        TabFileError: missing, no permission, no regular file, or longer than 16 MiB.
    """
    try:
        return read_regular_file(path, MAX_BYTES, "a table file")
    except FileRefusedError as error:
        raise TabFileError(FileProblem(str(path), str(error), "")) from None


def parse_table(data: bytes, name: str, context: FileContext) -> LoadedTable:
    """Process the content of a file as :func:`inspect_table` does.

    Raises:
        TabFileError: see :func:`inspect_table`.
    """
    source = decode(data, name)
    dialect = choose(source, context.format)
    context, renamed = under_new_names(source, context, dialect.name)
    decoded = dialect.read(source, context)
    unused = unused_options(context, dialect.name, (name for name in DECLARED if not _is_used(name, dialect)))
    decoded = replace(decoded, remarks=(*decoded.remarks, *renamed, *unused))
    table = _table(source, decoded)
    return LoadedTable(name, dialect.name, source.sha256, table, decoded, run_lints(name, table, decoded))


def _is_used(name: str, dialect: Dialect) -> bool:
    return DECLARED[name].option.is_for_all or name in dialect.uses


def dialect_of(path: Path, given: str | None = None) -> Dialect:
    """Return the dialect of a file without reading it as a table; ``given`` is its name, if known.

    Raises:
        TabFileError: the file cannot be read, or does not prove a known dialect.
    """
    return choose(decode(read_bytes(path), str(path)), given)


def _table(source: SourceText, decoded: Decoded) -> CorrectionTable:
    far = next((row for row in decoded.rows if not abs(row.position) < MAX_POSITION), None)
    if far is not None:
        raise source.error(
            f"a position of {far.position:g} {decoded.units.value}",
            f"positions below {MAX_POSITION:g}",
            line=far.forward_line or far.backward_line,
        )
    slope, before, after = steepest(decoded.rows)
    if abs(slope) >= 1:
        raise source.error(
            f"the correction changes with a slope of {slope:.4g} between {before.position:g} and "
            f"{after.position:g} {decoded.units.value}",
            "a slope below 1: check for a missing sign or a value in the wrong unit",
            line=after.forward_line,
            code="L1",
        )
    try:
        return make_table(
            [row.position for row in decoded.rows],
            [row.forward for row in decoded.rows],
            [row.backward for row in decoded.rows],
            decoded.units,
        )
    except TableError as error:
        raise source.error(str(error), "finite positions that ascend strictly") from error
