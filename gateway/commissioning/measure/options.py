"""Options of a measuring run. Lengths are in units of the axis, positions are machine positions.

A value outside its limits raises an ``OptionError`` here, before anything is checked or moved.
"""

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Annotated

from gateway.commissioning.table_options import StatedOptions
from gateway.metrology.gauge_kinds import GaugeKind
from gateway.metrology.standard import Grade
from gateway.metrology.walk import LEAST, MOST, MOST_PER_SIDE
from gateway.options import Option, Options


@dataclass(frozen=True, slots=True)
class AxisChoice(Options):
    """The axis to move, and the listener of the gateway."""

    axis: Annotated[str, Option("The axis.")]
    controller: Annotated[
        str | None, Option("Listener to connect to; default: the only one that may move the axis.")
    ] = None
    port: Annotated[
        str | None, Option("Serial port of this computer on the listener's cable, if the listener is serial.")
    ] = None


@dataclass(frozen=True, slots=True)
class Grid(Options):
    """The requested targets."""

    low: Annotated[float | None, Option("Lowest target, machine position.", "from")] = None
    high: Annotated[float | None, Option("Highest target.", "to")] = None
    step: Annotated[float | None, Option("Distance between targets.")] = None
    targets: Annotated[
        int | None, Option("In place of --step: number of targets, with random offsets.", min=2)
    ] = None
    spread: Annotated[float | None, Option("With --targets: largest offset; default: the lead.")] = None
    lead: Annotated[float | None, Option("Lead of the screw; default: key lead of the axis.")] = None
    seed: Annotated[int, Option("With --targets: the same seed gives the same targets.")] = 1
    runs: Annotated[int, Option("Runs up and down.", min=1, max=1000)] = 5
    overrun: Annotated[
        float | None, Option("How far beyond the targets the axis turns round; default: 1 mm.")
    ] = None

    @property
    def is_asked(self) -> bool:
        """Whether any option about targets was given."""
        return any(each is not None for each in (self.low, self.high, self.step, self.targets, self.overrun))


class Method(Enum):
    """How an axis is measured."""

    POSITIONS = "positions"
    """One instrument shows the position everywhere: a laser, a scale."""
    BLOCK_WALK = "block-walk"
    """A gauge block is walked along the axis, and a dial shows differences."""


class Gap(Enum):
    """What the gap between dial and stop does while the axis moves forward."""

    OPENS = "opens"
    CLOSES = "closes"


@dataclass(frozen=True, slots=True)
class WalkOptions(Options):
    """With ``block-walk``: the block, the dial, and how often they are placed."""

    method: Annotated[
        Method,
        Option(
            "positions: one instrument shows the position everywhere. block-walk: one gauge block is walked "
            "along the axis, and a dial shows differences."
        ),
    ] = Method.POSITIONS
    block: Annotated[float | None, Option("With block-walk: nominal length of the block.")] = None
    dial_range: Annotated[
        float | None,
        Option(
            "With block-walk: range of the dial that the walk may use. As much as the lead shows errors that "
            "repeat with the turn; 0 moves exactly by the block.",
            min=0.0,
        ),
    ] = None
    placements: Annotated[
        int | None,
        Option(
            "With block-walk: how often dial and stop are placed; default: about every 9 mm.",
            min=LEAST,
            max=MOST,
        ),
    ] = None
    per_side: Annotated[
        int,
        Option(
            "With block-walk: positions without the block at each placement, and as many with it. More show "
            "the turn better, if the dial has the range.",
            min=1,
            max=MOST_PER_SIDE,
        ),
    ] = 1
    gap: Annotated[
        Gap, Option("With block-walk: whether the gap of the dial opens while the axis moves forward.")
    ] = Gap.OPENS
    grade: Annotated[
        Grade | None, Option("Grade of the block, or unknown: then no scale is found.", "block-grade")
    ] = None
    deviation_um: Annotated[
        float, Option("From the block's certificate: actual less nominal length, in µm.", "block-deviation")
    ] = 0.0
    uncertainty_um: Annotated[
        float | None,
        Option(
            "In place of a grade, from the certificate: uncertainty (k = 2) in µm.",
            "block-uncertainty",
            min=0.0,
        ),
    ] = None
    temperature_range: Annotated[
        float,
        Option(
            "Largest difference of the temperatures of block and axis, in K.",
            "block-temperature-range",
            min=0.0,
        ),
    ] = 0.0
    dial_error_um: Annotated[
        float, Option("Limit of the dial's error over its range, in µm.", "dial-error", min=0.0)
    ] = 0.0
    dial_digit_um: Annotated[
        float,
        Option("Last digit of the dial, in µm, to say how good the walk can become.", "dial-digit", min=0.01),
    ] = 1.0

    @property
    def is_walk(self) -> bool:
        """Whether a block is walked."""
        return self.method is Method.BLOCK_WALK

    @property
    def is_asked(self) -> bool:
        """Whether any option about a walk was given."""
        return self != WalkOptions(self.method)


