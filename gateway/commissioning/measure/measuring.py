"""Measuring an axis, from options to results: checks, moves, and makes a table.

    reader = InstrumentOptions(gauge="/dev/ttyUSB0")
    options = MeasureOptions(AxisChoice("x"), Grid(0.0, 100.0, step=10.0), reader=reader)
    measuring = Measuring(load(path), options)
    measuring.check_ready()
    measuring.run(showing)
    print(measuring.result().outcome.evaluation.accuracy)

THE AXIS MOVES in :meth:`Measuring.run`, and nowhere else.
"""

import asyncio
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gateway.commissioning.measure import outcome
from gateway.commissioning.measure.axis_link import recipe_of
from gateway.commissioning.measure.checks import axis_of, check_same_plan, controller_of
from gateway.commissioning.measure.errors import (
    AxisError,
    EndedEarlyError,
    FileError,
    InstrumentError,
    MeasureError,
)
from gateway.commissioning.measure.instruments import GrowingCsv, Instrument, Keyboard, Lines, SerialGauge
from gateway.commissioning.measure.options import (
    Gap,
    Grid,
    InstrumentOptions,
    MeasureOptions,
    Pace,
    WalkOptions,
)
from gateway.commissioning.measure.readings_file import (
    SUFFIX,
    Earlier,
    MeasuringPlan,
    Plan,
    ReadingsFile,
    WalkPlan,
    check_order,
    facts_of,
    read_earlier,
)
from gateway.commissioning.measure.running import RunSettings, Showing
from gateway.commissioning.measure.session import (
    AxisRoute,
    MeasureSession,
    StartConditions,
    check_ready,
    endpoint_of,
    preview,
)
from gateway.compensation.settings import DEFAULT_MAX_SLOPE
from gateway.compensation.units import Units
from gateway.config.load import Loaded
from gateway.exchange.plan import AxisPlan
from gateway.ipc.client import NoRelayError, ask_relay
from gateway.ipc.messages import GetStatus, Ping, Status
from gateway.metrology.cycle import DECIMALS, Stop, even_targets, random_targets
from gateway.metrology.errors import ReadingsError
from gateway.metrology.gauge_kinds import DEFAULTS, GaugeKind
from gateway.metrology.gauges import GaugeError, pattern_of
from gateway.metrology.lead import Period, periods_of
from gateway.metrology.readings import Reading
from gateway.metrology.standard import Standard
from gateway.metrology.walk import MOST_DIFFERENCE_MM, Walk, usual_placements
from gateway.plain import JsonObject
from gateway.state.plan import shape_of
from gateway.status.model import RelayModel
from gateway.transport.endpoints import SerialEndpoint

if TYPE_CHECKING:
    from gateway.metrology.differences import Promise

EVEN: Final = 1e-6
"""Fraction of a step by which the last target of an even grid may miss the end."""
OVERRUN_MM: Final = 1.0
WINDOW_MM: Final = 0.01
LARGEST_MM: Final = 1.0
UM_PER_MM: Final = 1000.0
SLIPPED_DIGITS: Final = 6.0
"""Both lost motions of a placement are four readings of the dial: by chance they differ by less."""


def plan_of(grid: Grid, axis: AxisPlan) -> MeasuringPlan:
    """Return the targets of the measurement. Random targets are spread over the lead, if known.

    Raises:
        AxisError: options that are missing or do not fit together.
    """
    if grid.low is None or grid.high is None:
        raise AxisError("give --from and --to: the lowest and the highest target, as machine positions")
    if (grid.step is None) == (grid.targets is None):
        raise AxisError("give --step (even targets) or --targets (number of targets, with random offsets)")
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
    return MeasuringPlan(tuple(round(target, 9) for target in targets), grid.runs, overrun)


