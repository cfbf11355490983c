"""Options of a measuring run. Lengths are in units of the axis, positions are machine positions."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from gateway.commissioning.options import Option
from gateway.metrology.gauge_kinds import GaugeKind


@dataclass(frozen=True, slots=True)
class AxisChoice:
    """The axis to move, and the listener of the gateway."""

    axis: Annotated[str, Option("The axis.")]
    controller: Annotated[
        str | None, Option("Listener to connect to; default: the only one that may move the axis.")
    ] = None
    port: Annotated[
        str | None, Option("Serial port of this computer at the listener's cable, where it is a serial one.")
    ] = None


@dataclass(frozen=True, slots=True)
class Grid:
    """The requested targets."""

    low: Annotated[float | None, Option("Lowest target, machine position.", "from")] = None
    high: Annotated[float | None, Option("Highest target.", "to")] = None
    step: Annotated[float | None, Option("Distance of the targets.")] = None
    targets: Annotated[int | None, Option("Instead of --step: so many, with random offsets.", min=2)] = None
    spread: Annotated[float | None, Option("With --targets: largest offset; default: the lead.")] = None
    lead: Annotated[float | None, Option("Lead of the screw; default: the key lead of the axis.")] = None
    seed: Annotated[int, Option("With --targets: the same seed gives the same targets.")] = 1
    runs: Annotated[int, Option("Cycles up and down.", min=1, max=1000)] = 5
    overrun: Annotated[float | None, Option("How far beyond the targets it turns round; default 1 mm.")] = (
        None
    )

    @property
    def is_asked(self) -> bool:
        """Whether any option about targets was given."""
        return any(each is not None for each in (self.low, self.high, self.step, self.targets, self.overrun))


@dataclass(frozen=True, slots=True)
class Pace:
    """How the axis moves from stop to stop, and when it counts as arrived."""

    dwell_s: Annotated[float, Option("Seconds from the arrival to the reading.", "dwell", min=0.0)] = 2.0
    speed: Annotated[
        float | None, Option("For the estimate of the time, in units/s; the drive's own speed holds.")
    ] = None
    window: Annotated[
        float | None, Option("How near to a target the axis counts as there; default 0.01 mm.")
    ] = None
    move_timeout_s: Annotated[float, Option("Seconds that one move may take.", "move-timeout", min=0.1)] = (
        120.0
    )


@dataclass(frozen=True, slots=True)
class InstrumentOptions:
    """The instrument, and how its display becomes a machine position. Default: a person reads it."""

    csv: Annotated[Path | None, Option("Take readings from this file, to which rows are appended.")] = None
    column: Annotated[str, Option("With --csv: the column, by its name or number from 1.")] = "1"
    delimiter: Annotated[str, Option("With --csv: between columns; tab is one too.")] = ","
    gauge: Annotated[
        str | None, Option("Take readings from a gauge on this serial port.", metavar="PORT")
    ] = None
    kind: Annotated[GaugeKind, Option("How the gauge writes.", "gauge-kind")] = GaugeKind.SYLVAC
    baudrate: Annotated[int | None, Option("Default: 9600; 4800 for sylvac.", "gauge-baud")] = None
    request: Annotated[
        str | None,
        Option(
            "What asks the gauge, without its CR; empty: its button sends. Default: ? for sylvac, "
            "M1? for millimar.",
            "gauge-request",
        ),
    ] = None
    pattern: Annotated[
        str | None,
        Option(
            "With --gauge-kind pattern: a regular expression of a whole line, the number a group value.",
            "gauge-pattern",
            "REGEX",
        ),
    ] = None
    timeout_s: Annotated[float, Option("Seconds that an answer may take.", "gauge-timeout", min=0.1)] = 5.0
    units: Annotated[
        str | None, Option("Of the instrument: mm, um or inch; default: the axis's.", "reading-units")
    ] = None
    is_reversed: Annotated[
        bool, Option("The instrument counts down where the axis counts up.", "reversed")
    ] = False
    zero_at: Annotated[float, Option("Machine position at which the instrument shows 0.")] = 0.0
    largest: Annotated[
        float | None,
        Option("Beyond it a reading is taken for a slip; default 1 mm.", "largest-deviation"),
    ] = None


@dataclass(frozen=True, slots=True)
class Results:
    """The files for the readings and the results."""

    readings: Annotated[Path | None, Option("File of readings; default: the axis and the time.")] = None
    resume: Annotated[Path | None, Option("Go on with the file of a run that was stopped.")] = None
    out: Annotated[Path | None, Option("Write the table to this file.")] = None
    out_format: Annotated[str | None, Option("Dialect of --out; default: the active table's, or csv.")] = None
    table_step: Annotated[
        float | None,
        Option(
            "An even grid for the new table, over the whole travel: for a format that begins at home. "
            "Default: --step, where the table cannot be written at the targets."
        ),
    ] = None
    force: Annotated[bool, Option("Replace the file of --out and of --report.")] = False
    report: Annotated[Path | None, Option("Write a report: .html, .png or .svg.")] = None
    before: Annotated[
        Path | None, Option("With --report: readings without the table, for before and after.")
    ] = None


@dataclass(frozen=True, slots=True)
class MeasureOptions:
    """All options."""

    choice: AxisChoice
    grid: Grid = Grid()
    pace: Pace = Pace()
    reader: InstrumentOptions = InstrumentOptions()
    results: Results = Results()
