"""Sound files of the CSV dialects, Aerotech and Renishaw, with what their readers are told. All are in mm."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from gateway.compensation.units import Units
from gateway.tabfile import FileContext
from tests.tabfile import careless_csv

TABLES: Final = Path(__file__).parents[2] / "tables"


@dataclass(frozen=True, slots=True)
class CsvSample:
    """A file, and a second, careless way to understand it.

    ``header`` holds the lines whose numbers hold for all points; with ``sums`` a number holds for all points
    beyond its own. ``moves`` are targets in counts and what a drive of 10 000 counts per mm is told, worked
    out by hand, after the axis stood at the upper end of its travel.
    """

    dialect: str
    path: Path
    context: FileContext
    read: Callable[[str], tuple[careless_csv.Points, careless_csv.Points]]
    header: frozenset[int] = frozenset()
    sums: bool = False
    table_options: dict[str, object] = field(default_factory=dict)
    moves: tuple[tuple[int, int], ...] = ()


CSV_SAMPLES: Final = (
    CsvSample(
        "csv",
        TABLES / "csv" / "laser-errors.csv",
        FileContext(units=Units.MM, travel=(0.0, 400.0)),
        careless_csv.laser_errors,
        # 150 from above: +1.5 um too far, 15 counts off; 100: +2.0, 20; 300 from below: -3.5, 35 on
        moves=((1_500_000, 1_499_985), (1_000_000, 999_980), (3_000_000, 3_000_035)),
    ),
    CsvSample(
        "aerotech-cal",
        TABLES / "aerotech" / "x.cal",
        FileContext(units=Units.MM, travel=(0.0, 300.0), file_units=Units.MM, file_start=0.0),
        careless_csv.aerotech,
        header=frozenset({4, 5}),
        table_options={"file_units": "mm", "file_start": 0.0},
        # 50: -2.1 um are -21 counts; 0: 0; 75: -2.4
        moves=((500_000, 499_979), (0, 0), (750_000, 749_976)),
    ),
    CsvSample(
        "fanuc-csv",
        TABLES / "fanuc" / "x.csv",
        FileContext(units=Units.MM, travel=(-400.0, 450.0), file_units=Units.MM, file_counts_per_unit=1000.0),
        careless_csv.fanuc,
        header=frozenset(range(3, 8)),
        sums=True,
        table_options={"file_units": "mm", "file_counts_per_unit": 1000.0},
        # -250: 4 um are 40 counts; -400: 0; -225: half way between 4 and 2
        moves=((-2_500_000, -2_499_960), (-4_000_000, -4_000_000), (-2_250_000, -2_249_970)),
    ),
    CsvSample(
        "mitsubishi-csv",
        TABLES / "mitsubishi" / "x.csv",
        FileContext(units=Units.MM, travel=(-200.0, 200.0), file_units=Units.MM, file_counts_per_unit=1000.0),
        careless_csv.mitsubishi,
        header=frozenset(range(2, 7)),
        sums=True,
        table_options={"file_units": "mm", "file_counts_per_unit": 1000.0},
        # -100: 2 um are 20 counts; -200: 5 um; 100: -3 um
        moves=((-1_000_000, -999_980), (-2_000_000, -1_999_950), (1_000_000, 999_970)),
    ),
    CsvSample(
        "renishaw-ren",
        TABLES / "renishaw" / "x.ren",
        FileContext(units=Units.MM, travel=(-400.0, 0.0), file_units=Units.MM, file_counts_per_unit=1000.0),
        careless_csv.renishaw,
        header=frozenset({1, 2, 3}),
        table_options={"file_units": "mm", "file_counts_per_unit": 1000.0},
        # in reverse: 1.9 um at -100, 3.6 at -200; forward 8.0 at -150
        moves=((-1_000_000, -999_981), (-2_000_000, -1_999_964), (-1_500_000, -1_499_920)),
    ),
)
