"""A drift test like ISO 230-3: one position is read for hours while the machine warms up or rests.

File: comments and cells as those of readings, ``time_min`` (minutes), ``measured_`` or ``deviation_`` with a
unit, ``temperature_c`` if available. The results are the range over the test, the largest change within an
hour, the rate in the last hour, and the change per kelvin. Source of the quantities: textbooks' account of
ISO 230-3 (ETVE, environmental temperature variation error); the standard itself was not available.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean
from typing import Final

from gateway.compensation.units import Units
from gateway.metrology.formats.cells import decimal, heading_of, unit_of, units_of, words, worksheet_of
from gateway.tabfile.text import SourceText, shown

HEADING: Final = "time_min,measured_um (or _mm, _inch),temperature_c"
WINDOW_MIN: Final = 60.0
LEAST: Final = 3
LEAST_KELVIN: Final = 0.3
"""If the temperature varied by less, the change per kelvin is unknown."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading: minutes since any moment, position, temperature."""

    minutes: float
    measured: float
    temperature_c: float | None = None


@dataclass(frozen=True, slots=True)
class DriftTest:
    """The results; lengths in ``units``."""

    units: Units
    minutes: float
    span: float
    """Largest reading less smallest."""
    largest_hour: float
    """The largest range within any hour."""
    hour_began: float
    """Minutes from the first reading to that hour."""
    last_rate: float
    """Change an hour at the end, by the straight line through the last hour."""
    per_kelvin: float | None
    """Change a kelvin, by the straight line over temperature; None: not read, or it hardly varied."""
    explained: float | None
    """Share of the variance that this line explains."""


def evaluate_drift(samples: Sequence[Sample], units: Units) -> DriftTest:
    """Evaluate samples in the order of their times."""
    times = [each.minutes for each in samples]
    values = [each.measured for each in samples]
    hours = []
    for index, begin in enumerate(times):
        window = values[index : bisect_right(times, begin + WINDOW_MIN * (1 + 1e-9))]
        hours.append((max(window) - min(window), -begin))
    largest, began = max(hours)
    late = [each for each in samples if each.minutes >= times[-1] - WINDOW_MIN * (1 + 1e-9)]
    rate, _ = _line([each.minutes / WINDOW_MIN for each in late], [each.measured for each in late])
    warm = [(each.temperature_c, each.measured) for each in samples if each.temperature_c is not None]
    per_kelvin = explained = None
    if len(warm) == len(samples) and max(t for t, _ in warm) - min(t for t, _ in warm) >= LEAST_KELVIN:
        per_kelvin, explained = _line([t for t, _ in warm], [v for _, v in warm])
    return DriftTest(
        units,
        times[-1] - times[0],
        max(values) - min(values),
        largest,
        -began - times[0],
        rate,
        per_kelvin,
        explained,
    )


def _line(xs: Sequence[float], ys: Sequence[float]) -> tuple[float, float]:
    """Return the slope of the line that fits best, and the share of the variance that it explains."""
    middle, mean = fmean(xs), fmean(ys)
    xx = sum((x - middle) ** 2 for x in xs)
    yy = sum((y - mean) ** 2 for y in ys)
    xy = sum((x - middle) * (y - mean) for x, y in zip(xs, ys, strict=True))
    return (xy / xx if xx else 0.0), (xy * xy / (xx * yy) if xx and yy else 0.0)


def read_samples(source: SourceText) -> tuple[list[Sample], Units]:
    """Read a file of a drift test.

    Raises:
        TabFileError: a heading with missing columns, a cell that is not a number, times that do not ascend,
            fewer than three readings.
    """
    if heading_of(source) is None:
        raise source.error("no heading with a separator", HEADING, line=source.lines[0].number)
    worksheet = worksheet_of(source, HEADING)
    columns = {(words(name) or ("",))[0]: index for index, name in enumerate(worksheet.names)}
    value = "measured" if "measured" in columns else "deviation"
    missing = [name for name in ("time", value) if name not in columns]
    units = units_of(source, worksheet)
    if missing or units is None:
        found = f"no {' and no '.join(missing)} in the heading" if missing else "no unit in the heading"
        raise source.error(found, HEADING, line=worksheet.heading.number)
    time_name = worksheet.names[columns["time"]]
    if words(time_name)[1:] not in {("min",), ("minutes",)}:
        raise source.error(
            f"{shown(time_name)} in the heading", "time_min: minutes", line=worksheet.heading.number
        )
    scale = (unit_of(worksheet.names[columns[value]]) or (units, 1.0))[1]
    samples = []
    for line, cells in worksheet.lines:
        warm = (
            decimal(source, line, cells[columns["temperature"]], "temperature")
            if "temperature" in columns
            else None
        )
        minutes = decimal(source, line, cells[columns["time"]], "time")
        samples.append(Sample(minutes, decimal(source, line, cells[columns[value]], value) * scale, warm))
    for (line, _), (before, after) in zip(worksheet.lines[1:], pairwise(samples), strict=True):
        if after.minutes <= before.minutes:
            raise source.error(
                f"time {after.minutes:g} after {before.minutes:g}", "times that ascend", line=line
            )
    if len(samples) < LEAST:
        raise source.error(f"{len(samples)} reading(s)", f"at least {LEAST}", line=source.last_line)
    return samples, units
