"""Files of readings, and what is made of them. The first byte says what the reader is told besides."""

from collections.abc import Iterator
from itertools import product
from math import isfinite
from typing import Final

from gateway.compensation.errors import TableError
from gateway.compensation.units import Units
from gateway.metrology.build import HomeCase
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import evaluate
from gateway.metrology.formats import parse_survey
from gateway.metrology.formats.context import ReadingsContext, Runs
from gateway.metrology.recipe import Recipe, build_from
from gateway.tabfile import TabFileError
from tests.metrology.samples import POS, POS_MEANS, RTL, TB058_MANUAL, TB058_SIMULATED
from tests.tabfile.samples import TABLES

NAME: Final = "x.csv"
CONTEXTS: Final = tuple(
    ReadingsContext(units=units, runs=runs)
    for units, runs in product((None, Units.MM, Units.INCH), (None, *Runs))
)
RECIPES: Final = (
    Recipe(),
    Recipe(step=5.0, home=HomeCase.SWITCH_POSITIVE),
    Recipe(tolerance=0.001, drop_outliers=True),
    Recipe(smooth=30.0, one_way=True, travel=(-50.0, 150.0), step=25.0),
)


def files(data: bytes) -> None:
    """A text is readings that can be judged and made a table of, or is refused in words.

    Refused in words: with problems of one line each that begin with the name of the file; and where readings
    make no table, with a sentence.
    """
    first = data[0] if data else 0
    try:
        survey = parse_survey(data[1:], NAME, CONTEXTS[first % len(CONTEXTS)])
    except TabFileError as error:
        for line in str(error).split("\n"):
            assert line.startswith(NAME), line
        return
    for reading in survey.readings:
        assert isfinite(reading.target)
        assert isfinite(reading.measured)
        assert reading.run >= 1
    try:
        evaluate(survey)
        built = build_from(survey, RECIPES[first // len(CONTEXTS) % len(RECIPES)])
    except (ReadingsError, TableError) as error:
        assert str(error).strip()
        return
    table = built.table
    assert all(map(isfinite, (*table.positions, *table.forward, *table.backward)))


def seeds() -> Iterator[bytes]:
    """Yield the files of readings that come with the project, and the samples of the tests."""
    texts = [path.read_bytes() for path in sorted((TABLES / "readings").iterdir())]
    texts += [text.encode() for text in (RTL, POS, POS_MEANS, TB058_MANUAL, TB058_SIMULATED)]
    for number, text in enumerate(texts):
        for recipe in range(len(RECIPES)):
            yield bytes((recipe * len(CONTEXTS) + number % 4,)) + text
            yield bytes((recipe * len(CONTEXTS) + 4 + number % 4,)) + text
