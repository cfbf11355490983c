"""``pitch-gateway table refine``: a better table from readings that were taken with the old one in use."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final

import typer

from gateway.cli import survey_files as shared
from gateway.cli.arguments import TableFile
from gateway.cli.options import takes_options
from gateway.cli.output import print_json, print_lines
from gateway.cli.table_options import AsJson, Told
from gateway.cli.table_reading import inspect
from gateway.metrology.build import Fit
from gateway.metrology.doubts import notes_of
from gateway.metrology.formats import ReadingsContext
from gateway.metrology.readings import check_corrected, check_same_axis, small_unit
from gateway.metrology.refine import Points, Refined, refine_table
from gateway.metrology.residue import left_out_json, left_out_text
from gateway.tabfile import Dialect, LoadedTable, WriteOptions, axis_of_name, dialect_named
from gateway.tabfile.conversion import is_modulo, turns_lost

OWN_OPTIONS: Final = {
    "--to-axis": "--axis",
    "--resample STEP": "--to csv, then table convert with --resample STEP",
    "--to-units mm": "--to csv, then table convert with --to-units mm",
}
"""What some options of ``table convert`` are called here."""


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
    out: shared.OutFile,
    *,
    to: Annotated[
        str | None, typer.Option("--to", metavar="FORMAT", help="Format of OUT; default: that of FILE.")
    ] = None,
    home: shared.Home = None,
    union: Annotated[
        bool, typer.Option("--union", help="Points of FILE and of the readings; default: those of FILE.")
    ] = False,
    one_way: shared.OneWay = False,
    fit: shared.FitWish = Fit.AUTO,
    lead: shared.Lead = None,
    period: shared.Turns = None,
    to_20c: shared.To20 = None,
    max_slope: shared.MaxSlope = None,
    told: Told,
    to_counts_per_unit: shared.ToCounts = None,
    to_sense: shared.ToSense = None,
    to_file_axis: shared.ToFileAxis = None,
    readings_format: shared.ReadingsFormat = None,
    runs: shared.RunsTold = None,
    force: shared.Force = False,
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
    with shared.problems():
        loaded = inspect(file, told.context())
        target = shared.dialect_to_write(to) if to is not None else dialect_named(loaded.format)
        survey = shared.prepared(
            shared.read_all(readings, ReadingsContext(readings_format, told.units, told.axis, runs)),
            to_20c,
            is_quiet=json,
        )
        check_same_axis(survey.source, survey.axis, file.name, loaded.source.axis)
        check_corrected(survey.source, survey.facts, file.name, loaded.sha256)
        old = loaded.table.in_units(survey.units)
        letter = told.axis or loaded.source.axis or axis_of_name(out.name) or axis_of_name(file.name)
        given = WriteOptions(letter, to_counts_per_unit, file_axis=to_file_axis, sense=to_sense)
        options = _as_old(replace(given, is_modulo=is_modulo(loaded, loaded.table)), loaded, target, told)
        steepest = shared.steep_allowed(survey, max_slope)
        refined = refine_table(
            old,
            survey,
            home=home.reference(old) if home else None,
            points=Points.UNION if union else Points.TABLE,
            one_way=one_way,
            fit=fit,
            periods=shared.periods_of_readings(survey, lead, period),
            refusal=lambda each: shared.refusal(target, each.in_units(loaded.table.units), options, steepest),
        )
        refined = replace(refined, notes=(*refined.notes, *notes_of(survey, with_scale=False)))
        table = refined.table.in_units(loaded.table.units)
        options = replace(options, is_modulo=is_modulo(loaded, table))
        written = shared.written(table, target, options, OWN_OPTIONS, steepest)
        again = written.again
        refined = replace(refined, notes=(*refined.notes, *shared.steep_notes(again.table)))
        losses = (*written.result.losses, *turns_lost(loaded, again.source.modulo))
        written = replace(written, result=replace(written.result, losses=losses))
        result = written.result
        shared.write_file(out, result.text, force=force, encoding=result.encoding)
    if json:
        print_json(_as_data(file, out, refined, written))
    else:
        _print(out, refined, written)


def _as_old(given: WriteOptions, loaded: LoadedTable, target: Dialect, told: Told) -> WriteOptions:
    """Complete how OUT is written by how FILE is read."""
    scale, sense, file_axis = given.file_counts_per_unit, given.sense, given.file_axis
    if scale is None and "file_counts_per_unit" in target.writes:
        scale = told.file_counts_per_unit
    if target.name == loaded.format:  # whoever reads FILE reads OUT in the same way
        sense = sense or loaded.source.context.error_sense
        file_axis = file_axis or loaded.source.file_axis
    layout = told.v1_layout if "v1_layout" in target.writes else None
    return replace(given, file_counts_per_unit=scale, v1_layout=layout, file_axis=file_axis, sense=sense)


def _print(out: Path, refined: Refined, written: shared.WrittenTable) -> None:
    change, unit = refined.change, refined.table.units.value
    print_lines((f"note: {note}" for note in refined.notes), err=True)
    typer.echo(
        f"changed by {change.rms:.3g} {unit} (root mean square), by {change.largest:.3g} at "
        f"most, {change.direction.name.lower()} at {change.position:.9g}"
    )
    print_lines(written.lines(out))
    if refined.left_out is not None and refined.left_out_before is not None:
        small = small_unit(refined.units)
        typer.echo(
            f"between its points the table will leave {left_out_text(small, refined.left_out)}, the old one "
            f"leaves {left_out_text(small, refined.left_out_before)}"
        )


def _as_data(file: Path, out: Path, refined: Refined, written: shared.WrittenTable) -> dict[str, object]:
    return {
        "file": str(file),
        "out": str(out),
        "to": written.again.format,
        "units": refined.table.units.value,
        "largest_change": refined.change.largest,
        "rms_change": refined.change.rms,
        **left_out_json(refined.units, refined.left_out_before, "_before"),
        **left_out_json(refined.units, refined.left_out),
        "notes": list(refined.notes),
        **written.as_data(),
    }
