"""Pure text: files of readings, one file per format, text -> :class:`~gateway.metrology.readings.Survey`.

What a file does not prove (its units, the direction of a run) is told by a :class:`ReadingsContext`, or the
file is refused with what can be done. Errors are those of table files: file, line, found, allowed.
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
