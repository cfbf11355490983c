"""Files of readings, one module per format: text -> :class:`~gateway.metrology.readings.Survey`.

A :class:`ReadingsContext` gives what a file does not prove (its units, the direction of a run). Without it
the file is refused, with a remedy. Errors are those of table files: file, line, found, allowed.
"""

from gateway.metrology.formats.context import ReadingsContext, Runs
from gateway.metrology.formats.load import FORMATS, ReadingsFormat, is_readings, parse_survey, read_survey

__all__ = [
    "FORMATS",
    "ReadingsContext",
    "ReadingsFormat",
    "Runs",
    "is_readings",
    "parse_survey",
    "read_survey",
]
