"""What no file of a dialect can hold is refused with the reason, before anything is written."""

from collections.abc import Sequence
from typing import Any

import pytest

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, TabFileError, WriteOptions, dialect_named

MM, INCH, DEGREE = Units.MM, Units.INCH, Units.DEGREE
AMC = ErrorSense.ACTUAL_MINUS_COMMAND


def table(positions: Sequence[float], units: Units = MM, values: Sequence[float] = ()) -> CorrectionTable:
    """A table of one direction, without any correction where no values are given."""
    corrections = values or [0.0] * len(positions)
    return make_table(positions, corrections, corrections, units)


EVEN, UNEVEN, BESIDE_HOME, AROUND_HOME = [0, 1, 2], [0, 1, 3], [1, 2, 3], [-1, 0, 1]
SCALED = {"file_counts_per_unit": 1e4}
X = {"axis": "x"}
X_AMC = {"axis": "x", "sense": AMC}
INCREMENTS: list[tuple[CorrectionTable, float | None, str]] = [
    (table(EVEN), None, "counts per unit are missing"),
    (table(EVEN), -1000.0, "above 0"),
    (table(UNEVEN), 1000.0, "not evenly spaced"),
    (table([0.5, 1.5, 2.5]), 1000.0, "no point at 0"),
    (table(BESIDE_HOME), 1000.0, "no point at 0"),
    (table(EVEN, values=[0.01, 0, 0]), 1000.0, "0.01 mm at 0"),
    (table(EVEN, values=[0, 0, 0.9]), 1e6, "between 1 and 2"),
    (
        table([0, 180, 360], DEGREE, [0, 0.001, 0.001]),
        1000.0,
        "a turn with different corrections at its ends",
    ),
]
REFUSED: list[tuple[str, CorrectionTable, dict[str, Any], str]] = [
    ("centroid-1", table(EVEN, INCH), {}, "counts per unit are missing"),
    ("centroid-1", table(BESIDE_HOME, INCH), SCALED, "begins or ends at home"),
    ("centroid-1", table(EVEN, INCH, [0.01, 0, 0]), SCALED, "100 counts at home"),
    ("centroid-1", table(UNEVEN, INCH), SCALED, "not evenly spaced"),
    ("centroid-1", table(EVEN, INCH), {"file_counts_per_unit": 0.1}, "less than one count"),
    ("centroid-2", table(UNEVEN, INCH), {}, "not evenly spaced"),
    ("centroid-2", table(EVEN, DEGREE), {}, "degree"),
    ("centroid-2", table(EVEN, INCH, [0.0, 0.1001, 0.0]), {}, "1001.0000 x 0.0001 inch at 1"),
    ("centroid-2", table(EVEN, INCH), {"file_counts_per_unit": 0.5}, "too few"),
    ("centroid-2", table([0, 1]), {}, "at least 2"),
    ("centroid-3", table(EVEN, INCH), {}, "one letter"),
    ("centroid-3", table(BESIDE_HOME, INCH), X, "begins or ends at home"),
    ("centroid-3", table(AROUND_HOME, INCH), X, "begins or ends at home"),
    ("centroid-3", table(UNEVEN, INCH), X, "not evenly spaced"),
    ("centroid-3", table(EVEN, DEGREE), X, "degree"),
    ("centroid-3", table([0, 1e-4, 2e-4], INCH), X, "8 decimals"),
    *(
        (name, each, {"file_counts_per_unit": scale}, found)
        for name in ("fanuc-csv", "mitsubishi-csv")
        for each, scale, found in INCREMENTS
    ),
    ("fanuc-csv", table(range(1025)), {"file_counts_per_unit": 1000.0}, "1024 sections"),
    ("fagor-8055", table([0, 10]), {"sense": AMC}, "axis None"),
    ("fagor-8055", table([0, 10]), X, "the sense of its errors is missing"),
    ("fagor-8055", table(range(1001)), X_AMC, "1001 points"),
    ("fagor-8055", table([0, 0.00002]), X_AMC, "closer than 0.0001 mm"),
    ("fagor-8055", table([0, 4000], INCH), X_AMC, "a number of 4000"),
    ("heidenhain-com", table([0, 10]), {"sense": AMC}, "axis ''"),
    ("heidenhain-com", table([0, 10]), X, "the sense of its errors is missing"),
    ("heidenhain-com", table([0, 2e-7]), X_AMC, "closer than 1e-06 mm"),
    ("isg", table([0, 1], INCH), {}, "a table in inch"),
    ("isg", table([0, 1], INCH), {"file_counts_per_unit": -5.0}, "-5 increments per inch"),
    ("isg", table([0, 4e-7]), {}, "closer than 0.01"),
    ("siemens-eec", table([0, 5]), {}, "name of a machine axis"),
    ("siemens-eec", table([0, 5, 11]), {"axis": "X"}, "evenly spaced"),
    ("linuxcnc-1", table(range(257)), {}, "257 points"),
    ("linuxcnc-1", table([0, 5e-7]), {}, "apart"),
    ("aerotech-cal", table(EVEN), {}, "START line"),
    ("aerotech-cal", table(UNEVEN), X, "not evenly spaced"),
    ("weihong", table([0, 10]), X, "the sense of its errors is missing"),
    ("weihong", table([0, 10]), {"sense": AMC}, "axis ''"),
    ("renishaw-ren", table([0, 1]), {}, "only the laser's software makes these files"),
    ("mint", table([0, 1]), {"file_axis": "X"}, "axis 'X'"),
    # points that fit no even increment
    ("mint", table([0, 1, 3.7, 9.1], MM, [0, 0.001, -0.002, 0.001]), {}, "do not fit an even increment"),
]


@pytest.mark.parametrize(("dialect", "table", "options", "found"), REFUSED)
def test_what_a_dialect_cannot_hold_is_refused(
    dialect: str, table: CorrectionTable, options: dict[str, Any], found: str
) -> None:
    with pytest.raises(TabFileError) as caught:
        dialect_named(dialect).write(table, WriteOptions(**options))
    assert found in str(caught.value)


def test_unknown_dialect_is_named() -> None:
    with pytest.raises(TabFileError, match="centroid-1, centroid-2, centroid-3"):
        dialect_named("centroid-4")
