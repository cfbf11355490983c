"""``pitch-gateway table refine``: a better table from readings that were taken with the old one in use."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Final

import typer

from gateway.cli import readings_options as given
from gateway.cli.arguments import TableFile
from gateway.cli.options import takes_options
from gateway.cli.output import Format, StderrLine, show
from gateway.cli.table_convert import letter_for
from gateway.cli.table_options import AsJson, Force, OutFile, ReadOptions
from gateway.cli.table_reading import inspect, problems
from gateway.commissioning.tables import WrittenTable, refusal, steep_notes, written_table
from gateway.metrology.doubts import notes_of
from gateway.metrology.readings import check_corrected, check_same_axis, small_unit
from gateway.metrology.refine import Points, Refined, refine_table
from gateway.metrology.residue import left_out_json, left_out_text
from gateway.tabfile import Dialect, LoadedTable, WriteOptions, dialect_named
from gateway.tabfile.conversion import is_modulo, lost_modulo

OWN_OPTIONS: Final = {
    "--to-axis": "--axis",
    "--resample STEP": "--to csv, then table convert with --resample STEP",
    "--to-units mm": "--to csv, then table convert with --to-units mm",
}
"""What some options of ``table convert`` are called here."""


@dataclass(frozen=True, slots=True)
class RefineOptions:
    """How a table is refined."""

    to: Annotated[
        str | None, typer.Option("--to", metavar="FORMAT", help="Format of OUT; default: that of FILE.")
    ] = None
    home: given.Home = None
    union: Annotated[
        bool, typer.Option("--union", help="Points of FILE and of the readings; default: those of FILE.")
    ] = False
    shape: given.ShapeOptions = field(default_factory=given.ShapeOptions)
    max_slope: given.MaxSlope = None
    source: ReadOptions = field(default_factory=ReadOptions)
    out: given.OutOptions = field(default_factory=given.OutOptions)
    readings: given.FormatOptions = field(default_factory=given.FormatOptions)
    force: Force = False


@takes_options
def refine(
    file: TableFile,
    readings: Annotated[
        list[Path],
        typer.Argument(
            metavar="READINGS...",
            help="Readings that were taken while FILE was in use.",
            show_default=False,
            readable=False,
        ),
    ],
    out: OutFile,
    *,
    options: RefineOptions,
    json: AsJson = False,
) -> None:
    """Add to a table what was left of the error while it was in use: new = old + (nominal - measured).

    Do it again with readings under the new table; it says when that brings nothing more. With --home the
    correction at home stays what it was. A turn-around point without a reading is estimated from its
    neighbour.

    Examples:
      pitch-gateway table refine cnc10x.tab after.csv better.tab --home switch-positive

      pitch-gateway table refine cnc10z.tab after.csv better.tab --file-start -2.5 --home switch-negative
    """
    with problems():
        found = _refined(file, readings, out, options, is_quiet=json)
    show(found, Format.INDENTED if json else Format.TEXT)


def _refined(
    file: Path, readings: list[Path], out: Path, options: RefineOptions, *, is_quiet: bool
) -> "_RefinedTable":
    """Refine a table and write it. Raises TabFileError, MetrologyError, TableError."""
    source, screw = options.source, options.shape.screw
    loaded = inspect(file, source.context())
    target = dialect_named(loaded.format) if options.to is None else given.dialect_to_write(options.to)
    context = options.readings.context(source.units, source.axis)
    survey = given.read_all(readings, context, screw, is_quiet=is_quiet)
    check_same_axis(survey.source, survey.axis, file.name, loaded.source.axis)
    check_corrected(survey.source, survey.facts, file.name, loaded.sha256)
    old = loaded.table.in_units(survey.units)
    asked = options.out.writing(letter_for(loaded, source.axis, out))
    writing = _as_old(replace(asked, is_modulo=is_modulo(loaded, loaded.table)), loaded, target, source)
    steepest = given.steep_allowed(survey, options.max_slope)
    refined = refine_table(
        old,
        survey,
        home=options.home.reference(old) if options.home else None,
        points=Points.UNION if options.union else Points.TABLE,
        one_way=options.shape.one_way,
        fit=options.shape.fit,
        periods=screw.periods(survey),
        refusal=lambda each: refusal(target, each.in_units(loaded.table.units), writing, steepest),
    )
    refined = replace(refined, notes=(*refined.notes, *notes_of(survey, with_scale=False)))
    table = refined.table.in_units(loaded.table.units)
    writing = replace(writing, is_modulo=is_modulo(loaded, table))
    written = written_table(table, target, writing, steepest, OWN_OPTIONS)
    again = written.again
    refined = replace(refined, notes=(*refined.notes, *steep_notes(again.table)))
    losses = (*written.result.losses, *lost_modulo(loaded, again.source.modulo))
    written = replace(written, result=replace(written.result, losses=losses))
    written.put(out, force=options.force)
    return _RefinedTable(file, out, refined, written)


@dataclass(frozen=True, slots=True)
class _RefinedTable:
    """A better table, and by how much it differs from the old one."""

    file: Path
    out: Path
    refined: Refined
    written: WrittenTable

    def as_data(self) -> dict[str, object]:
        """Return it as plain data."""
        refined = self.refined
        return {
            "file": str(self.file),
            "out": str(self.out),
            "to": self.written.again.format,
            "units": refined.table.units.value,
            "largest_change": refined.change.largest,
            "rms_change": refined.change.rms,
            **left_out_json(refined.units, refined.left_out_before, "_before"),
            **left_out_json(refined.units, refined.left_out),
            "notes": list(refined.notes),
            **self.written.as_data(),
        }

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        refined = self.refined
        change, unit = refined.change, refined.table.units.value
        yield from (StderrLine(f"note: {note}") for note in refined.notes)
        yield (
            f"changed by {change.rms:.3g} {unit} (root mean square), by {change.largest:.3g} at "
            f"most, {change.direction.name.lower()} at {change.position:.9g}"
        )
        yield from self.written.lines(self.out)
        if refined.left_out is not None and refined.left_out_before is not None:
            small = small_unit(refined.units)
            yield (
                f"between its points the table will leave {left_out_text(small, refined.left_out)}, the old "
                f"one leaves {left_out_text(small, refined.left_out_before)}"
            )


def _as_old(asked: WriteOptions, loaded: LoadedTable, target: Dialect, source: ReadOptions) -> WriteOptions:
    """Complete how OUT is written by how FILE is read."""
    scale, sense, file_axis = asked.file_counts_per_unit, asked.sense, asked.file_axis
    if scale is None and "file_counts_per_unit" in target.writes:
        scale = source.file_counts_per_unit
    if target.name == loaded.format:  # whoever reads FILE reads OUT in the same way
        sense = sense or loaded.source.context.error_sense
        file_axis = file_axis or loaded.source.file_axis
    layout = source.v1_layout if "v1_layout" in target.writes else None
    return replace(asked, file_counts_per_unit=scale, v1_layout=layout, file_axis=file_axis, sense=sense)
