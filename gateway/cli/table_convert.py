"""``pitch-gateway table convert``: a table in another format, and the losses."""

from dataclasses import dataclass
from pathlib import Path

import typer

from gateway.cli.arguments import TableFile
from gateway.cli.options import takes_options
from gateway.cli.output import Format, show
from gateway.cli.table_options import AsJson, OutFile, OutOptions, Target
from gateway.cli.table_reading import inspect, problems
from gateway.commissioning.refining import letter_for
from gateway.commissioning.table_options import Force, ReadOptions
from gateway.compensation.errors import TableError
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.plain import JsonObject
from gateway.tabfile import (
    Dialect,
    FileContext,
    FileProblem,
    LoadedTable,
    TabFileError,
    WriteOptions,
    dialect_named,
)
from gateway.tabfile.conversion import (
    Converted,
    Resampled,
    converted,
    is_modulo,
    lost_modulo,
    reader_lines,
    reader_options,
    resample,
    tidied,
    write,
)
from gateway.tabfile.options import MAX_SCALE, MIN_SCALE


@takes_options
def convert(
    file: TableFile,
    out: OutFile,
    *,
    to: Target,
    out_options: OutOptions,
    source: ReadOptions,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """Write a table in another format, and say what that format cannot hold.

    The written text is read back and compared before OUT changes. If a format holds only even grids, use
    --resample for an uneven table. Centroid version 1 takes the counts per unit from --to-counts-per-unit or
    --file-counts-per-unit.

    Examples:
      pitch-gateway table convert CNC7Z.TAB cnc10z.tab --to centroid-3 --file-start -2.5 --axis z

      pitch-gateway table convert cnc10z.tab CNC7Z.TAB --to centroid-1 --to-counts-per-unit 25400

      pitch-gateway table convert x-table.csv cnc10x.tab --to centroid-3 --axis x --resample 10
    """
    target = dialect_named(to)
    with problems():
        loaded = inspect(file, source.context())
        scale = _scale(out_options.to_counts_per_unit)
        table = _in_units(loaded, out_options.to_units)
        if scale is None and target.name == "centroid-1" and source.file_counts_per_unit is not None:
            scale = source.file_counts_per_unit * table.units.convert_factor(loaded.table.units)
        even = None if out_options.resample is None else resample(table, out_options.resample, str(file))
        letter = _letter(out_options.to_axis) or letter_for(loaded, source.axis, out)
        table = even.table if even else table
        if even or out_options.to_units not in (None, loaded.table.units):
            table = tidied(table)
        options = WriteOptions(
            axis=letter,
            file_counts_per_unit=scale,
            v1_layout=out_options.to_v1_layout,
            file_axis=out_options.to_file_axis,
            sense=out_options.to_sense,
            is_modulo=is_modulo(loaded, table),
        )
        result = converted(table, target, options)
        write(out, result.written.text, force=force, encoding=result.written.encoding)
    found = _Converted(loaded, out, target, table.units, even, result)
    show(found, Format.INDENTED if json else Format.TEXT)


def _scale(given: float | None) -> float | None:
    """Return the scale of OUT.

    Raises:
        BadParameter: 0, or of a size that no machine has.
    """
    if given is not None and not MIN_SCALE <= abs(given) <= MAX_SCALE:
        rule = f"must be a number other than 0, its size from {MIN_SCALE:g} to {MAX_SCALE:g}"
        raise typer.BadParameter(f"{given:g}: {rule}", param_hint="--to-counts-per-unit")
    return given


def _letter(given: str | None) -> str | None:
    """Return the given axis letter of OUT.

    Raises:
        ContextError: it is not a letter.
    """
    return FileContext(axis=given).axis


def _in_units(loaded: LoadedTable, units: Units | None) -> CorrectionTable:
    try:
        return loaded.table.in_units(units or loaded.table.units)
    except (ValueError, TableError) as error:
        raise TabFileError(FileProblem(loaded.file, str(error), "--to-units of the same kind")) from error


@dataclass(frozen=True, slots=True)
class _Converted:
    """The written table, its losses, and the options that its reader needs."""

    loaded: LoadedTable
    out: Path
    target: Dialect
    units: Units
    even: Resampled | None
    result: Converted

    def _losses(self) -> list[str]:
        # Backlash compensation by the control of FILE, which is in no table.
        backlash = [line for line in self.loaded.source.behaves_as if line.startswith("backlash")]
        return [
            *self.result.written.losses,
            *(
                f"the lost motion that {self.loaded.format} states outside the table: {line}"
                for line in backlash
            ),
            *lost_modulo(self.loaded, self.result.modulo),
        ]

    def as_data(self) -> JsonObject:
        """Return it as plain data; lengths are in the units of OUT."""
        even = self.even
        return {
            "file": self.loaded.file,
            "out": str(self.out),
            "from": self.loaded.format,
            "to": self.target.name,
            "losses": self._losses(),
            "resampled": None
            if even is None
            else {
                "points": len(even.table.positions),
                "largest_difference": even.difference,
                "at": even.at,
            },
            "largest_difference": self.result.difference,
            "largest_difference_at": self.result.at,
            "units": self.units.value,
            "read_with": reader_options(self.result.written, self.target),
            "usual_suffix": self.target.suffix,
        }

    def lines(self) -> list[str]:
        """Return it as lines for a person."""
        lines = [f"{self.out}: {self.target.name}, from {self.loaded.file} ({self.loaded.format})"]
        if self.even is not None:
            size = len(self.even.table.positions)
            lines.append(
                f"on an even grid of {size} points: corrections change by at most "
                f"{self.even.difference:.3g} {self.units.value} (at {self.even.at:g})"
            )
        lines += [f"not in the file: {loss}" for loss in self._losses()]
        lines += reader_lines(self.result.written, self.target)
        if self.target.suffix and self.out.suffix.lower() != self.target.suffix.lower():
            lines.append(f"files of {self.target.name} are usually called *{self.target.suffix}")
        lines.append(
            f"largest difference of a correction when read back: {self.result.difference:.3g} "
            f"{self.units.value} (at {self.result.at:g})"
        )
        return lines
