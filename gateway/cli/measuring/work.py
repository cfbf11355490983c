"""One measuring command from its options to its results: looks, asks, moves, and makes a table of it."""

import asyncio
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from signal import SIGINT
from typing import Any, Final

import typer

from gateway.cli.commanding import NoAnswerError, ask_relay
from gateway.cli.measuring import outcome
from gateway.cli.measuring.checks import axis_of, check_same_plan, controller_of
from gateway.cli.measuring.errors import AxisError, FileError, MeasureError
from gateway.cli.measuring.instruments import Instrument, Keyboard, Lines
from gateway.cli.measuring.preview import Pace, preview
from gateway.cli.measuring.readings_file import (
    SUFFIX,
    Earlier,
    MeasuringPlan,
    ReadingsFile,
    check_order,
    facts_of,
    read_earlier,
)
from gateway.cli.measuring.recipe import recipe_of
from gateway.cli.measuring.running import Manners
from gateway.cli.measuring.session import Place, Seen, Session, endpoint_of, look
from gateway.cli.measuring.setting import Grid, Reader, Scale, instrument_of, manners_of, plan_of
from gateway.cli.measuring.showing import AsBar, AsJson, AsLines, Showing
from gateway.compensation.settings import DEFAULT_MAX_SLOPE
from gateway.config.axis_model import AxisSection
from gateway.ipc.messages import GetStatus, Ping, Status
from gateway.metrology.cycle import bidirectional_cycle, remaining
from gateway.metrology.errors import ReadingsError
from gateway.metrology.lead import Period, lead_warnings, periods_of
from gateway.metrology.readings import Reading
from gateway.state.plan import GatewayPlan, shape_of

STOPPED_BY_SIGNAL: Final = 128
"""Added to the number of a signal, this is the exit code of a command that it stopped, as in a shell."""


@dataclass(frozen=True, slots=True)
class Wish:
    """Everything that the command line says."""

    config: Path
    axis: str
    controller: str | None
    port: str | None
    grid: Grid
    reader: Reader
    scale: Scale
    speed: float | None
    readings: Path | None
    resume: Path | None
    out: Path | None
    out_format: str | None
    table_step: float | None
    report: Path | None
    before: Path | None
    force: bool
    yes: bool
    as_json: bool


def work(wish: Wish, plan: GatewayPlan, sections: Mapping[str, AxisSection], state: Path) -> int:
    """Do all of it; returns the exit code. ``sections`` are the axes of the configuration.

    Raises:
        MeasureError: it could not begin, or its results could not be made or written.
    """
    line, axis = axis_of(plan.lines, wish.axis)
    link = controller_of(line, wish.controller)
    place = Place(line, recipe_of(axis), link, endpoint_of(link, wish.port))
    out_format = outcome.check_format(wish.out_format, axis)
    outcome.check_places(wish.out, wish.report, force=wish.force)
    lines = Lines()
    unit = wish.scale.units or axis.settings.units.value
    instrument, manners = instrument_of(wish.reader, lines, unit), manners_of(wish.scale, axis)
    done = _Work(wish, place, state, sections[axis.name], shape=shape_of(plan), out_format=out_format)
    return done.run(instrument, manners, lines)


def _periods(lead: float | None) -> tuple[Period, ...]:
    """Return what the error may repeat with. Raises AxisError: a lead that is no length."""
    try:
        return periods_of(lead)
    except ReadingsError as error:
        raise AxisError(f"--lead: {error}") from None