@dataclass(frozen=True, slots=True)
class Pace(Options):
    """How the axis moves from stop to stop, and when it counts as arrived."""

    dwell_s: Annotated[float, Option("Seconds between arrival and reading.", "dwell", min=0.0)] = 2.0
    speed: Annotated[
        float | None, Option("Only to estimate the time, in units/s; the drive uses its own speed.")
    ] = None
    window: Annotated[
        float | None, Option("Distance to a target within which the axis has arrived; default: 0.01 mm.")
    ] = None
    move_timeout_s: Annotated[
        float, Option("Longest time of a move, in seconds.", "move-timeout", min=0.1)
    ] = 120.0


@dataclass(frozen=True, slots=True)
class InstrumentOptions(Options):
    """The instrument, and how its display becomes a machine position. Default: a person reads it."""

    csv: Annotated[Path | None, Option("Take readings from this file; the instrument appends rows.")] = None
    column: Annotated[str, Option("With --csv: name or number (from 1) of the column.")] = "1"
    delimiter: Annotated[str, Option("With --csv: character between columns; tab is one too.")] = ","
    gauge: Annotated[
        str | None, Option("Take readings from a gauge on this serial port.", metavar="PORT")
    ] = None
    kind: Annotated[GaugeKind, Option("Output format of the gauge.", "gauge-kind")] = GaugeKind.SYLVAC
    baudrate: Annotated[int | None, Option("Default: 9600; 4800 for sylvac.", "gauge-baud", min=1)] = None
    request: Annotated[
        str | None,
        Option(
            "Command that asks the gauge for a reading, without CR; empty: press its button. Default: "
            "? for sylvac, M1? for millimar.",
            "gauge-request",
        ),
    ] = None
    pattern: Annotated[
        str | None,
        Option(
            "With --gauge-kind pattern: regular expression of a whole line, with a group value for "
            "the number.",
            "gauge-pattern",
            "REGEX",
        ),
    ] = None
    timeout_s: Annotated[
        float, Option("Longest wait for an answer, in seconds.", "gauge-timeout", min=0.1)
    ] = 5.0
    units: Annotated[
        str | None,
        Option("Units of the instrument: mm, um or inch; default: those of the axis.", "reading-units"),
    ] = None
    is_reversed: Annotated[
        bool, Option("The instrument counts down while the axis counts up.", "reversed")
    ] = False
    zero_at: Annotated[float, Option("Machine position at which the instrument shows 0.")] = 0.0
    largest: Annotated[
        float | None,
        Option(
            "A reading further from its target counts as a mistake; default: 1 mm. With block-walk: further "
            "from the first of its placement; 0.5 mm.",
            "largest-deviation",
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class Results(Options):
    """The files for the readings and the results."""

    readings: Annotated[Path | None, Option("File of readings; default: named after axis and time.")] = None
    resume: Annotated[Path | None, Option("Continue a stopped run with its file of readings.")] = None
    out: Annotated[Path | None, Option("Write the table to this file.")] = None
    out_format: Annotated[
        str | None, Option("Format of --out; default: that of the active table, or csv.")
    ] = None
    table_step: Annotated[
        float | None,
        Option(
            "Even grid for the new table, over the whole travel: for a format that begins at home. "
            "Default: --step, if the table cannot be written at the targets."
        ),
    ] = None
    force: Annotated[bool, Option("Overwrite the files of --out and --report.")] = False
    report: Annotated[Path | None, Option("Write a report: .html, .png or .svg.")] = None
    before: Annotated[Path | None, Option("With --report: readings without the table, to compare.")] = None


@dataclass(frozen=True, slots=True)
class MeasureOptions:
    """All options."""

    choice: AxisChoice
    grid: Grid = Grid()
    pace: Pace = Pace()
    reader: InstrumentOptions = InstrumentOptions()
    results: Results = Results()
    walk: WalkOptions = WalkOptions()
    stated: StatedOptions = field(default_factory=StatedOptions)
