"""The options of ``pitch-gateway measure``."""

from pathlib import Path
from typing import Annotated

import typer

from gateway.metrology.gauge_kinds import GaugeKind

Option = typer.Option

AxisName = Annotated[str, Option("--axis", help="The axis.", show_default=False)]
Controller = Annotated[
    str | None,
    Option("--controller", help="Listener to connect to; default: the only one that may move the axis."),
]
Port = Annotated[
    str | None,
    Option("--port", help="Serial port of this computer at the listener's cable, where it is a serial one."),
]
From = Annotated[float | None, Option("--from", help="Lowest target, machine position.", show_default=False)]
To = Annotated[float | None, Option("--to", help="Highest target.", show_default=False)]
Step = Annotated[float | None, Option("--step", help="Distance of the targets.", show_default=False)]
Targets = Annotated[
    int | None,
    Option("--targets", min=2, help="Instead of --step: so many, with random offsets.", show_default=False),
]
Spread = Annotated[
    float | None,
    Option("--spread", help="With --targets: largest offset; default: the lead.", show_default=False),
]
Lead = Annotated[
    float | None,
    Option("--lead", help="Lead of the screw; default: the key lead of the axis.", show_default=False),
]
Seed = Annotated[int, Option("--seed", help="With --targets: the same seed gives the same targets.")]
Runs = Annotated[int, Option("--runs", min=1, max=1000, help="Cycles up and down.")]
Overrun = Annotated[
    float | None,
    Option("--overrun", help="How far beyond the targets it turns round; default 1 mm.", show_default=False),
]
Dwell = Annotated[float, Option("--dwell", min=0.0, help="Seconds from the arrival to the reading.")]
Speed = Annotated[
    float | None,
    Option("--speed", help="For the estimate of the time, in units/s; the drive's own speed holds."),
]
Window = Annotated[
    float | None, Option("--window", help="How near to a target the axis counts as there; default 0.01 mm.")
]
MoveTimeout = Annotated[float, Option("--move-timeout", min=0.1, help="Seconds that one move may take.")]
CsvFile = Annotated[
    Path | None, Option("--csv", help="Take readings from this file, to which rows are appended.")
]
Column = Annotated[str, Option("--column", help="With --csv: the column, by its name or number from 1.")]
Delimiter = Annotated[str, Option("--delimiter", help="With --csv: between columns; tab is one too.")]
Gauge = Annotated[
    str | None, Option("--gauge", help="Take readings from a gauge on this serial port.", metavar="PORT")
]
Kind = Annotated[GaugeKind, Option("--gauge-kind", help="How the gauge writes.")]
Baud = Annotated[int | None, Option("--gauge-baud", help="Default: 9600; 4800 for sylvac.")]
Request = Annotated[
    str | None,
    Option(
        "--gauge-request",
        help="What asks the gauge, without its CR; empty: its button sends. Default: ? for sylvac, "
        "M1? for millimar.",
    ),
]
Pattern = Annotated[
    str | None,
    Option(
        "--gauge-pattern",
        help="With --gauge-kind pattern: a regular expression of a whole line, the number a group value.",
        metavar="REGEX",
    ),
]
GaugeTimeout = Annotated[float, Option("--gauge-timeout", min=0.1, help="Seconds that an answer may take.")]
ReadingUnits = Annotated[
    str | None, Option("--reading-units", help="Of the instrument: mm, um or inch; default: the axis's.")
]
Reversed = Annotated[bool, Option("--reversed", help="The instrument counts down where the axis counts up.")]
ZeroAt = Annotated[float, Option("--zero-at", help="Machine position at which the instrument shows 0.")]
Largest = Annotated[
    float | None,
    Option("--largest-deviation", help="Beyond it a reading is taken for a slip; default 1 mm."),
]
Readings = Annotated[
    Path | None, Option("--readings", help="File of readings; default: the axis and the time.")
]
Resume = Annotated[Path | None, Option("--resume", help="Go on with the file of a run that was stopped.")]
Out = Annotated[Path | None, Option("--out", help="Write the table to this file.")]
OutFormat = Annotated[
    str | None, Option("--out-format", help="Dialect of --out; default: the active table's, or csv.")
]
TableStep = Annotated[
    float | None,
    Option(
        "--table-step",
        help="An even grid for the new table, over the whole travel: for a format that begins at home. "
        "Default: --step, where the table cannot be written at the targets.",
        show_default=False,
    ),
]
Force = Annotated[bool, Option("--force", help="Replace the file of --out and of --report.")]
ReportFile = Annotated[Path | None, Option("--report", help="Write a report: .html, .png or .svg.")]
Before = Annotated[
    Path | None,
    Option("--before", help="With --report: readings without the table, for before and after."),
]
Yes = Annotated[bool, Option("--yes", help="Do not ask before the axis moves: for scripts.")]
Json = Annotated[bool, Option("--json", help="Say everything that happens as lines of JSON.")]