def walk_plan_of(grid: Grid, given: WalkOptions, axis: AxisPlan) -> WalkPlan:
    """Return the walk of a block.

    Raises:
        AxisError: options that are missing or do not fit together.
    """
    if grid.low is None or grid.high is None:
        raise AxisError("give --from and --to: the ends of the walk, as machine positions")
    if grid.step is not None or grid.targets is not None:
        raise AxisError("remove --step and --targets: a block-walk has --placements instead")
    if given.block is None or given.dial_range is None:
        raise AxisError(
            "block-walk: give --block, the length of the block, and --dial-range, the range of the dial that "
            "the walk may use, such as 0.8 or 10"
        )
    units = axis.settings.units
    try:
        standard = Standard(
            given.grade,
            given.deviation_um,
            given.uncertainty_um,
            given.temperature_range,
            given.dial_error_um,
        )
        placements = given.placements
        if placements is None:
            placements = usual_placements(grid.low, grid.high, given.block, units)
        walk = Walk(
            grid.low,
            grid.high,
            given.block,
            placements,
            given.dial_range,
            grid.seed,
            given.gap is Gap.CLOSES,
            given.per_side,
        )
    except ReadingsError as error:
        raise AxisError(f"block-walk: {error}") from None
    return WalkPlan(
        walk, standard, units.from_mm(OVERRUN_MM) if grid.overrun is None else grid.overrun, units
    )


def _spread(grid: Grid) -> float | None:
    """Return the lead, if it fits between the targets."""
    assert grid.low is not None
    assert grid.high is not None
    assert grid.targets is not None
    if grid.lead is None or grid.lead * grid.targets >= grid.high - grid.low:
        return None
    return grid.lead


def instrument_of(
    reader: InstrumentOptions, lines: Lines, unit: str = "mm", *, is_walk: bool = False
) -> Instrument:
    """Return the instrument, not yet open; ``unit`` is the unit of its readings.

    Raises:
        InstrumentError: two instruments, or an invalid request.
    """
    if reader.csv is not None and reader.gauge is not None:
        raise InstrumentError("--csv and --gauge are two instruments: give only one")
    if reader.csv is not None:
        return GrowingCsv(reader.csv, reader.column, reader.delimiter)
    if reader.gauge is None:
        return Keyboard(lines, _prompt, is_walk=is_walk)
    if (reader.kind is GaugeKind.PATTERN) != (reader.pattern is not None):
        raise InstrumentError("give --gauge-kind pattern and --gauge-pattern together, or neither")
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


def run_settings_of(pace: Pace, reader: InstrumentOptions, axis: AxisPlan) -> RunSettings:
    """Return the settings of the run, in units of the axis. Raises InstrumentError: unknown units."""
    units = axis.settings.units
    window = units.from_mm(WINDOW_MM) if pace.window is None else pace.window
    largest = units.from_mm(LARGEST_MM) if reader.largest is None else reader.largest
    if not (window > 0 and largest > 0):
        raise InstrumentError("--window and --largest-deviation: greater than 0")
    return RunSettings(
        pace,
        window=window,
        largest_deviation=largest,
        sign=-1.0 if reader.is_reversed else 1.0,
        zero_at=reader.zero_at,
        scale=_factor(reader.units, units),
    )


def _factor(given: str | None, units: Units) -> float:
    if given is None:
        return 1.0
    factors = {
        "mm": units.from_mm(1.0),
        "um": units.from_mm(1.0 / UM_PER_MM),
        "inch": Units.INCH.convert_factor(units),
    }
    if given not in factors:
        raise InstrumentError(f"--reading-units {given}: allowed are {', '.join(factors)}")
    return factors[given]


