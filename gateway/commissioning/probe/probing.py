"""Checks of the drives of lines, as one call: their answers, or their times. Nothing is written.

    report = await probe(load(path).plan.lines)
    for line in report.lines(): print(line)

Not while the gateway runs: a line belongs to one program only.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from gateway.commissioning.probe.judgement import ProbeFinding, Weight, findings_of, ids_text, position_of
from gateway.commissioning.probe.readings import (
    RETURNED,
    AxisReadings,
    ask_unused_unit,
    ask_with_wrong_crc,
    read_axis,
    scan,
)
from gateway.commissioning.probe.timing import LineTimes, measure_line
from gateway.options import OptionError
from gateway.plain import JsonObject
from gateway.state.plan import LinePlan
from gateway.transport.errors import TransportError
from gateway.transport.framing import endpoint_key, returns_requests
from gateway.transport.master import ModbusMaster

BEFORE_THE_FIRST_MOVE: Final = (
    "check that the controller's own pitch and backlash compensation are off",
    "check size and sign of counts_per_unit: move by 1 mm, then pitch-gateway signtest --moved",
    "check sense and columns of the table with pitch-gateway signtest",
    "make the first moves slow and short, in the middle of the travel",
)


@dataclass(frozen=True, slots=True)
class Probed:
    """The readings of axes with their meaning, and the lines that could not be reached."""

    axes: tuple[tuple[AxisReadings, tuple[ProbeFinding, ...]], ...]
    problems: tuple[str, ...]

    @property
    def is_good(self) -> bool:
        """Whether every line was reached, and no axis has an error."""
        return not self.problems and not any(_is_wrong(findings) for _, findings in self.axes)

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        axes = {found.plan.name: _axis_data(found, findings) for found, findings in self.axes}
        return {"axes": axes, "problems": list(self.problems)}

    def lines(self) -> Iterator[str]:
        """Yield it in words, without the problems."""
        for found, findings in self.axes:
            yield from _axis_lines(found, findings)
        if self.axes:
            yield "\nBefore the first move:"
            yield from (f"  - {question}" for question in BEFORE_THE_FIRST_MOVE)


@dataclass(frozen=True, slots=True)
class Timed:
    """The response times of drives, and the lines that could not be reached."""

    times: tuple[LineTimes, ...]
    problems: tuple[str, ...]

    @property
    def is_good(self) -> bool:
        """Whether every line was reached, and time-outs can be proposed for it."""
        return not self.problems and not any(each.problem for each in self.times)

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        lines = {each.line.name: each.as_data() for each in self.times}
        return {"lines": lines, "problems": list(self.problems)}

    def lines(self) -> Iterator[str]:
        """Yield it in words, without the problems."""
        for each in self.times:
            yield from each.lines()


async def probe(
    lines: Sequence[LinePlan],
    axis: str | None = None,
    *,
    is_scanned: bool = False,
    on_scan: Callable[[LinePlan], None] = lambda _: None,
) -> Probed:
    """Read and check the registers in the register maps, of one axis or of all.

    ``is_scanned``: also read one register under each unit id from 1 to 247; ``on_scan`` is called with a line
    before its scan begins.

    Raises:
        OptionError: there is no such axis.
    """
    found: list[AxisReadings] = []
    problems: list[str] = []
    for line in lines_with(lines, axis):
        timing = line.timing
        master = ModbusMaster(line.drives, timing.response_timeout_ms, timing.gap_ms, timing.drain_ms)
        try:
            async with master:
                of_line = [await read_axis(master, plan) for plan in line.axes if axis in (None, plan.name)]
                found += of_line
                if is_scanned:
                    on_scan(line)
                    await scan(master, line, of_line)
                await ask_unused_unit(master, line, of_line[0])
                for each in of_line:
                    each.echoes = returns_requests(line.drives) if master.returned >= RETURNED else ""
                for each in of_line:
                    await ask_with_wrong_crc(master.exchange_with_wrong_crc, line, each)
        except TransportError as error:
            problems.append(_unreached(line, error))
    return Probed(tuple((each, tuple(findings_of(each))) for each in found), tuple(problems))


def lines_with(lines: Sequence[LinePlan], axis: str | None) -> Sequence[LinePlan]:
    """Return the lines with an axis, or the one with this axis. Raises OptionError: there is no such axis."""
    names = [plan.name for line in lines for plan in line.axes]
    if axis is not None and axis not in names:
        raise OptionError("axis", f"there is no axis {axis}; there are {', '.join(names)}")
    return [line for line in lines if any(axis in (None, plan.name) for plan in line.axes)]


async def time_drives(lines: Sequence[LinePlan]) -> Timed:
    """Measure the response times of the drives of lines to reads."""
    found: list[LineTimes] = []
    problems: list[str] = []
    for line in lines_with(lines, None):
        try:
            found.append(await measure_line(line))
        except TransportError as error:
            problems.append(_unreached(line, error))
    return Timed(tuple(found), tuple(problems))


def _unreached(line: LinePlan, error: TransportError) -> str:
    return f"line.{line.name}.drives.{endpoint_key(line.drives)}: {error.detail}"


def _is_wrong(findings: Sequence[ProbeFinding]) -> bool:
    return any(finding.weight is Weight.ERROR for finding in findings)


def _axis_data(found: AxisReadings, findings: Sequence[ProbeFinding]) -> JsonObject:
    positions = {
        name: {
            "address": reading.register.address,
            "raw": position.raw,
            "machine_position": position.corrected,
            "nominal_forward": position.forward,
            "nominal_backward": position.backward,
        }
        for name, reading in found.readings.items()
        if reading.words and reading.register.field is not None
        for position in [position_of(found.plan, reading)]
    }
    return {
        "unit_id": found.plan.unit_id,
        "units": found.plan.settings.units.value,
        "answers": found.answers,
        "answering_unit_ids": found.answering,
        "on_wrong_crc": None if found.on_wrong_crc is None else found.on_wrong_crc.value,
        "bits": {name: found.bit(name) for name in found.plan.bits},
        "positions": positions,
        "findings": [{"weight": finding.weight.value, "text": finding.text} for finding in findings],
        "wrong": _is_wrong(findings),
    }


def _axis_lines(found: AxisReadings, findings: Sequence[ProbeFinding]) -> Iterator[str]:
    plan = found.plan
    units = plan.settings.units.value
    answers = found.instead or ("answers" if found.answers else "no answer")
    yield f"axis {plan.name}, unit id {plan.unit_id}: {answers}"
    bits = [f"{name} {_bit(found.bit(name))}" for name in plan.bits]
    if bits and found.answers and not found.instead:
        yield f"  bits       {', '.join(bits)}"
    for name, reading in found.readings.items():
        if not reading.words or reading.register.field is None:
            continue
        position = position_of(plan, reading)
        yield (
            f"  {name:<10} raw {_raw(position.raw)}, machine position {position.corrected:.10g} {units}; "
            f"nominal {position.forward:.10g} forward, {position.backward:.10g} backward"
        )
    yield from (f"  {finding.weight.value}: {finding.text}" for finding in findings)
    if found.answering:
        yield f"  scan: {ids_text(found.answering)}"
    if all(finding.weight is Weight.NOTE for finding in findings):
        yield "  all values that were read are plausible"


def _raw(raw: float) -> str:
    """Return the text of a register's content in full: a count is a whole number."""
    return f"{raw:.0f}" if raw == int(raw) else f"{raw:.9g}"


def _bit(is_set: bool | None) -> str:
    return "not read" if is_set is None else "yes" if is_set else "no"
