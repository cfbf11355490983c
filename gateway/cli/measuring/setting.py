"""What was asked for, made into a plan of targets, an instrument and manners; nothing is opened here."""

import sys
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Final

from gateway.cli.measuring.errors import AxisError, InstrumentError
from gateway.cli.measuring.instruments import GrowingCsv, Instrument, Keyboard, Lines, SerialGauge
from gateway.cli.measuring.readings_file import MeasuringPlan
from gateway.cli.measuring.running import Manners
from gateway.compensation.units import Units
from gateway.exchange.plan import AxisPlan
from gateway.metrology.errors import ReadingsError
from gateway.metrology.gauge_kinds import GaugeKind
from gateway.metrology.gauges import DEFAULTS, GaugeError, pattern_of
from gateway.metrology.program import DECIMALS, even_targets, random_targets
from gateway.transport.endpoints import SerialEndpoint

EVEN: Final = 1e-6
"""Part of a step by which the last target of an even grid may miss the end."""
OVERRUN_MM: Final = 1.0
WINDOW_MM: Final = 0.01
LARGEST_MM: Final = 1.0
UM_PER_MM: Final = 1000.0


@dataclass(frozen=True, slots=True)
class Grid:
    """Targets as they were asked for, in units of the axis."""

    low: float | None = None
    high: float | None = None
    step: float | None = None
    targets: int | None = None
    spread: float | None = None
    seed: int = 1
    runs: int = 5
    overrun: float | None = None
    lead: float | None = None

    @property
    def is_asked(self) -> bool:
        """Whether anything was said about targets."""
        return any(each is not None for each in (self.low, self.high, self.step, self.targets, self.overrun))


@dataclass(frozen=True, slots=True)
class Reader:
    """The instrument as it was asked for."""

    csv: Path | None = None
    column: str = "1"
    delimiter: str = ","
    gauge: str | None = None
    kind: GaugeKind = GaugeKind.SYLVAC
    baudrate: int | None = None
    request: str | None = None
    timeout_s: float = 5.0
    pattern: str | None = None


@dataclass(frozen=True, slots=True)
class Scale:
    """How a reading becomes a machine position, and how long one waits for it."""

    dwell_s: float = 2.0
    window: float | None = None
    move_timeout_s: float = 120.0
    largest: float | None = None
    is_reversed: bool = False
    zero_at: float = 0.0
    units: str | None = None


def plan_of(grid: Grid, axis: AxisPlan) -> MeasuringPlan:
    """Return what is to be measured. Random targets are spread over the lead, where that is known.

    Raises:
        AxisError: options that are missing or do not fit together.
    """
    if grid.low is None or grid.high is None:
        raise AxisError("give --from and --to: the lowest and the highest target, as machine positions")
    if (grid.step is None) == (grid.targets is None):
        raise AxisError("give one of --step (even targets) and --targets (so many, with random offsets)")
    try:
        if grid.step is not None:
            targets = even_targets(grid.low, grid.high, grid.step)
            if abs(targets[-1] - grid.high) > EVEN * grid.step:
                raise AxisError(
                    f"--step {grid.step:g} does not lead from {grid.low:.9g} to {grid.high:.9g}: end at "
                    f"--to {targets[-1]:.9g}, or give another step"
                )
        else:
            assert grid.targets is not None
            decimals = DECIMALS[axis.settings.units]
            spread = _spread(grid) if grid.spread is None else grid.spread
            targets = random_targets(
                grid.low, grid.high, grid.targets, seed=grid.seed, spread=spread, decimals=decimals
            )
    except ReadingsError as error:
        raise AxisError(str(error)) from None
    units = axis.settings.units
    overrun = units.from_mm(OVERRUN_MM) if grid.overrun is None else grid.overrun
    if not isfinite(overrun):
        raise AxisError(f"--overrun {overrun}: it must be a finite length")
    return MeasuringPlan(tuple(round(target, 9) for target in targets), grid.runs, overrun)


def _spread(grid: Grid) -> float | None:
    """Return the lead, where the targets leave room for it."""
    assert grid.low is not None
    assert grid.high is not None
    assert grid.targets is not None
    if grid.lead is None or grid.lead * grid.targets >= grid.high - grid.low:
        return None
    return grid.lead


def instrument_of(reader: Reader, lines: Lines, unit: str = "mm") -> Instrument:
    """Return the instrument, not yet open; ``unit`` is the one in which its readings are taken.

    Raises:
        InstrumentError: two of them, or a wrong request.
    """
    if reader.csv is not None and reader.gauge is not None:
        raise InstrumentError("--csv and --gauge are two instruments: give one")
    if reader.csv is not None:
        return GrowingCsv(reader.csv, reader.column, reader.delimiter)
    if reader.gauge is None:
        return Keyboard(lines, _prompt)
    if (reader.kind is GaugeKind.PATTERN) != (reader.pattern is not None):
        raise InstrumentError("--gauge-kind pattern and --gauge-pattern belong together: give both or none")
    try:
        pattern = None if reader.pattern is None else pattern_of(reader.pattern)
    except GaugeError as error:
        raise InstrumentError(str(error)) from None
    usual = DEFAULTS[reader.kind]
    request = usual.request
    if reader.request is not None:
        if not reader.request.isascii():
            raise InstrumentError("--gauge-request: it must be ASCII")
        request = reader.request + "\r" if reader.request else ""
    endpoint = SerialEndpoint(
        reader.gauge,
        reader.baudrate or usual.baudrate,
        usual.parity,
        usual.data_bits,
        usual.stop_bits,
        low_latency=False,
    )
    return SerialGauge(reader.kind, endpoint, request, reader.timeout_s, pattern=pattern, unit=unit)


def manners_of(scale: Scale, axis: AxisPlan) -> Manners:
    """Return how the run goes, in units of the axis. Raises InstrumentError: unknown units."""
    units = axis.settings.units
    window = units.from_mm(WINDOW_MM) if scale.window is None else scale.window
    largest = units.from_mm(LARGEST_MM) if scale.largest is None else scale.largest
    if not (
        window > 0 and largest > 0 and isfinite(window) and isfinite(largest) and isfinite(scale.zero_at)
    ):
        raise InstrumentError("--window and --largest-deviation: greater than 0; --zero-at: a position")
    return Manners(
        dwell_s=scale.dwell_s,
        window=window,
        move_timeout_s=scale.move_timeout_s,
        largest_deviation=largest,
        sign=-1.0 if scale.is_reversed else 1.0,
        zero_at=scale.zero_at,
        scale=_factor(scale.units, units),
    )


def _factor(told: str | None, units: Units) -> float:
    if told is None:
        return 1.0
    factors = {
        "mm": units.from_mm(1.0),
        "um": units.from_mm(1.0 / UM_PER_MM),
        "inch": Units.INCH.convert_factor(units),
    }
    if told not in factors:
        raise InstrumentError(f"--reading-units {told}: allowed are {', '.join(factors)}")
    return factors[told]


def _prompt(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()