def _prompt(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()


@dataclass(frozen=True, slots=True)
class RunResult:
    """The result of a whole run."""

    outcome: outcome.RunOutcome
    readings_file: Path
    written: tuple[str, ...]
    """The other written files, a line each."""

    def as_data(self) -> JsonObject:
        """Return it for a program, in units of the axis."""
        return {**self.outcome.as_data(), "readings_file": str(self.readings_file)}

    @property
    def notes(self) -> tuple[str, ...]:
        """The paths of all files, a line each."""
        return (f"the readings are in {self.readings_file}", *self.written)


def _periods(lead: float | None) -> tuple[Period, ...]:
    """Return the possible periods of the error. Raises AxisError: an invalid lead."""
    try:
        return periods_of(lead)
    except ReadingsError as error:
        raise AxisError(f"--lead: {error}") from None


class Measuring:
    """One measurement of an axis through the gateway that runs a configuration.

    First :meth:`check_ready`, then :meth:`run` if readings are missing, then :meth:`result`.
    Lengths are machine positions in units of the axis.

    Raises:
        MeasureError: the options do not fit the axis, or each other.
    """

    def __init__(self, loaded: Loaded, options: MeasureOptions) -> None:
        choice, results = options.choice, options.results
        line, plan = axis_of(loaded.plan.lines, choice.axis)
        link = controller_of(line, choice.controller)
        self._route = AxisRoute(line, recipe_of(plan), link, endpoint_of(link, choice.port))
        self._out_format = outcome.check_format(results.out_format, plan)
        outcome.check_outputs(results.out, results.report, force=results.force)
        self._lines = Lines()
        unit = options.reader.units or plan.settings.units.value
        self.is_walk = options.walk.is_walk
        if options.walk.is_asked and not self.is_walk:
            raise AxisError("the options of a block need --method block-walk")
        if options.stated.given() and self.is_walk:
            raise AxisError(
                "block-walk: remove the options --u-..., and give --dial-error and --block-temperature-range"
            )
        self._stated = options.stated
        self.instrument = instrument_of(options.reader, self._lines, unit, is_walk=self.is_walk)
        self._settings = run_settings_of(options.pace, options.reader, plan)
        self._walk = options.walk
        self._loaded = loaded
        self._shape = shape_of(loaded.plan)
        self._section = loaded.sections.axes[plan.name]
        self._grid = options.grid
        self._pace = options.pace
        self._largest = options.reader.largest
        self._results = results
        self._axis = plan
        self.units = plan.settings.units
        self._lead = self._section.lead if options.grid.lead is None else options.grid.lead
        self._periods = _periods(self._lead)
        self._earlier: Earlier | None = None
        self._table_step: float | None = None
        """Of the new table's even grid; None: its points are the targets."""
        self._before = None if results.before is None else outcome.survey_before(results.before, plan)
        self._plan: Plan | None = None
        self._seen: StartConditions | None = None
        self._left: list[Stop] = []
        self.readings_file = results.resume

    def check_ready(self) -> int:
        """Check all conditions before the axis moves; return the number of remaining stops.

        Nothing is written to the drive.

        Raises:
            MeasureError: a condition is not met.
        """
        plan, done = self._planned()
        stops = plan.stops
        if self._results.resume is not None:
            check_order(self._results.resume, stops, done)
        self._plan, self._left = plan, plan.left(len(done))
        if isinstance(plan, WalkPlan):
            self._settings = self._for_dial(plan)
        self._seen = asyncio.run(check_ready(self._route, plan, stops, self._status))
        self._check_same(self._seen)
        if self.is_walk and self._seen.compensation.is_active:
            raise AxisError(
                f"axis {self._axis.name} is compensated, but a block is walked without a table: first type "
                f"pitch-gateway disable {self._loaded.path} {self._axis.name}"
            )
        self._choose_points(plan, self._seen)
        return len(self._left)

    def preview(self) -> Iterator[str]:
        """Yield what the user must know before the axis moves, after :meth:`check_ready`."""
        plan, seen = self._looked()
        yield from preview(self._route, seen, self._left, self.instrument.title, self._pace)
        for warning in plan.warnings(self._periods, self.units):
            yield f"  lead          {warning}"
        if isinstance(plan, WalkPlan):
            walk = plan.walk
            yield f"  placements    {walk.placements}, with {walk.readings} readings each; Enter between them"
            yield f"  how good      {self._promised(plan)}"

    @property
    def _digit(self) -> float:
        """The last digit of the dial."""
        return self.units.from_mm(self._walk.dial_digit_um / UM_PER_MM)

    def _broken_off(self, done: int) -> int:
        """Return how many of ``done`` readings are of a placement that was not complete: its zero is lost."""
        return done % self._plan.walk.readings if isinstance(self._plan, WalkPlan) else 0

    def _promised(self, plan: WalkPlan) -> str:
        """Return how good the table can become, in words."""
        words = self._promise(plan).describe(self.units, is_scale_known=plan.standard.is_length_known)
        return f"{words} (block: {plan.standard.describe()}; a dial of {self._walk.dial_digit_um:g} µm)"

    def _promise(self, plan: WalkPlan) -> "Promise":
        from gateway.metrology.differences import promise

        return promise(plan.walk, plan.standard, self.units, self._digit)

    @property
    def gap(self) -> float | None:
        """1 if the gap of the dial opens while the axis moves forward, -1 if it closes; None: no walk."""
        return self._settings.gap

    def run(self, showing: Showing, *, can_ask: bool = False) -> None:
        """Move the axis from stop to stop and read at each. On return it is at standstill.

        SIGINT, SIGTERM and SIGHUP stop it. ``can_ask``: a person at standard input decides whether an invalid
        reading is repeated.

        Raises:
            EndedEarlyError: it did not finish.
            MeasureError: the file of readings cannot be written.
        """
        plan, seen = self._looked()
        done = 0 if self._earlier is None else len(self._earlier.readings)
        done -= self._broken_off(done)
        with self._file(plan, seen) as file:
            session = MeasureSession(self._route, self.instrument, self._settings, file, showing)
            total = sum(stop.measure for stop in plan.stops)
            has_person = can_ask or self.is_walk
            try:
                showing.begin(total, done)
                if isinstance(plan, WalkPlan):
                    showing.happened("promise", self._promise(plan).as_data(self.units))
                asyncio.run(session.run(self._left, seen, self._status, self._lines if has_person else None))
            except MeasureError as error:
                took = done + len(session.readings)
                if not took and self._results.resume is None:
                    file.path.unlink(missing_ok=True)
                raise EndedEarlyError(str(error), took, session.stopped_by) from error

    def result(self) -> RunResult:
        """Evaluate all readings in their file, which is kept in any case.

        Raises:
            MeasureError: they make no table, or a file cannot be written.
        """
        _, seen = self._looked()
        path, results = self.readings_file, self._results
        assert path is not None, "there is one after run, or with resume"
        try:
            survey = outcome.survey_of(path, self._axis)
            found = outcome.outcome_of(
                survey, self._axis, is_active=seen.compensation.is_active, periods=self._periods,
                step=self._table_step,
                refusal=lambda table: outcome.refusal(self._out_format, table, self._axis, self._section),
            )  # fmt: skip
            written = []
            if results.out is not None:
                written += outcome.write_table(
                    found, results.out, self._out_format, self._axis, self._section, force=results.force
                )
            if results.report is not None:
                outcome.write_report(
                    found, results.report, self._axis.name, self._before, force=results.force
                )
                written.append(f"{results.report}: the report")
        except MeasureError as error:
            raise MeasureError(f"{error} (the readings are in {path})") from None
        return RunResult(found, path, tuple(written))

    def _looked(self) -> tuple[Plan, StartConditions]:
        assert self._plan is not None, "look comes first"
        assert self._seen is not None
        return self._plan, self._seen

    def _planned(self) -> tuple[Plan, tuple[Reading, ...]]:
        resume = self._results.resume
        if resume is None and self.is_walk:
            return walk_plan_of(self._grid, self._walk, self._axis), ()
        if resume is None:
            return plan_of(replace(self._grid, lead=self._lead), self._axis), ()
        is_asked = self._grid.is_asked or self._walk.is_asked or bool(self._stated.given())
        if is_asked or self._results.readings is not None:
            raise FileError(
                "--resume: the file defines the measurement: remove targets, --readings and options --u-..."
            )
        self._earlier = earlier = read_earlier(resume, self.units)
        if earlier.facts.get("axis") != self._axis.name:
            raise FileError(f"{resume}: is a measurement of axis {earlier.facts.get('axis')}")
        if isinstance(earlier.plan, WalkPlan) and not self.is_walk:
            raise FileError(f"{resume}: is a walk of a block: give --method block-walk too")
        return earlier.plan, earlier.readings

    def _check_same(self, seen: StartConditions) -> None:
        """Refuse readings with and without a table, or with two tables: they make no table."""
        if self._earlier is None:
            return
        was = self._earlier.facts.get("compensation")
        if was != seen.compensation.fact:
            raise FileError(
                f"{self._results.resume}: was measured with compensation {was}, now it is "
                f"{seen.compensation.fact}: set it back, or start a new measurement"
            )

    def _for_dial(self, plan: WalkPlan) -> RunSettings:
        """Return the settings for readings of a dial."""
        largest = self._settings.largest_deviation
        if self._largest is None:
            largest = self.units.from_mm(MOST_DIFFERENCE_MM)
        return replace(
            self._settings,
            gap=-1.0 if plan.walk.closes else 1.0,
            largest_deviation=largest,
            per_placement=plan.walk.readings,
            slipped=SLIPPED_DIGITS * self._digit,
        )

    def _choose_points(self, plan: Plan, seen: StartConditions) -> None:
        """Choose the points of the new table before the run. Raises FileError: it cannot be written."""
        results, axis, section = self._results, self._axis, self._section
        if seen.compensation.is_active and axis.table is not None:
            if results.table_step is not None:
                raise FileError("remove --table-step: the table in use is refined at its own points")
            if results.out is not None:
                outcome.check_writable(self._out_format, axis.table.positions, axis, section)
            return
        self._table_step = results.table_step
        if results.out is None or outcome.is_writable(
            self._out_format, outcome.points_of(plan.targets, self._table_step, axis), axis, section
        ):
            return
        if self._table_step is None:
            self._table_step = self._grid.step
        points = outcome.points_of(plan.targets, self._table_step, axis)
        outcome.check_writable(self._out_format, points, axis, section)

    def _status(self) -> RelayModel:
        """Return the status of the gateway that runs the configuration. Raises AxisError: none runs."""
        config, state = self._loaded.path, self._loaded.state_folder
        try:
            check_same_plan(ask_relay(config, state, Ping()), self._shape)
            reply = ask_relay(config, state, GetStatus())
        except NoRelayError as error:
            raise AxisError(str(error)) from None
        assert isinstance(reply, Status)
        return reply.status

    @contextmanager
    def _file(self, plan: Plan, seen: StartConditions) -> Iterator[ReadingsFile]:
        results, axis = self._results, self._axis
        now = time.strftime("%Y-%m-%dT%H:%M:%S%z")
        if results.resume is not None:
            file = ReadingsFile(results.resume, self.units, self._settings.gap)
            file.go_on()
            if self._earlier is not None:
                file.take_back(self._broken_off(len(self._earlier.readings)))
        else:
            stamp = time.strftime("%Y%m%d-%H%M%S")
            file = ReadingsFile(
                results.readings or Path(f"{axis.name}-{stamp}{SUFFIX}"), self.units, self._settings.gap
            )
            facts = facts_of(plan, axis.name, seen.compensation.fact, self.units)
            if self._lead is not None:
                facts["lead"] = f"{self._lead:.9g}"
            if axis.settings.max_slope != DEFAULT_MAX_SLOPE:
                facts["max_slope"] = f"{axis.settings.max_slope:g}"
            facts |= {name: f"{value:g}" for name, value in self._stated.given().items()}
            file.create({**facts, "instrument": self.instrument.title, "measured": now})
        self.readings_file = file.path
        try:
            yield file
        finally:
            file.close()