class _Work:
    """One command, when its options are known to be good."""

    def __init__(
        self, wish: Wish, place: Place, state: Path, section: AxisSection, *, shape: str, out_format: str
    ) -> None:
        self._wish = wish
        self._place = place
        self._state = state
        self._section = section
        self._shape = shape
        self._out_format = out_format
        self._axis = place.recipe.plan
        self._units = self._axis.settings.units
        self._lead = section.lead if wish.grid.lead is None else wish.grid.lead
        self._periods = _periods(self._lead)
        self._earlier: Earlier | None = None
        self._table_step: float | None = None
        """Of the new table's even grid; None: its points are the targets."""
        self._before = None if wish.before is None else outcome.survey_before(wish.before, self._axis)

    def run(self, instrument: Instrument, manners: Manners, lines: Lines) -> int:
        plan, done = self._plan()
        stops = list(bidirectional_cycle(plan.targets, plan.overrun, plan.runs))
        if self._wish.resume is not None:
            check_order(self._wish.resume, stops, done)
        left = remaining(stops, len(done))
        seen = asyncio.run(look(self._place, plan, stops, self._status))
        self._check_same(seen)
        self._choose_points(plan, seen)
        if not left:
            return self._finish(self._wish.resume, seen)
        for text in preview(
            self._place, seen, left, instrument.title, Pace(self._wish.scale.dwell_s, self._wish.speed)
        ):
            typer.echo(text, err=True)
        for warning in lead_warnings(plan.targets, self._periods, self._units):
            typer.echo(f"  lead          {warning}", err=True)
        self._ask()
        showing = self._showing(instrument)
        with self._file(plan, seen, instrument) as file:
            session = Session(self._place, instrument, manners, file, showing)
            total = 2 * len(plan.targets) * plan.runs
            try:
                showing.begin(total, len(done))
                asyncio.run(session.run(left, seen, self._status, lines if sys.stdin.isatty() else None))
            except MeasureError as error:
                return self._ended_early(error, session, file.path, len(done))
            finally:
                showing.end()
        return self._finish(file.path, seen)

    def _plan(self) -> tuple[MeasuringPlan, tuple[Reading, ...]]:
        wish = self._wish
        if wish.resume is None:
            return plan_of(replace(wish.grid, lead=self._lead), self._axis), ()
        if wish.grid.is_asked or wish.readings is not None:
            raise FileError("--resume: the file says what is measured: leave targets and --readings away")
        self._earlier = earlier = read_earlier(wish.resume, self._units)
        if earlier.facts.get("axis") != self._axis.name:
            raise FileError(f"{wish.resume}: was begun for axis {earlier.facts.get('axis')}")
        return earlier.plan, earlier.readings

    def _check_same(self, seen: Seen) -> None:
        """Readings with and without a table, or with two tables, make no table."""
        if self._earlier is None:
            return
        was = self._earlier.facts.get("compensation")
        if was != seen.compensation.fact:
            raise FileError(
                f"{self._wish.resume}: was measured with compensation {was}, and now it is "
                f"{seen.compensation.fact}: bring it back, or measure anew"
            )

    def _choose_points(self, plan: MeasuringPlan, seen: Seen) -> None:
        """Choose the points of the new table before the work. Raises FileError: it could not be written."""
        wish, axis, section = self._wish, self._axis, self._section
        if seen.compensation.is_active and axis.table is not None:
            if wish.table_step is not None:
                raise FileError("--table-step: the table in use is refined at its own points: leave it out")
            if wish.out is not None:
                outcome.check_writable(self._out_format, axis.table.positions, axis, section)
            return
        self._table_step = wish.table_step
        if wish.out is None or outcome.is_writable(
            self._out_format, outcome.points_of(plan.targets, self._table_step, axis), axis, section
        ):
            return
        if self._table_step is None:
            self._table_step = wish.grid.step
        points = outcome.points_of(plan.targets, self._table_step, axis)
        outcome.check_writable(self._out_format, points, axis, section)

    def _status(self) -> Mapping[str, Any]:
        """Return the status of the gateway that runs CONFIG. Raises AxisError: none does."""
        try:
            check_same_plan(ask_relay(self._wish.config, self._state, Ping()), self._shape)
            reply = ask_relay(self._wish.config, self._state, GetStatus())
        except NoAnswerError as error:
            raise AxisError(str(error)) from None
        assert isinstance(reply, Status)
        return reply.status

    def _ask(self) -> None:
        if self._wish.yes:
            return
        if not sys.stdin.isatty():
            raise AxisError("nobody can be asked whether it may move: run it on a terminal, or give --yes")
        try:
            may_move = typer.confirm("Is the way free, and may it move?", err=True)
        except typer.Abort as error:  # Ctrl-C, or the end of the input
            typer.echo(f"\n{self._wish.config}: nothing was moved", err=True)
            is_signal = isinstance(error.__context__, KeyboardInterrupt)
            raise typer.Exit(STOPPED_BY_SIGNAL + SIGINT if is_signal else 1) from None
        if not may_move:
            raise AxisError("nothing was moved")

    def _showing(self, instrument: Instrument) -> Showing:
        units = self._units.value
        if self._wish.as_json:
            return AsJson(units)
        if sys.stderr.isatty() and not isinstance(instrument, Keyboard):
            return AsBar(units)
        return AsLines(units)

    @contextmanager
    def _file(self, plan: MeasuringPlan, seen: Seen, instrument: Instrument) -> Iterator[ReadingsFile]:
        wish, axis = self._wish, self._axis
        now = time.strftime("%Y-%m-%dT%H:%M:%S%z")
        if wish.resume is not None:
            file = ReadingsFile(wish.resume, self._units)
            file.go_on()
        else:
            stamp = time.strftime("%Y%m%d-%H%M%S")
            file = ReadingsFile(wish.readings or Path(f"{axis.name}-{stamp}{SUFFIX}"), self._units)
            facts = facts_of(plan, axis.name, seen.compensation.fact, self._units)
            if self._lead is not None:
                facts["lead"] = f"{self._lead:.9g}"
            if axis.settings.max_slope != DEFAULT_MAX_SLOPE:
                facts["max_slope"] = f"{axis.settings.max_slope:g}"
            file.create({**facts, "instrument": instrument.title, "measured": now})
        try:
            yield file
        finally:
            file.close()

    def _ended_early(self, error: MeasureError, session: Session, path: Path, done: int) -> int:
        typer.echo(f"{self._wish.config}: {error}", err=True)
        took = done + len(session.readings)
        if took:
            typer.echo(
                f"{took} readings are in {path}; go on with: pitch-gateway measure {self._wish.config} "
                f"--axis {self._axis.name} --resume {path} and the same instrument",
                err=True,
            )
        elif self._wish.resume is None:
            path.unlink(missing_ok=True)
        number = session.stopped_by
        return 1 if number is None else STOPPED_BY_SIGNAL + number

    def _finish(self, path: Path | None, seen: Seen) -> int:
        """Make something of all readings, as they stand in their file, whatever becomes of this."""
        assert path is not None
        wish = self._wish
        try:
            survey = outcome.survey_of(path, self._axis)
            found = outcome.outcome_of(
                survey, self._axis, is_active=seen.compensation.is_active, periods=self._periods,
                step=self._table_step,
                refusal=lambda table: outcome.refusal(self._out_format, table, self._axis, self._section),
            )  # fmt: skip
            notes = []
            if wish.out is not None:
                notes += outcome.write_table(
                    found, wish.out, self._out_format, self._axis, self._section, force=wish.force
                )
            if wish.report is not None:
                outcome.write_report(found, wish.report, self._axis.name, self._before, force=wish.force)
                notes.append(f"{wish.report}: the report")
        except MeasureError as error:
            raise MeasureError(f"{error} (the readings are in {path})") from None
        except KeyboardInterrupt:
            typer.echo(
                f"{wish.config}: Ctrl-C before all results were made; no reading is missing in {path}: "
                f"--resume {path} makes the results of them",
                err=True,
            )
            return STOPPED_BY_SIGNAL + SIGINT
        if wish.as_json:
            AsJson(self._units.value).happened(
                "result", {**outcome.json_of(found), "readings_file": str(path)}
            )
        else:
            outcome.show(found)
        for note in (f"the readings are in {path}", *notes):
            typer.echo(note, err=wish.as_json)
        return 0
