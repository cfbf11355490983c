"""One sound file of each dialect, with what it means: what the tests that hold for all dialects go by."""

from pathlib import Path
from typing import Final

from gateway.compensation.units import Units
from gateway.tabfile import FileContext
from tests.tabfile.mutants import Meaning, Sample

TABLES: Final = Path(__file__).parents[2] / "tables"


def _both(units: Units, points: list[tuple[float, float]]) -> Meaning:
    return Meaning(units, points, points)


def _centroid_v1(text: str) -> Meaning:
    """Home listed, 64000 counts per inch."""
    (_, total), *values = (tuple(map(int, line.split())) for line in text.split("\n") if line.strip())
    step = total / 64000 / (len(values) - 1)
    return _both(Units.INCH, sorted((i * step, value / 64000) for i, (value,) in enumerate(values)))


def _centroid_v2(text: str) -> Meaning:
    """TB058: the table ends at 0."""
    lines = [line.split(";")[0].strip() for line in text.split("\n")]
    size, step = int(lines[0].split()[1]) + 1, float(lines[0].split()[2])
    values = [float(line) / 10_000 for line in lines[1:] if line]
    places = [(i - size + 1) * step for i in range(size)]
    curves = (list(zip(places, part, strict=True)) for part in (values[:size], values[size:]))
    return Meaning(Units.INCH, *curves)


def _centroid_v3(text: str) -> Meaning:
    """Home at the plus end: the second column is for the way down."""
    rows = sorted(tuple(map(float, line.split())) for line in text.split("\n")[5:] if line.strip())
    return Meaning(Units.INCH, [(x, up) for x, _, up in rows], [(x, down) for x, down, _ in rows])


SAMPLES: Final = (
    Sample(
        "centroid-1",
        "CNC7X.TAB",
        (TABLES / "centroid-v1" / "CNC7X.TAB").read_bytes(),
        FileContext(units=Units.INCH, file_counts_per_unit=64000.0, travel=(-22.7, 0.0)),
        _centroid_v1,
        header=frozenset({1}),
        table_options={"file_counts_per_unit": 64000.0},
        counts_per_unit=254_000.0,
        # -25 mm: -32/64000 inch are -127 counts; -50 mm: -38/64000 inch are -150.8
        moves=((-250_000, -250_127), (-500_000, -500_151), (-250_000, -250_127)),
    ),
    Sample(
        "centroid-2",
        "cnc10z.tab",
        (TABLES / "centroid-v2-tb058" / "cnc10z.tab").read_bytes(),
        FileContext(units=Units.INCH, travel=(-2.6, 0.0)),
        _centroid_v2,
        header=frozenset({1}),
        counts_per_unit=254_000.0,
        # -1.25 from above: 0.5 tenths, 12.7 counts; -2: 2 tenths, 50.8; -1.25 from below: 4.5 tenths, 114.3
        moves=((-317_500, -317_487), (-508_000, -507_949), (-317_500, -317_386)),
    ),
    Sample(
        "centroid-3",
        "cnc10z.tab",
        (TABLES / "centroid-v3" / "cnc10z.tab").read_bytes(),
        FileContext(units=Units.INCH, travel=(-4.1, 0.0)),
        _centroid_v3,
        counts_per_unit=254_000.0,
        # -1.25 from above: -1.85 tenths, -46.99 counts; -3: -1.7, -43.18; -1.25 from below: +1.2, +30.48
        moves=((-317_500, -317_547), (-762_000, -762_043), (-317_500, -317_470)),
    ),
)
