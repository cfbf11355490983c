"""``pitch-gateway table convert``: write a table in another dialect, checked by reading it back."""

import os
import secrets
import stat
from contextlib import suppress
from pathlib import Path

import typer

from gateway.cli import table_output as output
from gateway.compensation.errors import TableError
from gateway.compensation.units import Units
from gateway.files import kind_of
from gateway.tabfile import (
    Dialect,
    LoadedTable,
    Problem,
    TabFileError,
    WriteOptions,
    Written,
    axis_of_name,
    parse_table,
)
from gateway.tabfile.readings import largest_difference


def converted(
    loaded: LoadedTable, target: Dialect, options: WriteOptions, units: Units | None
) -> tuple[Written, float]:
    """Return the text and the largest difference of its corrections when it is read back, in its units.

    Raises:
        TabFileError: the target cannot hold the table, or units of another kind were asked for.
    """
    try:
        table = loaded.table.in_units(units or loaded.table.units)
    except (ValueError, TableError) as error:
        raise TabFileError(Problem(loaded.file, str(error), "--to-units of the same kind")) from error
    written = target.write(table, options)
    again = parse_table(written.text.encode(), f"a {target.name} file", written.context)
    # Compared in the units of the file: its rows are scaled like its table.
    factor = loaded.table.units.convert_factor(table.units)
    rows = [
        row._replace(
            position=row.position * factor, forward=row.forward * factor, backward=row.backward * factor
        )
        for row in loaded.source.rows
    ]
    return written, largest_difference(rows, again.source.rows)[0]


def write(out: Path, text: str, *, force: bool) -> None:
    """Write the file; an existing one only with ``force``, and then in one step, with the mode it had.

    A symbolic link is followed: the file that it names is written.

    Raises:
        TabFileError: a file of this name exists, it is no regular file, or the place cannot be written to.
    """
    try:
        if force:
            _replace(Path(os.path.realpath(out)), text.encode())
        else:
            _create(out, text.encode())
    except FileExistsError:
        raise TabFileError(Problem(str(out), "a file of this name", "a new name, or --force")) from None
    except OSError as error:
        raise TabFileError(Problem(str(out), error.strerror or str(error), "a place to write to")) from error


def _create(out: Path, content: bytes) -> None:
    with out.open("xb") as stream:
        try:
            stream.write(content)
            stream.flush()
        except OSError:
            out.unlink(missing_ok=True)
            raise


def _replace(out: Path, content: bytes) -> None:
    try:
        existing = out.stat()
    except FileNotFoundError:
        existing = None
    if existing is not None and not stat.S_ISREG(existing.st_mode):
        raise TabFileError(Problem(str(out), kind_of(existing.st_mode), "a regular file, or a new name"))
    beside = out.with_name(f".pitch-gateway-{secrets.token_hex(8)}")
    try:
        with beside.open("xb") as stream:
            if existing is not None:
                with suppress(PermissionError):  # only root gives files away
                    os.fchown(stream.fileno(), existing.st_uid, existing.st_gid)
                os.fchmod(stream.fileno(), stat.S_IMODE(existing.st_mode))
            stream.write(content)
        beside.replace(out)
    finally:
        beside.unlink(missing_ok=True)


def report(
    loaded: LoadedTable, out: Path, target: Dialect, result: tuple[Written, float], *, json: bool
) -> None:
    """Print what was written, what it does not hold and what its reader must be told."""
    written, difference = result
    told = {
        "file_counts_per_unit": written.context.file_counts_per_unit,
        "v1_layout": written.context.v1_layout.value if written.context.v1_layout else None,
        "file_start": written.context.file_start,
    }
    needed = {name: fact for name, fact in told.items() if fact is not None}
    if json:
        output.print_json(
            {
                "file": loaded.file,
                "out": str(out),
                "from": loaded.format,
                "to": target.name,
                "losses": list(written.losses),
                "largest_difference": difference,
                "read_with": needed,
            }
        )
        return
    typer.echo(f"{out}: {target.name}, from {loaded.file} ({loaded.format})")
    output.print_lines(f"not in the file: {loss}" for loss in written.losses)
    typer.echo(f"largest difference of a correction after reading it back: {difference:.3g}")


def letter_for(loaded: LoadedTable, axis: str | None, out: Path) -> str | None:
    """Return the axis letter for a file: told, in the source, or in one of the names."""
    return axis or loaded.source.axis or axis_of_name(out.name) or axis_of_name(Path(loaded.file).name)
