"""A better table from readings with the old one in use, as a file."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Final

from gateway.commissioning.table_options import (
    Force,
    FormatOptions,
    Home,
    MaxSlope,
    OutOptions,
    ReadOptions,
    ShapeOptions,
    steep_allowed,
    writable_names,
)
from gateway.commissioning.tables import WrittenTable, refusal, steep_notes, written_table
from gateway.metrology.doubts import notes_of
from gateway.metrology.errors import ReadingsError
from gateway.metrology.readings import Survey, check_corrected, check_same_axis, small_unit
from gateway.metrology.refine import Points, Refined, refine_table
from gateway.metrology.residue import left_out_json, left_out_text
from gateway.options import Option, Options
from gateway.plain import JsonObject
from gateway.tabfile import Dialect, LoadedTable, WriteOptions, axis_of_name, dialect_named
from gateway.tabfile.conversion import is_modulo, lost_modulo

OWN_OPTIONS: Final = {
    "--to-axis": "--axis",
    "--resample STEP": "--to csv, then table convert with --resample STEP",
    "--to-units mm": "--to csv, then table convert with --to-units mm",
}
"""Names here for some options of ``table convert``."""


@dataclass(frozen=True, slots=True)
class RefineOptions(Options):
    """Options for refining a table."""

    to: Annotated[
        str | None, Option("Format of OUT; default: that of FILE.", metavar="FORMAT", one_of=writable_names)
    ] = None
    home: Home = None
    union: Annotated[bool, Option("Points of FILE and of the readings; default: only those of FILE.")] = False
    shape: ShapeOptions = field(default_factory=ShapeOptions)
    max_slope: MaxSlope = None
    source: ReadOptions = field(default_factory=ReadOptions)
    out: OutOptions = field(default_factory=OutOptions)
    readings: FormatOptions = field(default_factory=FormatOptions)
    force: Force = False


def refine(loaded: LoadedTable, survey: Survey, out: Path, options: RefineOptions) -> "RefinedTable":
    """Add what was left of the error to the table in use, and write the sum to ``out``.

    Raises:
        TabFileError, MetrologyError, TableError: no table can be made, or ``out`` cannot be written.
    """
    source, file = options.source, Path(loaded.file)
    target = dialect_named(options.to or loaded.format)
    check_same_axis(survey.source, survey.axis, file.name, loaded.source.axis)
    if survey.standard is not None:
        raise ReadingsError(
            f"{survey.source}: differences over a block: walk the block without a table, and make a new one "
            "with table build"
        )
    check_corrected(survey.source, survey.facts, file.name, loaded.sha256)
    old = loaded.table.in_units(survey.units)
    asked = options.out.writing(letter_for(loaded, source.axis, out))
    writing = as_old(replace(asked, is_modulo=is_modulo(loaded, loaded.table)), loaded, target, source)
    steepest = steep_allowed(survey, options.max_slope)
    refined = refine_table(
        old,
        survey,
        home=options.home.reference(old) if options.home else None,
        points=Points.UNION if options.union else Points.TABLE,
        one_way=options.shape.one_way,
        fit=options.shape.fit,
        periods=options.shape.screw.periods(survey),
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
    return RefinedTable(file, out, refined, written)


@dataclass(frozen=True, slots=True)
class RefinedTable:
    """A better table, and its difference from the old one."""

    file: Path
    out: Path
    refined: Refined
    written: WrittenTable

    def as_data(self) -> JsonObject:
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
        """Yield it in words, without the notes."""
        refined = self.refined
        change, unit = refined.change, refined.table.units.value
        yield (
            f"changed by {change.rms:.3g} {unit} (root mean square), by at most {change.largest:.3g}, "
            f"{change.direction.name.lower()} at {change.position:.9g}"
        )
        yield from self.written.lines(self.out)
        if refined.left_out is not None and refined.left_out_before is not None:
            small = small_unit(refined.units)
            yield (
                f"between its points the table will leave {left_out_text(small, refined.left_out)}, the old "
                f"one leaves {left_out_text(small, refined.left_out_before)}"
            )


def letter_for(loaded: LoadedTable, axis: str | None, out: Path) -> str | None:
    """Return the axis letter for a file: the given one, that of the source, or one from the names."""
    return axis or loaded.source.axis or axis_of_name(out.name) or axis_of_name(Path(loaded.file).name)


def as_old(asked: WriteOptions, loaded: LoadedTable, target: Dialect, source: ReadOptions) -> WriteOptions:
    """Complete the options for writing OUT by those for reading FILE."""
    scale, sense, file_axis = asked.file_counts_per_unit, asked.sense, asked.file_axis
    if scale is None and "file_counts_per_unit" in target.writes:
        scale = source.file_counts_per_unit
    if target.name == loaded.format:  # a reader of FILE reads OUT in the same way
        if "file_counts_per_unit" in target.writes:  # the file may state it itself
            scale = scale or loaded.source.context.file_counts_per_unit
        sense = sense or loaded.source.context.error_sense
        file_axis = file_axis or loaded.source.file_axis
    layout = source.v1_layout if "v1_layout" in target.writes else None
    return replace(asked, file_counts_per_unit=scale, v1_layout=layout, file_axis=file_axis, sense=sense)
