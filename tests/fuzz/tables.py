"""Table files of every dialect. The first byte says what the reader is told beside the text."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from itertools import pairwise
from math import isfinite
from typing import Final

from gateway.compensation.units import Units
from gateway.tabfile import (
    DIALECTS,
    ErrorSense,
    FileContext,
    TabFileError,
    WriteOptions,
    dialect_named,
    parse_table,
)
from gateway.tabfile.options import HomeSide
from tests.tabfile.samples import SAMPLES

NAME: Final = "x.tab"
UNTOLD: Final = (
    FileContext(),
    FileContext(axis="x", units=Units.INCH, travel=(-20.0, 20.0), counts_per_unit=10_000.0),
    FileContext(units=Units.DEGREE, file_units=Units.DEGREE, file_counts_per_unit=-360.0),
    FileContext(units=Units.MM, file_units=Units.INCH, file_home=HomeSide.MINUS, file_start=-10.0),
    FileContext(file_axis="1", error_sense=ErrorSense.COMMAND_MINUS_ACTUAL, file_counts_per_unit=1000.0),
)
"""What may be told of any file, and helps with some."""


@cache
def contexts(dialect: str) -> tuple[FileContext, ...]:
    """Return what the reader of a dialect is told: as the samples of the tests need it, and otherwise."""
    of_samples = (sample.context for sample in SAMPLES if sample.dialect == dialect)
    return tuple(replace(context, format=dialect) for context in (*of_samples, *UNTOLD))


def read_as(dialect: str, data: bytes) -> None:
    """A text is a table that can be computed with, written and read again, or it is refused in words.

    Refused in words: with problems of one line each that begin with the name of the file.
    """
    told = contexts(dialect)
    context = told[data[0] % len(told)] if data else told[0]
    try:
        loaded = parse_table(data[1:], NAME, context)
    except TabFileError as error:
        for line in str(error).split("\n"):
            assert line.startswith(NAME), line
        assert len(str(error).split("\n")) == len(error.problems), "a problem of several lines"
        return
    table = loaded.table
    assert all(map(isfinite, (*table.positions, *table.forward, *table.backward)))
    assert all(one < other for one, other in pairwise(table.positions))
    for lint in loaded.lints:
        assert "\n" not in lint.message, lint.message
    options = WriteOptions(
        axis="x",
        file_counts_per_unit=context.file_counts_per_unit,
        v1_layout=context.v1_layout,
        file_axis=context.file_axis,
        sense=ErrorSense.ACTUAL_MINUS_COMMAND,
    )
    target = dialect_named(dialect)
    try:
        written = target.write(table, options)
    except TabFileError:
        return  # the dialect cannot hold it
    again = parse_table(written.text.encode(), NAME, replace(written.context, format=dialect)).table
    assert again.units.convert_factor(table.units) > 0
    assert again.positions, "nothing is read back"


def seeds(dialect: str) -> Iterator[bytes]:
    """Yield the samples of a dialect, and each other dialect's as a text that is not of it."""
    of_dialect = [sample for sample in SAMPLES if sample.dialect == dialect]
    for index, sample in enumerate(of_dialect):
        yield bytes((index,)) + sample.data
        for number in range(len(UNTOLD)):
            yield bytes((len(of_dialect) + number,)) + sample.data


DIALECT_NAMES: Final = tuple(dialect.name for dialect in DIALECTS)


def target_of(dialect: str) -> tuple[Callable[[bytes], None], Callable[[], Iterator[bytes]]]:
    """Return the target of one dialect, and its seeds."""
    return partial(read_as, dialect), partial(seeds, dialect)
