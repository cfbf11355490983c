"""``pitch-gateway probe CONFIG``."""

import asyncio
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gateway.cli.arguments import Config
from gateway.cli.configuration import load_or_exit

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gateway.commissioning.probe.judgement import Finding
    from gateway.commissioning.probe.readings import AxisReadings
    from gateway.commissioning.probe.timing import LineTimes
    from gateway.config.load import Loaded
    from gateway.state.plan import LinePlan

BEFORE_THE_FIRST_MOVE = (
    "is the controller's own pitch and backlash compensation off?",
    "is counts_per_unit right, in size and sign? move by 1 mm: pitch-gateway signtest --moved tells",
    "are the table's sense and its columns right? pitch-gateway signtest tells",
    "make the first moves slow and short, in the middle of the travel",
)


def probe(
    config: Config,
    *,
    axis: Annotated[str | None, typer.Option("--axis", help="Only this axis.")] = None,
    timing: Annotated[
        bool,
        typer.Option("--timing", help="Measure how long the drives take instead, and propose the time-outs."),
    ] = False,
    scan: Annotated[
        bool, typer.Option("--scan", help="Read from each unit id from 1 to 247 too: which ones answer?")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Look at the real drives before anything moves. Nothing is written.

    Reads the positions and bits that the register maps name, one request at a time and with the silences that
    the drives want: does each drive answer, do the words stand in the right order, is the axis inside its
    travel and its table, do commanded and actual position agree. Behind Modbus/TCP a unit id that nothing is
    known of is asked too: where it is not answered for, other_units may have to name further devices. On a
    serial line each drive gets one read with a wrong check sum, which it has to pass over in silence.

    With --scan one register is read under each unit id from 1 to 247, and the report names those that answer.
    Where nothing answers at once that takes 247 times response_timeout_ms.

    With --timing each drive is read a hundred times, then fifty times with as little silence before each
    request as it takes; what comes of it for response_timeout_ms, drain_ms and gap_ms is printed, with what
    they cost. Only reads are measured: a drive that stores something may take longer.

    Not while the gateway runs: a line belongs to one program only. Exit code 1 when anything is wrong.

    Examples:
        pitch-gateway probe gateway.toml

        pitch-gateway probe gateway.toml --timing

        pitch-gateway probe gateway.toml --scan

        pitch-gateway probe gateway.toml --axis x --json | jq .axes.x
    """
    loaded = load_or_exit(config)
    lines = _lines(loaded, config, axis)
    problems: list[str] = []
    _refuse_beside_gateway(loaded, config)
    if timing:
        if axis is not None:
            raise typer.BadParameter("all drives of a line share its time-outs", param_hint="--axis")
        if scan:
            raise typer.BadParameter("--timing measures, --scan looks: give one of them", param_hint="--scan")
        _time(config, lines, as_json=as_json)
        return
    found = asyncio.run(_probe(lines, axis, problems, is_scanned=scan))
    reports = {readings.plan.name: _report(readings) for readings in found}
    if as_json:
        typer.echo(json.dumps({"axes": reports, "problems": problems}))
    else:
        for readings in found:
            for text in _text(readings):
                typer.echo(text)
        _say_before_the_first_move(bool(found))
    for problem in problems:
        typer.echo(f"{config}: {problem}", err=True)
    if problems or any(report["wrong"] for report in reports.values()):
        raise typer.Exit(1)


def _lines(loaded: "Loaded", config: Path, axis: str | None) -> "list[LinePlan]":
    names = [plan.name for line in loaded.plan.lines for plan in line.axes]
    if axis is not None and axis not in names:
        typer.echo(f"{config}: there is no axis {axis}; there are {', '.join(names)}", err=True)
        raise typer.Exit(1)
    return [line for line in loaded.plan.lines if any(axis in (None, plan.name) for plan in line.axes)]


def _refuse_beside_gateway(loaded: "Loaded", config: Path) -> None:
    from gateway.ipc.client import NobodyListensError, NoGatewayError, ask
    from gateway.ipc.messages import Ping
    from gateway.ipc.place import SocketError, socket_path

    try:
        ask(socket_path(loaded.state_folder), Ping())
    except (NobodyListensError, SocketError):
        return
    except NoGatewayError:
        pass  # somebody is there, of another release perhaps, and has the drives
    typer.echo(
        f"{config}: its gateway runs and has the drives. pitch-gateway status {config} says whether they "
        f"answer, and pitch-gateway capture {config} --follow shows each frame; to probe, stop the gateway "
        "first",
        err=True,
    )
    raise typer.Exit(1)


async def _probe(
    lines: "list[LinePlan]", axis: str | None, problems: list[str], *, is_scanned: bool
) -> "list[AxisReadings]":
    from gateway.commissioning.probe.readings import (
        RETURNED,
        ask_unused_unit,
        ask_with_wrong_crc,
        read_axis,
        scan,
    )
    from gateway.transport.errors import TransportError
    from gateway.transport.framing import endpoint_key, returns_requests
    from gateway.transport.master import ModbusMaster

    found = []
    for line in lines:
        timing = line.timing
        master = ModbusMaster(line.drives, timing.response_timeout_ms, timing.gap_ms, timing.drain_ms)
        try:
            async with master:
                of_line = [await read_axis(master, plan) for plan in line.axes if axis in (None, plan.name)]
                found += of_line
                if is_scanned:
                    _say_scan(line)
                    await scan(master, line, of_line)
                await ask_unused_unit(master, line, of_line[0])
                for each in of_line:
                    each.echoes = returns_requests(line.drives) if master.returned >= RETURNED else ""
                for each in of_line:
                    await ask_with_wrong_crc(master.exchange_spoilt, line, each)
        except TransportError as error:
            problems.append(f"line.{line.name}.drives.{endpoint_key(line.drives)}: {error.detail}")
    return found


def _say_scan(line: "LinePlan") -> None:
    from gateway.commissioning.probe.readings import LAST_UNIT_ID
    from gateway.times import NS_PER_MS, NS_PER_S, span

    at_most = span(LAST_UNIT_ID * line.timing.response_timeout_ms * NS_PER_MS / NS_PER_S)
    typer.echo(
        f"line {line.name}: asks unit ids 1 to {LAST_UNIT_ID}, for {at_most} at most; Ctrl-C ends it",
        err=True,
    )


def _time(config: Path, lines: "list[LinePlan]", *, as_json: bool) -> None:
    """Measure lines, say what was found; exit code 1 where something does not answer."""
    problems: list[str] = []
    found = asyncio.run(_measure(lines, problems))
    if as_json:
        data = {times.line.name: times.as_data() for times in found}
        typer.echo(json.dumps({"lines": data, "problems": problems}))
    else:
        from gateway.commissioning.probe.timing import timing_lines

        for times in found:
            for text in timing_lines(times):
                typer.echo(text)
    for problem in problems:
        typer.echo(f"{config}: {problem}", err=True)
    if problems or any(times.problem for times in found):
        raise typer.Exit(1)


async def _measure(lines: "list[LinePlan]", problems: list[str]) -> "list[LineTimes]":
    from gateway.commissioning.probe.timing import measure_line
    from gateway.transport.errors import TransportError
    from gateway.transport.framing import endpoint_key

    found = []
    for line in lines:
        try:
            found.append(await measure_line(line))
        except TransportError as error:
            problems.append(f"line.{line.name}.drives.{endpoint_key(line.drives)}: {error.detail}")
    return found


def _report(found: "AxisReadings") -> dict[str, Any]:
    from gateway.commissioning.probe.judgement import Weight, findings_of, position_of

    findings = findings_of(found)
    positions = {
        name: {
            "address": reading.place.address,
            "raw": place.raw,
            "machine_position": place.corrected,
            "nominal_forward": place.forward,
            "nominal_backward": place.backward,
        }
        for name, reading in found.readings.items()
        if reading.words and reading.place.field is not None
        for place in [position_of(found.plan, reading)]
    }
    bits = {name: found.bit(name) for name in found.plan.bits}
    return {
        "unit_id": found.plan.unit_id,
        "units": found.plan.settings.units.value,
        "answers": found.answers,
        "answering_unit_ids": found.answering,
        "on_wrong_crc": None if found.on_wrong_crc is None else found.on_wrong_crc.value,
        "bits": bits,
        "positions": positions,
        "findings": [{"weight": finding.weight.value, "text": finding.text} for finding in findings],
        "wrong": any(finding.weight is Weight.ERROR for finding in findings),
    }


def _text(found: "AxisReadings") -> "Iterator[str]":
    from gateway.commissioning.probe.judgement import Weight, findings_of, position_of, said_ids

    plan = found.plan
    units = plan.settings.units.value
    answers = found.instead or ("answers" if found.answers else "no answer")
    yield f"axis {plan.name}, unit id {plan.unit_id}: {answers}"
    bits = [f"{name} {_bit(found.bit(name))}" for name in plan.bits]
    if bits and found.answers and not found.instead:
        yield f"  bits       {', '.join(bits)}"
    for name, reading in found.readings.items():
        if not reading.words or reading.place.field is None:
            continue
        place = position_of(plan, reading)
        yield (
            f"  {name:<10} raw {_raw(place.raw)}, machine position {place.corrected:.10g} {units}; "
            f"nominal {place.forward:.10g} forward, {place.backward:.10g} backward"
        )
    findings = findings_of(found)
    yield from (_line(finding) for finding in findings)
    if found.answering:
        yield f"  scan: {said_ids(found.answering)}"
    if all(finding.weight is Weight.NOTE for finding in findings):
        yield "  nothing that was read is wrong"


def _raw(raw: float) -> str:
    """Write the content of a register in full: a count is a whole number."""
    return f"{raw:.0f}" if raw == int(raw) else f"{raw:.9g}"


def _bit(is_set: bool | None) -> str:
    return "not read" if is_set is None else "yes" if is_set else "no"


def _line(finding: "Finding") -> str:
    return f"  {finding.weight.value}: {finding.text}"


def _say_before_the_first_move(has_axes: bool) -> None:
    if has_axes:
        typer.echo("\nBefore the first move:")
        for question in BEFORE_THE_FIRST_MOVE:
            typer.echo(f"  - {question}")
