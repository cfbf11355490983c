"""The first step of commands that take readings: read the files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from gateway.commissioning.table_options import ScrewOptions
from gateway.metrology.formats import ReadingsContext, read_survey
from gateway.metrology.readings import Survey, merged, understood

ReadingFiles = Annotated[
    list[Path],
    typer.Argument(
        metavar="READINGS...",
        help="Files of readings: CSV, a manual table, Renishaw .rtl, API .pos, or a spreadsheet (.xlsx).",
        show_default=False,
        readable=False,
    ),
]


def read_all(
    files: Sequence[Path], context: ReadingsContext, screw: ScrewOptions, *, is_quiet: bool
) -> Survey:
    """Read files of one axis as one survey, and print a summary, unless quiet.

    It is normalised to 20 °C, if requested.

    Raises:
        TabFileError, ReadingsError: see the called functions, and :meth:`ScrewOptions.normalised`.
    """
    survey = merged([read_survey(file, context) for file in files])
    if not is_quiet:
        typer.echo(f"read: {understood(survey)}")
    return screw.normalised(survey)
